//! Writing beside other work.

use nacre_base::Result;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// A thread that prepares and writes files, and waits for the disk, so that no other one has to.
pub(crate) struct Disk(Option<ThreadPool>);

impl Disk {
    pub(crate) fn new() -> Self {
        Self(ThreadPoolBuilder::new().num_threads(1).thread_name(|_| "disk".into()).build().ok())
    }

    /// Does both at once, `writing` on the thread; one after the other where the system has no thread to give.
    pub(crate) fn beside<T>(
        &self,
        writing: impl FnOnce() -> Result<()> + Send,
        work: impl FnOnce() -> T,
    ) -> (Result<()>, T) {
        let Some(pool) = &self.0 else { return (writing(), work()) };
        let mut written = Ok(());
        let worked = pool.in_place_scope(|scope| {
            scope.spawn(|_| written = writing());
            work()
        });
        (written, worked)
    }
}

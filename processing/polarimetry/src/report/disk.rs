//! Writing in parallel with other work.

use nacre_base::Result;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// A thread that prepares and writes files and waits for the disk, so that no other thread has to.
pub(crate) struct Disk(Option<ThreadPool>);

impl Disk {
    pub(crate) fn new() -> Self {
        Self(ThreadPoolBuilder::new().num_threads(1).thread_name(|_| "disk".into()).build().ok())
    }

    /// Runs both tasks in parallel, `writing` on the thread; sequentially if the system provides no thread.
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

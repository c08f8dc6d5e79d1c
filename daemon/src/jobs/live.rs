//! The job that is being worked on, as its threads report it.

use super::worker::Shared;
use nacre_processing::progress::Progress;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use tokio::sync::mpsc;

/// Where the running job is, and whether it is to stop.
pub(super) struct Live {
    pub id: String,
    cancelled: AtomicBool,
    stage: Mutex<String>,
    steps: AtomicU64,
    done: AtomicU64,
}

impl Live {
    pub fn new(id: &str) -> Self {
        Self {
            id: id.into(),
            cancelled: AtomicBool::new(false),
            stage: Mutex::default(),
            steps: AtomicU64::new(0),
            done: AtomicU64::new(0),
        }
    }

    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    pub fn stage(&self) -> String {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Share of the stage that is done. A stage without steps has no shares.
    pub fn progress(&self) -> f64 {
        share(self.done.load(Ordering::Relaxed), self.steps.load(Ordering::Relaxed))
    }
}

fn share(done: u64, steps: u64) -> f64 {
    if steps == 0 { 0.0 } else { (done as f64 / steps as f64).min(1.0) }
}

/// Takes the reports of the computing threads.
pub(super) struct Reporter {
    pub live: Arc<Live>,
    pub shared: Arc<Shared>,
    /// Stages on their way to the log. One that finds it full is not logged: computing does not wait for the disk.
    pub stages: mpsc::Sender<String>,
}

impl Progress for Reporter {
    fn stage(&self, name: &str, steps: u64) {
        *self.live.stage.lock().unwrap_or_else(PoisonError::into_inner) = name.into();
        self.live.done.store(0, Ordering::Relaxed);
        self.live.steps.store(steps, Ordering::Relaxed);
        let _ = self.stages.try_send(name.into());
        self.shared.changed(&self.live.id);
    }

    fn step(&self) {
        let done = self.live.done.fetch_add(1, Ordering::Relaxed) + 1;
        let steps = self.live.steps.load(Ordering::Relaxed);
        // Nobody looks closer than at whole percents.
        let percent = |done| (share(done, steps) * 100.0) as u8;
        if percent(done) != percent(done - 1) {
            self.shared.changed(&self.live.id);
        }
    }

    fn cancelled(&self) -> bool {
        self.live.cancelled.load(Ordering::Relaxed) || self.shared.stopping()
    }
}

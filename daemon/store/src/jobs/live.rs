//! The job that is being worked on, as its threads report it.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

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

    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// Begins a stage.
    pub fn begin(&self, stage: &str, steps: u64) {
        *self.stage.lock().unwrap_or_else(PoisonError::into_inner) = stage.into();
        self.done.store(0, Ordering::Relaxed);
        self.steps.store(steps, Ordering::Relaxed);
    }

    /// Counts a step; returns whether the progress in whole percents has changed.
    pub fn step(&self) -> bool {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        let steps = self.steps.load(Ordering::Relaxed);
        let percent = |done| (share(done, steps) * 100.0) as u8;
        percent(done) != percent(done - 1)
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

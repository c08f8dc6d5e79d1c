//! Live state of the running job, as its threads report it.

use nacre_base::estimate::{Running, Work};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

/// Progress of the running job, and its cancellation.
pub(super) struct Live {
    pub id: String,
    cancelled: AtomicBool,
    enough: AtomicBool,
    stage: Mutex<String>,
    steps: AtomicU64,
    done: AtomicU64,
    running: Mutex<Option<Running>>,
}

impl Live {
    pub fn new(id: &str) -> Self {
        Self {
            id: id.into(),
            cancelled: AtomicBool::new(false),
            enough: AtomicBool::new(false),
            stage: Mutex::default(),
            steps: AtomicU64::new(0),
            done: AtomicU64::new(0),
            running: Mutex::default(),
        }
    }

    /// Records the job's estimate of time, memory and disk.
    pub fn expect(&self, work: &Work) {
        let mut running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        // An operation within another one also reports an estimate; only the first counts.
        running.get_or_insert_with(|| Running::begin(work.clone()));
    }

    /// Remaining time in seconds, once the job has reported its estimate.
    pub fn remaining_s(&self) -> Option<f64> {
        let running = self.running.lock().unwrap_or_else(PoisonError::into_inner);
        running.as_ref().map(Running::remaining_s)
    }

    /// Sets the progress to 1.
    pub fn complete(&self) {
        let running = self.running.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(running) = running {
            running.complete();
        }
    }

    pub fn cancel(&self) {
        self.cancelled.store(true, Ordering::Relaxed);
    }

    pub fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    /// Asks for the result so far.
    pub fn finish(&self) {
        self.enough.store(true, Ordering::Relaxed);
    }

    pub fn is_enough(&self) -> bool {
        self.enough.load(Ordering::Relaxed)
    }

    /// Begins a stage.
    pub fn begin(&self, stage: &str, steps: u64) {
        *self.stage.lock().unwrap_or_else(PoisonError::into_inner) = stage.into();
        self.done.store(0, Ordering::Relaxed);
        self.steps.store(steps, Ordering::Relaxed);
    }

    /// Counts a step; returns whether the progress in whole percent has changed.
    pub fn step(&self) -> bool {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        let steps = self.steps.load(Ordering::Relaxed);
        let percent = |done| (share(done, steps) * 100.0) as u8;
        percent(done) != percent(done - 1)
    }

    pub fn stage(&self) -> String {
        self.stage.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Fraction done of the stage, 0 to 1; 0 for a stage without steps.
    pub fn progress(&self) -> f64 {
        share(self.done.load(Ordering::Relaxed), self.steps.load(Ordering::Relaxed))
    }
}

fn share(done: u64, steps: u64) -> f64 {
    if steps == 0 { 0.0 } else { (done as f64 / steps as f64).min(1.0) }
}

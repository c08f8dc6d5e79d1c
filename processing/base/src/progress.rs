//! Progress reports of long computations, and their cancellation.

use crate::estimate::Work;
use crate::{Error, Result};
use serde_json::Value;

/// Receives progress. Called from computing threads, so implementations must be cheap.
pub trait Progress: Sync {
    /// Receives the predicted time, memory and disk space: after validation of the input, before the first stage and
    /// before anything is written.
    ///
    /// # Errors
    /// `Cancelled` if only an estimate was requested.
    fn expect(&self, _: &Work) -> Result<()> {
        Ok(())
    }
    /// Begins a stage, with a name for the user and the number of steps.
    fn stage(&self, name: &str, steps: u64);
    /// Completes one step of the current stage.
    fn step(&self);
    /// True if intermediate pictures are displayed.
    fn is_watched(&self) -> bool {
        false
    }
    /// Displays an intermediate picture (PNG) and its state.
    fn show(&self, _so_far: Value, _png: Vec<u8>) {}
    /// True once the computation must stop; it then returns [`Error::Cancelled`] and leaves nothing behind.
    fn cancelled(&self) -> bool;

    /// True once the result so far is wanted: a computation that improves in passes ends with those that it has, and
    /// writes its result.
    fn is_enough(&self) -> bool {
        false
    }

    /// `Err(Cancelled)` if the computation must stop.
    fn check(&self) -> Result<()> {
        if self.cancelled() { Err(Error::Cancelled) } else { Ok(()) }
    }
}

/// Ignores progress and never cancels: for tests and benchmarks.
pub struct Silent;

impl Progress for Silent {
    fn stage(&self, _: &str, _: u64) {}
    fn step(&self) {}
    fn cancelled(&self) -> bool {
        false
    }
}

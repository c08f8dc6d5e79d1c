//! How a long computation tells its caller where it is, and learns that it is to stop.

use crate::estimate::Work;
use crate::{Error, Result};
use serde_json::Value;

/// Receives progress. Called from the computing threads, so it must be cheap.
pub trait Progress: Sync {
    /// An operation states its time, memory and disk: after the check of its input, before its first stage and before anything is written.
    ///
    /// # Errors
    /// `Cancelled` if only an estimate was asked for.
    fn expect(&self, _: &Work) -> Result<()> {
        Ok(())
    }
    /// A stage begins: its name as a user reads it, and how many steps it has.
    fn stage(&self, name: &str, steps: u64);
    /// One step of the current stage is done.
    fn step(&self);
    /// Whether somebody looks at intermediate pictures.
    fn is_watched(&self) -> bool {
        false
    }
    /// Shows an intermediate picture (PNG), and how far it is.
    fn show(&self, _so_far: Value, _png: Vec<u8>) {}
    /// True once the computation is to stop; it then returns [`Error::Cancelled`] and leaves nothing behind.
    fn cancelled(&self) -> bool;

    /// `Err(Cancelled)` when the computation is to stop.
    fn check(&self) -> Result<()> {
        if self.cancelled() { Err(Error::Cancelled) } else { Ok(()) }
    }
}

/// No report, never stopped: for tests and benchmarks.
pub struct Silent;

impl Progress for Silent {
    fn stage(&self, _: &str, _: u64) {}
    fn step(&self) {}
    fn cancelled(&self) -> bool {
        false
    }
}

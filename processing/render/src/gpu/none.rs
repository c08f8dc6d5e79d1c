//! No graphics card: this program was built without them.

use super::Prepared;

/// Says why there is none.
pub(in super::super) fn name() -> Result<String, String> {
    Err("this program was built without the feature gpu".into())
}

/// Never there.
pub(in super::super) enum Card {}

impl Card {
    /// Says why there is none.
    pub(in super::super) fn new(_: Prepared) -> Result<Self, String> {
        Err("this program was built without the feature gpu".into())
    }

    /// Says why there is none.
    pub(in super::super) fn with(prepared: Prepared, _: &str) -> Result<Self, String> {
        Self::new(prepared)
    }

    /// Never called.
    pub(in super::super) fn load(&mut self, _: Prepared) -> Result<(), String> {
        match *self {}
    }

    /// Never called.
    pub(in super::super) fn software(&self) -> bool {
        match *self {}
    }

    /// Never called.
    pub(in super::super) fn seconds(&mut self, _: usize, _: [usize; 2]) -> Result<f64, String> {
        match *self {}
    }

    /// Never called.
    pub(in super::super) fn part(&mut self, _: usize, _: usize, _: [usize; 2]) -> Result<Vec<[f32; 3]>, String> {
        match *self {}
    }

    /// Never called.
    pub(in super::super) fn pass(&mut self, _: usize, _: usize) -> Result<Vec<[f32; 3]>, String> {
        match *self {}
    }

    /// Never called.
    pub(in super::super) fn name(&self) -> &str {
        match *self {}
    }
}

//! Substitute for the graphics card in builds without GPU support.

use super::Prepared;

/// Returns the reason why there is no card.
pub(in super::super) fn name() -> Result<String, String> {
    Err("this program was built without the feature gpu".into())
}

/// Uninhabited.
pub(in super::super) enum Card {}

impl Card {
    /// Returns the reason why there is no card.
    pub(in super::super) fn new(_: Prepared) -> Result<Self, String> {
        Err("this program was built without the feature gpu".into())
    }

    /// Returns the reason why there is no card.
    pub(in super::super) fn with(prepared: Prepared, _: &str) -> Result<Self, String> {
        Self::new(prepared)
    }

    /// Unreachable.
    pub(in super::super) fn load(&mut self, _: Prepared) -> Result<(), String> {
        match *self {}
    }

    /// Unreachable.
    pub(in super::super) fn software(&self) -> bool {
        match *self {}
    }

    /// Unreachable.
    pub(in super::super) fn seconds(&mut self, _: usize, _: [usize; 2]) -> Result<f64, String> {
        match *self {}
    }

    /// Unreachable.
    pub(in super::super) fn part(&mut self, _: usize, _: usize, _: [usize; 2]) -> Result<Vec<[f32; 3]>, String> {
        match *self {}
    }

    /// Unreachable.
    pub(in super::super) fn pass(&mut self, _: usize, _: usize) -> Result<Vec<[f32; 3]>, String> {
        match *self {}
    }

    /// Unreachable.
    pub(in super::super) fn name(&self) -> &str {
        match *self {}
    }
}

//! What went wrong with a device: which one, doing what, what was expected and what came.

use serde::Serialize;

/// Result of a device call.
pub type DeviceResult<T> = Result<T, DeviceError>;

/// A device did not do what it was asked to.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{device}: {command}: expected {expected}, got {got}; {remedy}")]
pub struct DeviceError {
    /// Which device, as the user knows it.
    pub device: String,
    /// What it was asked to do.
    pub command: String,
    /// What should have come back.
    pub expected: String,
    /// What came back.
    pub got: String,
    /// What the user can do.
    pub remedy: String,
    /// What the caller can do.
    pub class: Class,
}

/// What the caller can do about a device error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// The same command may work when given again.
    Retry,
    /// The session must stop; a person must look.
    Stop,
    /// The device cannot do this at all: plan or configuration are wrong.
    Setup,
}

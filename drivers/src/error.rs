//! What went wrong with a device: which one, doing what, what was expected and what came.

use serde::{Deserialize, Serialize};

/// Result of a device call.
pub type DeviceResult<T> = Result<T, DeviceError>;

/// A device did not do what it was asked to.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error, Serialize, Deserialize)]
#[error("{device}: {command}: expected {expected}, got {got}; {remedy}")]
pub struct DeviceError {
    /// Which device, as the user knows it.
    pub device: Box<str>,
    /// What it was asked to do.
    pub command: Box<str>,
    /// What should have come back.
    pub expected: Box<str>,
    /// What came back.
    pub got: Box<str>,
    /// What the user can do.
    pub remedy: Box<str>,
    /// What the caller can do.
    pub class: Class,
}

/// What the caller can do about a device error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// The same command may work when given again.
    Retry,
    /// The link is gone; it may come back, with the device in an unknown state.
    Lost,
    /// The session must stop; a person must look.
    Stop,
    /// The device cannot do this at all: plan or configuration are wrong.
    Setup,
}

impl DeviceError {
    /// An error of the class [`Class::Stop`] without remedy; the other methods complete it.
    pub fn new(
        device: &str,
        command: impl Into<Box<str>>,
        expected: impl Into<Box<str>>,
        got: impl Into<Box<str>>,
    ) -> Self {
        Self {
            device: device.into(),
            command: command.into(),
            expected: expected.into(),
            got: got.into(),
            remedy: "look at the device, then resume the session".into(),
            class: Class::Stop,
        }
    }

    /// Says what the user can do.
    pub fn remedy(mut self, remedy: impl Into<Box<str>>) -> Self {
        self.remedy = remedy.into();
        self
    }

    /// Says what the caller can do.
    pub fn class(mut self, class: Class) -> Self {
        self.class = class;
        self
    }
}

//! Device errors: device, command, expected answer and received answer.

use serde::{Deserialize, Serialize};

/// Result of a device call.
pub type DeviceResult<T> = Result<T, DeviceError>;

/// A device failed to execute a command.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error, Serialize, Deserialize)]
#[error("{device}: {command}: expected {expected}, got {got}; {remedy}")]
pub struct DeviceError {
    /// Device name, as known to the user.
    pub device: Box<str>,
    /// Command that failed.
    pub command: Box<str>,
    /// Expected answer.
    pub expected: Box<str>,
    /// Received answer.
    pub got: Box<str>,
    /// Instruction for the user.
    pub remedy: Box<str>,
    /// Options of the caller.
    pub class: Class,
}

/// Options of the caller after a device error.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// The same command may succeed when repeated.
    Retry,
    /// The link is lost. The device may reconnect, in an unknown state.
    Lost,
    /// The session must stop until a person has checked the device.
    Stop,
    /// The device cannot do this: plan or configuration are wrong.
    Setup,
}

impl DeviceError {
    /// An error of class [`Class::Stop`] without a remedy; the other methods add to it.
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

    /// Sets the instruction for the user.
    pub fn remedy(mut self, remedy: impl Into<Box<str>>) -> Self {
        self.remedy = remedy.into();
        self
    }

    /// Sets the class.
    pub fn class(mut self, class: Class) -> Self {
        self.class = class;
        self
    }
}

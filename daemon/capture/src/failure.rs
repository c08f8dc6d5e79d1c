//! Failures of commands and captures, and their exit codes.

use nacre_base::Error;

/// Reason why a command failed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// Error of a computation, its input or its output.
    #[error(transparent)]
    Processing(#[from] Error),
    /// Device error.
    #[error(transparent)]
    Device(Box<nacre_drivers::DeviceError>),
    /// Error in a step of a capture.
    #[error("{step}: {failure}")]
    Step {
        /// File of the step.
        step: String,
        /// Underlying failure.
        failure: Box<Failure>,
    },
    /// The command completed, but its result misses the stated bound.
    #[error("{0}")]
    Bound(String),
}

impl From<nacre_drivers::DeviceError> for Failure {
    fn from(error: nacre_drivers::DeviceError) -> Self {
        Self::Device(Box::new(error))
    }
}

impl Failure {
    /// Adds the step of the capture; a cancellation belongs to no step.
    pub fn at(self, step: &str) -> Self {
        match self {
            Self::Processing(Error::Cancelled) => self,
            failure => Self::Step { step: step.into(), failure: Box::new(failure) },
        }
    }

    /// Device that caused the failure, if any.
    pub fn fault(&self) -> Option<&nacre_drivers::DeviceError> {
        match self {
            Self::Device(error) => Some(error),
            Self::Step { failure, .. } => failure.fault(),
            Self::Processing(_) | Self::Bound(_) => None,
        }
    }

    /// Exit code, as documented.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Processing(Error::Input { .. }) => 2,
            Self::Processing(Error::Cancelled) => 130,
            Self::Step { failure, .. } => failure.exit_code(),
            Self::Processing(Error::Output { .. }) | Self::Device(_) | Self::Bound(_) => 1,
        }
    }
}

//! Why a command or a capture failed, and its exit code.

use nacre_base::Error;

/// Why a command did not succeed.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// Something in the computation, its input or its output.
    #[error(transparent)]
    Processing(#[from] Error),
    /// A device.
    #[error(transparent)]
    Device(Box<nacre_drivers::DeviceError>),
    /// Something in a step of a capture.
    #[error("{step}: {failure}")]
    Step {
        /// The step, by its file.
        step: String,
        /// What failed.
        failure: Box<Failure>,
    },
    /// Everything ran, but the result misses its stated bound.
    #[error("{0}")]
    Bound(String),
}

impl From<nacre_drivers::DeviceError> for Failure {
    fn from(error: nacre_drivers::DeviceError) -> Self {
        Self::Device(Box::new(error))
    }
}

impl Failure {
    /// Says in which step of a capture it happened; a wish to stop belongs to none.
    pub fn at(self, step: &str) -> Self {
        match self {
            Self::Processing(Error::Cancelled) => self,
            failure => Self::Step { step: step.into(), failure: Box::new(failure) },
        }
    }

    /// The device that is at fault, if one is.
    pub fn fault(&self) -> Option<&nacre_drivers::DeviceError> {
        match self {
            Self::Device(error) => Some(error),
            Self::Step { failure, .. } => failure.fault(),
            Self::Processing(_) | Self::Bound(_) => None,
        }
    }

    /// The exit code of the contract.
    pub fn exit_code(&self) -> u8 {
        match self {
            Self::Processing(Error::Input { .. }) => 2,
            Self::Processing(Error::Cancelled) => 130,
            Self::Step { failure, .. } => failure.exit_code(),
            Self::Processing(Error::Output { .. }) | Self::Device(_) | Self::Bound(_) => 1,
        }
    }
}

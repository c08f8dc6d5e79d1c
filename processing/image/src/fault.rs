//! Errors of decoders, before the path of the file is attached.

use std::fmt;
use std::io;
use std::path::Path;

use ::image::ImageError;
use nacre_base::Error;
use serde::{Deserialize, Serialize};

/// Remedy for a damaged file.
pub(super) const RENEW: &str = "copy or export the file again";

/// Remedy for unsupported files with integer samples of up to 16 bits.
pub(super) const SAME_DEPTH: &str = "convert it to a grey or RGB PNG or TIFF of the same depth";

/// Remedy for numbers that integers of up to 16 bits cannot hold.
pub(super) const FLOATS: &str = "save it as a TIFF of 32-bit floats";

/// Error of a decoder; becomes an [`Error::Input`] with the path of the file.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Fault {
    problem: String,
    remedy: String,
}

/// Result of a decoder.
pub(super) type Decoded<T> = Result<T, Fault>;

impl Fault {
    /// The content contradicts itself or ends early.
    pub(super) fn damaged(words: impl fmt::Display) -> Self {
        Self { problem: format!("is truncated or damaged: {words}"), remedy: RENEW.into() }
    }

    /// The image exceeds the size limits.
    pub(super) fn too_large(problem: String) -> Self {
        Self { problem, remedy: "crop or scale it down".into() }
    }

    /// The file cannot be opened as an image.
    pub(super) fn unusable(problem: impl fmt::Display, remedy: impl Into<String>) -> Self {
        Self { problem: problem.to_string(), remedy: remedy.into() }
    }

    /// Attaches the path, for a message to users.
    pub(super) fn at(self, path: &Path) -> Error {
        Error::file(path, self.problem, self.remedy)
    }
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::NotFound => Self::unusable("does not exist", "check the path"),
            io::ErrorKind::UnexpectedEof => Self::damaged("the file ends too early"),
            // Decoders report damaged content as I/O errors of these kinds; others come from the system.
            io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput | io::ErrorKind::Other => Self::damaged(error),
            _ => Self::unusable(format!("cannot be read: {error}"), "check the path, its permissions and the disk"),
        }
    }
}

impl From<ImageError> for Fault {
    fn from(error: ImageError) -> Self {
        match error {
            ImageError::IoError(error) => error.into(),
            ImageError::Unsupported(error) => Self::unusable(format!("cannot be decoded: {error}"), SAME_DEPTH),
            other => Self::damaged(other),
        }
    }
}

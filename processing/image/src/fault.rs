//! Why a file cannot be decoded, before its path is known.

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

/// Remedy for numbers that integers of up to 16 bits do not hold.
pub(super) const FLOATS: &str = "save it as a TIFF of 32-bit floats";

/// Why a decoder gave up; becomes an [`Error::Input`] once the path is known.
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

    /// An image beyond the size limits.
    pub(super) fn too_large(problem: String) -> Self {
        Self { problem, remedy: "crop or scale it down".into() }
    }

    /// A file that cannot be opened as an image.
    pub(super) fn unusable(problem: impl fmt::Display, remedy: impl Into<String>) -> Self {
        Self { problem: problem.to_string(), remedy: remedy.into() }
    }

    /// The error that a user sees.
    pub(super) fn at(self, path: &Path) -> Error {
        Error::file(path, self.problem, self.remedy)
    }
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::NotFound => Self::unusable("does not exist", "check the path"),
            io::ErrorKind::UnexpectedEof => Self::damaged("the file ends too early"),
            // What decoders say through an I/O error about content, rather than what the system says.
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

//! Errors of readers of height files, before the name of the file is attached.

use nacre_base::Error;
use std::path::Path;

/// Result of a reader.
pub(in crate::height) type Outcome<T> = Result<T, Fault>;

/// Reason for which a file cannot be read.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::height) enum Fault {
    /// The file ends too early.
    Truncated(String),
    /// The file contradicts itself or its format.
    Damaged(String),
    /// The file is valid, but not a supported height field: the reason and the remedy.
    Unsupported(String, String),
}

impl Fault {
    pub(in crate::height) fn damaged(problem: impl Into<String>) -> Self {
        Self::Damaged(problem.into())
    }

    pub(in crate::height) fn unsupported(problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Unsupported(problem.into(), remedy.into())
    }

    /// Error for a file of a format, for example `Gwyddion file`.
    pub(in crate::height) fn of(self, path: &Path, format: &str) -> Error {
        let again = "copy or export the file again";
        match self {
            Self::Truncated(problem) => Error::file(path, format!("is a truncated {format}: {problem}"), again),
            Self::Damaged(problem) => Error::file(path, format!("is a damaged {format}: {problem}"), again),
            Self::Unsupported(problem, remedy) => {
                Error::file(path, format!("is a valid {format}, but not supported: {problem}"), remedy)
            }
        }
    }
}

//! Why a file of heights cannot be read, before its name is known.

use nacre_base::Error;
use std::path::Path;

/// Result of a reader.
pub(in crate::height) type Outcome<T> = Result<T, Fault>;

/// Why a file cannot be read.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::height) enum Fault {
    /// It ends too early.
    Truncated(String),
    /// It contradicts itself or its format.
    Damaged(String),
    /// It is valid, but no height field that Nacre reads: the reason and the remedy.
    Unsupported(String, String),
}

impl Fault {
    pub(in crate::height) fn damaged(problem: impl Into<String>) -> Self {
        Self::Damaged(problem.into())
    }

    pub(in crate::height) fn unsupported(problem: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self::Unsupported(problem.into(), remedy.into())
    }

    /// The error of a file of a format, `Gwyddion file` for example.
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

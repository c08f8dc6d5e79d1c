//! Faults of a mesh file, before its path is known.

use nacre_base::Error;
use std::path::Path;

/// Problem of a mesh file and its remedy; becomes an [`Error::Input`] once the path is known.
#[derive(Debug)]
pub(super) struct Fault {
    problem: String,
    remedy: String,
}

/// Result of a reader.
pub(super) type Decoded<T> = Result<T, Fault>;

impl Fault {
    /// The content contradicts itself or ends early.
    pub(super) fn damaged(problem: impl Into<String>) -> Self {
        Self { problem: problem.into(), remedy: "export the mesh again".into() }
    }

    /// An unsupported file, with a remedy for the user.
    pub(super) fn refused(problem: impl Into<String>, remedy: &str) -> Self {
        Self { problem: problem.into(), remedy: remedy.into() }
    }

    /// Converts to the error shown to the user.
    pub(super) fn at(self, path: &Path) -> Error {
        Error::file(path, self.problem, self.remedy)
    }
}

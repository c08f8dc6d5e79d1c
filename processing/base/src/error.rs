//! One error type: what is wrong, with which file or setting, and what to do about it.

use std::path::{Path, PathBuf};

/// Result of everything in this crate that can fail.
pub type Result<T> = std::result::Result<T, Error>;

/// Why a computation stopped.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Something the user gave (a file, a setting) cannot be used. Nothing has been written.
    #[error("{subject}: {problem}; {remedy}")]
    Input {
        /// The file or setting, as the user knows it.
        subject: String,
        /// What was found, and what was expected instead.
        problem: String,
        /// What the user can do.
        remedy: String,
    },
    /// A result could not be written (disk full, permission). What had been written is removed.
    #[error("{}: cannot write: {source}; {remedy}", path.display())]
    Output {
        /// The file or folder.
        path: PathBuf,
        /// The system's own answer.
        source: std::io::Error,
        /// What the user can do.
        remedy: &'static str,
    },
    /// The user or the caller asked to stop.
    #[error("interrupted")]
    Cancelled,
}

/// Remedy for a process or system that has as many files open as it may.
pub const OUT_OF_FILES: &str = "close other programs or raise the limit of open files (ulimit -n), then try again";

/// Whether the system refused because too many files are open, in this process (EMFILE) or altogether (ENFILE).
pub fn is_out_of_files(error: &std::io::Error) -> bool {
    const ENFILE: i32 = 23;
    const EMFILE: i32 = 24;
    matches!(error.raw_os_error(), Some(ENFILE | EMFILE))
}

impl Error {
    /// Bad input: `subject` (a file or setting), what is wrong with it, what to do.
    pub fn input(subject: impl ToString, problem: impl ToString, remedy: impl ToString) -> Self {
        Self::Input { subject: subject.to_string(), problem: problem.to_string(), remedy: remedy.to_string() }
    }

    /// Bad input file.
    pub fn file(path: &Path, problem: impl ToString, remedy: impl ToString) -> Self {
        Self::input(path.display(), problem, remedy)
    }

    /// A failed write, with the remedy that fits the system's answer.
    pub fn output(path: &Path, source: std::io::Error) -> Self {
        use std::io::ErrorKind as K;
        let remedy = match source.kind() {
            K::StorageFull | K::QuotaExceeded => "free some space or choose another --out folder",
            K::FileTooLarge => "raise the file size limit (ulimit -f) or choose another --out folder",
            K::ReadOnlyFilesystem => "mount the disk for writing or choose an --out folder on another one",
            K::PermissionDenied => "choose an --out folder that you may write to",
            _ if is_out_of_files(&source) => OUT_OF_FILES,
            _ => "check the disk and the --out folder",
        };
        Self::Output { path: path.into(), source, remedy }
    }
}

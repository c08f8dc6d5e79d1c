//! Common error type: problem, affected file or setting, and remedy.

use std::path::{Path, PathBuf};

/// Result of all fallible functions of these crates.
pub type Result<T> = std::result::Result<T, Error>;

/// Reason why a computation stopped.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// Invalid input: a file or a setting. Nothing has been written.
    #[error("{subject}: {problem}; {remedy}")]
    Input {
        /// File or setting, in the user's terms.
        subject: String,
        /// Problem, and the expected value.
        problem: String,
        /// Action for the user.
        remedy: String,
    },
    /// A result could not be written, for instance for lack of disk space or permission. Partial output is removed.
    #[error("{}: cannot write: {source}; {remedy}", path.display())]
    Output {
        /// The file or folder.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
        /// Action for the user.
        remedy: &'static str,
    },
    /// Cancelled by the user or the caller.
    #[error("interrupted")]
    Cancelled,
}

/// Remedy if a process or the system has too many open files.
pub const OUT_OF_FILES: &str = "close other programs or raise the limit of open files (ulimit -n), then try again";

/// True if too many files are open, in this process (EMFILE) or in the system (ENFILE).
pub fn is_out_of_files(error: &std::io::Error) -> bool {
    const ENFILE: i32 = 23;
    const EMFILE: i32 = 24;
    matches!(error.raw_os_error(), Some(ENFILE | EMFILE))
}

impl Error {
    /// Invalid input: `subject` (a file or setting), the problem, and the remedy.
    pub fn input(subject: impl ToString, problem: impl ToString, remedy: impl ToString) -> Self {
        Self::Input { subject: subject.to_string(), problem: problem.to_string(), remedy: remedy.to_string() }
    }

    /// Invalid input file.
    pub fn file(path: &Path, problem: impl ToString, remedy: impl ToString) -> Self {
        Self::input(path.display(), problem, remedy)
    }

    /// A failed write, with a remedy chosen by the system's error.
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

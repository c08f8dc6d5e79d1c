//! Work in a separate process, so that any failure (out of memory, an abort in a decoder, a stack overflow, a signal)
//! is an error for the parent process.
//!
//! A program registers itself at its start ([`register`]) and serves tasks in its hidden command ([`serve`]). [`run`]
//! starts that command and writes the limits and the task to its standard input. It reads `Message`s from its standard
//! output: JSON lines, optionally followed by bytes. Standard input stays open. The line `ENOUGH` asks
//! for the result so far ([`Progress::is_enough`](crate::progress::Progress::is_enough)); closing it is the request to
//! stop.
//!
//! On Linux, the process has a limit on its data (`RLIMIT_DATA`: heap, thread stacks and private mappings, but not
//! mappings of graphics drivers and files) and, optionally, on processor time. The kernel kills it first when memory
//! runs out. It runs at low priority and ends with the thread that started it. Other systems have no limits.

mod inside;
mod owner;

pub use inside::{Link, serve};
pub use owner::run;

use crate::Error;
use crate::estimate::Work;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::fmt;
use std::io;
use std::path::PathBuf;
use std::sync::OnceLock;
use std::time::Duration;

/// Hidden command of the program, which calls [`serve`].
pub const COMMAND: &str = "job";

/// Line that asks the process to end its passes and write the result.
const ENOUGH: &str = "enough";

static PROGRAM: OnceLock<PathBuf> = OnceLock::new();

/// Registers this executable for contained work. For programs whose command [`COMMAND`] calls [`serve`].
pub fn register() {
    // The link stays valid if the program's file is replaced.
    let own = if cfg!(target_os = "linux") { Ok("/proc/self/exe".into()) } else { std::env::current_exe() };
    if let Ok(own) = own {
        let _ = PROGRAM.set(own);
    }
}

/// True if [`run`] can start a process.
pub fn registered() -> bool {
    PROGRAM.get().is_some()
}

/// Limits of contained work.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Limits {
    /// Maximum data in bytes; `None` for no limit.
    pub memory: Option<u64>,
    /// Maximum processor time of all its threads in s; `None` for no limit. Independent of other load on the machine.
    pub processor_s: Option<u64>,
    /// True if other work, such as a capture, has precedence on the processor.
    pub background: bool,
}

/// A value with bulk data.
#[derive(Debug, Default, PartialEq)]
pub struct Part {
    /// Description, as JSON.
    pub value: Value,
    /// Bulk data: pixels, a PNG.
    pub bytes: Vec<u8>,
}

/// Reason why there is no result.
#[derive(Debug)]
pub enum Ended {
    /// Error of the work itself.
    Error(Error),
    /// The process died.
    Died(Death),
}

/// Cause of a process's death.
#[derive(Debug, PartialEq, Eq)]
pub enum Death {
    /// Memory limit in bytes exceeded.
    Memory(Option<u64>),
    /// Limit of processor time in s exceeded.
    Time(u64),
    /// Killed by another process, or by the kernel for lack of memory.
    Killed,
    /// Crashed; the text is the end of its standard error.
    Crashed(String),
    /// Could not be started, with the reason.
    NotStarted(String),
}

/// Formats a clause with the process as its subject.
impl fmt::Display for Death {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Memory(Some(bytes)) => {
                write!(f, "needed more memory than the {:.2} GiB that it may take", *bytes as f64 / f64::from(1 << 30))
            }
            Self::Memory(None) => f.write_str("needed more memory than there is"),
            Self::Time(seconds) => write!(f, "took more than {seconds} s of processor time"),
            Self::Killed => f.write_str("was killed (SIGKILL), as the system does when its memory runs out"),
            Self::Crashed(words) => write!(f, "crashed ({words})"),
            Self::NotStarted(reason) => write!(f, "could not be started ({reason})"),
        }
    }
}

/// First line sent to the process.
#[derive(Serialize, Deserialize)]
struct Order {
    limits: Limits,
    /// Process id of the parent.
    parent: u32,
    task: Value,
}

/// A line from the process.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Message {
    /// Predicted work.
    Expected(Work),
    /// Start of a stage with this number of steps.
    Stage { name: String, steps: u64 },
    /// Number of completed steps of the stage.
    Steps(u64),
    /// An intermediate result, followed by this number of bytes.
    Shown { value: Value, bytes: usize },
    /// The result, followed by this number of bytes; the process then ends.
    Done { value: Value, bytes: usize },
    /// An error; the process then ends.
    Failed(Told),
}

/// Serialised form of an [`Error`].
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Told {
    Input { subject: String, problem: String, remedy: String },
    Output { path: PathBuf, code: Option<i32>, words: String },
    Cancelled,
}

impl From<Error> for Told {
    fn from(error: Error) -> Self {
        match error {
            Error::Input { subject, problem, remedy } => Self::Input { subject, problem, remedy },
            Error::Output { path, source, .. } => {
                Self::Output { path, code: source.raw_os_error(), words: source.to_string() }
            }
            Error::Cancelled => Self::Cancelled,
        }
    }
}

impl From<Told> for Error {
    fn from(told: Told) -> Self {
        match told {
            Told::Input { subject, problem, remedy } => Self::Input { subject, problem, remedy },
            Told::Output { path, code, words } => {
                Self::output(&path, code.map_or_else(|| io::Error::other(words), io::Error::from_raw_os_error))
            }
            Told::Cancelled => Self::Cancelled,
        }
    }
}

/// Time between a request to stop, or the end of messages, and killing the process.
const GRACE: Duration = Duration::from_secs(2);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_arrive_as_they_were_sent() {
        let full = || io::Error::from_raw_os_error(28);
        for error in [
            Error::input("a.png", "is black", "add light"),
            Error::output("a.exr".as_ref(), full()),
            Error::output("a.exr".as_ref(), io::Error::other("no such thing")),
            Error::Cancelled,
        ] {
            let words = error.to_string();
            let line = serde_json::to_string(&Told::from(error)).unwrap();
            assert_eq!(Error::from(serde_json::from_str::<Told>(&line).unwrap()).to_string(), words);
        }
    }
}

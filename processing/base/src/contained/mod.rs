//! Work in a process of its own, so that whatever happens to it (no memory, an abort in a decoder, a stack overflow, a signal) is an error
//! for the process that asked for it.
//!
//! The program registers itself at its start ([`register`]) and serves tasks in its hidden command ([`serve`]). [`run`] starts that
//! command, writes the limits and the task to its standard input, and reads `Message`s from its standard output: JSON lines, each of
//! which may be followed by bytes. Standard input stays open: when it closes, the work is to stop.
//!
//! On Linux the process has a limit on its data (`RLIMIT_DATA`: heap, stacks of threads and private mappings, not the mappings of graphics
//! drivers and of files), may have one on its processor time, is killed by the kernel before others when memory runs out, leaves the
//! processor to others, and ends with the thread that started it. Elsewhere there are no limits.

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

/// The hidden command of the program that calls [`serve`].
pub const COMMAND: &str = "job";

static PROGRAM: OnceLock<PathBuf> = OnceLock::new();

/// Lets this process start itself for contained work. For programs whose command [`COMMAND`] calls [`serve`].
pub fn register() {
    // The link stays valid when the program's file is replaced.
    let own = if cfg!(target_os = "linux") { Ok("/proc/self/exe".into()) } else { std::env::current_exe() };
    if let Ok(own) = own {
        let _ = PROGRAM.set(own);
    }
}

/// Whether [`run`] can start a process.
pub fn registered() -> bool {
    PROGRAM.get().is_some()
}

/// Limits of contained work.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub struct Limits {
    /// Most bytes of its data; no limit where none is given.
    pub memory: Option<u64>,
    /// Most processor time of all its threads in s; no limit where none is given. A busy machine does not shorten it.
    pub processor_s: Option<u64>,
    /// Whether others (a capture) have precedence on the processor.
    pub background: bool,
}

/// A value with the bytes that go with it.
#[derive(Debug, Default, PartialEq)]
pub struct Part {
    /// Description, as JSON.
    pub value: Value,
    /// Bulk data: pixels, a PNG.
    pub bytes: Vec<u8>,
}

/// Why there is no result.
#[derive(Debug)]
pub enum Ended {
    /// The work's own answer.
    Error(Error),
    /// The process died.
    Died(Death),
}

/// How a process died.
#[derive(Debug, PartialEq, Eq)]
pub enum Death {
    /// It asked for more than its limit, in bytes.
    Memory(Option<u64>),
    /// It took more processor time than its limit, in s.
    Time(u64),
    /// Another process, or the kernel for lack of memory, killed it.
    Killed,
    /// It crashed; the words are its last ones.
    Crashed(String),
    /// It could not be started, for this reason.
    NotStarted(String),
}

/// A clause with the process as its subject.
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

/// First line to the process.
#[derive(Serialize, Deserialize)]
struct Order {
    limits: Limits,
    /// Process that started it.
    parent: u32,
    task: Value,
}

/// A line from the process.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Message {
    /// What the work needs.
    Expected(Work),
    /// A stage with so many steps begins.
    Stage { name: String, steps: u64 },
    /// So many steps of the stage are done.
    Steps(u64),
    /// An intermediate result, followed by so many bytes.
    Shown { value: Value, bytes: usize },
    /// The result, followed by so many bytes. The process ends.
    Done { value: Value, bytes: usize },
    /// An error instead. The process ends.
    Failed(Told),
}

/// An [`Error`] on its way.
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

/// After a wish to stop, or the end of its messages, a process has this long before it is killed.
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

//! Child process that performs contained work.

use super::{ENOUGH, Limits, Message, Order, Part};
use crate::Error;
use crate::estimate::Work;
use crate::progress::Progress;
use serde_json::Value;
use std::io::{self, BufRead, Write};
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Exit code of a process that received an invalid task.
const MISUSED: u8 = 2;

/// Connection to the parent process.
pub struct Link {
    limits: Limits,
    cancelled: Arc<AtomicBool>,
    enough: Arc<AtomicBool>,
    steps: AtomicU64,
    done: AtomicU64,
    out: Mutex<io::Stdout>,
}

impl Link {
    /// Limits of this process.
    pub fn limits(&self) -> Limits {
        self.limits
    }

    fn send(&self, message: &Message, bytes: &[u8]) {
        let Ok(line) = serde_json::to_string(message) else { return };
        let mut out = self.out.lock().unwrap_or_else(PoisonError::into_inner);
        // If the parent no longer reads, this process is about to be killed anyway.
        let _ = writeln!(out, "{line}").and_then(|()| out.write_all(bytes)).and_then(|()| out.flush());
    }
}

impl Progress for Link {
    fn expect(&self, work: &Work) -> Result<(), Error> {
        self.send(&Message::Expected(work.clone()), &[]);
        Ok(())
    }

    fn stage(&self, name: &str, steps: u64) {
        self.done.store(0, Ordering::Relaxed);
        self.steps.store(steps, Ordering::Relaxed);
        self.send(&Message::Stage { name: name.into(), steps }, &[]);
    }

    fn step(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        let steps = self.steps.load(Ordering::Relaxed).max(1);
        // One message per percent.
        let percent = |done: u64| done.saturating_mul(100) / steps;
        if percent(done) != percent(done - 1) {
            self.send(&Message::Steps(done), &[]);
        }
    }

    fn is_watched(&self) -> bool {
        true
    }

    fn show(&self, so_far: Value, png: Vec<u8>) {
        self.send(&Message::Shown { value: so_far, bytes: png.len() }, &png);
    }

    fn cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    fn is_enough(&self) -> bool {
        self.enough.load(Ordering::Relaxed)
    }
}

/// Serves one task on standard input and output: applies the limits sent with it, performs it, and sends its result or
/// error.
pub fn serve(work: impl FnOnce(Value, &Link) -> Result<Part, Error>) -> ExitCode {
    let mut line = String::new();
    let read = io::stdin().lock().read_line(&mut line);
    let Some(order) = read.ok().and_then(|_| serde_json::from_str::<Order>(&line).ok()) else {
        let _ = writeln!(io::stderr(), "nacre: this command is for the program itself");
        return ExitCode::from(MISUSED);
    };
    if let Err(error) = confine(&order) {
        let _ = writeln!(io::stderr(), "the limits of the process cannot be set: {error}");
        return ExitCode::FAILURE;
    }
    let (cancelled, enough) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
    let wishes = (cancelled.clone(), enough.clone());
    std::thread::spawn(move || {
        for line in io::stdin().lock().lines().map_while(Result::ok) {
            wishes.1.fetch_or(line == ENOUGH, Ordering::Relaxed);
        }
        wishes.0.store(true, Ordering::Relaxed);
    });
    let link = Link {
        limits: order.limits,
        cancelled,
        enough,
        steps: AtomicU64::new(0),
        done: AtomicU64::new(0),
        out: Mutex::new(io::stdout()),
    };
    match work(order.task, &link) {
        Ok(part) => link.send(&Message::Done { value: part.value, bytes: part.bytes.len() }, &part.bytes),
        Err(error) => link.send(&Message::Failed(error.into()), &[]),
    }
    ExitCode::SUCCESS
}

#[cfg(not(target_os = "linux"))]
fn confine(_: &Order) -> io::Result<()> {
    Ok(())
}

/// Applies the limits, and ties the process's life to its parent's.
#[cfg(target_os = "linux")]
fn confine(order: &Order) -> io::Result<()> {
    use rustix::process::{Pid, Resource, Signal, getppid, nice, set_parent_process_death_signal};
    set_parent_process_death_signal(Some(Signal::KILL))?;
    // The parent may have ended before.
    if getppid().map(Pid::as_raw_pid) != i32::try_from(order.parent).ok() {
        return Err(io::Error::other("the process that asked for it has ended"));
    }
    // Makes this process the kernel's first choice when memory runs out. Without /proc, it has normal priority.
    let _ = std::fs::write("/proc/self/oom_score_adj", "700");
    if order.limits.background {
        let _ = nice(10);
    }
    // A core dump with gigabytes of photographs would fill the disk.
    limit(Resource::Core, 0)?;
    if let Some(bytes) = order.limits.memory {
        limit(Resource::Data, bytes)?;
    }
    order.limits.processor_s.map_or(Ok(()), |seconds| limit(Resource::Cpu, seconds))
}

/// Lowers a resource limit.
#[cfg(target_os = "linux")]
fn limit(resource: rustix::process::Resource, most: u64) -> io::Result<()> {
    use rustix::process::{Rlimit, getrlimit, setrlimit};
    let now = getrlimit(resource);
    let least = |limit: Option<u64>| Some(limit.map_or(most, |limit| limit.min(most)));
    Ok(setrlimit(resource, Rlimit { current: least(now.current), maximum: now.maximum })?)
}

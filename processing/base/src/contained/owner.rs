//! Parent process that requests contained work.

use super::{COMMAND, Death, ENOUGH, Ended, GRACE, Limits, Message, Order, PROGRAM, Part};
use crate::Error;
use crate::progress::Progress;
use serde_json::Value;
use std::collections::VecDeque;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, SyncSender};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Polling interval for requests to stop.
const LOOK: Duration = Duration::from_millis(20);

/// Capacity of the message queue; a faster process waits.
const MESSAGES: usize = 16;

/// Number of lines kept from the end of standard error, and maximum length of a line.
const LINES: usize = 8;
const LINE_BYTES: u64 = 1000;

/// Maximum number of bytes after a message: the largest photograph (128 Mpixel, three channels of 32 bits).
const MOST_BYTES: usize = 3 << 29;

/// Signal numbers common to Linux, macOS and the BSDs.
const SIGKILL: i32 = 9;
const SIGXCPU: i32 = 24;

/// Performs a task in a separate process; returns when it has ended. Intermediate results go to `shown`, with progress
/// in between.
///
/// # Errors
/// [`Ended::Error`] with the error of the work, including `Cancelled`; [`Ended::Died`] if the process ended without a
/// message.
pub fn run(task: Value, limits: Limits, progress: &dyn Progress, shown: &mut dyn FnMut(Part)) -> Result<Part, Ended> {
    let not_started = |error: io::Error| Ended::Died(Death::NotStarted(error.to_string()));
    // Temporary files of the work are removed with this folder, however the process ends.
    let scratch = tempfile::Builder::new().prefix("nacre-job-").tempdir().map_err(not_started)?;
    let mut process = Process::start(task, limits, scratch.path()).map_err(not_started)?;
    let (mut steps, mut asked, mut enough) = (0_u64, None::<Instant>, false);
    let answer = loop {
        if asked.is_none() && progress.cancelled() {
            // Closing standard input requests the stop.
            (process.child.stdin, asked) = (None, Some(Instant::now()));
        }
        if !enough && progress.is_enough() {
            enough = true;
            // If the process has ended, its last message follows.
            let _ = process.child.stdin.as_mut().map(|stdin| writeln!(stdin, "{ENOUGH}"));
        }
        if asked.is_some_and(|since| since.elapsed() > GRACE) {
            break None;
        }
        match process.messages.recv_timeout(LOOK) {
            // A caller that only wants the estimate stops the process by `cancelled`.
            Ok((Message::Expected(work), _)) => drop(progress.expect(&work)),
            Ok((Message::Stage { name, steps: of }, _)) => {
                steps = 0;
                progress.stage(&name, of);
            }
            Ok((Message::Steps(done), _)) => {
                (steps..done).for_each(|_| progress.step());
                steps = done.max(steps);
            }
            Ok((Message::Shown { value, .. }, bytes)) => shown(Part { value, bytes }),
            Ok((Message::Done { value, .. }, bytes)) => break Some(Ok(Part { value, bytes })),
            Ok((Message::Failed(told), _)) => break Some(Err(Ended::Error(told.into()))),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => break None,
        }
    };
    let (status, words) = process.end(answer.is_none() && asked.is_none());
    match answer {
        Some(answer) => answer,
        // The caller no longer waits, however the process ended.
        None if asked.is_some() => Err(Ended::Error(Error::Cancelled)),
        None => Err(Ended::Died(death(status, &words, limits))),
    }
}

/// Derives the cause of death from exit status and last lines of standard error.
fn death(status: Option<ExitStatus>, words: &VecDeque<String>, limits: Limits) -> Death {
    let said = |phrase: &str| words.iter().find(|line| line.contains(phrase));
    let signal = status.and_then(|status| status.signal());
    // Messages of Rust's allocator, of its panics, and of a thread that could not allocate its stack.
    if said("memory allocation of").is_some() || said("Cannot allocate memory").is_some() {
        return Death::Memory(limits.memory);
    }
    match (signal, limits.processor_s) {
        (Some(SIGXCPU), Some(seconds)) => Death::Time(seconds),
        (Some(SIGKILL), _) => Death::Killed,
        _ => {
            let how = signal.map(|signal| format!("signal {signal}"));
            let how = how.or_else(|| Some(format!("exit code {}", status?.code()?)));
            let mut all: Vec<&str> = how.as_deref().into_iter().collect();
            let last = said("overflowed its stack").or_else(|| said("panicked at"));
            let after = last.and_then(|line| words.iter().skip_while(|l| *l != line).nth(1));
            all.extend(last.into_iter().chain(after).map(|line| line.trim()));
            Death::Crashed(all.join(": "))
        }
    }
}

/// A process with its streams.
struct Process {
    child: Child,
    messages: Receiver<(Message, Vec<u8>)>,
    reader: JoinHandle<()>,
    words: JoinHandle<VecDeque<String>>,
}

impl Process {
    fn start(task: Value, limits: Limits, scratch: &std::path::Path) -> io::Result<Self> {
        let program = PROGRAM.get().ok_or_else(|| io::Error::other("the program has not registered itself"))?;
        let order = serde_json::to_string(&Order { limits, parent: std::process::id(), task })?;
        let mut child = Command::new(program)
            .arg0("nacre")
            .arg(COMMAND)
            .env("TMPDIR", scratch)
            // A backtrace would push a panic's message out of the last lines.
            .env("RUST_BACKTRACE", "0")
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            // Ctrl-C reaches the parent only, which then stops this process.
            .process_group(0)
            .spawn()?;
        let (Some(stdout), Some(stderr)) = (child.stdout.take(), child.stderr.take()) else {
            return Err(io::Error::other("no pipe"));
        };
        let (tell, messages) = mpsc::sync_channel(MESSAGES);
        let reader = std::thread::spawn(move || read(BufReader::new(stdout), &tell));
        let words = std::thread::spawn(move || last_lines(BufReader::new(stderr)));
        // If the process has already died, its standard error gives the reason.
        let _ = child.stdin.as_mut().map(|stdin| stdin.write_all(format!("{order}\n").as_bytes()));
        Ok(Self { child, messages, reader, words })
    }

    /// Waits for the process to end and kills it: after a grace period if `patiently`, otherwise at once.
    fn end(mut self, patiently: bool) -> (Option<ExitStatus>, VecDeque<String>) {
        let begun = Instant::now();
        while patiently && begun.elapsed() < GRACE && matches!(self.child.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(1));
        }
        self.kill();
        let status = self.child.wait().ok();
        drop(self.messages);
        let _ = self.reader.join();
        (status, self.words.join().unwrap_or_default())
    }

    /// Kills the process and its process group.
    fn kill(&mut self) {
        #[cfg(target_os = "linux")]
        if let (Ok(None), Some(group)) =
            (self.child.try_wait(), i32::try_from(self.child.id()).ok().and_then(rustix::process::Pid::from_raw))
        {
            let _ = rustix::process::kill_process_group(group, rustix::process::Signal::KILL);
        }
        let _ = self.child.kill();
    }
}

/// Reads messages until the stream ends or the receiver is gone.
fn read(mut from: impl BufRead, tell: &SyncSender<(Message, Vec<u8>)>) {
    let mut line = String::new();
    while from.read_line(&mut line).is_ok_and(|n| n > 0) {
        let Ok(message) = serde_json::from_str::<Message>(&line) else { return };
        let mut bytes = vec![];
        if let Message::Shown { bytes: count, .. } | Message::Done { bytes: count, .. } = message {
            let taken = from.by_ref().take(count.min(MOST_BYTES) as u64).read_to_end(&mut bytes);
            if taken.ok() != Some(count) {
                return;
            }
        }
        if tell.send((message, bytes)).is_err() {
            return;
        }
        line.clear();
    }
}

/// The last lines of a stream, read to its end.
fn last_lines(mut from: impl BufRead) -> VecDeque<String> {
    let mut lines = VecDeque::new();
    let mut line = vec![];
    while from.by_ref().take(LINE_BYTES).read_until(b'\n', &mut line).is_ok_and(|n| n > 0) {
        lines.push_back(String::from_utf8_lossy(&line).trim_end().to_owned());
        if lines.len() > LINES {
            lines.pop_front();
        }
        line.clear();
    }
    lines
}

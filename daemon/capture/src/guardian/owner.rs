//! Owner's side of the guardian: the flash, and the thread that supervises the guardian.

use super::{AGAIN, Answer, Ask, Guarded, LAST_TRY};
use async_trait::async_trait;
use nacre_drivers::{Class, Clock, DeviceError, DeviceResult, Flash, FlashInfo, Switched};
use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::CommandExt;
use std::process::{Child, ChildStdin, Command, ExitStatus, Stdio};
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, Sender};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Interval of heartbeats while the light may be on or an answer is pending.
const BEAT: Duration = Duration::from_millis(50);

/// Maximum number of consecutive unanswered heartbeats while the light may be on; beyond it the guardian is considered
/// hung. Heartbeats are counted rather than time, because an overloaded owner sends fewer.
const MISSED_LIT: u32 = 4;

/// As `MISSED_LIT`, in the dark, where a busy machine may be slow without risk.
const MISSED_DARK: u32 = 20;

/// As `MISSED_LIT`, for a process that is still loading.
const MISSED_LOADING: u32 = 200;

/// Time limit of a request to a device, in addition to the lamp's settling time. Drivers give up earlier, with an error
/// that names the device.
const ANSWER: Duration = Duration::from_secs(6);

/// As `ANSWER`, for the flash of a simulated bench, which may have to render first.
const RENDERED: Duration = Duration::from_secs(30);

/// Maximum wait for the exit of a process that was killed or has closed its pipe.
const EXIT: Duration = Duration::from_secs(1);

/// A guardian process, killed when dropped.
struct Guardian {
    child: Child,
    asks: ChildStdin,
    answers: Receiver<DeviceResult<Answer>>,
}

impl Guardian {
    /// Starts a guardian, which switches the light off; returns it with the description of its flash.
    fn start(guarded: &Guarded) -> DeviceResult<(Self, FlashInfo)> {
        let failed = |e: &dyn std::fmt::Display| lost("start", &e.to_string()).class(Class::Lost);
        let described = serde_json::to_string(guarded).map_err(|e| failed(&e))?;
        let mut child = Command::new(std::env::current_exe().map_err(|e| failed(&e))?)
            .arg("guardian")
            .arg(described)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            // Ctrl-C reaches the owner only, which then ends the guardian.
            .process_group(0)
            .spawn()
            .map_err(|e| failed(&e))?;
        let (Some(asks), Some(stdout)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(failed(&"no pipe"));
        };
        let (tell, answers) = mpsc::channel();
        std::thread::spawn(move || {
            for line in BufReader::new(stdout).lines().map_while(Result::ok) {
                let answer = serde_json::from_str(&line);
                if tell.send(answer.unwrap_or_else(|e| Err(lost("answer", &e.to_string())))).is_err() {
                    return;
                }
            }
        });
        let mut guardian = Self { child, asks, answers };
        match guardian.ask(Ask::Describe, LAST_TRY + limit(guarded), MISSED_LOADING) {
            Ok(Ok(Answer::Described(info))) => Ok((guardian, info)),
            Ok(Ok(_)) => Err(failed(&"another answer")),
            Ok(Err(error)) => Err(error),
            Err(got) => Err(failed(&got)),
        }
    }

    /// Sends a request and waits for its answer, which may be a device error.
    ///
    /// # Errors
    /// The guardian is lost; the text describes the event that occurred instead of an answer.
    fn ask(&mut self, ask: Ask, limit: Duration, most_missed: u32) -> Result<DeviceResult<Answer>, String> {
        let ended = || "the end of its process".to_owned();
        // Discards answers to earlier heartbeats.
        self.answers.try_iter().for_each(drop);
        self.send(ask).map_err(|_| ended())?;
        let (begun, mut missed) = (Instant::now(), 0);
        while begun.elapsed() < limit {
            match self.answers.recv_timeout(BEAT) {
                Ok(Ok(Answer::Alive)) if ask != Ask::Beat => missed = 0,
                Ok(answer) => return Ok(answer),
                Err(RecvTimeoutError::Disconnected) => return Err(ended()),
                Err(RecvTimeoutError::Timeout) if missed == most_missed => return Err("no heartbeat".into()),
                Err(RecvTimeoutError::Timeout) => {
                    missed += 1;
                    self.send(Ask::Beat).map_err(|_| ended())?;
                }
            }
        }
        Err(format!("none within {:.0} s", limit.as_secs_f64()))
    }

    fn send(&mut self, ask: Ask) -> std::io::Result<()> {
        let line = serde_json::to_string(&ask)? + "\n";
        self.asks.write_all(line.as_bytes())
    }

    /// Exit status of the process, if it has ended.
    fn exited(&mut self, patience: Duration) -> Option<ExitStatus> {
        let begun = Instant::now();
        loop {
            match self.child.try_wait() {
                Ok(None) if begun.elapsed() < patience => std::thread::sleep(Duration::from_millis(1)),
                status => return status.ok().flatten(),
            }
        }
    }
}

impl Drop for Guardian {
    fn drop(&mut self) {
        let _ = self.child.kill();
        self.exited(EXIT);
    }
}

/// Time limit of a request, excluding the settling time.
fn limit(guarded: &Guarded) -> Duration {
    match guarded {
        Guarded::Bench(_) => RENDERED,
        Guarded::Device(_) => ANSWER,
    }
}

/// A request, and the channel for its answer.
type Request = (Ask, Sender<DeviceResult<Answer>>);

/// Forwards requests, and replaces a lost guardian.
struct Supervisor {
    guarded: Guarded,
    guardian: Guardian,
    /// Time limit of a request, including settling time.
    limit: Duration,
    /// True if the light may be on.
    lit: bool,
    /// Reason why the light is off although it should be on: its guardian was lost.
    lost: Option<DeviceError>,
}

impl Supervisor {
    /// Forwards requests until their sender is dropped, then ends the guardian.
    fn serve(mut self, asks: &Receiver<Request>) {
        loop {
            // In the dark, a lost guardian is replaced on the next request.
            let pause = if self.lit { BEAT } else { Duration::from_secs(3600) };
            match asks.recv_timeout(pause) {
                Ok((ask, answer)) => drop(answer.send(self.ask(ask))),
                Err(RecvTimeoutError::Timeout) => drop(self.ask(Ask::Beat)),
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        if !self.end() && self.lit && self.replace().is_ok() {
            self.end();
        }
    }

    /// Sends a request to the guardian, or to a new one after its loss.
    fn ask(&mut self, ask: Ask) -> DeviceResult<Answer> {
        let mut got = String::new();
        for _ in 0..2 {
            if let (Ask::IsOn, Some(error)) = (ask, &self.lost) {
                return Err(error.clone());
            }
            let was_lit = self.lit;
            self.lit |= ask == Ask::Switch(true);
            match self.guardian.ask(ask, self.limit, self.most_missed()) {
                Ok(answer) => {
                    if let Ok(Answer::Switched(switched)) = &answer {
                        self.lost = None;
                        self.lit &= ask != Ask::Switch(false) || switched.on;
                    }
                    return answer;
                }
                Err(instead) => got = instead,
            }
            // If no new guardian can be started, there are no heartbeats to send; the caller gets the error.
            let replaced = self.replace();
            self.lit = false;
            replaced?;
            if was_lit {
                self.lost = Some(lost("keep the light on", &got));
            }
        }
        Err(lost("carry out a request", &got))
    }

    fn most_missed(&self) -> u32 {
        if self.lit { MISSED_LIT } else { MISSED_DARK }
    }

    /// Kills the guardian and starts another one, which switches the light off.
    fn replace(&mut self) -> DeviceResult<()> {
        let begun = Instant::now();
        let _ = self.guardian.child.kill();
        loop {
            let error = match Guardian::start(&self.guarded) {
                Ok((next, _)) => {
                    if self.guardian.exited(Duration::ZERO).is_some() {
                        self.guardian = next;
                        return Ok(());
                    }
                    // The kernel may still execute its last command, so the replacement must start, and switch off,
                    // after its end.
                    lost("end", "a process that cannot be killed")
                }
                Err(error) => error,
            };
            if begun.elapsed() > LAST_TRY {
                return Err(error.class(Class::Lost));
            }
            std::thread::sleep(AGAIN);
        }
    }

    /// Requests the guardian to switch off and exit. Returns false if it hung or was killed.
    fn end(&mut self) -> bool {
        let _ = self.guardian.ask(Ask::End, LAST_TRY + self.limit, self.most_missed());
        // Its stream ends shortly before its process does.
        self.guardian.exited(EXIT).is_some_and(|status| status.code().is_some())
    }
}

fn lost(command: &str, got: &str) -> DeviceError {
    DeviceError::new("flash guardian", command, "an answer", got).remedy("resume the session").class(Class::Retry)
}

/// A flash controlled through its guardian.
pub struct GuardedFlash {
    /// Dropping the sender ends the supervisor.
    asks: Option<Sender<Request>>,
    supervisor: Option<JoinHandle<()>>,
    info: FlashInfo,
    /// Clock for a device of this machine, whose guardian knows only the system's clock.
    clock: Option<Arc<dyn Clock>>,
}

impl GuardedFlash {
    /// Starts a guardian for a flash. Times reported for a device of this machine are on `clock`.
    ///
    /// # Errors
    /// It cannot be started, or cannot connect to the flash.
    pub fn start(guarded: &Guarded, clock: Arc<dyn Clock>) -> DeviceResult<Self> {
        let (guardian, info) = Guardian::start(guarded)?;
        let limit = limit(guarded) + Duration::from_secs_f64(info.settling_s.clamp(0.0, 1e6));
        let supervisor = Supervisor { guarded: guarded.clone(), guardian, limit, lit: false, lost: None };
        let (asks, requests) = mpsc::channel();
        let supervisor = std::thread::spawn(move || supervisor.serve(&requests));
        let clock = matches!(guarded, Guarded::Device(_)).then_some(clock);
        Ok(Self { asks: Some(asks), supervisor: Some(supervisor), info, clock })
    }

    fn ask(&self, ask: Ask) -> DeviceResult<Answer> {
        let (reply, replies) = mpsc::channel();
        let sent = self.asks.as_ref().is_some_and(|asks| asks.send((ask, reply)).is_ok());
        let answer = if sent { replies.recv().ok() } else { None };
        answer.unwrap_or_else(|| Err(lost("carry out a request", "the end of its supervisor").class(Class::Lost)))
    }
}

impl Drop for GuardedFlash {
    fn drop(&mut self) {
        self.asks = None;
        if let Some(supervisor) = self.supervisor.take() {
            let _ = supervisor.join();
        }
    }
}

#[async_trait]
impl Flash for GuardedFlash {
    fn describe(&self) -> FlashInfo {
        self.info.clone()
    }

    async fn switch(&mut self, on: bool) -> DeviceResult<Switched> {
        match self.ask(Ask::Switch(on))? {
            Answer::Switched(switched) => {
                let settled = |clock: &Arc<dyn Clock>| clock.now() + Duration::from_secs_f64(self.info.settling_s);
                Ok(Switched { since: self.clock.as_ref().map_or(switched.since, settled), ..switched })
            }
            _ => Err(lost(if on { "switch on" } else { "switch off" }, "another answer")),
        }
    }

    async fn is_on(&mut self) -> DeviceResult<bool> {
        match self.ask(Ask::IsOn)? {
            Answer::On(on) => Ok(on),
            _ => Err(lost("report its state", "another answer")),
        }
    }
}

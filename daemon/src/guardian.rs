//! The guardian of the flash: a small process of its own that holds the flash and switches it off when whoever wanted light
//! goes away, hangs or forgets, so that not even SIGKILL of the capture leaves it on.
//!
//! It talks JSON lines over its standard streams. Light goes off when the pipe closes, when no heartbeat came for
//! 0.4 s, after the flash's longest on-time, on SIGTERM, and when the guardian starts.

use nacre_drivers::flash::FlashConfig;
use nacre_drivers::{Class, Clock, DeviceError, DeviceResult, Flash, FlashInfo, Switched, SystemClock};
use nacre_sim::SimDevice;
use nacre_sim::socket::RemoteBench;
use serde::{Deserialize, Serialize};
use std::io::{BufRead, BufReader, Write};
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;

/// A heartbeat comes this often.
const BEAT: Duration = Duration::from_millis(100);

/// Without one for this long, light goes off.
const SILENCE: Duration = Duration::from_millis(400);

/// A flash that does not go off is told again after this,
const AGAIN: Duration = Duration::from_millis(50);

/// and for this long.
const LAST_TRY: Duration = Duration::from_secs(10);

#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Ask {
    Describe,
    Switch(bool),
    IsOn,
    /// Whoever wants light is alive; no answer.
    Beat,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Answer {
    Described(FlashInfo),
    Switched(Switched),
    On(bool),
}

/// Which flash a guardian holds.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Guarded {
    /// That of the simulated bench behind a socket.
    Bench(PathBuf),
    /// A device of this machine.
    Device(FlashConfig),
}

impl Guarded {
    /// Opens the flash itself.
    ///
    /// # Errors
    /// As its driver answers.
    pub fn open(&self) -> DeviceResult<Box<dyn Flash>> {
        match self {
            Self::Bench(socket) => Ok(Box::new(SimDevice::new(Box::new(RemoteBench::connect(socket)?))?)),
            Self::Device(config) => {
                let clock: Arc<dyn Clock> = Arc::new(SystemClock);
                config.open(&clock).unwrap_or_else(|| {
                    let (wanted, got) = ("a device of this machine", "a simulated one");
                    Err(DeviceError::new("flash guardian", "open the flash", wanted, got).class(Class::Setup))
                })
            }
        }
    }
}

enum Event {
    Asked(Ask),
    /// The pipe closed, or SIGTERM came.
    End,
}

/// Runs the guardian on this process's standard streams until they close; `open` opens the flash, again after its link
/// was lost.
///
/// # Errors
/// The flash cannot be opened, or cannot be switched off at the end.
pub fn run(open: impl Fn() -> DeviceResult<Box<dyn Flash>>) -> DeviceResult<()> {
    let failed = |e: std::io::Error| DeviceError::new("flash guardian", "start", "a thread", e.to_string());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(failed)?;
    let (tell, events) = mpsc::channel();
    let ended = tell.clone();
    ctrlc::set_handler(move || drop(ended.send(Event::End))).map_err(|e| failed(std::io::Error::other(e)))?;
    std::thread::spawn(move || {
        // Also nonsense ends it: whoever sent it is not to be trusted with light.
        for line in std::io::stdin().lines().map_while(Result::ok) {
            let Ok(ask) = serde_json::from_str(&line) else { break };
            if tell.send(Event::Asked(ask)).is_err() {
                return;
            }
        }
        let _ = tell.send(Event::End);
    });
    let begun = open().and_then(|flash| {
        let mut guard = Guard { flash, open, runtime, lit: None, beat: Instant::now() };
        guard.off_for_sure().map(|()| guard)
    });
    let mut guard = match begun {
        Ok(guard) => guard,
        // Whoever started it is the one to say so.
        Err(error) => {
            let told = serde_json::to_string(&DeviceResult::<Answer>::Err(error.clone()));
            let told = told.map_err(std::io::Error::from).and_then(|line| writeln!(std::io::stdout(), "{line}"));
            return told.map_err(|_| error);
        }
    };
    loop {
        match events.recv_timeout(guard.patience()) {
            Ok(Event::Asked(Ask::Beat)) => guard.beat = Instant::now(),
            Ok(Event::Asked(ask)) => {
                guard.beat = Instant::now();
                let Ok(line) = serde_json::to_string(&guard.answer(ask)) else { break };
                let mut out = std::io::stdout().lock();
                if writeln!(out, "{line}").and_then(|()| out.flush()).is_err() {
                    break;
                }
            }
            Err(RecvTimeoutError::Timeout) => guard.off_for_sure()?,
            Ok(Event::End) | Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    guard.off_for_sure()
}

struct Guard<O> {
    flash: Box<dyn Flash>,
    open: O,
    runtime: Runtime,
    /// Since when the light is on.
    lit: Option<Instant>,
    beat: Instant,
}

impl<O: Fn() -> DeviceResult<Box<dyn Flash>>> Guard<O> {
    fn answer(&mut self, ask: Ask) -> DeviceResult<Answer> {
        match ask {
            Ask::Switch(on) => {
                // On from before the command, so that no answer is needed for it to be switched off.
                let since = Instant::now();
                self.lit = if on { Some(self.lit.unwrap_or(since)) } else { self.lit };
                let switched = self.runtime.block_on(self.flash.switch(on))?;
                self.lit = self.lit.filter(|_| on || switched.on);
                Ok(Answer::Switched(switched))
            }
            Ask::IsOn => Ok(Answer::On(self.runtime.block_on(self.flash.is_on())?)),
            Ask::Describe | Ask::Beat => Ok(Answer::Described(self.flash.describe())),
        }
    }

    /// How long nothing may be heard.
    fn patience(&self) -> Duration {
        let Some(lit) = self.lit else { return Duration::from_secs(3600) };
        let longest = Duration::from_secs_f64(self.flash.describe().max_on_s.clamp(0.0, 1e6));
        let ends = (self.beat + SILENCE).min(lit + longest);
        ends.saturating_duration_since(Instant::now())
    }

    /// Switches off, over a new link if the old one is lost.
    fn off_for_sure(&mut self) -> DeviceResult<()> {
        let begun = Instant::now();
        loop {
            match self.runtime.block_on(self.flash.switch(false)) {
                Ok(switched) if !switched.on => {
                    self.lit = None;
                    return Ok(());
                }
                Ok(_) if begun.elapsed() > LAST_TRY => return Err(stays_on(&self.flash.describe().id)),
                Err(error) if begun.elapsed() > LAST_TRY => return Err(error),
                _ => {}
            }
            std::thread::sleep(AGAIN);
            if let Ok(flash) = (self.open)() {
                self.flash = flash;
            }
        }
    }
}

fn stays_on(id: &str) -> DeviceError {
    DeviceError::new(id, "switch off", "off", "on").remedy("switch it off by hand and check its wiring")
}

/// The flash behind its guardian.
pub struct GuardedFlash {
    child: Child,
    asks: Arc<Mutex<Option<ChildStdin>>>,
    answers: BufReader<ChildStdout>,
    info: FlashInfo,
    /// Times the switching of a device of this machine, whose guardian knows no other clock than the machine's.
    clock: Option<Arc<dyn Clock>>,
    /// Ends the heartbeat when dropped.
    stop: Option<Sender<()>>,
    heart: Option<JoinHandle<()>>,
}

impl GuardedFlash {
    /// Starts a guardian for a flash. What a device of this machine reports is timed on `clock`.
    ///
    /// # Errors
    /// It cannot be started, or cannot reach the flash.
    pub fn start(guarded: &Guarded, clock: Arc<dyn Clock>) -> DeviceResult<Self> {
        let described = serde_json::to_string(guarded).map_err(|e| lost("start", &e.to_string()))?;
        let exe = std::env::current_exe().map_err(|e| lost("start", &e.to_string()))?;
        let mut child = Command::new(exe)
            .arg("guardian")
            .arg(described)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            // Ctrl-C is for the capture; the guardian ends when that closes the pipe.
            .process_group(0)
            .spawn()
            .map_err(|e| lost("start", &e.to_string()))?;
        let (Some(stdin), Some(stdout)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(lost("start", "no pipe"));
        };
        let asks = Arc::new(Mutex::new(Some(stdin)));
        let (stop, stopped) = mpsc::channel();
        let beating = asks.clone();
        let heart = std::thread::spawn(move || {
            while stopped.recv_timeout(BEAT) == Err(RecvTimeoutError::Timeout) {
                // A guardian that is gone is noticed by whoever asks it next.
                let _ = send(&beating, Ask::Beat);
            }
        });
        let info = FlashInfo { id: String::new(), settling_s: 0.0, max_on_s: 0.0 };
        let answers = BufReader::new(stdout);
        let clock = matches!(guarded, Guarded::Device(_)).then_some(clock);
        let mut flash = Self { child, asks, answers, info, clock, stop: Some(stop), heart: Some(heart) };
        match flash.ask("describe itself", Ask::Describe)? {
            Answer::Described(info) => flash.info = info,
            _ => return Err(lost("describe itself", "another answer")),
        }
        Ok(flash)
    }

    fn ask(&mut self, command: &str, ask: Ask) -> DeviceResult<Answer> {
        let mut line = String::new();
        let heard = send(&self.asks, ask).and_then(|()| self.answers.read_line(&mut line));
        match heard {
            Ok(0) => Err(lost(command, "a closed pipe")),
            Err(e) => Err(lost(command, &e.to_string())),
            Ok(_) => serde_json::from_str(&line).unwrap_or_else(|e| Err(lost(command, &e.to_string()))),
        }
    }
}

fn send(asks: &Mutex<Option<ChildStdin>>, ask: Ask) -> std::io::Result<()> {
    let line = serde_json::to_string(&ask)? + "\n";
    match asks.lock().unwrap_or_else(PoisonError::into_inner).as_mut() {
        Some(pipe) => pipe.write_all(line.as_bytes()),
        None => Err(std::io::ErrorKind::BrokenPipe.into()),
    }
}

fn lost(command: &str, got: &str) -> DeviceError {
    DeviceError::new("flash guardian", command, "an answer", got)
        .remedy("look at the flash, then resume the session")
        .class(Class::Lost)
}

impl Drop for GuardedFlash {
    fn drop(&mut self) {
        self.stop = None;
        if let Some(heart) = self.heart.take() {
            let _ = heart.join();
        }
        // The guardian switches off and ends.
        *self.asks.lock().unwrap_or_else(PoisonError::into_inner) = None;
        let _ = self.child.wait();
    }
}

#[async_trait::async_trait]
impl Flash for GuardedFlash {
    fn describe(&self) -> FlashInfo {
        self.info.clone()
    }

    async fn switch(&mut self, on: bool) -> DeviceResult<Switched> {
        let command = if on { "switch on" } else { "switch off" };
        match self.ask(command, Ask::Switch(on))? {
            Answer::Switched(switched) => {
                let settled = |clock: &Arc<dyn Clock>| clock.now() + Duration::from_secs_f64(self.info.settling_s);
                Ok(Switched { since: self.clock.as_ref().map_or(switched.since, settled), ..switched })
            }
            _ => Err(lost(command, "another answer")),
        }
    }

    async fn is_on(&mut self) -> DeviceResult<bool> {
        match self.ask("report its state", Ask::IsOn)? {
            Answer::On(on) => Ok(on),
            _ => Err(lost("report its state", "another answer")),
        }
    }
}

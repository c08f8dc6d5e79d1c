//! Guardian of the flash: a child process that holds the flash device and switches it off if its owner is killed. Owner
//! and guardian monitor each other while the light may be on. They exchange JSON lines over the guardian's standard
//! streams.
//!
//! The guardian switches the light off when it starts, when its pipe closes, and on SIGTERM. It also does so after 0.4
//! s without a message from its owner, and after the maximum on-time of the flash.
//!
//! The owner (`GuardedFlash`) waits for the answer to every request, with a time limit. It kills a guardian that has
//! ended, answers no heartbeat for 0.25 s, or exceeds the time limit of a request. It then starts another one, which
//! switches the light off.

mod owner;

pub(crate) use owner::GuardedFlash;

use nacre_drivers::flash::FlashConfig;
use nacre_drivers::{Class, Clock, DeviceError, DeviceResult, Flash, FlashInfo, Switched, SystemClock};
use nacre_sim::SimDevice;
use nacre_sim::socket::RemoteBench;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;

/// Time without a message from the owner after which the guardian switches the light off.
const SILENCE: Duration = Duration::from_millis(400);

/// Pause between attempts to switch off.
const AGAIN: Duration = Duration::from_millis(50);

/// Time limit of attempts to switch off.
const LAST_TRY: Duration = Duration::from_secs(10);

/// Request of the owner.
#[derive(Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Ask {
    Describe,
    Switch(bool),
    IsOn,
    /// Heartbeat of the owner. Answered at once, even while the guardian waits for the device.
    Beat,
    /// Switch off and exit; the exit is the answer.
    End,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Answer {
    Described(FlashInfo),
    Switched(Switched),
    On(bool),
    Alive,
}

/// Flash held by a guardian.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Guarded {
    /// Flash of the simulated bench behind a socket.
    Bench(PathBuf),
    /// Device of this machine.
    Device(FlashConfig),
}

impl Guarded {
    /// Opens the flash itself.
    ///
    /// # Errors
    /// Those of its driver.
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
    Request(Ask),
    /// Requested by the owner, by a closed pipe, or by SIGTERM.
    End,
}

/// Runs the guardian on standard input and output until they close; `open` opens the flash, and reopens it after a lost
/// connection.
///
/// # Errors
/// The flash cannot be opened, or cannot be switched off at the end.
pub fn run(open: impl Fn() -> DeviceResult<Box<dyn Flash>>) -> DeviceResult<()> {
    let failed = |e: std::io::Error| DeviceError::new("flash guardian", "start", "a thread", e.to_string());
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(failed)?;
    let (tell, events) = mpsc::channel();
    let ended = tell.clone();
    ctrlc::set_handler(move || drop(ended.send(Event::End))).map_err(|e| failed(std::io::Error::other(e)))?;
    std::thread::spawn(move || listen(&tell));
    let begun = open().and_then(|flash| {
        let mut guard = Guard { flash, open, runtime, lit: None, beat: Instant::now() };
        guard.off_for_sure().map(|()| guard)
    });
    let mut guard = match begun {
        Ok(guard) => guard,
        // The parent process reports the error.
        Err(error) => return say(&Err(error.clone())).map_err(|_| error),
    };
    loop {
        match events.recv_timeout(guard.patience()) {
            Ok(Event::Request(Ask::Beat)) => guard.beat = Instant::now(),
            Ok(Event::Request(ask)) => {
                guard.beat = Instant::now();
                if say(&guard.answer(ask)).is_err() {
                    break;
                }
            }
            Err(RecvTimeoutError::Timeout) => guard.off_for_sure()?,
            Ok(Event::End) | Err(RecvTimeoutError::Disconnected) => break,
        }
    }
    guard.off_for_sure()
}

/// Reads requests until the pipe closes.
fn listen(tell: &Sender<Event>) {
    // An invalid request ends the guardian, too, because its sender cannot be trusted with the light.
    for line in std::io::stdin().lines().map_while(Result::ok) {
        let delivered = match serde_json::from_str(&line) {
            Ok(Ask::End) => tell.send(Event::End).is_ok(),
            Ok(Ask::Beat) => tell.send(Event::Request(Ask::Beat)).is_ok() && say(&Ok(Answer::Alive)).is_ok(),
            Ok(ask) => tell.send(Event::Request(ask)).is_ok(),
            Err(_) => false,
        };
        if !delivered {
            break;
        }
    }
    let _ = tell.send(Event::End);
}

/// Sends an answer to the owner.
fn say(answer: &DeviceResult<Answer>) -> std::io::Result<()> {
    let line = serde_json::to_string(answer)?;
    let mut out = std::io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush())
}

struct Guard<O> {
    flash: Box<dyn Flash>,
    open: O,
    runtime: Runtime,
    /// Time at which the light was switched on.
    lit: Option<Instant>,
    beat: Instant,
}

impl<O: Fn() -> DeviceResult<Box<dyn Flash>>> Guard<O> {
    fn answer(&mut self, ask: Ask) -> DeviceResult<Answer> {
        match ask {
            Ask::Switch(on) => {
                // Set before the command, so that the light is switched off even without its answer.
                let since = Instant::now();
                self.lit = if on { Some(self.lit.unwrap_or(since)) } else { self.lit };
                let switched = self.runtime.block_on(self.flash.switch(on))?;
                self.lit = self.lit.filter(|_| on || switched.on);
                Ok(Answer::Switched(switched))
            }
            Ask::IsOn => Ok(Answer::On(self.runtime.block_on(self.flash.is_on())?)),
            Ask::Describe | Ask::Beat | Ask::End => Ok(Answer::Described(self.flash.describe())),
        }
    }

    /// Maximum time to wait for a message.
    fn patience(&self) -> Duration {
        let Some(lit) = self.lit else { return Duration::from_secs(3600) };
        let longest = Duration::from_secs_f64(self.flash.describe().max_on_s.clamp(0.0, 1e6));
        let ends = (self.beat + SILENCE).min(lit + longest);
        ends.saturating_duration_since(Instant::now())
    }

    /// Switches off, over a new connection if the old one is lost.
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

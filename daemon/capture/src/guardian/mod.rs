//! The guardian of the flash: a child process that holds the flash device and switches it off when its owner is killed.
//! Owner and guardian watch each other while the light may be on. They exchange JSON lines over the guardian's standard
//! streams.
//!
//! The guardian switches the light off when it starts, when its pipe closes, when it hears nothing from its owner for 0.4 s,
//! after the flash's longest on-time, and on SIGTERM.
//!
//! The owner (`GuardedFlash`) waits for the answer to every request, but not for ever. When the guardian has ended, answers
//! no heartbeat for 0.25 s, or exceeds the time limit of a request, the owner kills it and starts another one, which switches the
//! light off when it starts.

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

/// The guardian switches the light off when it hears nothing from its owner for this long.
const SILENCE: Duration = Duration::from_millis(400);

/// Pause before another attempt to switch off.
const AGAIN: Duration = Duration::from_millis(50);

/// Attempts to switch off end after this.
const LAST_TRY: Duration = Duration::from_secs(10);

/// A request of the owner.
#[derive(Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Ask {
    Describe,
    Switch(bool),
    IsOn,
    /// The owner is alive. Answered at once, also while the device is waited for.
    Beat,
    /// Switch off and exit, which is the answer.
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
    /// The owner asked for it, the pipe closed, or SIGTERM came.
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
    std::thread::spawn(move || listen(&tell));
    let begun = open().and_then(|flash| {
        let mut guard = Guard { flash, open, runtime, lit: None, beat: Instant::now() };
        guard.off_for_sure().map(|()| guard)
    });
    let mut guard = match begun {
        Ok(guard) => guard,
        // Whoever started it is the one to say so.
        Err(error) => return say(&Err(error.clone())).map_err(|_| error),
    };
    loop {
        match events.recv_timeout(guard.patience()) {
            Ok(Event::Asked(Ask::Beat)) => guard.beat = Instant::now(),
            Ok(Event::Asked(ask)) => {
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
    // Also nonsense ends it: whoever sent it is not to be trusted with light.
    for line in std::io::stdin().lines().map_while(Result::ok) {
        let told = match serde_json::from_str(&line) {
            Ok(Ask::End) => tell.send(Event::End).is_ok(),
            Ok(Ask::Beat) => tell.send(Event::Asked(Ask::Beat)).is_ok() && say(&Ok(Answer::Alive)).is_ok(),
            Ok(ask) => tell.send(Event::Asked(ask)).is_ok(),
            Err(_) => false,
        };
        if !told {
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
            Ask::Describe | Ask::Beat | Ask::End => Ok(Answer::Described(self.flash.describe())),
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

//! Rotation stages of Thorlabs' Elliptec series: piezo motors on a serial bus.
//!
//! A module that loses power restarts with another zero and does not report it. Angles are therefore trusted only after
//! homing by this program, and only while each movement ends as the protocol specifies. After any other event the next
//! movement homes first. For the same reason the driver repeats queries, but not movements.

mod bus;
mod errors;
pub mod protocol;
mod settings;
#[cfg(test)]
mod tests;

pub use settings::Settings;

use super::check;
use super::zero::Zero;
use crate::wire::{Lines, SerialWire, Wire, shown, wait};
use crate::{Arrived, Class, Clock, DeviceResult, Stage, StageInfo};
use async_trait::async_trait;
use protocol::{Command, Identity, Motor, Reply, Status, degrees, parse, pulses};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Baud rate of the bus.
const BAUD: u32 = 9600;

/// Time to wait for the end of a movement before querying the status.
const POLL: Duration = Duration::from_millis(100);

/// Consecutive idle answers after which the end of a movement counts as missed.
const MISSED: u32 = 3;

/// Silence, in multiples of the answer time, after which no late answer is expected.
const QUIET: u32 = 5;

/// Time limit of a frequency search.
const SEARCHING: Duration = Duration::from_secs(120);

/// Time limit of cleaning, which takes minutes according to the manual.
const CLEANING: Duration = Duration::from_secs(1800);

/// A rotation stage on an Elliptec bus.
pub struct Elliptec {
    lines: Lines,
    settings: Settings,
    clock: Arc<dyn Clock>,
    identity: Identity,
    zero: Zero,
    cleaning: bool,
    /// Late answers may still arrive, and would be mistaken for answers to later queries.
    unsettled: bool,
}

/// Message received on the bus.
enum Received {
    Reply(Reply),
    Garbage(String),
    Nothing,
}

impl Elliptec {
    /// Opens the port and identifies the module.
    ///
    /// # Errors
    /// `Setup` if the port cannot be opened or another device answers; otherwise as the module.
    pub fn open(settings: &Settings, clock: Arc<dyn Clock>) -> DeviceResult<Self> {
        let name = format!("Elliptec stage {}", char::from(settings.address));
        settings.check().map_err(|e| crate::stage::misconfigured(&name, e))?;
        let wire = SerialWire::open(&name, &settings.port, BAUD)?;
        Self::on(Box::new(wire), settings, clock)
    }

    /// Identifies the module on an open port.
    ///
    /// # Errors
    /// As [`Elliptec::open`].
    pub fn on(wire: Box<dyn Wire>, settings: &Settings, clock: Arc<dyn Clock>) -> DeviceResult<Self> {
        let name = format!("Elliptec stage {}", char::from(settings.address));
        let identity = Identity { kind: 0, serial: String::new(), year: String::new(), travel: 0, pulses: 1 };
        let lines = Lines::new(wire, &name, b"\r\n");
        let settings = settings.clone();
        let mut stage =
            Self { lines, settings, clock, identity, zero: Zero::Unchecked, cleaning: false, unsettled: false };
        wait(stage.identify())?;
        Ok(stage)
    }

    async fn identify_module(&mut self) -> DeviceResult<()> {
        const WHAT: &str = "identify itself";
        // The stage may still be moving on behalf of a previous program; an old error is reported once.
        match self.idle(WHAT, self.longest_move()).await {
            Err(e) if e.class != Class::Lost => self.idle(WHAT, self.longest_move()).await?,
            other => other?,
        }
        self.zero = Zero::Unchecked;
        let identity = self
            .query(WHAT, Command::Identity, |reply| match reply {
                Reply::Identity(identity) => Some(identity),
                _ => None,
            })
            .await?;
        if let Some(other) = identity.not_rotary() {
            return Err(self
                .error(WHAT, "a rotation stage", format!("an {}, {other}", identity.name()))
                .remedy("correct port and address in the configuration")
                .class(Class::Setup));
        }
        let (name, address) = (identity.name(), char::from(self.settings.address));
        self.lines.rename(&format!("Elliptec {name} s/n {} address {address}", identity.serial));
        self.identity = identity;
        Ok(())
    }

    /// Identity reported by the module.
    pub fn identity(&self) -> &Identity {
        &self.identity
    }

    /// Searches for the best frequency of each motor, after a change of the load or when the stage gets stuck. The
    /// stage moves.
    ///
    /// # Errors
    /// As the module.
    pub async fn search_frequency(&mut self) -> DeviceResult<()> {
        const WHAT: &str = "search its frequencies";
        for motor in [Motor::One, Motor::Two] {
            self.begin(WHAT, Command::SearchFrequency(motor)).await?;
            self.idle(WHAT, SEARCHING).await?;
        }
        Ok(())
    }

    /// Runs the cleaning cycle, which takes minutes and sweeps the full turn; [`Stage::halt`] ends it.
    ///
    /// # Errors
    /// As the module.
    pub async fn clean(&mut self) -> DeviceResult<()> {
        const WHAT: &str = "clean its track";
        self.begin(WHAT, Command::Clean).await?;
        self.cleaning = true;
        let cleaned = self.idle(WHAT, CLEANING).await;
        self.cleaning = false;
        cleaned
    }

    fn longest_move(&self) -> Duration {
        Duration::from_millis(self.settings.move_ms)
    }

    fn answer(&self) -> Duration {
        Duration::from_millis(self.settings.answer_ms)
    }

    /// Waits until no late answer can arrive.
    async fn settle(&mut self, what: &str) -> DeviceResult<()> {
        if self.unsettled {
            self.lines.quiet(what, QUIET * self.answer()).await?;
            self.unsettled = false;
        }
        self.lines.clear(what)
    }

    /// Sends a movement command; the position is unknown from here on.
    async fn begin(&mut self, what: &str, command: Command) -> DeviceResult<()> {
        self.zero = Zero::Unchecked;
        self.settle(what).await?;
        self.lines.send(what, &command.encode(self.settings.address))
    }

    /// Next message of this module; messages of other modules on the bus are skipped.
    async fn receive(&mut self, what: &str, until: Instant) -> DeviceResult<Received> {
        loop {
            let Some(line) = self.lines.next(what, until).await? else { return Ok(Received::Nothing) };
            match parse(&line) {
                Some((_, Reply::Other)) => {}
                Some((from, reply)) if from == self.settings.address => return Ok(Received::Reply(reply)),
                Some(_) => {}
                None => return Ok(Received::Garbage(shown(&line))),
            }
        }
    }

    /// Sends a query, repeated once if there is no valid answer.
    async fn query<T>(&mut self, what: &str, command: Command, pick: fn(Reply) -> Option<T>) -> DeviceResult<T> {
        let mut got = String::new();
        self.settle(what).await?;
        for _ in 0..2 {
            self.lines.send(what, &command.encode(self.settings.address))?;
            let until = self.lines.now() + self.answer();
            got = loop {
                match self.receive(what, until).await? {
                    Received::Nothing => break format!("nothing within {} ms", self.settings.answer_ms),
                    Received::Garbage(line) => break line,
                    // Late answer to a repeated query.
                    Received::Reply(Reply::Status(Status::Ok)) if command != Command::Status => {}
                    Received::Reply(Reply::Status(status)) if command != Command::Status => {
                        return Err(match status {
                            Status::Busy => self.passing(what, "an answer", "status 9 (busy)"),
                            status => self.failed(what, status),
                        });
                    }
                    Received::Reply(reply) => match pick(reply) {
                        Some(answer) => return Ok(answer),
                        None => continue,
                    },
                }
            };
            self.unsettled = true;
        }
        Err(self.passing(what, "an answer", got))
    }

    async fn status(&mut self, what: &str) -> DeviceResult<Status> {
        self.query(what, Command::Status, |reply| match reply {
            Reply::Status(status) => Some(status),
            _ => None,
        })
        .await
    }

    /// Position in degrees.
    async fn place(&mut self, what: &str) -> DeviceResult<f64> {
        let pulses = self.query(what, Command::Position, |reply| match reply {
            Reply::Position(pulses) => Some(pulses),
            _ => None,
        });
        let pulses = pulses.await?;
        Ok(degrees(pulses, self.identity.pulses))
    }

    /// Waits until the module is not busy.
    async fn idle(&mut self, what: &str, limit: Duration) -> DeviceResult<()> {
        let until = self.lines.now() + limit;
        loop {
            match self.status(what).await? {
                Status::Ok => return Ok(()),
                Status::Busy if self.lines.now() < until => self.pause(what).await?,
                Status::Busy => return Err(self.stuck(what, limit)),
                status => return Err(self.failed(what, status)),
            }
        }
    }

    async fn pause(&mut self, what: &str) -> DeviceResult<()> {
        let until = self.lines.now() + POLL / 2;
        while self.lines.next(what, until).await?.is_some() {}
        Ok(())
    }

    /// Waits for the end of a movement; returns the final position.
    async fn finish(&mut self, what: &str) -> DeviceResult<f64> {
        let until = self.lines.now() + self.longest_move();
        let (mut unanswered, mut idle, mut busy) = (0, 0, false);
        let mut got = "an end without its position".to_owned();
        while self.lines.now() < until {
            let limit = if unanswered > 0 { self.answer() } else { POLL };
            match self.receive(what, self.lines.now() + limit).await? {
                // A late answer to an earlier movement looks the same, but the module is then still busy.
                Received::Reply(Reply::Position(_)) => match self.status(what).await? {
                    Status::Ok => return self.place(what).await,
                    Status::Busy => (unanswered, idle, busy) = (0, 0, true),
                    status => return Err(self.failed(what, status)),
                },
                Received::Reply(Reply::Status(Status::Busy)) => (unanswered, idle, busy) = (0, 0, true),
                Received::Reply(Reply::Status(Status::Ok)) => (unanswered, idle, busy) = (0, idle + 1, false),
                Received::Reply(Reply::Status(status)) => return Err(self.failed(what, status)),
                Received::Reply(_) => {}
                Received::Garbage(line) => (got, self.unsettled) = (line, true),
                Received::Nothing if unanswered == 2 => {
                    return Err(self.passing(what, "an answer", format!("nothing within {} ms", limit.as_millis())));
                }
                Received::Nothing => {
                    self.lines.send(what, &Command::Status.encode(self.settings.address))?;
                    self.unsettled |= unanswered > 0;
                    unanswered += 1;
                }
            }
            if idle == MISSED {
                return Err(self.passing(what, "the position at the end", got));
            }
        }
        Err(if busy {
            self.stuck(what, self.longest_move())
        } else {
            self.passing(what, "the end of the movement", got)
        })
    }

    /// Checks that the stage is at its last known position; homes it if that is unknown.
    async fn verify_position(&mut self, what: &str) -> DeviceResult<()> {
        if !matches!(self.zero, Zero::Known(_)) {
            return self.find_zero(what).await.map(drop);
        }
        let at = self.place(what).await?;
        match self.zero.left_elsewhere(at, self.settings.tolerance_deg) {
            Some(left) => Err(self.lost_position(what, left, at)),
            None => Ok(()),
        }
    }

    async fn find_zero(&mut self, what: &str) -> DeviceResult<f64> {
        self.begin(what, Command::Home).await?;
        let at = self.finish(what).await?;
        if at.abs() > self.settings.tolerance_deg {
            return Err(self.passing(what, "0° after homing", format!("{at:.2}°")));
        }
        self.zero = Zero::Known(at);
        Ok(at)
    }

    fn arrived(&self, angle_deg: f64) -> Arrived {
        Arrived { since: self.clock.now() + Duration::from_millis(self.settings.settling_ms), angle_deg }
    }

    fn target(&self, what: &str, angle_deg: f64) -> DeviceResult<i32> {
        check::angle(self.lines.device(), what, angle_deg, self.settings.limits_deg, "stage")?;
        pulses(angle_deg, self.identity.pulses).ok_or_else(|| {
            self.error(what, "an angle that it can count in pulses", format!("{angle_deg}°"))
                .remedy("correct limits_deg of the stage")
                .class(Class::Setup)
        })
    }
}

#[async_trait]
impl Stage for Elliptec {
    fn describe(&self) -> StageInfo {
        StageInfo {
            id: self.lines.device().to_owned(),
            speed_deg_s: self.settings.speed_deg_s,
            settling_s: self.settings.settling_ms as f64 / 1000.0,
            limits_deg: self.settings.limits_deg,
            tolerance_deg: self.settings.tolerance_deg,
            approach_deg: 0.0,
            longest_s: 2.0 * self.settings.move_ms as f64 / 1000.0,
            // `st` does not stop a move to a position.
            halts: false,
            by_hand: false,
        }
    }

    async fn home(&mut self) -> DeviceResult<Arrived> {
        let at = self.find_zero("home").await?;
        Ok(self.arrived(at))
    }

    async fn move_to(&mut self, angle_deg: f64) -> DeviceResult<Arrived> {
        let what = format!("move to {angle_deg}°");
        let target = self.target(&what, angle_deg)?;
        self.verify_position(&what).await?;
        self.begin(&what, Command::MoveTo(target)).await?;
        let at = self.finish(&what).await?;
        self.zero = Zero::Known(at);
        Ok(self.arrived(at))
    }

    /// Waits for the end of the movement, which cannot be stopped; only cleaning can.
    async fn halt(&mut self) -> DeviceResult<()> {
        if std::mem::take(&mut self.cleaning) {
            self.begin("halt", Command::Stop).await?;
        }
        self.idle("halt", self.longest_move()).await
    }

    async fn position(&mut self) -> DeviceResult<f64> {
        const WHAT: &str = "report its position";
        let at = self.place(WHAT).await?;
        match self.zero.left_elsewhere(at, self.settings.tolerance_deg) {
            Some(left) => Err(self.lost_position(WHAT, left, at)),
            None if self.zero == Zero::Forgotten => Err(self
                .error(WHAT, "an angle", "a module that was reset and not homed since")
                .remedy("home it, then resume the session")),
            None => Ok(at),
        }
    }
}

//! A rotary axis on a motor controller that runs GRBL 1.1.
//!
//! GRBL answers `ok` when it has queued a line. The end of a movement is therefore taken from its reports: idle, and at
//! the target. A controller that restarts counts from another zero. It announces the restart, and its position then
//! differs from the last known one.

mod errors;
pub mod protocol;
mod settings;
#[cfg(test)]
mod tests;

pub use settings::Settings;

use super::check;
use super::zero::Zero;
use crate::wire::{Lines, SerialWire, Wire, shown, wait};
use crate::{Arrived, Class, Clock, DeviceError, DeviceResult, Stage, StageInfo};
use async_trait::async_trait;
use protocol::{Line, Place, Report, State, move_line, parse};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Interval of report requests during a movement.
const POLL: Duration = Duration::from_millis(50);

/// Consecutive idle reports away from the target that end a movement.
const SHORT: u32 = 3;

/// Silence, in multiples of the answer time, after which no late answer is expected.
const QUIET: u32 = 5;

/// Multiple of the answer time after which a controller that sends without a pause counts as faulty.
const TALK: u32 = 40;

/// A rotary axis of a GRBL controller.
pub struct Grbl {
    lines: Lines,
    settings: Settings,
    clock: Arc<dyn Clock>,
    zero: Zero,
    /// Whether a homing cycle is in progress.
    homing: bool,
    /// Origin of the axis' work coordinates, as last reported.
    offset: Option<f64>,
    /// Late answers may still arrive.
    unsettled: bool,
}

/// Received message.
enum Received {
    Line(Line),
    Garbage(String),
    Nothing,
}

impl Grbl {
    /// Opens the port, which restarts many controllers, and identifies the controller.
    ///
    /// # Errors
    /// `Setup` if the port cannot be opened or another device answers; otherwise as the controller.
    pub fn open(settings: &Settings, clock: Arc<dyn Clock>) -> DeviceResult<Self> {
        settings.check().map_err(|e| crate::stage::misconfigured("GRBL stage", e))?;
        let wire = SerialWire::open("GRBL stage", &settings.port, settings.baud)?;
        Self::on(Box::new(wire), settings, clock)
    }

    /// Identifies the controller on an open port.
    ///
    /// # Errors
    /// As [`Grbl::open`].
    pub fn on(wire: Box<dyn Wire>, settings: &Settings, clock: Arc<dyn Clock>) -> DeviceResult<Self> {
        let lines = Lines::new(wire, "GRBL stage", b"\r\n");
        let (settings, zero) = (settings.clone(), Zero::Unchecked);
        let mut stage = Self { lines, settings, clock, zero, homing: false, offset: None, unsettled: false };
        wait(stage.start())?;
        Ok(stage)
    }

    /// Waits for the first report and queries the version.
    async fn start(&mut self) -> DeviceResult<()> {
        const WHAT: &str = "start";
        let until = self.lines.now() + Duration::from_millis(self.settings.start_ms);
        let mut reported = false;
        while !reported && self.lines.now() < until {
            self.lines.send(WHAT, protocol::REPORT)?;
            let next = self.lines.now() + self.answer();
            while let Some(line) = self.lines.next(WHAT, next).await? {
                if matches!(parse(&line), Some(Line::Report(_))) {
                    reported = true;
                    break;
                }
            }
        }
        if !reported {
            let got = format!("none within {} ms", self.settings.start_ms);
            return Err(self
                .error(WHAT, "a report of GRBL", got)
                .remedy("check that the controller runs GRBL 1.1, and port and baud in the configuration")
                .class(Class::Setup));
        }
        let version = self.version(WHAT).await?;
        self.lines.rename(&format!("GRBL {version} on {}", self.settings.port.display()));
        Ok(())
    }

    async fn version(&mut self, what: &str) -> DeviceResult<String> {
        self.lines.send(what, b"$I\n")?;
        let until = self.lines.now() + self.answer();
        let mut version = None;
        while let Some(line) = self.lines.next(what, until).await? {
            match parse(&line) {
                Some(Line::Message(text)) => version = text.strip_prefix("VER:").map(str::to_owned).or(version),
                Some(Line::Ok) => break,
                _ => {}
            }
        }
        let version = version.as_deref().map(|v| v.trim_end_matches(':').to_owned());
        version.ok_or_else(|| self.passing(what, "its version", "none".into()))
    }

    fn answer(&self) -> Duration {
        Duration::from_millis(self.settings.answer_ms)
    }

    /// Next received message, without informational ones.
    async fn receive(&mut self, what: &str, until: Instant) -> DeviceResult<Received> {
        loop {
            let Some(line) = self.lines.next(what, until).await? else { return Ok(Received::Nothing) };
            match parse(&line) {
                Some(Line::Message(_)) => {}
                Some(Line::Started(_)) => return Err(self.restarted(what)),
                Some(Line::Alarm(code)) => return Err(self.alarmed(what, Some(code))),
                Some(Line::Error(code)) => return Err(self.refused(what, code)),
                Some(Line::Report(report)) => {
                    self.update_state(&report);
                    return Ok(Received::Line(Line::Report(report)));
                }
                Some(line) => return Ok(Received::Line(line)),
                None => return Ok(Received::Garbage(shown(&line))),
            }
        }
    }

    /// Error for a missing answer, which may still arrive late.
    fn no_reply(&mut self, what: &str, expected: &str, received: Received, limit: Duration) -> DeviceError {
        self.unsettled = true;
        let got = match received {
            Received::Garbage(line) => line,
            _ => format!("nothing within {} ms", limit.as_millis()),
        };
        self.passing(what, expected, got)
    }

    fn update_state(&mut self, report: &Report) {
        let offset = report.offset.as_ref().and_then(|o| o.get(self.settings.axis.index()));
        self.offset = offset.copied().or(self.offset);
    }

    /// Processes unsolicited messages, and waits until no late answer can arrive.
    async fn settle(&mut self, what: &str) -> DeviceResult<()> {
        let time = if self.unsettled { QUIET * self.answer() } else { Duration::ZERO };
        let until = self.lines.now() + time + TALK * self.answer();
        while self.lines.now() < until {
            if let Received::Nothing = self.receive(what, self.lines.now() + time).await? {
                self.unsettled = false;
                return Ok(());
            }
        }
        Err(self.passing(what, "an answer", "a controller that talks all the time".into()))
    }

    /// Sends a line and waits until it is accepted.
    async fn command(&mut self, what: &str, line: &str, limit: Duration) -> DeviceResult<()> {
        self.settle(what).await?;
        self.lines.send(what, line.as_bytes())?;
        let until = self.lines.now() + limit;
        loop {
            match self.receive(what, until).await? {
                Received::Line(Line::Ok) => return Ok(()),
                // Answer to an earlier report request.
                Received::Line(_) => {}
                other => return Err(self.no_reply(what, "ok", other, limit)),
            }
        }
    }

    /// Requests a report, once again if there is no valid one.
    async fn report(&mut self, what: &str) -> DeviceResult<Report> {
        match self.report_once(what).await {
            Err(e) if e.class == Class::Retry => self.report_once(what).await,
            other => other,
        }
    }

    async fn report_once(&mut self, what: &str) -> DeviceResult<Report> {
        self.settle(what).await?;
        self.lines.send(what, protocol::REPORT)?;
        let until = self.lines.now() + self.answer();
        loop {
            match self.receive(what, until).await? {
                Received::Line(Line::Report(report)) => return Ok(report),
                Received::Line(_) => {}
                other => return Err(self.no_reply(what, "a report", other, self.answer())),
            }
        }
    }

    /// State, and position of the axis in degrees.
    async fn status(&mut self, what: &str) -> DeviceResult<(State, f64)> {
        // Work coordinates give the machine position only with their origin, which not every report contains.
        for _ in 0..40 {
            let report = self.report(what).await?;
            let index = self.settings.axis.index();
            let units = match (&report.place, self.offset) {
                (Some(Place::Machine(axes)), _) => axes.get(index).copied(),
                (Some(Place::Work(axes)), Some(offset)) => axes.get(index).map(|a| a + offset),
                (Some(Place::Work(_)), None) => continue,
                (None, _) => None,
            };
            return match units {
                Some(units) => Ok((report.state, units * self.settings.degrees_per_unit)),
                None => Err(self.no_axis(what)),
            };
        }
        Err(self.passing(what, "a report with WCO", "none".into()))
    }

    /// Waits until the axis is idle, at the target if there is one; returns its position.
    async fn wait_for_rest(&mut self, what: &str, target_deg: Option<f64>, limit: Duration) -> DeviceResult<f64> {
        let until = self.lines.now() + limit;
        let mut short = 0;
        loop {
            let (state, at) = self.status(what).await?;
            match state {
                State::Idle if target_deg.is_none_or(|t| (at - t).abs() <= self.settings.tolerance_deg) => {
                    return Ok(at);
                }
                State::Idle if short + 1 == SHORT => return Err(self.stopped_short(what, target_deg, at)),
                State::Idle => short += 1,
                State::Run | State::Jog | State::Home if self.lines.now() < until => short = 0,
                State::Alarm => return Err(self.alarmed(what, None)),
                state => return Err(self.not_idle(what, state)),
            }
            self.pause(what).await?;
        }
    }

    async fn pause(&mut self, what: &str) -> DeviceResult<()> {
        let until = self.lines.now() + POLL;
        while self.lines.now() < until {
            // Unsolicited messages in the meantime are processed.
            let _ = self.receive(what, until).await?;
        }
        Ok(())
    }

    async fn find_zero(&mut self, what: &str) -> DeviceResult<f64> {
        let limit = Duration::from_millis(self.settings.home_ms);
        if self.zero == Zero::Forgotten && !self.settings.homes {
            return Err(self.lost_zero(what));
        }
        if self.settings.homes {
            if matches!(self.zero, Zero::Going { .. }) {
                // A movement without a confirmed end may still be running.
                self.wait_for_rest(what, None, limit).await?;
            }
            self.zero = Zero::Unchecked;
            self.homing = true;
            self.command(what, "$H\n", limit).await?;
        }
        let at = self.wait_for_rest(what, None, limit).await?;
        self.homing = false;
        if let Zero::Going { to, .. } = self.zero
            && (at - to).abs() > self.settings.tolerance_deg
        {
            return Err(self.moved_away(what, to, at));
        }
        self.zero = Zero::Known(at);
        Ok(at)
    }

    /// Position of the axis, which must be its last known one; homes it if that is unknown.
    async fn verify_position(&mut self, what: &str) -> DeviceResult<f64> {
        if !matches!(self.zero, Zero::Known(_)) {
            return self.find_zero(what).await;
        }
        let at = self.wait_for_rest(what, None, self.answer()).await?;
        match self.zero.left_elsewhere(at, self.settings.tolerance_deg) {
            Some(left) => Err(self.moved_away(what, left, at)),
            None => Ok(at),
        }
    }

    async fn turn(&mut self, what: &str, angle_deg: f64) -> DeviceResult<Arrived> {
        check::angle(self.lines.device(), what, angle_deg, self.settings.limits_deg, "stage")?;
        let from = self.verify_position(what).await?;
        self.zero = Zero::Going { from, to: angle_deg };
        let scale = self.settings.degrees_per_unit;
        let line = move_line(self.settings.axis, angle_deg / scale, self.settings.feed_deg_min / scale.abs());
        let limit = Duration::from_millis(self.settings.move_ms);
        self.command(what, &line, self.answer()).await?;
        let at = self.wait_for_rest(what, Some(angle_deg), limit).await?;
        self.zero = Zero::Known(at);
        Ok(self.arrived(at))
    }

    fn arrived(&self, angle_deg: f64) -> Arrived {
        Arrived { since: self.clock.now() + Duration::from_millis(self.settings.settling_ms), angle_deg }
    }

    /// Holds the movement, and discards it once the axis stands.
    async fn end_movement(&mut self) -> DeviceResult<()> {
        const WHAT: &str = "halt";
        self.lines.send(WHAT, protocol::HOLD)?;
        let until = self.lines.now() + Duration::from_millis(self.settings.move_ms);
        // During homing GRBL accepts only a reset.
        let homing = std::mem::take(&mut self.homing);
        let mut before = None;
        while self.lines.now() < until && !homing {
            match self.status(WHAT).await {
                Ok((State::Hold { still: true } | State::Idle, at)) => {
                    before = Some(at);
                    break;
                }
                Ok((State::Alarm, _)) => break,
                // The hold byte may have been lost, so it is sent again.
                Ok((State::Run | State::Jog, _)) => {
                    self.lines.send(WHAT, protocol::HOLD)?;
                    self.pause(WHAT).await?;
                }
                Ok(_) => self.pause(WHAT).await?,
                Err(e) if e.class == Class::Lost => return Err(e),
                Err(_) => break,
            }
        }
        self.lines.send(WHAT, protocol::RESET)?;
        let until = self.lines.now() + self.answer();
        while let Some(line) = self.lines.next(WHAT, until).await? {
            if matches!(parse(&line), Some(Line::Started(_))) {
                let forgotten = self.zero == Zero::Forgotten;
                let (state, at) = self.status(WHAT).await.unwrap_or((State::Alarm, 0.0));
                let kept = before.is_some_and(|s: f64| (s - at).abs() <= self.settings.tolerance_deg);
                self.zero = match state {
                    State::Idle if kept && !forgotten => Zero::Known(at),
                    _ => Zero::Forgotten,
                };
                return Ok(());
            }
        }
        Err(self.passing(WHAT, "a restart after the reset", format!("none within {} ms", self.settings.answer_ms)))
    }
}

#[async_trait]
impl Stage for Grbl {
    fn describe(&self) -> StageInfo {
        StageInfo {
            id: self.lines.device().to_owned(),
            speed_deg_s: self.settings.feed_deg_min / 60.0,
            settling_s: self.settings.settling_ms as f64 / 1000.0,
            limits_deg: self.settings.limits_deg,
            tolerance_deg: self.settings.tolerance_deg,
            approach_deg: 0.0,
            longest_s: (self.settings.home_ms + self.settings.move_ms) as f64 / 1000.0,
            halts: true,
            by_hand: false,
        }
    }

    async fn home(&mut self) -> DeviceResult<Arrived> {
        let found = self.find_zero("home").await.map(|at| self.arrived(at));
        found.map_err(|e| self.for_good(e))
    }

    async fn move_to(&mut self, angle_deg: f64) -> DeviceResult<Arrived> {
        let turned = self.turn(&format!("move to {angle_deg}°"), angle_deg).await;
        turned.map_err(|e| self.for_good(e))
    }

    async fn halt(&mut self) -> DeviceResult<()> {
        self.end_movement().await.map_err(|e| self.for_good(e))
    }

    async fn position(&mut self) -> DeviceResult<f64> {
        const WHAT: &str = "report its position";
        let (_, at) = self.status(WHAT).await.map_err(|e| self.for_good(e))?;
        match self.zero.left_elsewhere(at, self.settings.tolerance_deg) {
            Some(left) => Err(self.moved_away(WHAT, left, at)),
            None if self.zero == Zero::Forgotten => Err(self.lost_zero(WHAT)),
            None => Ok(at),
        }
    }
}

//! A stage whose text protocol is described in the configuration.
//!
//! A move is complete only when the stage reports the target position, regardless of its other answers.

pub mod pattern;
mod settings;
#[cfg(test)]
mod tests;

pub use settings::{Exchange, Motion, Settings};

use super::check;
use super::zero::Zero;
use crate::wire::{Lines, SerialWire, Wire, shown, wait};
use crate::{Arrived, Class, Clock, DeviceError, DeviceResult, Stage, StageInfo};
use async_trait::async_trait;
use pattern::{Match, Pattern};
use settings::{Command, Phrases};
use std::sync::Arc;
use std::time::Duration;

/// Interval of queries during a movement.
const POLL: Duration = Duration::from_millis(50);

/// Consecutive equal positions after which a stage counts as stationary.
const STILL: u32 = 4;

/// Silence, in multiples of the answer time, after which no late answer is expected.
const QUIET: u32 = 5;

/// A stage with a text protocol.
pub struct LineStage {
    lines: Lines,
    settings: Settings,
    phrases: Phrases,
    clock: Arc<dyn Clock>,
    zero: Zero,
    /// Late answers may still arrive.
    unsettled: bool,
}

impl LineStage {
    /// Opens the port and queries the position.
    ///
    /// # Errors
    /// `Setup` if the configuration is wrong or the port cannot be opened; otherwise as the stage.
    pub fn open(settings: &Settings, clock: Arc<dyn Clock>) -> DeviceResult<Self> {
        settings.read().map_err(|e| crate::stage::misconfigured(&settings.name, e))?;
        let wire = SerialWire::open(&settings.name, &settings.port, settings.baud)?;
        Self::on(Box::new(wire), settings, clock)
    }

    /// Queries the position on an open port.
    ///
    /// # Errors
    /// As [`LineStage::open`].
    pub fn on(wire: Box<dyn Wire>, settings: &Settings, clock: Arc<dyn Clock>) -> DeviceResult<Self> {
        let phrases = settings.read().map_err(|e| crate::stage::misconfigured(&settings.name, e))?;
        let id = format!("{} on {}", settings.name, settings.port.display());
        let (lines, settings) = (Lines::new(wire, &id, b"\r\n"), settings.clone());
        let mut stage = Self { lines, settings, phrases, clock, zero: Zero::Unchecked, unsettled: false };
        wait(stage.place("report its position"))
            .map_err(|e| if e.class == Class::Retry { e.class(Class::Setup) } else { e })?;
        Ok(stage)
    }

    fn answer(&self) -> Duration {
        Duration::from_millis(self.settings.motion.answer_ms)
    }

    fn longest_move(&self) -> Duration {
        Duration::from_millis(self.settings.motion.move_ms)
    }

    fn error(&self, what: &str, expected: &str, got: impl Into<Box<str>>) -> DeviceError {
        DeviceError::new(self.lines.device(), what, expected, got)
    }

    fn passing(&self, what: &str, expected: &str, got: impl Into<Box<str>>) -> DeviceError {
        self.error(what, expected, got)
            .remedy("check cable, power and the lines in the configuration, then try again")
            .class(Class::Retry)
    }

    /// Waits until no late answer can arrive.
    async fn settle(&mut self, what: &str) -> DeviceResult<()> {
        if self.unsettled {
            self.lines.quiet(what, QUIET * self.answer()).await?;
            self.unsettled = false;
        }
        self.lines.clear(what)
    }

    /// Sends a line.
    async fn send_text(&mut self, what: &str, text: &str) -> DeviceResult<()> {
        self.settle(what).await?;
        self.lines.send(what, format!("{text}{}", self.settings.terminator).as_bytes())
    }

    /// The next line; an error if it matches an error pattern.
    async fn receive(&mut self, what: &str, limit: Duration) -> DeviceResult<Vec<u8>> {
        let Some(line) = self.lines.next(what, self.lines.now() + limit).await? else {
            self.unsettled = true;
            return Err(self.passing(what, "an answer", format!("nothing within {} ms", limit.as_millis())));
        };
        let units = self.settings.units_per_deg;
        if self.phrases.errors.iter().any(|e| e.matches(&line, units).is_some()) {
            if self.phrases.home.is_some() {
                self.zero = Zero::Unchecked;
            }
            return Err(self.error(what, "no error", shown(&line)).remedy("see the manual of the stage, then resume"));
        }
        Ok(line)
    }

    /// Waits for the answer that matches the pattern.
    async fn expect(
        &mut self,
        what: &str,
        which: fn(&Phrases) -> Option<&Command>,
        limit: Duration,
    ) -> DeviceResult<Match> {
        let line = self.receive(what, limit).await?;
        let reply: Option<&Pattern> = which(&self.phrases).map(|command| &command.reply);
        match reply.and_then(|r| r.matches(&line, self.settings.units_per_deg)) {
            Some(matched) => Ok(matched),
            None => {
                self.unsettled = true;
                Err(self.passing(what, "the reply in the configuration", shown(&line)))
            }
        }
    }

    /// Executes an exchange; `None` if it is not configured.
    async fn exchange(
        &mut self,
        what: &str,
        which: fn(&Phrases) -> Option<&Command>,
        angle_deg: f64,
        limit: Duration,
    ) -> DeviceResult<Option<Match>> {
        let Some(text) = which(&self.phrases).map(|s| s.send.fill(angle_deg, self.settings.units_per_deg)) else {
            return Ok(None);
        };
        self.send_text(what, &text).await?;
        self.expect(what, which, limit).await.map(Some)
    }

    /// Position; queried once again if the answer is invalid.
    async fn place(&mut self, what: &str) -> DeviceResult<f64> {
        let mut answer = self.exchange(what, |p| Some(&p.position), 0.0, self.answer()).await;
        if answer.as_ref().is_err_and(|e| e.class == Class::Retry) {
            answer = self.exchange(what, |p| Some(&p.position), 0.0, self.answer()).await;
        }
        match answer? {
            Some(Match::Degrees(angle)) => Ok(angle),
            _ => Err(self.passing(what, "an angle", "none")),
        }
    }

    /// Waits until the stage reports that it stands, if the configuration has such a query.
    async fn wait_for_standstill(&mut self, what: &str) -> DeviceResult<()> {
        let until = self.lines.now() + self.longest_move();
        while let Some(text) = self.phrases.poll.as_ref().map(|p| p.send.fill(0.0, 1.0)) {
            self.send_text(what, &text).await?;
            let line = self.receive(what, self.answer()).await?;
            let wait_for_standstill =
                self.phrases.poll.as_ref().and_then(|p| p.reply.matches(&line, self.settings.units_per_deg));
            if wait_for_standstill.is_some() {
                return Ok(());
            }
            if self.lines.now() > until {
                return Err(self.error(what, "the end of the movement", shown(&line)).remedy(
                    "check that it turns freely, and poll.reply in the configuration, then resume the session",
                ));
            }
            self.pause(what).await?;
        }
        Ok(())
    }

    async fn pause(&mut self, what: &str) -> DeviceResult<()> {
        let until = self.lines.now() + POLL;
        while self.lines.next(what, until).await?.is_some() {}
        Ok(())
    }

    /// Waits until the position is constant, at the target if there is one; returns the position.
    async fn wait_for_rest(&mut self, what: &str, target_deg: Option<f64>) -> DeviceResult<f64> {
        let tolerance = self.settings.motion.tolerance_deg;
        let until = self.lines.now() + self.longest_move();
        let (mut last, mut still) = (f64::NAN, 0);
        while self.lines.now() < until {
            let at = self.place(what).await?;
            // Positions are compared with the first of the equal ones, so that slow drift is noticed.
            if (at - last).abs() <= tolerance {
                still += 1;
            } else {
                (last, still) = (at, 0);
            }
            // One reading suffices at the target or with a status query. Otherwise the movement may not have begun yet.
            let enough = if target_deg.is_some() || self.phrases.poll.is_some() { 1 } else { STILL };
            let there = target_deg.is_none_or(|t| (at - t).abs() <= tolerance);
            match (there, still) {
                (true, n) if n >= enough => return Ok(at),
                (false, STILL..) => {
                    let expected = format!("{}°", target_deg.unwrap_or(0.0));
                    return Err(self.passing(what, &expected, format!("rest at {at:.2}°, without its end")));
                }
                _ => {}
            }
            self.pause(what).await?;
        }
        Err(self.error(what, "rest", "a movement that does not end").remedy("switch it off, then resume the session"))
    }

    async fn find_zero(&mut self, what: &str) -> DeviceResult<f64> {
        if self.phrases.home.is_some() {
            self.zero = Zero::Unchecked;
            let limit = if self.phrases.poll.is_some() { self.answer() } else { self.longest_move() };
            self.exchange(what, |p| p.home.as_ref(), 0.0, limit).await?;
            self.wait_for_standstill(what).await?;
        } else if self.zero == Zero::Forgotten {
            return Err(self.lost_zero(what));
        }
        let at = self.wait_for_rest(what, None).await?;
        if let Zero::Going { to, .. } = self.zero
            && (at - to).abs() > self.settings.motion.tolerance_deg
            && self.phrases.home.is_none()
        {
            return Err(self.moved_away(what, to, at));
        }
        self.zero = Zero::Known(at);
        Ok(at)
    }

    fn again(&self) -> &'static str {
        if self.phrases.home.is_some() {
            "home it, then resume the session"
        } else {
            "set its zero as its manual says, start nacre again, then begin a new session"
        }
    }

    fn lost_zero(&self, what: &str) -> DeviceError {
        self.error(what, "a known zero", "a stage that was reset since it was set").remedy(self.again())
    }

    fn moved_away(&mut self, what: &str, left: f64, at: f64) -> DeviceError {
        self.zero = Zero::Forgotten;
        let expected = format!("to find it where it was left, at {left:.2}°");
        self.error(what, &expected, format!("{at:.2}°, after a reset or another program's move")).remedy(self.again())
    }

    /// Position of the stage, which must be its last known one; homes it if that is unknown.
    async fn verify_position(&mut self, what: &str) -> DeviceResult<f64> {
        if !matches!(self.zero, Zero::Known(_)) {
            return self.find_zero(what).await;
        }
        let at = self.place(what).await?;
        match self.zero.left_elsewhere(at, self.settings.motion.tolerance_deg) {
            Some(left) => Err(self.moved_away(what, left, at)),
            None => Ok(at),
        }
    }

    async fn turn(&mut self, what: &str, angle_deg: f64) -> DeviceResult<Arrived> {
        check::angle(self.lines.device(), what, angle_deg, self.settings.motion.limits_deg, "stage")?;
        let from = self.verify_position(what).await?;
        self.zero = Zero::Going { from, to: angle_deg };
        let limit = if self.phrases.poll.is_some() { self.answer() } else { self.longest_move() };
        self.exchange(what, |p| Some(&p.go), angle_deg, limit).await?;
        self.wait_for_standstill(what).await?;
        let at = self.wait_for_rest(what, Some(angle_deg)).await?;
        self.zero = Zero::Known(at);
        Ok(self.arrived(at))
    }

    fn arrived(&self, angle_deg: f64) -> Arrived {
        Arrived { since: self.clock.now() + Duration::from_millis(self.settings.motion.settling_ms), angle_deg }
    }

    /// Without homing, a restored link may lead to a restarted stage, so the error becomes permanent.
    fn for_good(&self, error: DeviceError) -> DeviceError {
        match error.class {
            Class::Lost if self.phrases.home.is_none() => error.class(Class::Stop).remedy(self.again()),
            _ => error,
        }
    }
}

#[async_trait]
impl Stage for LineStage {
    fn describe(&self) -> StageInfo {
        let motion = &self.settings.motion;
        StageInfo {
            id: self.lines.device().to_owned(),
            speed_deg_s: motion.speed_deg_s,
            settling_s: motion.settling_ms as f64 / 1000.0,
            limits_deg: motion.limits_deg,
            tolerance_deg: motion.tolerance_deg,
            approach_deg: 0.0,
            longest_s: 2.0 * motion.move_ms as f64 / 1000.0,
            halts: self.phrases.halt.is_some(),
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
        // The answer to the dropped query may still arrive.
        for _ in 0..2 {
            match self.exchange("halt", |p| p.halt.as_ref(), 0.0, self.answer()).await {
                Ok(_) => break,
                Err(e) if e.class != Class::Retry => return Err(self.for_good(e)),
                Err(_) => {}
            }
        }
        self.wait_for_standstill("halt").await.map_err(|e| self.for_good(e))?;
        let at = self.wait_for_rest("halt", None).await.map_err(|e| self.for_good(e))?;
        // A stage stopped between the two ends knows its position; elsewhere its zero is lost.
        if let Zero::Going { from, to } = self.zero {
            let slack = self.settings.motion.tolerance_deg;
            let on_its_way = at >= from.min(to) - slack && at <= from.max(to) + slack;
            self.zero = if on_its_way { Zero::Known(at) } else { Zero::Forgotten };
        }
        Ok(())
    }

    async fn position(&mut self) -> DeviceResult<f64> {
        const WHAT: &str = "report its position";
        let at = self.place(WHAT).await.map_err(|e| self.for_good(e))?;
        match self.zero.left_elsewhere(at, self.settings.motion.tolerance_deg) {
            Some(left) => Err(self.moved_away(WHAT, left, at)),
            None if self.zero == Zero::Forgotten => Err(self.lost_zero(WHAT)),
            None => Ok(at),
        }
    }
}

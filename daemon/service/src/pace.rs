//! Remaining time of a session: its estimate, corrected by the measured pace.

use nacre_base::estimate::Machine;
use nacre_capture::plan::{Limits, Plan};
use std::time::{Duration, Instant};

/// Predicted times of the phases of a session in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Expected {
    /// Metering of the exposure.
    pub metering_s: f64,
    /// All frames of the plan.
    pub frames_s: f64,
    /// Results.
    pub results_s: f64,
}

impl Expected {
    /// Prediction for a plan that is metered to `exposure`, or states it.
    pub fn of(plan: &Plan, exposure: Duration, limits: &Limits) -> Self {
        Self {
            metering_s: plan.metering_s(exposure, limits),
            frames_s: plan.estimate(exposure, limits, 0.0).seconds,
            results_s: plan.results_work(limits).map_or(0.0, |work| Machine::here().estimate(&work).seconds),
        }
    }
}

/// Phase of a session.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Waits for the devices.
    Waiting,
    /// Meters the exposure.
    Metering,
    /// Takes frames.
    Frames,
    /// Computes results.
    Results,
}

impl Phase {
    /// Phase of a stage of the run.
    pub fn of(stage: &str) -> Self {
        match stage {
            "waiting" => Self::Waiting,
            "capturing" => Self::Frames,
            _ if stage.starts_with("metering") => Self::Metering,
            _ => Self::Results,
        }
    }
}

/// Measured pace of a session.
#[derive(Debug)]
pub struct Pace {
    expected: Expected,
    phase: Phase,
    /// Start of the phase.
    begun: Instant,
    /// Number of frames of the plan.
    frames: u64,
    /// Number of timed frames, and their total time in seconds.
    timed: (u64, f64),
    /// End of the last frame; `None` at the start and after a pause, when the devices are prepared.
    last: Option<Instant>,
}

impl Pace {
    /// A session that waits for the devices.
    pub fn new(expected: Expected, now: Instant) -> Self {
        Self { expected, phase: Phase::Waiting, begun: now, frames: 0, timed: (0, 0.0), last: None }
    }

    /// A stage begins. Results have several.
    pub fn stage(&mut self, name: &str, steps: u64, now: Instant) {
        let phase = Phase::of(name);
        if phase != self.phase {
            (self.phase, self.begun) = (phase, now);
        }
        if phase == Phase::Frames {
            (self.frames, self.last) = (steps, None);
        }
    }

    /// A frame was taken and stored.
    pub fn frame(&mut self, now: Instant) {
        if let Some(last) = self.last.replace(now) {
            let (count, seconds) = self.timed;
            self.timed = (count + 1, seconds + now.saturating_duration_since(last).as_secs_f64());
        }
    }

    /// The session pauses.
    pub fn pause(&mut self) {
        self.last = None;
    }

    /// Remaining time in seconds until the results, or the last frame of a plan without results.
    /// `done` is the number of stored frames.
    pub fn remaining_s(&self, done: u64, now: Instant) -> f64 {
        let Expected { metering_s, frames_s, results_s } = self.expected;
        let since = |then: Instant| now.saturating_duration_since(then).as_secs_f64();
        match self.phase {
            Phase::Waiting => metering_s + frames_s + results_s,
            Phase::Metering => overdue(metering_s, since(self.begun)) + frames_s + results_s,
            Phase::Frames => {
                let predicted = frames_s / self.frames.max(1) as f64;
                // The prediction counts as one measured frame.
                let (count, seconds) = self.timed;
                let each = (seconds + predicted) / (count + 1) as f64;
                let under_way = since(self.last.unwrap_or(self.begun)).min(each);
                (each * self.frames.saturating_sub(done) as f64 - under_way).max(0.0) + results_s
            }
            Phase::Results => overdue(results_s, since(self.begun)),
        }
    }
}

/// Remaining time in seconds of a phase without measured pace. One that takes longer than predicted is assumed to last
/// a quarter longer than so far.
fn overdue(predicted_s: f64, elapsed_s: f64) -> f64 {
    (predicted_s - elapsed_s).max(0.25 * elapsed_s)
}

#[cfg(test)]
mod tests {
    use super::*;

    const EXPECTED: Expected = Expected { metering_s: 2.0, frames_s: 10.0, results_s: 3.0 };

    fn at(begun: Instant, seconds: f64) -> Instant {
        begun + Duration::from_secs_f64(seconds)
    }

    #[test]
    fn the_measured_pace_corrects_the_estimate() {
        let begun = Instant::now();
        let mut pace = Pace::new(EXPECTED, begun);
        assert_eq!(pace.remaining_s(0, begun), 15.0);
        pace.stage("metering", 1, begun);
        assert_eq!(pace.remaining_s(0, at(begun, 0.5)), 14.5);
        assert_eq!(pace.remaining_s(0, at(begun, 8.0)), 15.0, "metering takes longer than predicted");
        pace.stage("capturing", 10, at(begun, 9.0));
        assert_eq!(pace.remaining_s(0, at(begun, 9.0)), 13.0);
        // Frames take 2 s each, twice as long as predicted.
        for k in 1..=9 {
            pace.frame(at(begun, 9.0 + 2.0 * f64::from(k)));
        }
        let left = pace.remaining_s(9, at(begun, 27.0));
        assert!((4.8..5.0).contains(&left), "{left}");
        pace.stage("solving", 1, at(begun, 29.0));
        pace.stage("writing", 1, at(begun, 31.0));
        assert_eq!(pace.remaining_s(10, at(begun, 31.0)), 1.0);
    }

    #[test]
    fn neither_earlier_frames_nor_pauses_count() {
        let begun = Instant::now();
        let mut pace = Pace::new(EXPECTED, begun);
        pace.stage("capturing", 10, begun);
        assert_eq!(pace.remaining_s(4, begun), 9.0);
        pace.frame(at(begun, 1.0));
        pace.pause();
        pace.frame(at(begun, 1000.0));
        pace.frame(at(begun, 1001.0));
        assert_eq!(pace.remaining_s(7, at(begun, 1001.0)), 6.0);
    }
}

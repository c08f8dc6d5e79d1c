//! Rotation stage of the analyser, with travel time, ringing, backlash and random error.

use crate::config::StageConfig;
use crate::random::{key, normals};
use std::time::Duration;

/// Amplitude in degrees of the ringing after a move; it decays within the settling time.
const RINGING_DEG: f64 = 0.5;

/// A simulated stage. Angles in degrees.
pub struct Stage {
    config: StageConfig,
    seed: u64,
    /// Moves, newest last. Older ones are needed for exposures that began before the last command.
    moves: Vec<Move>,
}

#[derive(Clone, Copy)]
struct Move {
    start: Duration,
    /// Time of arrival; afterwards only ringing remains.
    arrival: Duration,
    from: f64,
    to: f64,
}

impl Stage {
    /// A stage at rest at 0°.
    pub fn new(config: &StageConfig, seed: u64) -> Self {
        let rest = Move { start: Duration::ZERO, arrival: Duration::ZERO, from: 0.0, to: 0.0 };
        Self { config: config.clone(), seed, moves: vec![rest] }
    }

    /// Starts a move; returns the time at which the stage has settled.
    pub fn move_to(&mut self, target_deg: f64, now: Duration) -> Duration {
        let from = self.angle(now);
        let travel = (target_deg - from).abs();
        let missed = if target_deg < from { self.config.backlash_deg } else { 0.0 };
        // The error depends on target and direction only. The same approach ends at the same angle, so a resumed
        // session sees the same angles as an uninterrupted one.
        let [random, _] = normals(key(&[self.seed, 0x57a6e, target_deg.to_bits(), u64::from(target_deg < from)]));
        let arrival = now + Duration::from_secs_f64(travel / self.config.speed_deg_s);
        let to = target_deg + missed + self.config.repeatability_deg * random;
        self.begin(Move { start: now, arrival, from, to });
        arrival + self.settling()
    }

    /// Stops a movement at once.
    pub fn halt(&mut self, now: Duration) {
        let here = self.angle(now);
        self.begin(Move { start: now, arrival: now, from: here, to: here });
    }

    fn begin(&mut self, next: Move) {
        self.moves.push(next);
        if self.moves.len() > 8 {
            self.moves.remove(0);
        }
    }

    /// True angle at a time no earlier than the last few moves.
    pub fn angle(&self, at: Duration) -> f64 {
        let Some(m) = self.moves.iter().rev().find(|m| m.start <= at).or(self.moves.first()) else { return 0.0 };
        if at >= m.arrival {
            if m.from == m.to || self.config.settle_ms == 0.0 {
                return m.to;
            }
            let since = (at - m.arrival).as_secs_f64();
            let settling = self.settling().as_secs_f64();
            if since >= settling {
                return m.to;
            }
            // Decays to 1e-4 of the initial amplitude within the settling time.
            return m.to + RINGING_DEG * (-9.2 * since / settling).exp() * (40.0 * since / settling).cos();
        }
        let share = (at.saturating_sub(m.start)).as_secs_f64() / (m.arrival - m.start).as_secs_f64();
        m.from + (m.to - m.from) * share
    }

    /// Transmission axis of the analyser in degrees, anticlockwise from the right of the image.
    pub fn axis(&self, at: Duration) -> f64 {
        let angle = self.angle(at);
        let error = self.config.eccentricity_deg * (angle - self.config.eccentricity_at_deg).to_radians().sin();
        let sense = if self.config.clockwise { -1.0 } else { 1.0 };
        self.config.zero_deg + sense * (angle + error)
    }

    fn settling(&self) -> Duration {
        Duration::from_secs_f64(self.config.settle_ms / 1000.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stage(backlash_deg: f64) -> Stage {
        Stage::new(&StageConfig { backlash_deg, repeatability_deg: 0.0, ..StageConfig::default() }, 1)
    }

    #[test]
    fn a_move_takes_its_time_and_settles() {
        let mut s = stage(0.0);
        let done = s.move_to(90.0, Duration::from_secs(1));
        assert_eq!(done, Duration::from_millis(1000 + 500 + 120));
        assert!((s.angle(Duration::from_millis(1250)) - 45.0).abs() < 1e-9);
        assert!((s.angle(Duration::from_millis(1501)) - 90.0).abs() > 0.1, "it rings");
        assert!((s.angle(done) - 90.0).abs() < 1e-3);
    }

    #[test]
    fn a_move_that_is_halted_ends_there() {
        let mut s = stage(0.0);
        s.move_to(90.0, Duration::ZERO);
        s.halt(Duration::from_millis(250));
        assert!([250, 300, 5000].into_iter().all(|ms| (s.angle(Duration::from_millis(ms)) - 45.0).abs() < 1e-9));
    }

    #[test]
    fn the_axis_follows_the_scale() {
        let config = StageConfig {
            backlash_deg: 0.0,
            repeatability_deg: 0.0,
            zero_deg: 10.0,
            clockwise: true,
            eccentricity_deg: 0.5,
            eccentricity_at_deg: 30.0,
            ..StageConfig::default()
        };
        let mut s = Stage::new(&config, 1);
        let done = s.move_to(120.0, Duration::ZERO);
        assert!((s.axis(done) - (10.0 - 120.5)).abs() < 1e-3);
    }

    #[test]
    fn arriving_from_above_misses_by_the_backlash() {
        let mut s = stage(0.1);
        let up = s.move_to(30.0, Duration::ZERO);
        assert!((s.angle(up) - 30.0).abs() < 1e-3);
        let down = s.move_to(10.0, up);
        assert!((s.angle(down) - 10.1).abs() < 1e-3);
    }
}

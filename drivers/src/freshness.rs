//! A frame is fresh or it is not used.
//!
//! Cameras queue frames, and adopt a changed setting only some frames later. So a frame may show the bench as it was
//! before the last change. The rule: the whole exposure must lie after the change and its settling, and the
//! camera's control lag must have passed.

use std::time::Duration;

/// What a camera says about a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// Counts frames the camera made, including those nobody took.
    pub sequence: u64,
    /// End of readout, on the bench's clock.
    pub timestamp: Duration,
}

/// The last physical change (stage, light, display, camera control) and how long it takes to act.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Freshness {
    /// When stage, light and display were done changing, settling included.
    pub steady_since: Duration,
    /// When the camera's controls were last set.
    pub controls_set: Duration,
    /// Frames that the camera takes to adopt its controls, as measured.
    pub control_lag_frames: u32,
}

impl Freshness {
    /// Whether a frame with this stamp shows the bench after the last change. `exposure` and `readout` are those in
    /// force, the longest possible where that is not known.
    pub fn accepts(&self, stamp: Stamp, exposure: Duration, readout: Duration) -> bool {
        let frame = exposure + readout;
        let began = stamp.timestamp.saturating_sub(frame);
        // A frame in progress when the controls were set does not count towards the lag.
        let adopted = self.controls_set + frame * (self.control_lag_frames + 1);
        began >= self.steady_since && (self.control_lag_frames == 0 || began >= adopted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn accepts(freshness: Freshness, timestamp_ms: u32) -> bool {
        freshness.accepts(Stamp { sequence: 0, timestamp: MS * timestamp_ms }, MS * 40, MS * 10)
    }

    #[test]
    fn the_whole_exposure_must_follow_the_change() {
        let f = Freshness { steady_since: MS * 1000, ..Freshness::default() };
        assert!(!accepts(f, 1049) && accepts(f, 1050));
    }

    #[test]
    fn the_control_lag_must_have_passed() {
        let f = Freshness { steady_since: Duration::ZERO, controls_set: MS * 1000, control_lag_frames: 2 };
        assert!(!accepts(f, 1199) && accepts(f, 1200));
    }
}

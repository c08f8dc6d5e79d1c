//! Rule for fresh frames: a frame that is not fresh is not used.
//!
//! Cameras queue frames and apply a changed setting only some frames later. A frame may therefore show the bench before
//! the last change. Two conditions must hold. The whole exposure must lie after the change and its settling. The
//! camera's control lag must have passed, counted in frames, since frames with the old exposure may take longer.

use serde::{Deserialize, Serialize};
use std::time::Duration;

/// Sequence number and time of a frame, as reported by the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stamp {
    /// Number of the frame, including frames that were not read.
    pub sequence: u64,
    /// End of readout, on the bench's clock.
    pub timestamp: Duration,
}

/// Condition for frames that show the present state of the bench.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Freshness {
    /// Time at which stage, light and display had finished changing, settling included.
    pub steady_since: Duration,
    /// First frame with the camera's present controls.
    pub first_sequence: u64,
    /// Exposure plus readout with these controls: from a frame's start to its timestamp.
    pub duration: Duration,
}

impl Freshness {
    /// Accepts no frame.
    pub const NEVER: Self = Self { steady_since: Duration::MAX, first_sequence: u64::MAX, duration: Duration::ZERO };

    /// Whether a frame with this stamp shows the bench after the last change.
    pub fn accepts(&self, stamp: Stamp) -> bool {
        let adopted = stamp.sequence >= self.first_sequence;
        adopted && stamp.timestamp.saturating_sub(self.duration) >= self.steady_since
    }

    /// First frame that certainly has the controls set at `set_at`. `frame` is the first frame that ended later: it was
    /// in progress, and up to `lag` more may follow with the old controls. `None` for frames that ended earlier.
    pub fn first_with_controls(frame: Stamp, set_at: Duration, lag: u32) -> Option<u64> {
        (frame.timestamp > set_at).then(|| frame.sequence + 1 + u64::from(lag))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn the_whole_exposure_must_follow_the_change() {
        let f = Freshness { steady_since: MS * 1000, first_sequence: 0, duration: MS * 50 };
        let accepts = |ms: u32| f.accepts(Stamp { sequence: 5, timestamp: MS * ms });
        assert!(!accepts(1049) && accepts(1050));
    }

    #[test]
    fn the_control_lag_must_have_passed() {
        let stamp = |sequence, ms| Stamp { sequence, timestamp: MS * ms };
        assert_eq!(Freshness::first_with_controls(stamp(3, 990), MS * 1000, 2), None);
        assert_eq!(Freshness::first_with_controls(stamp(4, 1040), MS * 1000, 2), Some(7));
        let f = Freshness { first_sequence: 7, ..Freshness::default() };
        assert!(!f.accepts(stamp(6, 9000)) && f.accepts(stamp(7, 9000)));
    }
}

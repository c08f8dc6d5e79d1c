//! Offset of the camera's clock, estimated from the Exif times of its photographs.
//!
//! Camera clocks are wrong by hours or years, and Exif times have a resolution of one second. The first photograph
//! gives the offset to the computer's clock within an interval, and each further one narrows it.

use crate::camera::photograph::Taken;

/// Assumed relative drift between both clocks, such as 4 s per day.
const DRIFT: f64 = 5e-5;
/// Accepted error of Exif times in s: cameras state the time of slightly different moments.
const SLACK_S: f64 = 0.5;

/// Knowledge of the camera's clock. All times are in s; those of the computer since 1970.
#[derive(Clone, Debug, Default)]
pub struct CameraClock {
    /// Lowest and highest difference between camera and computer, and when it was learnt.
    offset: Option<([f64; 2], f64)>,
    /// Time of the last photograph.
    last: Option<Taken>,
}

impl CameraClock {
    /// Records a photograph that was taken before the session.
    pub fn earlier(&mut self, taken: Option<Taken>) {
        self.last = taken.filter(is_finite);
    }

    /// Whether a photograph was certainly taken before `since`, a time of the computer's clock.
    pub fn is_older(&self, taken: Option<Taken>, since: f64) -> bool {
        let Some(taken) = taken.filter(is_finite) else { return false };
        let before_last = self.last.is_some_and(|last| taken.seconds + taken.resolution_s <= last.seconds);
        let latest = taken.seconds + taken.resolution_s;
        before_last || self.widened(since).is_some_and(|[low, _]| latest - low < since)
    }

    /// Learns from a photograph that was taken between the times `since` and `until` of the computer's clock.
    pub fn learn(&mut self, taken: Option<Taken>, since: f64, until: f64) {
        let Some(taken) = taken.filter(is_finite) else { return };
        self.last = Some(taken);
        let found = [taken.seconds - until, taken.seconds + taken.resolution_s - since];
        let narrowed = self.widened(until).map(|[low, high]| [found[0].max(low), found[1].min(high)]);
        // An empty interval means that the camera's clock was set: only the last photograph counts.
        let offset = narrowed.filter(|[low, high]| low <= high).unwrap_or(found);
        self.offset = Some((offset, until));
    }

    /// The interval of the offset, wider by the drift since it was learnt.
    fn widened(&self, now: f64) -> Option<[f64; 2]> {
        self.offset.map(|([low, high], at)| {
            let drift = SLACK_S + DRIFT * (now - at).abs();
            [low - drift, high + drift]
        })
    }
}

fn is_finite(taken: &Taken) -> bool {
    taken.seconds.is_finite() && (0.0..=3600.0).contains(&taken.resolution_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn whole(seconds: f64) -> Option<Taken> {
        Some(Taken { seconds: seconds.floor(), resolution_s: 1.0 })
    }

    #[test]
    fn late_photographs_are_recognised_with_a_clock_that_is_wrong_by_years() {
        let (mut clock, years) = (CameraClock::default(), -1e8);
        clock.earlier(whole(years + 900.0));
        assert!(clock.is_older(whole(years + 800.0), 1000.0), "before that of the folder");
        assert!(!clock.is_older(whole(years + 1001.2), 1000.0));
        clock.learn(whole(years + 1001.2), 1000.0, 1003.0);
        // Taken at 1010, and arrives after the request at 1020.
        assert!(clock.is_older(whole(years + 1010.0), 1020.0));
        assert!(!clock.is_older(whole(years + 1020.5), 1020.0));
        assert!(!clock.is_older(None, 1020.0), "no time is stated");
        assert!(!clock.is_older(Some(Taken { seconds: f64::NAN, resolution_s: 1.0 }), 1020.0));
    }

    #[test]
    fn a_clock_that_was_set_is_learnt_again() {
        let mut clock = CameraClock::default();
        clock.learn(whole(100.0), 100.0, 101.0);
        assert!(!clock.is_older(whole(8000.0), 200.0));
        clock.learn(whole(8000.0), 200.0, 201.0);
        assert!(!clock.is_older(whole(8100.0), 300.0) && clock.is_older(whole(8010.0), 300.0));
    }

    proptest! {
        /// Photographs that are taken after each request are never called older, and those of 6 s before it always are,
        /// if transfers take up to 2 s.
        #[test]
        fn fresh_photographs_are_accepted_and_old_ones_are_not(
            offset in -1e9..1e9f64,
            shots in prop::collection::vec((5.0..500.0f64, 0.0..20.0f64, 0.1..2.0f64), 1..40),
        ) {
            let (mut clock, mut now) = (CameraClock::default(), 1e9);
            for (k, (pause, think, transfer)) in shots.into_iter().enumerate() {
                now += pause;
                let shot = now + think;
                prop_assert!(k == 0 || clock.is_older(whole(now - 6.0 + offset), now));
                prop_assert!(!clock.is_older(whole(shot + offset), now));
                clock.learn(whole(shot + offset), now, shot + transfer);
                now = shot + transfer;
            }
        }
    }
}

//! Frame numbers and times that increase across restarts of the stream, overflows of the kernel's counter and unusable
//! timestamps.

use super::node::Buffer;
use super::settings::Timestamps;
use crate::Stamp;
use std::time::Duration;

/// Largest lead of a timestamp over the present in which a driver that extrapolates may err. Larger ones are of another
/// clock.
const AHEAD: Duration = Duration::from_millis(10);
/// Largest delay between a frame's timestamp and its place in the queue, besides exposure, readout and latency. Older
/// timestamps are of another clock.
const BEHIND: Duration = Duration::from_secs(1);

/// Interpretation of a camera's timestamps.
#[derive(Clone, Copy, Debug)]
pub struct TimeRule {
    /// Meaning of the timestamps.
    pub meaning: Timestamps,
    /// Time from the start of exposure to the end of readout.
    pub duration: Duration,
    /// Maximum delay of a timestamp after the end of readout.
    pub latency: Duration,
}

impl TimeRule {
    /// Latest possible end of readout; `None` if the timestamp is unusable. The queue was empty at `empty_at`, before
    /// the frame arrived.
    fn end_of_readout(&self, buffer: &Buffer<'_>, empty_at: Duration, now: Duration) -> Option<Duration> {
        let starts = match self.meaning {
            Timestamps::Auto => buffer.start_of_exposure,
            Timestamps::StartOfExposure => true,
            Timestamps::EndOfReadout => false,
            Timestamps::Arrival => return None,
        };
        let time = buffer.timestamp;
        let after_start = if starts { self.duration } else { Duration::ZERO };
        let arrived = time.saturating_add(after_start + self.latency + BEHIND);
        if !buffer.monotonic || time.is_zero() || time > now + AHEAD || arrived < empty_at {
            return None;
        }
        let end = if starts { time.saturating_add(after_start) } else { time.saturating_sub(self.latency) };
        // The frame has arrived, so its readout has ended.
        Some(end.min(now))
    }
}

/// Frame counter.
#[derive(Debug, Default)]
pub struct Counter {
    /// Kernel sequence number of the stream's last frame; `None` at its start.
    kernel: Option<u32>,
    next: u64,
    last_end: Option<Duration>,
    /// Last time at which the kernel's queue was certainly empty.
    empty_at: Duration,
    /// Whether the last frame had an unusable timestamp.
    by_arrival: bool,
}

impl Counter {
    /// Starts a new stream. Its numbers exceed all previous ones, even those of another process, because they start at
    /// the time in ms, which grows faster than frame numbers.
    pub fn restart(&mut self, now: Duration) {
        self.kernel = None;
        self.next = self.next.max(u64::try_from(now.as_millis()).unwrap_or(u64::MAX / 2));
        self.empty_at = now;
    }

    /// Notes that the queue was empty at this time.
    pub fn empty(&mut self, at: Duration) {
        self.empty_at = self.empty_at.max(at);
    }

    /// Whether frames are timed by their arrival, for which the queue must be examined often.
    pub fn by_arrival(&self) -> bool {
        self.by_arrival
    }

    /// Number and end of readout of a frame; `None` if the frame is not newer than the last.
    ///
    /// A frame without a usable timestamp gets the last time at which it had certainly not arrived. It is then never
    /// taken for newer than it is.
    pub fn stamp(&mut self, buffer: &Buffer<'_>, rule: &TimeRule, now: Duration) -> Option<Stamp> {
        let end = rule.end_of_readout(buffer, self.empty_at, now);
        let later = end.filter(|end| self.last_end.is_none_or(|last| *end > last));
        let counted = self.kernel.is_none_or(|last| (1..1 << 31).contains(&buffer.sequence.wrapping_sub(last)));
        // The same time again is the same frame again, unless the kernel counted on. Drivers without a counter always
        // give 0.
        if later.is_none() && !counted && (end.is_some() || buffer.sequence != 0) {
            return None;
        }
        self.by_arrival = later.is_none();
        let after_last = |last: Duration| last.saturating_add(Duration::from_nanos(1));
        let arrival = self.empty_at.saturating_sub(rule.latency).max(self.last_end.map_or(Duration::ZERO, after_last));
        let timestamp = later.unwrap_or(arrival);
        self.last_end = Some(timestamp);
        Some(Stamp { sequence: self.number(buffer.sequence), timestamp })
    }

    /// Number of a frame, with gaps for dropped frames. Frames of drivers without a counter are numbered here.
    fn number(&mut self, kernel: u32) -> u64 {
        let ahead = self.kernel.map_or(1, |last| kernel.wrapping_sub(last));
        let skipped = if (1..1 << 31).contains(&ahead) { u64::from(ahead - 1) } else { 0 };
        self.kernel = Some(kernel);
        let number = self.next + skipped;
        self.next = number + 1;
        number
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const NS: Duration = Duration::from_nanos(1);
    const MS: Duration = Duration::from_millis(1);
    const RULE: TimeRule = TimeRule { meaning: Timestamps::Auto, duration: Duration::ZERO, latency: Duration::ZERO };

    fn buffer(sequence: u32, ms: u32) -> Buffer<'static> {
        let timestamp = MS * ms;
        Buffer { bytes: &[], sequence, timestamp, monotonic: true, start_of_exposure: false, error: false }
    }

    fn counter(start: u32) -> Counter {
        let mut counter = Counter::default();
        counter.restart(MS * start);
        counter
    }

    /// Stamps a frame of the stream of [`counter`] at its own time.
    fn number(counter: &mut Counter, kernel: u32, ms: u32) -> Option<u64> {
        counter.stamp(&buffer(kernel, ms), &RULE, MS * ms).map(|stamp| stamp.sequence)
    }

    #[test]
    fn numbers_only_grow_with_gaps_for_dropped_frames() {
        let mut counter = counter(5000);
        let mut number = |kernel, ms: u32| number(&mut counter, kernel, 5000 + ms);
        assert_eq!(number(0, 10), Some(5000));
        assert_eq!(number(3, 20), Some(5003), "two were dropped");
        assert_eq!(number(2, 15), None, "out of order");
        assert_eq!(number(u32::MAX, 30), Some(5004), "a counter that jumps back");
        assert_eq!(number(0, 40), Some(5005), "and runs over");
        assert_eq!(number(0, 50), Some(5006), "and stands still");
    }

    #[test]
    fn numbers_go_on_in_the_next_stream() {
        let mut counter = counter(5000);
        assert_eq!(number(&mut counter, 6, 5010), Some(5000));
        counter.restart(MS * 100);
        assert_eq!(number(&mut counter, 0, 5020), Some(5001));
        counter.restart(MS * 9000);
        assert_eq!(number(&mut counter, 7, 9001), Some(9000));
    }

    #[test]
    fn unusable_timestamps_are_replaced_by_the_last_time_before_the_arrival() {
        let wall = Buffer { monotonic: false, ..buffer(1, 5995) };
        // Frames of other clocks, of the future, and from before the queue was empty.
        for frame in [wall, buffer(1, 0), buffer(1, 6011), buffer(1, 4899)] {
            let mut counter = counter(5000);
            counter.empty(MS * 5900);
            let stamp = counter.stamp(&frame, &RULE, MS * 6000).unwrap();
            assert_eq!((stamp.timestamp, counter.by_arrival()), (MS * 5900, true), "{frame:?}");
        }
        let mut counter = counter(5000);
        counter.empty(MS * 5900);
        let stamp = counter.stamp(&buffer(1, 4900), &RULE, MS * 6000).unwrap();
        assert_eq!((stamp.timestamp, counter.by_arrival()), (MS * 4900, false));
    }

    #[test]
    fn a_clock_that_jumps_back_keeps_the_order_of_frames() {
        let mut counter = counter(5000);
        let mut stamp = |kernel, ms, now| counter.stamp(&buffer(kernel, ms), &RULE, MS * now).map(|s| s.timestamp);
        assert_eq!(stamp(0, 5800, 5800), Some(MS * 5800));
        assert_eq!(stamp(1, 5400, 5900), Some(MS * 5800 + NS));
        assert_eq!(stamp(1, 5400, 5900), None, "the same frame again");
        counter.empty(MS * 5950);
        let end = counter.stamp(&buffer(2, 5500), &RULE, MS * 6000).unwrap().timestamp;
        assert_eq!(end, MS * 5950);
    }

    #[test]
    fn a_driver_without_counter_and_timestamps_is_numbered() {
        let mut counter = counter(5000);
        let numbers: Vec<_> = (0..3).map(|_| number(&mut counter, 0, 0)).collect();
        assert_eq!(numbers, [Some(5000), Some(5001), Some(5002)]);
        // A driver that does count sent the same frame twice.
        assert_eq!((number(&mut counter, 7, 0), number(&mut counter, 7, 0)), (Some(5009), None));
    }

    proptest! {
        #[test]
        fn frames_stay_in_order_with_any_timestamps(
            frames in prop::collection::vec((any::<u32>(), 0u64..4000, any::<[bool; 3]>(), 0u32..300), 1..40),
            duration in 0u32..3000,
        ) {
            let mut counter = counter(1000);
            let rule = TimeRule { duration: MS * duration, latency: MS, ..RULE };
            let (mut now, mut last) = (MS * 1000, Stamp { sequence: 0, timestamp: Duration::ZERO });
            for (i, (sequence, ms, [monotonic, start_of_exposure, empty], waited)) in frames.into_iter().enumerate() {
                if empty {
                    counter.empty(now);
                }
                now += MS * waited;
                let timestamp = Duration::from_millis(ms);
                let frame = Buffer { timestamp, monotonic, start_of_exposure, ..buffer(sequence, 0) };
                if let Some(stamp) = counter.stamp(&frame, &rule, now) {
                    prop_assert!(stamp.sequence > last.sequence && stamp.timestamp > last.timestamp);
                    prop_assert!(stamp.timestamp <= now + NS * i as u32);
                    last = stamp;
                }
            }
        }
    }

    #[test]
    fn the_start_of_exposure_counts_only_with_its_duration() {
        let rule = TimeRule { duration: MS * 2000, ..RULE };
        let started = Buffer { start_of_exposure: true, ..buffer(1, 5000) };
        let mut counter = counter(5000);
        counter.empty(MS * 6500);
        // The queue was empty 1.5 s after the timestamp, which the exposure explains.
        assert_eq!(counter.stamp(&started, &rule, MS * 7000).unwrap().timestamp, MS * 7000);
    }
}

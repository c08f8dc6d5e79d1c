//! Frame numbers and times: evidence of freshness.

use std::time::Duration;

/// Largest frame number of GigE Vision 1; 0 is never used.
const BLOCK_IDS: u64 = 65_535;
/// Time over which the delay between the camera's clock and arrival is compared. Clocks drift apart by at most 100 ppm,
/// 1 ms in this time, and a longer exposure delays frames for at most twice this time.
const WINDOW: Duration = Duration::from_secs(10);

/// Frame counter that continues across restarts of the stream and overflows of the camera's numbers.
#[derive(Debug, Default)]
pub struct Counter {
    /// The camera's number of the stream's last frame; `None` at its start.
    last: Option<u64>,
    next: u64,
}

impl Counter {
    /// Starts a new stream. Its numbers exceed all previous ones, even those of another process, because they start at
    /// the time in ms, which grows faster than frame numbers.
    pub fn restart(&mut self, now: Duration) {
        self.last = None;
        self.next = self.next.max(u64::try_from(now.as_millis()).unwrap_or(u64::MAX / 2));
    }

    /// Number of a frame, with gaps for lost frames. Frames of a camera that restarts its numbers count on.
    pub fn number(&mut self, id: u64) -> u64 {
        let ahead = self.last.map_or(1, |last| match id {
            _ if id > last => id - last,
            // 16-bit numbers begin again with 1.
            _ if last <= BLOCK_IDS && id > 0 => id + BLOCK_IDS - last,
            _ => 1,
        });
        let skipped = if (1..1 << 15).contains(&ahead) { ahead - 1 } else { 0 };
        self.last = Some(id);
        let number = self.next.saturating_add(skipped);
        self.next = number.saturating_add(1);
        number
    }
}

/// Relation of the camera's clock to the monotonic clock.
///
/// A frame that waited in the camera or on the network arrives late, and could pass for a fresh one. The camera's own
/// timestamp has no such delay. The smallest difference between arrival and timestamp converts it to the monotonic
/// clock. The result is never later than the arrival.
#[derive(Debug, Default)]
pub struct DeviceClock {
    last_ns: u64,
    begun: Duration,
    /// Smallest differences in ns: of the previous window and of this one.
    offsets: [Option<i128>; 2],
}

impl DeviceClock {
    /// Time of a frame on the monotonic clock. `device_ns` is the camera's timestamp in ns; 0 for a camera without a
    /// clock, whose frames have the time of their arrival.
    pub fn time(&mut self, device_ns: u64, arrival: Duration) -> Duration {
        if device_ns <= self.last_ns {
            // The clock was set back or does not run.
            *self = Self { last_ns: device_ns, begun: arrival, offsets: [None; 2] };
            if device_ns == 0 {
                return arrival;
            }
        }
        self.last_ns = device_ns;
        if arrival.saturating_sub(self.begun) > WINDOW {
            self.begun = arrival;
            self.offsets = [self.offsets[1], None];
        }
        let (device, arrived) = (i128::from(device_ns), arrival.as_nanos().cast_signed());
        let offset = arrived - device;
        let smallest = self.offsets[1].map_or(offset, |known| known.min(offset));
        self.offsets[1] = Some(smallest);
        let smallest = self.offsets[0].map_or(smallest, |known| known.min(smallest));
        u64::try_from(device + smallest).map_or(arrival, Duration::from_nanos)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn numbers_only_grow_with_gaps_for_lost_frames() {
        let mut counter = Counter::default();
        counter.restart(MS * 5000);
        let numbers: Vec<u64> = [65_533, 65_534, 1, 2, 5, 5, 0, 1].map(|id| counter.number(id)).into();
        assert_eq!(numbers, [5000, 5001, 5003, 5004, 5007, 5008, 5009, 5010], "65535 and 3 to 4 were lost");
        counter.restart(MS * 100);
        assert_eq!(counter.number(7), 5011);
        let mut wide = Counter::default();
        assert_eq!([1 << 40, (1 << 40) + 3, 9].map(|id| wide.number(id)), [0, 3, 4]);
    }

    #[test]
    fn a_frame_that_waited_has_the_time_at_which_it_was_taken() {
        let mut clock = DeviceClock::default();
        let second = 1_000_000_000;
        assert_eq!(clock.time(5 * second, MS * 100_010), MS * 100_010);
        // Taken 1 s later, but 300 ms late on the network.
        assert_eq!(clock.time(6 * second, MS * 101_310), MS * 101_010);
        // A faster frame shows that the first was late too.
        assert_eq!(clock.time(7 * second, MS * 102_005), MS * 102_005);
        assert_eq!(clock.time(8 * second, MS * 103_050), MS * 103_005);
        // The clock is set back.
        assert_eq!(clock.time(1, MS * 104_000), MS * 104_000);
        // A camera without a clock.
        assert_eq!([0, 0].map(|ns| clock.time(ns, MS * 105_000)), [MS * 105_000; 2]);
    }

    #[test]
    fn a_drifting_clock_is_followed() {
        let mut clock = DeviceClock::default();
        for s in 1..2000u64 {
            // The camera's clock is slow by 100 ppm.
            let arrival = Duration::from_secs(s) + MS * 10;
            let time = clock.time(s * 999_900_000, arrival);
            assert!(time <= arrival && arrival - time <= MS * 3, "{s}: {:?}", arrival - time);
        }
    }

    proptest! {
        #[test]
        fn times_are_in_order_and_not_after_arrival(frames in prop::collection::vec((1u64..1 << 40, 1u64..1 << 40), 1..50)) {
            let (mut clock, mut device, mut arrival, mut last) = (DeviceClock::default(), 0, 0, None);
            for (later, gap) in frames {
                (device, arrival) = (device + later, arrival + gap);
                let arrived = Duration::from_nanos(arrival);
                let time = clock.time(device, arrived);
                prop_assert!(time <= arrived && last.is_none_or(|last| time > last), "{time:?} after {last:?}");
                last = Some(time);
            }
        }

        #[test]
        fn no_stamp_is_too_wild(stamps: Vec<(u64, u64, u64)>) {
            let (mut clock, mut counter, mut last) = (DeviceClock::default(), Counter::default(), None);
            for (id, ns, arrival) in stamps {
                let arrival = Duration::from_nanos(arrival);
                prop_assert!(clock.time(ns, arrival) <= arrival);
                let number = counter.number(id);
                prop_assert!(last.is_none_or(|last| number > last));
                last = Some(number);
            }
        }
    }
}

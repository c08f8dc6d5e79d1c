//! Frame numbers that continue across restarts of the stream and overflows of the kernel's counter.

use std::time::Duration;

/// Frame counter.
#[derive(Debug, Default)]
pub struct Counter {
    /// Kernel sequence number of the stream's last frame; `None` at its start.
    kernel: Option<u32>,
    next: u64,
    last_end: Option<Duration>,
}

impl Counter {
    /// Starts a new stream. Its numbers exceed all previous ones, even those of another process, because they start at
    /// the time in ms, which grows faster than frame numbers.
    pub fn restart(&mut self, now: Duration) {
        self.kernel = None;
        self.next = self.next.max(u64::try_from(now.as_millis()).unwrap_or(u64::MAX / 2));
    }

    /// Number of a frame, with gaps for dropped frames; `None` if the frame is not newer than the last. Frames of
    /// drivers without a counter are numbered here.
    pub fn number(&mut self, kernel: u32, end: Duration) -> Option<u64> {
        if self.last_end.is_some_and(|last| end <= last) {
            return None;
        }
        self.last_end = Some(end);
        let ahead = self.kernel.map_or(1, |last| kernel.wrapping_sub(last));
        let skipped = if (1..1 << 31).contains(&ahead) { u64::from(ahead - 1) } else { 0 };
        self.kernel = Some(kernel);
        let number = self.next + skipped;
        self.next = number + 1;
        Some(number)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn numbers_only_grow_with_gaps_for_dropped_frames() {
        let mut counter = Counter::default();
        counter.restart(MS * 5000);
        let mut number = |kernel, ms: u32| counter.number(kernel, MS * ms);
        assert_eq!(number(0, 10), Some(5000));
        assert_eq!(number(3, 20), Some(5003), "two were dropped");
        assert_eq!(number(2, 15), None, "out of order");
        assert_eq!(number(u32::MAX, 30), Some(5004), "a counter that jumps back");
        assert_eq!(number(0, 40), Some(5005), "and runs over");
        assert_eq!(number(0, 50), Some(5006), "and stands still");
        counter.restart(MS * 100);
        assert_eq!(counter.number(0, MS * 60), Some(5007));
        counter.restart(MS * 9000);
        assert_eq!(counter.number(7, MS * 9001), Some(9000));
    }
}

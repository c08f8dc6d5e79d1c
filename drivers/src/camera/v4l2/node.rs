//! What the driver needs of a video device: the seam between it and the kernel.

use std::io;
use std::time::Duration;

/// A video device: one of the kernel, or a fake one in tests.
///
/// Errors are the kernel's own: `ENODEV` for a device that is gone, `EBUSY` for one in use.
pub trait Node: Send {
    /// Range of a control; None if the device does not have it.
    fn range(&mut self, id: u32) -> io::Result<Option<Range>>;
    /// Sets a control.
    fn set(&mut self, id: u32, value: i64) -> io::Result<()>;
    /// Value of a control.
    fn get(&mut self, id: u32) -> io::Result<i64>;
    /// Codes of the formats that it offers.
    fn formats(&mut self) -> io::Result<Vec<[u8; 4]>>;
    /// Sizes that it offers in a format; of a range only the largest.
    fn sizes(&mut self, fourcc: [u8; 4]) -> io::Result<Vec<[u32; 2]>>;
    /// Sets format and size; returns what became of them.
    fn set_format(&mut self, fourcc: [u8; 4], size: [u32; 2]) -> io::Result<Format>;
    /// Times from frame to frame that it offers, in seconds.
    fn intervals(&mut self, format: &Format) -> io::Result<Vec<f64>>;
    /// Sets the time from frame to frame where one is given; returns the one in force, if the device tells.
    fn interval(&mut self, seconds: Option<f64>) -> io::Result<Option<f64>>;
    /// Starts the stream with this many buffers; its sequence numbers begin again.
    fn start(&mut self, buffers: u32) -> io::Result<()>;
    /// Stops the stream.
    fn stop(&mut self) -> io::Result<()>;
    /// The oldest frame in the queue; None when none came within `timeout`.
    fn dequeue(&mut self, timeout: Duration) -> io::Result<Option<Buffer<'_>>>;
}

/// What a control can be set to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Range {
    /// Lowest value.
    pub low: i64,
    /// Highest value.
    pub high: i64,
    /// Values differ by multiples of it.
    pub step: i64,
    /// It cannot be set.
    pub fixed: bool,
}

impl Range {
    /// The value nearest to `value` that can be set.
    pub fn nearest(&self, value: f64) -> i64 {
        let (low, high) = (self.low, self.high.max(self.low));
        let step = self.step.max(1) as f64;
        let steps = ((value - low as f64) / step).round();
        let nearest = (low as f64 + steps * step).clamp(low as f64, high as f64);
        (nearest as i64).clamp(low, high)
    }
}

/// Format of a stream, as the kernel says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Format {
    /// Code of the format.
    pub fourcc: [u8; 4],
    /// Pixels per row, and rows.
    pub size: [u32; 2],
    /// Bytes from one row to the next.
    pub stride: u32,
    /// Luma uses all codes; None if the device does not say.
    pub full_range: Option<bool>,
}

/// A frame as it lies in the kernel's memory.
#[derive(Clone, Copy, Debug)]
pub struct Buffer<'a> {
    /// What the camera sent.
    pub bytes: &'a [u8],
    /// Counts frames since the stream was started, including dropped ones.
    pub sequence: u32,
    /// On the monotonic clock.
    pub timestamp: Duration,
    /// The timestamp is on the monotonic clock.
    pub monotonic: bool,
    /// The timestamp is that of the exposure's start; otherwise that of the frame's arrival, which may be later than the end of
    /// readout by the time that the camera takes to work on it ([`super::Settings::latency_ms`]).
    pub start_of_exposure: bool,
    /// The driver says that the frame is damaged.
    pub error: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn values_are_rounded_to_steps_within_the_range() {
        let range = Range { low: 3, high: 2047, step: 4, fixed: false };
        assert_eq!([0.0, 4.9, 5.1, 1e9].map(|v| range.nearest(v)), [3, 3, 7, 2047]);
        assert_eq!(range.nearest(f64::NAN), range.low);
    }

    proptest! {
        #[test]
        fn no_range_is_too_wild(low: i64, high: i64, step: i64, value: f64) {
            let nearest = Range { low, high, step, fixed: false }.nearest(value);
            prop_assert!(nearest >= low && nearest <= high.max(low));
        }
    }
}

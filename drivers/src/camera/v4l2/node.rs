//! Interface between the driver and the kernel's video device.

use std::io;
use std::time::Duration;

/// A video device of the kernel, or a fake one in tests.
///
/// Errors are those of the kernel: `ENODEV` for a device that is gone, `EBUSY` for one in use.
pub trait Node: Send {
    /// Range of a control; `None` if the device lacks it.
    fn range(&mut self, id: u32) -> io::Result<Option<Range>>;
    /// Sets a control.
    fn set(&mut self, id: u32, value: i64) -> io::Result<()>;
    /// Value of a control.
    fn get(&mut self, id: u32) -> io::Result<i64>;
    /// FourCC codes of the supported formats.
    fn formats(&mut self) -> io::Result<Vec<[u8; 4]>>;
    /// Supported sizes in a format; only the largest of a continuous range.
    fn sizes(&mut self, fourcc: [u8; 4]) -> io::Result<Vec<[u32; 2]>>;
    /// Sets format and size; returns those in force.
    fn set_format(&mut self, fourcc: [u8; 4], size: [u32; 2]) -> io::Result<Format>;
    /// Supported frame intervals in s.
    fn intervals(&mut self, format: &Format) -> io::Result<Vec<f64>>;
    /// Sets the frame interval in s if given; returns the one in force, or `None` if the device does not report it.
    fn interval(&mut self, seconds: Option<f64>) -> io::Result<Option<f64>>;
    /// Starts the stream with this many buffers; sequence numbers restart. Returns the format in force, which other
    /// programs could change until now.
    fn start(&mut self, buffers: u32) -> io::Result<Format>;
    /// Stops the stream.
    fn stop(&mut self) -> io::Result<()>;
    /// The oldest frame in the queue; `None` if the queue stayed empty for `timeout`.
    fn dequeue(&mut self, timeout: Duration) -> io::Result<Option<Buffer<'_>>>;
}

/// Range of a control's values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Range {
    /// Lowest value.
    pub low: i64,
    /// Highest value.
    pub high: i64,
    /// Step between supported values.
    pub step: i64,
    /// Whether the control is read-only.
    pub fixed: bool,
}

impl Range {
    /// The supported value closest to `value`.
    pub fn nearest(&self, value: f64) -> i64 {
        let (low, high) = (self.low, self.high.max(self.low));
        let step = self.step.max(1) as f64;
        let steps = ((value - low as f64) / step).round();
        let nearest = (low as f64 + steps * step).clamp(low as f64, high as f64);
        (nearest as i64).clamp(low, high)
    }
}

/// Format of a stream, as reported by the kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Format {
    /// FourCC code of the format.
    pub fourcc: [u8; 4],
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Bytes from one row to the next.
    pub stride: u32,
    /// Whether luma uses the full range of codes; `None` if the device does not report it.
    pub full_range: Option<bool>,
}

/// The picture in a plane's memory. `used` counts the bytes of a header of `offset` bytes and of the picture after it.
pub fn plane_payload(memory: &[u8], used: u32, offset: u32) -> &[u8] {
    let [used, offset] = [used, offset].map(|bytes| usize::try_from(bytes).unwrap_or(usize::MAX));
    let end = used.min(memory.len());
    &memory[offset.min(end)..end]
}

/// A frame in the kernel's memory.
#[derive(Clone, Copy, Debug)]
pub struct Buffer<'a> {
    /// Payload sent by the camera.
    pub bytes: &'a [u8],
    /// Frame number since the start of the stream, including dropped frames.
    pub sequence: u32,
    /// Timestamp, on the clock given by `monotonic`.
    pub timestamp: Duration,
    /// Whether the timestamp is on the monotonic clock.
    pub monotonic: bool,
    /// Whether the timestamp is that of the exposure's start. Otherwise it is that of the frame's arrival, which lags
    /// the end of readout by the camera's processing time ([`super::Settings::latency_ms`]).
    pub start_of_exposure: bool,
    /// Whether the driver flags the frame as damaged.
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

    #[test]
    fn a_plane_may_begin_with_a_header() {
        let memory = [1, 2, 3, 4];
        assert_eq!(plane_payload(&memory, 3, 0), [1, 2, 3]);
        assert_eq!(plane_payload(&memory, 4, 1), [2, 3, 4]);
        assert_eq!(
            [(9, 2), (2, 9), (0, 0)].map(|(used, offset)| plane_payload(&memory, used, offset).len()),
            [2, 0, 0]
        );
    }

    proptest! {
        #[test]
        fn no_range_is_too_wild(low: i64, high: i64, step: i64, value: f64) {
            let nearest = Range { low, high, step, fixed: false }.nearest(value);
            prop_assert!(nearest >= low && nearest <= high.max(low));
        }
    }
}

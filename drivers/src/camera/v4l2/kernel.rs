//! Video devices of the kernel.
//!
//! The crate `v4l` panics on unknown answers, such as a new colour space. Every call that may panic is wrapped, and the
//! panic becomes an error.

use super::driver::{Reset, V4l2Camera, failure};
use super::node::{Buffer, Format, Node, Range};
use super::settings::Settings;
use crate::{Clock, DeviceResult, usb_reset};
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use v4l::buffer::{Flags, Type};
use v4l::frameinterval::FrameIntervalEnum;
use v4l::framesize::FrameSizeEnum;
use v4l::io::mmap::Stream;
use v4l::io::traits::{CaptureStream, Stream as _};
use v4l::v4l_sys::v4l2_query_ext_ctrl;
use v4l::video::Capture;
use v4l::{Device, FourCC, Fraction, control, format::Quantization};

/// Parameter of uvcvideo: whether timestamps come from the camera ("1") or from the arrival of a frame's first packet.
const UVC_CLOCK: &str = "/sys/module/uvcvideo/parameters/hwtimestamps";
/// Maximum number of sizes, formats or rates that are read.
const MAX_LIST: usize = 4096;

/// A video device of the kernel.
pub struct KernelNode {
    device: Device,
    stream: Option<Stream<'static>>,
    /// Whether the flag for the start of exposure is reliable.
    starts: bool,
}

/// Opens a camera.
///
/// # Errors
/// `Setup` if the device is missing, may not be opened or is no camera.
pub fn open(settings: &Settings, clock: &Arc<dyn Clock>) -> DeviceResult<V4l2Camera> {
    let failed = |e| failure(&settings.device, "open", "a camera", &e);
    let path = std::fs::canonicalize(&settings.device).map_err(failed)?;
    let place = usb_reset::sysfs_device("video4linux", &path);
    let id = place.as_deref().map_or_else(|| settings.device.clone(), |p| identity(p, &path));
    let node = KernelNode::open(&path).map_err(failed)?;
    V4l2Camera::open(Box::new(node), &id, settings.clone(), clock.clone(), resetter(place))
}

/// Model and serial number; the name for a camera that is not on USB.
fn identity(place: &Path, node: &Path) -> String {
    if let Some(usb) = usb_reset::usb_identity(place) {
        return format!("v4l2 {usb}");
    }
    let name = node.file_name().map(|n| Path::new("/sys/class/video4linux").join(n).join("name"));
    let name = name.and_then(|path| std::fs::read_to_string(path).ok());
    format!("v4l2 {}", name.as_deref().map_or("camera", str::trim))
}

fn resetter(place: Option<PathBuf>) -> Reset {
    Box::new(move || {
        let place = place.as_deref().ok_or("its place in the system is not known")?;
        usb_reset::reset(usb_reset::usb_address(place).ok_or("it is not a USB device")?)
    })
}

impl KernelNode {
    /// Opens the device node `path`.
    ///
    /// # Errors
    /// As the kernel.
    pub fn open(path: &Path) -> io::Result<Self> {
        let driver = usb_reset::sysfs_device("video4linux", path).and_then(|p| p.join("driver").canonicalize().ok());
        let uvc = driver.is_some_and(|d| d.ends_with("uvcvideo"));
        // By default uvcvideo flags the start of exposure but stamps the arrival of a frame's first packet. That packet
        // arrives after the exposure, so the stamp would be late by up to a frame period.
        let from_camera = std::fs::read_to_string(UVC_CLOCK).is_ok_and(|v| matches!(v.trim(), "1" | "Y"));
        Ok(Self { device: Device::with_path(path)?, stream: None, starts: !uvc || from_camera })
    }
}

/// Runs a call into the crate `v4l` and converts a panic into an error.
fn caught<T>(run: impl FnOnce() -> io::Result<T>) -> io::Result<T> {
    catch_unwind(AssertUnwindSafe(run))
        .unwrap_or_else(|_| Err(io::Error::other("an answer of the kernel that the crate v4l does not know")))
}

/// The crate queries all controls at once and panics on unknown control types.
#[allow(unsafe_code, reason = "the crate has no safe way to ask for one control's range")]
fn query(device: &Device, id: u32) -> io::Result<v4l2_query_ext_ctrl> {
    // SAFETY: the structure is plain data for which zeros are valid, and it lives through the call. It is the one that
    // this request reads and writes. The descriptor belongs to `device`.
    unsafe {
        let mut control_query = v4l2_query_ext_ctrl { id, ..std::mem::zeroed() };
        let request = v4l::v4l2::vidioc::VIDIOC_QUERY_EXT_CTRL;
        v4l::v4l2::ioctl(device.handle().fd(), request, (&raw mut control_query).cast())?;
        Ok(control_query)
    }
}

fn seconds(fraction: &Fraction) -> f64 {
    f64::from(fraction.numerator) / f64::from(fraction.denominator)
}

impl Node for KernelNode {
    fn range(&mut self, id: u32) -> io::Result<Option<Range>> {
        const UNUSABLE: u32 = control::Flags::DISABLED.bits() | control::Flags::WRITE_ONLY.bits();
        match query(&self.device, id) {
            Ok(found) if found.flags & UNUSABLE == 0 => Ok(Some(Range {
                low: found.minimum,
                high: found.maximum,
                step: i64::try_from(found.step).unwrap_or(i64::MAX),
                fixed: found.flags & control::Flags::READ_ONLY.bits() != 0,
            })),
            Ok(_) => Ok(None),
            Err(e) if matches!(e.kind(), io::ErrorKind::InvalidInput | io::ErrorKind::Unsupported) => Ok(None),
            // The driver has no controls.
            Err(e) if e.raw_os_error() == Some(rustix::io::Errno::NOTTY.raw_os_error()) => Ok(None),
            Err(e) => Err(e),
        }
    }

    fn set(&mut self, id: u32, value: i64) -> io::Result<()> {
        self.device.set_control(control::Control { id, value: control::Value::Integer(value) })
    }

    fn get(&mut self, id: u32) -> io::Result<i64> {
        match caught(|| self.device.control(id))?.value {
            control::Value::Integer(value) => Ok(value),
            control::Value::Boolean(value) => Ok(i64::from(value)),
            other => Err(io::Error::other(format!("a value that is no number: {other:?}"))),
        }
    }

    fn formats(&mut self) -> io::Result<Vec<[u8; 4]>> {
        let formats = caught(|| self.device.enum_formats())?;
        Ok(formats.into_iter().take(MAX_LIST).map(|f| f.fourcc.repr).collect())
    }

    fn sizes(&mut self, fourcc: [u8; 4]) -> io::Result<Vec<[u32; 2]>> {
        let sizes = caught(|| self.device.enum_framesizes(FourCC::new(&fourcc)))?;
        let largest = |size: FrameSizeEnum| match size {
            FrameSizeEnum::Discrete(d) => [d.width, d.height],
            FrameSizeEnum::Stepwise(s) => [s.max_width, s.max_height],
        };
        Ok(sizes.into_iter().take(MAX_LIST).map(|s| largest(s.size)).collect())
    }

    fn set_format(&mut self, fourcc: [u8; 4], [width, height]: [u32; 2]) -> io::Result<Format> {
        let wanted = v4l::Format::new(width, height, FourCC::new(&fourcc));
        let got = caught(|| self.device.set_format(&wanted))?;
        let full_range = match got.quantization {
            Quantization::FullRange => Some(true),
            Quantization::LimitedRange => Some(false),
            Quantization::Default => None,
        };
        Ok(Format { fourcc: got.fourcc.repr, size: [got.width, got.height], stride: got.stride, full_range })
    }

    fn intervals(&mut self, format: &Format) -> io::Result<Vec<f64>> {
        let [width, height] = format.size;
        // Drivers that cannot list intervals can still report the current one.
        let found = caught(|| self.device.enum_frameintervals(FourCC::new(&format.fourcc), width, height));
        let discrete = |interval: v4l::FrameInterval| match interval.interval {
            FrameIntervalEnum::Discrete(fraction) => Some(seconds(&fraction)),
            FrameIntervalEnum::Stepwise(_) => None,
        };
        Ok(found.unwrap_or_default().into_iter().take(MAX_LIST).filter_map(discrete).collect())
    }

    fn interval(&mut self, wanted: Option<f64>) -> io::Result<Option<f64>> {
        const UNIT: u32 = 10_000_000;
        let params = match wanted {
            Some(s) => {
                let fraction = Fraction::new((s * f64::from(UNIT)).round().clamp(1.0, 4e9) as u32, UNIT);
                caught(|| self.device.set_params(&v4l::video::capture::Parameters::new(fraction)))
            }
            None => caught(|| self.device.params()),
        };
        match params {
            Ok(params) => Ok(Some(seconds(&params.interval))),
            Err(e) if super::controls::is_gone(&e) => Err(e),
            // Many drivers do not report frame rates.
            Err(_) => Ok(None),
        }
    }

    fn start(&mut self, buffers: u32) -> io::Result<()> {
        self.stop()?;
        let mut stream = Stream::with_buffers(&self.device, Type::VideoCapture, buffers.max(2))?;
        // `next` requeues the buffer that it returned last, initially number 0; the others are queued here.
        for index in 1.. {
            match CaptureStream::queue(&mut stream, index) {
                Ok(()) => {}
                // There are no more buffers: the driver decides their number.
                Err(e) if e.kind() == io::ErrorKind::InvalidInput && index > 1 => break,
                Err(e) => {
                    release(stream);
                    return Err(e);
                }
            }
        }
        if let Err(e) = stream.start() {
            release(stream);
            return Err(e);
        }
        self.stream = Some(stream);
        Ok(())
    }

    fn stop(&mut self) -> io::Result<()> {
        if let Some(stream) = self.stream.take() {
            release(stream);
        }
        Ok(())
    }

    fn dequeue(&mut self, timeout: Duration) -> io::Result<Option<Buffer<'_>>> {
        let starts = self.starts;
        let Some(stream) = &mut self.stream else { return Err(io::Error::other("no stream")) };
        let ms = i32::try_from(timeout.as_millis()).unwrap_or(i32::MAX);
        // POLLIN. A device that is gone is ready at once, and the read below fails.
        if caught(|| stream.handle().poll(1, ms))? == 0 {
            return Ok(None);
        }
        stream.set_timeout(timeout.min(Duration::from_secs(1000)));
        let (bytes, meta) = CaptureStream::next(stream)?;
        let used = usize::try_from(meta.bytesused).unwrap_or(0).min(bytes.len());
        let kind = meta.flags & Flags::TIMESTAMP_MASK;
        let source = meta.flags & Flags::TSTAMP_SRC_MASK;
        let micros = u32::try_from(meta.timestamp.usec).unwrap_or(0).min(999_999);
        Ok(Some(Buffer {
            bytes: &bytes[..used],
            sequence: meta.sequence,
            timestamp: Duration::new(u64::try_from(meta.timestamp.sec).unwrap_or(0), micros * 1000),
            monotonic: kind == Flags::TIMESTAMP_MONOTONIC,
            start_of_exposure: starts && source == Flags::TSTAMP_SRC_SOE,
            error: meta.flags.contains(Flags::ERROR),
        }))
    }
}

impl Drop for KernelNode {
    fn drop(&mut self) {
        let _ = self.stop();
    }
}

/// Stops a stream and frees its buffers. The crate panics if that fails, and a second panic would abort the process, so
/// the stream is then leaked.
fn release(mut stream: Stream<'static>) {
    match stream.stop() {
        Err(e) if !super::controls::is_gone(&e) => std::mem::forget(stream),
        _ => drop(catch_unwind(AssertUnwindSafe(|| drop(stream)))),
    }
}

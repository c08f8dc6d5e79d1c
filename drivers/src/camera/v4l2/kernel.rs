//! Video devices of the kernel.
//!
//! The crate `v4l` panics on unknown answers, such as a new type of control. Every call that may panic is wrapped, and
//! the panic becomes an error. Its calls for formats and streams know only the single-planar interface, so those are
//! made here and in `stream.rs`.
#![allow(unsafe_code, reason = "calls of the kernel")]

use super::driver::{Reset, V4l2Camera, failure};
use super::node::{Buffer, Format, Node, Range};
use super::settings::Settings;
use super::stream::{Stream, ioctl};
use crate::{Clock, DeviceResult, usb_reset};
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;
use v4l::frameinterval::FrameIntervalEnum;
use v4l::framesize::FrameSizeEnum;
use v4l::v4l_sys::{
    V4L2_CAP_DEVICE_CAPS, V4L2_CAP_VIDEO_CAPTURE, V4L2_CAP_VIDEO_CAPTURE_MPLANE, v4l2_buf_type,
    v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE as SINGLE_PLANAR,
    v4l2_buf_type_V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE as MULTI_PLANAR, v4l2_capability, v4l2_captureparm,
    v4l2_field_V4L2_FIELD_NONE as PROGRESSIVE, v4l2_fmtdesc, v4l2_format, v4l2_fract, v4l2_pix_format,
    v4l2_pix_format_mplane, v4l2_quantization_V4L2_QUANTIZATION_FULL_RANGE as FULL_RANGE,
    v4l2_quantization_V4L2_QUANTIZATION_LIM_RANGE as LIMITED_RANGE, v4l2_query_ext_ctrl, v4l2_streamparm,
};
use v4l::v4l2::vidioc;
use v4l::video::Capture;
use v4l::{Device, FourCC, Fraction, control};

/// Parameter of uvcvideo: whether timestamps come from the camera ("1") or from the arrival of a frame's first packet.
const UVC_CLOCK: &str = "/sys/module/uvcvideo/parameters/hwtimestamps";
/// Maximum number of sizes, formats or rates that are read.
const MAX_LIST: u32 = 4096;

/// A video device of the kernel.
pub struct KernelNode {
    device: Device,
    /// Interface for formats and buffers.
    kind: v4l2_buf_type,
    stream: Option<Stream>,
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
        let device = Device::with_path(path)?;
        let kind = interface(&device)?;
        Ok(Self { device, kind, stream: None, starts: !uvc || from_camera })
    }

    /// The format in force, or sets one.
    fn format(&self, request: vidioc::_IOC_TYPE, wanted: Option<([u8; 4], [u32; 2])>) -> io::Result<Format> {
        let mut format = v4l2_format { type_: self.kind, ..Default::default() };
        let multi_planar = self.kind == MULTI_PLANAR;
        if let Some((fourcc, [width, height])) = wanted {
            let pixelformat = u32::from_le_bytes(fourcc);
            if multi_planar {
                format.fmt.pix_mp =
                    v4l2_pix_format_mplane { width, height, pixelformat, field: PROGRESSIVE, ..Default::default() };
            } else {
                format.fmt.pix =
                    v4l2_pix_format { width, height, pixelformat, field: PROGRESSIVE, ..Default::default() };
            }
        }
        // SAFETY: this is the structure of both requests.
        unsafe { ioctl(&self.device.handle(), request, &mut format)? };
        let (fourcc, size, stride, quantization) = if multi_planar {
            // SAFETY: with this type the kernel sets this member, and every value is valid. A packed structure may not
            // be borrowed.
            let pix = unsafe { format.fmt.pix_mp };
            let stride = pix.plane_fmt[0].bytesperline;
            (pix.pixelformat, [pix.width, pix.height], stride, u32::from(pix.quantization))
        } else {
            // SAFETY: as above.
            let pix = unsafe { format.fmt.pix };
            (pix.pixelformat, [pix.width, pix.height], pix.bytesperline, pix.quantization)
        };
        let full_range = match quantization {
            FULL_RANGE => Some(true),
            LIMITED_RANGE => Some(false),
            _ => None,
        };
        Ok(Format { fourcc: fourcc.to_le_bytes(), size, stride, full_range })
    }

    /// The frame interval in force, or sets one.
    fn frame_interval(&self, request: vidioc::_IOC_TYPE, wanted: Option<v4l2_fract>) -> io::Result<f64> {
        let mut parameters = v4l2_streamparm { type_: self.kind, ..Default::default() };
        if let Some(interval) = wanted {
            parameters.parm.capture = v4l2_captureparm { timeperframe: interval, ..Default::default() };
        }
        // SAFETY: this is the structure of both requests, without pointers.
        unsafe { ioctl(&self.device.handle(), request, &mut parameters)? };
        // SAFETY: with this type the kernel sets this member, and every value is valid.
        let v4l2_fract { numerator, denominator } = unsafe { parameters.parm.capture.timeperframe };
        Ok(f64::from(numerator) / f64::from(denominator))
    }
}

/// The interface for the device's pictures. Devices without pictures have none, which shows in their formats.
fn interface(device: &Device) -> io::Result<v4l2_buf_type> {
    let mut found = v4l2_capability::default();
    // SAFETY: this is the structure of the request, without pointers.
    unsafe { ioctl(&device.handle(), vidioc::VIDIOC_QUERYCAP, &mut found)? };
    let of_node = found.capabilities & V4L2_CAP_DEVICE_CAPS != 0;
    let able = if of_node { found.device_caps } else { found.capabilities };
    let multi_planar = able & V4L2_CAP_VIDEO_CAPTURE_MPLANE != 0 && able & V4L2_CAP_VIDEO_CAPTURE == 0;
    Ok(if multi_planar { MULTI_PLANAR } else { SINGLE_PLANAR })
}

/// Runs a call into the crate `v4l` and converts a panic into an error.
fn caught<T>(run: impl FnOnce() -> io::Result<T>) -> io::Result<T> {
    catch_unwind(AssertUnwindSafe(run))
        .unwrap_or_else(|_| Err(io::Error::other("an answer of the kernel that the crate v4l does not know")))
}

/// The crate queries all controls at once and panics on unknown control types.
fn query(device: &Device, id: u32) -> io::Result<v4l2_query_ext_ctrl> {
    let mut control_query = v4l2_query_ext_ctrl { id, ..Default::default() };
    // SAFETY: this is the structure of the request, without pointers.
    unsafe { ioctl(&device.handle(), vidioc::VIDIOC_QUERY_EXT_CTRL, &mut control_query)? };
    Ok(control_query)
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
        let mut formats = Vec::new();
        for index in 0..MAX_LIST {
            let mut format = v4l2_fmtdesc { index, type_: self.kind, ..Default::default() };
            // SAFETY: this is the structure of the request, without pointers.
            match unsafe { ioctl(&self.device.handle(), vidioc::VIDIOC_ENUM_FMT, &mut format) } {
                Ok(()) => formats.push(format.pixelformat.to_le_bytes()),
                Err(e) if super::controls::is_gone(&e) => return Err(e),
                // The list ends, or the device has none.
                Err(_) => break,
            }
        }
        Ok(formats)
    }

    fn sizes(&mut self, fourcc: [u8; 4]) -> io::Result<Vec<[u32; 2]>> {
        let sizes = caught(|| self.device.enum_framesizes(FourCC::new(&fourcc)))?;
        let largest = |size: FrameSizeEnum| match size {
            FrameSizeEnum::Discrete(d) => [d.width, d.height],
            FrameSizeEnum::Stepwise(s) => [s.max_width, s.max_height],
        };
        Ok(sizes.into_iter().take(MAX_LIST as usize).map(|s| largest(s.size)).collect())
    }

    fn set_format(&mut self, fourcc: [u8; 4], size: [u32; 2]) -> io::Result<Format> {
        self.format(vidioc::VIDIOC_S_FMT, Some((fourcc, size)))
    }

    fn intervals(&mut self, format: &Format) -> io::Result<Vec<f64>> {
        let [width, height] = format.size;
        // Drivers that cannot list intervals can still report the current one.
        let found = caught(|| self.device.enum_frameintervals(FourCC::new(&format.fourcc), width, height));
        let discrete = |interval: v4l::FrameInterval| match interval.interval {
            FrameIntervalEnum::Discrete(fraction) => Some(seconds(&fraction)),
            FrameIntervalEnum::Stepwise(_) => None,
        };
        Ok(found.unwrap_or_default().into_iter().take(MAX_LIST as usize).filter_map(discrete).collect())
    }

    fn interval(&mut self, wanted: Option<f64>) -> io::Result<Option<f64>> {
        const UNIT: u32 = 10_000_000;
        let interval = match wanted {
            Some(s) => {
                let numerator = (s * f64::from(UNIT)).round().clamp(1.0, 4e9) as u32;
                self.frame_interval(vidioc::VIDIOC_S_PARM, Some(v4l2_fract { numerator, denominator: UNIT }))
            }
            None => self.frame_interval(vidioc::VIDIOC_G_PARM, None),
        };
        match interval {
            Ok(interval) => Ok(Some(interval)),
            Err(e) if super::controls::is_gone(&e) => Err(e),
            // Many drivers do not report frame rates.
            Err(_) => Ok(None),
        }
    }

    fn start(&mut self, buffers: u32) -> io::Result<Format> {
        self.stop()?;
        self.stream = Some(Stream::start(self.device.handle(), self.kind, buffers.max(2), self.starts)?);
        // Buffers fix the format.
        self.format(vidioc::VIDIOC_G_FMT, None)
    }

    fn stop(&mut self) -> io::Result<()> {
        self.stream = None;
        Ok(())
    }

    fn dequeue(&mut self, timeout: Duration) -> io::Result<Option<Buffer<'_>>> {
        self.stream.as_mut().ok_or_else(|| io::Error::other("no stream"))?.dequeue(timeout)
    }
}

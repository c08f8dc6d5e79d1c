//! The V4L2 camera driver, on any [`Node`].

use super::controls::{self, Ranges, is_gone};
use super::node::{Buffer, Format, Node};
use super::open::{INTERVAL_S, Opened, picture};
use super::pixels::Picture;
use super::sequence::{Counter, TimeRule};
use super::settings::Settings;
use crate::camera::without_shutter;
use crate::{Camera, CameraInfo, Class, Clock, Controls, DeviceError, DeviceResult, Frame, Freshness, Stamp};
use async_trait::async_trait;
use rustix::io::Errno;
use std::io;
use std::sync::Arc;
use std::time::Duration;

/// Longest single wait in the kernel.
const SLICE: Duration = Duration::from_millis(200);
/// The same for frames that are timed by their arrival: the error of their time is at most two slices.
const ARRIVAL_SLICE: Duration = Duration::from_millis(2);
/// Maximum time for a frame, in exposures; [`SLACK`] is added.
const PATIENCE: u32 = 3;
const SLACK: Duration = Duration::from_secs(1);

/// Resets the camera as if it were unplugged, where that is possible; `Err` gives the reason otherwise.
pub type Reset = Box<dyn FnMut() -> Result<(), String> + Send>;

/// A camera of V4L2.
pub struct V4l2Camera {
    node: Box<dyn Node>,
    clock: Arc<dyn Clock>,
    reset: Reset,
    settings: Settings,
    info: CameraInfo,
    picture: Picture,
    ranges: Ranges,
    interval: Duration,
    exposure: Duration,
    counter: Counter,
    streaming: bool,
}

impl V4l2Camera {
    /// Prepares a camera: sets its format and disables automatic functions. `id` is its stable identity.
    ///
    /// # Errors
    /// `Setup` if the device is not a usable camera; `Lost` if it is gone.
    pub fn open(
        mut node: Box<dyn Node>,
        id: &str,
        settings: Settings,
        clock: Arc<dyn Clock>,
        reset: Reset,
    ) -> DeviceResult<Self> {
        let opened = Opened::new(node.as_mut(), id, &settings)?;
        Ok(Self {
            node,
            clock,
            reset,
            info: opened.info(id, &settings),
            picture: opened.picture,
            ranges: opened.ranges,
            interval: Duration::from_secs_f64(opened.interval_s.unwrap_or(INTERVAL_S)),
            exposure: opened.exposure,
            counter: Counter::default(),
            streaming: false,
            settings,
        })
    }

    fn start(&mut self) -> DeviceResult<()> {
        if !self.streaming {
            let begun = self.clock.now();
            let started = self.node.start(self.settings.buffers);
            let format = started.map_err(|e| failure(&self.info.id, "start its stream", "a stream", &e))?;
            self.counter.restart(begun);
            self.streaming = true;
            self.adopt(&format)?;
        }
        Ok(())
    }

    /// Adopts the padding of rows in force. Another program may have changed the format since the camera was opened.
    fn adopt(&mut self, format: &Format) -> DeviceResult<()> {
        let Picture { format: wanted, width, height, .. } = self.picture;
        let found = picture(wanted, format);
        if format.fourcc == wanted.fourcc && [found.width, found.height] == [width, height] && found.check().is_ok() {
            self.picture = found;
            return Ok(());
        }
        self.stop();
        let expected = format!("{} of {width} × {height}", wanted.name());
        let fourcc = String::from_utf8_lossy(&format.fourcc);
        let name = fourcc.trim_end();
        let got = format!("{name} of {} × {} in rows of {} bytes", found.width, found.height, format.stride);
        // Opening the camera again sets the format.
        Err(DeviceError::new(&self.info.id, "start its stream", expected, got)
            .remedy("another program changed the camera's format: close it")
            .class(Class::Lost))
    }

    fn stop(&mut self) {
        if self.streaming {
            // A stream that cannot be stopped belongs to a device that is gone; the next command reports it.
            let _ = self.node.stop();
            self.streaming = false;
        }
    }

    /// Error of a failed stream. An unplugged device fails in several ways before it disappears, so every failure
    /// counts as a lost link: reconnecting does no harm.
    fn broken(&mut self, e: &io::Error) -> DeviceError {
        self.stop();
        failure(&self.info.id, "take a frame", "a frame", e).class(Class::Lost)
    }

    /// Error for a camera whose next frame is overdue.
    fn hangs(&mut self, waited: Duration) -> DeviceError {
        self.stop();
        let got = format!("none within {:.1} s", waited.as_secs_f64());
        let error = |then: String| DeviceError::new(&self.info.id, "take a frame", "a frame", format!("{got}; {then}"));
        match (self.reset)() {
            Ok(()) => error("it was reset over USB".into())
                .remedy("if it hangs again, connect it to a socket of its own, without a hub")
                .class(Class::Lost),
            Err(why) => error(format!("it cannot be reset: {why}"))
                .remedy("unplug the camera and plug it in again, then resume the session")
                .class(Class::Retry),
        }
    }

    /// The next frame that is newer than the last; `None` if it has not arrived.
    fn poll(&mut self, fresh: Freshness) -> DeviceResult<Option<Frame>> {
        let rule = TimeRule {
            meaning: self.settings.timestamps,
            duration: self.exposure.saturating_add(Duration::from_secs_f64(self.info.readout_s)),
            latency: Duration::try_from_secs_f64(self.settings.latency_ms / 1e3).unwrap_or_default(),
        };
        let asked = self.clock.now();
        let polled = match self.node.dequeue(if self.counter.by_arrival() { ARRIVAL_SLICE } else { SLICE }) {
            Ok(Some(buffer)) => {
                let stamp = self.counter.stamp(&buffer, &rule, self.clock.now());
                Ok(stamp.map(|stamp| frame(&self.picture, &buffer, stamp, fresh)))
            }
            Ok(None) => {
                self.counter.empty(asked);
                Ok(None)
            }
            Err(e) if e.kind() == io::ErrorKind::Interrupted => Ok(None),
            Err(e) => Err(e),
        };
        polled.map_err(|e| self.broken(&e))
    }

    fn set(&mut self, exposure: Duration, gain: f64) -> io::Result<(Duration, f64)> {
        let exposure = match self.ranges.exposure {
            // An exposure set by other means remains in force.
            _ if self.settings.exposure_ms.is_some() => self.exposure,
            Some(control) => control.set(self.node.as_mut(), exposure)?,
            None => self.exposure,
        };
        Ok((exposure, controls::amplify(self.node.as_mut(), &self.ranges, self.settings.gain, gain)?))
    }
}

impl Drop for V4l2Camera {
    fn drop(&mut self) {
        self.stop();
    }
}

#[async_trait]
impl Camera for V4l2Camera {
    fn describe(&self) -> CameraInfo {
        self.info.clone()
    }

    async fn configure(&mut self, exposure: Duration, gain: f64) -> DeviceResult<Controls> {
        let set = self.set(exposure, gain);
        let (exposure, gain) = set.map_err(|e| refused(&self.info.id, &e))?;
        self.exposure = exposure;
        Ok(Controls { exposure, gain, set_at: self.clock.now() })
    }

    async fn cover(&mut self, closed: bool) -> DeviceResult<Duration> {
        without_shutter(&self.info.id, closed, self.clock.now())
    }

    async fn next_frame(&mut self, fresh: Freshness) -> DeviceResult<Frame> {
        self.start()?;
        let begun = self.clock.now();
        let patience = PATIENCE * (self.exposure.max(self.interval) + self.interval) + SLACK;
        loop {
            if let Some(frame) = self.poll(fresh)? {
                return Ok(frame);
            }
            let waited = self.clock.now().saturating_sub(begun);
            if waited > patience {
                return Err(self.hangs(waited));
            }
        }
    }
}

fn frame(picture: &Picture, buffer: &Buffer<'_>, stamp: Stamp, fresh: Freshness) -> Frame {
    let Picture { width, height, .. } = *picture;
    let nothing = Frame { stamp, width, height, damaged: buffer.error, codes: Vec::new() };
    if !fresh.accepts(stamp) {
        return nothing;
    }
    let unpacked = if buffer.error { None } else { picture.unpack(buffer.bytes).ok() };
    match unpacked {
        Some(codes) => Frame { codes, ..nothing },
        None => Frame { damaged: true, codes: vec![0; width * height], ..nothing },
    }
}

/// Kernel error of a control, whose codes differ in meaning from those of opening.
fn refused(id: &str, e: &io::Error) -> DeviceError {
    let error = failure(id, "set exposure and gain", "both set", e);
    match e.raw_os_error().map(Errno::from_raw_os_error) {
        Some(Errno::BUSY) => error.remedy("the camera was not ready: try again").class(Class::Retry),
        Some(Errno::ACCESS) => error.remedy(
            "the camera holds this control itself: switch its automatic off (`v4l2-ctl -L` lists the controls), or give \
             exposure_ms as it is",
        ),
        _ => error,
    }
}

/// Device error for a kernel error, with its meaning.
pub(super) fn failure(id: &str, command: &str, expected: &str, e: &io::Error) -> DeviceError {
    let error = DeviceError::new(id, command, expected, e.to_string());
    let code = e.raw_os_error().map(Errno::from_raw_os_error);
    if is_gone(e) {
        return error.remedy("check the camera's cable and plug it in again").class(Class::Lost);
    }
    match code {
        Some(Errno::BUSY) => error
            .remedy("another program uses the camera: close it (`fuser -v /dev/video*` names it)")
            .class(Class::Setup),
        Some(Errno::ACCESS | Errno::PERM) => error
            .remedy("let this user use cameras: `sudo usermod -aG video $USER`, then log in again")
            .class(Class::Setup),
        Some(Errno::NOENT) => error
            .remedy("plug the camera in and give one of the names in /dev/v4l/by-id as `device`")
            .class(Class::Setup),
        Some(Errno::NOMEM) => error.remedy("set fewer `buffers` or a smaller `size`").class(Class::Setup),
        Some(Errno::NOSPC) => error
            .remedy(
                "the USB bus is full: connect the camera to a socket of its own, or set a smaller size or lower fps",
            )
            .class(Class::Setup),
        Some(Errno::INVAL | Errno::NOTTY) => {
            error.remedy("the camera cannot do this: choose another format or camera").class(Class::Setup)
        }
        // A USB camera may be too busy for a command.
        _ => error.remedy("plug the camera out and in again if this comes back").class(Class::Retry),
    }
}

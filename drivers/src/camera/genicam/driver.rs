//! The GenICam camera driver, on any [`Node`].

use super::faults;
use super::node::{Buffer, Node};
use super::open::Opened;
use super::settings::{GainUnit, Settings, Timestamps, Trigger};
use super::stamps::{Counter, DeviceClock};
use crate::camera::pfnc::Picture;
use crate::camera::without_shutter;
use crate::{Camera, CameraInfo, Clock, Controls, DeviceError, DeviceResult, Frame, Freshness, Stamp};
use async_trait::async_trait;
use std::sync::Arc;
use std::time::Duration;

/// Longest single wait in the library.
const SLICE: Duration = Duration::from_millis(200);
/// Maximum time for a frame, in exposures; [`SLACK`] is added.
const PATIENCE: u32 = 3;
const SLACK: Duration = Duration::from_secs(1);

/// A GenICam camera.
pub struct GenicamCamera {
    node: Box<dyn Node>,
    clock: Arc<dyn Clock>,
    settings: Settings,
    info: CameraInfo,
    picture: Picture,
    format: u32,
    gain: (GainUnit, f64),
    has_gain: bool,
    interval: Duration,
    exposure: Duration,
    packet_size: Option<u32>,
    counter: Counter,
    device_clock: DeviceClock,
    streaming: bool,
}

/// Result of waiting for a frame.
enum Polled {
    Frame(Frame),
    /// No frame yet, or a stale one that is incomplete or older than the trigger.
    Nothing,
    /// A frame that the camera exposed for a shorter time than after the trigger: it needs another trigger.
    Premature,
}

impl GenicamCamera {
    /// Prepares a camera: sets format and region and disables automatic functions.
    ///
    /// # Errors
    /// `Setup` if the camera is not usable as configured; `Lost` if it is gone.
    pub fn open(mut node: Box<dyn Node>, settings: Settings, clock: Arc<dyn Clock>) -> DeviceResult<Self> {
        let opened = Opened::new(node.as_mut(), &settings)?;
        Ok(Self {
            node,
            clock,
            info: opened.info(&settings),
            picture: opened.picture,
            format: opened.format,
            gain: opened.gain_unit(&settings),
            has_gain: opened.gains.is_some(),
            interval: opened.interval,
            exposure: opened.exposure,
            packet_size: opened.packet_size,
            counter: Counter::default(),
            device_clock: DeviceClock::default(),
            streaming: false,
            settings,
        })
    }

    fn start(&mut self) -> DeviceResult<()> {
        if !self.streaming {
            let started = self.node.start(self.settings.buffers);
            started.map_err(|e| faults::command(&self.info.id, "start its stream", "a stream", &e))?;
            self.counter.restart(self.clock.now());
            self.device_clock = DeviceClock::default();
            self.streaming = true;
        }
        Ok(())
    }

    fn stop(&mut self) {
        if self.streaming {
            self.node.stop();
            self.streaming = false;
        }
    }

    /// Error for a camera whose next frame is overdue. The stream is stopped, so that a late frame of an old trigger is
    /// not taken for that of the next.
    fn hangs(&mut self, waited: Duration) -> DeviceError {
        let (packets, answers) = (self.node.packets(), self.node.answers());
        self.stop();
        faults::silent(&self.info.id, waited.as_secs_f64(), answers, packets, self.packet_size)
    }

    /// Waits for the next frame. `triggered` is the time of the trigger that started its exposure.
    fn poll(&mut self, fresh: Freshness, triggered: Option<Duration>) -> DeviceResult<Polled> {
        let Some(buffer) = self.node.dequeue(SLICE) else { return Ok(Polled::Nothing) };
        let sequence = self.counter.number(buffer.frame_id);
        let from_camera = match self.settings.timestamps {
            Timestamps::Camera => self.device_clock.time(buffer.device_ns, buffer.arrival),
            Timestamps::Arrival => buffer.arrival,
        };
        let readout = Duration::from_secs_f64(self.info.readout_s);
        let timestamp = match triggered {
            Some(at) if buffer.arrival < at => return Ok(Polled::Nothing),
            Some(at) if buffer.arrival < at + self.exposure => return Ok(Polled::Premature),
            Some(at) => (at + self.exposure + readout).min(self.clock.now()),
            None => from_camera,
        };
        let stamp = Stamp { sequence, timestamp };
        if let Some(defect) = faults::defect(buffer.status) {
            if !fresh.accepts(stamp) {
                return Ok(Polled::Nothing);
            }
            let packets = self.node.packets();
            return Err(faults::incomplete(&self.info.id, defect, packets, self.packet_size));
        }
        if buffer.format != self.format {
            let got = format!("{:#010X}", buffer.format);
            let expected = format!("a frame in the format {:#010X}", self.format);
            return Err(DeviceError::new(&self.info.id, "take a frame", expected, got)
                .remedy("another program changed the camera's format: end it, then resume the session"));
        }
        match frame(&self.picture, &buffer, stamp, fresh) {
            Ok(frame) => Ok(Polled::Frame(frame)),
            Err(short) => {
                let (defect, packets) = (format!("a frame with {short}"), self.node.packets());
                Err(faults::incomplete(&self.info.id, &defect, packets, self.packet_size))
            }
        }
    }

    fn trigger(&mut self) -> DeviceResult<Option<Duration>> {
        if self.settings.trigger == Trigger::Free {
            return Ok(None);
        }
        let before = self.clock.now();
        let triggered = self.node.trigger();
        triggered.map_err(|e| faults::command(&self.info.id, "trigger an exposure", "an exposure", &e))?;
        Ok(Some(before))
    }
}

impl Drop for GenicamCamera {
    fn drop(&mut self) {
        self.stop();
    }
}

#[async_trait]
impl Camera for GenicamCamera {
    fn describe(&self) -> CameraInfo {
        self.info.clone()
    }

    async fn configure(&mut self, exposure: Duration, gain: f64) -> DeviceResult<Controls> {
        let (unit, low) = self.gain;
        let failed = |e| faults::command(&self.info.id, "set exposure and gain", "both set", &e);
        let exposure = self.node.exposure(Some(exposure)).map_err(failed)?;
        let gain = match self.has_gain {
            true => unit.linear(self.node.gain(Some(unit.value(gain, low))).map_err(failed)?, low),
            false => 1.0,
        };
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
        let mut triggered = self.trigger()?;
        loop {
            match self.poll(fresh, triggered)? {
                Polled::Frame(frame) => return Ok(frame),
                Polled::Premature => triggered = self.trigger()?,
                Polled::Nothing => {}
            }
            let waited = self.clock.now().saturating_sub(begun);
            if waited > patience {
                return Err(self.hangs(waited));
            }
        }
    }
}

/// Converts a complete frame. The engine compares its size with the announced one.
fn frame(picture: &Picture, buffer: &Buffer<'_>, stamp: Stamp, fresh: Freshness) -> Result<Frame, String> {
    let (width, height) = (buffer.width, buffer.height);
    let codes = match fresh.accepts(stamp) {
        true => Picture { width, height, padding: buffer.padding, ..*picture }.unpack(buffer.bytes)?,
        false => Vec::new(),
    };
    Ok(Frame { stamp, width, height, damaged: false, codes })
}

//! Cameras behind a device server (ASCOM Alpaca, INDI): a command starts each exposure, and the picture is fetched
//! after its end.
//!
//! A frame cannot be older than its command. A picture that arrives before the exposure can have ended belongs to an
//! earlier command and is not used.

#[cfg(test)]
mod tests;

use super::without_shutter;
use crate::{Camera, CameraInfo, Class, Clock, Controls, DeviceError, DeviceResult, Frame, Freshness, Stamp};
use async_trait::async_trait;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use std::time::Duration;

/// Interval of queries for the picture.
const POLL: Duration = Duration::from_millis(20);
/// Share of the exposure after which a picture may arrive: timers of cameras differ from that of the computer.
const EARLIEST: f64 = 0.9;
/// Largest accepted relative difference between the requested exposure and that stated with a picture, and absolute one
/// in s.
const EXPOSURE_TOLERANCE: [f64; 2] = [0.02, 1e-3];
/// Number of pictures of earlier commands that are passed over.
const MAX_EARLIER: u32 = 3;

/// Unit of a gain control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GainUnit {
    /// The camera stays at its lowest gain, which counts as 1.
    #[default]
    Lowest,
    /// Decibels: 20 dB are a factor of 10.
    Decibel,
    /// Tenths of a decibel, as with many cameras for astronomy: 200 are a factor of 10.
    TenthDecibel,
    /// The factor itself.
    Factor,
}

impl GainUnit {
    /// Factor of a value of the control relative to its lowest one.
    pub fn linear(self, value: f64, low: f64) -> f64 {
        match self {
            // Not 1 if the camera did not accept its lowest gain.
            Self::Lowest => 1.0 + (value - low).abs(),
            Self::Decibel => 10f64.powf((value - low) / 20.0),
            Self::TenthDecibel => 10f64.powf((value - low) / 200.0),
            Self::Factor => value / low,
        }
    }

    /// Value of the control for a factor.
    pub fn value(self, linear: f64, low: f64) -> f64 {
        match self {
            Self::Lowest => low,
            Self::Decibel => low + 20.0 * linear.log10(),
            Self::TenthDecibel => low + 200.0 * linear.log10(),
            Self::Factor => low * linear,
        }
    }

    /// Range of the factor for a range of the control; a control whose lowest factor is not positive stays there.
    pub fn range(self, control: Option<[f64; 2]>) -> [f64; 2] {
        match (self, control) {
            (Self::Factor, Some([low, _])) if low <= 0.0 => [1.0, 1.0],
            (Self::Decibel | Self::TenthDecibel | Self::Factor, Some([low, high])) if high > low => {
                [1.0, self.linear(high, low)]
            }
            _ => [1.0, 1.0],
        }
    }
}

/// Properties of a camera that has been set up.
#[derive(Clone, Debug)]
pub(crate) struct Facts {
    /// Stable identity.
    pub id: String,
    /// Width of the pictures in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Shortest and longest exposure in s.
    pub exposure_s: [f64; 2],
    /// Exposures are multiples of this in s; 0 if the step is unknown.
    pub exposure_step_s: f64,
    /// Range of the gain control in its own unit, if there is one.
    pub gains: Option<[f64; 2]>,
    /// Unit of the gain control.
    pub gain_unit: GainUnit,
    /// Code of black.
    pub black: u16,
    /// Code of a saturated pixel.
    pub white: u16,
    /// Whether the camera takes dark frames.
    pub shutter: bool,
    /// Exposures that suit the display.
    pub steady_exposures_s: Vec<f64>,
    /// Maximum time between the end of an exposure and its picture.
    pub download: Duration,
    /// Warnings for the user.
    pub warnings: Vec<String>,
}

/// A picture.
pub(crate) struct Picture {
    pub width: usize,
    pub height: usize,
    /// Codes, row by row, the top row first.
    pub codes: Vec<u16>,
    /// Exposure in s, as stated with the picture.
    pub exposure_s: Option<f64>,
}

/// A camera that exposes at a command. Each call ends within the time for an answer.
pub(crate) trait Exposer: Send {
    /// Properties after set-up.
    fn facts(&self) -> &Facts;
    /// Sets the gain in the control's unit; returns the value in force.
    fn set_gain(&mut self, value: f64) -> DeviceResult<f64>;
    /// Starts an exposure; `dark` keeps the shutter closed.
    fn start(&mut self, exposure_s: f64, dark: bool) -> DeviceResult<()>;
    /// Whether the picture can be fetched; waits at most `limit`.
    fn is_ready(&mut self, limit: Duration) -> DeviceResult<bool>;
    /// Fetches the picture.
    fn fetch(&mut self) -> DeviceResult<Picture>;
    /// Ends a running exposure, if the camera can, and discards its picture.
    fn abort(&mut self) -> DeviceResult<()>;
}

/// A camera on an [`Exposer`].
pub(crate) struct CommandedCamera<E: Exposer> {
    exposer: E,
    clock: Arc<dyn Clock>,
    exposure_s: f64,
    /// Gain in force in the control's unit.
    gain: Option<f64>,
    covered: bool,
    sequence: u64,
    set_at: Duration,
    /// The camera may be exposing for an earlier command, perhaps of another program.
    unfinished: bool,
    /// An exposure of this driver may be running.
    running: bool,
}

impl<E: Exposer> CommandedCamera<E> {
    pub fn new(exposer: E, clock: Arc<dyn Clock>) -> Self {
        let [low, high] = exposer.facts().exposure_s;
        // Sequence numbers exceed those of an earlier process, because time in ms grows faster than frames.
        let sequence = u64::try_from(clock.now().as_millis()).unwrap_or(u64::MAX / 2);
        Self {
            exposer,
            clock,
            exposure_s: 0.1_f64.clamp(low, high.max(low)),
            gain: None,
            covered: false,
            sequence,
            set_at: Duration::ZERO,
            unfinished: true,
            running: false,
        }
    }

    fn id(&self) -> &str {
        &self.exposer.facts().id
    }

    fn error(&self, expected: impl Into<Box<str>>, got: impl Into<Box<str>>) -> DeviceError {
        DeviceError::new(self.id(), "take a frame", expected, got)
    }

    fn next_stamp(&mut self, timestamp: Duration) -> Stamp {
        self.sequence = self.sequence.saturating_add(1);
        Stamp { sequence: self.sequence, timestamp }
    }

    /// Exposes and fetches a picture; returns it with the time of the command.
    fn expose(&mut self) -> DeviceResult<(Picture, Duration)> {
        if self.unfinished {
            self.exposer.abort()?;
        }
        for _ in 0..MAX_EARLIER {
            let begun = self.clock.now();
            (self.unfinished, self.running) = (true, true);
            self.exposer.start(self.exposure_s, self.covered)?;
            self.wait(begun)?;
            let early = self.clock.now() < begun + Duration::from_secs_f64(EARLIEST * self.exposure_s);
            let picture = self.exposer.fetch()?;
            if early {
                self.exposer.abort()?;
                continue;
            }
            (self.unfinished, self.running) = (false, false);
            self.check(&picture)?;
            return Ok((picture, begun));
        }
        Err(self
            .error(format!("a picture after {} s", self.exposure_s), "pictures that arrive earlier")
            .remedy("end other programs that use the camera, then resume the session")
            .class(Class::Retry))
    }

    /// Waits for the picture of an exposure that began at `begun`.
    fn wait(&mut self, begun: Duration) -> DeviceResult<()> {
        self.clock.wait(Duration::from_secs_f64(EARLIEST * self.exposure_s));
        let limit = Duration::from_secs_f64(self.exposure_s) + self.exposer.facts().download;
        while !self.exposer.is_ready(POLL)? {
            let waited = self.clock.now().saturating_sub(begun);
            if waited > limit {
                return Err(self
                    .error("a picture", format!("none within {:.1} s", waited.as_secs_f64()))
                    .remedy("check the camera in the program of its server; slow cameras need a larger download_s")
                    .class(Class::Retry));
            }
        }
        Ok(())
    }

    fn check(&self, picture: &Picture) -> DeviceResult<()> {
        let [relative, absolute] = EXPOSURE_TOLERANCE;
        let other = |s: &f64| (s - self.exposure_s).abs() > relative * self.exposure_s + absolute;
        if let Some(exposure_s) = picture.exposure_s.filter(other) {
            return Err(self
                .error(format!("a picture of {} s", self.exposure_s), format!("one of {exposure_s} s"))
                .remedy("end other programs that use the camera, then resume the session")
                .class(Class::Retry));
        }
        Ok(())
    }
}

#[async_trait]
impl<E: Exposer> Camera for CommandedCamera<E> {
    fn describe(&self) -> CameraInfo {
        let facts = self.exposer.facts();
        CameraInfo {
            id: facts.id.clone(),
            width: facts.width,
            height: facts.height,
            exposure_s: facts.exposure_s,
            exposure_now_s: self.exposure_s,
            gain: facts.gain_unit.range(facts.gains),
            black: facts.black,
            white: facts.white,
            // The exposure begins after the command, so its readout does not matter.
            readout_s: 0.0,
            control_lag_frames: 0,
            shutter: facts.shutter,
            full_scale_e: None,
            read_noise_e: None,
            exposure_choices_s: vec![],
            by_hand: false,
            steady_exposures_s: facts.steady_exposures_s.clone(),
            warnings: facts.warnings.clone(),
        }
    }

    async fn configure(&mut self, exposure: Duration, gain: f64) -> DeviceResult<Controls> {
        let Facts { exposure_s: [low, high], exposure_step_s: step, gains, gain_unit, .. } = *self.exposer.facts();
        let wanted = exposure.as_secs_f64().clamp(low, high.max(low));
        let stepped = if step > 0.0 { (wanted / step).round() * step } else { wanted };
        self.exposure_s = if stepped >= low && stepped <= high { stepped } else { wanted };
        let gain = match gains {
            Some([lowest, highest]) => {
                let value = gain_unit.value(gain.max(1e-9), lowest).clamp(lowest, highest.max(lowest)).round();
                if self.gain != Some(value) {
                    self.gain = None;
                    self.gain = Some(self.exposer.set_gain(value)?);
                }
                gain_unit.linear(self.gain.unwrap_or(value), lowest)
            }
            None => 1.0,
        };
        self.set_at = self.clock.now();
        Ok(Controls { exposure: Duration::from_secs_f64(self.exposure_s), gain, set_at: self.set_at })
    }

    async fn cover(&mut self, closed: bool) -> DeviceResult<Duration> {
        if !self.exposer.facts().shutter {
            return without_shutter(self.id(), closed, self.clock.now());
        }
        self.covered = closed;
        Ok(self.clock.now())
    }

    async fn next_frame(&mut self, fresh: Freshness) -> DeviceResult<Frame> {
        let Facts { width, height, .. } = *self.exposer.facts();
        // No picture is in a queue, so that none has to be waited for after a change of the controls.
        if fresh.steady_since == Duration::MAX {
            let now = self.clock.now().max(self.set_at + Duration::from_nanos(1));
            let stamp = self.next_stamp(now);
            return Ok(Frame { stamp, width, height, damaged: false, codes: vec![] });
        }
        let (picture, begun) = self.expose()?;
        // The exposure began after the command.
        let stamp = self.next_stamp(begun + Duration::from_secs_f64(self.exposure_s));
        Ok(Frame { stamp, width: picture.width, height: picture.height, damaged: false, codes: picture.codes })
    }
}

impl<E: Exposer> Drop for CommandedCamera<E> {
    fn drop(&mut self) {
        if self.running {
            // On drop there is no caller to receive the error.
            let _ = self.exposer.abort();
        }
    }
}

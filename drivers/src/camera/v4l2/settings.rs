//! What a bench's configuration says about a V4L2 camera.

use super::pixels::{FORMATS, Layout, PixelFormat};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A camera of the kernel's V4L2: USB cameras, frame grabbers, camera modules.
///
/// Set exposure, gain and everything else by hand: the driver switches off all that the camera would do by itself.
/// Choose a raw format where there is one. Cameras that process their pictures are not linear, even in grey.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// The device, by a name that stays: `/dev/v4l/by-id/…` for this camera, `/dev/v4l/by-path/…` for this socket. The
    /// number in `/dev/video0` may be another one when the camera is plugged in again, or reset because it hangs.
    pub device: String,
    /// Name of the pixel format, as `v4l2-ctl --list-formats` shows it; without one, the most linear that is offered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<String>,
    /// Pixels per row, and rows; without it, the largest that is offered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<[u32; 2]>,
    /// Frames per second. Most cameras cannot expose for longer than a frame lasts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fps: Option<f64>,
    /// Frames until changed controls act, as `nacre init` measures it.
    #[serde(default = "control_lag_frames")]
    pub control_lag_frames: u32,
    /// How often the panel refreshes, in Hz: exposures are best multiples of its period.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub panel_refresh_hz: Option<f64>,
    /// Code of no light; without it, 16 where luma has a foot, else 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub black: Option<u16>,
    /// Code of a saturated pixel; needed where a camera fills a format only in part, as 10 bits in Y16.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub white: Option<u16>,
    /// Time from the end of the first row's exposure to that of the last, and the transfer; without it, the time from frame to frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub readout_ms: Option<f64>,
    /// How much later than the end of readout a frame's timestamp may be, in ms: the time that a camera works on a picture before
    /// sending it. Cameras with a picture processor or MJPEG buffer one or two frames.
    #[serde(default)]
    pub latency_ms: f64,
    /// The exposure of a camera that has no control for it, in ms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure_ms: Option<f64>,
    /// What the values of the gain control mean.
    #[serde(default)]
    pub gain: GainScale,
    /// What the kernel's timestamps mean.
    #[serde(default)]
    pub timestamps: Timestamps,
    /// Frames that the kernel may queue.
    #[serde(default = "buffers")]
    pub buffers: u32,
}

/// What the values of the gain control mean. No standard says; 1 is always the lowest gain that the camera has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GainScale {
    /// Not known: the camera stays at its lowest gain.
    #[default]
    Lowest,
    /// Gain is proportional to the value, where this is the value of gain 1.
    Unity(f64),
    /// Each step is this many dB above the lowest value.
    DbPerStep(f64),
}

/// What the kernel's timestamps mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Timestamps {
    /// What the driver says; without a word, the end of readout.
    #[default]
    Auto,
    /// The start of exposure.
    StartOfExposure,
    /// The end of readout.
    EndOfReadout,
}

fn control_lag_frames() -> u32 {
    2
}

fn buffers() -> u32 {
    4
}

impl GainScale {
    /// Linear gain of a control's value; `low` is the control's lowest.
    pub fn linear(self, value: i64, low: i64) -> f64 {
        match self {
            Self::Lowest => 1.0,
            Self::Unity(one) => value as f64 / one,
            Self::DbPerStep(db) => 10f64.powf(value.saturating_sub(low) as f64 * db / 20.0),
        }
    }

    /// The control's value, not rounded, for a linear gain.
    pub fn value(self, gain: f64, low: i64) -> f64 {
        match self {
            Self::Lowest => low as f64,
            Self::Unity(one) => gain * one,
            Self::DbPerStep(db) => low as f64 + 20.0 * gain.log10() / db,
        }
    }
}

impl Settings {
    /// A camera with everything else as by default.
    pub fn new(device: &str) -> Self {
        Self {
            device: device.to_owned(),
            format: None,
            size: None,
            fps: None,
            control_lag_frames: control_lag_frames(),
            panel_refresh_hz: None,
            black: None,
            white: None,
            readout_ms: None,
            latency_ms: 0.0,
            exposure_ms: None,
            gain: GainScale::default(),
            timestamps: Timestamps::default(),
            buffers: buffers(),
        }
    }

    /// Says what is wrong with them.
    ///
    /// # Errors
    /// The key and what it must be.
    pub fn check(&self) -> Result<(), String> {
        let within = |key: &str, value: Option<f64>, low: f64, high: f64| match value {
            Some(v) if !(v >= low && v <= high) => Err(format!("{key} is {v}; give {low} to {high}")),
            _ => Ok(()),
        };
        if !self.device.starts_with('/') || self.device.contains('\0') {
            return Err(format!("device is {:?}; give a path, such as /dev/v4l/by-id/…", self.device));
        }
        if let Some(name) = self.format.as_deref().filter(|n| PixelFormat::named(n).is_none()) {
            let known: Vec<String> = FORMATS.iter().map(PixelFormat::name).collect();
            return Err(format!("format is {name:?}; give one of {}", known.join(", ")));
        }
        if let (Some(black), Some(white)) = (self.black, self.white)
            && black >= white
        {
            return Err(format!("black is {black} and white is {white}; give a larger white"));
        }
        let gain = match self.gain {
            GainScale::Lowest => None,
            GainScale::Unity(v) | GainScale::DbPerStep(v) => Some(v),
        };
        within("fps", self.fps, 0.01, 2000.0)?;
        within("gain", gain, 1e-3, 1e6)?;
        within("control_lag_frames", Some(f64::from(self.control_lag_frames)), 0.0, 100.0)?;
        within("panel_refresh_hz", self.panel_refresh_hz, 1.0, 1000.0)?;
        within("readout_ms", self.readout_ms, 0.0, 60_000.0)?;
        within("latency_ms", Some(self.latency_ms), 0.0, 60_000.0)?;
        within("exposure_ms", self.exposure_ms, 1e-3, 3_600_000.0)?;
        within("buffers", Some(f64::from(self.buffers)), 2.0, 32.0)
    }

    /// What the user should know about this format.
    pub fn warning(format: PixelFormat) -> Option<String> {
        let name = format.name();
        match format.layout {
            Layout::Jpeg => Some(format!(
                "{name} is lossy: the camera has changed its codes in ways that cannot be undone; choose another format"
            )),
            Layout::LumaFirst | Layout::LumaSecond => {
                Some(format!("{name} is processed: its codes are hardly linear in the light; measure its linearity"))
            }
            _ => None,
        }
    }
}

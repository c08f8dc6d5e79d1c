//! Configuration of a V4L2 camera in a bench.

use super::formats::{FORMATS, Layout, PixelFormat};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A V4L2 camera: USB cameras, frame grabbers, camera modules.
///
/// Set exposure, gain and all other values manually: the driver disables the camera's automatic functions. Choose a raw
/// format if the camera has one. Cameras that process their pictures are not linear, even in grey.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Device path under a stable name: `/dev/v4l/by-id/…` for this camera, `/dev/v4l/by-path/…` for this socket. The
    /// number in `/dev/video0` may change when the camera is replugged or reset.
    pub device: String,
    /// Name of the pixel format, as shown by `v4l2-ctl --list-formats`; default: the most linear supported format.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<String>,
    /// Width and height in pixels; default: the largest supported size.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<[u32; 2]>,
    /// Frames per second. Most cameras limit the exposure to one frame period.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fps: Option<f64>,
    /// Frames until changed controls take effect, as measured by `nacre init`.
    #[serde(default = "control_lag_frames")]
    pub control_lag_frames: u32,
    /// Refresh rate of the display in Hz: exposures should be multiples of its period.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub panel_refresh_hz: Option<f64>,
    /// Code of black; default: 16 for luma with footroom, otherwise 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub black: Option<u16>,
    /// Code of a saturated pixel. Required if a camera does not use the full range of a format, such as 10 bits in Y16.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub white: Option<u16>,
    /// Time from the end of the first row's exposure to that of the last, plus the transfer, in ms; default: the frame
    /// interval.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub readout_ms: Option<f64>,
    /// Maximum delay of a frame's timestamp after the end of readout, in ms: the processing time of the camera. Cameras
    /// with an image processor or MJPEG buffer one or two frames.
    #[serde(default)]
    pub latency_ms: f64,
    /// Exposure in ms of a camera without exposure control.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure_ms: Option<f64>,
    /// Duration of one step of the camera's exposure control in µs; default: 100, as V4L2 defines it. Required if the
    /// camera has only the control `exposure`, whose unit no standard defines: sensors count lines.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure_unit_us: Option<f64>,
    /// Scale of the gain control's values.
    #[serde(default)]
    pub gain: GainScale,
    /// Meaning of the kernel's timestamps.
    #[serde(default)]
    pub timestamps: Timestamps,
    /// Number of frames that the kernel may queue.
    #[serde(default = "buffers")]
    pub buffers: u32,
}

/// Scale of the gain control's values, which no standard defines. Gain 1 is always the camera's lowest gain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GainScale {
    /// Unknown scale: the camera stays at its lowest gain.
    #[default]
    Lowest,
    /// Gain is proportional to the value; this is the value of gain 1.
    Unity(f64),
    /// Each step above the lowest value adds this many dB.
    DbPerStep(f64),
}

/// Meaning of the kernel's timestamps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Timestamps {
    /// As flagged by the driver; without a flag, the end of readout. A frame whose timestamp is zero, in the future, of
    /// another clock or not later than the last one is treated as with `arrival`.
    #[default]
    Auto,
    /// The start of exposure.
    StartOfExposure,
    /// The end of readout.
    EndOfReadout,
    /// Unusable. A frame's time is the last moment at which it had certainly not arrived.
    Arrival,
}

fn control_lag_frames() -> u32 {
    2
}

fn buffers() -> u32 {
    4
}

impl GainScale {
    /// Linear gain of a control value; `low` is the control's lowest value.
    pub fn linear(self, value: i64, low: i64) -> f64 {
        match self {
            Self::Lowest => 1.0,
            Self::Unity(one) => value as f64 / one,
            Self::DbPerStep(db) => 10f64.powf(value.saturating_sub(low) as f64 * db / 20.0),
        }
    }

    /// Control value of a linear gain, not rounded.
    pub fn value(self, gain: f64, low: i64) -> f64 {
        match self {
            Self::Lowest => low as f64,
            Self::Unity(one) => gain * one,
            Self::DbPerStep(db) => low as f64 + 20.0 * gain.log10() / db,
        }
    }
}

impl Settings {
    /// Default settings for a device.
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
            exposure_unit_us: None,
            gain: GainScale::default(),
            timestamps: Timestamps::default(),
            buffers: buffers(),
        }
    }

    /// Checks the settings.
    ///
    /// # Errors
    /// The invalid key and its valid values.
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
        within("exposure_unit_us", self.exposure_unit_us, 1e-3, 1e6)?;
        within("buffers", Some(f64::from(self.buffers)), 2.0, 32.0)
    }

    /// Warning about the limits of this format, if there are any.
    pub fn warning(format: PixelFormat) -> Option<String> {
        let name = format.name();
        match format.layout {
            Layout::Jpeg => Some(format!(
                "{name} is lossy: the camera has changed its codes in ways that cannot be undone; choose another format"
            )),
            Layout::LumaFirst | Layout::LumaSecond | Layout::LumaPlane => {
                Some(format!("{name} is processed: its codes are hardly linear in the light; measure its linearity"))
            }
            _ => None,
        }
    }
}

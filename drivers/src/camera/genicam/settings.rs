//! Configuration of a GenICam camera in a bench.

use super::node::Gains;
use crate::camera::pfnc::PixelFormat;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Longest accepted name of a camera.
const MAX_NAME: usize = 256;

/// A GenICam camera: GigE Vision or USB3 Vision, through the library aravis.
///
/// The driver disables automatic functions and sets exposure and gain. Polarization cameras deliver the mosaic of their
/// sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Identifier of the camera, as shown by `nacre devices`, or its network address.
    pub device: String,
    /// Name of the pixel format, such as `Mono12p`, `BayerRG12` or `PolarizeMono12`; default: the one with the most
    /// bits, raw before processed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub format: Option<String>,
    /// Region on the sensor in pixels: left, top, width, height; default: the whole sensor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub region: Option<[u32; 4]>,
    /// Frames per second; it limits the exposure to one frame period. Default: as set in the camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fps: Option<f64>,
    /// Frames until changed controls take effect, as measured by `nacre init`.
    #[serde(default = "control_lag_frames")]
    pub control_lag_frames: u32,
    /// Refresh rate of the display in Hz: exposures should be multiples of its period.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub panel_refresh_hz: Option<f64>,
    /// Code of black; default: 0.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub black: Option<u16>,
    /// Code of a saturated pixel. Required if a camera does not use the full range of a format, such as 12 bits in
    /// `Mono16`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub white: Option<u16>,
    /// Black level in the camera's unit (`BlackLevel`); default: as set in the camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub black_level: Option<f64>,
    /// Unit of the gain control.
    #[serde(default)]
    pub gain: GainUnit,
    /// Longest time in ms between the end of the exposure and the start of transmission; default: one frame period, or
    /// 0 with a software trigger.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub readout_ms: Option<f64>,
    /// Start of an exposure.
    #[serde(default)]
    pub trigger: Trigger,
    /// Source of the frames' times.
    #[serde(default)]
    pub timestamps: Timestamps,
    /// Size of network packets in bytes; default: the largest that arrives. Packets above 1500 bytes need jumbo frames
    /// on all network devices between camera and computer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub packet_size: Option<u32>,
    /// Number of frames that may be queued.
    #[serde(default = "buffers")]
    pub buffers: u32,
}

/// Unit of the gain control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum GainUnit {
    /// Decibels if the camera states this unit; otherwise the camera stays at its lowest gain.
    #[default]
    Auto,
    /// The camera stays at its lowest gain, which counts as 1.
    Lowest,
    /// Decibels: 20 dB are a factor of 10.
    Decibel,
    /// The factor itself.
    Factor,
}

/// Start of an exposure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Trigger {
    /// The camera runs freely.
    #[default]
    Free,
    /// A command to the camera starts each exposure.
    Software,
}

/// Source of the frames' times.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Timestamps {
    /// The camera's clock, converted to the computer's clock. Delays on the network have no effect.
    #[default]
    Camera,
    /// The arrival of the frame's first packet, for cameras whose clock is not usable.
    Arrival,
}

fn control_lag_frames() -> u32 {
    2
}

fn buffers() -> u32 {
    8
}

impl GainUnit {
    /// The unit of a control with this range.
    pub fn resolved(self, gains: Option<Gains>) -> Self {
        match (self, gains) {
            (_, None) => Self::Lowest,
            (Self::Auto, Some(gains)) if gains.decibel => Self::Decibel,
            (Self::Auto, _) => Self::Lowest,
            (unit, _) => unit,
        }
    }

    /// Linear gain of a control value; `low` is the control's lowest value.
    pub fn linear(self, value: f64, low: f64) -> f64 {
        match self {
            // The unit is unknown: the result only shows that the gain is not the lowest.
            Self::Auto | Self::Lowest => 1.0 + (value - low).abs(),
            Self::Decibel => 10f64.powf(value / 20.0),
            Self::Factor => value,
        }
    }

    /// Control value of a linear gain.
    pub fn value(self, gain: f64, low: f64) -> f64 {
        match self {
            Self::Auto | Self::Lowest => low,
            Self::Decibel => 20.0 * gain.log10(),
            Self::Factor => gain,
        }
    }

    /// Lowest and highest linear gain.
    pub fn range(self, gains: Option<Gains>) -> [f64; 2] {
        match (self.resolved(gains), gains) {
            (unit @ (Self::Decibel | Self::Factor), Some(gains)) => {
                // A gain of 0 is invalid, even if the camera's range includes it.
                [gains.low, gains.high].map(|value| unit.linear(value, gains.low).max(1e-3))
            }
            _ => [1.0, 1.0],
        }
    }
}

impl Settings {
    /// Default settings for a camera.
    pub fn new(device: &str) -> Self {
        Self {
            device: device.to_owned(),
            format: None,
            region: None,
            fps: None,
            control_lag_frames: control_lag_frames(),
            panel_refresh_hz: None,
            black: None,
            white: None,
            black_level: None,
            gain: GainUnit::default(),
            readout_ms: None,
            trigger: Trigger::default(),
            timestamps: Timestamps::default(),
            packet_size: None,
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
        if self.device.trim().is_empty() || self.device.len() > MAX_NAME || self.device.contains('\0') {
            return Err(format!("device is {:?}; give a camera's identifier, as in `nacre devices`", self.device));
        }
        if let Some(name) = self.format.as_deref().filter(|n| PixelFormat::named(n).is_none()) {
            return Err(format!(
                "format is {name:?}; give one of Mono, Bayer or Polarize, such as Mono12p or BayerRG12"
            ));
        }
        if let Some([_, _, width, height]) = self.region.filter(|[_, _, width, height]| *width == 0 || *height == 0) {
            return Err(format!("region has a size of {width} × {height}; give left, top, width, height"));
        }
        if let (Some(black), Some(white)) = (self.black, self.white)
            && black >= white
        {
            return Err(format!("black is {black} and white is {white}; give a larger white"));
        }
        within("fps", self.fps, 0.01, 2000.0)?;
        within("control_lag_frames", Some(f64::from(self.control_lag_frames)), 0.0, 100.0)?;
        within("panel_refresh_hz", self.panel_refresh_hz, 1.0, 1000.0)?;
        within("black_level", self.black_level, -65_535.0, 65_535.0)?;
        within("readout_ms", self.readout_ms, 0.0, 60_000.0)?;
        within("packet_size", self.packet_size.map(f64::from), 576.0, 16_384.0)?;
        for side in self.region.iter().flatten() {
            within("region", Some(f64::from(*side)), 0.0, 32_768.0)?;
        }
        within("buffers", Some(f64::from(self.buffers)), 2.0, 64.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_that_are_wrong_are_named() {
        let right = Settings::new("Aravis-Fake-GV01");
        assert_eq!(right.check(), Ok(()));
        for (wrong, key) in [
            (Settings::new(" "), "device"),
            (Settings { format: Some("RGB8".into()), ..right.clone() }, "format"),
            (Settings { region: Some([0, 0, 0, 5]), ..right.clone() }, "region"),
            (Settings { region: Some([u32::MAX; 4]), ..right.clone() }, "region"),
            (Settings { black: Some(9), white: Some(9), ..right.clone() }, "black"),
            (Settings { fps: Some(f64::NAN), ..right.clone() }, "fps"),
            (Settings { packet_size: Some(20), ..right.clone() }, "packet_size"),
            (Settings { buffers: 1, ..right.clone() }, "buffers"),
        ] {
            assert!(wrong.check().unwrap_err().contains(key), "{key}");
        }
        let text = serde_json::to_string(&right).unwrap();
        assert_eq!(serde_json::from_str::<Settings>(&text).unwrap(), right);
    }

    #[test]
    fn gains_are_linear_where_their_unit_is_known() {
        let gains = Some(Gains { low: 0.0, high: 20.0, decibel: true });
        assert_eq!(GainUnit::Auto.resolved(gains), GainUnit::Decibel);
        assert_eq!(GainUnit::Auto.range(gains), [1.0, 10.0]);
        let unknown = Some(Gains { low: 0.0, high: 511.0, decibel: false });
        assert_eq!(GainUnit::Auto.range(unknown), [1.0, 1.0]);
        assert_eq!(GainUnit::Factor.range(unknown), [1e-3, 511.0]);
        assert!((GainUnit::Decibel.value(10.0, 0.0) - 20.0).abs() < 1e-12);
        assert_eq!(GainUnit::Lowest.linear(3.0, 1.0), 3.0);
        assert_eq!(GainUnit::Decibel.range(None), [1.0, 1.0]);
    }
}

//! `frames.json`, the description of a set of photographs and the only input format of reconstructions. The capture
//! engine writes it into every session folder; `nacre import` creates it for other photographs.

mod calibration;
mod clipping;
pub mod hdr;
mod illumination;
mod layout;
mod linear;
mod load;
mod noise;
mod sensor;
pub mod stack;
mod stated;
mod tags;

pub use calibration::{
    AnalyserCalibration, CALIBRATION_FILE, Calibration, CalibrationSource, CameraCalibration, FlatCalibration,
    OrientationCalibration, RetarderCalibration,
};
pub use clipping::Clipping;
pub use illumination::Illumination;
pub use layout::{Bayer, Filters, Layout, Sensor};
pub use linear::{LinearFrame, Linearizer};
pub use load::{LoadedFrames, check, load, planned, save};
pub use noise::{ASSUMED, BELOW_WHITE_SIGMA, FrameNoise, NoiseModel, NoiseSource};
pub use sensor::{Mosaic, mosaic};
pub use tags::{Tagged, exposures};

use nacre_base::{Error, Result, Version};
use nacre_image::{Depth, Samples};
use nacre_optics::polarization::Material;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Name of the file that describes a folder of photographs.
pub const FILE_NAME: &str = "frames.json";

/// Name of the additional file in the folder of a capture session.
pub const SESSION_FILE: &str = "session.json";

/// A set of photographs, and the conversion of their values to light. Linear value = transfer⁻¹((v - black)/(white -
/// black)) / (exposure · gain).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FrameSet {
    /// Version of the format.
    #[serde(default)]
    pub version: Version<1>,
    /// Quantity varied between the photographs.
    pub kind: Kind,
    /// The photographs, in the order they were taken.
    pub frames: Vec<Frame>,
    /// Transfer function of the files.
    pub transfer: Transfer,
    /// Black level: file value without light (default 0).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub black: Option<f64>,
    /// File value of a saturated pixel (default: the largest value of the file's depth, 1 for floating point). Pixels
    /// at or above it are not used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub white: Option<f64>,
    /// Channel of colour files and of colour polarization sensors. Default: the channel closest to `wavelength_nm`, or
    /// green; all channels for kind exposures. Rejected for grey files.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub channel: Option<Channel>,
    /// Analyser angles of each 2×2 block of the sensor: a name such as `"sony"`, or degrees, `[[top left, top right],
    /// [bottom left, bottom right]]`. Required for division_of_focal_plane, rejected otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub layout: Option<Layout>,
    /// Colour filters of each 4×4 super-pixel of a colour polarization sensor with `layout` in degrees. Named sensors
    /// imply them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colour: Option<Bayer>,
    /// Illumination of the sample (default: unknown). With a circular panel, reconstructions fit models of gratings by
    /// default, otherwise plain polarimetry.
    #[serde(default, skip_serializing_if = "Illumination::is_unknown")]
    pub illumination: Illumination,
    /// Noise of the sensor (default: estimated from the photographs).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise: Option<NoiseModel>,
    /// Standard deviation of the analyser angles in degrees (default: estimated from the photographs).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub angle_sigma_deg: Option<f64>,
    /// Photograph without light at the same exposure, subtracted from every frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dark: Option<PathBuf>,
    /// Photograph of a uniformly reflecting surface; intensities are divided by it relative to its mean (flat field).
    /// A file in floating point beside photographs in integers holds relative light.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flat: Option<PathBuf>,
    /// Centre wavelength of the filter in nm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wavelength_nm: Option<f64>,
    /// Bandwidth of the filter in nm (full width at half maximum).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub band_nm: Option<f64>,
    /// Distances between sample, light and camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub geometry: Option<Distances>,
    /// Width and height of the panel in mm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub panel_mm: Option<[f64; 2]>,
    /// Material of the sample (default: a film of index 1.5 on aluminium).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub material: Option<Material>,
    /// Calibration of the bench at the time of the capture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<Calibration>,
}

/// Quantity varied between the photographs of a set.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// The angle of an analyser in front of the camera.
    Polarization,
    /// The angle of four analysers on each 2×2 block of the sensor, with or without colour filters.
    DivisionOfFocalPlane,
    /// The exposure time.
    Exposures,
    /// Nothing, or the analyser angle, under a flash.
    Flash,
    /// The lit position or the fringes on the panel.
    Spots,
    /// Any quantity that the frames state.
    Free,
}

/// One photograph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Frame {
    /// Image file, relative to the folder of `frames.json` and inside it.
    pub file: PathBuf,
    /// Analyser angle in degrees, anticlockwise from the right of the image as seen by the camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub analyser_deg: Option<f64>,
    /// Exposure time in s (default 1).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub exposure_s: Option<f64>,
    /// Gain relative to the camera's base (default 1).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gain: Option<f64>,
    /// Disc on the panel; without it the panel is black, unless the set's kind implies otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spot: Option<Spot>,
    /// Fringes on the panel, instead of a disc.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fringes: Option<Fringes>,
    /// True if the flash was on (default: true in sets of kind flash).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flash: Option<bool>,
    /// Position of the flash in mm from the centre of the sample: right, up, and along the outward normal, as seen by
    /// the camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub light_mm: Option<[f64; 3]>,
    /// Photograph without light at this frame's exposure, for sets with several exposures. Subtracted from this frame
    /// instead of the set's `dark`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dark: Option<PathBuf>,
}

/// A white disc on the panel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Spot {
    /// Centre in mm, to the right of and above the panel's centre.
    pub center_mm: [f64; 2],
    /// Diameter in mm.
    pub diameter_mm: f64,
}

/// Fringes over the whole panel: luminance (1 + cos 2π(f · x + phase)) / 2; uniform light at zero frequency.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Fringes {
    /// Spatial frequency to the right and upwards in cycles per mm.
    pub cycles_per_mm: [f64; 2],
    /// Phase at the panel's centre in cycles.
    pub phase: f64,
}

/// Transfer function between light and file values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Transfer {
    /// Proportional to light.
    Linear,
    /// The sRGB curve of IEC 61966-2-1.
    Srgb,
    /// Value = light^(1/gamma).
    Gamma(f64),
    /// Light = v (1 + a v + b v² + c v³) / (1 + a + b + c) for a value v between black (0) and white (1): a measured
    /// response, which must rise.
    Polynomial([f64; 3]),
    /// Unknown: recovered from the photographs, for kind exposures.
    Recover,
}

/// Permitted exponents.
const GAMMAS: std::ops::RangeInclusive<f64> = 0.1..=10.0;

/// Light of a value between black (0) and white (1) for coefficients of [`Transfer::Polynomial`].
fn polynomial([a, b, c]: [f64; 3], v: f64) -> f64 {
    v * (1.0 + v * (a + v * (b + v * c))) / (1.0 + a + b + c)
}

/// Steps of Newton's method for the inverse of a polynomial.
const ROUNDS: usize = 8;

/// A channel of a colour file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Channel {
    /// Red.
    R,
    /// Green.
    G,
    /// Blue.
    B,
    /// Mean of the four colour filters of a colour polarization sensor, or channel Y of EXR files.
    Luminance,
}

/// Distances on the bench.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Distances {
    /// Distance in mm from the sample to the camera and to the plane of the light.
    pub distance_mm: f64,
    /// Distance in mm from the camera to the centre of the light.
    pub baseline_mm: f64,
    /// Pixel size on the sample in µm.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pixel_um: Option<f64>,
    /// Pixel of the photographs below the camera, from the left and from the top (default: half the baseline to the
    /// left of the centre).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera_px: Option<[f64; 2]>,
}

impl FrameSet {
    /// Linear photographs without further metadata.
    pub fn new(kind: Kind, frames: Vec<Frame>) -> Self {
        Self {
            version: Version,
            kind,
            frames,
            transfer: Transfer::Linear,
            black: None,
            white: None,
            channel: None,
            layout: None,
            colour: None,
            illumination: Illumination::Unknown,
            noise: None,
            angle_sigma_deg: None,
            dark: None,
            flat: None,
            wavelength_nm: None,
            band_nm: None,
            geometry: None,
            panel_mm: None,
            material: None,
            calibration: None,
        }
    }
}

impl FrameSet {
    /// Transmission axis of the analyser in rad, anticlockwise from the right of the image; 0 for frames without an
    /// angle.
    pub fn analyser_axis(&self, frame: &Frame) -> f64 {
        let stage = frame.analyser_deg.unwrap_or_default();
        let calibrated = self.calibration.as_ref().and_then(|c| c.analyser.as_ref());
        calibrated.map_or(stage, |analyser| analyser.axis_deg(stage)).to_radians()
    }

    /// Contrast of the analyser behind parallel and crossed polarizers; 1 if not calibrated.
    pub fn analyser_contrast(&self) -> f64 {
        let calibrated = self.calibration.as_ref().and_then(|c| c.analyser.as_ref());
        calibrated.map_or(1.0, AnalyserCalibration::contrast)
    }

    /// Standard deviation of a pixel of the flat field, as a share; 0 if not calibrated.
    pub fn flat_sigma(&self) -> f64 {
        self.calibration.as_ref().and_then(|c| c.flat.as_ref()).map_or(0.0, |flat| flat.sigma)
    }
}

impl Frame {
    /// A photograph without metadata.
    pub fn new(file: impl Into<PathBuf>) -> Self {
        Self {
            file: file.into(),
            analyser_deg: None,
            exposure_s: None,
            gain: None,
            spot: None,
            fringes: None,
            flash: None,
            light_mm: None,
            dark: None,
        }
    }

    /// `1 / (exposure · gain)`.
    pub fn scale(&self) -> f64 {
        1.0 / (self.exposure_s.unwrap_or(1.0) * self.gain.unwrap_or(1.0))
    }
}

impl Transfer {
    /// Rejects unusual exponents, and `Recover`, which a single photograph does not permit.
    ///
    /// # Errors
    /// `Input`.
    pub fn check_known(self) -> Result<()> {
        let remedy = "say linear, srgb or gamma=NUMBER, such as gamma=2.2";
        match self {
            Self::Recover => {
                Err(Error::input("--transfer", "one photograph does not tell how its values grow with light", remedy))
            }
            known => known.problem().map_or(Ok(()), |(_, problem)| Err(Error::input("--transfer", problem, remedy))),
        }
    }

    /// Key and problem of an invalid number.
    pub(crate) fn problem(self) -> Option<(&'static str, String)> {
        match self {
            Self::Gamma(g) if !GAMMAS.contains(&g) => Some(("transfer.gamma", format!("{g} is outside 0.1 to 10"))),
            Self::Polynomial(c) if !(0..=100).all(|k| self.slope(f64::from(k) / 100.0) > 0.0) => {
                Some(("transfer.polynomial", format!("{c:?} is no response that rises from 0 to 1")))
            }
            _ => None,
        }
    }

    /// Light (0 to 1) of an encoded value (0 to 1). Values above 1 continue the curve; negative ones give negative
    /// light (linear, sRGB) or 0 (gamma).
    pub fn decode(self, v: f32) -> f32 {
        match self {
            Self::Linear | Self::Recover => v,
            Self::Srgb if v <= 0.040_45 => v / 12.92,
            Self::Srgb => ((v + 0.055) / 1.055).powf(2.4),
            Self::Gamma(g) => v.max(0.0).powf(g as f32),
            Self::Polynomial(c) => polynomial(c, v.into()) as f32,
        }
    }

    /// Encoded value (0 to 1) of light (0 to 1): the inverse of [`decode`](Self::decode).
    pub fn encode(self, light: f64) -> f64 {
        match self {
            Self::Linear | Self::Recover => light,
            Self::Srgb if light <= 0.003_130_8 => 12.92 * light,
            Self::Srgb => 1.055 * light.powf(1.0 / 2.4) - 0.055,
            Self::Gamma(g) => light.max(0.0).powf(1.0 / g),
            Self::Polynomial(c) => {
                // Newton's method; the curve is nearly straight.
                (0..ROUNDS).fold(light, |v, _| v - (polynomial(c, v) - light) / self.slope(v))
            }
        }
    }

    /// Light of a file's sample, relative to white; NaN at the largest integer, which is saturated.
    pub fn light(self, samples: &Samples, sample: usize) -> f32 {
        let (code, white) = match samples {
            Samples::U8(v) => (f32::from(v[sample]), Depth::U8.full_scale()),
            Samples::U16(v) => (f32::from(v[sample]), Depth::U16.full_scale()),
            Samples::F32(v) => return self.decode(v[sample]),
        };
        if code >= white { f32::NAN } else { self.decode(code / white) }
    }

    /// Derivative of light with respect to the encoded value `v`.
    pub fn slope(self, v: f64) -> f64 {
        match self {
            Self::Linear | Self::Recover => 1.0,
            Self::Srgb if v <= 0.040_45 => 1.0 / 12.92,
            Self::Srgb => 2.4 / 1.055 * ((v + 0.055) / 1.055).powf(1.4),
            Self::Gamma(g) => g * v.max(1e-6).powf(g - 1.0),
            Self::Polynomial([a, b, c]) => (1.0 + v * (2.0 * a + v * (3.0 * b + v * 4.0 * c))) / (1.0 + a + b + c),
        }
    }
}

impl Channel {
    /// Channel of a camera with the highest sensitivity at a wavelength in nm.
    pub fn nearest(nm: f64) -> Self {
        match nm {
            nm if nm >= 590.0 => Self::R,
            nm if nm >= 500.0 => Self::G,
            _ => Self::B,
        }
    }

    /// Name in a sentence.
    pub fn name(self) -> &'static str {
        match self {
            Self::R => "red",
            Self::G => "green",
            Self::B => "blue",
            Self::Luminance => "luminance",
        }
    }

    /// Name in an EXR file.
    pub fn letter(self) -> &'static str {
        match self {
            Self::R => "R",
            Self::G => "G",
            Self::B => "B",
            Self::Luminance => "Y",
        }
    }

    /// Index in an RGB pixel.
    pub fn index(self) -> usize {
        match self {
            Self::R => 0,
            Self::G | Self::Luminance => 1,
            Self::B => 2,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn srgb_matches_the_standard() {
        // IEC 61966-2-1: code 188 of 255 is 50.3 % light.
        assert!((Transfer::Srgb.decode(188.0 / 255.0) - 0.502_9).abs() < 1e-3);
        assert!((Transfer::Gamma(2.0).decode(0.5) - 0.25).abs() < 1e-7);
        let curved = Transfer::Polynomial([0.08, 0.01, 0.03]);
        assert!((curved.decode(1.0) - 1.0).abs() < 1e-7);
        assert_eq!(Transfer::Polynomial([-0.9, 0.0, 0.0]).problem().unwrap().0, "transfer.polynomial");
        for t in [Transfer::Linear, Transfer::Srgb, Transfer::Gamma(2.2), curved] {
            for light in [0.001, 0.2, 0.9] {
                assert!((f64::from(t.decode(t.encode(light) as f32)) - light).abs() < 1e-6);
            }
            let difference = (t.decode(0.501) - t.decode(0.499)) / 0.002;
            assert!((f64::from(difference) - t.slope(0.5)).abs() < 1e-3);
        }
    }
}

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
mod transfer;

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
pub use transfer::Transfer;

use nacre_base::Version;
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

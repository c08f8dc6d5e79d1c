//! `bench.toml`: configuration of the virtual bench.

mod check;
mod defaults;

use crate::random::{key, normals};
use crate::surface::{SampleConfig, SampleKind};
use nacre_base::Version;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The virtual bench. All keys are optional; `nacre schema bench` prints the defaults.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BenchConfig {
    /// Version of the format.
    pub version: Version<1>,
    /// Seed of all random numbers: sample, defects, noise.
    pub seed: u64,
    /// Seed of the noise of photographs; by default that of the bench, on which the properties of its pixels depend.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub noise_seed: Option<u64>,
    /// The sample on the table.
    pub sample: SampleConfig,
    /// Effect of the grating on polarization.
    pub grating: GratingConfig,
    /// The transparent film over the grating.
    pub film: FilmConfig,
    /// The LCD panel with its retarder.
    pub panel: PanelConfig,
    /// The colour filter.
    pub filter: FilterConfig,
    /// The camera.
    pub camera: CameraConfig,
    /// The analyser.
    pub analyser: AnalyserConfig,
    /// The rotation stage of the analyser.
    pub stage: StageConfig,
    /// The flash.
    pub flash: FlashConfig,
    /// Distances.
    pub geometry: GeometryConfig,
    /// Faults of devices.
    pub faults: Vec<FaultConfig>,
}

/// The flash: a small unpolarized lamp in the plane of panel and camera lens.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FlashConfig {
    /// Position to the right of the midpoint between camera and panel, in mm.
    pub x_mm: f64,
    /// Position above that point, in mm.
    pub y_mm: f64,
    /// Diameter in mm.
    pub diameter_mm: f64,
    /// Luminance relative to the panel.
    pub power: f64,
    /// Time until the light is steady, in ms.
    pub settle_ms: f64,
    /// Longest on-time in seconds.
    pub max_on_s: f64,
}

/// A fault of one device.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FaultConfig {
    /// The faulty device.
    pub device: FaultyDevice,
    /// Kind of the fault.
    pub kind: FaultKind,
    /// Number of commands before the fault; descriptions do not count.
    #[serde(default)]
    pub after: u64,
    /// Number of commands that fail. Default: all further ones.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub times: Option<u64>,
}

/// Devices that can fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FaultyDevice {
    /// The rotation stage.
    Stage,
    /// The camera.
    Camera,
    /// The panel.
    Display,
    /// The flash.
    Flash,
    /// The door switch; counts queries of its level.
    Interlock,
    /// The clock of all devices; counts commands to all devices.
    Clock,
}

/// Kinds of faults.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// Any device: no answer within the driver's time limit.
    Silent,
    /// Any device: the connection is lost.
    Lost,
    /// Stage: stops half-way and reports that angle.
    StopsShort,
    /// Stage: answers with an invalid angle.
    Nonsense,
    /// Camera: frames of another size.
    WrongSize,
    /// Camera: frames that the driver flags as damaged.
    Damaged,
    /// Display: acknowledges another pattern.
    OtherPattern,
    /// Flash: reads back the opposite state.
    WrongState,
    /// Interlock: opens.
    Opens,
    /// Clock: set back by an hour.
    SetBack,
}

/// Jones matrix of the grating: diag(-1, R) along and across its vector, with R = r·exp(iζ) (2018 paper, Eq. 6). A
/// mirror has R = -1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GratingConfig {
    /// Modulus of R at 1 µm period.
    pub r: f64,
    /// Phase of R at 1 µm period, in degrees.
    pub zeta_deg: f64,
    /// Strength of the grating's effect on polarization: from 0 (mirror) to 1 (R as given).
    pub ellipticity: f64,
    /// Exponent of the growth of ln r and ζ - 180° with (1 µm / period); 0 makes R equal for all periods.
    pub period_power: f64,
    /// Computes R from Maxwell's equations at normal incidence, for every period and wavelength. Then `r`, `zeta_deg`
    /// and `period_power` have no effect.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rigorous: Option<RigorousConfig>,
}

/// Sinusoidal metal surface under the film, for the rigorous computation of R.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RigorousConfig {
    /// Peak-to-peak depth of the surface in µm. It is independent of the sample's depth, which sets the diffraction
    /// efficiencies.
    pub depth_um: f64,
    /// Real part of the metal's refractive index.
    pub metal_n: f64,
    /// Imaginary part of the metal's refractive index, positive.
    pub metal_k: f64,
    /// Largest error of R, of the solver and the interpolation over the period.
    pub max_error: f64,
}

/// Plastic film: birefringent, with a front reflection (2018 paper, Eq. 4).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FilmConfig {
    /// Retardance of one pass at the filter's centre wavelength, in degrees.
    pub retardance_deg: f64,
    /// Azimuth of the film's axis in degrees.
    pub axis_deg: f64,
    /// Amplitude of the front reflection relative to the incident field.
    pub front_reflection: f64,
    /// Phase of the front reflection in degrees; it depends on the film's thickness.
    pub front_phase_deg: f64,
    /// Refractive index.
    pub index: f64,
}

/// The LCD as light source: a white disc behind a quarter-wave retarder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PanelConfig {
    /// Diameter of the white disc in mm. Default: the smallest disc that fills every pixel's mirror direction, at
    /// least 180 mm.
    pub disc_mm: Option<f64>,
    /// Width and height of the panel in mm.
    pub size_mm: [f64; 2],
    /// Direction of the panel's linear polarization, in degrees.
    pub polarization_deg: f64,
    /// Direction of the retarder's axis, in degrees.
    pub retarder_deg: f64,
    /// Retardance of the retarder at the filter's centre wavelength, in degrees (ideal: 90).
    pub retardance_deg: f64,
    /// Exponent of the luminance at an angle: luminance ∝ cos^falloff.
    pub falloff: f64,
    /// Unpolarized ambient light, relative to the panel as seen in a mirror.
    pub ambient: f64,
    /// Exponent of the tone curve: luminance ∝ (8-bit code)^gamma.
    pub gamma: f64,
    /// Delay in ms until a new pattern is visible; the panel acknowledges it at once.
    pub lag_ms: f64,
}

/// Colour filter in front of the camera, with a Gaussian band.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FilterConfig {
    /// Centre wavelength in nm.
    pub wavelength_nm: f64,
    /// Full width at half maximum in nm.
    pub band_nm: f64,
}

/// Camera with lens.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CameraConfig {
    /// Pixels per row.
    pub width: u32,
    /// Number of rows.
    pub height: u32,
    /// Exposure time in ms. Default: metered so that no pixel saturates at any analyser angle.
    pub exposure_ms: Option<f64>,
    /// Gain, 1 to 100.
    pub gain: f64,
    /// Full-well capacity in electrons.
    pub well_e: f64,
    /// Standard deviation of the read noise in electrons.
    pub read_noise_e: f64,
    /// Bits of the analog-to-digital converter, 8 to 16.
    pub bits: u32,
    /// Code of black.
    pub black_level: u32,
    /// Sensitivity in electrons per ms for a perfect mirror.
    pub sensitivity_e_ms: f64,
    /// Readout time in ms.
    pub readout_ms: f64,
    /// Frames in the camera's queue, which are stale after any change.
    pub queue: u32,
    /// Frames until a changed exposure or gain takes effect.
    pub lag_frames: u32,
    /// Standard deviation of the lens blur in pixels.
    pub blur_px: f64,
    /// Fraction of light that is lost in the corners, 0 to 1.
    pub vignetting: f64,
    /// Diameter of the aperture in mm; it softens the edge of the disc.
    pub aperture_mm: f64,
    /// Rays per pixel along each axis. Pixels that show one surface get two.
    pub subsamples: u32,
    /// Dark current in electrons per second.
    pub dark_e_s: f64,
    /// Differences of darkness between pixels in electrons (standard deviation).
    pub dsnu_e: f64,
    /// Differences of sensitivity between pixels, as a share (standard deviation).
    pub prnu: f64,
    /// Share of pixels without sensitivity or with a dark current of half the full well per second.
    pub bad_pixels: f64,
    /// Loss of response at full well, as a share: electrons e are read as e (1 - loss · e / well).
    pub response_loss: f64,
}

/// The analyser: a slightly wedged plate, which shifts the image.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AnalyserConfig {
    /// Length of the image shift in pixels; it points along the analyser's angle and turns with it.
    pub wedge_px: f64,
    /// Additional random shift per angle: standard deviation per axis in pixels.
    pub jitter_px: f64,
}

/// Rotation stage of the analyser.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StageConfig {
    /// Speed in degrees per second.
    pub speed_deg_s: f64,
    /// Settling time after a move in ms.
    pub settle_ms: f64,
    /// Angle error when it arrives from above, in degrees.
    pub backlash_deg: f64,
    /// Standard deviation of the angle error of a move, in degrees.
    pub repeatability_deg: f64,
    /// Smallest and largest angle in degrees.
    pub limits_deg: [f64; 2],
    /// Extinction ratio: transmission through parallel over crossed polarizers.
    pub extinction_ratio: f64,
    /// Transmission axis at the stage's zero in degrees, anticlockwise from the right of the image.
    pub zero_deg: f64,
    /// True if the analyser turns clockwise, as seen by the camera, with increasing angles of the stage.
    pub clockwise: bool,
    /// Amplitude in degrees of the periodic angle error of an eccentric scale.
    pub eccentricity_deg: f64,
    /// Angle of the stage in degrees at which that error is zero and increases.
    pub eccentricity_at_deg: f64,
}

/// Distances.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GeometryConfig {
    /// Distance from sample to camera and to panel, in mm.
    pub distance_mm: f64,
    /// Distance from camera to the panel's centre in mm; the sample faces the midpoint.
    pub baseline_mm: f64,
}

impl CameraConfig {
    /// Exposure time in seconds with which the camera starts to stream: as configured, or 10 ms.
    pub fn power_on_exposure_s(&self) -> f64 {
        self.exposure_ms.unwrap_or(10.0) / 1000.0
    }
}

impl BenchConfig {
    /// Image shift in pixels, right and down, at this analyser angle.
    pub fn shift_px(&self, analyser_deg: f64) -> [f64; 2] {
        let AnalyserConfig { wedge_px, jitter_px } = self.analyser;
        // Rounded to 0.1°, so that ringing of the stage does not change the random shift.
        let tenths = (10.0 * analyser_deg).round() as i64 as u64;
        let random = normals(key(&[self.seed, 0x3ed6e, tenths]));
        let (sin, cos) = analyser_deg.to_radians().sin_cos();
        [wedge_px * cos + jitter_px * random[0], -wedge_px * sin + jitter_px * random[1]]
    }

    /// Diameter of the white disc in mm.
    pub fn disc_mm(&self) -> f64 {
        let aperture = self.camera.aperture_mm;
        // The mirror directions of the field's corners reach twice as far on the panel. A compact disc has no corners,
        // and a larger light would add its first orders, which are brighter than the mirrored light.
        let needed = match self.sample.kind {
            SampleKind::Cd => 2.0 * self.sample.size_mm() + aperture,
            _ => 2.0 * 2f64.sqrt() * self.sample.field_mm() + 2.0 * aperture,
        };
        self.panel.disc_mm.unwrap_or(needed.max(180.0))
    }
}

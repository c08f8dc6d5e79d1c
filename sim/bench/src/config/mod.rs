//! `bench.toml`: everything about the virtual bench that can be turned.

mod check;
mod defaults;

use crate::random::{key, normals};
use crate::surface::{SampleConfig, SampleKind};
use nacre_base::Version;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The virtual bench. Every key may be left out; its default is printed by `nacre schema bench`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BenchConfig {
    /// Version of the format.
    pub version: Version<1>,
    /// Seed of everything random: sample, defects, noise.
    pub seed: u64,
    /// The surface on the table.
    pub sample: SampleConfig,
    /// How the grating changes polarization.
    pub grating: GratingConfig,
    /// The transparent film over the grating.
    pub film: FilmConfig,
    /// The LCD panel with its retarder.
    pub panel: PanelConfig,
    /// The colour filter.
    pub filter: FilterConfig,
    /// The camera.
    pub camera: CameraConfig,
    /// The analyser itself.
    pub analyser: AnalyserConfig,
    /// The stage that turns the analyser.
    pub stage: StageConfig,
    /// The flash.
    pub flash: FlashConfig,
    /// Where things stand.
    pub geometry: GeometryConfig,
    /// What goes wrong.
    pub faults: Vec<FaultConfig>,
}

/// The flash: a small unpolarized lamp in the plane of panel and camera lens.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FlashConfig {
    /// To the right of the point between camera and panel, in mm.
    pub x_mm: f64,
    /// Above it, in mm.
    pub y_mm: f64,
    /// Diameter in mm.
    pub diameter_mm: f64,
    /// Luminance relative to the panel.
    pub power: f64,
    /// Time until the light is steady, in ms.
    pub settle_ms: f64,
    /// It must not be on for longer than this, in seconds.
    pub max_on_s: f64,
}

/// A fault of one device.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FaultConfig {
    /// Which device.
    pub device: FaultyDevice,
    /// What it does.
    pub kind: FaultKind,
    /// Commands that it carries out properly before (descriptions do not count).
    #[serde(default)]
    pub after: u64,
    /// Commands that fail; all further ones when it is not given.
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
    /// The door switch; counts how often its level is asked for.
    Interlock,
    /// The clock that all devices report; counts commands to all devices.
    Clock,
}

/// Ways to fail.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// Any device: no answer within the driver's time.
    Silent,
    /// Any device: the link is gone.
    Lost,
    /// Stage: stands still half-way and says where.
    StopsShort,
    /// Stage: answers something that is no angle.
    Nonsense,
    /// Camera: frames of another size.
    WrongSize,
    /// Camera: frames that the driver flags as damaged.
    Damaged,
    /// Display: acknowledges another pattern.
    OtherPattern,
    /// Flash: the state read back is the opposite.
    WrongState,
    /// Interlock: opens.
    Opens,
    /// Clock: is set back by an hour.
    SetBack,
}

/// The grating's Jones matrix is diag(-1, R) along and across its vector, R = r·exp(iζ) (2018 paper, Eq. 6); a
/// mirror has R = -1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GratingConfig {
    /// Modulus of R at 1 µm period.
    pub r: f64,
    /// Phase of R at 1 µm period, in degrees.
    pub zeta_deg: f64,
    /// Weakens the grating's effect on polarization: 1 as given, 0 that of a mirror.
    pub ellipticity: f64,
    /// ln r and ζ - 180° grow as (1 µm / period) to this power; 0 makes them the same for all periods.
    pub period_power: f64,
    /// Takes R from Maxwell's equations at normal incidence instead, for every period and wavelength; `r`, `zeta_deg`
    /// and `period_power` then do not count.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rigorous: Option<RigorousConfig>,
}

/// The sinusoidal metal surface under the film whose R is computed rigorously.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RigorousConfig {
    /// Depth of the surface, peak to peak, in µm; apart from the sample's, which decides how much light the orders get.
    pub depth_um: f64,
    /// Real part of the metal's refractive index.
    pub metal_n: f64,
    /// Imaginary part of the metal's refractive index, positive.
    pub metal_k: f64,
    /// Largest error of R, solver and interpolation over the period together.
    pub max_error: f64,
}

/// Plastic film: birefringent, and reflecting at its front (2018 paper, Eq. 4).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FilmConfig {
    /// Retardance of one pass at the filter's middle wavelength, in degrees.
    pub retardance_deg: f64,
    /// Azimuth of the film's axis in degrees.
    pub axis_deg: f64,
    /// Amplitude of the front reflection, relative to the incident field.
    pub front_reflection: f64,
    /// Phase of the front reflection, in degrees (the film's thickness shifts it).
    pub front_phase_deg: f64,
    /// Refractive index.
    pub index: f64,
}

/// The LCD as light: a white disc behind a quarter-wave retarder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct PanelConfig {
    /// Diameter of the white disc in mm; by default it just fills every pixel's mirror direction, at least 180 mm.
    pub disc_mm: Option<f64>,
    /// Width and height of the panel in mm.
    pub size_mm: [f64; 2],
    /// Direction of the panel's linear polarization, in degrees.
    pub polarization_deg: f64,
    /// Direction of the retarder's axis, in degrees.
    pub retarder_deg: f64,
    /// The retarder's retardance at the filter's middle wavelength, in degrees (ideal: 90).
    pub retardance_deg: f64,
    /// Loss of luminance at an angle: luminance ∝ cos^falloff.
    pub falloff: f64,
    /// Unpolarized light from elsewhere, relative to the panel as seen in a mirror.
    pub ambient: f64,
    /// What its luminance grows with: the code, of 8 bits, to this power.
    pub gamma: f64,
    /// Time until a new pattern is there, in ms, although the panel says that it is there at once.
    pub lag_ms: f64,
}

/// Colour filter in front of the camera, a Gaussian band.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FilterConfig {
    /// Middle of the band in nm.
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
    /// Rows.
    pub height: u32,
    /// Exposure time in ms; without it the bench is metered so that no pixel saturates at any analyser angle.
    pub exposure_ms: Option<f64>,
    /// Gain.
    pub gain: f64,
    /// Electrons that fill a pixel.
    pub well_e: f64,
    /// Read noise in electrons, standard deviation.
    pub read_noise_e: f64,
    /// Bits of the converter, 8 to 16.
    pub bits: u32,
    /// Code of no light.
    pub black_level: u32,
    /// Electrons per ms from a perfect mirror.
    pub sensitivity_e_ms: f64,
    /// Readout time in ms.
    pub readout_ms: f64,
    /// Frames that wait in the camera's queue, stale after any change.
    pub queue: u32,
    /// Frames until a changed exposure or gain acts.
    pub lag_frames: u32,
    /// Standard deviation of the lens blur in pixels.
    pub blur_px: f64,
    /// Loss of light in the corners, 0 to 1.
    pub vignetting: f64,
    /// Diameter of the aperture in mm; softens the edge of the disc.
    pub aperture_mm: f64,
    /// Rays per pixel along each side.
    pub subsamples: u32,
}

/// The analyser: a plate whose faces are not quite parallel shifts the image.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AnalyserConfig {
    /// Length of the shift in pixels; it points along the analyser's angle and turns with it.
    pub wedge_px: f64,
    /// Random shift of each angle besides, standard deviation per direction in pixels.
    pub jitter_px: f64,
}

/// Rotation stage of the analyser.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct StageConfig {
    /// Speed in degrees per second.
    pub speed_deg_s: f64,
    /// Time until it stands still after a move, in ms.
    pub settle_ms: f64,
    /// Angle missed when it arrives from above, in degrees.
    pub backlash_deg: f64,
    /// Random error of each move, standard deviation in degrees.
    pub repeatability_deg: f64,
    /// Lowest and highest angle that it takes.
    pub limits_deg: [f64; 2],
    /// Light through parallel over light through crossed polarizers.
    pub extinction_ratio: f64,
}

/// Distances.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GeometryConfig {
    /// Sample to camera and to panel, in mm.
    pub distance_mm: f64,
    /// Camera to the middle of the panel, in mm; the sample lies half-way.
    pub baseline_mm: f64,
}

impl CameraConfig {
    /// Exposure with which the camera begins to stream, in seconds: as configured, or 10 ms.
    pub fn power_on_exposure_s(&self) -> f64 {
        self.exposure_ms.unwrap_or(10.0) / 1000.0
    }
}

impl BenchConfig {
    /// By how many pixels the image is shifted, right and down, with the analyser at this angle.
    pub fn shift_px(&self, analyser_deg: f64) -> [f64; 2] {
        let AnalyserConfig { wedge_px, jitter_px } = self.analyser;
        // The same angle is shifted in the same way, whatever is left of the stage's ringing.
        let tenths = (10.0 * analyser_deg).round() as i64 as u64;
        let random = normals(key(&[self.seed, 0x3ed6e, tenths]));
        let (sin, cos) = analyser_deg.to_radians().sin_cos();
        [wedge_px * cos + jitter_px * random[0], -wedge_px * sin + jitter_px * random[1]]
    }

    /// Diameter of the white disc in mm.
    pub fn disc_mm(&self) -> f64 {
        let aperture = self.camera.aperture_mm;
        // The mirror directions of the field's corners reach twice as far on the panel. A compact disc has no corners, and a
        // larger light brings its first orders in, which are brighter than the mirrored light.
        let needed = match self.sample.kind {
            SampleKind::Cd => 2.0 * self.sample.size_mm() + aperture,
            _ => 2.0 * 2f64.sqrt() * self.sample.field_mm() + 2.0 * aperture,
        };
        self.panel.disc_mm.unwrap_or(needed.max(180.0))
    }
}

//! `bench.toml`: everything about the virtual bench that can be turned.

use crate::surface::SampleConfig;
use nacre_processing::rcwa::ALUMINIUM;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The virtual bench. Every key may be left out; its default is printed by `nacre schema bench`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BenchConfig {
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

impl FaultKind {
    /// Whether a device can fail in this way.
    fn befalls(self, device: FaultyDevice) -> bool {
        use FaultyDevice::{Camera, Clock, Display, Flash, Interlock, Stage};
        match self {
            Self::Silent | Self::Lost => device != Clock,
            Self::StopsShort | Self::Nonsense => device == Stage,
            Self::WrongSize | Self::Damaged => device == Camera,
            Self::OtherPattern => device == Display,
            Self::WrongState => device == Flash,
            Self::Opens => device == Interlock,
            Self::SetBack => device == Clock,
        }
    }
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

impl Default for GratingConfig {
    fn default() -> Self {
        Self { r: 1.1, zeta_deg: 45.0, ellipticity: 1.0, period_power: 1.2, rigorous: None }
    }
}

impl Default for RigorousConfig {
    fn default() -> Self {
        Self { depth_um: 0.1, metal_n: ALUMINIUM.re, metal_k: ALUMINIUM.im, max_error: 1e-3 }
    }
}

impl Default for FilmConfig {
    fn default() -> Self {
        Self { retardance_deg: 0.0, axis_deg: 20.0, front_reflection: 0.05, front_phase_deg: 0.0, index: 1.468 }
    }
}

impl Default for PanelConfig {
    fn default() -> Self {
        Self {
            disc_mm: None,
            // A common 27-inch panel.
            size_mm: [597.0, 336.0],
            polarization_deg: 0.0,
            retarder_deg: 45.0,
            retardance_deg: 90.0,
            falloff: 2.0,
            ambient: 0.002,
        }
    }
}

impl Default for FilterConfig {
    fn default() -> Self {
        Self { wavelength_nm: 550.0, band_nm: 10.0 }
    }
}

impl Default for CameraConfig {
    fn default() -> Self {
        Self {
            width: 1024,
            height: 1024,
            exposure_ms: None,
            gain: 1.0,
            well_e: 40_000.0,
            read_noise_e: 8.0,
            bits: 12,
            black_level: 64,
            sensitivity_e_ms: 2500.0,
            readout_ms: 10.0,
            queue: 4,
            lag_frames: 2,
            blur_px: 0.5,
            vignetting: 0.2,
            aperture_mm: 12.0,
            subsamples: 2,
        }
    }
}

impl Default for StageConfig {
    fn default() -> Self {
        Self {
            speed_deg_s: 180.0,
            settle_ms: 120.0,
            backlash_deg: 0.1,
            repeatability_deg: 0.01,
            limits_deg: [-360.0, 720.0],
            extinction_ratio: 1e4,
        }
    }
}

impl Default for FlashConfig {
    fn default() -> Self {
        Self { x_mm: 300.0, y_mm: 250.0, diameter_mm: 10.0, power: 30.0, settle_ms: 1.0, max_on_s: 30.0 }
    }
}

impl Default for GeometryConfig {
    fn default() -> Self {
        Self { distance_mm: 600.0, baseline_mm: 100.0 }
    }
}

impl CameraConfig {
    /// Exposure with which the camera begins to stream, in seconds: as configured, or 10 ms.
    pub fn power_on_exposure_s(&self) -> f64 {
        self.exposure_ms.unwrap_or(10.0) / 1000.0
    }
}

impl BenchConfig {
    /// Reads a bench from TOML.
    ///
    /// # Errors
    /// A sentence that names the key, what was found and what is allowed.
    pub fn from_toml(text: &str) -> Result<Self, String> {
        let config: Self = toml::from_str(text).map_err(|e| e.to_string().trim_end().replace('\n', "\n  "))?;
        config.validate()?;
        Ok(config)
    }

    /// Checks every number.
    ///
    /// # Errors
    /// A sentence that names the key, what was found and what is allowed.
    pub fn validate(&self) -> Result<(), String> {
        self.sample.validate()?;
        let rigorous = self.grating.rigorous.clone().unwrap_or_default();
        let (g, f, p, c, s) = (&self.grating, &self.film, &self.panel, &self.camera, &self.stage);
        for (key, value, low, high) in [
            ("grating.r", g.r, 1e-6, 1e6),
            ("grating.zeta_deg", g.zeta_deg, -360.0, 360.0),
            ("grating.ellipticity", g.ellipticity, 0.0, 1.0),
            ("grating.period_power", g.period_power, 0.0, 4.0),
            ("grating.rigorous.depth_um", rigorous.depth_um, 0.0, 2.0),
            ("grating.rigorous.metal_n", rigorous.metal_n, 0.0, 20.0),
            ("grating.rigorous.metal_k", rigorous.metal_k, 1e-3, 50.0),
            ("grating.rigorous.max_error", rigorous.max_error, 1e-6, 0.5),
            ("film.retardance_deg", f.retardance_deg, -360.0, 360.0),
            ("film.axis_deg", f.axis_deg, -360.0, 360.0),
            ("film.front_reflection", f.front_reflection, 0.0, 0.9),
            ("film.front_phase_deg", f.front_phase_deg, -360.0, 360.0),
            ("film.index", f.index, 1.0, 3.0),
            ("panel.disc_mm", p.disc_mm.unwrap_or(180.0), 0.1, 5000.0),
            ("panel.size_mm[0]", p.size_mm[0], 1.0, 1e5),
            ("panel.size_mm[1]", p.size_mm[1], 1.0, 1e5),
            ("panel.polarization_deg", p.polarization_deg, -360.0, 360.0),
            ("panel.retarder_deg", p.retarder_deg, -360.0, 360.0),
            ("panel.retardance_deg", p.retardance_deg, -360.0, 360.0),
            ("panel.falloff", p.falloff, 0.0, 20.0),
            ("panel.ambient", p.ambient, 0.0, 10.0),
            ("filter.wavelength_nm", self.filter.wavelength_nm, 380.0, 780.0),
            ("filter.band_nm", self.filter.band_nm, 0.0, 200.0),
            ("camera.width", c.width.into(), 2.0, 16_384.0),
            ("camera.height", c.height.into(), 2.0, 16_384.0),
            ("camera.exposure_ms", c.exposure_ms.unwrap_or(40.0), 1e-3, 1e6),
            ("camera.gain", c.gain, 0.01, 1000.0),
            ("camera.well_e", c.well_e, 10.0, 1e7),
            ("camera.read_noise_e", c.read_noise_e, 0.0, 1e4),
            ("camera.bits", c.bits.into(), 8.0, 16.0),
            ("camera.black_level", c.black_level.into(), 0.0, f64::from(1u32 << c.bits.min(16)) - 2.0),
            ("camera.sensitivity_e_ms", c.sensitivity_e_ms, 1e-3, 1e9),
            ("camera.readout_ms", c.readout_ms, 0.0, 1e4),
            ("camera.queue", c.queue.into(), 1.0, 64.0),
            ("camera.lag_frames", c.lag_frames.into(), 0.0, 16.0),
            ("camera.blur_px", c.blur_px, 0.0, 20.0),
            ("camera.vignetting", c.vignetting, 0.0, 1.0),
            ("camera.aperture_mm", c.aperture_mm, 0.0, 200.0),
            ("camera.subsamples", c.subsamples.into(), 1.0, 16.0),
            ("stage.speed_deg_s", s.speed_deg_s, 0.1, 1e5),
            ("stage.settle_ms", s.settle_ms, 0.0, 1e5),
            ("stage.backlash_deg", s.backlash_deg, -10.0, 10.0),
            ("stage.repeatability_deg", s.repeatability_deg, 0.0, 10.0),
            ("stage.extinction_ratio", s.extinction_ratio, 1.0, 1e12),
            ("stage.limits_deg[0]", s.limits_deg[0], -36_000.0, s.limits_deg[1]),
            ("stage.limits_deg[1]", s.limits_deg[1], s.limits_deg[0], 36_000.0),
            ("flash.x_mm", self.flash.x_mm, -1e4, 1e4),
            ("flash.y_mm", self.flash.y_mm, -1e4, 1e4),
            ("flash.diameter_mm", self.flash.diameter_mm, 0.1, 1000.0),
            ("flash.power", self.flash.power, 1e-6, 1e9),
            ("flash.settle_ms", self.flash.settle_ms, 0.0, 1e5),
            ("flash.max_on_s", self.flash.max_on_s, 1e-3, 1e5),
            ("geometry.distance_mm", self.geometry.distance_mm, 10.0, 1e5),
            ("geometry.baseline_mm", self.geometry.baseline_mm, 0.0, 1e5),
        ] {
            if !(low..=high).contains(&value) {
                return Err(format!("{key} is {value}; give a number from {low} to {high}"));
            }
        }
        match self.faults.iter().position(|f| !f.kind.befalls(f.device)) {
            Some(i) => {
                let fault = &self.faults[i];
                Err(format!(
                    "faults[{i}]: the {:?} has no fault {:?}; `nacre schema bench` lists them",
                    fault.device, fault.kind
                )
                .to_lowercase())
            }
            None => Ok(()),
        }
    }

    /// Diameter of the white disc in mm.
    pub fn disc_mm(&self) -> f64 {
        let field = self.sample.field_mm();
        // The mirror directions of the field's corners reach twice as far on the panel.
        self.panel.disc_mm.unwrap_or((2.0 * 2f64.sqrt() * field + 2.0 * self.camera.aperture_mm).max(180.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_documented_bench_is_read() {
        let text = r#"
            seed = 7
            sample = { kind = "kinematic", size_mm = 25, depth_um = 0.1, period_um = 1.0, reflectance_variation = 0.4 }
            film = { retardance_deg = 10, axis_deg = 20, front_reflection = 0.05 }
            camera = { well_e = 40000, read_noise_e = 8, bits = 12, queue = 4, lag_frames = 2 }
            stage = { backlash_deg = 0.1, settle_ms = 120, speed_deg_s = 180 }
            geometry = { distance_mm = 600, baseline_mm = 100 }
        "#;
        let bench = BenchConfig::from_toml(text).unwrap();
        assert_eq!((bench.seed, bench.film.retardance_deg, bench.camera.width), (7, 10.0, 1024));
    }

    #[test]
    fn wrong_benches_are_refused_by_key() {
        for (text, named) in [
            ("sed = 1", "sed"),
            ("camera = { bits = 40 }", "camera.bits"),
            ("camera = { exposure_ms = nan }", "camera.exposure_ms"),
            ("film = { index = -1 }", "film.index"),
            ("sample = { kind = \"moon\" }", "moon"),
        ] {
            let message = BenchConfig::from_toml(text).unwrap_err();
            assert!(message.contains(named), "{message}");
        }
    }
}

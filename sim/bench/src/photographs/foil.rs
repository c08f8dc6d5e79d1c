//! Photographs of foil with dots below the resolution, whose gratings have random orientations and periods.
//!
//! The distribution is a closed form. A pixel's radiance sums the density of dots whose grating vector diffracts an
//! order to the camera. The sum is over points of the flash, wavelengths of the band, and orders up to the third.
//! There are no bins, and no formulas are shared with the reconstruction.

use super::bracket::{bracket, check_exposures};
use super::flash::{blurred, disc};
use nacre_base::{Error, Result};
use nacre_image::OutputFolder;
use nacre_optics::geometry::{Camera, Geometry, Pose, Uncertainty, text};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// A scene with a foil.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FoilPhotograph {
    /// Seed of the noise.
    pub seed: u64,
    /// Period as a function of orientation.
    pub pattern: FoilPattern,
    /// Standard deviation of the period about that function, in µm.
    pub spread_um: f64,
    /// Peak-to-peak depth of the sinusoidal gratings in µm.
    pub depth_um: f64,
    /// Centre wavelength of the filter in nm.
    pub wavelength_nm: f64,
    /// Full width at half maximum of the filter's band in nm.
    pub band_nm: f64,
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Size of a pixel on the foil, in µm.
    pub pixel_um: f64,
    /// Height of the camera above the foil in mm; it looks straight down.
    pub camera_mm: f64,
    /// Height of the flash above the foil in mm.
    pub flash_mm: f64,
    /// Position of the flash relative to the camera, to the right and up, in mm.
    pub baseline_mm: [f64; 2],
    /// Diameter of the flash in mm.
    pub flash_diameter_mm: f64,
    /// Standard deviation of the zero order in half vectors.
    pub gloss: f64,
    /// Standard deviation of the lens blur in pixels.
    pub blur_px: f64,
    /// Exposures relative to the first.
    pub exposures: Vec<f64>,
    /// Level of the brightest pixel in the first exposure, as a fraction of white.
    pub level: f64,
    /// Electrons at white.
    pub full_scale_e: f64,
    /// Standard deviation of the read noise in electrons.
    pub read_noise_e: f64,
}

/// Period as a function of orientation; orientations are uniformly distributed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum FoilPattern {
    /// One period in µm: a circle.
    Circle(f64),
    /// From the first period at 0° to the second at 180°, in µm: a spiral of two arms.
    Spiral([f64; 2]),
}

impl Default for FoilPhotograph {
    fn default() -> Self {
        Self {
            seed: 1,
            pattern: FoilPattern::Spiral([1.0, 1.45]),
            spread_um: 0.06,
            depth_um: 0.08,
            wavelength_nm: 530.0,
            band_nm: 10.0,
            width: 480,
            height: 480,
            pixel_um: 560.0,
            camera_mm: 500.0,
            flash_mm: 300.0,
            baseline_mm: [20.0, -10.0],
            flash_diameter_mm: 4.0,
            gloss: 0.008,
            blur_px: 0.6,
            exposures: vec![1.0, 16.0, 256.0],
            level: 0.9,
            full_scale_e: 40_000.0,
            read_noise_e: 8.0,
        }
    }
}

/// Number of wavelengths in the band.
const WAVELENGTHS: i32 = 5;

impl FoilPattern {
    /// Mean period at an orientation, in µm.
    pub fn period_um(self, theta: f64) -> f64 {
        match self {
            Self::Circle(um) => um,
            Self::Spiral([a, b]) => a + (b - a) * theta / PI,
        }
    }
}

impl FoilPhotograph {
    /// Checks all numbers.
    ///
    /// # Errors
    /// `Input`, naming the number.
    pub fn check(&self) -> Result<()> {
        let bad = |name: &str, problem: String| Err(Error::input(name, problem, "correct the scene"));
        let periods = match self.pattern {
            FoilPattern::Circle(um) => [um, um],
            FoilPattern::Spiral(ends) => ends,
        };
        if !periods.iter().all(|p| (0.3..=20.0).contains(p)) {
            return bad("pattern", format!("has periods {periods:?}; expected 0.3 to 20 µm"));
        }
        for (name, value, least, most) in [
            ("spread_um", self.spread_um, 1e-3, 0.2 * periods[0].min(periods[1])),
            ("depth_um", self.depth_um, 1e-3, 2.0),
            ("wavelength_nm", self.wavelength_nm, 200.0, 2000.0),
            ("band_nm", self.band_nm, 0.0, 0.5 * self.wavelength_nm),
            ("pixel_um", self.pixel_um, 0.1, 1e5),
            ("camera_mm", self.camera_mm, 1.0, 1e5),
            ("flash_mm", self.flash_mm, 1.0, 1e5),
            ("flash_diameter_mm", self.flash_diameter_mm, 0.0, 1e3),
            ("gloss", self.gloss, 1e-4, 0.2),
            ("blur_px", self.blur_px, 0.0, 20.0),
            ("level", self.level, 1e-6, 1e3),
            ("full_scale_e", self.full_scale_e, 1.0, 1e9),
            ("read_noise_e", self.read_noise_e, 0.0, 1e6),
        ] {
            if !(least..=most).contains(&value) {
                return bad(name, format!("is {value}; expected {least} to {most}"));
            }
        }
        if self.width.min(self.height) < 16 || self.width.max(self.height) > 4096 {
            return bad("width, height", format!("are {} × {}; expected 16 to 4096", self.width, self.height));
        }
        if !self.baseline_mm.iter().all(|b| b.abs() <= 1e4) {
            return bad("baseline_mm", format!("is {:?}", self.baseline_mm));
        }
        check_exposures(&self.exposures)
    }

    /// Probability density of dots over orientation (rad) and period (µm).
    pub fn density(&self, theta: f64, um: f64) -> f64 {
        let off = (um - self.pattern.period_um(theta.rem_euclid(PI))) / self.spread_um;
        (-0.5 * off * off).exp() / (TAU.sqrt() * self.spread_um * PI)
    }

    /// Density of dots over grating vectors (in 1/µm), each dot with its vector and the opposite one.
    fn vectors(&self, [x, y]: [f64; 2]) -> f64 {
        let lines = x.hypot(y);
        // dx dy = lines · d(lines) dθ, and d(period) = d(lines)/lines².
        if lines < 1e-3 { 0.0 } else { self.density(y.atan2(x), 1.0 / lines) / lines.powi(3) }
    }

    /// Radiance of every pixel, row 0 on top, in units of (flash intensity in W/sr) per mm² and sr.
    ///
    /// # Errors
    /// Those of [`Self::check`].
    pub fn radiance(&self) -> Result<Vec<f64>> {
        self.radiance_of(&|k| self.vectors(k))
    }

    /// Radiance of a foil with another density of dots over grating vectors (in 1/µm), such as a reproduced foil.
    ///
    /// The density covers half of the plane or all of it; a vector and its opposite are one dot.
    ///
    /// # Errors
    /// Those of [`Self::check`].
    pub fn radiance_of(&self, vectors: &(dyn Fn([f64; 2]) -> f64 + Sync)) -> Result<Vec<f64>> {
        self.check()?;
        let band: Vec<[f64; 2]> = (-WAVELENGTHS / 2..=WAVELENGTHS / 2)
            .map(|k| {
                let off = 2.0 * f64::from(k) / f64::from(WAVELENGTHS / 2);
                [(self.wavelength_nm + 0.5 * self.band_nm * off) / 1000.0, 0.5_f64.powf(off * off)]
            })
            .collect();
        let sum: f64 = band.iter().map(|b| b[1]).sum();
        let flash = disc(0.5 * self.flash_diameter_mm);
        let middle = [0.5 * (self.width - 1) as f64, 0.5 * (self.height - 1) as f64];
        let light = |i: usize| {
            let (x, y) = ((i % self.width) as f64, (i / self.width) as f64);
            let at = [(x - middle[0]) * self.pixel_um / 1000.0, (middle[1] - y) * self.pixel_um / 1000.0];
            let mut radiance = 0.0;
            for [dx, dy] in &flash {
                let source = [self.baseline_mm[0] + dx, self.baseline_mm[1] + dy, self.flash_mm];
                let (half, w, irradiance) = self.half(at, source);
                let of_band = |[lambda, weight]: &[f64; 2]| weight / sum * self.orders(half, w, *lambda, vectors);
                radiance += irradiance * band.iter().map(of_band).sum::<f64>();
            }
            radiance / flash.len() as f64
        };
        let sharp: Vec<f64> = (0..self.width * self.height).into_par_iter().map(light).collect();
        Ok(blurred(&sharp, self.width, self.blur_px))
    }

    /// Half vector, sum of cosines and irradiance at a point, with the camera above the origin.
    fn half(&self, at: [f64; 2], source: [f64; 3]) -> ([f64; 2], f64, f64) {
        let to = |[x, y, z]: [f64; 3]| {
            let d = [x - at[0], y - at[1], z];
            let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
            (d.map(|v| v / length), length)
        };
        let ((i, distance), (o, _)) = (to(source), to([0.0, 0.0, self.camera_mm]));
        ([i[0] + o[0], i[1] + o[1]], i[2] + o[2], i[2] / (distance * distance))
    }

    /// Light in all orders per unit of squared direction cosine; the integral is the incident light.
    fn orders(&self, half: [f64; 2], w: f64, lambda: f64, vectors: &(dyn Fn([f64; 2]) -> f64 + Sync)) -> f64 {
        let energy = |n: i32| libm::jn(n, PI * w * self.depth_um / lambda).powi(2);
        let square = (half[0] * half[0] + half[1] * half[1]) / (self.gloss * self.gloss);
        let zero = energy(0) * (-0.5 * square).exp() / (TAU * self.gloss * self.gloss);
        let order = |n: i32| {
            let reach = f64::from(n) * lambda;
            energy(n) * vectors(half.map(|h| h / reach)) / (reach * reach)
        };
        zero + (1..=3).map(order).sum::<f64>()
    }

    /// Positions of camera and flash.
    pub fn geometry(&self) -> Geometry {
        let focal = self.camera_mm / (self.pixel_um / 1000.0);
        let center_px = [0.5 * (self.width - 1) as f64, 0.5 * (self.height - 1) as f64];
        let camera = Camera { focal_px: [focal; 2], center_px, distortion: [0.0; 5] };
        let down = Pose {
            rotation: [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
            translation_mm: [0.0, 0.0, self.camera_mm],
        };
        Geometry {
            light_mm: Some([self.baseline_mm[0], self.baseline_mm[1], self.flash_mm]),
            wavelength_nm: Some(self.wavelength_nm),
            image_px: Some([self.width as u32, self.height as u32]),
            sigma: Uncertainty { light_mm: Some([0.0; 3]), wavelength_nm: Some(0.0), ..Uncertainty::default() },
            ..Geometry::new(camera, down)
        }
    }

    /// Writes the exposures with their `frames.json`, `geometry.json`, `truth.exr` (radiance without noise) and
    /// `scene.json`.
    ///
    /// # Errors
    /// Those of [`Self::check`]; `Output`.
    pub fn write(&self, folder: &OutputFolder) -> Result<()> {
        bracket!(self).write(folder, &self.radiance()?, self.level)?;
        folder.write("geometry.json", text(&self.geometry()).as_bytes())?;
        folder.write_json("scene.json", self)
    }
}

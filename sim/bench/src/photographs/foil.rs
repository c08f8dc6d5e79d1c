//! Photographs of foil: dots too small to be seen, whose gratings have random orientations and periods.
//!
//! The distribution is a formula, and so is the light: a pixel's radiance is the sum, over points of the flash, wavelengths of the band
//! and orders up to the third, of the density of dots whose grating vector sends that order to the camera. Nothing is counted in bins, and
//! nothing of the reconstruction's formulas is used.

use super::bracket::{bracket, check_exposures};
use super::flash::{blurred, disc};
use nacre_base::{Error, Result};
use nacre_image::OutputFolder;
use nacre_optics::geometry::{Camera, Geometry, Pose, Uncertainty, text};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// A scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FoilPhotograph {
    /// Seed of the noise.
    pub seed: u64,
    /// How periods depend on orientations.
    pub pattern: FoilPattern,
    /// Standard deviation of the period about that, in µm.
    pub spread_um: f64,
    /// Depth of the gratings, sinusoidal, peak to peak, in µm.
    pub depth_um: f64,
    /// Middle of the filter's band in nm.
    pub wavelength_nm: f64,
    /// Full width at half maximum of the filter's band in nm.
    pub band_nm: f64,
    /// Pixels.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Size of a pixel on the foil, in µm.
    pub pixel_um: f64,
    /// Camera above the foil, in mm; it looks straight down.
    pub camera_mm: f64,
    /// Flash above the foil, in mm.
    pub flash_mm: f64,
    /// From the camera to the flash, to the right and up, in mm.
    pub baseline_mm: [f64; 2],
    /// Diameter of the flash in mm.
    pub flash_diameter_mm: f64,
    /// Standard deviation of the zero order in half vectors.
    pub gloss: f64,
    /// Blur of the lens, standard deviation in pixels.
    pub blur_px: f64,
    /// Exposures, each so many times the first.
    pub exposures: Vec<f64>,
    /// Level of the brightest pixel in the first exposure, of white.
    pub level: f64,
    /// Electrons at white.
    pub full_scale_e: f64,
    /// Read noise in electrons.
    pub read_noise_e: f64,
}

/// How periods depend on orientations; all orientations are equally frequent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum FoilPattern {
    /// One period in µm: a circle.
    Circle(f64),
    /// From the first at 0° to the second at 180°, in µm: a spiral of two arms.
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

/// Wavelengths of the band.
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
    /// Refuses numbers that make no sense.
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

    /// Density of dots over orientation (rad) and period (µm): integrates to 1.
    pub fn density(&self, theta: f64, um: f64) -> f64 {
        let off = (um - self.pattern.period_um(theta.rem_euclid(PI))) / self.spread_um;
        (-0.5 * off * off).exp() / (TAU.sqrt() * self.spread_um * PI)
    }

    /// Density of dots over grating vectors (in 1/µm), of which each dot has two.
    fn vectors(&self, [x, y]: [f64; 2]) -> f64 {
        let lines = x.hypot(y);
        // dx dy = lines · d(lines) dθ, and d(period) = d(lines)/lines².
        if lines < 1e-3 { 0.0 } else { self.density(y.atan2(x), 1.0 / lines) / lines.powi(3) }
    }

    /// Radiance of every pixel, row 0 on top, in units of (flash intensity in W/sr) per mm² and sr.
    ///
    /// # Errors
    /// As [`Self::check`].
    pub fn radiance(&self) -> Result<Vec<f64>> {
        self.radiance_of(&|k| self.vectors(k))
    }

    /// The same for dots with another density over grating vectors (in 1/µm, half of the plane or all, each vector and its opposite being
    /// one dot): the photograph of a foil that was made anew.
    ///
    /// # Errors
    /// As [`Self::check`].
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

    /// Half vector, sum of cosines and irradiance at a place, with the camera over the origin.
    fn half(&self, at: [f64; 2], source: [f64; 3]) -> ([f64; 2], f64, f64) {
        let to = |[x, y, z]: [f64; 3]| {
            let d = [x - at[0], y - at[1], z];
            let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
            (d.map(|v| v / length), length)
        };
        let ((i, distance), (o, _)) = (to(source), to([0.0, 0.0, self.camera_mm]));
        ([i[0] + o[0], i[1] + o[1]], i[2] + o[2], i[2] / (distance * distance))
    }

    /// Light in all orders, per direction cosine squared: sums to the light that falls in.
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

    /// Where camera and flash are.
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

    /// Writes the exposures with their `frames.json`, `geometry.json`, `truth.exr` (radiance without noise) and `scene.json`.
    ///
    /// # Errors
    /// As [`Self::check`]; `Output`.
    pub fn write(&self, folder: &OutputFolder) -> Result<()> {
        bracket!(self).write(folder, &self.radiance()?, self.level)?;
        folder.write("geometry.json", text(&self.geometry()).as_bytes())?;
        folder.write_json("scene.json", self)
    }
}

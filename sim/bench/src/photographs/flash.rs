//! Photographs of a homogeneous diffracting surface under a flash, through a narrow-band filter.
//!
//! Every pixel is a point of the surface with its own directions to camera and flash. Radiance is summed over the
//! flash's disc and the filter's band. Each order is a Gaussian in direction cosines, whose width is set by the
//! coherence and whose integral is its efficiency. No formulas are shared with the reconstruction.

use super::bracket::{bracket, check_exposures};
use super::orders::{Orders, Surface};
use nacre_base::{Error, Result};
use nacre_image::OutputFolder;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// A scene with one flash.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FlashPhotograph {
    /// Seed of the noise.
    pub seed: u64,
    /// The surface.
    pub surface: Surface,
    /// Standard deviation of the coherence function on the surface in µm.
    pub coherence_um: f64,
    /// Centre wavelength of the filter in nm.
    pub wavelength_nm: f64,
    /// Full width at half maximum of the filter's band in nm.
    pub band_nm: f64,
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Size of a pixel on the surface, in µm.
    pub pixel_um: f64,
    /// Height of the camera above the surface in mm; it looks straight down.
    pub camera_mm: f64,
    /// Height of the flash above the surface in mm.
    pub flash_mm: f64,
    /// Position of the flash relative to the camera, to the right and up, in mm.
    pub baseline_mm: [f64; 2],
    /// Diameter of the flash in mm.
    pub flash_diameter_mm: f64,
    /// Position of the zero order in the photograph, in pixels right and down from the centre.
    pub zero_order_px: [f64; 2],
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

impl Default for FlashPhotograph {
    fn default() -> Self {
        Self {
            seed: 1,
            surface: Surface::Lattice {
                pitch_um: [20.0, 20.0],
                fill: [0.6, 0.8],
                amplitude: [1.0, 0.5],
                depth_um: 0.08,
            },
            coherence_um: 65.0,
            wavelength_nm: 680.0,
            band_nm: 10.0,
            width: 512,
            height: 512,
            pixel_um: 1000.0,
            camera_mm: 1000.0,
            flash_mm: 1000.0,
            baseline_mm: [0.0, 0.0],
            flash_diameter_mm: 5.0,
            zero_order_px: [0.0, 0.0],
            blur_px: 0.6,
            exposures: vec![1.0, 8.0, 64.0],
            level: 0.9,
            full_scale_e: 40_000.0,
            read_noise_e: 8.0,
        }
    }
}

/// Number of rings of points on the flash, and of wavelengths in the band.
const RINGS: i32 = 4;
const WAVELENGTHS: i32 = 7;

/// Number of standard deviations within which an order contributes.
const REACH: f64 = 5.0;

impl FlashPhotograph {
    /// Checks all numbers.
    ///
    /// # Errors
    /// `Input`, naming the number.
    pub fn check(&self) -> Result<()> {
        let bad = |name: &str, problem: String| Err(Error::input(name, problem, "correct the scene"));
        let positive = [
            ("coherence_um", self.coherence_um, 1e5),
            ("wavelength_nm", self.wavelength_nm, 1e4),
            ("pixel_um", self.pixel_um, 1e6),
            ("camera_mm", self.camera_mm, 1e7),
            ("flash_mm", self.flash_mm, 1e7),
            ("level", self.level, 1e3),
            ("full_scale_e", self.full_scale_e, 1e9),
        ];
        for (name, value, most) in positive {
            if !(value > 0.0 && value <= most) {
                return bad(name, format!("is {value}; expected above 0, at most {most}"));
            }
        }
        let not_negative = [
            ("band_nm", self.band_nm, 0.5 * self.wavelength_nm),
            ("flash_diameter_mm", self.flash_diameter_mm, 1e4),
            ("blur_px", self.blur_px, 20.0),
            ("read_noise_e", self.read_noise_e, 1e6),
        ];
        for (name, value, most) in not_negative {
            if !(0.0..=most).contains(&value) {
                return bad(name, format!("is {value}; expected 0 to {most}"));
            }
        }
        if self.width.min(self.height) < 8 || self.width.max(self.height) > 8192 {
            return bad("width, height", format!("are {} × {}; expected 8 to 8192", self.width, self.height));
        }
        check_exposures(&self.exposures)?;
        if self.baseline_mm.iter().chain(&self.zero_order_px).any(|v| v.is_nan() || v.abs() > 1e5) {
            return bad("baseline_mm, zero_order_px", "are too large".into());
        }
        let pitches = match self.surface {
            Surface::Lattice { pitch_um, fill, amplitude, depth_um } => {
                let shares = fill.iter().chain(&amplitude).all(|v| (0.0..=1.0).contains(v));
                if !shares || !(0.0..=10.0).contains(&depth_um) {
                    return bad("surface", "fill and amplitude are 0 to 1, the depth 0 to 10 µm".into());
                }
                pitch_um.to_vec()
            }
            Surface::Grating { period_um, depth_um, .. } | Surface::Paper { period_um, depth_um, .. } => {
                if !(0.0..=10.0).contains(&depth_um) {
                    return bad("surface.depth_um", format!("is {depth_um}; expected 0 to 10"));
                }
                vec![period_um]
            }
        };
        if pitches.iter().any(|p| !(0.2..=1000.0).contains(p)) {
            return bad("surface", format!("repeats every {pitches:?} µm; expected 0.2 to 1000"));
        }
        Ok(())
    }

    /// Positions of camera, light and zero order.
    fn geometry(&self) -> Geometry {
        let [bx, by] = self.baseline_mm;
        // The mirror point divides the baseline in proportion to the heights.
        let share = self.camera_mm / (self.camera_mm + self.flash_mm);
        Geometry { zero_mm: [bx * share, by * share], light_mm: [bx, by, self.flash_mm], camera_mm: self.camera_mm }
    }

    /// Radiance of every pixel, row 0 on top, in units of (flash intensity in W/sr) per mm² and sr.
    ///
    /// # Errors
    /// Those of [`Self::check`].
    pub fn radiance(&self) -> Result<Vec<f64>> {
        self.check()?;
        let (lambda, geometry) = (self.wavelength_nm / 1000.0, self.geometry());
        let half = 0.5 * self.band_nm / 1000.0;
        // A Gaussian band, truncated at three half widths at half maximum.
        let band: Vec<[f64; 2]> = (-WAVELENGTHS / 2..=WAVELENGTHS / 2)
            .map(|k| {
                let off = 3.0 * f64::from(k) / f64::from(WAVELENGTHS / 2);
                [lambda + off * half, 0.5_f64.powf(off * off)]
            })
            .collect();
        let sum: f64 = band.iter().map(|b| b[1]).sum();
        let band: Vec<[f64; 2]> =
            if half > 0.0 { band.into_iter().map(|[l, w]| [l, w / sum]).collect() } else { vec![[lambda, 1.0]] };
        let least = lambda - 3.0 * half;
        let orders = self.surface.orders([0.2 / (lambda + 3.0 * half), 2.0 / least], 2.0, least);
        let disc = disc(0.5 * self.flash_diameter_mm);
        let step = self.pixel_um / 1000.0;
        let middle = [0.5 * (self.width - 1) as f64, 0.5 * (self.height - 1) as f64];
        let place = |i: usize| {
            let (x, y) = ((i % self.width) as f64, (i / self.width) as f64);
            [
                geometry.zero_mm[0] + (x - middle[0] - self.zero_order_px[0]) * step,
                geometry.zero_mm[1] - (y - middle[1] - self.zero_order_px[1]) * step,
            ]
        };
        let light = |i: usize| {
            let at = place(i);
            let point = |[dx, dy]: &[f64; 2]| self.under_point(&orders, &band, &geometry, at, [*dx, *dy]);
            disc.iter().map(point).sum::<f64>() / disc.len() as f64
        };
        let sharp: Vec<f64> = (0..self.width * self.height).into_par_iter().map(light).collect();
        Ok(blurred(&sharp, self.width, self.blur_px))
    }

    /// Radiance at a point of the surface due to one point of the flash.
    fn under_point(&self, orders: &Orders, band: &[[f64; 2]], geometry: &Geometry, at: [f64; 2], off: [f64; 2]) -> f64 {
        let to = |[x, y, z]: [f64; 3]| {
            let d = [x - at[0], y - at[1], z];
            let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
            (d.map(|v| v / length), length)
        };
        let [lx, ly, lz] = geometry.light_mm;
        let (incident, distance) = to([lx + off[0], ly + off[1], lz]);
        let (seen, _) = to([0.0, 0.0, geometry.camera_mm]);
        let (u, v, w) = (-incident[0] - seen[0], -incident[1] - seen[1], incident[2] + seen[2]);
        let irradiance = incident[2] / (distance * distance);
        let mut brdf = 0.0;
        for [angle, share] in &orders.patches {
            let (sin, cos) = angle.sin_cos();
            let along = [u * cos + v * sin, v * cos - u * sin];
            for [lambda, weight] in band {
                brdf += share * weight * self.orders_at(orders, along, *lambda, w);
            }
        }
        irradiance * brdf
    }

    /// BRDF: Σ energy · Gaussian over the orders near these direction cosines. Its integral over direction cosines is
    /// the reflected energy.
    fn orders_at(&self, orders: &Orders, along: [f64; 2], lambda: f64, w: f64) -> f64 {
        // A Gaussian amplitude of this σ on the surface has σ = λ/(2π σ) in direction cosines, its square 1/√2 of
        // that.
        let sigma = lambda / (TAU * self.coherence_um * 2.0_f64.sqrt());
        let near = |axis: usize| {
            let spacing = lambda / orders.pitch_um[axis];
            if spacing == 0.0 {
                return 0..=0;
            }
            let order = |at: f64| at / spacing;
            let (from, to) = (order(along[axis] - REACH * sigma), order(along[axis] + REACH * sigma));
            from.ceil() as i32..=to.floor() as i32
        };
        let mut sum = 0.0;
        for n in near(1) {
            for m in near(0) {
                let off = |axis: usize, k: i32| along[axis] - f64::from(k) * lambda / orders.pitch_um[axis];
                let square = (off(0, m).powi(2) + off(1, n).powi(2)) / (sigma * sigma);
                if square < REACH * REACH {
                    sum += orders.at([m, n], w / lambda) * (-0.5 * square).exp();
                }
            }
        }
        sum / (TAU * sigma * sigma)
    }

    /// Writes the exposures with their `frames.json`, `truth.exr` (radiance without noise) and `scene.json` (all
    /// parameters).
    ///
    /// # Errors
    /// Those of [`Self::check`]; `Output`.
    pub fn write(&self, folder: &OutputFolder) -> Result<()> {
        bracket!(self).write(folder, &self.radiance()?, self.level)?;
        folder.write_json("scene.json", self)
    }
}

/// Positions in mm, with the camera at the origin of x and y.
struct Geometry {
    /// Position of the zero order.
    zero_mm: [f64; 2],
    light_mm: [f64; 3],
    camera_mm: f64,
}

/// Uniformly spaced points on a disc.
pub(super) fn disc(radius: f64) -> Vec<[f64; 2]> {
    if radius == 0.0 {
        return vec![[0.0, 0.0]];
    }
    (0..RINGS)
        .flat_map(|ring| {
            // Every point of a ring represents the same area.
            let n = 6 * ring + 3;
            let r = radius * ((f64::from(3 * ring * ring) + 0.5 * f64::from(n)) / f64::from(3 * RINGS * RINGS)).sqrt();
            (0..n).map(move |k| {
                let angle = TAU * (f64::from(k) + 0.5 * f64::from(ring % 2)) / f64::from(n);
                [r * angle.cos(), r * angle.sin()]
            })
        })
        .collect()
}

/// Convolves an image with a Gaussian.
pub(super) fn blurred(image: &[f64], width: usize, sigma: f64) -> Vec<f64> {
    if sigma == 0.0 {
        return image.to_vec();
    }
    let reach = (4.0 * sigma).ceil() as i64;
    let kernel: Vec<f64> = (-reach..=reach).map(|k| (-0.5 * (k as f64 / sigma).powi(2)).exp()).collect();
    let sum: f64 = kernel.iter().sum();
    let height = image.len() / width;
    let pass = |image: &[f64], along: [usize; 2], length: usize| -> Vec<f64> {
        let at = |i: usize| {
            let place = (i / along[0] % length) as i64;
            let taps = (-reach..=reach).zip(&kernel).map(|(k, weight)| {
                let to = (place + k).clamp(0, length as i64 - 1);
                weight * image[(i as i64 + (to - place) * along[0] as i64) as usize]
            });
            taps.sum::<f64>() / sum
        };
        (0..image.len()).into_par_iter().map(at).collect()
    };
    pass(&pass(image, [1, 0], width), [width, 0], height)
}

#[cfg(test)]
#[path = "flash_tests.rs"]
mod tests;

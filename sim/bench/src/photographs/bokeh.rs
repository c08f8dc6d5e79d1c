//! Photographs of an out-of-focus highlight on a grating, in which dark pixels are deep.
//!
//! Every pixel is the mean of the scene over quasi-random points, distributed as the lens blur and the pixel's area. No
//! image is convolved, so no code is shared with the deconvolution.

use super::orders::Profile;
use crate::random::{electrons, key};
use nacre_base::{Error, Result};
use nacre_image::{Attribute, OutputFolder, write_exr, write_png16_gray};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// Number of points of the scene per pixel.
const POINTS: usize = 600;

/// Number of points along each side of a pixel for the ground truth.
const TRUTH: usize = 6;

/// Code of white in the 16-bit files.
const WHITE: f64 = 65_535.0;

/// Largest level, with a margin so that noise alone does not saturate pixels.
const BRIGHTEST: f64 = 0.8;

/// A scene with a grating and a highlight.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BokehPhotograph {
    /// Seed of the noise.
    pub seed: u64,
    /// Profile of the grooves; blazed ones rise along the grating vector.
    pub profile: Profile,
    /// Duty cycle of rectangular grooves: fraction of the period that is high.
    pub duty: f64,
    /// Period in µm.
    pub period_um: f64,
    /// Peak-to-peak depth in µm.
    pub depth_um: f64,
    /// Direction of the grating vector in degrees, anticlockwise from the right.
    pub angle_deg: f64,
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Size of a pixel on the sample, in µm.
    pub pixel_um: f64,
    /// Radius of the highlight around the centre in pixels; 0 fills the photograph.
    pub highlight_px: f64,
    /// Levels at the lowest and the highest point in the highlight, as fractions of white.
    pub light: [f64; 2],
    /// Level outside the highlight, as a fraction of white.
    pub dark: f64,
    /// Standard deviation of the lens blur in pixels.
    pub blur_px: f64,
    /// Electrons at white.
    pub full_scale_e: f64,
    /// Standard deviation of the read noise in electrons.
    pub read_noise_e: f64,
}

impl Default for BokehPhotograph {
    fn default() -> Self {
        Self {
            seed: 1,
            profile: Profile::Blazed,
            duty: 0.5,
            period_um: 40.0,
            depth_um: 0.4,
            angle_deg: 0.0,
            width: 384,
            height: 320,
            pixel_um: 2.5,
            highlight_px: 0.0,
            light: [0.15, BRIGHTEST],
            dark: 0.01,
            blur_px: 2.0,
            full_scale_e: 20_000.0,
            read_noise_e: 8.0,
        }
    }
}

impl BokehPhotograph {
    /// Checks all numbers.
    ///
    /// # Errors
    /// `Input`, naming the number.
    pub fn check(&self) -> Result<()> {
        let within = [
            ("duty", self.duty, 0.05, 0.95),
            ("period_um", self.period_um, 1.0, 1e5),
            ("depth_um", self.depth_um, 1e-3, 1000.0),
            ("angle_deg", self.angle_deg, -360.0, 360.0),
            ("pixel_um", self.pixel_um, 1e-3, 1e4),
            ("highlight_px", self.highlight_px, 0.0, 1e5),
            ("light", self.light[0], 0.0, BRIGHTEST),
            ("light", self.light[1], self.light[0], BRIGHTEST),
            ("dark", self.dark, 0.0, BRIGHTEST),
            ("blur_px", self.blur_px, 0.0, 50.0),
            ("full_scale_e", self.full_scale_e, 1.0, 1e9),
            ("read_noise_e", self.read_noise_e, 0.0, 1e6),
        ];
        for (name, value, least, most) in within {
            if !(least..=most).contains(&value) {
                let problem = format!("is {value}; expected {least} to {most}");
                return Err(Error::input(name, problem, "correct the scene"));
            }
        }
        if self.width.min(self.height) < 8 || self.width.max(self.height) > 4096 {
            let problem = format!("are {} × {}; expected 8 to 4096", self.width, self.height);
            return Err(Error::input("width, height", problem, "correct the scene"));
        }
        if self.period_um < 2.0 * self.pixel_um {
            let problem = format!("is {}, less than two pixels", self.period_um);
            return Err(Error::input("period_um", problem, "give smaller pixels"));
        }
        Ok(())
    }

    /// Height in µm at a point in pixels, from 0 to the depth.
    fn height_at(&self, [x, y]: [f64; 2]) -> f64 {
        let (sin, cos) = self.angle_deg.to_radians().sin_cos();
        let phase = ((x * cos - y * sin) * self.pixel_um / self.period_um).rem_euclid(1.0);
        self.depth_um
            * match self.profile {
                Profile::Sinusoid => 0.5 + 0.5 * (TAU * phase).cos(),
                Profile::Blazed => phase,
                Profile::Rectangular => f64::from(u8::from(phase < self.duty)),
            }
    }

    /// Level at a point in pixels, without blur.
    fn light_at(&self, at: [f64; 2]) -> f64 {
        let off = [at[0] - 0.5 * (self.width - 1) as f64, at[1] - 0.5 * (self.height - 1) as f64];
        if self.highlight_px > 0.0 && off[0].hypot(off[1]) > self.highlight_px {
            return self.dark;
        }
        self.light[0] + (self.light[1] - self.light[0]) * self.height_at(at) / self.depth_um
    }

    /// Mean of a function over points around every pixel.
    fn means(&self, points: &[[f64; 2]], of: &(dyn Fn([f64; 2]) -> f64 + Sync)) -> Vec<f64> {
        let one = |i: usize| {
            let (x, y) = ((i % self.width) as f64, (i / self.width) as f64);
            points.iter().map(|[dx, dy]| of([x + dx, y + dy])).sum::<f64>() / points.len() as f64
        };
        (0..self.width * self.height).into_par_iter().map(one).collect()
    }

    /// Levels on the sensor, without noise.
    fn blurred(&self) -> Vec<f64> {
        // A golden-angle spiral has uniform density; its radii follow a Gaussian.
        let golden = TAU * (2.0 - 0.5 * (1.0 + 5_f64.sqrt()));
        let point = |k: usize| {
            let share = (k as f64 + 0.5) / POINTS as f64;
            let (radius, angle) = (self.blur_px * (-2.0 * (1.0 - share).ln()).sqrt(), golden * k as f64);
            [radius * angle.cos() + halton(k, 2) - 0.5, radius * angle.sin() + halton(k, 3) - 0.5]
        };
        let points: Vec<[f64; 2]> = (0..POINTS).map(point).collect();
        self.means(&points, &|at| self.light_at(at))
    }

    /// Level and height of the pixels without blur.
    fn truth(&self) -> [Vec<f64>; 2] {
        let place = |k: usize| (k as f64 + 0.5) / TRUTH as f64 - 0.5;
        let points: Vec<[f64; 2]> = (0..TRUTH * TRUTH).map(|k| [place(k % TRUTH), place(k / TRUTH)]).collect();
        [self.means(&points, &|at| self.light_at(at)), self.means(&points, &|at| self.height_at(at))]
    }

    /// The photograph as sensor levels, 0 (black) to 1 (white), and the same without blur and noise.
    ///
    /// # Errors
    /// Those of [`Self::check`].
    pub fn photographed(&self) -> Result<[Vec<f32>; 2]> {
        self.check()?;
        let value = |(i, light): (usize, f64)| {
            let arrived = electrons(key(&[self.seed, i as u64]), light * self.full_scale_e, self.read_noise_e);
            (arrived / self.full_scale_e) as f32
        };
        let photograph = self.blurred().into_iter().enumerate().map(value).collect();
        let [light, _] = self.truth();
        Ok([photograph, light.into_iter().map(|v| v as f32).collect()])
    }

    /// Writes `photograph.png` (16 bits, linear), `truth.exr` (level and height without blur and noise) and
    /// `scene.json`.
    ///
    /// # Errors
    /// Those of [`Self::check`]; `Output`.
    pub fn write(&self, folder: &OutputFolder) -> Result<()> {
        let [photograph, _] = self.photographed()?;
        let codes: Vec<u16> =
            photograph.iter().map(|v| (f64::from(*v) * WHITE).clamp(0.0, WHITE).round() as u16).collect();
        write_png16_gray(&folder.path("photograph.png"), self.width, self.height, &codes)?;
        let truth = self.truth();
        let attributes = [
            ("units", Attribute::Text("Y: light of white; height: µm".into())),
            ("pixel_um", Attribute::Number(self.pixel_um)),
        ];
        write_exr(&folder.path("truth.exr"), self.width, self.height, &["Y", "height"], &attributes, &|c, y, row| {
            row.iter_mut().zip(&truth[c][y * self.width..]).for_each(|(out, v)| *out = *v as f32);
        })?;
        folder.write_json("scene.json", self)
    }
}

/// The `k`-th number of Halton's sequence in `base`, in (0, 1).
fn halton(k: usize, base: usize) -> f64 {
    let (mut k, mut part, mut sum) = (k + 1, 1.0, 0.0);
    while k > 0 {
        part /= base as f64;
        sum += part * (k % base) as f64;
        k /= base;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blur_takes_the_contrast_that_a_gaussian_takes() {
        for (blur_px, angle_deg) in [(0.0, 0.0), (1.5, 0.0), (2.5, 40.0)] {
            let scene = BokehPhotograph {
                profile: Profile::Sinusoid,
                blur_px,
                angle_deg,
                width: 160,
                height: 16,
                ..BokehPhotograph::default()
            };
            let light = scene.blurred();
            let (sin, cos) = f64::to_radians(angle_deg).sin_cos();
            let turn = TAU / 16.0;
            // 160 × 16 pixels hold whole periods only if the lines are vertical.
            let (mut re, mut im, mut square) = (0.0, 0.0, 0.0);
            for (i, v) in light.iter().enumerate() {
                let phase = turn * ((i % 160) as f64 * cos - (i / 160) as f64 * sin);
                re += (v - 0.475) * phase.cos();
                im += (v - 0.475) * phase.sin();
                square += phase.cos().powi(2);
            }
            let pixel = |k: f64| if k == 0.0 { 1.0 } else { (0.5 * k).sin() / (0.5 * k) };
            let wanted = 0.325 * (-0.5 * (turn * blur_px).powi(2)).exp() * pixel(turn * cos) * pixel(turn * sin);
            let found = f64::hypot(re, im) / square;
            assert!((found / wanted - 1.0).abs() < 0.02, "{blur_px} {angle_deg}: {found} {wanted}");
        }
    }

    #[test]
    fn truth_is_what_was_asked_for() {
        let scene = BokehPhotograph { highlight_px: 50.0, ..BokehPhotograph::default() };
        let [light, height] = scene.truth();
        let middle = 160 * 384 + 192;
        assert!((light[middle] - (0.15 + 0.65 * height[middle] / 0.4)).abs() < 1e-9);
        assert!((light[0] - 0.01).abs() < 1e-12 && height.iter().all(|h| (0.0..=0.4).contains(h)));
        for change in [
            |s: &mut BokehPhotograph| s.period_um = 0.0,
            |s: &mut BokehPhotograph| s.pixel_um = f64::NAN,
            |s: &mut BokehPhotograph| s.width = 2,
            |s: &mut BokehPhotograph| s.period_um = 4.0,
            |s: &mut BokehPhotograph| s.light = [0.5, 0.2],
        ] {
            let mut scene = BokehPhotograph::default();
            change(&mut scene);
            assert!(scene.check().is_err());
        }
    }
}

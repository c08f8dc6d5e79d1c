//! Measured height fields in a scene: Stam's BRDF by the cheapest method that is as exact as asked for (see [`nacre_brdf`]).

use crate::light::Source;
use crate::light::viewer::RANGE;
use crate::material::diffraction::albedo_normalisation::{AlbedoNormalisation, sides};
use crate::material::diffraction::lobes::{along, half_cos};
use crate::material::shading::Accuracy;
use nacre_base::Result;
use nacre_base::progress::{Progress, Silent};
use nacre_brdf::{Densities, HeightField, Reflectance, Settings, TermSet, TermsRequest, Workspace};
use nacre_image::Precision;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Longest coherence in µm that sums over lights from everywhere are made with, and that the albedo is taken with.
const COARSE_UM: f64 = 32.0;
const NORM_UM: f64 = 8.0;

/// Least error that is asked of terms in single precision.
const SINGLE: f64 = 1e-3;

/// Running sums by which samples are drawn.
const COURSES: usize = 8;

/// A height field ready for use.
pub(crate) struct Relief {
    field: HeightField,
    coherence_um: f64,
    densities: Densities,
    /// The same with a coherence that is short enough for sums over the frequencies of its patch.
    coarse: Densities,
    /// Distance of these frequencies.
    bin: [f64; 2],
    /// How many to each side.
    bins: [i32; 2],
    pub reflectance: Reflectance,
    /// Directions of the patch's axes.
    pub turn: [f64; 2],
    norm: AlbedoNormalisation,
    pub lossless: bool,
    /// Running sums over frequencies, by which samples are drawn, for each of some [`COURSES`] of q, from flat views to steep ones.
    running: Vec<Vec<f64>>,
    /// How densities are computed, in words.
    pub why: String,
    /// The error that is predicted of lobes with a thousandth of the light.
    pub error: f64,
}

impl Relief {
    /// Of a height field.
    ///
    /// # Errors
    /// `Input` when its pitch does not suffice.
    pub(crate) fn new(
        field: &HeightField,
        (coherence_um, reflectance): (f64, Reflectance),
        (orientation, lossless): (f64, bool),
        error: f64,
        progress: &dyn Progress,
    ) -> Result<Self> {
        let error = error.clamp(1e-4, 0.2);
        let densities = Densities::new(field, coherence_um, error, 1e7, progress)?;
        let size = field.size_um();
        let short = 0.5 * size[0].min(size[1]);
        let short = |most: f64| Densities::new(field, short.clamp(1.0, most), error, 1e7, &Silent);
        let (coarse, shortest) = (short(COARSE_UM)?, short(NORM_UM)?);
        let norm = AlbedoNormalisation::new(&shortest, sides(field, &shortest), field.range_um(), progress)?;
        let bin = size.map(|s| 1.0 / s.min(64.0));
        let bins = bin.map(|b| (2.0 * RANGE[1] / b) as i32);
        let (sin, cos) = orientation.sin_cos();
        let (why, predicted) = (densities.choice.why.clone(), densities.choice.predicted_error);
        let mut relief = Self {
            field: field.clone(),
            coherence_um,
            densities,
            coarse,
            bin,
            bins,
            reflectance,
            turn: [cos, sin],
            norm,
            lossless,
            running: vec![],
            why,
            error: predicted,
        };
        relief.prepare();
        progress.check()?;
        Ok(relief)
    }

    /// The terms of an expansion of its phases whose densities are off by less than `error`, or by what single precision leaves of deep fields, as
    /// cards look them up.
    ///
    /// # Errors
    /// As [`TermSet::new`].
    pub(crate) fn terms(&self, error: f64, progress: &dyn Progress) -> Result<TermSet> {
        let settings =
            Settings { coherence_um: self.coherence_um, max_error: error.clamp(SINGLE, 0.2), ..Settings::default() };
        let wanted = TermsRequest { extent: 2.0, precision: Some(Precision::Float) };
        TermSet::new(&self.field, &settings, wanted, progress)
    }

    /// Width and height of the patch in µm.
    pub(crate) fn size_um(&self) -> [f64; 2] {
        self.field.size_um()
    }

    /// Standard deviation of a lobe in 1/µm.
    pub(crate) fn sigma(&self) -> f64 {
        self.densities.window.sigma
    }

    /// The same of sums over lights from everywhere.
    pub(crate) fn sigma_under(&self) -> f64 {
        self.coarse.window.sigma
    }

    /// What directions of view are divided by.
    pub(crate) fn norm(&self) -> &AlbedoNormalisation {
        &self.norm
    }

    fn prepare(&mut self) {
        let count = ((2 * self.bins[0] + 1) * (2 * self.bins[1] + 1)) as usize;
        let course = |k: usize| {
            let q = 2.0 * TAU * RANGE[1] * (k as f64 + 0.5) / COURSES as f64;
            let at = |w: &mut Workspace, k: usize| self.coarse.at(self.frequency(k), q, w);
            let raw: Vec<f64> = (0..count).into_par_iter().map_init(Workspace::default, at).collect();
            let floor = 1e-3 * raw.iter().sum::<f64>() / count as f64;
            let sum = |sum: &mut f64, v: &f64| {
                *sum += v + floor;
                Some(*sum)
            };
            raw.iter().scan(0.0, sum).collect()
        };
        self.running = (0..COURSES).map(course).collect();
    }

    /// The running sum at the q of the mirror's direction: a surface that is seen flat is nearly a mirror.
    fn running(&self, view: [f64; 3], number: f64) -> &[f64] {
        let k = (view[2] * number / RANGE[1] * COURSES as f64) as usize;
        &self.running[k.min(COURSES - 1)]
    }

    /// Frequency of a bin.
    fn frequency(&self, k: usize) -> [f64; 2] {
        let width = (2 * self.bins[0] + 1) as usize;
        let at = [(k % width) as i32 - self.bins[0], (k / width) as i32 - self.bins[1]];
        [0, 1].map(|i| f64::from(at[i]) * self.bin[i])
    }

    /// In the patch's own frame.
    fn own(&self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        let [cos, sin] = self.turn;
        [cos * x + sin * y, cos * y - sin * x, z]
    }

    /// What a direction of view is divided by, times cos θ of view.
    fn divisor(&self, view: [f64; 3], number: f64) -> f64 {
        let albedo = self.norm.at(view, number);
        if self.lossless { albedo.max(1e-9) } else { albedo.max(view[2]) }
    }

    /// BRDF times the cosine of the light at a wave number, in the patch's own frame.
    fn value(&self, light: [f64; 3], view: [f64; 3], number: f64, w: &mut Workspace, coarse: bool) -> f64 {
        let densities = if coarse { &self.coarse } else { &self.densities };
        let f = [0, 1].map(|k| (light[k] + view[k]) * number);
        let density = densities.at(f, TAU * number * (light[2] + view[2]), w);
        if density <= 0.0 {
            return 0.0;
        }
        let reflected = self.reflectance.at(half_cos(light, view), 1e3 / number);
        density * number * number * reflected * gain(light, view) / self.divisor(view, number)
    }

    /// BRDF times the cosine of a place of a small light, summed up over its spectrum: X, Y, Z.
    pub(crate) fn lit(&self, view: [f64; 3], source: &Source, accuracy: &Accuracy, w: &mut Workspace) -> [f64; 3] {
        let (view, light, seen) = (self.own(view), self.own(source.drawn()), source.seen);
        if light[2] <= 0.0 {
            return [0.0; 3];
        }
        let tangent = (light[0] + view[0]).hypot(light[1] + view[1]);
        let width = self.densities.window.sigma / tangent.max(1e-9);
        along(seen, seen.range(), width, accuracy, |number| self.value(light, view, number, w, false))
    }

    /// The same at one wave number, for sums over many directions: with the short coherence.
    pub(crate) fn at(&self, light: [f64; 3], view: [f64; 3], number: f64, w: &mut Workspace) -> f64 {
        if light[2] <= 0.0 {
            return 0.0;
        }
        self.value(self.own(light), self.own(view), number, w, true)
    }

    /// A direction of light at a wave number; it may lie below the horizon. Most are where the patch's spectrum is, the others near to the
    /// horizon, the more the flatter the view, where the gain is.
    pub(crate) fn sample(&self, view: [f64; 3], number: f64, [u, v]: [f64; 2]) -> Option<[f64; 3]> {
        let view = self.own(view);
        let rim = rim_share(view);
        if u < rim {
            let (sin, cos) = (TAU * v).sin_cos();
            let z = rim_height(view, u / rim);
            let flat = (1.0 - z * z).max(0.0).sqrt();
            return Some([flat * cos, flat * sin, z]);
        }
        let u = [((u - rim) / (1.0 - rim)).min(1.0), v];
        let running = self.running(view, number);
        let last = running.len() - 1;
        let wanted = u[0] * running[last];
        let k = running.partition_point(|r| *r <= wanted).min(last);
        let before = if k == 0 { 0.0 } else { running[k - 1] };
        let within = [((wanted - before) / (running[k] - before)).clamp(0.0, 1.0), u[1]];
        let f = self.frequency(k);
        let [x, y] = [0, 1].map(|i| (f[i] + (within[i] - 0.5) * self.bin[i]) / number - view[i]);
        let square = x * x + y * y;
        let [cos, sin] = self.turn;
        (square < 1.0).then(|| [cos * x - sin * y, sin * x + cos * y, (1.0 - square).sqrt()])
    }

    /// Density of [`Self::sample`] per solid angle.
    pub(crate) fn density(&self, light: [f64; 3], view: [f64; 3], number: f64) -> f64 {
        let (light, view) = (self.own(light), self.own(view));
        let rim = rim_share(view);
        let z = view[2].max(1e-6);
        let horizon = rim * z * (1.0 + z) / (TAU * (light[2] + z).powi(2));
        let at = [0, 1].map(|k| ((light[k] + view[k]) * number / self.bin[k]).round() as i64);
        let [w, h] = self.bins.map(i64::from);
        if at[0].abs() > w || at[1].abs() > h {
            return horizon;
        }
        let k = ((at[1] + h) * (2 * w + 1) + at[0] + w) as usize;
        let running = self.running(view, number);
        let before = if k == 0 { 0.0 } else { running[k - 1] };
        let share = (running[k] - before) / running[running.len() - 1];
        horizon + (1.0 - rim) * share / (self.bin[0] * self.bin[1]) * number * number * light[2]
    }
}

/// Part of the directions that are drawn near to the horizon.
fn rim_share(view: [f64; 3]) -> f64 {
    0.5 * (1.0 - view[2])
}

/// Cosine of a direction whose density per solid angle is as `1 / w²`.
fn rim_height([_, _, z]: [f64; 3], u: f64) -> f64 {
    let z = z.max(1e-6);
    (1.0 / (1.0 / z - u / (z * (1.0 + z))) - z).clamp(0.0, 1.0)
}

/// Stam's gain times both cosines: `(1 + ωi·ωo)² / w²`.
fn gain(light: [f64; 3], view: [f64; 3]) -> f64 {
    let dot: f64 = (0..3).map(|k| light[k] * view[k]).sum();
    let w = light[2] + view[2];
    (1.0 + dot).powi(2) / (w * w)
}

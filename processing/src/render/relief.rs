//! Measured height fields in a scene: Stam's BRDF by the cheapest method that is as exact as asked for (see [`crate::surface`]).

use super::lobes::{Accuracy, along, half_cos};
use super::spectrum::{RANGE, Seen};
use crate::Result;
use crate::progress::{Progress, Silent};
use crate::surface::{Densities, HeightField, Reflectance, Workspace};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Sines of view along a side, and wave numbers, at which the albedo is known.
const VIEWS: usize = 21;
const NUMBERS: usize = 7;

/// Most frequencies of a patch that the albedo is added up from, the brightest ones.
const BRIGHTEST: usize = 2000;

/// A height field ready for use.
pub(super) struct Relief {
    densities: Densities,
    /// The same with a coherence that is short enough for sums over the frequencies of its patch.
    coarse: Densities,
    /// Distance of these frequencies.
    bin: [f64; 2],
    /// How many to each side.
    bins: [i32; 2],
    reflectance: Reflectance,
    /// Directions of the patch's axes.
    turn: [f64; 2],
    /// Albedo times cos θ over sines of view and wave numbers.
    albedo: Vec<f64>,
    lossless: bool,
    /// Running sum over frequencies, by which samples are drawn.
    running: Vec<f64>,
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
    pub(super) fn new(
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
        let coarse = Densities::new(field, short.clamp(1.0, 1e4), error, 1e7, &Silent)?;
        let bin = size.map(|s| 1.0 / s.min(64.0));
        let bins = bin.map(|b| (2.0 * RANGE[1] / b) as i32);
        let (sin, cos) = orientation.sin_cos();
        let (why, predicted) = (densities.choice.why.clone(), densities.choice.predicted_error);
        let mut relief = Self {
            densities,
            coarse,
            bin,
            bins,
            reflectance,
            turn: [cos, sin],
            albedo: vec![],
            lossless,
            running: vec![],
            why,
            error: predicted,
        };
        relief.prepare();
        progress.check()?;
        Ok(relief)
    }

    fn prepare(&mut self) {
        let middle = TAU * 0.5 * (RANGE[0] + RANGE[1]) * 1.8;
        let count = ((2 * self.bins[0] + 1) * (2 * self.bins[1] + 1)) as usize;
        let raw: Vec<f64> = (0..count)
            .into_par_iter()
            .map_init(Workspace::default, |w, k| self.coarse.at(self.frequency(k), middle, w))
            .collect();
        let floor = 1e-3 * raw.iter().sum::<f64>() / count as f64;
        let mut sum = 0.0;
        self.running = raw
            .iter()
            .map(|v| {
                sum += v + floor;
                sum
            })
            .collect();
        let mut kept: Vec<usize> = (0..count).filter(|k| raw[*k] > 1e-7 * sum).collect();
        kept.sort_by(|a, b| raw[*b].total_cmp(&raw[*a]));
        let all: f64 = kept.iter().map(|k| raw[*k]).sum();
        kept.truncate(BRIGHTEST);
        let share = kept.iter().map(|k| raw[*k]).sum::<f64>() / all;
        self.albedo = (0..VIEWS * VIEWS * NUMBERS)
            .into_par_iter()
            .map_init(Workspace::default, |w, k| {
                let at = |k: usize| (2.0 * k as f64 / (VIEWS - 1) as f64 - 1.0) * 0.999;
                let [x, y] = [at(k % VIEWS), at(k / VIEWS % VIEWS)];
                let shrink = (0.999 / x.hypot(y).max(1e-9)).min(1.0);
                let view = [x * shrink, y * shrink];
                let z = (1.0 - view[0] * view[0] - view[1] * view[1]).max(1e-9).sqrt();
                let view = [view[0], view[1], z];
                let number = wave_number(k / (VIEWS * VIEWS));
                let mut sum = 0.0;
                // Four places of each bin, as 1/cos θi is steep at the rim.
                for (k, part) in kept.iter().flat_map(|k| (0..4).map(move |part| (*k, part))) {
                    let f = self.frequency(k);
                    let off = [part % 2, part / 2].map(|s| f64::from(s) * 0.5 - 0.25);
                    let f = [f[0] + off[0] * self.bin[0], f[1] + off[1] * self.bin[1]];
                    let light = [f[0] / number - view[0], f[1] / number - view[1]];
                    let square = light[0] * light[0] + light[1] * light[1];
                    if square < 1.0 {
                        // A cell's own width keeps grazing light finite.
                        let floor = (self.bin[0].max(self.bin[1]) / number).min(0.2);
                        let light = [light[0], light[1], (1.0 - square).sqrt().max(floor * 0.25)];
                        sum += self.coarse.at(f, TAU * number * (z + light[2]), w) * gain_cos(light, view);
                    }
                }
                sum * 0.25 / share * self.bin[0] * self.bin[1]
            })
            .collect();
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
    fn norm(&self, view: [f64; 3], number: f64) -> f64 {
        let place = |v: f64| ((v / 0.999).clamp(-1.0, 1.0) + 1.0) * 0.5 * (VIEWS - 1) as f64;
        let (x, y) = (place(view[0]), place(view[1]));
        let z = ((number - RANGE[0]) / (RANGE[1] - RANGE[0])).clamp(0.0, 1.0) * (NUMBERS - 1) as f64;
        let (i, j, k) = ((x as usize).min(VIEWS - 2), (y as usize).min(VIEWS - 2), (z as usize).min(NUMBERS - 2));
        let (u, v, w) = (x - i as f64, y - j as f64, z - k as f64);
        let at = |i: usize, j: usize, k: usize| self.albedo[(k * VIEWS + j) * VIEWS + i];
        let row = |j: usize, k: usize| at(i, j, k) * (1.0 - u) + at(i + 1, j, k) * u;
        let plane = |k: usize| row(j, k) * (1.0 - v) + row(j + 1, k) * v;
        let albedo = plane(k) * (1.0 - w) + plane(k + 1) * w;
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
        density * number * number * reflected * gain_cos(light, view) * light[2] / self.norm(view, number)
    }

    /// BRDF times the cosine of a small light, summed up over its spectrum: X, Y, Z.
    pub(super) fn lit(
        &self,
        [view, light]: [[f64; 3]; 2],
        seen: &Seen,
        accuracy: &Accuracy,
        w: &mut Workspace,
    ) -> [f64; 3] {
        let (view, light) = (self.own(view), self.own(light));
        if light[2] <= 0.0 {
            return [0.0; 3];
        }
        let tangent = (light[0] + view[0]).hypot(light[1] + view[1]);
        let width = self.densities.window.sigma / tangent.max(1e-9);
        along(seen, seen.range(), width, accuracy, |number| self.value(light, view, number, w, false))
    }

    /// The same at one wave number, for sums over many directions: with the short coherence.
    pub(super) fn at(&self, light: [f64; 3], view: [f64; 3], number: f64, w: &mut Workspace) -> f64 {
        if light[2] <= 0.0 {
            return 0.0;
        }
        self.value(self.own(light), self.own(view), number, w, true)
    }

    /// A direction of light at a wave number; it may lie below the horizon.
    pub(super) fn sample(&self, view: [f64; 3], number: f64, u: [f64; 2]) -> Option<[f64; 3]> {
        let view = self.own(view);
        let last = self.running.len() - 1;
        let wanted = u[0] * self.running[last];
        let k = self.running.partition_point(|r| *r <= wanted).min(last);
        let before = if k == 0 { 0.0 } else { self.running[k - 1] };
        let within = [((wanted - before) / (self.running[k] - before)).clamp(0.0, 1.0), u[1]];
        let f = self.frequency(k);
        let [x, y] = [0, 1].map(|i| (f[i] + (within[i] - 0.5) * self.bin[i]) / number - view[i]);
        let square = x * x + y * y;
        let [cos, sin] = self.turn;
        (square < 1.0).then(|| [cos * x - sin * y, sin * x + cos * y, (1.0 - square).sqrt()])
    }

    /// Density of [`Self::sample`] per solid angle.
    pub(super) fn density(&self, light: [f64; 3], view: [f64; 3], number: f64) -> f64 {
        let (light, view) = (self.own(light), self.own(view));
        let at = [0, 1].map(|k| ((light[k] + view[k]) * number / self.bin[k]).round() as i64);
        let [w, h] = self.bins.map(i64::from);
        if at[0].abs() > w || at[1].abs() > h {
            return 0.0;
        }
        let k = ((at[1] + h) * (2 * w + 1) + at[0] + w) as usize;
        let before = if k == 0 { 0.0 } else { self.running[k - 1] };
        let share = (self.running[k] - before) / self.running[self.running.len() - 1];
        share / (self.bin[0] * self.bin[1]) * number * number * light[2]
    }
}

fn wave_number(k: usize) -> f64 {
    RANGE[0] + (RANGE[1] - RANGE[0]) * k as f64 / (NUMBERS - 1) as f64
}

/// Stam's gain times the cosine of view: `(1 + ωi·ωo)² / (cos θi w²)`.
fn gain_cos(light: [f64; 3], view: [f64; 3]) -> f64 {
    let dot: f64 = (0..3).map(|k| light[k] * view[k]).sum();
    let w = light[2] + view[2];
    (1.0 + dot).powi(2) / (light[2] * w * w)
}

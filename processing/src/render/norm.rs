//! What Stam's BRDF of a height field gives back of light from everywhere, by which it is divided.

use super::spectrum::RANGE;
use crate::Result;
use crate::environment::solid_angle;
use crate::image::catmull_rom;
use crate::progress::Progress;
use crate::surface::{Densities, Workspace};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Most places of the patch's spectrum that are added up, the brightest ones.
const BRIGHTEST: usize = 8000;

/// Part of the brightest place's light below which a place is left out.
const DARK: f64 = 1e-7;

/// Nodes in a lobe's standard deviation, which is how fast the albedo changes where a lobe sets; cubics between them.
const FINE: f64 = 2.0;

/// Fewest and most directions of view along a side, and wave numbers.
const VIEWS: [usize; 2] = [33, 121];
const NUMBERS: [usize; 2] = [12, 48];

/// A power density changes its course within half a turn of the deepest place's phase: linear between so many nodes of it.
const NODES_PER_TURN: f64 = 16.0;
const MOST_NODES: usize = 400;

/// Albedo times cos θ over directions of view and wave numbers.
///
/// Directions lie evenly in Lambert's equal-area projection, `(x, y) / √(1 + z)`, in which the cosine is smooth at the rim.
pub(super) struct Norm {
    views: usize,
    numbers: usize,
    albedo: Vec<f32>,
}

/// The patch's spectrum at the places that hold its light.
struct Places {
    frequency: Vec<[f64; 2]>,
    /// Sides of a place.
    sides: [f64; 2],
    /// Power densities at nodes of `q`, place by place.
    power: Vec<f32>,
    nodes: usize,
    /// Nodes per unit of q.
    per_q: f64,
    /// Part of the light that the places hold.
    share: f64,
}

impl Norm {
    /// Of a height field of this depth, from densities under light of a short coherence. Frequencies are looked at in places of these
    /// sides.
    ///
    /// # Errors
    /// `Cancelled`.
    pub(super) fn new(densities: &Densities, sides: [f64; 2], depth_um: f64, progress: &dyn Progress) -> Result<Self> {
        let places = Places::new(densities, sides, depth_um);
        let lobe = densities.window.sigma / FINE;
        let within = |n: f64, [least, most]: [usize; 2]| (n.ceil() as usize).clamp(least, most);
        // In the middle a step of the projection is √2 steps of the direction cosine.
        let views = within(2.0 * 2f64.sqrt() * 1.9 / lobe, VIEWS) | 1;
        let numbers = within((RANGE[1] - RANGE[0]) / lobe, NUMBERS);
        let mut norm = Self { views, numbers, albedo: vec![] };
        progress.check()?;
        norm.albedo = (0..views * views * numbers)
            .into_par_iter()
            .map(|k| {
                if progress.cancelled() {
                    return 0.0;
                }
                let number = RANGE[0] + (RANGE[1] - RANGE[0]) * (k / (views * views)) as f64 / (numbers - 1) as f64;
                places.albedo(norm.view(k % (views * views)), number) as f32
            })
            .collect();
        progress.check()?;
        Ok(norm)
    }

    /// Direction of a node; beyond the rim, that of the rim.
    fn view(&self, k: usize) -> [f64; 3] {
        let at = |k: usize| 2.0 * k as f64 / (self.views - 1) as f64 - 1.0;
        let [x, y] = [at(k % self.views), at(k / self.views)];
        let shrink = 1.0 / x.hypot(y).max(1.0);
        let [x, y] = [x * shrink, y * shrink];
        let z = (1.0 - x * x - y * y).max(0.0);
        let scale = (1.0 + z).sqrt();
        [x * scale, y * scale, z]
    }

    /// Albedo times cos θ of view.
    pub(super) fn at(&self, view: [f64; 3], number: f64) -> f64 {
        let scale = 1.0 / (1.0 + view[2].max(0.0)).sqrt();
        let (n, m) = (self.views, self.numbers);
        let place = |v: f64| ((v * scale).clamp(-1.0, 1.0) + 1.0) * 0.5 * (n - 1) as f64;
        let (x, y) = (place(view[0]), place(view[1]));
        let z = ((number - RANGE[0]) / (RANGE[1] - RANGE[0])).clamp(0.0, 1.0) * (m - 1) as f64;
        let (i, j, k) = ((x as usize).min(n - 2), (y as usize).min(n - 2), (z as usize).min(m - 2));
        let [u, v, w] = [x - i as f64, y - j as f64, z - k as f64].map(|t| catmull_rom(t as f32));
        // Beyond the edges, the nodes there.
        let near = |i: usize, n: usize| [0, 1, 2, 3].map(|o| (i + o).saturating_sub(1).min(n - 1));
        let (columns, rows) = (near(i, n), near(j, n));
        let mut sum = 0.0;
        for (k, w) in near(k, m).into_iter().zip(w) {
            for (j, v) in rows.iter().zip(v) {
                let row = &self.albedo[(k * n + j) * n..][..n];
                let across: f32 = columns.iter().zip(u).map(|(i, u)| u * row[*i]).sum();
                sum += w * v * across;
            }
        }
        f64::from(sum)
    }
}

impl Places {
    fn new(densities: &Densities, sides: [f64; 2], depth_um: f64) -> Self {
        let most_q = 2.0 * TAU * RANGE[1];
        let nodes = ((most_q * depth_um / TAU * NODES_PER_TURN) as usize).clamp(16, MOST_NODES) + 1;
        let per_q = (nodes - 1) as f64 / most_q;
        let half = sides.map(|s| (2.0 * RANGE[1] / s) as i32);
        let width = (2 * half[0] + 1) as usize;
        let count = width * (2 * half[1] + 1) as usize;
        let frequency = |k: usize| {
            let at = [(k % width) as i32 - half[0], (k / width) as i32 - half[1]];
            [0, 1].map(|i| f64::from(at[i]) * sides[i])
        };
        // At three depths of phase, as some orders vanish at one.
        let light: Vec<f64> = (0..count)
            .into_par_iter()
            .map_init(Workspace::default, |w, k| {
                [0.35, 0.5, 0.65].iter().map(|part| densities.at(frequency(k), part * most_q, w)).sum()
            })
            .collect();
        let brightest = light.iter().fold(0.0_f64, |m, v| m.max(*v));
        let mut kept: Vec<usize> = (0..count).filter(|k| light[*k] > DARK * brightest).collect();
        kept.sort_by(|a, b| light[*b].total_cmp(&light[*a]));
        kept.truncate(BRIGHTEST);
        let share = kept.iter().map(|k| light[*k]).sum::<f64>() / light.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let mut power = vec![0.0_f32; kept.len() * nodes];
        power.par_chunks_mut(nodes).zip(&kept).for_each_init(Workspace::default, |w, (row, k)| {
            for (n, out) in row.iter_mut().enumerate() {
                *out = densities.at(frequency(*k), n as f64 / per_q, w) as f32;
            }
        });
        Self { frequency: kept.into_iter().map(frequency).collect(), sides, power, nodes, per_q, share }
    }

    /// `∬ (1 + ωi·ωo)² / w² · P(f, q) ν² / cos θi dx dy`, which is the albedo times cos θ of view before anything is divided.
    fn albedo(&self, view: [f64; 3], number: f64) -> f64 {
        let (turn, sides) = (1.0 / number, self.sides.map(|s| s / number));
        let mut sum = 0.0;
        for (f, power) in self.frequency.iter().zip(self.power.chunks_exact(self.nodes)) {
            let [x, y] = [f[0] * turn - view[0], f[1] * turn - view[1]];
            let square = x * x + y * y;
            if square > 1.2 {
                continue;
            }
            let solid = solid_angle([x, y], sides, 1);
            let z = (1.0 - square).max(0.0).sqrt();
            let w = z + view[2];
            let q = TAU * number * w * self.per_q;
            let k = (q as usize).min(self.nodes - 2);
            let share = q - k as f64;
            let density = f64::from(power[k]) * (1.0 - share) + f64::from(power[k + 1]) * share;
            let gain = (1.0 + x * view[0] + y * view[1] + z * view[2]) / w;
            sum += density * gain * gain * solid;
        }
        sum * number * number / self.share
    }
}

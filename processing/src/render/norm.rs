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

/// In views whose cosine is less, gains change within cells beyond this radius of the disc of direction cosines: they are integrated over.
const FLAT: f64 = 0.35;
const RIM: f64 = 0.9;

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
                norm.node(&places, k % (views * views), number) as f32
            })
            .collect();
        progress.check()?;
        Ok(norm)
    }

    /// Value at a node. Beyond the rim, where cubics near to it need values as well, it goes on as it came.
    fn node(&self, places: &Places, k: usize, number: f64) -> f64 {
        let at = |k: usize| 2.0 * k as f64 / (self.views - 1) as f64 - 1.0;
        let [x, y] = [at(k % self.views), at(k / self.views)];
        let radius = x.hypot(y);
        let of = |to: f64| {
            let [x, y] = [x, y].map(|v| v * to / radius.max(1e-9));
            let z = (1.0 - x * x - y * y).max(0.0);
            let scale = (1.0 + z).sqrt();
            places.albedo([x * scale, y * scale, z], number)
        };
        let beyond = radius - 1.0;
        if beyond <= 0.0 {
            of(radius)
        } else if beyond < 6.0 / (self.views - 1) as f64 {
            2.0 * of(1.0) - of(1.0 - beyond)
        } else {
            0.0
        }
    }

    /// Nodes along a side, wave numbers, and the values at the nodes: wave number by wave number, row by row.
    pub(super) fn nodes(&self) -> (usize, usize, &[f32]) {
        (self.views, self.numbers, &self.albedo)
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
        let flat = view[2] < FLAT;
        let mut sum = 0.0;
        for (f, power) in self.frequency.iter().zip(self.power.chunks_exact(self.nodes)) {
            let [x, y] = [f[0] * turn - view[0], f[1] * turn - view[1]];
            let square = x * x + y * y;
            if square > 1.2 {
                continue;
            }
            let value = |x: f64, y: f64, z: f64| {
                let w = (z + view[2]).max(1e-6);
                let gain = (1.0 + x * view[0] + y * view[1] + z * view[2]) / w;
                self.density(power, TAU * number * w) * gain * gain
            };
            sum += if flat && square > RIM * RIM {
                at_rim([x, y], sides, value)
            } else {
                value(x, y, (1.0 - square).max(0.0).sqrt()) * solid_angle([x, y], sides, 1)
            };
        }
        sum * number * number / self.share
    }

    /// Power density of a place, from its nodes.
    fn density(&self, power: &[f32], q: f64) -> f64 {
        let q = q * self.per_q;
        let k = (q as usize).min(self.nodes - 2);
        let share = q - k as f64;
        // What a shallow phase diffracts grows with its square.
        let share = if k == 0 { share * share } else { share };
        f64::from(power[k]) * (1.0 - share) + f64::from(power[k + 1]) * share
    }
}

/// Integral over the solid angle of the part of a cell of the disc of direction cosines that is above the horizon: over x by Gauss
/// in the angle whose sine it is, in which nothing is singular, over y in slices.
fn at_rim([x, y]: [f64; 2], sides: [f64; 2], value: impl Fn(f64, f64, f64) -> f64) -> f64 {
    const SLICES: usize = 2;
    const GAUSS: [(f64, f64); 2] = [(-0.577_350_269_189_625_8, 0.5), (0.577_350_269_189_625_8, 0.5)];
    let step = sides[1] / SLICES as f64;
    let mut sum = 0.0;
    for k in 0..SLICES {
        let y = y + (k as f64 + 0.5) * step - 0.5 * sides[1];
        let radius = (1.0 - y * y).max(0.0).sqrt();
        if radius == 0.0 {
            continue;
        }
        let angle = |x: f64| (x / radius).clamp(-1.0, 1.0).asin();
        let (from, to) = (angle(x - 0.5 * sides[0]), angle(x + 0.5 * sides[0]));
        if to > from {
            let at = |(node, weight): (f64, f64)| {
                let (sin, cos) = (0.5 * (from + to) + 0.5 * (to - from) * node).sin_cos();
                weight * value(radius * sin, y, radius * cos)
            };
            sum += GAUSS.map(at).iter().sum::<f64>() * (to - from) * step;
        }
    }
    sum
}

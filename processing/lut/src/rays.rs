//! Summation of all entries at once: rays through the zero order, and along each a convolution over ln r.
//!
//! Radii are processed by octave. Half the radius needs half as many rays and half as many samples for the same spacing
//! in pixels. All octaves together therefore cost a third more than the outermost.

use super::kernel::{Kernel, Weight};
use super::plane::Plane;
use nacre_image::catmull_rom;
use pulp::Arch;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Number of rays processed together.
const LANES: usize = 16;

/// Rows and rays beyond an octave that interpolation needs.
const HALO: usize = 2;

/// Minimum number of rays of an octave.
const FEWEST: usize = 32;

/// Sampling density of the photograph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fineness {
    /// Spacing of rays and of samples along them in pixels of the photograph, at the radius where it shows the mean
    /// wavelength of an octave's outer entries.
    pub spacing_px: f64,
    /// Stride from samples to rows of the table in the outermost octave. It halves with each octave inwards, where
    /// wavelengths are less dispersed.
    pub every: usize,
}

impl Fineness {
    /// Sampling density of the next octave inwards.
    pub(super) fn inward(self) -> Self {
        Self { every: (self.every / 2).max(1), ..self }
    }
}

/// Entries of one octave of radii, over ln r and angle.
pub(super) struct Octave {
    /// ln of the first row's radius in pixels, and row distance in ln r.
    first: f64,
    step: f64,
    rays: usize,
    rows: usize,
    /// Rows of `rays + 2·HALO` entries; the first lies `HALO` rays before angle 0.
    entries: Vec<Weight>,
}

/// Array sizes of an octave.
pub(super) struct Layout {
    /// Sample distance in ln r.
    step: f64,
    pub rays: usize,
    pub rows: usize,
    /// Number of samples along a ray.
    pub samples: usize,
    pub taps: usize,
}

impl Layout {
    /// Sizes for radii from half of `outer` to `outer`, in pixels.
    pub(super) fn new(outer: f64, kernel: &Kernel, fineness: Fineness) -> Self {
        let step = fineness.spacing_px / (outer * kernel.stretch());
        let [low, high] = kernel.range();
        let rays = ((TAU / step).ceil() as usize).max(FEWEST).next_multiple_of(LANES);
        let rows = (2.0_f64.ln() / (step * fineness.every as f64)).ceil() as usize + 1 + 2 * HALO;
        // The same number as in the kernel's steps.
        let taps = ((high / step).ceil() - (low / step).floor()) as usize + 4;
        Self { step, rays, rows, samples: (rows - 1) * fineness.every + taps, taps }
    }

    /// Memory of the entries in bytes.
    pub(super) fn bytes(&self) -> usize {
        self.rows * (self.rays + 2 * HALO) * size_of::<Weight>()
    }
}

impl Octave {
    /// Entries at radii from half of `outer` to `outer`, in pixels around a centre.
    pub(super) fn new(plane: &Plane, center: [f64; 2], kernel: &Kernel, outer: f64, fineness: Fineness) -> Self {
        let layout = Layout::new(outer, kernel, fineness);
        let (step, steps) = (layout.step, kernel.steps(layout.step));
        let (every, taps) = (fineness.every, steps.weights.len());
        let row_step = step * every as f64;
        let first = (0.5 * outer).ln() - HALO as f64 * row_step;
        let samples = (layout.rows - 1) * every + taps;
        // Light is sampled at ln r − q: the smallest radius belongs to the first row and the last weight.
        let least = first - (steps.first + taps as isize - 1) as f64 * step;
        let radii: Vec<f32> = (0..samples).map(|t| (least + t as f64 * step).exp() as f32).collect();
        // Samples increase with radius, but weights with wavelength, which decreases with radius.
        let weights: Vec<Weight> = steps.weights.iter().rev().copied().collect();
        let sums = weights.iter().scan(0.0, |sum, weight| {
            *sum += weight[3];
            Some(*sum)
        });
        let covered: Vec<f32> = std::iter::once(0.0).chain(sums).collect();
        let stride = layout.rays + 2 * HALO;
        let mut entries = vec![[0.0; 4]; layout.rows * stride];
        let blocks: Vec<Vec<[[f32; LANES]; 4]>> = (0..layout.rays / LANES)
            .into_par_iter()
            .map(|block| {
                let angle = |k: usize| TAU * (block * LANES + k) as f64 / layout.rays as f64;
                // Direction in the photograph of a half vector: opposite, with rows growing downwards.
                let directions = std::array::from_fn(|k| [-angle(k).cos() as f32, angle(k).sin() as f32]);
                let center = center.map(|c| c as f32);
                let (radii, weights, covered) = (&radii, &weights, &covered);
                let work = Work { plane, center, directions, radii, weights, covered, rows: layout.rows, every };
                Arch::new().dispatch(|| work.run())
            })
            .collect();
        entries.par_chunks_mut(stride).enumerate().for_each(|(row, out)| {
            for (block, rows) in blocks.iter().enumerate() {
                for k in 0..LANES {
                    out[HALO + block * LANES + k] = std::array::from_fn(|c| rows[row][c][k]);
                }
            }
            let (rays, end) = (layout.rays, out.len());
            out.copy_within(rays..rays + HALO, 0);
            out.copy_within(HALO..2 * HALO, end - HALO);
        });
        Self { first, step: row_step, rays: layout.rays, rows: layout.rows, entries }
    }

    /// Interpolated entry at ln r and an angle of 0 to 2π.
    #[inline(always)]
    pub(super) fn at(&self, log: f32, angle: f32) -> Weight {
        let down = ((log - self.first as f32) * (1.0 / self.step) as f32).clamp(1.0, (self.rows - 3) as f32);
        let across = angle * (self.rays as f64 / TAU) as f32;
        let (row, ray) = (down as usize, (across as usize).min(self.rays - 1));
        let (a, b) = (catmull_rom(down - row as f32), catmull_rom(across - ray as f32));
        let stride = self.rays + 2 * HALO;
        // The first of four taps precedes by one row and one ray.
        let first = (row - 1) * stride + ray + HALO - 1;
        let mut sum = [0.0; 4];
        for (k, weight) in a.iter().enumerate() {
            let Some(four) = self.entries.get(first + k * stride..).and_then(|r| r.first_chunk::<4>()) else { break };
            for c in 0..4 {
                let along = four[0][c] * b[0] + four[1][c] * b[1] + four[2][c] * b[2] + four[3][c] * b[3];
                sum[c] += weight * along;
            }
        }
        sum
    }
}

/// A block of rays of an octave.
struct Work<'a> {
    plane: &'a Plane,
    center: [f32; 2],
    directions: [[f32; 2]; LANES],
    radii: &'a [f32],
    /// In order of increasing sample radius.
    weights: &'a [Weight],
    /// Cumulative coverage of the weights.
    covered: &'a [f32],
    rows: usize,
    every: usize,
}

impl Work<'_> {
    #[inline(always)]
    fn run(&self) -> Vec<[[f32; LANES]; 4]> {
        let mut light = vec![[0.0; LANES]; self.radii.len()];
        let mut known = vec![[0.0; LANES]; self.radii.len()];
        for ((light, known), radius) in light.iter_mut().zip(&mut known).zip(self.radii) {
            for k in 0..LANES {
                let [x, y] = self.directions[k];
                [light[k], known[k]] = self.plane.at(self.center[0] + radius * x, self.center[1] + radius * y);
            }
        }
        // Where everything is known, coverage needs no sum; beyond the photograph, nothing contributes.
        let whole = known.iter().take_while(|lanes| lanes.iter().all(|k| *k == 1.0)).count();
        let end = known.iter().rposition(|lanes| lanes.iter().any(|k| *k != 0.0)).map_or(0, |last| last + 1);
        let row = |i: usize| {
            let first = i * self.every;
            let taps = end.saturating_sub(first).min(self.weights.len());
            let sure = whole.saturating_sub(first).min(taps);
            let (inside, border) = self.weights[..taps].split_at(sure);
            let [x, y, z] = add_up(&light[first..][..sure], inside);
            let mut sum = [x, y, z, [self.covered[sure]; LANES]];
            // Few samples are known on only some lanes.
            for ((light, known), weight) in light[first + sure..].iter().zip(&known[first + sure..]).zip(border) {
                for (sum, weight) in sum.iter_mut().zip(&weight[..3]) {
                    sum.iter_mut().zip(light).for_each(|(sum, light)| *sum += weight * light);
                }
                sum[3].iter_mut().zip(known).for_each(|(sum, known)| *sum += weight[3] * known);
            }
            sum
        };
        (0..self.rows).map(row).collect()
    }
}

/// X, Y and Z of samples along a block of rays.
#[inline(always)]
fn add_up(light: &[[f32; LANES]], weights: &[Weight]) -> [[f32; LANES]; 3] {
    let (mut x, mut y, mut z) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for (light, weight) in light.iter().zip(weights) {
        for k in 0..LANES {
            x[k] += weight[0] * light[k];
            y[k] += weight[1] * light[k];
            z[k] += weight[2] * light[k];
        }
    }
    [x, y, z]
}

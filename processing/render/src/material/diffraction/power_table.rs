//! Power densities of a height field at equidistant spatial frequencies and path factors `q`, for sums over environment
//! light.

use crate::light::viewer::RANGE;
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_base::random::Stream;
use nacre_brdf::{Densities, Workspace};
use nacre_image::catmull_rom;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Frequency spacing in standard deviations of a lobe, and nodes of `q` per turn of the phase of the deepest point.
/// Cubic interpolation has an error of 0.2 % of a lobe's light.
const STEP: f64 = 0.35;
const NODES_PER_TURN: f64 = 16.0;
const MIN_NODES: usize = 8;

/// Maximum number of values: 12 MB, computed in some seconds.
const MOST: usize = 3_000_000;

/// Random frequencies at which the table is compared with the densities.
const PROBES: usize = 1000;

/// A table of power densities.
pub(crate) struct PowerTable {
    /// Frequencies on each side of 0, and their spacing in 1/µm.
    half: [i32; 2],
    step: f64,
    /// Values of `q` per frequency, including one beyond each end, and values per unit of `q`.
    row: usize,
    per_q: f64,
    /// Densities in µm²: row by row of frequencies, then by `q`.
    power: Vec<f32>,
    /// Mean absolute error at random positions, relative to the mean density.
    pub error: f64,
}

impl PowerTable {
    /// Tabulates the densities of a field of this depth; `None` if the table would be too large or its error exceeds
    /// `error`.
    ///
    /// # Errors
    /// `Cancelled`.
    pub(crate) fn new(
        densities: &Densities,
        depth_um: f64,
        error: f64,
        progress: &dyn Progress,
    ) -> Result<Option<Self>> {
        let most_q = 2.0 * TAU * RANGE[1];
        let nodes = ((most_q * depth_um / TAU * NODES_PER_TURN).ceil().min(1e6) as usize).max(MIN_NODES);
        let per_q = nodes as f64 / most_q;
        let step = STEP * densities.window.sigma;
        // Two more than are needed, for cubic interpolation.
        let half = [(2.0 * RANGE[1] / step).min(1e6) as i32 + 2; 2];
        let [width, height] = half.map(|h| (2 * h + 1) as usize);
        let row = nodes + 3;
        if width.saturating_mul(height).saturating_mul(row) > MOST {
            return Ok(None);
        }
        let mut power = vec![0.0_f32; width * height * row];
        let reached = 2.0 * RANGE[1] + 2.0 * step;
        power.par_chunks_mut(row).enumerate().for_each_init(Workspace::default, |w, (k, values)| {
            let at = [(k % width) as i32 - half[0], (k / width) as i32 - half[1]].map(|n| f64::from(n) * step);
            if progress.cancelled() || at[0].hypot(at[1]) > reached {
                return;
            }
            for (n, value) in values[1..row - 1].iter_mut().enumerate() {
                *value = densities.at(at, n as f64 / per_q, w) as f32;
            }
            // Linear extrapolation beyond both ends.
            values[0] = 2.0 * values[1] - values[2];
            values[row - 1] = 2.0 * values[row - 2] - values[row - 3];
        });
        progress.check()?;
        let mut table = Self { half, step, row, per_q, power, error: 0.0 };
        table.error = table.compared(densities);
        Ok(Some(table).filter(|t| t.error <= error))
    }

    /// Mean absolute difference from the exact densities, relative to their mean, at random frequencies and `q`.
    fn compared(&self, densities: &Densities) -> f64 {
        let mut random = Stream::of(0);
        let (mut off, mut sum, mut w) = (0.0, 0.0, Workspace::default());
        for _ in 0..PROBES {
            let [x, y, q] = random.numbers();
            // Half of them are close to the mirror direction.
            let near = if random.next() < 0.5 { 0.1 } else { 1.0 };
            let place = [x, y].map(|v| (2.0 * v - 1.0) * RANGE[1] * near);
            let q = q * 2.0 * TAU * RANGE[1];
            let truth = densities.at(place, q, &mut w);
            off += (self.at(place, q) - truth).abs();
            sum += truth;
        }
        if sum > 0.0 { off / sum } else { 0.0 }
    }

    /// Density in µm² at a spatial frequency in 1/µm, for `q = 2π/λ · (cos θi + cos θr)` in 1/µm.
    pub(crate) fn at(&self, place: [f64; 2], q: f64) -> f64 {
        let width = (2 * self.half[0] + 1) as usize;
        let start = |k: usize| {
            let at = (place[k] / self.step + f64::from(self.half[k])).clamp(1.0, f64::from(2 * self.half[k] - 2));
            (at as usize, catmull_rom(at.fract() as f32))
        };
        let ((left, across), (top, down)) = (start(0), start(1));
        let q = (q * self.per_q).clamp(0.0, (self.row - 4) as f64);
        let k = q as usize;
        let steep = catmull_rom((q - k as f64) as f32);
        let mut sum = 0.0_f32;
        for (j, v) in down.iter().enumerate() {
            for (i, u) in across.iter().enumerate() {
                let from = ((top + j - 1) * width + left + i - 1) * self.row + k;
                let four = &self.power[from..from + 4];
                sum += u * v * four.iter().zip(steep).map(|(p, w)| p * w).sum::<f32>();
            }
        }
        f64::from(sum.max(0.0))
    }
}

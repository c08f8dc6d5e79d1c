//! Monte Carlo integration with multiple importance sampling, for any table, view and environment.

use super::{Environment, Frame, Table, geometry};
use std::f64::consts::TAU;

/// Samples half vectors in proportion to a table's entries.
pub struct Sampler<'a> {
    table: &'a Table,
    /// Cumulative sum over the entries.
    running: Vec<f64>,
}

/// An estimate and its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Radiance.
    pub radiance: [f64; 3],
    /// Standard error of the radiance.
    pub error: [f64; 3],
}

impl<'a> Sampler<'a> {
    /// Prepares the cumulative sum of a table.
    pub fn new(table: &'a Table) -> Self {
        let light = |p: &[f32; 3]| p.iter().map(|v| f64::from(v.max(0.0))).sum::<f64>();
        let mut sum = 0.0;
        let running = table.rgb.iter().map(|p| {
            sum += light(p);
            sum
        });
        Self { running: running.collect(), table }
    }

    fn draw(&self, u: [f64; 2], also: f64) -> [f64; 2] {
        let size = self.table.size;
        let wanted = u[0] * self.running[size * size - 1];
        let i = self.running.partition_point(|r| *r <= wanted).min(size * size - 1);
        let cell = self.table.cell();
        let x = (i % size) as f64 + u[1];
        let y = (size - 1 - i / size) as f64 + also;
        [x, y].map(|v| v * cell - self.table.extent)
    }

    /// Density per unit area of half vectors.
    fn density(&self, h: [f64; 2]) -> f64 {
        let size = self.table.size;
        let place = |v: f64| (v + self.table.extent) / self.table.cell();
        let [x, y] = h.map(place);
        let inside = |v: f64| (0.0..size as f64).contains(&v);
        let total = self.running[size * size - 1];
        if !inside(x) || !inside(y) || total <= 0.0 {
            return 0.0;
        }
        let i = (size - 1 - y as usize) * size + x as usize;
        let light = self.running[i] - if i == 0 { 0.0 } else { self.running[i - 1] };
        light / (total * self.table.cell().powi(2))
    }

    /// Radiance reflected towards `view`. `pairs` directions are drawn from the environment and as many from the table,
    /// weighted by the balance heuristic (Veach and Guibas 1995). The same seed gives the same estimate.
    pub fn reflected(
        &self,
        environment: &Environment,
        frame: &Frame,
        view: [f64; 3],
        pairs: usize,
        seed: u64,
    ) -> Estimate {
        let view = frame.local(view);
        let nothing = Estimate { radiance: [0.0; 3], error: [0.0; 3] };
        if view[2] <= 0.0 || pairs == 0 {
            return nothing;
        }
        let dark = self.running.last().is_none_or(|v| *v <= 0.0);
        let value = |light: [f64; 3], world: [f64; 3], radiance: [f32; 3]| {
            if light[2] <= 0.0 {
                return [0.0; 3];
            }
            let h = [light[0] + view[0], light[1] + view[1]];
            // A density over half vectors is a density over the tangential part of ωi; the factor cos θi converts it to
            // solid angle.
            let density = environment.density(world) + self.density(h) * light[2];
            let factor = geometry(light, view) / density.max(f64::MIN_POSITIVE);
            let s = self.table.at(h);
            std::array::from_fn(|c| f64::from(s[c]) * f64::from(radiance[c]) * factor)
        };
        let mut sums = [[0.0_f64; 3]; 2];
        for k in 0..pairs {
            let u = evenly(k, seed);
            let (world, radiance, _) = environment.sample([u[0], u[1]]);
            let one = value(frame.local(world), world, radiance);
            let h = self.draw([u[2], u[3]], u[4]);
            let [x, y] = [h[0] - view[0], h[1] - view[1]];
            let square = x * x + y * y;
            let other = if square < 1.0 && !dark {
                let light = [x, y, (1.0 - square).sqrt()];
                let world = frame.world(light);
                value(light, world, environment.radiance(world))
            } else {
                [0.0; 3]
            };
            for c in 0..3 {
                let v = one[c] + other[c];
                sums[0][c] += v;
                sums[1][c] += v * v;
            }
        }
        let n = pairs as f64;
        let mean = sums[0].map(|v| v / n);
        let error = std::array::from_fn(|c| ((sums[1][c] / n - mean[c] * mean[c]).max(0.0) / n).sqrt());
        Estimate { radiance: mean, error }
    }
}

/// Low-discrepancy points in the five-dimensional unit cube (Roberts' sequence, shifted by the seed).
fn evenly(k: usize, seed: u64) -> [f64; 5] {
    // The positive root of x⁶ = x + 1.
    const ROOT: f64 = 1.134_724_138_401_519_5;
    let start = (seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 11) as f64 / (1_u64 << 53) as f64;
    std::array::from_fn(|d| {
        let step = ROOT.powi(-(d as i32) - 1);
        (start * (d as f64 + 1.0) * TAU + step * (k as f64 + 0.5)).fract()
    })
}

//! Samples directions of light by a height field's power densities.
//!
//! The power of a deep field in an order depends on `q = 2π/λ (cos θi + cos θr)`, and therefore on the sampled
//! direction itself. Directions are drawn from densities at several values of `q` in turn, which cover all light above
//! the horizon for the view. The density at a single `q` may vanish where the field is bright.

use crate::light::viewer::RANGE;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Values of `q` per turn of the phase of the deepest point.
const COURSES_PER_TURN: f64 = 4.0;

/// Smallest and largest number of values of `q`.
const COURSES: [usize; 2] = [8, 24];

/// Maximum number of entries of all tables together.
const MOST: usize = 4_000_000;

/// Share of directions drawn uniformly above the horizon, so that no direction is sampled far too rarely.
const EVEN: f64 = 0.1;

/// Cumulative sums over frequencies, for sampling.
pub(crate) struct LightSampler {
    /// Frequency spacing in 1/µm.
    bin: [f64; 2],
    /// Number of frequencies on each side of zero.
    bins: [i32; 2],
    /// One cumulative sum per value of `q`, equidistant from 0 to the largest.
    running: Vec<Vec<f64>>,
}

/// A direction of view at a wave number.
#[derive(Clone, Copy)]
pub(crate) struct Sight {
    pub view: [f64; 3],
    pub number: f64,
    /// First index of `q`, and number of indices.
    courses: [usize; 2],
}

impl LightSampler {
    /// Sampler for a patch of this size and depth in µm, from densities at frequencies and `q`.
    pub(crate) fn new<W: Default + Send>(
        size: [f64; 2],
        depth_um: f64,
        density: impl Fn([f64; 2], f64, &mut W) -> f64 + Sync,
    ) -> Self {
        let bin = size.map(|s| 1.0 / s.min(64.0));
        let bins = bin.map(|b| (2.0 * RANGE[1] / b) as i32);
        let count = ((2 * bins[0] + 1) * (2 * bins[1] + 1)) as usize;
        let most = 2.0 * TAU * RANGE[1];
        let courses = (most * depth_um / TAU * COURSES_PER_TURN).ceil() as usize;
        let courses = courses.clamp(COURSES[0], COURSES[1]).min((MOST / count).max(COURSES[0]));
        let mut sampler = Self { bin, bins, running: vec![] };
        let course = |k: usize| {
            let q = most * (k as f64 + 0.5) / courses as f64;
            let at = |w: &mut W, k: usize| density(sampler.frequency(k), q, w);
            let raw: Vec<f64> = (0..count).into_par_iter().map_init(W::default, at).collect();
            let floor = 1e-3 * raw.iter().sum::<f64>() / count as f64;
            let sum = |sum: &mut f64, v: &f64| {
                *sum += v + floor;
                Some(*sum)
            };
            raw.iter().scan(0.0, sum).collect()
        };
        sampler.running = (0..courses).map(course).collect();
        sampler
    }

    /// Frequency of a bin.
    fn frequency(&self, k: usize) -> [f64; 2] {
        let width = (2 * self.bins[0] + 1) as usize;
        let at = [(k % width) as i32 - self.bins[0], (k / width) as i32 - self.bins[1]];
        [0, 1].map(|i| f64::from(at[i]) * self.bin[i])
    }

    /// Prepares a direction of view, in the patch's frame, at a wave number.
    pub(crate) fn sight(&self, view: [f64; 3], number: f64) -> Sight {
        let count = self.running.len();
        let course = |w: f64| ((0.5 * w * number / RANGE[1] * count as f64) as usize).min(count - 1);
        let [first, last] = [course(view[2]), course(1.0 + view[2])];
        Sight { view, number, courses: [first, last + 1 - first] }
    }

    /// A direction of light from three numbers from 0 to 1; it may lie below the horizon. Most follow the patch's
    /// spectrum. The others are uniform or, increasingly for grazing views, near the horizon, where the gain is large.
    pub(crate) fn sample(&self, sight: &Sight, [u, v, w]: [f64; 3]) -> Option<[f64; 3]> {
        let Sight { view, number, courses } = *sight;
        let rim = (1.0 - EVEN) * rim_share(view);
        if u < EVEN + rim {
            let z = if u < EVEN { u / EVEN } else { rim_height(view, (u - EVEN) / rim) };
            let flat = (1.0 - z * z).max(0.0).sqrt();
            let (sin, cos) = (TAU * v).sin_cos();
            return Some([flat * cos, flat * sin, z]);
        }
        let course = ((u - EVEN - rim) / (1.0 - EVEN - rim) * courses[1] as f64) as usize;
        let running = &self.running[courses[0] + course.min(courses[1] - 1)];
        let last = running.len() - 1;
        let wanted = v * running[last];
        let k = running.partition_point(|r| *r <= wanted).min(last);
        let before = if k == 0 { 0.0 } else { running[k - 1] };
        let within = [((wanted - before) / (running[k] - before)).clamp(0.0, 1.0), w];
        let f = self.frequency(k);
        let [x, y] = [0, 1].map(|i| (f[i] + (within[i] - 0.5) * self.bin[i]) / number - view[i]);
        let square = x * x + y * y;
        (square < 1.0).then(|| [x, y, (1.0 - square).sqrt()])
    }

    /// Density of [`Self::sample`] per solid angle, for a direction above the horizon.
    pub(crate) fn density(&self, sight: &Sight, light: [f64; 3]) -> f64 {
        let Sight { view, number, courses } = *sight;
        let rim = (1.0 - EVEN) * rim_share(view);
        let z = view[2].max(1e-6);
        let apart = EVEN / TAU + rim * z * (1.0 + z) / (TAU * (light[2] + z).powi(2));
        let at = [0, 1].map(|k| ((light[k] + view[k]) * number / self.bin[k]).round() as i64);
        let [w, h] = self.bins.map(i64::from);
        if at[0].abs() > w || at[1].abs() > h {
            return apart;
        }
        let k = ((at[1] + h) * (2 * w + 1) + at[0] + w) as usize;
        let share = |running: &Vec<f64>| {
            let before = if k == 0 { 0.0 } else { running[k - 1] };
            (running[k] - before) / running[running.len() - 1]
        };
        let [first, count] = courses;
        let mean = self.running[first..first + count].iter().map(share).sum::<f64>() / count as f64;
        apart + (1.0 - EVEN - rim) * mean / (self.bin[0] * self.bin[1]) * number * number * light[2]
    }
}

/// Share of directions drawn near the horizon.
fn rim_share(view: [f64; 3]) -> f64 {
    0.5 * (1.0 - view[2])
}

/// Cosine of a direction whose density per solid angle is proportional to `1 / w²`.
fn rim_height([_, _, z]: [f64; 3], u: f64) -> f64 {
    let z = z.max(1e-6);
    (1.0 / (1.0 / z - u / (z * (1.0 + z))) - z).clamp(0.0, 1.0)
}

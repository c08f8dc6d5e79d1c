//! Shading of a point: environment, multiple importance sampling, and accuracy of sums over light.

use crate::light::Sky;
use crate::light::viewer::RANGE;
use crate::material::light_pool::{self, Candidate, Pool, even};
use crate::vector::V3;
use std::f64::consts::PI;

/// Samples per pixel and pass: 2 × 2 subpixels.
pub const SAMPLES: usize = 4;

/// Samples per pixel and pass for a picture with many samples: 4 × 4 subpixels.
pub const WELL_SPREAD: usize = 16;

/// Accuracy of sums over orders and wave numbers.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Accuracy {
    /// Relative target error of each sum.
    pub error: f64,
    /// Wave-number step in standard deviations of a lobe: the trapezoid rule on a Gaussian has the error
    /// `2 exp(-2π²/step²)`.
    pub step: f64,
    /// Truncation radius of a lobe in standard deviations.
    pub reach: f64,
    /// Fixed wave-number step, if given: n bins over the spectrum.
    pub fixed: Option<f64>,
}

impl Accuracy {
    pub(crate) fn new(error: f64, bins: Option<usize>) -> Self {
        let e = error.clamp(1e-9, 0.5);
        Self {
            error: e,
            step: PI * (2.0 / (2.0 / e).ln()).sqrt(),
            reach: (-2.0 * (0.5 * e).ln()).sqrt(),
            fixed: bins.map(|n| (RANGE[1] - RANGE[0]) / n.max(1) as f64),
        }
    }
}

/// A shaded point.
pub(crate) struct Place {
    pub uv: [f64; 2],
    /// Direction of view in the point's frame.
    pub view: [f64; 3],
}

/// Adds a weighted contribution.
pub(crate) fn add(sum: &mut [f64; 3], part: [f64; 3], weight: f64) {
    sum.iter_mut().zip(part).for_each(|(s, p)| *s += p * weight);
}

/// Environment as seen from a point.
pub(crate) struct Above<'a> {
    pub sky: &'a Sky,
    /// The point's frame.
    pub frame: &'a [V3; 3],
    /// Whether the sky is visible in a direction.
    pub open: &'a (dyn Fn(V3) -> bool + Sync),
    /// Precomputed reflection of the environment by a table towards the view, if available (see
    /// [`crate::prepared_scene::flat`]).
    pub summed: Option<[f64; 3]>,
}

impl Above<'_> {
    /// Transforms a direction of the frame to the scene.
    pub(crate) fn direction(&self, local: [f64; 3]) -> V3 {
        self.frame[0] * local[0] + self.frame[1] * local[1] + self.frame[2] * local[2]
    }

    /// Radiance from a direction of the frame, linear sRGB.
    pub(crate) fn radiance(&self, local: [f64; 3]) -> [f64; 3] {
        let towards = self.direction(local);
        if (self.open)(towards) { self.sky.radiance(towards) } else { [0.0; 3] }
    }
}

/// Reflection of an environment by multiple importance sampling with the balance heuristic (Veach and Guibas 1995): one
/// direction sampled from the environment, and one from the BRDF. Two numbers from 0 to 1 select the environment's;
/// `value` is BRDF times cosine times radiance.
pub(crate) fn both_ways(
    above: &Above,
    at: [f64; 2],
    mut value: impl FnMut([f64; 3], [f64; 3]) -> [f64; 3],
    drawn: Option<[f64; 3]>,
    density: impl Fn([f64; 3]) -> f64,
) -> [f64; 3] {
    let mut sum = [0.0; 3];
    let (towards, rgb, bright) = above.sky.sample(at);
    let local = above.frame.map(|f| f.dot(&towards));
    let all = bright + density(local);
    if local[2] > 0.0 && all > 0.0 && (above.open)(towards) {
        add(&mut sum, value(local, rgb), 1.0 / all);
    }
    if let Some(local) = drawn {
        let own = density(local);
        let all = own + above.sky.density(above.direction(local));
        if own > 0.0 && all > 0.0 {
            add(&mut sum, value(local, above.radiance(local)), 1.0 / all);
        }
    }
    sum
}

/// As [`Self::both_ways`] with `COUNT` directions of each kind, of which [`Pool`] selects few to be traced: for BRDFs
/// that are cheaper than tracing. The random numbers select the environment's directions, the BRDF's by `draw`, and the
/// traced ones.
pub(crate) fn pooled<const COUNT: usize, const N: usize>(
    above: &Above,
    (at, own, pick): ([f64; 2], [f64; N], f64),
    value: impl Fn([f64; 3], [f64; 3]) -> [f64; 3],
    draw: impl Fn([f64; N]) -> Option<[f64; 3]>,
    density: impl Fn([f64; 3]) -> f64,
) -> [f64; 3] {
    const { assert!(2 * COUNT <= light_pool::MOST) }
    let mut pool = Pool::new();
    let mut put = |local: [f64; 3], towards: V3, rgb: [f64; 3], all: f64| {
        if local[2] > 0.0 && all > 0.0 {
            let part = value(local, rgb).map(|v| v / (all * COUNT as f64));
            pool.add(Candidate { local, towards, part, weight: part.iter().sum() });
        }
    };
    for k in 0..COUNT {
        let (towards, rgb, bright) = above.sky.sample(even(at, k));
        let local = above.frame.map(|f| f.dot(&towards));
        put(local, towards, rgb, bright + density(local));
        if let Some(local) = draw(even(own, k)) {
            let towards = above.direction(local);
            put(local, towards, above.sky.radiance(towards), density(local) + above.sky.density(towards));
        }
    }
    let mut sum = [0.0; 3];
    pool.chosen(pick, |one, factor| {
        if (above.open)(one.towards) {
            add(&mut sum, one.part, factor);
        }
    });
    sum
}

//! Similarity of two diffraction patterns.

use std::f64::consts::TAU;

/// Angular and radial marginal distributions of a pattern's light about its zero order; each sums to 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Marginals {
    /// By angle, anticlockwise from the right.
    pub angular: Vec<f64>,
    /// By radius.
    pub radial: Vec<f64>,
}

impl Marginals {
    /// Marginals of a photograph (`width` pixels per row) about a centre, between two radii in pixels. NaN counts as 0.
    pub fn of(light: &[f32], width: usize, [x, y]: [f64; 2], [from, to]: [f64; 2], bins: [usize; 2]) -> Self {
        let (mut angular, mut radial) = (vec![0.0; bins[0]], vec![0.0; bins[1]]);
        for (i, value) in light.iter().enumerate().filter(|(_, v)| v.is_finite()) {
            let (dx, dy) = ((i % width) as f64 - x, y - (i / width) as f64);
            let r = dx.hypot(dy);
            if r < from || r >= to {
                continue;
            }
            let turn = dy.atan2(dx).rem_euclid(TAU) / TAU;
            angular[((turn * bins[0] as f64) as usize).min(bins[0] - 1)] += f64::from(*value);
            radial[((r - from) / (to - from) * bins[1] as f64) as usize] += f64::from(*value);
        }
        for all in [&mut angular, &mut radial] {
            let sum: f64 = all.iter().sum();
            all.iter_mut().for_each(|v| *v /= sum);
        }
        Self { angular, radial }
    }
}

/// Total variation distance of two normalised distributions: 0 for equal ones, 1 for disjoint ones.
pub fn total_variation(a: &[f64], b: &[f64]) -> f64 {
    0.5 * a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum::<f64>()
}

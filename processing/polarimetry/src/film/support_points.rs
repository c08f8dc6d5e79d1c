//! Support points along a curve, and the likelihoods of each point for the nearby ones.

use crate::film::cloud::CloudPoint;
use crate::film::curve::Curve;
use crate::film::projection::{ClosestPoint, CurveSamples};
use nacre_base::vectors::vectorised;
use std::f64::consts::{PI, TAU};

/// Segments of the curve for its arc length.
const SEGMENTS: usize = 1024;

/// Spacing of support points in standard deviations of a typical point, and their minimum and maximum number.
pub(crate) const SPACING: f64 = 0.5;
const MIN_COUNT: usize = 64;
const MAX_COUNT: usize = 8192;

/// Distance in standard deviations beyond which support points are neglected.
const REACH: f64 = 6.0;

/// Equidistant support points along a curve.
pub(crate) struct SupportPoints {
    pub at: Vec<[f64; 2]>,
    /// Their orientations in rad.
    pub thetas: Vec<f64>,
    /// Arc length up to the beginning of each segment, in units of the spacing.
    index: Vec<f64>,
    /// Spacing of the support points.
    step: f64,
}

impl SupportPoints {
    pub fn new(curve: &Curve, noise: f64) -> Self {
        let turn = PI / SEGMENTS as f64;
        let mut length = vec![0.0; SEGMENTS + 1];
        for k in 0..SEGMENTS {
            let (_, t) = curve.with_tangent((k as f64 + 0.5) * turn);
            length[k + 1] = length[k] + t[0].hypot(t[1]) * turn;
        }
        let total = length[SEGMENTS].max(f64::MIN_POSITIVE);
        let count = ((total / (SPACING * noise)) as usize).clamp(MIN_COUNT, MAX_COUNT);
        let step = total / count as f64;
        let (mut thetas, mut k) = (Vec::with_capacity(count), 0);
        for i in 0..count {
            let wanted = (i as f64 + 0.5) * step;
            while k + 1 < SEGMENTS && length[k + 1] < wanted {
                k += 1;
            }
            let part = (wanted - length[k]) / (length[k + 1] - length[k]).max(f64::MIN_POSITIVE);
            thetas.push((k as f64 + part.clamp(0.0, 1.0)) * turn);
        }
        Self {
            at: thetas.iter().map(|theta| curve.at(*theta)).collect(),
            thetas,
            index: length.iter().map(|l| l / step).collect(),
            step,
        }
    }

    /// Orientation in rad at an arc length in units of the spacing, possibly fractional or beyond a full turn.
    pub fn theta(&self, arc: f64) -> f64 {
        let k = arc.floor() as usize % self.thetas.len();
        let next = self.thetas.get(k + 1).copied().unwrap_or(self.thetas[0] + PI);
        self.thetas[k] + (next - self.thetas[k]) * arc.fract()
    }

    /// Arc length of an orientation in rad, in units of the spacing.
    fn of(&self, theta: f64) -> f64 {
        let turn = theta.rem_euclid(PI) / PI * SEGMENTS as f64;
        let k = (turn as usize).min(SEGMENTS - 1);
        self.index[k] + (self.index[k + 1] - self.index[k]) * (turn - k as f64)
    }
}

/// ln of a bivariate normal density, as a function of the deviation.
pub(crate) fn log_density([a, b, c]: [f64; 3]) -> impl Fn([f64; 2]) -> f64 {
    let determinant = a * c - b * b;
    let [xx, xy, yy] = [c, -2.0 * b, a].map(|v| -0.5 * v / determinant);
    let middle = -0.5 * determinant.ln() - TAU.ln();
    move |[x, y]| middle + xx * x * x + xy * x * y + yy * y * y
}

/// Likelihood rows of some points: for each point runs of consecutive support points with their likelihoods.
#[derive(Default)]
pub(crate) struct LikelihoodRows {
    pub points: Vec<LikelihoodRow>,
    pub runs: Vec<Run>,
    /// In single precision: sums of positive numbers lose only their last digits.
    pub values: Vec<f32>,
}

/// A point. Its likelihoods are divided by a unit.
pub(crate) struct LikelihoodRow {
    /// ln of the unit.
    pub unit: f64,
    /// Likelihoods of an outlier, and of metal without a grating.
    pub outlier: f64,
    pub mirror: f64,
    /// Number of runs.
    pub runs: usize,
}

/// Consecutive support points, padded to a multiple of [`LANES`] with zero likelihood. Indices continue periodically
/// beyond the last support point.
pub(crate) struct Run {
    pub start: usize,
    pub length: usize,
}

/// Numbers processed in parallel.
pub(crate) const LANES: usize = 8;

impl LikelihoodRows {
    pub fn of(points: &[CloudPoint], curve: &Curve, curve_samples: &CurveSamples, support: &SupportPoints) -> Self {
        let mut rows = Self::default();
        let mut logs = vec![];
        vectorised(
            #[inline(always)]
            || {
                for point in points {
                    rows.add(point, curve, curve_samples, support, &mut logs);
                }
            },
        );
        rows
    }

    #[inline(always)]
    fn add(
        &mut self,
        point: &CloudPoint,
        curve: &Curve,
        curve_samples: &CurveSamples,
        support: &SupportPoints,
        logs: &mut Vec<f64>,
    ) {
        let (count, first_run) = (support.at.len(), self.runs.len());
        let density = log_density(point.covariance);
        let [a, b, c] = point.covariance;
        logs.clear();
        for ClosestPoint { theta, gradient: [x, y], .. } in curve_samples.local_minima_within(point, REACH) {
            let along = ((a * c - b * b) * (x * x + y * y)).sqrt();
            let reach = (REACH * along / support.step + 2.0).min(0.5 * count as f64);
            let first = (support.of(theta) - reach).floor().rem_euclid(count as f64) as usize % count;
            let (known, length) = (first_run..self.runs.len(), ((2.0 * reach) as usize + 1).min(count));
            let mut begun = None;
            for i in 0..=length {
                let k = (first + i) % count;
                let is_known = |run: &Run| (k + count - run.start) % count < run.length;
                if i == length || self.runs[known.clone()].iter().any(is_known) {
                    if let Some((start, from)) = begun.take() {
                        self.runs.push(Run { start, length: i - from });
                    }
                    continue;
                }
                begun.get_or_insert((k, i));
                logs.push(density([point.at[0] - support.at[k][0], point.at[1] - support.at[k][1]]));
            }
        }
        let of_mirror = curve.mirror.map(|m| density([point.at[0] - m[0], point.at[1] - m[1]]));
        let of_outlier = -PI.ln();
        let unit = logs.iter().copied().fold(of_outlier, f64::max).max(of_mirror.unwrap_or(f64::NEG_INFINITY));
        let mut logs = logs.iter();
        for run in &mut self.runs[first_run..] {
            self.values.extend(logs.by_ref().take(run.length).map(|l| (l - unit).exp() as f32));
            let padded = run.length.next_multiple_of(LANES);
            self.values.extend(std::iter::repeat_n(0.0, padded - run.length));
            run.length = padded;
        }
        self.points.push(LikelihoodRow {
            unit,
            outlier: (of_outlier - unit).exp(),
            mirror: of_mirror.map_or(0.0, |l| (l - unit).exp()),
            runs: self.runs.len() - first_run,
        });
    }
}

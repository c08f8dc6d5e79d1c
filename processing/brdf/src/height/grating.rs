//! Patches that are a part of one grating: its period and direction from few periods, also where they are no whole number.
//!
//! Peaks of a spectrum are as wide as one over the patch, so that they tell nothing of one or two periods. A grating varies along one direction:
//! the direction is the one along which a single profile explains the heights best, and its period the shortest step by which the profile
//! repeats itself. Both are then refined by least squares of a Fourier series. A profile that does not repeat within the patch is one period of
//! the surface if it lies along a side and goes on there, since the surface is the patch repeated without end.

use super::HeightField;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// Part of the variance that one profile along one direction must explain.
const EXPLAINED: f64 = 0.9;

/// Mean squared difference of a profile and itself a period on, over twice its variance, at most; and over the least of all steps.
const REPEATS: f64 = 0.03;

/// Part of a period that must be seen twice for it to be one.
const OVERLAP: f64 = 0.2;

/// Most pixels that are looked at, and most harmonics that are fitted.
const PIXELS: usize = 6000;
const HARMONICS: usize = 8;

/// Part of a profile's variance that what is seen twice must have.
const EVEN: f64 = 0.1;

/// Fewest pixels of a period.
const FEWEST: f64 = 4.0;

/// Patches of more periods have peaks in their spectrum that are as exact.
pub(super) const MANY: f64 = 6.0;

/// Periods in a row of the whole patch, in pixels, from which its steps are as fine as those of the patch.
const LEAST_PIXELS: usize = 16;

/// One grating.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Grating {
    /// Period in µm.
    pub period_um: f64,
    /// Direction of the grating vector, anticlockwise from the right, 0 to 180.
    pub direction_deg: f64,
    /// Periods that the patch holds along it, from corner to corner.
    pub periods: f64,
    /// Part of the variance of the heights that it explains.
    pub share: f64,
}

/// Heights at places in µm right and up of the patch's middle, without their mean.
struct Places {
    all: Vec<[f64; 3]>,
    variance: f64,
}

/// A profile along a direction: mean heights in bins of one pixel, and how many heights each has.
struct Profile {
    bins: Vec<[f64; 2]>,
}

impl Places {
    fn of(field: &HeightField) -> Self {
        let step = (((field.width * field.height) as f64 / PIXELS as f64).sqrt().ceil() as usize).max(1);
        let middle = |n: usize| 0.5 * (n as f64 - 1.0);
        let rows = (0..field.height).step_by(if field.height > 1 { step } else { 1 });
        let mut all: Vec<[f64; 3]> = rows
            .flat_map(|y| (0..field.width).step_by(step).map(move |x| [x, y]))
            .map(|[x, y]| {
                let at = [x as f64 - middle(field.width), middle(field.height) - y as f64];
                [at[0] * field.pixel_um, at[1] * field.pixel_um, field.um[y * field.width + x]]
            })
            .collect();
        let mean = all.iter().map(|p| p[2]).sum::<f64>() / all.len() as f64;
        all.iter_mut().for_each(|p| p[2] -= mean);
        let variance = all.iter().map(|p| p[2] * p[2]).sum::<f64>() / all.len() as f64;
        Self { all, variance }
    }

    fn profile(&self, angle: f64, bin: f64) -> Profile {
        let (sin, cos) = angle.sin_cos();
        let along = |p: &[f64; 3]| p[0] * cos + p[1] * sin;
        let [low, high] = self.all.iter().map(along).fold([f64::MAX, f64::MIN], |[a, b], v| [a.min(v), b.max(v)]);
        let first = low - 0.5 * bin;
        let mut bins = vec![[0.0; 2]; ((high - first) / bin) as usize + 1];
        for p in &self.all {
            let to = &mut bins[((along(p) - first) / bin) as usize];
            *to = [to[0] + p[2], to[1] + 1.0];
        }
        bins.iter_mut().for_each(|b| b[0] /= b[1].max(1.0));
        Profile { bins }
    }

    /// Part of the variance that a profile along an angle explains, beyond what as many bins explain by chance.
    fn explained(&self, angle: f64, bin: f64) -> f64 {
        let profile = self.profile(angle, bin);
        let filled = profile.bins.iter().filter(|b| b[1] > 0.0).count() as f64;
        let count = self.all.len() as f64;
        let kept = profile.bins.iter().map(|b| b[1] * b[0] * b[0]).sum::<f64>() / (count * self.variance);
        1.0 - (1.0 - kept) * count / (count - filled).max(1.0)
    }

    /// The direction along which one profile explains most, and how much.
    fn direction(&self, bin: f64) -> [f64; 2] {
        let of = |angle: f64| self.explained(angle, bin);
        let better = |[a, b]: [f64; 2], angle: f64| {
            let here = of(angle);
            if here > b { [angle, here] } else { [a, b] }
        };
        let mut best = (0..180).map(|k| f64::from(k) * PI / 180.0).fold([0.0, f64::MIN], better);
        let mut step = PI / 360.0;
        for _ in 0..8 {
            for side in [-1.0, 1.0] {
                best = better(best, best[0] + side * step);
            }
            step *= 0.5;
        }
        best
    }

    /// What a Fourier series with a frequency leaves of the variance.
    fn left(&self, frequency: [f64; 2], harmonics: usize) -> f64 {
        let n = 2 * harmonics + 1;
        let (mut matrix, mut right) = (DMatrix::<f64>::zeros(n, n), DVector::<f64>::zeros(n));
        let mut row = DVector::<f64>::zeros(n);
        for p in &self.all {
            let phase = TAU * (frequency[0] * p[0] + frequency[1] * p[1]);
            row[0] = 1.0;
            for k in 1..=harmonics {
                (row[2 * k - 1], row[2 * k]) = (k as f64 * phase).sin_cos();
            }
            matrix.ger(1.0, &row, &row, 1.0);
            right.axpy(p[2], &row, 1.0);
        }
        let all = self.all.len() as f64 * self.variance;
        matrix.cholesky().map_or(1.0, |c| 1.0 - c.solve(&right).dot(&right) / all)
    }
}

impl Profile {
    /// The shortest step in bins by which the profile repeats itself, if there is one.
    fn period(&self) -> Option<f64> {
        let n = self.bins.len();
        let weights: f64 = self.bins.iter().map(|b| b[1]).sum();
        let mean = self.bins.iter().map(|b| b[0] * b[1]).sum::<f64>() / weights;
        let variance = self.bins.iter().map(|b| b[1] * (b[0] - mean).powi(2)).sum::<f64>() / weights;
        let unlike = |step: usize| {
            let mut sums = [0.0; 4];
            for (a, b) in self.bins.iter().zip(&self.bins[step..]) {
                let weight = a[1].min(b[1]);
                let terms = [weight, weight * (a[0] - b[0]).powi(2), weight * a[0], weight * a[0] * a[0]];
                (0..4).for_each(|k| sums[k] += terms[k]);
            }
            let [weight, square, sum, power] = sums;
            // Where the profile is even it is like itself at any step.
            let own = (power - sum * sum / weight) / weight;
            if own > EVEN * variance { square / weight / (2.0 * variance) } else { 1.0 }
        };
        let most = (n as f64 / (1.0 + OVERLAP)) as usize;
        let all: Vec<f64> = (0..=most).map(unlike).collect();
        // Steps below the first hill are too short to see the profile change.
        let hill = (1..most).find(|k| all[*k] > 0.5 || (all[*k] > 10.0 * REPEATS && all[*k + 1] < all[*k]))?;
        let least = all.get(hill..most)?.iter().copied().fold(f64::MAX, f64::min);
        let good = |k: &usize| {
            all[*k] <= REPEATS.max(1.5 * least) && all[*k] <= all[*k - 1] && all[*k] <= all[*k + 1] && all[*k] < 0.2
        };
        let at = (hill + 1..most).find(good)?;
        let (a, b, c) = (all[at - 1], all[at], all[at + 1]);
        let bend = a - 2.0 * b + c;
        Some(at as f64 + if bend > 0.0 { (0.5 * (a - c) / bend).clamp(-0.5, 0.5) } else { 0.0 })
    }
}

impl Profile {
    fn steps(&self) -> Vec<f64> {
        self.bins.windows(2).map(|b| b[1][0] - b[0][0]).collect()
    }

    /// Whether it rises or falls all the way.
    fn is_ramp(&self) -> bool {
        let steps = self.steps();
        steps.iter().all(|d| *d > 0.0) || steps.iter().all(|d| *d < 0.0)
    }

    /// Whether its end is as near to its begin as neighbours are; steps of its own do not count.
    fn joins(&self) -> bool {
        let mut sizes: Vec<f64> = self.steps().iter().map(|d| d.abs()).collect();
        sizes.sort_by(f64::total_cmp);
        let usual = sizes.get(sizes.len() / 2).copied().unwrap_or(0.0);
        let heights = self.bins.iter().map(|b| b[0]);
        let range = heights.clone().fold(f64::MIN, f64::max) - heights.fold(f64::MAX, f64::min);
        let ends = self.bins.first().zip(self.bins.last()).map_or(0.0, |(a, b)| (a[0] - b[0]).abs());
        ends <= (3.0 * usual).max(0.02 * range)
    }
}

impl Grating {
    /// The grating that a patch is a part of, if it is of one alone.
    ///
    /// `goes_on` says whether the patch goes on without steps where it is repeated.
    pub(super) fn find(field: &HeightField, goes_on: bool) -> Option<Self> {
        let places = Places::of(field);
        if field.width < 2 * LEAST_PIXELS || places.variance <= 1e-14 {
            return None;
        }
        let step = ((field.width * field.height) as f64 / places.all.len() as f64).sqrt();
        let bin = field.pixel_um * if field.height > 1 { step.max(1.0) } else { 1.0 };
        let [angle, share] = if field.height > 1 { places.direction(bin) } else { [0.0, 1.0] };
        if share < EXPLAINED {
            return None;
        }
        let size = field.size_um();
        let across =
            |angle: f64| size[0] * angle.cos().abs() + if field.height > 1 { size[1] * angle.sin().abs() } else { 0.0 };
        let profile = places.profile(angle, bin);
        let Some(period) = profile.period().map(|p| p * bin).filter(|p| *p >= FEWEST * field.pixel_um) else {
            return whole_side(field, &profile, goes_on, angle, share);
        };
        let harmonics = ((0.5 * period / bin) as usize).clamp(1, HARMONICS);
        let found = refined(&places, period, angle, across(angle), harmonics);
        let [period_um, angle, left] = found;
        let this = Self {
            period_um,
            direction_deg: angle.to_degrees().rem_euclid(180.0),
            periods: across(angle) / period_um,
            share: 1.0 - left,
        };
        (this.share > EXPLAINED - 0.15).then_some(this)
    }

    /// One period of it as a patch of one row, along its direction: heights are means of all pixels at the same part of a period.
    pub(crate) fn whole(&self, field: &HeightField) -> HeightField {
        let (sin, cos) = self.direction_deg.to_radians().sin_cos();
        let count = ((self.period_um / field.pixel_um).ceil() as usize).max(LEAST_PIXELS);
        let middle = |n: usize| 0.5 * (n as f64 - 1.0);
        let mut sums = vec![[0.0; 2]; count];
        for (i, height) in field.um.iter().enumerate() {
            let at = [(i % field.width) as f64 - middle(field.width), middle(field.height) - (i / field.width) as f64];
            let phase = ((at[0] * cos + at[1] * sin) * field.pixel_um / self.period_um).rem_euclid(1.0);
            let to = &mut sums[((phase * count as f64) as usize).min(count - 1)];
            *to = [to[0] + height, to[1] + 1.0];
        }
        let known = |k: usize| sums[k % count][1] > 0.0;
        let value = |k: usize| sums[k % count][0] / sums[k % count][1];
        let filled = |k: usize| {
            let (left, right) = ((0..count).find(|d| known(k + count - d)), (0..count).find(|d| known(k + d)));
            let (left, right) = (left.unwrap_or(0), right.unwrap_or(0));
            if left + right == 0 {
                return value(k);
            }
            (value(k + count - left) * right as f64 + value(k + right) * left as f64) / (left + right) as f64
        };
        HeightField {
            width: count,
            height: 1,
            pixel_um: self.period_um / count as f64,
            um: (0..count).map(filled).collect(),
            ..field.clone()
        }
    }
}

/// Period, angle and what is left of the variance, the least near to those that are given.
fn refined(places: &Places, period: f64, angle: f64, size: f64, harmonics: usize) -> [f64; 3] {
    let of = |v: [f64; 2]| places.left([v[1].cos() / v[0], v[1].sin() / v[0]], harmonics);
    let mut best = [period, angle];
    let mut left = of(best);
    // A phase that is off by a tenth of a period at the patch's ends.
    let mut steps = [0.2 * period * period / size, 0.2 * period / size];
    for _ in 0..12 {
        for axis in 0..2 {
            let moved = |sign: f64| {
                let mut at = best;
                at[axis] += sign * steps[axis];
                at
            };
            let sides = [-1.0, 1.0].map(|sign| of(moved(sign)));
            let bend = sides[0] - 2.0 * left + sides[1];
            let to = if bend > 0.0 { (0.5 * (sides[0] - sides[1]) / bend).clamp(-1.0, 1.0) } else { 0.0 };
            let candidates = [moved(to), moved(-1.0), moved(1.0)];
            for at in candidates {
                let here = of(at);
                if here < left {
                    (best, left) = (at, here);
                }
            }
            steps[axis] *= 0.5;
        }
    }
    [best[0], best[1], left]
}

/// A profile along a side that does not repeat within the patch, as one period of the surface that the repeated patch is: where it goes on
/// there, or is a ramp, whose step may lie at the seam.
fn whole_side(field: &HeightField, profile: &Profile, goes_on: bool, angle: f64, share: f64) -> Option<Grating> {
    let size = field.size_um();
    let along = usize::from(angle.sin().abs() > angle.cos().abs());
    let across = if along == 0 { angle.sin().abs() * size[1] } else { angle.cos().abs() * size[0] };
    // Along a side within a pixel over the patch.
    let straight = across < 1.5 * field.pixel_um || field.height == 1;
    (straight && (goes_on && profile.joins() || profile.is_ramp())).then(|| Grating {
        period_um: size[along],
        direction_deg: 90.0 * along as f64,
        periods: 1.0,
        share,
    })
}

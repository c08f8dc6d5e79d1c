//! Period and direction of a grating from a patch with few periods, whose number may be fractional.
//!
//! Spectral peaks have a width of one over the patch and cannot resolve one or two periods. A grating varies along one
//! direction only. Its direction is the one whose mean profile explains the most height variance, and its period the
//! shortest shift by which the profile repeats. A least-squares fit of a Fourier series refines both. A short series
//! fits stepped profiles badly, so their period is refined on the profile.
//!
//! A profile that does not repeat within the patch counts as one period of the repeated patch. It must lie along a side
//! and be continuous across the seam.

use super::HeightField;
use nacre_base::statistics::median;
use nalgebra::{DMatrix, DVector};
use schemars::JsonSchema;
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// Smallest fraction of the variance that the profile along one direction explains.
const EXPLAINED: f64 = 0.9;

/// Largest mean squared difference between a profile and its copy one period further, over twice its variance; and
/// relative to the minimum over all shifts.
const REPEATS: f64 = 0.03;

/// Smallest overlap of the patch with itself, in periods.
const OVERLAP: f64 = 0.2;

/// Largest number of pixels, and of harmonics in the fit.
const PIXELS: usize = 6000;
const HARMONICS: usize = 8;

/// Smallest variance of the overlap, relative to that of the profile.
const EVEN: f64 = 0.1;

/// Thresholds of a step: multiple of the median difference between neighbours, and fraction of the profile's range.
const STEEP: [f64; 2] = [4.0, 0.1];

/// Increment of the shifts of a profile, in bins. Shifts begin at half an increment to avoid whole bins, which
/// interpolation between bins would favour.
const FINE: f64 = 0.25;

/// Relative difference below which profiles count as equal.
const ALIKE: f64 = 1e-12;

/// Smallest number of pixels per period.
const FEWEST: f64 = 4.0;

/// Number of periods above which spectral peaks are equally precise.
pub(super) const MANY: f64 = 6.0;

/// Smallest number of pixels per period of a row that replaces a patch, so that its steps are as fine as those of the
/// patch.
const LEAST_PIXELS: usize = 16;

/// Grating of which a patch is a part.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Grating {
    /// Period in µm.
    pub period_um: f64,
    /// Direction of the grating vector in degrees, anticlockwise from the right, 0 to 180.
    pub direction_deg: f64,
    /// Number of periods along the grating vector, from corner to corner of the patch.
    pub periods: f64,
    /// Fraction of the height variance that the grating explains.
    pub share: f64,
}

/// Heights at positions in µm to the right of and above the patch's centre, with zero mean.
struct Places {
    all: Vec<[f64; 3]>,
    variance: f64,
    /// Sampling step in pixels.
    step: usize,
}

/// Every `step`-th pixel of a field, as heights at positions in µm to the right of and above its centre.
fn places(field: &HeightField, step: usize) -> impl Iterator<Item = [f64; 3]> + Clone {
    let middle = |n: usize| 0.5 * (n as f64 - 1.0);
    let rows = (0..field.height).step_by(if field.height > 1 { step } else { 1 });
    rows.flat_map(move |y| (0..field.width).step_by(step).map(move |x| [x, y])).map(move |[x, y]| {
        let at = [x as f64 - middle(field.width), middle(field.height) - y as f64];
        [at[0] * field.pixel_um, at[1] * field.pixel_um, field.um[y * field.width + x]]
    })
}

/// Profile along a direction: mean heights in bins, and the number of heights in each.
struct Profile {
    bins: Vec<[f64; 2]>,
    /// Smallest difference between neighbours that counts as a step.
    steep: f64,
}

impl Places {
    fn of(field: &HeightField) -> Self {
        let step = (((field.width * field.height) as f64 / PIXELS as f64).sqrt().ceil() as usize).max(1);
        let mut all: Vec<[f64; 3]> = places(field, step).collect();
        let mean = all.iter().map(|p| p[2]).sum::<f64>() / all.len() as f64;
        all.iter_mut().for_each(|p| p[2] -= mean);
        let variance = all.iter().map(|p| p[2] * p[2]).sum::<f64>() / all.len() as f64;
        Self { all, variance, step }
    }

    fn profile(&self, angle: f64, bin: f64) -> Profile {
        Profile::of(self.all.iter().copied(), angle, bin)
    }

    /// Fraction of the variance explained by the profile along an angle, corrected for the number of bins.
    fn explained(&self, angle: f64, bin: f64) -> f64 {
        let profile = self.profile(angle, bin);
        let filled = profile.bins.iter().filter(|b| b[1] > 0.0).count() as f64;
        let count = self.all.len() as f64;
        let kept = profile.bins.iter().map(|b| b[1] * b[0] * b[0]).sum::<f64>() / (count * self.variance);
        1.0 - (1.0 - kept) * count / (count - filled).max(1.0)
    }

    /// Direction whose profile explains the largest fraction of the variance, and that fraction.
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

    /// Fraction of the variance that a Fourier series of a frequency does not explain.
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
    /// Profile of heights along an angle, in bins of a width in µm.
    fn of(places: impl Iterator<Item = [f64; 3]> + Clone, angle: f64, bin: f64) -> Self {
        let (sin, cos) = angle.sin_cos();
        let along = |p: &[f64; 3]| p[0] * cos + p[1] * sin;
        let [low, high] = places.clone().fold([f64::MAX, f64::MIN], |[a, b], p| [a.min(along(&p)), b.max(along(&p))]);
        let first = low - 0.5 * bin;
        let mut bins = vec![[0.0; 2]; ((high - first) / bin) as usize + 1];
        for p in places {
            let to = &mut bins[((along(&p) - first) / bin) as usize];
            *to = [to[0] + p[2], to[1] + 1.0];
        }
        bins.iter_mut().for_each(|b| b[0] /= b[1].max(1.0));
        let mut this = Self { bins, steep: 0.0 };
        this.steep = (STEEP[0] * this.usual_step()).max(STEEP[1] * this.range());
        this
    }

    fn differences(&self) -> Vec<f64> {
        self.bins.windows(2).map(|b| b[1][0] - b[0][0]).collect()
    }

    fn usual_step(&self) -> f64 {
        let mut sizes: Vec<f64> = self.differences().iter().map(|d| d.abs()).collect();
        median(&mut sizes).unwrap_or(0.0)
    }

    fn range(&self) -> f64 {
        let heights = self.bins.iter().map(|b| b[0]);
        heights.clone().fold(f64::MIN, f64::max) - heights.fold(f64::MAX, f64::min)
    }

    fn has_steps(&self) -> bool {
        self.differences().iter().any(|d| d.abs() > self.steep)
    }

    /// Bounds of the height at a position in bins, and weight, from the adjacent bins. Within a step, the bounds are
    /// those of the step.
    fn at(&self, place: f64) -> ([f64; 2], f64) {
        let (k, part) = (place as usize, place.fract());
        let (a, b) = (self.bins[k], self.bins[(k + usize::from(part > 0.0)).min(self.bins.len() - 1)]);
        let between = a[0] + part * (b[0] - a[0]);
        let is_step = (a[0] - b[0]).abs() > self.steep;
        (if is_step { [a[0].min(b[0]), a[0].max(b[0])] } else { [between; 2] }, a[1].min(b[1]))
    }

    /// Mean squared difference from the profile shifted by `step` bins, over twice the variance. It is 1 if the overlap
    /// is flat, as a flat part equals itself at any shift.
    fn unlike(&self, step: f64, variance: f64) -> f64 {
        let mut sums = [0.0; 4];
        let count = (self.bins.len() as f64 - step).ceil().max(0.0) as usize;
        for (i, [height, own]) in self.bins.iter().take(count).enumerate() {
            let place = i as f64 + step;
            if place > (self.bins.len() - 1) as f64 {
                break;
            }
            let ([low, high], other) = self.at(place);
            let weight = own.min(other);
            let off = height - height.clamp(low, high);
            let terms = [weight, weight * off * off, weight * height, weight * height * height];
            (0..4).for_each(|k| sums[k] += terms[k]);
        }
        let [weight, square, sum, power] = sums;
        let own = (power - sum * sum / weight) / weight;
        if own > EVEN * variance { square / weight / (2.0 * variance) } else { 1.0 }
    }

    fn variance(&self) -> f64 {
        let weights: f64 = self.bins.iter().map(|b| b[1]).sum();
        let mean = self.bins.iter().map(|b| b[0] * b[1]).sum::<f64>() / weights;
        self.bins.iter().map(|b| b[1] * (b[0] - mean).powi(2)).sum::<f64>() / weights
    }

    /// Longest shift in bins that is tested.
    fn longest(&self) -> f64 {
        self.bins.len() as f64 / (1.0 + OVERLAP)
    }

    /// Shortest shift in bins by which the profile repeats; `None` if there is none.
    fn period(&self) -> Option<f64> {
        let variance = self.variance();
        let most = (self.longest() / FINE) as usize;
        let step = |k: usize| (k as f64 + 0.5) * FINE;
        let all: Vec<f64> = (0..=most).map(|k| self.unlike(step(k), variance)).collect();
        // Before the first maximum, shifts are too short for the profile to change.
        let hill = (1..most).find(|k| all[*k] > 0.5 || (all[*k] > 10.0 * REPEATS && all[*k + 1] < all[*k]))?;
        let least = all.get(hill..most)?.iter().copied().fold(f64::MAX, f64::min);
        let good = |k: &usize| {
            all[*k] <= REPEATS.max(1.5 * least) && all[*k] <= all[*k - 1] && all[*k] <= all[*k + 1] && all[*k] < 0.2
        };
        let first = (hill + 1..most).find(good)?;
        let last = (first..most).take_while(|k| all[*k] <= all[first] + ALIKE).last()?;
        Some(0.5 * (step(first) + step(last)))
    }

    /// Period in bins of the best agreement over 1, 2, 4, … periods, within `reach` of `near`.
    fn refined(&self, near: f64, reach: f64) -> f64 {
        let variance = self.variance();
        let (mut near, mut reach, mut count) = (near, reach, 1.0);
        while count * near + reach <= self.longest() {
            let [low, high] = self.most_alike(count * near, reach, variance).map(|step| step / count);
            count *= 2.0;
            (near, reach) = (0.5 * (low + high), 0.5 * count * (high - low) + 1.0);
        }
        near
    }

    /// Bounds of the shift within `reach` of `step` with the best agreement.
    fn most_alike(&self, step: f64, reach: f64, variance: f64) -> [f64; 2] {
        let (mut middle, mut reach) = (step, reach);
        loop {
            let steps: Vec<f64> = (-20..20).map(|k| middle + reach * (f64::from(k) + 0.5) / 20.0).collect();
            let unlike: Vec<f64> = steps.iter().map(|s| self.unlike(s.max(0.0), variance)).collect();
            let least = unlike.iter().copied().fold(f64::MAX, f64::min);
            let best: Vec<f64> =
                steps.iter().zip(&unlike).filter(|(_, u)| **u <= least + ALIKE).map(|(s, _)| *s).collect();
            let [low, high] = best.iter().fold([f64::MAX, f64::MIN], |[a, b], s| [a.min(*s), b.max(*s)]);
            if best.len() > 2 || reach < 1e-3 {
                return [low, high];
            }
            (middle, reach) = (0.5 * (low + high), 0.1 * reach);
        }
    }

    /// Whether the profile is monotonic.
    fn is_ramp(&self) -> bool {
        let steps = self.differences();
        steps.iter().all(|d| *d > 0.0) || steps.iter().all(|d| *d < 0.0)
    }

    /// Whether the end of the profile continues at its beginning, compared with usual differences between neighbours
    /// without steps.
    fn joins(&self) -> bool {
        let ends = self.bins.first().zip(self.bins.last()).map_or(0.0, |(a, b)| (a[0] - b[0]).abs());
        ends <= (3.0 * self.usual_step()).max(0.02 * self.range())
    }
}

impl Grating {
    /// Finds the grating of which a patch is a part; `None` for patches of several gratings.
    ///
    /// `goes_on` states whether the repeated patch has no steps at its seams.
    pub(super) fn find(field: &HeightField, goes_on: bool) -> Option<Self> {
        let thinned = Places::of(field);
        if field.width < 2 * LEAST_PIXELS || thinned.variance <= 1e-14 {
            return None;
        }
        let bin = field.pixel_um * thinned.step as f64;
        let [angle, share] = if field.height > 1 { thinned.direction(bin) } else { [0.0, 1.0] };
        if share < EXPLAINED {
            return None;
        }
        let size = field.size_um();
        let across =
            |angle: f64| size[0] * angle.cos().abs() + if field.height > 1 { size[1] * angle.sin().abs() } else { 0.0 };
        let profile = thinned.profile(angle, bin);
        let Some(period) = profile.period().map(|p| p * bin).filter(|p| *p >= FEWEST * field.pixel_um) else {
            return whole_side(field, &profile, goes_on, angle, share);
        };
        let harmonics = ((0.5 * period / bin) as usize).clamp(1, HARMONICS);
        let [series_um, angle, left] = refined(&thinned, period, angle, across(angle), harmonics);
        let fine = Profile::of(places(field, 1), angle, field.pixel_um);
        let period_um = if fine.has_steps() {
            field.pixel_um * fine.refined(period / field.pixel_um, bin / field.pixel_um + 0.5)
        } else {
            series_um
        };
        let this = Self {
            period_um,
            direction_deg: angle.to_degrees().rem_euclid(180.0),
            periods: across(angle) / period_um,
            share: 1.0 - left,
        };
        (this.share > EXPLAINED - 0.15).then_some(this)
    }

    /// One period of the grating as a patch of one row along its direction, by averaging all pixels of the same phase.
    pub(crate) fn whole(&self, field: &HeightField) -> HeightField {
        let (sin, cos) = self.direction_deg.to_radians().sin_cos();
        let count = ((self.period_um / field.pixel_um).ceil() as usize).max(LEAST_PIXELS);
        // Sums of heights and phases in bins, and their counts.
        let mut sums = vec![[0.0; 3]; count];
        for [x, y, height] in places(field, 1) {
            let part = ((x * cos + y * sin) / self.period_um).rem_euclid(1.0) * count as f64;
            let to = &mut sums[(part as usize).min(count - 1)];
            *to = [to[0] + height, to[1] + part, to[2] + 1.0];
        }
        let known: Vec<[f64; 2]> = sums.iter().filter(|s| s[2] > 0.0).map(|s| [s[1] / s[2], s[0] / s[2]]).collect();
        let profile = Profile::of(known.iter().map(|k| [k[0], 0.0, k[1]]), 0.0, 1.0);
        // Within a step, the height is that of the nearer position.
        let at = |k: usize| {
            let (n, place) = (known.len(), k as f64 + 0.5);
            let next = known.partition_point(|p| p[0] <= place);
            let ([mut from, a], [mut to, b]) = (known[(next + n - 1) % n], known[next % n]);
            from -= if next == 0 { count as f64 } else { 0.0 };
            to += if next == n { count as f64 } else { 0.0 };
            let part = (place - from) / (to - from);
            let part = if (a - b).abs() > profile.steep { part.round() } else { part };
            a + part * (b - a)
        };
        HeightField {
            width: count,
            height: 1,
            pixel_um: self.period_um / count as f64,
            um: (0..count).map(at).collect(),
            ..field.clone()
        }
    }
}

/// Period, angle and unexplained variance at the minimum near a start.
fn refined(places: &Places, period: f64, angle: f64, size: f64, harmonics: usize) -> [f64; 3] {
    let of = |v: [f64; 2]| places.left([v[1].cos() / v[0], v[1].sin() / v[0]], harmonics);
    let mut best = [period, angle];
    let mut left = of(best);
    // A tenth of a period of phase at the ends of the patch.
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

/// Profile along a side that does not repeat within the patch, taken as one period of the repeated patch. It must be
/// continuous across the seam, or a ramp whose step may be at the seam.
fn whole_side(field: &HeightField, profile: &Profile, goes_on: bool, angle: f64, share: f64) -> Option<Grating> {
    let size = field.size_um();
    let along = usize::from(angle.sin().abs() > angle.cos().abs());
    let across = if along == 0 { angle.sin().abs() * size[1] } else { angle.cos().abs() * size[0] };
    // The profile is parallel to a side within a pixel over the patch.
    let straight = across < 1.5 * field.pixel_um || field.height == 1;
    (straight && (goes_on && profile.joins() || profile.is_ramp())).then(|| Grating {
        period_um: size[along],
        direction_deg: 90.0 * along as f64,
        periods: 1.0,
        share,
    })
}

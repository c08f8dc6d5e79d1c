//! Fit of the grating at one position of the tile, or the reason why it is undetermined.

use super::lobe::Lobe;
use super::solve::{Copy, Prior, Solution, cost_at, solve};
use super::view::Half;
use nacre_base::statistics::median;

/// Radius of the excluded zero order in standard deviations.
pub(super) const SPECULAR: f64 = 5.5;

/// Model error from non-Gaussian lobes and unequal copies: standard deviation relative to the light itself, and
/// relative to the brightest copy.
const MODEL_ERROR: [f64; 2] = [0.04, 0.004];

/// Minimum brightness of the brightest copy, in standard deviations of its noise, at a lit position.
const MIN_SNR: f64 = 6.0;

/// Number of bright copies that provide start values, and their minimum brightness relative to the brightest.
const STARTS: usize = 6;
const BRIGHT: f64 = 0.12;

/// Number of start values followed, and the number with few copies near a lobe.
const FOLLOWED_STARTS: [usize; 2] = [4, 10];

/// Number of copies near a lobe above which a few start values find all gratings. With fewer, start values surround the
/// bright copies.
const ENOUGH_COPIES: usize = 9;

/// Minimum number of copies near a lobe. Unknowns are the grating vector (with a shared length, its direction) and the
/// light, so fewer copies leave no redundancy.
const MIN_COPIES: [usize; 2] = [4, 3];

/// Fraction of a lobe's peak above which a copy is near it.
const NEAR: f64 = 0.02;

/// χ² difference, in units of the best fit's residual, above which another grating is ruled out.
const EXCLUSION_CHI2: f64 = 16.0;

/// Light of a second grating relative to the first, above which a position has several gratings.
const MAX_SECOND_GRATING: f64 = 0.12;

/// Light of higher orders relative to the first, above which a solution is rejected.
const MAX_HIGHER_ORDERS: f64 = 2.0;

/// χ² per copy in a lobe above which a fit is rejected.
const MAX_CHI2: f64 = 6.0;

/// Maximum σ of an orientation in rad (as in maps from polarization), and relative σ of a period.
const MAX_SIGMA: [f64; 2] = [0.125, 0.125];

/// Result at a position.
#[derive(Clone, Copy, Debug)]
pub(super) enum Found {
    /// A grating.
    Grating(Grating),
    /// The reason for masking.
    Masked(MaskReason),
}

/// A grating with its uncertainty.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grating {
    /// In rad, `[0, π)`, anticlockwise from the right.
    pub orientation: f64,
    /// λ/a.
    pub length: f64,
    /// Standard deviation of the orientation in rad.
    pub orientation_sigma: f64,
    /// Standard deviation of the length.
    pub length_sigma: f64,
}

/// Reason for masking.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum MaskReason {
    /// No photograph shows a copy.
    Unseen,
    /// No diffracted light.
    Dark,
    /// Several gratings fit, or the diffraction order is ambiguous.
    Ambiguous,
    /// Several gratings at the same position.
    Several,
    /// Too few copies near a lobe.
    Uncertain,
    /// No grating fits.
    Unexplained,
}

/// A photographed copy.
#[derive(Clone, Copy, Debug)]
pub(super) struct Observed {
    pub seen: Half,
    /// Light and variance; NaN if missing.
    pub light: [f32; 2],
}

/// Copies of a position outside of the zero order.
pub(super) struct DiffractedCopies {
    /// Light divided by irradiance; weights are inverse variances of camera noise.
    copies: Vec<Copy>,
    /// Light of the brightest copy.
    pub brightest: f64,
    /// Median light.
    pub median: f64,
}

impl DiffractedCopies {
    /// From photographed copies.
    ///
    /// # Errors
    /// `Unseen` without copies.
    pub fn of(observed: &[Observed], lobe: &Lobe) -> Result<Self, MaskReason> {
        let usable = observed.iter().filter(|o| o.light[0].is_finite() && o.light[1] > 0.0);
        let diffracted = usable.filter_map(|o| {
            let shape = lobe.at(&o.seen);
            let gain = o.seen.gain;
            let half = lobe.middle(&o.seen);
            let far = shape.square(half) > SPECULAR * SPECULAR && gain > 0.0;
            let weight = gain * gain / f64::from(o.light[1]);
            far.then(|| Copy { half, shape, light: f64::from(o.light[0]) / gain, weight })
        });
        let copies: Vec<Copy> = diffracted.collect();
        let mut lights: Vec<f64> = copies.iter().map(|c| c.light).collect();
        let brightest = lights.iter().copied().fold(f64::MIN, f64::max);
        let median = median(&mut lights).ok_or(MaskReason::Unseen)?;
        Ok(Self { copies, brightest, median })
    }

    /// True if no copy is near a lobe. If most copies are equally bright, the light is stray light.
    pub fn is_dark(&self) -> bool {
        let noise = self.copies.iter().filter(|c| c.light >= self.brightest).map(|c| c.weight.powf(-0.5));
        self.brightest <= MIN_SNR * noise.fold(0.0, f64::max)
            || (self.copies.len() > 8 && self.brightest < 4.0 * self.median)
    }

    /// Light relative to a unit; the model error is added to the noise.
    pub fn normalised(&self, unit: f64) -> Vec<Copy> {
        let copy = |c: &Copy| {
            let light = c.light / unit;
            let model_variance = (MODEL_ERROR[0] * light).powi(2) + MODEL_ERROR[1] * MODEL_ERROR[1];
            Copy { light, weight: 1.0 / (1.0 / (c.weight * unit * unit) + model_variance), ..*c }
        };
        self.copies.iter().map(copy).collect()
    }
}

/// Copies outside of the zero order, relative to the brightest; the error is the reason without light.
pub(super) fn copies(observed: &[Observed], lobe: &Lobe) -> Result<Vec<Copy>, MaskReason> {
    let diffracted = DiffractedCopies::of(observed, lobe)?;
    if diffracted.is_dark() { Err(MaskReason::Dark) } else { Ok(diffracted.normalised(diffracted.brightest)) }
}

/// Fits a grating to the copies.
pub(super) fn fit(copies: &[Copy], prior: &Prior) -> Found {
    let near = |s: &Solution| copies.iter().filter(|c| s.inside(c) > NEAR).count();
    let mut solutions = solutions(copies, prior, false);
    if solutions.iter().any(|s| near(s) < ENOUGH_COPIES) {
        solutions.extend(self::solutions(copies, prior, true));
    }
    // Bright higher orders with a dark first order would require a depth above a quarter of a wavelength.
    solutions.retain(|s| {
        s.orders[0] > 5.0 * s.first_sigma && s.orders[1..].iter().all(|o| *o < MAX_HIGHER_ORDERS * s.orders[0])
    });
    solutions.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let Some(best) = solutions.first() else { return Found::Masked(MaskReason::Unexplained) };
    let per_copy = chi2_per_copy(best, copies);
    let scale = per_copy.max(1.0);
    let [xx, xy, yy] = best.covariance.map(|c| c * scale);
    let length = best.vector[0].hypot(best.vector[1]);
    let [x, y] = best.vector.map(|v| v / length);
    let variance = |x: f64, y: f64| (x * x * xx + 2.0 * x * y * xy + y * y * yy).max(0.0);
    let (orientation_sigma, length_sigma) = (variance(-y, x).sqrt() / length, variance(x, y).sqrt());
    let masked = |why| Found::Masked(why);
    if has_second(best, copies) {
        return masked(MaskReason::Several);
    }
    if per_copy > MAX_CHI2 {
        return masked(MaskReason::Unexplained);
    }
    // A better solution may lie beyond the end of the searched range.
    if prior.shared.is_none() && !(prior.range[0] * 1.01..prior.range[1] * 0.99).contains(&length) {
        return masked(MaskReason::Ambiguous);
    }
    if near(best) < MIN_COPIES[usize::from(prior.shared.is_some())] {
        return masked(MaskReason::Uncertain);
    }
    if !(orientation_sigma < MAX_SIGMA[0] && length_sigma < MAX_SIGMA[1] * length) {
        return masked(MaskReason::Uncertain);
    }
    let other = |s: &&Solution| {
        let [dx, dy] = nearer(best.vector, s.vector);
        let apart = dx.hypot(dy) > 3.0 * (orientation_sigma * length).max(length_sigma).max(1e-3 * length);
        apart && s.cost - best.cost < EXCLUSION_CHI2 * scale
    };
    if solutions.iter().skip(1).any(|s| other(&s)) || is_higher_order(best, copies, prior) {
        return masked(MaskReason::Ambiguous);
    }
    let orientation = y.atan2(x).rem_euclid(std::f64::consts::PI);
    Found::Grating(Grating { orientation, length, orientation_sigma, length_sigma })
}

/// Difference of two grating vectors, irrespective of their signs.
fn nearer(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    let (minus, plus) = ([a[0] - b[0], a[1] - b[1]], [a[0] + b[0], a[1] + b[1]]);
    if minus[0].hypot(minus[1]) < plus[0].hypot(plus[1]) { minus } else { plus }
}

/// Least-squares solutions, starting near or all around the brightest copies, interpreted as first and as second
/// orders.
fn solutions(copies: &[Copy], prior: &Prior, around: bool) -> Vec<Solution> {
    let mut bright: Vec<&Copy> = copies.iter().filter(|c| c.light > BRIGHT).collect();
    bright.sort_by(|a, b| b.light.total_cmp(&a.light));
    let mut chosen: Vec<&Copy> = vec![];
    for copy in bright {
        let near = |c: &&Copy| copy.shape.square(nearer(copy.half, c.half)) < 2.0;
        if chosen.len() < STARTS && !chosen.iter().any(near) {
            chosen.push(copy);
        }
    }
    let mut starts: Vec<([f64; 2], f64)> = vec![];
    for copy in &chosen {
        for order in [1.0, 2.0] {
            for [dx, dy] in places(around) {
                let width = copy.shape.width();
                let at = [(copy.half[0] + dx * width) / order, (copy.half[1] + dy * width) / order];
                let length = at[0].hypot(at[1]);
                // Slightly beyond the range, since a copy need not lie at the lobe's peak.
                let beyond = 2.5 * width / order;
                if length < prior.range[0] - beyond || length > prior.range[1] + beyond || length == 0.0 {
                    continue;
                }
                let wanted = prior.shared.map_or(length.clamp(prior.range[0], prior.range[1]), |[shared, _]| shared);
                let start = at.map(|v| v * wanted / length);
                starts.push((start, cost_at(copies, start, prior)));
            }
        }
    }
    starts.sort_by(|a, b| a.1.total_cmp(&b.1));
    // Neighbouring start values converge to the same solution.
    let mut followed: Vec<[f64; 2]> = vec![];
    for (start, _) in &starts {
        let apart = |f: &[f64; 2]| copies.first().is_some_and(|c| c.shape.square(nearer(*start, *f)) > 0.8);
        if followed.len() < FOLLOWED_STARTS[usize::from(around)] && followed.iter().all(apart) {
            followed.push(*start);
        }
    }
    followed.iter().filter_map(|start| solve(copies, *start, prior)).collect()
}

/// Offsets of start values around a copy, in lobe widths.
fn places(around: bool) -> Vec<[f64; 2]> {
    let mut all = vec![[0.0; 2]];
    for ring in if around { 1..3 } else { 1..2 } {
        for k in 0..6 {
            let (sin, cos) = f64::sin_cos(std::f64::consts::FRAC_PI_3 * (f64::from(k) + 0.5 * f64::from(ring)));
            let far = if around { f64::from(ring) } else { 1.2 };
            all.push([far * cos, far * sin]);
        }
    }
    all
}

/// χ² per copy in a lobe and degree of freedom.
fn chi2_per_copy(best: &Solution, copies: &[Copy]) -> f64 {
    let inside = copies.iter().filter(|c| best.inside(c) > 0.05);
    let (sum, count) = inside.fold((0.0, 0), |(sum, count), c| {
        let left = c.light - best.light(c);
        (sum + c.weight * left * left, count + 1)
    });
    if count > 3 { sum / f64::from(count - 3) } else { sum }
}

/// True if a copy far from the grating's lobes is bright.
fn has_second(best: &Solution, copies: &[Copy]) -> bool {
    let first = best.orders[0];
    copies.iter().any(|c| {
        let left = c.light - best.light(c);
        left > 5.0 / c.weight.sqrt() && left > MAX_SECOND_GRATING * first * c.shape.peak && best.inside(c) < 0.01
    })
}

/// True if the light may be a second or third order: no copy at half or a third of the half vector excludes a first
/// order.
fn is_higher_order(best: &Solution, copies: &[Copy], prior: &Prior) -> bool {
    let length = best.vector[0].hypot(best.vector[1]);
    let within = |length: f64| prior.shared.map_or(length >= prior.range[0], |[l, s]| (length - l).abs() < 5.0 * s);
    [2.0, 3.0].iter().any(|order| {
        let [light, sigma] = best.light_at(copies, 1.0 / order);
        within(length / order) && light + 3.0 * sigma > 0.5 * best.orders[0]
    })
}

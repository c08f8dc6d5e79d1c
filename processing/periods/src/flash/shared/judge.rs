//! Assignment of one of a few gratings to a position, from the light of its copies.

use super::super::fit::MaskReason;
use super::super::solve::{Copy, Solution};
use nacre_base::statistics::median;

/// Minimum coverage of a pixel by its grating; the rest is a gap or the neighbouring polygon.
const MIN_COVERAGE: f64 = 0.7;

/// Maximum light relative to a fully covered pixel; print varies.
const MAX_COVERAGE: f64 = 1.3;

/// Lower bound of a second grating's coverage above which a pixel has several gratings.
const MAX_SECOND_COVERAGE: f64 = 0.4;

/// Expected brightness at full coverage, in standard deviations, above which a grating is observable at a position.
const MIN_SNR: f64 = 8.0;

/// Relative model error of a grating's light at a copy.
const TOLERANCE: f64 = 0.1;

/// Squared residual above which a copy is an outlier and is down-weighted.
const OUTLIER_CHI2: f64 = 6.0;

/// A grating is excluded when its χ² exceeds that of the best one by this multiple of the best one's residual per copy.
const EXCLUSION_CHI2: f64 = 16.0;

/// Maximum χ² per lit copy: at edges, each copy shows a different part of the polygon.
const MAX_CHI2: f64 = 12.0;

/// A copy is lit where full coverage would give this part of a lobe's peak.
const LIT_SHARE: f64 = 0.02;

/// Minimum number of copies for an estimate of stray light by their median.
const MIN_COPIES_FOR_MEDIAN: usize = 8;

/// The best of a few gratings at a position.
#[derive(Clone, Copy, Debug)]
pub(super) struct Best {
    /// Index of the grating.
    pub grating: usize,
    /// Light relative to a fully covered pixel.
    pub amount: f64,
    /// χ² per lit copy.
    pub per_copy: f64,
    /// χ² of the second-best grating minus χ² of this one.
    pub ahead: f64,
    /// Largest lower bound of another grating's coverage.
    pub second: f64,
    /// Brightest light far from the grating's lobes, relative to the peak of its first order.
    pub elsewhere: f64,
}

/// Copies within a lobe of a grating. The grating's uncertainty limits their weights, and outliers have small weights.
pub(super) fn near(copies: &[Copy], grating: &Solution) -> Vec<Copy> {
    let weighted = |c: &Copy| {
        let model = grating.light(c);
        let weight = 1.0 / (1.0 / c.weight + (TOLERANCE * model).powi(2));
        let odd = (c.light - model).powi(2) * weight / OUTLIER_CHI2;
        (model > grating.stray).then(|| Copy { weight: weight / (1.0 + odd), ..*c })
    };
    copies.iter().filter_map(weighted).collect()
}

/// Fit of one grating to a position's copies.
struct GratingFit {
    model: Vec<f64>,
    weight: Vec<f64>,
    square: f64,
    amount: f64,
    cost: f64,
    per_copy: f64,
}

fn fit_amount(copies: &[Copy], light: &[f64], all: f64, grating: &Solution) -> GratingFit {
    let model: Vec<f64> = copies.iter().map(|c| grating.light(c) - grating.stray).collect();
    let weight = copies.iter().zip(&model).map(|(c, m)| 1.0 / (1.0 / c.weight + (TOLERANCE * m).powi(2)));
    let weight: Vec<f64> = weight.collect();
    let in_lobe = || (0..copies.len()).filter(|i| model[*i] > 0.0);
    let square: f64 = in_lobe().map(|i| weight[i] * model[i] * model[i]).sum();
    let product: f64 = in_lobe().map(|i| weight[i] * model[i] * light[i]).sum();
    let amount = if square > MIN_SNR * MIN_SNR { (product / square).clamp(0.0, MAX_COVERAGE) } else { 0.0 };
    let (mut cost, mut lit, mut left) = (all, 0, 0.0);
    for i in in_lobe() {
        let squares = weight[i] * (light[i] - amount * model[i]).powi(2);
        cost += squares - copies[i].weight * light[i] * light[i];
        if model[i] > LIT_SHARE * grating.orders[0] * copies[i].shape.peak {
            (lit, left) = (lit + 1, left + squares);
        }
    }
    GratingFit { model, weight, square, amount, cost, per_copy: left / lit.max(1) as f64 }
}

/// The grating with the lowest χ²; `None` if no grating has light.
pub(super) fn best(copies: &[Copy], gratings: &[Solution]) -> Option<Best> {
    let mut lights: Vec<f64> = copies.iter().map(|c| c.light).collect();
    let known = gratings.first()?.stray;
    let stray = if copies.len() >= MIN_COPIES_FOR_MEDIAN { median(&mut lights).unwrap_or(known) } else { known };
    let light: Vec<f64> = copies.iter().map(|c| c.light - stray).collect();
    let all: f64 = copies.iter().zip(&light).map(|(c, y)| c.weight * y * y).sum();
    let of: Vec<GratingFit> = gratings.iter().map(|g| fit_amount(copies, &light, all, g)).collect();
    let order = (0..of.len()).filter(|k| of[*k].amount > 0.0);
    let grating = order.min_by(|a, b| of[*a].cost.total_cmp(&of[*b].cost))?;
    let own = &of[grating];
    let next = (0..of.len()).filter(|k| *k != grating).map(|k| of[k].cost).fold(all, f64::min);
    let per_copy = own.per_copy;
    let beside = |k: usize| second_coverage(copies, &light, own, &of[k], per_copy.max(1.0).sqrt());
    let second = (0..of.len()).filter(|k| *k != grating).map(beside).fold(0.0, f64::max);
    let first = gratings[grating].orders[0];
    let bright = (0..copies.len()).filter(|i| own.model[*i] <= 0.0 && light[*i] > 5.0 / copies[*i].weight.sqrt());
    let elsewhere = bright.map(|i| light[i] / (first * copies[i].shape.peak)).fold(0.0, f64::max);
    Some(Best { grating, amount: own.amount, per_copy, ahead: next - own.cost, second, elsewhere })
}

/// Lower bound of a second grating's coverage.
fn second_coverage(copies: &[Copy], light: &[f64], own: &GratingFit, other: &GratingFit, scale: f64) -> f64 {
    if other.square < MIN_SNR * MIN_SNR {
        return 0.0;
    }
    let (mut cross, mut a, mut b) = (0.0, 0.0, 0.0);
    for (i, c) in copies.iter().enumerate() {
        let weight = own.weight[i].min(other.weight[i]).min(c.weight);
        cross += weight * own.model[i] * other.model[i];
        a += weight * own.model[i] * light[i];
        b += weight * other.model[i] * light[i];
    }
    let determinant = own.square * other.square - cross * cross;
    if determinant < 1e-3 * own.square * other.square {
        return 0.0;
    }
    let second_coverage = (b * own.square - a * cross) / determinant;
    second_coverage - 2.0 * scale * (own.square / determinant).sqrt()
}

impl Best {
    /// Reason why the position is not assigned to the grating, if any.
    pub fn mask_reason(&self) -> Option<MaskReason> {
        if self.second.max(self.elsewhere) > MAX_SECOND_COVERAGE * self.amount {
            return Some(MaskReason::Several);
        }
        if self.per_copy > MAX_CHI2 {
            return Some(MaskReason::Unexplained);
        }
        if !(MIN_COVERAGE..MAX_COVERAGE).contains(&self.amount) {
            return Some(MaskReason::Uncertain);
        }
        (self.ahead < EXCLUSION_CHI2 * self.per_copy.max(1.0)).then_some(MaskReason::Ambiguous)
    }
}

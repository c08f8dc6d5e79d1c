//! The grating at one place of the tile, or why there is none to tell.

use super::lobe::Lobe;
use super::solve::{Copy, Prior, Solution, cost_at, solve};
use super::view::Half;
use nacre_base::statistics::median;

/// The order zero is left out within so many standard deviations.
pub(super) const SPECULAR: f64 = 5.5;

/// Lobes are not quite Gaussian, and copies not quite alike: standard deviation over the light itself, and over the brightest copy.
const UNLIKE: [f64; 2] = [0.04, 0.004];

/// Brightest copy in standard deviations of its noise, from which there is light.
const LIT: f64 = 6.0;

/// Bright copies that starts are taken from, and how bright they must be relative to the brightest.
const STARTS: usize = 6;
const BRIGHT: f64 = 0.12;

/// Starts that are followed, and where few copies are near a lobe.
const FOLLOWED: [usize; 2] = [4, 10];

/// Copies near a lobe from which a few starts find all gratings; with fewer, starts lie all around the bright copies.
const MANY: usize = 9;

/// Copies near a lobe below which nothing checks the fit: the unknowns are a vector (with a shared length, its direction) and its light.
const FEWEST: [usize; 2] = [4, 3];

/// Part of a lobe's peak from which a copy is near it.
const NEAR: f64 = 0.02;

/// Another grating is ruled out when it is so much worse, in units of what the best one leaves over.
const RULED_OUT: f64 = 16.0;

/// Light of a second grating, over the first one's, from which a place has several.
const SECOND: f64 = 0.12;

/// Higher orders that are so many times as bright as the first make it no grating.
const HIGHER: f64 = 2.0;

/// Squares left over per copy in a lobe, from which the fit explains nothing.
const POOR: f64 = 6.0;

/// Largest σ of an orientation in rad, as in maps from polarization, and of a period over itself.
const UNCERTAIN: [f64; 2] = [0.125, 0.125];

/// What was found.
#[derive(Clone, Copy, Debug)]
pub(super) enum Found {
    /// A grating.
    Grating(Grating),
    /// Why there is none.
    Masked(Why),
}

/// A grating and how well it is known.
#[derive(Clone, Copy, Debug)]
pub(super) struct Grating {
    /// In rad, `[0, π)`, anticlockwise from the right.
    pub orientation: f64,
    /// λ/a.
    pub length: f64,
    /// σ of the orientation in rad.
    pub orientation_sigma: f64,
    /// σ of the length.
    pub length_sigma: f64,
}

/// Why a place is masked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Why {
    /// No copy is in any photograph.
    Unseen,
    /// No order's light.
    Dark,
    /// Several gratings explain it, or the light could be of another order.
    Ambiguous,
    /// More than one grating is there.
    Several,
    /// Too few copies near a lobe.
    Uncertain,
    /// No grating explains it.
    Unexplained,
}

/// A copy as it was photographed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Observed {
    pub seen: Half,
    /// Light and variance; NaN for none.
    pub light: [f32; 2],
}

/// Copies of a place outside of the order zero.
pub(super) struct Outside {
    /// Light over what falls on the place; weights are inverse variances of the camera's noise.
    copies: Vec<Copy>,
    /// The brightest one's light.
    pub brightest: f64,
    /// The middle of their lights.
    pub median: f64,
}

impl Outside {
    /// Of what was photographed.
    ///
    /// # Errors
    /// `Unseen` without any.
    pub fn of(observed: &[Observed], lobe: &Lobe) -> Result<Self, Why> {
        let usable = observed.iter().filter(|o| o.light[0].is_finite() && o.light[1] > 0.0);
        let outside = usable.filter_map(|o| {
            let shape = lobe.at(&o.seen);
            let gain = o.seen.gain;
            let half = lobe.middle(&o.seen);
            let far = shape.square(half) > SPECULAR * SPECULAR && gain > 0.0;
            let weight = gain * gain / f64::from(o.light[1]);
            far.then(|| Copy { half, shape, light: f64::from(o.light[0]) / gain, weight })
        });
        let copies: Vec<Copy> = outside.collect();
        let mut lights: Vec<f64> = copies.iter().map(|c| c.light).collect();
        let brightest = lights.iter().copied().fold(f64::MIN, f64::max);
        let median = median(&mut lights).ok_or(Why::Unseen)?;
        Ok(Self { copies, brightest, median })
    }

    /// Whether no copy is near a lobe. Where most copies are as bright, it is stray light.
    pub fn is_dark(&self) -> bool {
        let noise = self.copies.iter().filter(|c| c.light >= self.brightest).map(|c| c.weight.powf(-0.5));
        self.brightest <= LIT * noise.fold(0.0, f64::max)
            || (self.copies.len() > 8 && self.brightest < 4.0 * self.median)
    }

    /// Light over a unit, which part of the lobes' light that model and copies differ by counts as noise.
    pub fn over(&self, unit: f64) -> Vec<Copy> {
        let copy = |c: &Copy| {
            let light = c.light / unit;
            let unlike = (UNLIKE[0] * light).powi(2) + UNLIKE[1] * UNLIKE[1];
            Copy { light, weight: 1.0 / (1.0 / (c.weight * unit * unit) + unlike), ..*c }
        };
        self.copies.iter().map(copy).collect()
    }
}

/// Copies outside of the order zero, over the brightest; none without light.
pub(super) fn copies(observed: &[Observed], lobe: &Lobe) -> Result<Vec<Copy>, Why> {
    let outside = Outside::of(observed, lobe)?;
    if outside.is_dark() { Err(Why::Dark) } else { Ok(outside.over(outside.brightest)) }
}

/// The grating that explains the copies.
pub(super) fn fit(copies: &[Copy], prior: &Prior) -> Found {
    let near = |s: &Solution| copies.iter().filter(|c| s.inside(c) > NEAR).count();
    let mut solutions = solutions(copies, prior, false);
    if solutions.iter().any(|s| near(s) < MANY) {
        solutions.extend(self::solutions(copies, prior, true));
    }
    // A grating with bright higher orders and a dark first one is none (unless it is deeper than a quarter of a wavelength).
    solutions.retain(|s| s.orders[0] > 5.0 * s.first_sigma && s.orders[1..].iter().all(|o| *o < HIGHER * s.orders[0]));
    solutions.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let Some(best) = solutions.first() else { return Found::Masked(Why::Unexplained) };
    let per_copy = left_over(best, copies);
    let scale = per_copy.max(1.0);
    let [xx, xy, yy] = best.covariance.map(|c| c * scale);
    let length = best.vector[0].hypot(best.vector[1]);
    let [x, y] = best.vector.map(|v| v / length);
    let variance = |x: f64, y: f64| (x * x * xx + 2.0 * x * y * xy + y * y * yy).max(0.0);
    let (orientation_sigma, length_sigma) = (variance(-y, x).sqrt() / length, variance(x, y).sqrt());
    let masked = |why| Found::Masked(why);
    if has_second(best, copies) {
        return masked(Why::Several);
    }
    if per_copy > POOR {
        return masked(Why::Unexplained);
    }
    // At the end of the range, a better one may lie beyond.
    if prior.shared.is_none() && !(prior.range[0] * 1.01..prior.range[1] * 0.99).contains(&length) {
        return masked(Why::Ambiguous);
    }
    if near(best) < FEWEST[usize::from(prior.shared.is_some())] {
        return masked(Why::Uncertain);
    }
    if !(orientation_sigma < UNCERTAIN[0] && length_sigma < UNCERTAIN[1] * length) {
        return masked(Why::Uncertain);
    }
    let other = |s: &&Solution| {
        let [dx, dy] = nearer(best.vector, s.vector);
        let apart = dx.hypot(dy) > 3.0 * (orientation_sigma * length).max(length_sigma).max(1e-3 * length);
        apart && s.cost - best.cost < RULED_OUT * scale
    };
    if solutions.iter().skip(1).any(|s| other(&s)) || is_higher_order(best, copies, prior) {
        return masked(Why::Ambiguous);
    }
    let orientation = y.atan2(x).rem_euclid(std::f64::consts::PI);
    Found::Grating(Grating { orientation, length, orientation_sigma, length_sigma })
}

/// Difference of two grating vectors, which have no sign.
fn nearer(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    let (minus, plus) = ([a[0] - b[0], a[1] - b[1]], [a[0] + b[0], a[1] + b[1]]);
    if minus[0].hypot(minus[1]) < plus[0].hypot(plus[1]) { minus } else { plus }
}

/// Least squares near to the brightest copies, or all around them, taken as first and as second orders.
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
                // A little outside of the range, since a copy need not be at the peak.
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
    // Those that lie close together lead to the same.
    let mut followed: Vec<[f64; 2]> = vec![];
    for (start, _) in &starts {
        let apart = |f: &[f64; 2]| copies.first().is_some_and(|c| c.shape.square(nearer(*start, *f)) > 0.8);
        if followed.len() < FOLLOWED[usize::from(around)] && followed.iter().all(apart) {
            followed.push(*start);
        }
    }
    followed.iter().filter_map(|start| solve(copies, *start, prior)).collect()
}

/// Places around a copy that starts are taken from, in widths of its lobe.
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

/// Squares left over per copy in a lobe and degree of freedom.
fn left_over(best: &Solution, copies: &[Copy]) -> f64 {
    let inside = copies.iter().filter(|c| best.inside(c) > 0.05);
    let (sum, count) = inside.fold((0.0, 0), |(sum, count), c| {
        let left = c.light - best.light(c);
        (sum + c.weight * left * left, count + 1)
    });
    if count > 3 { sum / f64::from(count - 3) } else { sum }
}

/// Whether a copy far from the grating's lobes is bright.
fn has_second(best: &Solution, copies: &[Copy]) -> bool {
    let first = best.orders[0];
    copies.iter().any(|c| {
        let left = c.light - best.light(c);
        left > 5.0 / c.weight.sqrt() && left > SECOND * first * c.shape.peak && best.inside(c) < 0.01
    })
}

/// Whether the light may be a second or third order: half-way or a third of the way in, nothing tells that there is no first one.
fn is_higher_order(best: &Solution, copies: &[Copy], prior: &Prior) -> bool {
    let length = best.vector[0].hypot(best.vector[1]);
    let within = |length: f64| prior.shared.map_or(length >= prior.range[0], |[l, s]| (length - l).abs() < 5.0 * s);
    [2.0, 3.0].iter().any(|order| {
        let [light, sigma] = best.light_at(copies, 1.0 / order);
        within(length / order) && light + 3.0 * sigma > 0.5 * best.orders[0]
    })
}

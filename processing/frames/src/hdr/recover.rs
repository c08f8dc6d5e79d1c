//! Recovery of a camera's response from a bracket (Debevec and Malik 1997, Eq. 3).
//!
//! Unknowns are the log light `g` at 255 knots and the log radiance of every sampled pixel. Each value between black
//! and white gives an equation `g(value) = ln radiance + ln exposure`. Radiances are eliminated one at a time, so that
//! only the knots remain. For equal exposure steps, `g` is determined only up to a function periodic in the step.
//! Smoothness removes this ambiguity: it penalises the change of slope over the logarithm of the code, which is zero
//! for power laws.

use super::response::{KNOTS, Response};
use nalgebra::{DMatrix, DVector};

/// Range of values between black (0) and white (1): values outside are clipped or nearly black.
const LOW: f64 = 4.5 / 255.0;
const HIGH: f64 = 252.5 / 255.0;

/// Minimum standard deviation of a value in knots, for rounding and slight noise. It increases with the scatter of the
/// data.
const SIGMA: f64 = 0.6;

/// Maximum relative decrease of light towards brighter values that counts as noise, and knot from which it applies;
/// lower knots are nearly black.
const DIP: f64 = 0.1;
const RISES_FROM: usize = 16;

/// Standard deviation of the change of slope of `g` over ln code between knots. With 0.05, the periodic ambiguity
/// causes a 10 % error for a linear camera. With 0.003, the shoulder of film is 1 % too flat.
const BEND: f64 = 0.01;

/// Number of knots on each side over which the slope for weights is averaged, because the slope between adjacent knots
/// is noisy.
const AROUND: usize = 4;

/// Number of standard deviations above which deviations, for instance by motion, are down-weighted.
const OUTLIER: f64 = 3.0;

/// Number of re-weighting iterations.
const ROUNDS: usize = 5;

/// Minimum number of observations from pixels in more than one exposure.
const FEWEST: usize = 200;

/// A recovered curve.
pub(super) struct Recovered {
    /// Light at the knots, 1 at code 128.
    pub curve: Vec<f64>,
    /// Largest relative standard deviation of light between codes 16 and 240, from the scatter of the data.
    pub sigma: f64,
    /// Fraction of the knots between 16 and 240 with observations nearby.
    pub seen: f64,
}

/// Recovers one channel. `positions[exposure][pixel]` is 0 at black and 1 at white; `scales` are the exposures'
/// `1/(exposure · gain)`.
///
/// # Errors
/// A problem of the bracket, as text.
pub(super) fn recover(positions: &[Vec<f64>], scales: &[f64]) -> Result<Recovered, String> {
    let data = Data::new(positions, scales)?;
    let mut g: Vec<f64> = (0..KNOTS).map(|k| 2.2 * (k.max(1) as f64 / 128.0).ln()).collect();
    let mut solved = None;
    let mut sigma = SIGMA;
    for round in 0..ROUNDS {
        let system = data.system(&g, sigma, round > 0);
        sigma = (sigma * system.chi2.sqrt()).max(SIGMA);
        let Some(cholesky) = system.matrix.clone().cholesky() else {
            return Err("the exposures do not overlap".into());
        };
        let solution = cholesky.solve(&system.right);
        (1..KNOTS).for_each(|k| g[k] = solution[k - 1]);
        solved = Some((cholesky, system.chi2));
    }
    let (cholesky, chi2) = solved.ok_or("there is nothing to solve")?;
    let inverse = cholesky.inverse();
    let sigma = (16..=240).map(|k| (chi2.max(1.0) * inverse[(k - 1, k - 1)]).sqrt()).fold(0.0, f64::max);
    let curve = rising(&g)?;
    Ok(Recovered { curve, sigma, seen: data.seen() })
}

/// Light as a monotonically increasing function of the code.
fn rising(g: &[f64]) -> Result<Vec<f64>, String> {
    let mut curve: Vec<f64> = g.iter().map(|g| g.exp()).collect();
    curve[0] = 0.0;
    // From the bright end downwards, so that the darkest codes, which are least certain, are adjusted.
    for k in (1..KNOTS - 1).rev() {
        if curve[k] >= curve[k + 1] {
            if k >= RISES_FROM && curve[k] > curve[k + 1] * (1.0 + DIP) {
                let cause = "the exposure times may be wrong, or something moved";
                return Err(format!("brighter values would mean less light (code {k}); {cause}"));
            }
            curve[k] = curve[k + 1] * k as f64 / (k + 1) as f64;
        }
    }
    Ok(curve)
}

/// Combines the curves of all channels. Their light is equal at code 128, in agreement with the camera's white balance.
pub(super) fn response(channels: &[Recovered]) -> Response {
    let top = channels.iter().filter_map(|c| c.curve.last()).fold(0.0, |a: f64, b| a.max(*b));
    let curve = |c: &Recovered| c.curve.iter().map(|v| (v / top) as f32).collect();
    Response { curves: channels.iter().map(curve).collect() }
}

/// One value: adjacent knots, and ln exposure.
struct Value {
    knot: usize,
    share: f64,
    exposure: f64,
}

/// Usable values of pixels with at least two of them.
struct Data {
    pixels: Vec<Vec<Value>>,
}

/// Normal equations of knots 1 to 255.
struct System {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
    /// Mean squared deviation relative to its expectation.
    chi2: f64,
}

impl Data {
    fn new(positions: &[Vec<f64>], scales: &[f64]) -> Result<Self, String> {
        let count = positions.iter().map(Vec::len).min().unwrap_or(0);
        let value = |position: f64, scale: &f64| {
            let at = position * (KNOTS - 1) as f64;
            let knot = (at as usize).min(KNOTS - 2);
            (LOW..=HIGH).contains(&position).then(|| Value { knot, share: at - knot as f64, exposure: -scale.ln() })
        };
        let of = |i: usize| positions.iter().zip(scales).filter_map(|(p, s)| value(p[i], s)).collect::<Vec<_>>();
        let differ = |v: &Vec<Value>| v.iter().any(|a| (a.exposure - v[0].exposure).abs() > 1e-3);
        let pixels: Vec<Vec<Value>> = (0..count).map(of).filter(|v| v.len() > 1 && differ(v)).collect();
        if pixels.len() < FEWEST {
            let problem =
                "a response cannot be recovered: too few pixels are well exposed in two exposures of different time";
            return Err(format!("{problem} ({} of {count})", pixels.len()));
        }
        Ok(Self { pixels })
    }

    fn system(&self, g: &[f64], sigma: f64, robust: bool) -> System {
        let n = KNOTS - 1;
        let mut matrix = DMatrix::<f64>::zeros(n, n);
        let mut right = DVector::<f64>::zeros(n);
        let (mut square, mut freedom) = (0.0, 0.0);
        let slope = |k: usize| {
            let (low, high) = (k.saturating_sub(AROUND).max(1), (k + AROUND).min(KNOTS - 1));
            ((g[high] - g[low]) / (high - low) as f64).max(1e-3)
        };
        let slopes: Vec<f64> = (0..KNOTS).map(slope).collect();
        for pixel in &self.pixels {
            let at = |v: &Value| g[v.knot] * (1.0 - v.share) + g[v.knot + 1] * v.share;
            let slope = |v: &Value| slopes[v.knot];
            let plain: Vec<f64> = pixel.iter().map(|v| (slope(v) * sigma).powi(-2)).collect();
            let mean = |w: &[f64]| {
                let sum = pixel.iter().zip(w).map(|(v, w)| w * (at(v) - v.exposure)).sum::<f64>();
                sum / w.iter().sum::<f64>()
            };
            let mut weights = plain.clone();
            if robust {
                let middle = mean(&plain);
                for (v, w) in pixel.iter().zip(&mut weights) {
                    let off = (at(v) - v.exposure - middle).abs() * w.sqrt();
                    *w *= (OUTLIER / off.max(OUTLIER)).powi(2);
                }
            }
            let (total, middle) = (weights.iter().sum::<f64>(), mean(&weights));
            for (v, w) in pixel.iter().zip(&weights) {
                let (i, a) = (v.knot.max(1) - 1, [1.0 - v.share, v.share]);
                for (p, b) in a.iter().enumerate() {
                    right[i + p] += w * b * v.exposure;
                    a.iter().enumerate().for_each(|(q, c)| matrix[(i + p, i + q)] += w * b * c);
                }
                square += w * (at(v) - v.exposure - middle).powi(2);
            }
            freedom += (pixel.len() - 1) as f64;
            // Eliminates the pixel's own radiance.
            let exposure = pixel.iter().zip(&weights).map(|(v, w)| w * v.exposure).sum::<f64>() / total;
            for (v, w) in pixel.iter().zip(&weights) {
                for (p, b) in [(0, 1.0 - v.share), (1, v.share)] {
                    let i = v.knot.max(1) - 1 + p;
                    right[i] -= w * b * exposure;
                    for (u, y) in pixel.iter().zip(&weights) {
                        for (q, c) in [(0, 1.0 - u.share), (1, u.share)] {
                            matrix[(i, u.knot.max(1) - 1 + q)] -= w * b * y * c / total;
                        }
                    }
                }
            }
        }
        smooth(&mut matrix);
        // Fixes the scale: light is 1 at code 128.
        matrix[(127, 127)] += 1e8;
        System { matrix, right, chi2: (square / freedom).max(1e-6) }
    }

    fn seen(&self) -> f64 {
        let mut near = [false; KNOTS];
        for v in self.pixels.iter().flatten() {
            (v.knot.saturating_sub(4)..(v.knot + 5).min(KNOTS)).for_each(|k| near[k] = true);
        }
        near[16..=240].iter().filter(|n| **n).count() as f64 / 225.0
    }
}

/// Adds the smoothness term.
fn smooth(matrix: &mut DMatrix<f64>) {
    let u = |k: usize| (k as f64).ln();
    for k in 2..KNOTS - 1 {
        let (before, after) = (1.0 / (u(k) - u(k - 1)), 1.0 / (u(k + 1) - u(k)));
        let row = [(k - 2, before), (k - 1, -before - after), (k, after)];
        for (i, a) in row {
            row.iter().for_each(|(j, b)| matrix[(i, *j)] += a * b / (BEND * BEND));
        }
    }
}

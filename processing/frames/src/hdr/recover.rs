//! The response of a camera, recovered from a bracket (Debevec and Malik 1997, Eq. 3).
//!
//! Unknown are the log light `g` of 255 knots and the log radiance of every sampled pixel. Each value between black and white
//! says `g(value) = ln radiance + ln exposure`; radiances are eliminated one by one, so that only the knots are solved for.
//! A bracket in even steps cannot tell `g` from `g` plus anything that repeats with the step, so smoothness has to decide:
//! it is the change of slope over the logarithm of the code, which costs no power law anything.

use super::response::{KNOTS, Response};
use nalgebra::{DMatrix, DVector};

/// Values between black (0) and white (1) that are looked at: outside they are clipped or next to nothing.
const LOW: f64 = 4.5 / 255.0;
const HIGH: f64 = 252.5 / 255.0;

/// Least standard deviation of a value in knots: rounding and a little noise. It grows with what the data scatter by.
const SIGMA: f64 = 0.6;

/// Brighter values that seem to mean less light are taken for noise if they do so by less than this part of the light, from this
/// knot on: below there is little but black.
const DIP: f64 = 0.1;
const RISES_FROM: usize = 16;

/// How much the slope of `g` over ln code may change from knot to knot, standard deviation. With 0.05 what repeats with the step of
/// the bracket is 10 % wrong for a linear camera; with 0.003 a film's shoulder is 1 % flatter than it is.
const BEND: f64 = 0.01;

/// Knots to both sides over which the slope is taken that weights depend on: that of neighbours is noise.
const AROUND: usize = 4;

/// Deviations beyond so many standard deviations count less and less: something moved.
const OUTLIER: f64 = 3.0;

/// Rounds of weighting.
const ROUNDS: usize = 5;

/// Fewest observations of pixels in more than one exposure.
const FEWEST: usize = 200;

/// A recovered curve.
pub(super) struct Recovered {
    /// Light at the knots, 1 at code 128.
    pub curve: Vec<f64>,
    /// Largest relative standard deviation of light between codes 16 and 240, by the scatter of the data.
    pub sigma: f64,
    /// Share of the knots between 16 and 240 that values were seen near to.
    pub seen: f64,
}

/// One channel: `positions[exposure][pixel]`, 0 at black and 1 at white, with the exposures' `1/(exposure · gain)`.
///
/// # Errors
/// What is wrong with the bracket, in words.
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

/// Light that rises with the code.
fn rising(g: &[f64]) -> Result<Vec<f64>, String> {
    let mut curve: Vec<f64> = g.iter().map(|g| g.exp()).collect();
    curve[0] = 0.0;
    // From the bright end down, so that the darkest codes, of which least is known, give way.
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

/// Curves of all channels as one response: their light is alike at code 128, as a camera's white balance has it.
pub(super) fn response(channels: &[Recovered]) -> Response {
    let top = channels.iter().filter_map(|c| c.curve.last()).fold(0.0, |a: f64, b| a.max(*b));
    let curve = |c: &Recovered| c.curve.iter().map(|v| (v / top) as f32).collect();
    Response { curves: channels.iter().map(curve).collect() }
}

/// One value: which knots it lies between, and ln exposure.
struct Value {
    knot: usize,
    share: f64,
    exposure: f64,
}

/// Usable values of the pixels that have at least two.
struct Data {
    pixels: Vec<Vec<Value>>,
}

/// Normal equations of knots 1 to 255.
struct System {
    matrix: DMatrix<f64>,
    right: DVector<f64>,
    /// Mean squared deviation over what was expected.
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
            // What the pixel's own radiance takes up.
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
        // The scale is free: light is 1 at code 128.
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

/// Adds what smoothness asks for.
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

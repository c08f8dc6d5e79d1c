//! Fit of a row of slits to a slice: number, width and spacing (2017 paper, section 6.1). Slit edges are blurred by a
//! Gaussian, so that the blurred photograph can be fitted without bias in the full width at half maximum.

use super::period::Lines;
use nacre_base::least_squares::{Damping, Problem, Step, levenberg_marquardt};
use nalgebra::{SMatrix, SVector};
use schemars::JsonSchema;
use serde::Serialize;

/// Parameters: dark level, bright level, centre of a slit, spacing, width, softness.
const N: usize = 6;
type Values = SVector<f64, N>;

/// Maximum number of fit steps.
const STEPS: usize = 100;

/// Slits fitted to a slice, with standard deviations; lengths in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Slits {
    /// Number of bright slits whose centre lies in the slice and is more than half bright.
    pub count: usize,
    /// Distance of adjacent slits.
    pub spacing_px: [f64; 2],
    /// Full width of a slit at half maximum.
    pub width_px: [f64; 2],
    /// Standard deviation of the Gaussian blur of the edges.
    pub softness_px: [f64; 2],
    /// Light between slits and in slits.
    pub light: [f64; 2],
    /// Root mean square residual relative to the difference of these two.
    pub residual: f64,
}

/// Fits slits to a slice with detected lines; `None` if the fit fails.
pub(super) fn slits(values: &[f64], lines: &Lines) -> Option<Slits> {
    let period = lines.period_px[0];
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted[(share * (sorted.len() - 1) as f64) as usize];
    let (dark, bright) = (at(0.05), at(0.95));
    let lit = values.iter().filter(|v| **v > 0.5 * (dark + bright)).count() as f64 / values.len() as f64;
    // The fundamental of a row of slits has its maximum at their centres.
    let middle = -lines.phase / std::f64::consts::TAU * period;
    let width = lit.clamp(0.15, 0.85) * period;
    let start = Values::from([dark, bright, middle, period, width, 0.1 * period]);
    let (found, normal, square) = fit(values, start)?;
    let [dark, bright, middle, spacing, width, softness] = found.into();
    let sensible = bright > dark && (0.8..1.25).contains(&(spacing / period)) && width > 0.0 && width < spacing;
    if !sensible {
        return None;
    }
    let left: Vec<f64> = (0..values.len()).map(|i| values[i] - model(&found, i as f64)).collect();
    let n = values.len() as f64;
    let together = left.windows(2).map(|p| p[0] * p[1]).sum::<f64>() / square.max(f64::MIN_POSITIVE);
    // Correlated residuals reduce the effective number of samples.
    let inflation = ((1.0 + together) / (1.0 - together).max(0.02)).max(1.0);
    let variance = square / (n - N as f64) * inflation;
    let covariance = normal.try_inverse()? * variance;
    let with = |value: f64, k: usize| [value, covariance[(k, k)].max(0.0).sqrt()];
    let middles = ((-middle / spacing).ceil() as i64)..=(((n - 1.0 - middle) / spacing).floor() as i64);
    let is_lit = |k: &i64| {
        let at = (middle + *k as f64 * spacing).round().clamp(0.0, n - 1.0) as usize;
        values[at] > 0.5 * (dark + bright)
    };
    Some(Slits {
        count: middles.filter(is_lit).count(),
        spacing_px: with(spacing, 3),
        width_px: with(width, 4),
        softness_px: with(softness.abs(), 5),
        light: [dark, bright],
        residual: (square / n).sqrt() / (bright - dark),
    })
}

/// Light at a position: sum of the slits that contribute there.
fn model(p: &Values, x: f64) -> f64 {
    let [dark, bright, middle, spacing, width, softness] = (*p).into();
    let nearest = ((x - middle) / spacing).round();
    let scale = 1.0 / (softness.abs().max(1e-3) * std::f64::consts::SQRT_2);
    let one = |k: f64| {
        let off = x - middle - (nearest + k) * spacing;
        0.5 * (libm::erf((off + 0.5 * width) * scale) - libm::erf((off - 0.5 * width) * scale))
    };
    dark + (bright - dark) * [-2.0, -1.0, 0.0, 1.0, 2.0].map(one).iter().sum::<f64>()
}

/// Derivatives of [`model`] with respect to its parameters.
fn slope(p: &Values, x: f64) -> Values {
    let [dark, bright, middle, spacing, width, softness] = (*p).into();
    let nearest = ((x - middle) / spacing).round();
    let soft = softness.abs().max(1e-3);
    let scale = 1.0 / (soft * std::f64::consts::SQRT_2);
    let (mut lit, mut by_middle, mut by_spacing, mut by_width, mut by_softness) = (0.0, 0.0, 0.0, 0.0, 0.0);
    for k in [-2.0, -1.0, 0.0, 1.0, 2.0] {
        let off = x - middle - (nearest + k) * spacing;
        let [end, begin] = [off + 0.5 * width, off - 0.5 * width].map(|edge| edge * scale);
        // Half the derivative of erf.
        let [at_end, at_begin] = [end, begin].map(|edge| (-edge * edge).exp() * 0.5 * std::f64::consts::FRAC_2_SQRT_PI);
        lit += 0.5 * (libm::erf(end) - libm::erf(begin));
        let by_place = (at_end - at_begin) * scale;
        by_middle -= by_place;
        by_spacing -= by_place * (nearest + k);
        by_width += 0.5 * (at_end + at_begin) * scale;
        by_softness -= (at_end * end - at_begin * begin) / soft;
    }
    let contrast = bright - dark;
    Values::from([
        1.0 - lit,
        lit,
        contrast * by_middle,
        contrast * by_spacing,
        contrast * by_width,
        contrast * by_softness * softness.signum(),
    ])
}

/// Levenberg-Marquardt damping.
const DAMPING: Damping = Damping { first: 1e-3, down: 0.3, least: 0.0, up: 10.0, most: 1e10 };

/// Relative decrease of the sum of squares below which the fit has converged.
const CONVERGED: f64 = 1e-10;

/// Light along a line, one value per pixel.
struct Line<'a>(&'a [f64]);

/// The damped normal matrix has no inverse.
struct Singular;

impl Line<'_> {
    fn normal(&self, p: &Values) -> (SMatrix<f64, N, N>, Values) {
        let (mut normal, mut right) = (SMatrix::<f64, N, N>::zeros(), Values::zeros());
        for (i, v) in self.0.iter().enumerate() {
            let x = i as f64;
            let slope = slope(p, x);
            normal += slope * slope.transpose();
            right += slope * (v - model(p, x));
        }
        (normal, right)
    }

    fn squares(&self, p: &Values) -> f64 {
        self.0.iter().enumerate().map(|(i, v)| (v - model(p, i as f64)).powi(2)).sum()
    }
}

impl Problem for Line<'_> {
    /// Parameters and their sum of squares.
    type State = (Values, f64);
    type Error = Singular;

    fn cost(&self, (_, squares): &(Values, f64)) -> f64 {
        *squares
    }

    fn step(&self, (p, _): &(Values, f64), damping: f64) -> Result<Step<(Values, f64)>, Singular> {
        let (mut normal, right) = self.normal(p);
        (0..N).for_each(|k| normal[(k, k)] *= 1.0 + damping);
        let next = p + normal.try_inverse().ok_or(Singular)? * right;
        Ok(Step::Trial((next, self.squares(&next))))
    }

    fn accept(&self, (_, before): &(Values, f64), (_, after): &mut (Values, f64)) -> bool {
        before - *after < CONVERGED * before
    }
}

/// Least-squares fit: parameters, normal matrix at the minimum, and sum of squares.
fn fit(values: &[f64], start: Values) -> Option<(Values, SMatrix<f64, N, N>, f64)> {
    let line = Line(values);
    let (p, best) = levenberg_marquardt(&line, (start, line.squares(&start)), DAMPING, STEPS).ok()?;
    best.is_finite().then(|| (p, line.normal(&p).0, best))
}

#[cfg(test)]
mod tests {
    use super::super::period::lines;
    use super::*;

    fn noise(i: usize) -> f64 {
        let x = (i as f64 * 78.233).sin() * 43_758.545_3;
        3.46 * (x - x.floor() - 0.5)
    }

    #[test]
    fn slopes_are_those_of_the_model() {
        for p in [[0.2, 0.9, 4.7, 17.3, 6.2, 1.2], [0.1, 0.5, -3.0, 9.6, 5.5, -0.8]].map(Values::from) {
            for x in (0..100).map(|i| 0.37 * f64::from(i)) {
                let found = slope(&p, x);
                for k in 0..N {
                    let (mut up, mut down) = (p, p);
                    (up[k], down[k]) = (p[k] + 1e-5, p[k] - 1e-5);
                    let wanted = (model(&up, x) - model(&down, x)) / 2e-5;
                    assert!((found[k] - wanted).abs() < 1e-7, "{k} at {x}: {} instead of {wanted}", found[k]);
                }
            }
        }
    }

    #[test]
    fn slits_are_measured_to_their_uncertainty() {
        for (spacing, width, soft) in [(17.3, 6.2, 1.2), (9.6, 5.5, 0.8), (30.0, 7.5, 2.0)] {
            let truth = Values::from([0.2, 0.9, 4.7, spacing, width, soft]);
            let values: Vec<f64> = (0..400).map(|i| model(&truth, i as f64) + 0.02 * noise(i)).collect();
            let found = slits(&values, &lines(&values).unwrap()).unwrap();
            for ([value, sigma], truth) in
                [(found.spacing_px, spacing), (found.width_px, width), (found.softness_px, soft)]
            {
                assert!((value - truth).abs() < 4.0 * sigma && sigma < 0.1, "{truth}: {found:?}");
            }
            let count = (0..60).filter(|k| (0.0..=399.0).contains(&(4.7 + f64::from(*k) * spacing))).count();
            assert_eq!(found.count, count);
        }
    }

    #[test]
    fn only_slits_that_are_lit_count() {
        let truth = Values::from([0.1, 0.9, 5.0, 20.0, 8.0, 1.5]);
        let lit = |i: usize| if (105..310).contains(&i) { model(&truth, i as f64) } else { 0.1 };
        let values: Vec<f64> = (0..400).map(|i| lit(i) + 0.005 * noise(i)).collect();
        let found = lines(&values).and_then(|l| slits(&values, &l)).unwrap();
        // Centres at 105, 125, … 305.
        assert!((10..=11).contains(&found.count), "{found:?}");
    }
}

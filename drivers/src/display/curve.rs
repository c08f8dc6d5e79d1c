//! Tone curve of a display from measured luminances.

use super::kms::Tone;
use serde::Serialize;

/// Largest deviation from a power law, relative to white, for which the law is used.
pub const POWER_LAW: f64 = 0.005;

/// Range of plausible exponents.
const EXPONENTS: [f64; 2] = [0.2, 5.0];

/// Power law fitted to luminances: `black + (white − black) · code^gamma`, code in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PowerLaw {
    /// Exponent.
    pub gamma: f64,
    /// Standard deviation of the exponent, from the residuals.
    pub gamma_sigma: f64,
    /// Black luminance relative to white.
    pub black: f64,
    /// Largest residual, relative to the range from black to white.
    pub deviation: f64,
}

/// Fits a power law by least squares to luminances (any unit) at equidistant codes from black to white. Returns `None`
/// for fewer than five values, for non-finite values, and without any light.
pub fn power_law(luminances: &[f64]) -> Option<PowerLaw> {
    let n = luminances.len();
    if n < 5 || luminances.iter().any(|l| !l.is_finite()) {
        return None;
    }
    let code = |i: usize| i as f64 / (n - 1) as f64;
    // For a given exponent, linear least squares yields black and white.
    let line = |gamma: f64| {
        let x: Vec<f64> = (0..n).map(|i| code(i).powf(gamma)).collect();
        let mean = |v: &[f64]| v.iter().sum::<f64>() / n as f64;
        let (mx, my) = (mean(&x), mean(luminances));
        let sxx: f64 = x.iter().map(|x| (x - mx).powi(2)).sum();
        let sxy: f64 = x.iter().zip(luminances).map(|(x, y)| (x - mx) * (y - my)).sum();
        let step = sxy / sxx;
        let black = my - step * mx;
        let left: Vec<f64> = x.iter().zip(luminances).map(|(x, y)| y - black - step * x).collect();
        (black, step, left)
    };
    let squares = |gamma: f64| line(gamma).2.iter().map(|r| r * r).sum::<f64>();
    let gamma = golden(squares, EXPONENTS);
    let (black, step, left) = line(gamma);
    if step <= 0.0 || black + step <= 0.0 {
        return None;
    }
    // Derivative of the law with respect to the exponent, orthogonal to the terms of black and white: the residual of
    // a linear fit.
    let slope: Vec<f64> =
        (0..n).map(|i| if i == 0 { 0.0 } else { step * code(i).powf(gamma) * code(i).ln() }).collect();
    let x: Vec<f64> = (0..n).map(|i| code(i).powf(gamma)).collect();
    let bend = squares_beside(&slope, &x);
    let variance = left.iter().map(|r| r * r).sum::<f64>() / (n - 3) as f64;
    Some(PowerLaw {
        gamma,
        gamma_sigma: (variance / bend).sqrt(),
        black: black / (black + step),
        deviation: left.iter().fold(0.0, |most: f64, r| most.max(r.abs())) / step,
    })
}

/// Sum of squared residuals of `values` after a linear fit in `x`.
fn squares_beside(values: &[f64], x: &[f64]) -> f64 {
    let n = values.len() as f64;
    let (mv, mx) = (values.iter().sum::<f64>() / n, x.iter().sum::<f64>() / n);
    let sum = |f: fn(f64, f64) -> f64| values.iter().zip(x).map(|(v, x)| f(v - mv, x - mx)).sum::<f64>();
    sum(|v, _| v * v) - sum(|v, x| v * x).powi(2) / sum(|_, x| x * x)
}

/// Minimum of a unimodal function between two ends, by golden-section search.
fn golden(f: impl Fn(f64) -> f64, [mut low, mut high]: [f64; 2]) -> f64 {
    let part = 0.5 * (5.0_f64.sqrt() - 1.0);
    for _ in 0..60 {
        let (a, b) = (high - part * (high - low), low + part * (high - low));
        if f(a) < f(b) { high = b } else { low = a }
    }
    0.5 * (low + high)
}

impl PowerLaw {
    /// Tone curve for the configuration: the exponent if the law fits, otherwise the luminances, made strictly
    /// increasing.
    pub fn tone(&self, luminances: &[f64]) -> Tone {
        if self.deviation <= POWER_LAW {
            return Tone::Gamma((self.gamma * 1e4).round() / 1e4);
        }
        let white = luminances.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let mut below = -1.0;
        let risen = luminances.iter().map(|l| {
            // Five digits exceed the precision of any camera.
            below = ((l.max(0.0) / white * 1e5).round() / 1e5_f64).max(below + 1e-5).max(0.0);
            below
        });
        Tone::Measured(risen.collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(of: impl Fn(f64) -> f64) -> Vec<f64> {
        (0..16).map(|i| of(f64::from(i) / 15.0)).collect()
    }

    #[test]
    fn exponents_and_black_are_found() {
        for gamma in [0.45, 1.0, 1.8, 2.2, 3.1] {
            let law = power_law(&curve(|c| 3.0 + 897.0 * c.powf(gamma))).unwrap();
            assert!((law.gamma - gamma).abs() < 1e-6 && (law.black - 3.0 / 900.0).abs() < 1e-6, "{law:?}");
            assert!(law.deviation < 1e-6);
            assert_eq!(law.tone(&[]), Tone::Gamma(gamma));
        }
    }

    #[test]
    fn the_exponents_standard_deviation_includes_noise() {
        // Pseudo-random noise, uniform within ±1.
        let noise = |i: u64| {
            let z = (i + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            let z = (z ^ (z >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            (z >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        let within = (0..200).filter(|trial| {
            let values: Vec<f64> =
                (0..16).map(|i| (i as f64 / 15.0).powf(2.2) + 0.003 * noise(100 * trial + i)).collect();
            let law = power_law(&values).unwrap();
            (law.gamma - 2.2).abs() < law.gamma_sigma
        });
        // 68 % of 200, within four standard deviations of that count.
        let within = within.count();
        assert!((110..=162).contains(&within), "{within}");
    }

    #[test]
    fn other_curves_are_kept_as_measured() {
        let values = curve(|c| if c < 0.5 { 0.1 * c } else { 0.05 + 1.9 * (c - 0.5) });
        let law = power_law(&values).unwrap();
        assert!(law.deviation > POWER_LAW);
        let Tone::Measured(kept) = law.tone(&values) else { panic!("a power law") };
        Tone::Measured(kept.clone()).check().unwrap();
        assert!(kept.iter().zip(&values).all(|(k, v)| (k - v).abs() < 1e-4));
        // Noise that makes black brighter than the next level must not yield an invalid curve.
        let tone = law.tone(&[0.002, 0.001, 0.0, 0.3, 1.0]);
        tone.check().unwrap();
    }

    #[test]
    fn invalid_curves_are_none() {
        assert!(power_law(&[0.0, 0.5, 1.0]).is_none() && power_law(&[f64::NAN; 16]).is_none());
        assert!(power_law(&[1.0; 16]).is_none() && power_law(&curve(|c| 1.0 - c)).is_none());
    }
}

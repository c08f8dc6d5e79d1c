//! Line counting: the strongest frequency along a slice.

use num_complex::Complex64;
use schemars::JsonSchema;
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// Number of harmonics attributed to the lines rather than to noise.
const HARMONICS: usize = 8;

/// Minimum ratio of the amplitude of the lines to its standard deviation.
const CLEAR: f64 = 6.0;

/// Minimum number of periods in a slice; fewer cannot be distinguished from uneven lighting.
const FEWEST: f64 = 2.5;

/// Periodic lines along a slice.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Lines {
    /// Period along the slice in pixels, and its standard deviation.
    pub period_px: [f64; 2],
    /// Number of lines that the slice crosses.
    pub count: f64,
    /// Amplitude of the fundamental, in units of light.
    pub amplitude: f64,
    /// Phase of the fundamental at the first sample: light is `amplitude · cos(2π x / period + phase)`.
    #[serde(skip)]
    pub phase: f64,
}

/// Finds lines; `None` without a significant peak.
///
/// Searches the slice's windowed (Hann) spectrum for its peak and refines the frequency continuously. The standard
/// deviation is the Cramér-Rao bound of a sinusoid in white noise, with the residual after subtraction of all harmonics
/// as noise.
pub(super) fn lines(values: &[f64]) -> Option<Lines> {
    let n = values.len();
    let straight = detrended(values);
    let window: Vec<f64> = (0..n).map(|i| (PI * (i as f64 + 0.5) / n as f64).sin().powi(2)).collect();
    let total: f64 = window.iter().sum();
    let at = |frequency: f64| -> Complex64 {
        let turned = |(i, (v, w)): (usize, (&f64, &f64))| Complex64::from_polar(v * w, -TAU * frequency * i as f64);
        straight.iter().zip(&window).enumerate().map(turned).sum::<Complex64>() * (2.0 / total)
    };
    // Four grid points per resolvable frequency step of a slice of this length.
    let step = 0.25 / n as f64;
    let first = (FEWEST / n as f64 / step).ceil() as usize;
    let last = (0.5 / step) as usize;
    let powers: Vec<f64> = (first..=last).map(|k| at(k as f64 * step).norm_sqr()).collect();
    let peak = (0..powers.len()).max_by(|a, b| powers[*a].total_cmp(&powers[*b]))?;
    if peak == 0 || peak + 1 == powers.len() {
        return None;
    }
    let middle = (first + peak) as f64 * step;
    let frequency = highest(&|f| at(f).norm_sqr(), middle - step, middle + step);
    let fundamental = at(frequency);
    let noise = residual_power(&straight, frequency);
    let amplitude = fundamental.norm();
    if !(amplitude > CLEAR * noise * (2.0 * 1.5 / n as f64).sqrt() && amplitude > 1e-12) {
        return None;
    }
    // Frequency in cycles per sample; the window increases the variance by a factor of about 1.5.
    let sigma = (1.5 * 24.0 * (noise / amplitude).powi(2) / (n as f64).powi(3)).sqrt() / TAU;
    let period = 1.0 / frequency;
    Some(Lines {
        period_px: [period, sigma * period * period],
        count: frequency * n as f64,
        amplitude,
        phase: fundamental.arg(),
    })
}

/// Subtracts mean and slope.
fn detrended(values: &[f64]) -> Vec<f64> {
    let n = values.len() as f64;
    let middle = 0.5 * (n - 1.0);
    let mean = values.iter().sum::<f64>() / n;
    let (mut across, mut square) = (0.0, 0.0);
    for (i, v) in values.iter().enumerate() {
        let x = i as f64 - middle;
        (across, square) = (across + x * v, square + x * x);
    }
    values.iter().enumerate().map(|(i, v)| v - mean - across / square * (i as f64 - middle)).collect()
}

/// Maximum of a unimodal function (golden-section search).
fn highest(of: &dyn Fn(f64) -> f64, mut from: f64, mut to: f64) -> f64 {
    let ratio = 0.5 * (5_f64.sqrt() - 1.0);
    for _ in 0..60 {
        let (a, b) = (to - ratio * (to - from), from + ratio * (to - from));
        if of(a) < of(b) { from = a } else { to = b }
    }
    0.5 * (from + to)
}

/// Standard deviation of the residual after subtraction of the harmonics.
fn residual_power(values: &[f64], frequency: f64) -> f64 {
    let n = values.len() as f64;
    let mut left = values.to_vec();
    for k in (1..=HARMONICS).take_while(|k| *k as f64 * frequency < 0.5) {
        let turn = |i: usize| Complex64::from_polar(1.0, -TAU * frequency * (k * i) as f64);
        let part = left.iter().enumerate().map(|(i, v)| turn(i) * *v).sum::<Complex64>() * (2.0 / n);
        left.iter_mut().enumerate().for_each(|(i, v)| *v -= (part * turn(i).conj()).re);
    }
    (left.iter().map(|v| v * v).sum::<f64>() / n).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(i: usize) -> f64 {
        let x = (i as f64 * 12.9898).sin() * 43_758.545_3;
        3.46 * (x - x.floor() - 0.5)
    }

    #[test]
    fn periods_are_found_to_their_uncertainty() {
        for (n, period, scatter) in [(200, 9.37, 0.02), (64, 11.1, 0.01), (1000, 23.456, 0.3), (300, 3.3, 0.1)] {
            let value = |i: usize| {
                let place = (i as f64 + 1.3) / period;
                0.4 + 0.3 * place.rem_euclid(1.0) + 1e-4 * i as f64 + scatter * noise(i)
            };
            let values: Vec<f64> = (0..n).map(value).collect();
            let found = lines(&values).unwrap();
            let [px, sigma] = found.period_px;
            assert!((px - period).abs() < 4.0 * sigma + 2e-3 * period, "{period}: {found:?}");
            assert!((found.count - n as f64 / period).abs() < 0.05 * found.count);
        }
    }

    #[test]
    fn nothing_is_found_where_there_is_nothing() {
        assert!(lines(&(0..300).map(noise).collect::<Vec<_>>()).is_none());
        assert!(lines(&[0.3; 200]).is_none());
        assert!(lines(&(0..200).map(|i| f64::from(i) * 0.1).collect::<Vec<_>>()).is_none());
    }
}

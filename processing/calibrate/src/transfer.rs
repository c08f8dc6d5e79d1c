//! Photon transfer: gain, read noise, full well, dark current and linearity from means and variances.
//!
//! Definitions follow EMVA Standard 1288, release 4.0 Linear, sections 6 and 7. The difference of two photographs of
//! one exposure has twice the variance of the temporal noise; patterns of light and sensor cancel.

use crate::series::{Group, values};
use nacre_base::Result;
use nacre_base::progress::Progress;
use schemars::JsonSchema;
use serde::Serialize;

/// Share of the saturation up to which the variance is fitted (EMVA 1288).
const FITTED: f64 = 0.7;

/// Range of the saturation in which the linearity is judged (EMVA 1288).
const LINEAR: [f64; 2] = [0.05, 0.95];

/// Variance of the quantisation in DN².
pub const QUANTISATION: f64 = 1.0 / 12.0;

/// Mean and temporal noise of the photographs of one exposure.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Level {
    /// Exposure time in s.
    pub exposure_s: f64,
    /// Number of photographs.
    pub photographs: usize,
    /// Mean value in DN.
    pub mean_dn: f64,
    /// Temporal variance of a pixel in DN².
    pub variance_dn2: f64,
    /// Standard deviation of `variance_dn2`.
    pub variance_sigma_dn2: f64,
}

/// Measures a group by the differences of its photographs in pairs, of which two are in memory.
///
/// # Errors
/// `Input` for files that cannot be read; `Cancelled`.
pub fn level(group: &Group, channel: usize, progress: &dyn Progress) -> Result<Level> {
    let (mut sum, mut squares, mut pairs) = (0.0, 0.0, 0_usize);
    let mut pixels = 1;
    for pair in group.files.chunks_exact(2) {
        let (a, b) = (values(&pair[0], channel, progress)?, values(&pair[1], channel, progress)?);
        pixels = a.len().max(1);
        let (mut total, mut difference, mut square) = (0.0, 0.0, 0.0);
        for (a, b) in a.iter().zip(&b) {
            let (a, b) = (f64::from(*a), f64::from(*b));
            total += a + b;
            difference += a - b;
            square += (a - b).powi(2);
        }
        let count = pixels as f64;
        sum += total / count;
        // Without the difference of the means, which the light changes.
        squares += (square / count - (difference / count).powi(2)) * count / (count - 1.0).max(1.0);
        pairs += 1;
        pair.iter().for_each(|_| progress.step());
    }
    let variance = 0.5 * squares / pairs as f64;
    Ok(Level {
        exposure_s: group.exposure_s,
        photographs: 2 * pairs,
        mean_dn: 0.5 * sum / pairs as f64,
        variance_dn2: variance,
        variance_sigma_dn2: variance * (2.0 / (pairs * pixels) as f64).sqrt(),
    })
}

/// A value and its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Measured {
    /// The value.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

/// Results of the photon transfer.
#[derive(Clone, Debug, PartialEq)]
pub struct Transfer {
    /// Gain in DN per electron.
    pub gain: Measured,
    /// Temporal noise of darkness in electrons, without quantisation.
    pub read_noise_e: Measured,
    /// Value of darkness at no exposure, in DN.
    pub black_dn: f64,
    /// Dark current in electrons per second; `None` for fewer than three exposures.
    pub dark_current_e_s: Option<Measured>,
    /// Electrons at saturation; `None` if the series does not reach it.
    pub full_well_e: Option<f64>,
    /// Mean at saturation, or the highest of the series, in DN.
    pub saturation_dn: f64,
    /// Mean deviation from proportionality to the exposure, as a share; `None` for fewer than three exposures.
    pub linearity: Option<f64>,
    /// Chi-square per degree of freedom of the straight line of variances.
    pub chi_square: f64,
    /// Number of exposures that the gain is fitted to.
    pub fitted: usize,
}

/// Photon transfer of levels with light against levels of darkness. `None` if no level with light is below saturation.
pub fn transfer(lit: &[Level], dark: &[Level]) -> Option<Transfer> {
    let top = lit.iter().max_by(|a, b| a.variance_dn2.total_cmp(&b.variance_dn2))?;
    let saturates = lit.iter().any(|l| l.mean_dn > top.mean_dn && l.variance_dn2 < 0.9 * top.variance_dn2);
    let saturation_dn = if saturates { top.mean_dn } else { lit.iter().map(|l| l.mean_dn).fold(0.0, f64::max) };
    let (offset, slope, slope_sigma) = dark_line(dark);
    let black = |l: &Level| offset + slope * l.exposure_s;
    let dark_of = |l: &Level| {
        let distance = |d: &&Level| (d.exposure_s / l.exposure_s).ln().abs();
        dark.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)))
    };
    let swing = saturation_dn - offset;
    let used: Vec<[f64; 3]> = lit
        .iter()
        .filter(|l| l.mean_dn - black(l) <= FITTED * swing && l.mean_dn > black(l))
        .filter_map(|l| {
            let dark = dark_of(l)?;
            let sigma = l.variance_sigma_dn2.hypot(dark.variance_sigma_dn2);
            Some([l.mean_dn - black(l), l.variance_dn2 - dark.variance_dn2, sigma.max(1e-12)])
        })
        .collect();
    let (top_sum, bottom) =
        used.iter().fold((0.0, 0.0), |(a, b), [x, y, s]| (a + x * y / (s * s), b + x * x / (s * s)));
    if bottom <= 0.0 || top_sum <= 0.0 {
        return None;
    }
    let gain = top_sum / bottom;
    let freedom = (used.len() - 1).max(1) as f64;
    let chi_square = used.iter().map(|[x, y, s]| ((y - gain * x) / s).powi(2)).sum::<f64>() / freedom;
    let gain = Measured { value: gain, sigma: chi_square.max(1.0).sqrt() / bottom.sqrt() };
    let shortest = dark.first()?;
    let noise = (shortest.variance_dn2 - QUANTISATION).max(0.0).sqrt() / gain.value;
    let noise_sigma = 0.5 * shortest.variance_sigma_dn2 / shortest.variance_dn2.max(1e-12).sqrt() / gain.value;
    let relative = gain.sigma / gain.value;
    Some(Transfer {
        gain,
        read_noise_e: Measured { value: noise, sigma: noise_sigma.hypot(noise * relative) },
        black_dn: offset,
        dark_current_e_s: (dark.len() >= 3).then(|| Measured {
            value: slope / gain.value,
            sigma: (slope_sigma / gain.value).hypot(slope / gain.value * relative),
        }),
        full_well_e: saturates.then(|| swing / gain.value),
        saturation_dn,
        linearity: linearity(lit, &black, offset, swing),
        chi_square,
        fitted: used.len(),
    })
}

/// Offset and slope (DN per s) of the dark means over the exposure, and the standard deviation of the slope.
fn dark_line(dark: &[Level]) -> (f64, f64, f64) {
    let n = dark.len() as f64;
    let mean = |of: &dyn Fn(&Level) -> f64| dark.iter().map(of).sum::<f64>() / n.max(1.0);
    let (t, y) = (mean(&|l| l.exposure_s), mean(&|l| l.mean_dn));
    let spread: f64 = dark.iter().map(|l| (l.exposure_s - t).powi(2)).sum();
    if dark.len() < 3 || spread <= 0.0 {
        return (y, 0.0, 0.0);
    }
    let slope = dark.iter().map(|l| (l.exposure_s - t) * (l.mean_dn - y)).sum::<f64>() / spread;
    let off = dark.iter().map(|l| (l.mean_dn - y - slope * (l.exposure_s - t)).powi(2)).sum::<f64>();
    (y - slope * t, slope, (off / (n - 2.0) / spread).sqrt())
}

/// Mean relative deviation from the straight line through all exposures within the judged range.
fn linearity(lit: &[Level], black: &dyn Fn(&Level) -> f64, offset: f64, swing: f64) -> Option<f64> {
    let inside = |l: &&Level| (LINEAR[0]..=LINEAR[1]).contains(&((l.mean_dn - offset) / swing));
    let used: Vec<[f64; 2]> = lit.iter().filter(inside).map(|l| [l.exposure_s, l.mean_dn - black(l)]).collect();
    if used.len() < 3 {
        return None;
    }
    // Relative deviations are least: weights are the inverse squares of the values.
    let sums = used.iter().fold([0.0; 5], |s, [t, y]| {
        let w = 1.0 / (y * y);
        [s[0] + w, s[1] + w * t, s[2] + w * t * t, s[3] + w * y, s[4] + w * t * y]
    });
    let determinant = sums[0] * sums[2] - sums[1] * sums[1];
    if determinant.abs() < 1e-12 * sums[0] * sums[2] {
        return None;
    }
    let slope = (sums[0] * sums[4] - sums[1] * sums[3]) / determinant;
    let start = (sums[2] * sums[3] - sums[1] * sums[4]) / determinant;
    let deviation = |[t, y]: &[f64; 2]| ((start + slope * t - y) / y).abs();
    Some(used.iter().map(deviation).sum::<f64>() / used.len() as f64)
}

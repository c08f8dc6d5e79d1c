//! Photon transfer: gain, read noise, full well, dark current and linearity from means and variances.
//!
//! Definitions follow EMVA Standard 1288, release 4.0 Linear, sections 6 and 7. The difference of two photographs of
//! one exposure has twice the variance of the temporal noise; patterns of light and sensor cancel.

use crate::response::{RANGE, Response};
use crate::series::{Group, values};
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_base::statistics::quantile;
use schemars::JsonSchema;
use serde::Serialize;

/// Share of the saturation up to which the variance is fitted (EMVA 1288).
const FITTED: f64 = 0.7;

/// Smallest share of the pixels that must be unsaturated for them to count alone.
const ENOUGH: f64 = 0.1;

/// Percentile of the values that stands for saturation, in uneven light too.
const HIGH: f64 = 0.9;

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
    /// Share of the pixels that are far below saturation; mean and variance are theirs if they are a tenth or more.
    pub unsaturated: f64,
    /// 90th percentile of the values in DN: saturation, where most pixels are saturated.
    pub high_dn: f64,
}

/// Sums over pixels of pairs of photographs.
#[derive(Clone, Copy, Default)]
struct Sums {
    pixels: f64,
    total: f64,
    difference: f64,
    square: f64,
}

impl Sums {
    fn add(&mut self, a: f64, b: f64) {
        self.pixels += 1.0;
        self.total += a + b;
        self.difference += a - b;
        self.square += (a - b).powi(2);
    }

    fn mean(&self) -> f64 {
        0.5 * self.total / self.pixels.max(1.0)
    }

    /// Temporal variance, without the difference of the means, which the light changes.
    fn variance(&self) -> f64 {
        let n = self.pixels.max(2.0);
        0.5 * (self.square / n - (self.difference / n).powi(2)) * n / (n - 1.0)
    }
}

impl Level {
    /// True if the mean is that of all pixels, so that it grows with the light.
    pub fn is_whole(&self) -> bool {
        self.unsaturated >= 1.0 || self.unsaturated < ENOUGH
    }
}

/// Measures a group by the differences of its photographs in pairs, of which two are in memory. Values are corrected by
/// the response.
///
/// Pixels are selected by the sum of a pair, which is independent of their difference. Those above `FITTED` of white
/// are left out, unless nearly all are.
///
/// # Errors
/// `Input` for files that cannot be read; `Cancelled`.
pub fn level(group: &Group, channel: usize, response: &Response, progress: &dyn Progress) -> Result<Level> {
    let white = response.linearised(response.white_dn);
    let (mut all, mut low, mut pairs, mut high) = (vec![], vec![], 0, 0.0);
    for pair in group.files.chunks_exact(2) {
        let (a, b) = (values(&pair[0], channel, progress)?, values(&pair[1], channel, progress)?);
        let (mut every, mut unsaturated) = (Sums::default(), Sums::default());
        high += response.linearised(quantile(&mut a.clone(), HIGH).unwrap_or(0.0).into());
        for (a, b) in a.iter().zip(&b) {
            let [a, b] = [*a, *b].map(|v| response.linearised(v.into()));
            every.add(a, b);
            if a + b <= 2.0 * FITTED * white {
                unsaturated.add(a, b);
            }
        }
        all.push(every);
        low.push(unsaturated);
        pairs += 1;
        pair.iter().for_each(|_| progress.step());
    }
    let pixels = |sums: &[Sums]| sums.iter().map(|s| s.pixels).sum::<f64>();
    let unsaturated = pixels(&low) / pixels(&all).max(1.0);
    let used = if unsaturated >= ENOUGH { low } else { all };
    let mean = |of: fn(&Sums) -> f64| used.iter().map(of).sum::<f64>() / f64::from(pairs);
    let variance = mean(Sums::variance);
    Ok(Level {
        exposure_s: group.exposure_s,
        photographs: 2 * pairs as usize,
        mean_dn: mean(Sums::mean),
        variance_dn2: variance,
        variance_sigma_dn2: variance * (2.0 / pixels(&used).max(1.0)).sqrt(),
        unsaturated,
        high_dn: high / f64::from(pairs),
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
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Transfer {
    /// Gain K in DN per electron.
    pub gain_dn_e: Measured,
    /// Read noise in electrons: temporal noise of darkness without exposure and quantisation.
    pub read_noise_e: Measured,
    /// Value without light and exposure in DN.
    pub black_dn: f64,
    /// Dark current in electrons per second; none for fewer than three dark exposures.
    pub dark_current_e_s: Option<Measured>,
    /// Electrons at saturation; none if no photograph is saturated.
    pub full_well_e: Option<f64>,
    /// Value at saturation, or the highest one, in DN: the 90th percentile of the brightest exposure.
    pub saturation_dn: f64,
    /// Mean deviation from proportionality to the exposure, as a share; none for fewer than three exposures.
    pub linearity_error: Option<f64>,
    /// Chi-square per degree of freedom of the straight line of variances over means.
    pub chi_square: f64,
    /// Number of exposures with light that the gain is fitted to.
    pub fitted: usize,
}

/// Photon transfer of levels with light against levels of darkness. `None` if no level with light is below saturation.
pub fn transfer(lit: &[Level], dark: &[Level]) -> Option<Transfer> {
    let top = lit.iter().max_by(|a, b| a.variance_dn2.total_cmp(&b.variance_dn2))?;
    let saturates = lit.iter().any(|l| l.mean_dn > top.mean_dn && l.variance_dn2 < 0.9 * top.variance_dn2);
    let saturation_dn = lit.iter().map(|l| l.high_dn).fold(0.0, f64::max);
    let darkness = DarkLine::of(dark);
    let DarkLine { offset, slope, slope_sigma } = darkness;
    let black = |l: &Level| darkness.at(l);
    let swing = saturation_dn - offset;
    let below = lit.iter().filter(|l| l.mean_dn - offset <= FITTED * swing && l.mean_dn > black(l));
    // Electrons of darkness scatter as those of light do, so that dark levels lie on the same line.
    let used: Vec<[f64; 3]> =
        below.chain(dark).map(|l| [l.mean_dn - offset, l.variance_dn2, l.variance_sigma_dn2.max(1e-12)]).collect();
    let fitted = used.len().checked_sub(dark.len()).filter(|n| *n > 0)?;
    let line = line(&used)?;
    if line.slope.value <= 0.0 {
        return None;
    }
    let (gain, chi_square) = (line.slope, line.chi_square);
    let variance = line.start.value - QUANTISATION;
    let noise = variance.max(0.0).sqrt() / gain.value;
    let noise_sigma = 0.5 * line.start.sigma / variance.max(line.start.sigma).sqrt() / gain.value;
    let relative = gain.sigma / gain.value;
    Some(Transfer {
        gain_dn_e: gain,
        read_noise_e: Measured { value: noise, sigma: noise_sigma.hypot(noise * relative) },
        black_dn: offset,
        dark_current_e_s: (dark.len() >= 3).then(|| Measured {
            value: slope / gain.value,
            sigma: (slope_sigma / gain.value).hypot(slope / gain.value * relative),
        }),
        full_well_e: saturates.then(|| swing / gain.value),
        saturation_dn,
        linearity_error: linearity(lit, &black, offset, swing),
        chi_square,
        fitted,
    })
}

/// A straight line through points, and chi-square per degree of freedom.
struct Line {
    start: Measured,
    slope: Measured,
    chi_square: f64,
}

/// The weighted line through points `[x, y, standard deviation of y]`; scatter beyond the deviations enlarges those of
/// the result. `None` if all points have one x.
fn line(points: &[[f64; 3]]) -> Option<Line> {
    let sums = points.iter().fold([0.0; 5], |s, [x, y, sigma]| {
        let w = 1.0 / (sigma * sigma);
        [s[0] + w, s[1] + w * x, s[2] + w * x * x, s[3] + w * y, s[4] + w * x * y]
    });
    let determinant = sums[0] * sums[2] - sums[1] * sums[1];
    if determinant <= 1e-12 * sums[0] * sums[2] {
        return None;
    }
    let slope = (sums[0] * sums[4] - sums[1] * sums[3]) / determinant;
    let start = (sums[2] * sums[3] - sums[1] * sums[4]) / determinant;
    let off = |[x, y, sigma]: &[f64; 3]| ((start + slope * x - y) / sigma).powi(2);
    let chi_square = points.iter().map(off).sum::<f64>() / (points.len() as f64 - 2.0).max(1.0);
    let sigma = |variance: f64| (variance / determinant * chi_square.max(1.0)).sqrt();
    Some(Line {
        start: Measured { value: start, sigma: sigma(sums[2]) },
        slope: Measured { value: slope, sigma: sigma(sums[0]) },
        chi_square,
    })
}

/// The dark means over the exposure.
#[derive(Clone, Copy)]
pub struct DarkLine {
    /// Value at no exposure in DN.
    pub offset: f64,
    /// Growth in DN per s.
    slope: f64,
    /// Standard deviation of the growth.
    slope_sigma: f64,
}

impl DarkLine {
    /// The straight line through the means; a constant for fewer than three.
    pub fn of(dark: &[Level]) -> Self {
        let n = dark.len() as f64;
        let mean = |of: &dyn Fn(&Level) -> f64| dark.iter().map(of).sum::<f64>() / n.max(1.0);
        let (t, y) = (mean(&|l| l.exposure_s), mean(&|l| l.mean_dn));
        let spread: f64 = dark.iter().map(|l| (l.exposure_s - t).powi(2)).sum();
        if dark.len() < 3 || spread <= 0.0 {
            return Self { offset: y, slope: 0.0, slope_sigma: 0.0 };
        }
        let slope = dark.iter().map(|l| (l.exposure_s - t) * (l.mean_dn - y)).sum::<f64>() / spread;
        let off = dark.iter().map(|l| (l.mean_dn - y - slope * (l.exposure_s - t)).powi(2)).sum::<f64>();
        Self { offset: y - slope * t, slope, slope_sigma: (off / (n - 2.0) / spread).sqrt() }
    }

    /// Value of darkness in DN at the exposure of a level.
    pub fn at(&self, level: &Level) -> f64 {
        self.offset + self.slope * level.exposure_s
    }
}

/// Mean relative deviation from the straight line through all exposures within the judged range.
fn linearity(lit: &[Level], black: &dyn Fn(&Level) -> f64, offset: f64, swing: f64) -> Option<f64> {
    let inside = |l: &&Level| l.is_whole() && (RANGE[0]..=RANGE[1]).contains(&((l.mean_dn - offset) / swing));
    let used: Vec<[f64; 2]> = lit.iter().filter(inside).map(|l| [l.exposure_s, l.mean_dn - black(l)]).collect();
    if used.len() < 3 {
        return None;
    }
    // Relative deviations are least.
    let points: Vec<[f64; 3]> = used.iter().map(|[t, y]| [*t, *y, *y]).collect();
    let Line { start, slope, .. } = line(&points)?;
    let (start, slope) = (start.value, slope.value);
    let deviation = |[t, y]: &[f64; 2]| ((start + slope * t - y) / y).abs();
    Some(used.iter().map(deviation).sum::<f64>() / used.len() as f64)
}

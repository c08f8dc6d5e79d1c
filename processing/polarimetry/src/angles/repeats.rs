//! Noise from repeated views. Views at equal angles, or at angles 180° apart, show the same light, so their differences
//! are noise, for any scene and model. They calibrate the noise, and test whether σ matches the scatter of repeated
//! measurements.

use crate::angles::sample::{AREA, Half, SIDE, Sample};
use crate::fit::noise::line_above;
use crate::fit::views::View;
use crate::orient;
use crate::{Design, FrameNoise, angle_difference};
use nacre_base::statistics::{median, median_chi_square};
use nacre_frames::LoadedFrames;
use schemars::JsonSchema;
use serde::Serialize;
use std::f64::consts::PI;

/// Largest difference modulo 180° of angles that count as equal, in degrees: the reading accuracy of goniometers.
const SAME_ANGLE_DEG: f64 = 0.05;

/// Minimum number of repeated angles: with three, each half of the series determines an orientation, and noise is
/// sampled at all intensities of a turn.
const MIN_ANGLES: usize = 3;

/// Minimum number of blocks for a noise estimate, and minimum number of blocks of similar intensity in a group.
const MIN_BLOCKS: usize = 16;
const GROUPS: usize = 24;

/// Variance of a block, relative to its noise, above which it counts as textured: a rotating analyser shifts texture.
const TEXTURED: f64 = 3.0;

/// Range of reduced χ² without a warning.
const GOOD: std::ops::RangeInclusive<f64> = 0.8..=1.3;

/// Relative difference of exposures that count as equal.
const SAME_EXPOSURE: f64 = 1e-6;

/// Results from repeated views.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct RepeatsReport {
    /// Number of pairs of views at angles equal modulo 180°.
    pub pairs: usize,
    /// Brightness of the second view of each pair relative to the first.
    pub gain: Vec<f64>,
    /// Pixels on which both halves of the series were compared; noise is calibrated on other pixels.
    pub pixels: usize,
    /// Median over these pixels of the polarization angle of the second half minus that of the first, in degrees.
    pub offset_deg: f64,
    /// Root mean square of that difference, in degrees.
    pub difference_deg: f64,
    /// Its expected value from the σ of both halves, in degrees.
    pub expected_deg: f64,
    /// Reduced χ²: the mean squared difference over the sum of both σ²; 1 for a correct σ.
    pub chi2: f64,
    /// Reduced χ² from the median, which is robust against dust and edges.
    pub chi2_median: f64,
}

impl RepeatsReport {
    /// Warning for the user.
    pub fn warning(&self) -> Option<String> {
        let sigma = if self.chi2 > 1.0 { "too small" } else { "too large" };
        (!GOOD.contains(&self.chi2)).then(|| {
            format!(
                "the halves of the series differ by {:.3}° where σ says {:.3}° (reduced χ² {:.2}, {:.2} by the median): σ is {sigma}",
                self.difference_deg, self.expected_deg, self.chi2, self.chi2_median
            )
        })
    }
}

/// Pairs of repeated views by index. Empty unless all photographs have the same exposure and at least three angles are
/// repeated.
pub(crate) fn pairs(frames: &LoadedFrames, views: &[View], kept: usize) -> Vec<[usize; 2]> {
    let all = &frames.set.frames;
    let alike = |a: f64, b: f64| (a / b - 1.0).abs() < SAME_EXPOSURE;
    let one_exposure = all
        .windows(2)
        .all(|f| alike(f[0].scale(), f[1].scale()) && alike(f[0].gain.unwrap_or(1.0), f[1].gain.unwrap_or(1.0)));
    if !one_exposure {
        return vec![];
    }
    paired(&views.iter().take(kept).map(|v| v.stated).collect::<Vec<_>>())
}

fn paired(angles: &[f64]) -> Vec<[usize; 2]> {
    let apart = |a: f64, b: f64| angle_difference(a, b).to_degrees().abs();
    let mut waiting: Vec<usize> = vec![];
    let mut pairs: Vec<[usize; 2]> = vec![];
    for (k, psi) in angles.iter().enumerate() {
        match waiting.iter().position(|first| apart(angles[*first], *psi) < SAME_ANGLE_DEG) {
            Some(i) => pairs.push([waiting.remove(i), k]),
            None => waiting.push(k),
        }
    }
    let repeated: Vec<f64> = pairs.iter().map(|[k, _]| angles[*k]).collect();
    let first = |i: &usize| repeated[..*i].iter().all(|a| apart(*a, repeated[*i]) >= SAME_ANGLE_DEG);
    if (0..repeated.len()).filter(first).count() < MIN_ANGLES { vec![] } else { pairs }
}

/// Noise of a view from the differences of repeats, on one half of the sample. Values at or below `black` are clipped
/// and excluded. `quantisation` is the variance of rounding to codes, which repeats of a quiet camera do not show.
pub(crate) fn calibrate(sample: &Sample, pairs: &[[usize; 2]], black: f64, quantisation: f64) -> Option<FrameNoise> {
    let mut seen: Vec<BlockPair> = vec![];
    for [p, q] in pairs {
        let (first, second) = (sample.view(*p), sample.view(*q));
        let gain = gain(sample, first, second)?;
        let block = |b: usize| BlockPair::new(&first[b * AREA..][..AREA], &second[b * AREA..][..AREA], gain, black);
        seen.extend(sample.half(Half::Black).filter_map(block));
    }
    if seen.len() < MIN_BLOCKS {
        return None;
    }
    seen.sort_by(|a, b| a.level.total_cmp(&b.level));
    let size = seen.len().div_ceil(GROUPS).max(MIN_BLOCKS);
    let point =
        |group: &mut [BlockPair]| (BlockPair::level(group), with_rounding(BlockPair::noise(group), quantisation));
    let points: Vec<(f64, f64)> = seen.chunks_mut(size).map(point).collect();
    Some(line_above(&points, quantisation))
}

/// Noise variance including rounding (`quantisation` = step²/12), from the variance `seen` of repeats. Repeats of a
/// quiet camera are rounded alike, so their differences do not contain the rounding error. Assume two values with the
/// same noise, uniformly distributed over the codes. The covariance of their rounding errors is a sum over the
/// harmonics of the staircase (Sripad and Snyder 1977).
fn with_rounding(seen: f64, quantisation: f64) -> f64 {
    const HARMONICS: u32 = 32;
    const HALVINGS: u32 = 60;
    let step2 = 12.0 * quantisation;
    let alike = |variance: f64| -> f64 {
        let harmonic = |m: u32| {
            let k = f64::from(m * m);
            (-4.0 * PI * PI * k * variance / step2).exp() / k
        };
        step2 / (2.0 * PI * PI) * (1..=HARMONICS).map(harmonic).sum::<f64>()
    };
    // From three steps of noise on, and for unquantised values, the differences contain all of it.
    if seen >= 9.0 * step2 {
        return seen;
    }
    let (mut low, mut high) = (0.0, seen);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if middle + quantisation - alike(middle) < seen { low = middle } else { high = middle }
    }
    low + quantisation
}

/// Brightness of the second view relative to the first: median over the brighter blocks.
fn gain(sample: &Sample, first: &[f32], second: &[f32]) -> Option<f64> {
    let sum = |view: &[f32]| view.iter().map(|v| f64::from(*v)).sum::<f64>();
    let blocks = first.chunks(AREA).zip(second.chunks(AREA)).take(sample.view(0).len() / AREA);
    let mut means: Vec<(f64, f64)> =
        blocks.map(|(a, b)| (sum(a), sum(b))).filter(|(a, b)| *a > 0.0 && b.is_finite()).collect();
    means.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut ratios: Vec<f64> = means[means.len() / 2..].iter().map(|(a, b)| b / a).collect();
    median(&mut ratios).filter(|g| *g > 0.0)
}

/// A block in two views.
struct BlockPair {
    level: f64,
    /// Variance of a view, from the difference of both.
    noise: f64,
    /// Variance from the sum of both views, which also contains the texture of the block.
    texture: f64,
}

impl BlockPair {
    fn new(first: &[f32], second: &[f32], gain: f64, black: f64) -> Option<Self> {
        let usable = |v: &f32| v.is_finite() && f64::from(*v) > black;
        if !first.iter().chain(second).all(usable) {
            return None;
        }
        let together = |sign: f64| {
            let all: [f64; AREA] = std::array::from_fn(|i| f64::from(second[i]) + sign * gain * f64::from(first[i]));
            all
        };
        let [difference, sum] = [together(-1.0), together(1.0)];
        let share = 1.0 / (1.0 + gain * gain);
        Some(Self {
            level: 0.5 * sum.iter().sum::<f64>() / AREA as f64,
            noise: share * about_plane(&difference),
            texture: share * about_plane(&sum),
        })
    }

    fn level(group: &[Self]) -> f64 {
        group.iter().map(|s| s.level).sum::<f64>() / group.len().max(1) as f64
    }

    /// Variance of a group of blocks: the median over blocks without texture, or over the smoother half if there are
    /// fewer of them.
    fn noise(group: &mut [Self]) -> f64 {
        let of = |blocks: &[Self]| median(&mut blocks.iter().map(|s| s.noise).collect::<Vec<_>>()).unwrap_or(0.0);
        let about = of(group);
        group.sort_by(|a, b| a.texture.total_cmp(&b.texture));
        let plain = group.partition_point(|s| s.texture < TEXTURED * about);
        of(&group[..plain.max(group.len().div_ceil(2))]) * FREEDOM as f64 / median_chi_square(FREEDOM)
    }
}

/// A plane takes three degrees of freedom.
const FREEDOM: usize = AREA - 3;

/// Variance about the best-fitting plane, because drifting light adds a plane to the difference.
fn about_plane(block: &[f64; AREA]) -> f64 {
    let middle = 0.5 * (SIDE - 1) as f64;
    let mut sums = [0.0; 4];
    for (i, v) in block.iter().enumerate() {
        let (x, y) = ((i % SIDE) as f64 - middle, (i / SIDE) as f64 - middle);
        sums = [sums[0] + v, sums[1] + v * x, sums[2] + v * y, sums[3] + v * v];
    }
    let [one, x, y, square] = sums;
    let across = AREA as f64 * ((SIDE * SIDE - 1) as f64) / 12.0;
    (square - one * one / AREA as f64 - (x * x + y * y) / across).max(0.0) / FREEDOM as f64
}

/// Compares the polarization angles of the two halves of a series of repeats, on the pixels that noise was not
/// calibrated on.
pub(crate) fn compare_halves(
    sample: &Sample,
    pairs: &[[usize; 2]],
    views: &[View],
    noise: &[FrameNoise],
) -> Option<RepeatsReport> {
    let blocks: Vec<usize> = sample.half(Half::White).collect();
    let halves = [0, 1].map(|half| {
        let views: Vec<(usize, f64)> = pairs.iter().map(|p| (p[half], views[p[half]].angle)).collect();
        let design = Design::new(&views.iter().map(|v| v.1).collect::<Vec<_>>()).ok()?;
        let noise: Vec<FrameNoise> = views.iter().filter_map(|(k, _)| noise.get(*k)).copied().collect();
        let mut maps = sample.solve(&blocks, &views, &design);
        Some(orient(&mut maps, &design, &noise, 0.0))
    });
    let [Some(a), Some(b)] = halves else { return None };
    let both = a.orientation.iter().zip(&b.orientation).zip(a.sigma.iter().zip(&b.sigma));
    let differences: Vec<(f64, f64)> = both
        .map(|((a, b), (sa, sb))| {
            (angle_difference(f64::from(*b), f64::from(*a)), f64::from(*sa).hypot(f64::from(*sb)))
        })
        .filter(|(d, _)| d.is_finite())
        .collect();
    let n = differences.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| differences.iter().map(of).sum::<f64>() / n;
    let mut scaled: Vec<f64> = differences.iter().map(|(d, s)| (d / s).powi(2)).collect();
    let mut plain: Vec<f64> = differences.iter().map(|(d, _)| d.to_degrees()).collect();
    Some(RepeatsReport {
        pairs: pairs.len(),
        gain: pairs.iter().filter_map(|[p, q]| gain(sample, sample.view(*p), sample.view(*q))).collect(),
        pixels: differences.len(),
        chi2_median: median(&mut scaled)? / MEDIAN_OF_SQUARE,
        offset_deg: median(&mut plain)?,
        difference_deg: mean(|(d, _)| d * d).sqrt().to_degrees(),
        expected_deg: mean(|(_, s)| s * s).sqrt().to_degrees(),
        chi2: mean(|(d, s)| (d / s).powi(2)),
    })
}

/// Median of χ² with one degree of freedom.
const MEDIAN_OF_SQUARE: f64 = 0.454_936;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{normal, uniform};

    /// From repeats that mostly round alike to repeats that never do, the error is found to 5 %.
    #[test]
    fn noise_hidden_by_rounding_is_restored() {
        const N: u64 = 200_000;
        for sigma in [0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 4.0] {
            let (mut between, mut about) = (0.0, 0.0);
            for i in 0..N {
                let truth = 100.0 * uniform(1, i);
                let [p, q] = [2, 3].map(|seed| (truth + sigma * normal(seed, i)).round());
                between += (p - q).powi(2) / (2 * N) as f64;
                about += (p - truth).powi(2) / N as f64;
            }
            let found = with_rounding(between, 1.0 / 12.0);
            assert!((found / about - 1.0).abs() < 0.05, "{sigma}: {found} {about}, differ by {between}");
        }
        assert_eq!(with_rounding(2.0, 0.0), 2.0);
    }
}

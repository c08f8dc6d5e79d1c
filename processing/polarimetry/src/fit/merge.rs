//! Merges several exposures of one view into an intensity per pixel with its variance.
//!
//! Each pixel uses its unsaturated exposures, weighted by their inverse variances (shot + read + quantisation), which
//! is the best linear estimate. Short exposures contribute to bright pixels, long ones to dark pixels.

use crate::FrameNoise;
use nacre_frames::{ASSUMED, BELOW_WHITE_SIGMA};
use nacre_frames::{Linearizer, LoadedFrames};

/// Merges rows of photographs that differ only in exposure.
pub(crate) struct Merge {
    noise: Vec<FrameNoise>,
}

/// Saturation margin of each photograph of a bracket below white, relative to white minus black; the shortest exposure
/// may reach white.
pub(crate) fn clear_of_white(frames: &LoadedFrames, linearizer: &Linearizer, bracket: &[usize]) -> Vec<f64> {
    let camera = frames.set.noise.unwrap_or(ASSUMED);
    let frame = |k: &usize| &frames.set.frames[*k];
    let shortest = bracket.iter().map(|k| frame(k).scale()).fold(0.0, f64::max);
    let margin = |k: &usize| {
        let FrameNoise { shot, floor } = camera.frame(frame(k).gain.unwrap_or(1.0), 1.0, linearizer.step());
        if frame(k).scale() < shortest { BELOW_WHITE_SIGMA * (shot + floor).sqrt() } else { 0.0 }
    };
    bracket.iter().map(margin).collect()
}

/// A row of linear values during a merge.
#[derive(Clone, Copy, Default)]
struct Sums {
    /// Σ 1/shot, the number of electrons per unit of intensity, and Σ I/shot.
    electrons: f32,
    first: f32,
    /// Σ w and Σ w I with w the inverse variance.
    weight: f32,
    light: f32,
}

impl Merge {
    /// A merge of photographs with this noise, in the order in which `row` is called for them.
    pub(crate) fn new(noise: Vec<FrameNoise>) -> Self {
        Self { noise }
    }

    /// With variances multiplied by `factor`.
    pub(crate) fn scaled(&self, factor: f64) -> Self {
        Self { noise: self.noise.iter().map(|n| n.scaled(factor)).collect() }
    }

    /// Noise of merged exposures if none is saturated: exact in the bright and the dark limit.
    pub(crate) fn together(noise: &[FrameNoise]) -> FrameNoise {
        if let [one] = noise {
            return *one;
        }
        let parallel = |of: fn(&FrameNoise) -> f64| 1.0 / noise.iter().map(|n| 1.0 / of(n)).sum::<f64>();
        FrameNoise { shot: parallel(|n| n.shot), floor: parallel(|n| n.floor) }
    }

    /// Merges one row. `row(k, values, bad)` fills in linear values of the `k`-th photograph. `bad[x]` is set to 1
    /// where all photographs are saturated; value and variance are then those of total darkness.
    pub(crate) fn row(
        &self,
        row: impl Fn(usize, &mut [f32], &mut [u8]),
        values: &mut [f32],
        variances: &mut [f32],
        bad: &mut [u8],
    ) {
        let width = values.len();
        let mut sums = vec![Sums::default(); width];
        let mut read: Vec<(Vec<f32>, Vec<u8>)> =
            self.noise.iter().map(|_| (vec![0.0; width], vec![0; width])).collect();
        for (k, (light, saturated)) in read.iter_mut().enumerate() {
            row(k, light, saturated);
            let electrons = (1.0 / self.noise[k].shot.max(f64::from(f32::MIN_POSITIVE))) as f32;
            for ((sum, light), _) in sums.iter_mut().zip(light).zip(saturated).filter(|(_, s)| **s == 0) {
                sum.electrons += electrons;
                sum.first += electrons * *light;
            }
        }
        for ((light, saturated), noise) in read.iter().zip(&self.noise) {
            let (shot, floor) = (noise.shot as f32, noise.floor as f32);
            for ((sum, light), _) in sums.iter_mut().zip(light).zip(saturated).filter(|(_, s)| **s == 0) {
                // All exposures are weighted at a common intensity, since lower values would otherwise have larger
                // weights.
                let weight = 1.0 / (shot * (sum.first / sum.electrons).max(0.0) + floor).max(f32::MIN_POSITIVE);
                sum.weight += weight;
                sum.light += weight * light;
            }
        }
        for (x, sum) in sums.iter().enumerate() {
            if sum.weight > 0.0 {
                // A correction of one electron: low intensities also have larger weights in the fit over angles.
                values[x] = sum.light / sum.weight + 1.0 / sum.electrons;
                variances[x] = 1.0 / sum.weight;
            } else {
                (values[x], variances[x], bad[x]) = (0.0, 1.0, 1);
            }
        }
    }
}

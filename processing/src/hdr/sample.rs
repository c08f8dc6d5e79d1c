//! Some pixels of every exposure: what a response is recovered from, and what the exposures are checked against each other on.

use super::coding::{Coding, Entry, Scatter};
use crate::frames::Frame;
use crate::image::{Raster, Samples};
use serde::Serialize;

/// Most pixels, and most values of all exposures together, whatever their number.
const PIXELS: usize = 16_384;
const VALUES: usize = 8 << 20;

/// Light this many standard deviations above nothing is what exposures are compared on.
const CLEAR_SIGMA: f64 = 10.0;

/// Values of the same pixels in every exposure.
pub(super) struct Sample {
    pixels: Vec<usize>,
    channels: Vec<usize>,
    /// Per exposure: file values of each pixel's merged channels.
    pub values: Vec<Vec<f32>>,
}

/// How well the exposures agree.
#[derive(Clone, Debug, Serialize)]
pub(super) struct Agreement {
    /// Mean squared deviation from the merged light over the variance that noise explains, per degree of freedom; the median over the
    /// sample, corrected to the mean of a normal one. None where no pixel was measured twice.
    pub chi2: Option<f64>,
    /// Per exposure: the factor that its light is brighter by than the others', and its standard deviation. None for exposures that
    /// share no pixel with another.
    pub gains: Vec<Option<[f64; 2]>>,
}

impl Sample {
    /// Of images of this size, spread evenly.
    pub(super) fn new(width: usize, height: usize, channels: &[usize], frames: usize) -> Self {
        let most = PIXELS.min(VALUES / (frames * channels.len()).max(1)).max(1);
        let step = ((width * height) as f64 / most as f64).sqrt().max(1.0);
        let along =
            |length: usize| (0..).map(move |i| ((f64::from(i) + 0.5) * step) as usize).take_while(move |x| *x < length);
        let pixels = along(height).flat_map(|y| along(width).map(move |x| y * width + x)).collect();
        Self { pixels, channels: channels.to_vec(), values: vec![vec![]; frames] }
    }

    /// Takes in the `k`-th exposure.
    pub(super) fn put(&mut self, k: usize, raster: &Raster) {
        let at = self.pixels.iter().flat_map(|p| self.channels.iter().map(move |c| p * raster.channels + c));
        self.values[k] = match &raster.samples {
            Samples::U8(v) => at.map(|i| v[i].into()).collect(),
            Samples::U16(v) => at.map(|i| v[i].into()).collect(),
            Samples::F32(v) => at.map(|i| v[i]).collect(),
        };
    }

    /// Values of one channel: per exposure, per pixel.
    pub(super) fn of_channel(&self, position: usize) -> Vec<Vec<f32>> {
        let n = self.channels.len();
        self.values.iter().map(|v| v.iter().skip(position).step_by(n).copied().collect()).collect()
    }

    /// Compares the exposures with what they are merged into.
    pub(super) fn agreement(&self, coding: &Coding, frames: &[Frame]) -> Agreement {
        let n = self.channels.len();
        let light: Vec<Vec<Entry>> = frames
            .iter()
            .zip(&self.values)
            .map(|(frame, values)| {
                let entry = |(i, v): (usize, &f32)| coding.entry(self.channels[i % n], frame, f64::from(*v));
                values.iter().enumerate().map(entry).collect()
            })
            .collect();
        let scatters: Vec<Scatter> = frames.iter().map(|f| coding.scatter(f)).collect();
        let longest = (0..frames.len()).map(|k| frames[k].scale()).fold(0.0, f64::max);
        let samples = self.pixels.len() * n;
        let mut chi2: Vec<f64> = Vec::with_capacity(samples);
        let mut gains = vec![(0.0_f64, 0.0_f64); frames.len()];
        for i in 0..samples {
            let seen: Vec<usize> = (0..frames.len()).filter(|k| light[*k][i][1].is_finite()).collect();
            let freedom = seen.len().saturating_sub(1);
            if freedom == 0 {
                continue;
            }
            // One light for all weights, by the exposures' lengths.
            let length = |k: &usize| longest / frames[*k].scale();
            let first = seen.iter().map(|k| length(k) * f64::from(light[*k][i][0])).sum::<f64>();
            let common = (first / seen.iter().map(length).sum::<f64>()) as f32;
            let weighted = |k: &usize| {
                let weight = f64::from(scatters[*k].weight(common, light[*k][i][1]));
                (*k, weight * f64::from(light[*k][i][0]), weight)
            };
            let entries: Vec<(usize, f64, f64)> = seen.iter().map(weighted).collect();
            let (light, weight) = entries.iter().fold((0.0, 0.0), |(a, b), (_, x, w)| (a + x, b + w));
            let mean = light / weight;
            let mut square = 0.0;
            for (k, x, w) in entries {
                square += w * (x / w - mean).powi(2);
                // Against the others alone, which do not hold its own noise.
                let (others, rest) = ((light - x), weight - w);
                // Where the others know little, their noise would be taken for light.
                if rest > 0.0 && others > CLEAR_SIGMA * rest.sqrt() {
                    let (expected, variance) = (others / rest, 1.0 / w + 1.0 / rest);
                    gains[k].0 += x / w * expected / variance;
                    gains[k].1 += expected * expected / variance;
                }
            }
            chi2.push(square / freedom as f64 / median_over_mean(freedom));
        }
        let middle = chi2.len() / 2;
        let median = (!chi2.is_empty()).then(|| *chi2.select_nth_unstable_by(middle, f64::total_cmp).1);
        let gain = |(product, square): (f64, f64)| (square > 0.0).then(|| [product / square, square.recip().sqrt()]);
        Agreement { chi2: median, gains: gains.into_iter().map(gain).collect() }
    }
}

/// Median of χ² per degree of freedom (Wilson and Hilferty).
fn median_over_mean(freedom: usize) -> f64 {
    (1.0 - 2.0 / (9.0 * freedom as f64)).powi(3)
}

//! Sampled pixels of all exposures, for recovery of the response and comparison of the exposures.

use super::coding::{Coding, Entry, Scatter};
use crate::Frame;
use nacre_base::statistics::{median, median_chi_square};
use nacre_image::{Raster, Samples};

/// Maximum number of pixels, and maximum number of values over all exposures.
const PIXELS: usize = 16_384;
const VALUES: usize = 1 << 20;

/// Minimum signal-to-noise ratio of light used to compare exposures.
const CLEAR_SIGMA: f64 = 10.0;

/// Limits of the factor on an assumed camera's noise, and number of bisections between them.
const FACTOR: [f64; 2] = [1e-6, 1e6];
const HALVINGS: usize = 20;

/// Values of the same pixels in all exposures.
pub(super) struct Sample {
    pixels: Vec<usize>,
    channels: Vec<usize>,
    /// File values of each pixel's merged channels, per exposure.
    pub values: Vec<Vec<f32>>,
    /// Dark signal per exposure, relative to one exposure's value; empty if none is subtracted.
    pub darks: Vec<Vec<f32>>,
}

/// Consistency of the exposures.
#[derive(Clone, Debug)]
pub(super) struct Agreement {
    /// Reduced χ² of the deviations from the merged light: median over the sample, scaled to the mean of a normal
    /// distribution. `None` if no pixel was measured twice.
    pub chi2: Option<f64>,
    /// Brightness of each exposure relative to the others, and its standard deviation. `None` for exposures that share
    /// no pixel with another.
    pub gains: Vec<Option<[f64; 2]>>,
}

impl Sample {
    /// Evenly distributed samples of images of this size.
    pub(super) fn new(width: usize, height: usize, channels: &[usize], frames: usize) -> Self {
        let most = PIXELS.min(VALUES / (frames * channels.len()).max(1)).max(1);
        let step = ((width * height) as f64 / most as f64).sqrt().max(1.0);
        let along =
            |length: usize| (0..).map(move |i| ((f64::from(i) + 0.5) * step) as usize).take_while(move |x| *x < length);
        let pixels = along(height).flat_map(|y| along(width).map(move |x| y * width + x)).collect();
        Self { pixels, channels: channels.to_vec(), values: vec![vec![]; frames], darks: vec![vec![]; frames] }
    }

    /// Adds the `k`-th exposure.
    pub(super) fn put(&mut self, k: usize, raster: &Raster) {
        let at = self.pixels.iter().flat_map(|p| self.channels.iter().map(move |c| p * raster.channels + c));
        self.values[k] = match &raster.samples {
            Samples::U8(v) => at.map(|i| v[i].into()).collect(),
            Samples::U16(v) => at.map(|i| v[i].into()).collect(),
            Samples::F32(v) => at.map(|i| v[i]).collect(),
        };
    }

    /// Adds the dark signal of the `k`-th exposure: of every merged sample, or empty.
    pub(super) fn put_dark(&mut self, k: usize, light: &[f32]) {
        let n = self.channels.len();
        let at = self.pixels.iter().flat_map(|p| p * n..(p + 1) * n);
        self.darks[k] = at.filter_map(|i| light.get(i).copied()).collect();
    }

    /// Values of one channel: per exposure, per pixel.
    pub(super) fn of_channel(&self, position: usize) -> Vec<Vec<f32>> {
        let n = self.channels.len();
        self.values.iter().map(|v| v.iter().skip(position).step_by(n).copied().collect()).collect()
    }

    /// Converts the exposures to light for comparison.
    pub(super) fn comparison(&self, coding: &Coding, frames: &[Frame]) -> Comparison {
        let n = self.channels.len();
        let of_frame = |(frame, values): (&Frame, &Vec<f32>)| -> Vec<Entry> {
            let entry = |(i, v): (usize, &f32)| coding.entry(self.channels[i % n], frame, f64::from(*v));
            values.iter().enumerate().map(entry).collect()
        };
        let dark = |(frame, dark): (&Frame, &Vec<f32>)| dark.iter().map(|d| d * frame.scale() as f32).collect();
        Comparison {
            light: frames.iter().zip(&self.values).map(of_frame).collect(),
            darks: frames.iter().zip(&self.darks).map(dark).collect(),
            scatters: frames.iter().map(|f| coding.scatter(f)).collect(),
            // Weights derive from a common estimate of light, the mean over exposure lengths.
            lengths: frames.iter().map(|f| 1.0 / f.scale()).collect(),
        }
    }
}

/// Light of the same samples in all exposures.
pub(super) struct Comparison {
    light: Vec<Vec<Entry>>,
    /// Dark signal to subtract; empty for none.
    darks: Vec<Vec<f32>>,
    scatters: Vec<Scatter>,
    lengths: Vec<f64>,
}

impl Comparison {
    /// Compares the exposures with their merged light, with noise variances multiplied by `factor`.
    pub(super) fn agreement(&self, factor: f64) -> Agreement {
        let mut chi2 = vec![];
        let mut gains = vec![(0.0_f64, 0.0_f64); self.light.len()];
        let mut seen = vec![];
        for i in 0..self.light.first().map_or(0, Vec::len) {
            self.entries(i, factor, &mut seen);
            let freedom = seen.len().saturating_sub(1);
            if freedom == 0 {
                continue;
            }
            let (light, weight) = seen.iter().fold((0.0, 0.0), |(a, b), (_, x, w)| (a + x, b + w));
            let mean = light / weight;
            let mut square = 0.0;
            for (k, x, w) in &seen {
                square += w * (x / w - mean).powi(2);
                // Compares with the other exposures only, whose noise is independent.
                let (others, rest) = (light - x, weight - w);
                // Uncertain light of the others would be dominated by their noise.
                if rest > 0.0 && others > CLEAR_SIGMA * rest.sqrt() {
                    let (expected, variance) = (others / rest, 1.0 / w + 1.0 / rest);
                    gains[*k].0 += x / w * expected / variance;
                    gains[*k].1 += expected * expected / variance;
                }
            }
            chi2.push(square / median_chi_square(freedom));
        }
        let gain = |(product, square): (f64, f64)| (square > 0.0).then(|| [product / square, square.recip().sqrt()]);
        Agreement { chi2: median(&mut chi2), gains: gains.into_iter().map(gain).collect() }
    }

    /// Exposures with a valid sample: index, weight · light, weight.
    fn entries(&self, i: usize, factor: f64, seen: &mut Vec<(usize, f64, f64)>) {
        let shown = || (0..self.light.len()).filter(|k| self.light[*k][i][1].is_finite());
        let dark = |k: usize| self.darks[k].get(i).copied();
        let light = |k: usize| self.light[k][i][0] - dark(k).unwrap_or(0.0);
        let sum = |of: &dyn Fn(usize) -> f64| shown().map(of).sum::<f64>();
        let common = sum(&|k| self.lengths[k] * f64::from(light(k))) / sum(&|k| self.lengths[k]);
        seen.clear();
        seen.extend(shown().map(|k| {
            let scatter = self.scatters[k].times(factor as f32);
            let besides = self.light[k][i][1] + dark(k).map_or(0.0, |d| scatter.of_dark(d));
            let weight = f64::from(scatter.weight(common as f32, besides));
            (k, weight * f64::from(light(k)), weight)
        }));
    }

    /// Factor on the noise variances that, together with rounding, explains the differences between exposures. `None`
    /// if no sample was measured twice. The variance of rounding is known and not scaled.
    pub(super) fn noise_factor(&self) -> Option<f64> {
        let excess = |factor: f64| self.agreement(factor).chi2.map(|c| c - 1.0);
        let [mut low, mut high] = FACTOR;
        if excess(low)? <= 0.0 {
            return Some(low);
        }
        for _ in 0..HALVINGS {
            let middle = (low * high).sqrt();
            if excess(middle)? > 0.0 { low = middle } else { high = middle }
        }
        Some(high)
    }
}

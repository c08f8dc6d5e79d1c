//! Some pixels of every exposure: what a response is recovered from, and what the exposures are checked against each other on.

use super::coding::{Coding, Entry, Scatter};
use crate::Frame;
use nacre_base::statistics::{median, median_chi_square};
use nacre_image::{Raster, Samples};

/// Most pixels, and most values of all exposures together, whatever their number.
const PIXELS: usize = 16_384;
const VALUES: usize = 1 << 20;

/// Light this many standard deviations above nothing is what exposures are compared on.
const CLEAR_SIGMA: f64 = 10.0;

/// Limits of what an assumed camera's noise is multiplied by, and how often the interval between them is halved.
const FACTOR: [f64; 2] = [1e-6, 1e6];
const HALVINGS: usize = 20;

/// Values of the same pixels in every exposure.
pub(super) struct Sample {
    pixels: Vec<usize>,
    channels: Vec<usize>,
    /// Per exposure: file values of each pixel's merged channels.
    pub values: Vec<Vec<f32>>,
    /// Per exposure: what the camera shows without light, in light of one value; empty for none.
    pub darks: Vec<Vec<f32>>,
}

/// How well the exposures agree.
#[derive(Clone, Debug)]
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
        Self { pixels, channels: channels.to_vec(), values: vec![vec![]; frames], darks: vec![vec![]; frames] }
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

    /// Takes in what the camera shows without light at the `k`-th exposure: of every merged sample, or nothing.
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

    /// The exposures as light, to be compared.
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
            // One light for all weights is had by the exposures' lengths.
            lengths: frames.iter().map(|f| 1.0 / f.scale()).collect(),
        }
    }
}

/// Light of the same samples in every exposure.
pub(super) struct Comparison {
    light: Vec<Vec<Entry>>,
    /// What is to be subtracted; empty for nothing.
    darks: Vec<Vec<f32>>,
    scatters: Vec<Scatter>,
    lengths: Vec<f64>,
}

impl Comparison {
    /// Compares the exposures with what they are merged into, if the noise's variance is `factor` times what was thought.
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
                // Against the others alone, which do not hold its own noise.
                let (others, rest) = (light - x, weight - w);
                // Where the others know little, their noise would be taken for light.
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

    /// Exposures that show a sample: which, weight · light, weight.
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

    /// What the noise's variance must be multiplied by, so that it and rounding explain how the exposures differ. None where
    /// no sample was seen twice. Rounding is known and stays what it is.
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

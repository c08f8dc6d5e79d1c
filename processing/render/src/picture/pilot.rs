//! Predicts the noise of a picture and the number of passes, from a sample of its pixels or from its first passes.

use crate::material::SAMPLES;
use crate::material::diffraction::memory::Memory;
use crate::picture::Picture;
use crate::picture::adaptive_sampling::{Others, picture_weights, weights};
use crate::picture::pixel::{FEWEST, Pixel, pass};
use crate::prepared_scene::PreparedScene;
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_base::random::Stream;
use rayon::prelude::*;

/// Number of groups of four pixels in the sample.
const PILOT: usize = 1024;

/// Noise and light of a sample of pixels, from which those of the picture are predicted.
pub(crate) struct Pilot {
    /// Pixels by increasing weight.
    pixels: Vec<Weighed>,
    /// Fraction of lit pixels.
    lit: f64,
    /// Mean luminance.
    pub mean: f64,
    /// Whether all pixels receive the same number of passes.
    even: bool,
    /// Time of a round in s.
    pub seconds_of_a_pass: f64,
}

/// A pixel of a pilot.
struct Weighed {
    /// Relative number of passes that it receives.
    weight: f64,
    /// Sums over this pixel and those of larger weight: weights, variances of passes relative to the squared mean
    /// luminance, and these variances over weights.
    sums: [f64; 3],
}

impl Pilot {
    /// Renders a few thousand pixels, 2 × 2 at random positions, four times.
    ///
    /// # Errors
    /// `Cancelled`.
    pub(crate) fn new(prepared: &PreparedScene, progress: &dyn Progress) -> Result<Self> {
        let [width, height] = prepared.size();
        let count = PILOT.min(width * height / 4).max(1);
        progress.stage("looking ahead", 1);
        let begun = std::time::Instant::now();
        let pixel = |memory: &mut Memory, k: usize| {
            let first = chosen(k / 4, count, width * height);
            let (x, y) = ((first % width + k % 2).min(width - 1), (first / width + k / 2 % 2).min(height - 1));
            let mut pixel = Pixel::default();
            if !progress.cancelled() {
                (0..FEWEST)
                    .for_each(|n| pixel.add(prepared.viewer.kept(pass(prepared, y * width + x, n, SAMPLES, memory))));
            }
            pixel
        };
        let pixels: Vec<Pixel> = (0..4 * count).into_par_iter().map_init(Memory::default, pixel).collect();
        progress.check()?;
        progress.step();
        let seconds = begun.elapsed().as_secs_f64() * (width * height) as f64 / (pixels.len() * FEWEST) as f64;
        Ok(Self::of(&pixels, seconds, false))
    }

    /// Pilot from rendered pixels, in groups of four neighbours.
    pub(crate) fn of(pixels: &[Pixel], seconds_of_a_pass: f64, even: bool) -> Self {
        // As in a picture, the noise estimate comes from the neighbours.
        let others = |four: &[Pixel]| -> Vec<Others> {
            let without = |k: usize| four.iter().enumerate().filter(move |(i, _)| *i != k).map(|(_, p)| p);
            (0..four.len()).map(|k| Others::of(without(k))).collect()
        };
        let weights = weights(&pixels.chunks(4).flat_map(others).collect::<Vec<_>>());
        Self::with(pixels, weights, seconds_of_a_pass, even)
    }

    /// Pilot from the first passes of a whole picture: a sample would miss the few bright pixels that have most of the
    /// noise.
    pub(crate) fn of_picture(picture: &Picture, seconds_of_a_pass: f64) -> Self {
        Self::with(&picture.pixels, picture_weights(&picture.pixels, picture.width), seconds_of_a_pass, false)
    }

    fn with(pixels: &[Pixel], weights: Vec<f64>, seconds_of_a_pass: f64, even: bool) -> Self {
        let count = pixels.len().max(1) as f64;
        let mean = pixels.iter().map(|p| p.luminance).sum::<f64>() / count;
        let over = |p: &Pixel| p.error().powi(2) * f64::from(p.passes) / (mean * mean);
        let variance = |p: &Pixel| Some(over(p)).filter(|v| v.is_finite()).unwrap_or(0.0);
        let mut pairs: Vec<[f64; 2]> = weights.into_iter().zip(pixels.iter().map(variance)).map(Into::into).collect();
        pairs.sort_by(|a, b| b[0].total_cmp(&a[0]));
        let mut sums = [0.0; 3];
        let mut weighed: Vec<Weighed> = pairs
            .into_iter()
            .map(|[weight, variance]| {
                let parts = [weight, variance, if weight > 0.0 { variance / weight } else { 0.0 }];
                sums.iter_mut().zip(parts).for_each(|(sum, part)| *sum += part);
                Weighed { weight, sums }
            })
            .collect();
        weighed.reverse();
        let lit = pixels.iter().filter(|p| p.luminance > 0.0).count() as f64 / count;
        Self { pixels: weighed, lit, mean, even, seconds_of_a_pass }
    }

    /// Estimated number of lit pixels of a picture of this size.
    pub(crate) fn lit_pixels(&self, [width, height]: [usize; 2]) -> f64 {
        self.lit * (width * height) as f64
    }

    /// Noise of the picture after some rounds.
    ///
    /// The first passes are distributed evenly. Later ones raise pixels to a number of passes in proportion to their
    /// weights; pixels that already have more keep them. The level of the others follows from the remaining passes.
    pub(crate) fn noise(&self, rounds: usize) -> f64 {
        let count = self.pixels.len() as f64;
        let first = rounds.min(FEWEST) as f64;
        if self.even || rounds <= FEWEST {
            return (self.sums(0)[1] / (rounds as f64).max(1.0) / count).sqrt();
        }
        let passes = (first + (rounds - FEWEST) as f64 * self.lit) * count;
        // Passes per weight if the pixels before index `k` keep the first passes; from some index on it suffices for
        // the pixel itself.
        let level = |k: usize| (passes - first * k as f64) / self.sums(k)[0];
        let (mut low, mut high) = (0, self.pixels.len() - 1);
        while low < high {
            let middle = low + (high - low) / 2;
            if self.pixels[middle].weight * level(middle) >= first { high = middle } else { low = middle + 1 }
        }
        let [weights, variances, over] = self.sums(low);
        let kept = (self.sums(0)[1] - variances) / first;
        let raised = if weights > 0.0 { over / level(low) } else { variances / first };
        ((kept + raised) / count).sqrt()
    }

    /// Sums over the pixels from an index on, by increasing weight: weights, variances, and variances over weights.
    fn sums(&self, from: usize) -> [f64; 3] {
        self.pixels.get(from).map_or([0.0; 3], |p| p.sums)
    }

    /// Rounds required for a target error, at most `most`.
    pub(crate) fn passes(&self, error: f64, most: usize) -> usize {
        let (mut low, mut high) = (FEWEST.min(most), most);
        while low < high {
            let middle = low + (high - low) / 2;
            if self.noise(middle) <= error { high = middle } else { low = middle + 1 }
        }
        low
    }
}

/// A random pixel of the `k`-th of `count` parts of a picture.
fn chosen(k: usize, count: usize, pixels: usize) -> usize {
    let part = pixels as f64 / count as f64;
    (((k as f64 + Stream::new(k, usize::MAX).next()) * part) as usize).min(pixels - 1)
}

/// Root mean square difference of some pixels of two scenes that differ in their accuracy, relative to the mean
/// luminance; `None` in the dark.
///
/// # Errors
/// `Cancelled`.
pub(crate) fn compared(
    one: &PreparedScene,
    other: &PreparedScene,
    count: usize,
    progress: &dyn Progress,
) -> Result<Option<f64>> {
    let [width, height] = one.size();
    let count = count.min(width * height);
    let pairs: Vec<[f64; 2]> = (0..count)
        .into_par_iter()
        .map_init(Memory::default, |memory, k| {
            if progress.cancelled() {
                return [0.0; 2];
            }
            [one, other].map(|prepared| pass(prepared, chosen(k, count, width * height), 0, SAMPLES, memory)[1])
        })
        .collect();
    progress.check()?;
    let [off, light] = pairs.iter().fold([0.0; 2], |[d, l], [a, b]| [d + (a - b).powi(2), l + b]);
    Ok((light > 0.0).then(|| (off * count as f64).sqrt() / light))
}

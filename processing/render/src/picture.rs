//! Passes over a picture, and how far it is from its limit.

use super::allot::{Others, allot, weights};
use super::material::Memory;
use super::ready::Ready;
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_base::random::Stream;
use nacre_optics::color::xyz_of_linear_srgb;
use rayon::prelude::*;

/// Samples of a pixel in a pass: two by two places within it.
pub const SAMPLES: usize = 4;

/// Pixels that a thread takes at once.
const TILE: usize = 64;

/// Fewest passes whose differences tell an error.
pub(super) const FEWEST: usize = 4;

/// Places that a pilot looks at.
const PILOT: usize = 1024;

/// A pixel after some passes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pixel {
    /// Mean of the passes, linear sRGB (or three bands of a spectrum).
    pub rgb: [f64; 3],
    /// Mean luminance of the passes (or mean of the bands).
    pub luminance: f64,
    /// Sum of the squared differences of the passes' luminances from their mean.
    pub squares: f64,
    /// Passes that it has.
    pub passes: u32,
}

/// A picture that gets better with each pass.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Rounds of passes that are in it: as many passes each as there are pixels with light.
    pub passes: usize,
    /// Row by row from the top.
    pub pixels: Vec<Pixel>,
    /// A spectrum per pixel, if it was asked for.
    pub bands: Vec<Band>,
}

/// What a band of the spectrum sees of a picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Band {
    /// Its wavelength, in nm.
    pub nm: f64,
    /// Mean spectral radiance, per nm, in units in which a light's luminance is the observer's Y; row by row from the top.
    pub radiance: Vec<f32>,
}

impl Pixel {
    /// Adds a pass (Welford 1962).
    pub(super) fn add(&mut self, (rgb, luminance): ([f64; 3], f64)) {
        self.passes += 1;
        let share = 1.0 / f64::from(self.passes);
        (0..3).for_each(|c| self.rgb[c] += (rgb[c] - self.rgb[c]) * share);
        let off = luminance - self.luminance;
        self.luminance += off * share;
        self.squares += off * (luminance - self.luminance);
    }

    /// Standard error of the luminance.
    pub fn error(&self) -> f64 {
        if self.passes < 2 {
            return f64::NAN;
        }
        let passes = f64::from(self.passes);
        (self.squares.max(0.0) / (passes * (passes - 1.0))).sqrt()
    }
}

/// One pass of a pixel: the mean of its samples, X, Y, Z.
fn pass(ready: &Ready, index: usize, pass: usize, memory: &mut Memory) -> [f64; 3] {
    let width = ready.size()[0];
    let (x, y) = ((index % width) as f64, (index / width) as f64);
    let mut random = Stream::new(index, pass);
    let mut sum = [0.0; 3];
    for k in 0..SAMPLES {
        let [u, v] = random.numbers();
        let at = [x + 0.5 * ((k % 2) as f64 + u), y + 0.5 * ((k / 2) as f64 + v)];
        let part = ready.at(at, &mut random, memory);
        (0..3).for_each(|c| sum[c] += part[c] / SAMPLES as f64);
    }
    sum
}

/// Root mean square of the standard errors over the mean luminance; 0 in the dark.
fn relative(squares: impl Iterator<Item = f64>, luminances: impl Iterator<Item = f64>) -> f64 {
    let (mut square, mut light, mut count) = (0.0, 0.0, 0.0_f64);
    for (s, l) in squares.zip(luminances) {
        square += s;
        light += l;
        count += 1.0;
    }
    if light <= 0.0 { 0.0 } else { (square / count.max(1.0)).sqrt() / (light / count.max(1.0)) }
}

impl Picture {
    /// A picture before its first pass.
    pub(super) fn new([width, height]: [usize; 2]) -> Self {
        Self { width, height, passes: 0, pixels: vec![Pixel::default(); width * height], bands: vec![] }
    }

    /// Adds a round of passes: one to each pixel at first, then more where noise is.
    ///
    /// # Errors
    /// `Cancelled` when it is to stop; the picture is then of no use.
    pub(super) fn add(&mut self, ready: &Ready, progress: &dyn Progress) -> Result<()> {
        let counts = match self.passes < FEWEST {
            true => vec![1; self.pixels.len()],
            false => allot(&self.pixels, self.width, self.passes),
        };
        self.add_passes(ready, &counts, progress)
    }

    /// Adds so many passes to each pixel.
    pub(super) fn add_passes(&mut self, ready: &Ready, counts: &[u8], progress: &dyn Progress) -> Result<()> {
        let tiles = self.pixels.par_chunks_mut(TILE).zip(counts.par_chunks(TILE)).enumerate();
        tiles.for_each_init(Memory::default, |memory, (tile, (pixels, counts))| {
            for (k, (pixel, count)) in pixels.iter_mut().zip(counts).enumerate() {
                for _ in 0..*count {
                    if progress.cancelled() {
                        return;
                    }
                    pixel.add(ready.eye.kept(pass(ready, tile * TILE + k, pixel.passes as usize, memory)));
                }
            }
        });
        progress.check()?;
        self.passes += 1;
        Ok(())
    }

    /// Smaller by a whole number, so that no side is longer than `most`: to look at.
    pub fn shrunk(&self, most: usize) -> Self {
        let n = self.width.max(self.height).div_ceil(most.max(1)).max(1);
        let [width, height] = [self.width, self.height].map(|side| side.div_ceil(n));
        let block = |k: usize| {
            let (x, y) = (k % width * n, k / width * n);
            let (mut sum, mut count) = (Pixel::default(), 0.0);
            for row in y..(y + n).min(self.height) {
                for p in &self.pixels[row * self.width + x..row * self.width + (x + n).min(self.width)] {
                    (0..3).for_each(|c| sum.rgb[c] += p.rgb[c]);
                    sum.luminance += p.luminance;
                    count += 1.0;
                }
            }
            Pixel { rgb: sum.rgb.map(|v| v / count), luminance: sum.luminance / count, ..sum }
        };
        let pixels = (0..width * height).map(block).collect();
        Self { width, height, passes: self.passes, pixels, bands: vec![] }
    }

    /// Adds a pass that was made elsewhere, linear sRGB.
    pub(super) fn add_pixels(&mut self, pass: &[[f32; 3]]) {
        self.passes += 1;
        for (pixel, rgb) in self.pixels.iter_mut().zip(pass) {
            pixel.add((rgb.map(f64::from), xyz_of_linear_srgb(*rgb)[1].into()));
        }
    }

    /// Whether it has as many passes as are allowed, or as an error takes.
    pub(super) fn is_enough(&self, most: usize, error: f64) -> bool {
        self.passes >= most || (self.passes >= FEWEST && self.error() <= error)
    }

    /// Root mean square of the pixels' standard errors over the mean luminance; NaN before the second pass.
    pub fn error(&self) -> f64 {
        let squares = self.pixels.iter().map(|p| p.error().powi(2));
        relative(squares, self.pixels.iter().map(|p| p.luminance))
    }
}

/// What some pixels tell about all of them.
pub(super) struct Pilot {
    /// Variances of their passes, over the square of their mean luminance.
    variances: Vec<f64>,
    /// What they get of the passes.
    weights: Vec<f64>,
    /// Part of them that has light.
    lit: f64,
    /// Whether all pixels get the same.
    even: bool,
    /// Seconds of a round.
    pub seconds_of_a_pass: f64,
}

impl Pilot {
    /// Renders a few thousand pixels, two by two at places drawn by chance, four times.
    ///
    /// # Errors
    /// `Cancelled`.
    pub(super) fn new(ready: &Ready, progress: &dyn Progress) -> Result<Self> {
        let [width, height] = ready.size();
        let count = PILOT.min(width * height / 4).max(1);
        progress.stage("looking ahead", 1);
        let begun = std::time::Instant::now();
        let pixel = |memory: &mut Memory, k: usize| {
            let first = chosen(k / 4, count, width * height);
            let (x, y) = ((first % width + k % 2).min(width - 1), (first / width + k / 2 % 2).min(height - 1));
            let mut pixel = Pixel::default();
            if !progress.cancelled() {
                (0..FEWEST).for_each(|n| pixel.add(ready.eye.kept(pass(ready, y * width + x, n, memory))));
            }
            pixel
        };
        let pixels: Vec<Pixel> = (0..4 * count).into_par_iter().map_init(Memory::default, pixel).collect();
        progress.check()?;
        progress.step();
        let seconds = begun.elapsed().as_secs_f64() * (width * height) as f64 / (pixels.len() * FEWEST) as f64;
        Ok(Self::of(&pixels, seconds, false))
    }

    /// Of pixels that have been rendered, four side by side each.
    pub(super) fn of(pixels: &[Pixel], seconds_of_a_pass: f64, even: bool) -> Self {
        let count = pixels.len().max(1) as f64;
        let mean = pixels.iter().map(|p| p.luminance).sum::<f64>() / count;
        let over = |p: &Pixel| p.error().powi(2) * f64::from(p.passes) / (mean * mean);
        let variances: Vec<f64> =
            pixels.iter().map(|p| Some(over(p)).filter(|v| v.is_finite()).unwrap_or(0.0)).collect();
        // As in a picture, the others tell where noise is.
        let others = |four: &[Pixel]| -> Vec<Others> {
            let without = |k: usize| four.iter().enumerate().filter(move |(i, _)| *i != k).map(|(_, p)| p);
            (0..four.len()).map(|k| Others::of(without(k))).collect()
        };
        let weights = weights(&pixels.chunks(4).flat_map(others).collect::<Vec<_>>());
        let lit = pixels.iter().filter(|p| p.luminance > 0.0).count() as f64 / count;
        Self { variances, weights, lit, even, seconds_of_a_pass }
    }

    /// Pixels of a picture of this size that have light, about.
    pub(super) fn lit_pixels(&self, [width, height]: [usize; 2]) -> f64 {
        self.lit * (width * height) as f64
    }

    /// Noise of the picture after some rounds.
    pub(super) fn noise(&self, rounds: usize) -> f64 {
        let count = self.variances.len() as f64;
        let first = rounds.min(FEWEST) as f64;
        let passes = (first + rounds.saturating_sub(FEWEST) as f64 * self.lit) * count;
        let share = passes / self.weights.iter().sum::<f64>().max(1e-300);
        let of = |(v, w): (&f64, &f64)| v / if self.even { rounds as f64 } else { (w * share).max(first).max(1.0) };
        (self.variances.iter().zip(&self.weights).map(of).sum::<f64>() / count.max(1.0)).sqrt()
    }

    /// Rounds that an error takes, at most so many.
    pub(super) fn passes(&self, error: f64, most: usize) -> usize {
        let (mut low, mut high) = (FEWEST.min(most), most);
        while low < high {
            let middle = low + (high - low) / 2;
            if self.noise(middle) <= error { high = middle } else { low = middle + 1 }
        }
        low
    }
}

/// One pixel of each of `count` parts of a picture, by chance.
fn chosen(k: usize, count: usize, pixels: usize) -> usize {
    let part = pixels as f64 / count as f64;
    (((k as f64 + Stream::new(k, usize::MAX).next()) * part) as usize).min(pixels - 1)
}

/// Root mean square difference of some pixels of two scenes that differ in their accuracy, over the mean luminance, as noise is; none in the
/// dark.
///
/// # Errors
/// `Cancelled`.
pub(super) fn compared(one: &Ready, other: &Ready, count: usize, progress: &dyn Progress) -> Result<Option<f64>> {
    let [width, height] = one.size();
    let count = count.min(width * height);
    let pairs: Vec<[f64; 2]> = (0..count)
        .into_par_iter()
        .map_init(Memory::default, |memory, k| {
            if progress.cancelled() {
                return [0.0; 2];
            }
            [one, other].map(|ready| pass(ready, chosen(k, count, width * height), 0, memory)[1])
        })
        .collect();
    progress.check()?;
    let [off, light] = pairs.iter().fold([0.0; 2], |[d, l], [a, b]| [d + (a - b).powi(2), l + b]);
    Ok((light > 0.0).then(|| (off * count as f64).sqrt() / light))
}

//! Passes over a picture, and how far it is from its limit.

use super::material::Memory;
use super::ready::Ready;
use crate::Result;
use crate::color::xyz_of_linear_srgb;
use crate::progress::Progress;
use crate::random::Stream;
use rayon::prelude::*;

/// Samples of a pixel in a pass: two by two places within it.
pub const SAMPLES: usize = 4;

/// Pixels that a thread takes at once.
const TILE: usize = 64;

/// Fewest passes whose differences tell an error.
pub(super) const FEWEST: usize = 4;

/// Pixels of a pilot.
const PILOT: usize = 4096;

/// A pixel after some passes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pixel {
    /// Mean of the passes, linear sRGB (or three bands of a spectrum).
    pub rgb: [f64; 3],
    /// Mean luminance of the passes (or mean of the bands).
    pub luminance: f64,
    /// Sum of the squared differences of the passes' luminances from their mean.
    pub squares: f64,
}

/// A picture that gets better with each pass.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Pixels of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Passes that are in it.
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
    /// Adds the `n`-th pass (Welford 1962).
    fn add(&mut self, (rgb, luminance): ([f64; 3], f64), n: usize) {
        let share = 1.0 / n as f64;
        (0..3).for_each(|c| self.rgb[c] += (rgb[c] - self.rgb[c]) * share);
        let off = luminance - self.luminance;
        self.luminance += off * share;
        self.squares += off * (luminance - self.luminance);
    }

    /// Standard error of the luminance after some passes.
    pub fn error(&self, passes: usize) -> f64 {
        if passes < 2 {
            return f64::NAN;
        }
        (self.squares.max(0.0) / (passes * (passes - 1)) as f64).sqrt()
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

    /// Adds a pass.
    ///
    /// # Errors
    /// `Cancelled` when it is to stop; the picture is then of no use.
    pub(super) fn add(&mut self, ready: &Ready, progress: &dyn Progress) -> Result<()> {
        let n = self.passes;
        self.pixels.par_chunks_mut(TILE).enumerate().for_each_init(Memory::default, |memory, (tile, pixels)| {
            if progress.cancelled() {
                return;
            }
            for (k, pixel) in pixels.iter_mut().enumerate() {
                pixel.add(ready.eye.kept(pass(ready, tile * TILE + k, n, memory)), n + 1);
            }
        });
        progress.check()?;
        self.passes = n + 1;
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
            Pixel { rgb: sum.rgb.map(|v| v / count), luminance: sum.luminance / count, squares: 0.0 }
        };
        let pixels = (0..width * height).map(block).collect();
        Self { width, height, passes: self.passes, pixels, bands: vec![] }
    }

    /// Adds a pass that was made elsewhere, linear sRGB.
    pub(super) fn add_pixels(&mut self, pass: &[[f32; 3]]) {
        self.passes += 1;
        for (pixel, rgb) in self.pixels.iter_mut().zip(pass) {
            pixel.add((rgb.map(f64::from), xyz_of_linear_srgb(*rgb)[1].into()), self.passes);
        }
    }

    /// Whether it has as many passes as are allowed, or as an error takes.
    pub(super) fn is_enough(&self, most: usize, error: f64) -> bool {
        self.passes >= most || (self.passes >= FEWEST && self.error() <= error)
    }

    /// Root mean square of the pixels' standard errors over the mean luminance; NaN before the second pass.
    pub fn error(&self) -> f64 {
        let squares = self.pixels.iter().map(|p| p.error(self.passes).powi(2));
        relative(squares, self.pixels.iter().map(|p| p.luminance))
    }
}

/// What some pixels tell about all of them.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Pilot {
    /// Error of a picture of one pass; of n passes that is its n-th part's root.
    pub error_of_a_pass: f64,
    /// Seconds of a pass.
    pub seconds_of_a_pass: f64,
}

impl Pilot {
    /// Renders a few thousand pixels, drawn by chance, four times.
    ///
    /// # Errors
    /// `Cancelled`.
    pub(super) fn new(ready: &Ready, progress: &dyn Progress) -> Result<Self> {
        let [width, height] = ready.size();
        let count = PILOT.min(width * height);
        progress.stage("looking ahead", 1);
        let begun = std::time::Instant::now();
        let pixels: Vec<Pixel> = (0..count)
            .into_par_iter()
            .map_init(Memory::default, |memory, k| {
                let mut pixel = Pixel::default();
                if !progress.cancelled() {
                    let at = chosen(k, count, width * height);
                    (0..FEWEST).for_each(|n| pixel.add(ready.eye.kept(pass(ready, at, n, memory)), n + 1));
                }
                pixel
            })
            .collect();
        progress.check()?;
        progress.step();
        let seconds = begun.elapsed().as_secs_f64() * (width * height) as f64 / (count * FEWEST) as f64;
        let squares = pixels.iter().map(|p| p.squares / (FEWEST - 1) as f64);
        let error = relative(squares, pixels.iter().map(|p| p.luminance));
        Ok(Self { error_of_a_pass: error, seconds_of_a_pass: seconds })
    }

    /// Passes that an error takes.
    pub(super) fn passes(&self, error: f64) -> usize {
        let wanted = (self.error_of_a_pass / error).powi(2).ceil();
        if wanted.is_finite() { (wanted as usize).max(FEWEST) } else { usize::MAX }
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

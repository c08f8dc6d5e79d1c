//! Progressive pictures and their error.

mod adaptive_sampling;
mod compare;
mod output;
mod pilot;
mod pixel;

pub use compare::{Difference, difference};
pub use output::{bytes, exposure, png, read_picture, write_picture, write_png};
pub(crate) use output::{digest, keep, resumed};
pub(crate) use pilot::{Pilot, compared};
pub(crate) use pixel::FEWEST;
pub use pixel::Pixel;

use crate::material::SAMPLES;
use crate::material::diffraction::memory::Memory;
use crate::prepared_scene::PreparedScene;
use adaptive_sampling::adaptive_passes;
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_optics::color::xyz_of_linear_srgb;
use pixel::pass;
use rayon::prelude::*;

/// Pixels per task of a thread.
const TILE: usize = 64;

/// A progressively refined picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Samples per pass: 4 or 16.
    pub pass_samples: usize,
    /// Completed rounds; each has as many passes as there are lit pixels.
    pub passes: usize,
    /// Row by row from the top.
    pub pixels: Vec<Pixel>,
    /// A spectrum per pixel, if requested.
    pub bands: Vec<Band>,
}

/// A spectral band of a picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Band {
    /// Wavelength in nm.
    pub nm: f64,
    /// Mean spectral radiance per nm, in units in which a light's luminance is the observer's Y; row by row from the
    /// top.
    pub radiance: Vec<f32>,
}

/// Root mean square of the standard errors, relative to the mean luminance; 0 in the dark.
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
    pub(crate) fn new([width, height]: [usize; 2]) -> Self {
        let pixels = vec![Pixel::default(); width * height];
        Self { width, height, pass_samples: SAMPLES, passes: 0, pixels, bands: vec![] }
    }

    /// Adds a round of passes: one per pixel at first, later distributed by noise.
    ///
    /// # Errors
    /// `Cancelled`; the picture is then unusable.
    pub(crate) fn add(&mut self, prepared: &PreparedScene, progress: &dyn Progress) -> Result<()> {
        let counts = match self.passes < FEWEST {
            true => vec![1; self.pixels.len()],
            false => adaptive_passes(&self.pixels, self.width, self.passes),
        };
        self.add_passes(prepared, &counts, progress)
    }

    /// Adds the given number of passes to each pixel.
    pub(crate) fn add_passes(
        &mut self,
        prepared: &PreparedScene,
        counts: &[u8],
        progress: &dyn Progress,
    ) -> Result<()> {
        let samples = self.pass_samples;
        let tiles = self.pixels.par_chunks_mut(TILE).zip(counts.par_chunks(TILE)).enumerate();
        tiles.for_each_init(Memory::default, |memory, (tile, (pixels, counts))| {
            for (k, (pixel, count)) in pixels.iter_mut().zip(counts).enumerate() {
                for _ in 0..*count {
                    if progress.cancelled() {
                        return;
                    }
                    let seen = pass(prepared, tile * TILE + k, pixel.passes as usize, samples, memory);
                    pixel.add(prepared.viewer.kept(seen));
                }
            }
        });
        progress.check()?;
        self.passes += 1;
        Ok(())
    }

    /// Reduces the picture by an integer factor, so that no side exceeds `most`, for previews.
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
        Self { width, height, pass_samples: self.pass_samples, passes: self.passes, pixels, bands: vec![] }
    }

    /// Adds a pass that was rendered elsewhere, linear sRGB.
    pub(crate) fn add_pixels(&mut self, pass: &[[f32; 3]]) {
        self.passes += 1;
        for (pixel, rgb) in self.pixels.iter_mut().zip(pass) {
            pixel.add((rgb.map(f64::from), xyz_of_linear_srgb(*rgb)[1].into()));
        }
    }

    /// Whether it has the maximum number of passes, or meets the target error.
    pub(crate) fn is_enough(&self, most: usize, error: f64, progress: &dyn Progress) -> bool {
        let met = self.passes >= FEWEST && self.error() <= error;
        self.passes >= most || met || self.is_wanted_now(progress)
    }

    /// Whether the picture was asked for as it is, and has the two passes from which its noise is known.
    pub(crate) fn is_wanted_now(&self, progress: &dyn Progress) -> bool {
        self.passes > 1 && progress.is_enough()
    }

    /// Samples per pixel, averaged over lit pixels.
    pub fn samples(&self) -> usize {
        self.passes * self.pass_samples
    }

    /// Root mean square of the pixels' standard errors, relative to the mean luminance; NaN before the second pass.
    pub fn error(&self) -> f64 {
        let squares = self.pixels.iter().map(|p| p.error().powi(2));
        relative(squares, self.pixels.iter().map(|p| p.luminance))
    }
}

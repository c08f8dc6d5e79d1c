//! Pixel statistics, and one pass of a pixel.

use crate::material::diffraction::memory::Memory;
use crate::prepared_scene::PreparedScene;
use nacre_base::random::Stream;

/// Minimum number of passes for an estimate of a pixel's standard error.
pub(crate) const FEWEST: usize = 4;

/// Statistics of a pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pixel {
    /// Mean of the passes, linear sRGB (or three spectral bands).
    pub rgb: [f64; 3],
    /// Mean luminance of the passes (or mean of the bands).
    pub luminance: f64,
    /// Sum of the squared deviations of the passes' luminances from their mean.
    pub squares: f64,
    /// Number of passes.
    pub passes: u32,
}

impl Pixel {
    /// Adds a pass (Welford 1962).
    pub(crate) fn add(&mut self, (rgb, luminance): ([f64; 3], f64)) {
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

/// One pass of a pixel: the mean of `samples` samples, X, Y, Z. They are stratified over as many subpixels, and each of
/// their other random numbers over as many intervals of 0 to 1. `samples` is 4 or 16.
pub(super) fn pass(
    prepared: &PreparedScene,
    index: usize,
    pass: usize,
    samples: usize,
    memory: &mut Memory,
) -> [f64; 3] {
    let width = prepared.size()[0];
    let (x, y) = ((index % width) as f64, (index / width) as f64);
    let side = samples.isqrt();
    let mut sum = [0.0; 3];
    for k in 0..samples {
        let mut random = Stream::stratified(index, pass, k, samples);
        let [u, v] = random.numbers();
        let at = [x + ((k % side) as f64 + u) / side as f64, y + ((k / side) as f64 + v) / side as f64];
        let part = prepared.at(at, &mut random, memory);
        (0..3).for_each(|c| sum[c] += part[c] / samples as f64);
    }
    sum
}

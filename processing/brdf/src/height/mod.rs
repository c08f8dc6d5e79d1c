//! Height fields: reading, levelling, quality and synthesis.

mod formats;
mod gaps;
mod grating;
mod picture;
mod quality;
mod read;
mod squares;
mod stored;
mod synthetic;
#[cfg(test)]
mod tests;
mod text;
mod tiff;

pub use grating::Grating;
pub use quality::{Peak, Quality};
pub use read::{EXTENSIONS, Scale, read};
pub use synthetic::{Profile, Shape, Synthetic};

use nacre_base::{Error, Result};

/// Longest side of a height field, in pixels.
pub const MAX_SIDE: usize = 8192;
/// Largest number of pixels of a height field (128 MiB of heights).
pub const MAX_PIXELS: usize = 16 << 20;

/// Patch of a surface: heights in µm, row 0 on top, square pixels.
///
/// For every method, the surface is this patch, repeated infinitely in both directions.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightField {
    /// Name of its file, or description, for messages.
    pub name: String,
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Pixel pitch in µm.
    pub pixel_um: f64,
    /// `width · height` heights in µm, row by row from the top.
    pub um: Vec<f64>,
    /// Height resolution of the file in µm; absent for floating point.
    pub step_um: Option<f64>,
    /// Notes on reading the file: format, channel, encoding.
    pub notes: Vec<String>,
}

impl HeightField {
    /// Creates a height field, and checks sizes and values.
    ///
    /// # Errors
    /// `Input`, naming `subject`, for a size beyond the limits, an invalid pitch, and heights that are not finite.
    pub fn new(subject: &str, width: usize, height: usize, pixel_um: f64, um: Vec<f64>) -> Result<Self> {
        check_size(subject, width, height)?;
        if um.len() != width * height {
            let problem = format!("has {} heights where {width} x {height} were expected", um.len());
            return Err(Error::input(subject, problem, "export the file again"));
        }
        if !(1e-5..=1e4).contains(&pixel_um) {
            let problem = format!("has a pixel pitch of {pixel_um} µm");
            return Err(Error::input(subject, problem, "give 0.00001 to 10000 with --pixel-um"));
        }
        if let Some(at) = um.iter().position(|h| !h.is_finite()) {
            let count = um.iter().filter(|h| !h.is_finite()).count();
            let problem = format!(
                "{count} heights are no numbers (NaN or infinite), the first at column {}, row {}",
                at % width,
                at / width
            );
            return Err(Error::input(subject, problem, "crop the patch to where heights are known"));
        }
        let this = Self { name: subject.into(), width, height, pixel_um, um, step_um: None, notes: vec![] };
        let range = this.range_um();
        if range > 1e3 {
            let problem = format!("spans {range} µm of height");
            return Err(Error::input(subject, problem, "expected at most 1000 µm: check unit and --range-um"));
        }
        Ok(this)
    }

    /// Width and height of the patch in µm.
    pub fn size_um(&self) -> [f64; 2] {
        [self.width, self.height].map(|n| n as f64 * self.pixel_um)
    }

    /// Lowest and highest point in µm.
    pub fn ends_um(&self) -> [f64; 2] {
        self.um.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], h| [low.min(*h), high.max(*h)])
    }

    /// Height range: highest minus lowest point, in µm.
    pub fn range_um(&self) -> f64 {
        let [low, high] = self.ends_um();
        high - low
    }

    /// Slopes to the right and up of the best-fitting plane (least squares), in µm per µm.
    pub fn tilt(&self) -> [f64; 2] {
        let middle = |n: usize| 0.5 * (n as f64 - 1.0);
        let (mx, my) = (middle(self.width), middle(self.height));
        let mut sums = [0.0; 2];
        for (y, row) in self.um.chunks_exact(self.width).enumerate() {
            for (x, h) in row.iter().enumerate() {
                sums[0] += h * (x as f64 - mx);
                sums[1] += h * (my - y as f64);
            }
        }
        // Σ (x - mx)² over all pixels is rows · n (n² - 1) / 12.
        let square = |n: usize, lines: usize| lines as f64 * n as f64 * ((n * n) as f64 - 1.0) / 12.0;
        let slope = |sum: f64, square: f64| if square > 0.0 { sum / square / self.pixel_um } else { 0.0 };
        [slope(sums[0], square(self.width, self.height)), slope(sums[1], square(self.height, self.width))]
    }

    /// Subtracts the best-fitting plane and the mean, to correct a tilted sample. A blazed grating loses a part of the
    /// profile's slope, the less the more periods the patch has.
    #[must_use]
    pub fn levelled(mut self) -> Self {
        let [right, up] = self.tilt();
        let mean = self.um.iter().sum::<f64>() / self.um.len() as f64;
        let (mx, my) = (0.5 * (self.width as f64 - 1.0), 0.5 * (self.height as f64 - 1.0));
        for (y, row) in self.um.chunks_exact_mut(self.width).enumerate() {
            for (x, h) in row.iter_mut().enumerate() {
                *h -= mean + self.pixel_um * (right * (x as f64 - mx) + up * (my - y as f64));
            }
        }
        self
    }
}

fn check_size(subject: &str, width: usize, height: usize) -> Result<()> {
    if width < 2 || height < 1 || width.max(height) > MAX_SIDE || width.saturating_mul(height) > MAX_PIXELS {
        let limit = format!("expected at most {MAX_SIDE} along a side and {} Mpixel", MAX_PIXELS >> 20);
        return Err(Error::input(subject, format!("is {width} x {height} pixels; {limit}"), "crop it"));
    }
    Ok(())
}

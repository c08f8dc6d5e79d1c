//! Lat-long environments: radiance of all directions as an equirectangular picture.

use nacre_base::{Error, Result};
use nacre_image::{Light, read_light};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::path::Path;

/// Maximum number of pixels of an environment (8192 × 4096); with its sampling tables it takes 20 bytes per pixel.
const MAX_PIXELS: usize = 32 << 20;

/// Largest magnitude of negative radiance that is clamped to 0, relative to the brightest pixel. Resampling with
/// overshoot causes such values beside a sun: Lanczos' three-lobe filter falls to -0.13 of a point's height, as found
/// in published maps.
const NOISE: f32 = 0.2;

/// Largest fraction of infinite or NaN pixels.
const MAX_NOT_FINITE: f64 = 0.01;

/// Fraction of negative light from which a warning is issued.
const WARNED_NEGATIVE: f64 = 1e-4;

/// A lat-long environment of linear radiance. Row 0 is the zenith (+z), the centre column points towards +x, and
/// azimuth (anticlockwise seen from above) increases to the left.
///
/// The centre of pixel (x, y) is the direction with polar angle `π (y + ½)/height` and azimuth
/// `2π (½ − (x + ½)/width)`.
#[derive(Clone, Debug)]
pub struct Environment {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Linear radiance, row by row from the zenith.
    pub rgb: Vec<[f32; 3]>,
    /// Clamped negative light relative to all light, before weighting by solid angle.
    pub negative: f64,
    /// Conversions and choices made while reading its file.
    file_warnings: Vec<String>,
    /// Cumulative weights of all pixels for [`Self::sample`].
    running: Vec<f64>,
}

impl Environment {
    /// Reads an OpenEXR or Radiance HDR picture, twice as wide as high; `layer` selects one of several pictures of an
    /// OpenEXR file.
    ///
    /// Colours are converted to Rec. 709 primaries. Infinite radiance is replaced by the brightest finite one, NaN by
    /// black; [`Self::warnings`] reports it.
    ///
    /// # Errors
    /// `Input` if the file cannot be read, has another aspect ratio, is too large, or has several pictures and `layer`
    /// names none of them. Also if more than 1 % of its radiance is infinite or NaN, or some is negative beyond noise.
    pub fn read(path: &Path, layer: Option<&str>) -> Result<Self> {
        let [width, height] = nacre_image::size(path)?;
        let refuse = |problem: String, remedy: &str| Err(Error::file(path, problem, remedy));
        if width.abs_diff(2 * height) > 2 {
            let problem = format!("is {width} x {height} pixels; an environment is twice as wide as high");
            return refuse(problem, "give a lat-long (equirectangular) environment");
        }
        if width * height > MAX_PIXELS {
            let problem = format!("is {width} x {height} pixels, more than {} Mpixel", MAX_PIXELS >> 20);
            return refuse(problem, "scale it down");
        }
        let Light { width, height, mut rgb, notes } = read_light(path, layer)?;
        let name = path.display().to_string();
        let words = made_finite(&name, width, &mut rgb)?;
        let short = path.file_name().unwrap_or_default().to_string_lossy();
        let warnings = notes.into_iter().chain(words).map(|words| format!("{short}: {words}")).collect();
        Ok(Self { file_warnings: warnings, ..Self::checked(&name, width, height, rgb)? })
    }

    /// An environment from radiances, row by row from the zenith.
    ///
    /// # Errors
    /// `Input` for an empty or too large picture, for a number of values other than `width · height`, and for values
    /// that are NaN, infinite or negative beyond noise.
    pub fn of(width: usize, height: usize, rgb: Vec<[f32; 3]>) -> Result<Self> {
        Self::checked("environment", width, height, rgb)
    }

    /// Constant radiance in all directions; negative and NaN values count as 0.
    pub fn constant(rgb: [f32; 3]) -> Self {
        let rgb = rgb.map(|v| if v.is_finite() { v.max(0.0) } else { 0.0 });
        Self::tabled(4, 2, vec![rgb; 8])
    }

    fn checked(subject: &str, width: usize, height: usize, mut rgb: Vec<[f32; 3]>) -> Result<Self> {
        if width == 0 || height == 0 || width.checked_mul(height) != Some(rgb.len()) || rgb.len() > MAX_PIXELS {
            let problem = format!("{width} x {height} pixels with {} radiances", rgb.len());
            return Err(Error::input(subject, problem, format!("give 1 to {MAX_PIXELS} pixels")));
        }
        let most = rgb.as_flattened().iter().fold(0.0_f32, |m, v| m.max(*v));
        let bad = rgb.iter().position(|p| p.iter().any(|v| !v.is_finite() || *v < -NOISE * most));
        if let Some(i) = bad {
            let [r, g, b] = rgb[i];
            let problem = format!("has radiance {r}, {g}, {b} in column {}, row {}", i % width, i / width);
            return Err(Error::input(subject, problem, "give finite radiances that are not negative"));
        }
        let mut sums = [0.0_f64; 2];
        for value in rgb.as_flattened_mut() {
            sums[usize::from(*value < 0.0)] += f64::from(value.abs());
            *value = value.max(0.0);
        }
        let negative = if sums[1] > 0.0 { sums[1] / sums[0] } else { 0.0 };
        Ok(Self { negative, ..Self::tabled(width, height, rgb) })
    }

    fn tabled(width: usize, height: usize, rgb: Vec<[f32; 3]>) -> Self {
        let mut environment = Self { width, height, rgb, negative: 0.0, file_warnings: vec![], running: vec![] };
        let mut weights = vec![0.0_f64; width * height];
        let all = &environment;
        weights.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let solid = all.solid_angle(y);
            row.iter_mut().enumerate().for_each(|(x, out)| *out = all.mean(x, y) * solid);
        });
        if weights.iter().sum::<f64>() <= 0.0 {
            // A black environment is sampled uniformly.
            weights.iter_mut().enumerate().for_each(|(i, out)| *out = all.solid_angle(i / width));
        }
        let mut sum = 0.0;
        for weight in &mut weights {
            sum += *weight;
            *weight = sum;
        }
        environment.running = weights;
        environment
    }

    /// Warnings about the environment.
    pub fn warnings(&self) -> Vec<String> {
        let part = 100.0 * self.negative;
        let warning = format!("radiance of the environment that is negative, {part:.2} % of its light, counts as none");
        self.file_warnings.iter().cloned().chain((self.negative > WARNED_NEGATIVE).then_some(warning)).collect()
    }

    /// Pixel of a column and a row that may lie beyond the edges: columns wrap, rows continue across the pole.
    #[inline]
    fn pixel(&self, x: isize, y: isize) -> [f32; 3] {
        let (width, height) = (self.width as isize, self.height as isize);
        let (x, y) = match y {
            y if y < 0 => (x + width / 2, (-1 - y).min(height - 1)),
            y if y >= height => (x + width / 2, (2 * height - 1 - y).max(0)),
            y => (x, y),
        };
        self.rgb[(y * width + x.rem_euclid(width)) as usize]
    }

    /// Mean of the interpolated radiance over a pixel, summed over the channels.
    fn mean(&self, x: usize, y: usize) -> f64 {
        const ACROSS: [f64; 3] = [0.125, 0.75, 0.125];
        let mut sum = 0.0;
        for (j, down) in ACROSS.iter().enumerate() {
            for (i, along) in ACROSS.iter().enumerate() {
                let [r, g, b] = self.pixel((x + i) as isize - 1, (y + j) as isize - 1);
                sum += down * along * (f64::from(r) + f64::from(g) + f64::from(b));
            }
        }
        sum
    }

    /// Solid angle of a pixel of a row, in steradians.
    pub fn solid_angle(&self, row: usize) -> f64 {
        let edge = |y: usize| (PI * y as f64 / self.height as f64).cos();
        TAU / self.width as f64 * (edge(row) - edge(row + 1))
    }

    /// Direction of a position in the picture, in pixels: (½, ½) is the centre of the first pixel.
    pub fn direction(&self, x: f64, y: f64) -> [f64; 3] {
        let (sin, cos) = (PI * y / self.height as f64).sin_cos();
        let azimuth = TAU * (0.5 - x / self.width as f64);
        [sin * azimuth.cos(), sin * azimuth.sin(), cos]
    }

    /// Position of a direction in the picture, in pixels: (½, ½) is the centre of the first pixel.
    #[inline]
    pub fn place(&self, direction: [f64; 3]) -> [f64; 2] {
        let [x, y, z] = direction;
        let polar = x.hypot(y).atan2(z);
        [(0.5 - y.atan2(x) / TAU) * self.width as f64, polar / PI * self.height as f64]
    }

    /// Radiance from a direction (of any length but 0), interpolated between pixel centres, also across the poles.
    #[inline]
    pub fn radiance(&self, direction: [f64; 3]) -> [f32; 3] {
        let [x, y] = self.place(direction).map(|v| v - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (u, v) = ((x - left) as f32, (y - top) as f32);
        let (left, top) = (left as isize, top as isize);
        let corner = |i: isize, j: isize| self.pixel(left + i, top + j);
        let [a, b, c, d] = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
        std::array::from_fn(|k| (1.0 - v) * ((1.0 - u) * a[k] + u * b[k]) + v * ((1.0 - u) * c[k] + u * d[k]))
    }

    /// Importance sampling: direction for two numbers from 0 to 1, its radiance, and its probability density per
    /// steradian. The density of a pixel is proportional to its mean over the channels.
    pub fn sample(&self, u: [f64; 2]) -> ([f64; 3], [f32; 3], f64) {
        let (width, height) = (self.width, self.height);
        let total = self.running[width * height - 1];
        let until = |i: usize| if i == 0 { 0.0 } else { self.running[i - 1] };
        let wanted = u[1].clamp(0.0, 1.0) * total;
        let (mut low, mut high) = (0, height - 1);
        while low < high {
            let middle = usize::midpoint(low, high);
            if self.running[(middle + 1) * width - 1] > wanted { high = middle } else { low = middle + 1 }
        }
        let row = low;
        let [begin, end] = [until(row * width), until((row + 1) * width)];
        let down = ((wanted - begin) / (end - begin)).clamp(0.0, 1.0);
        let wanted = begin + u[0].clamp(0.0, 1.0) * (end - begin);
        let cells = &self.running[row * width..(row + 1) * width];
        // The last pixel with a positive weight receives the rounding remainder.
        let column = cells.partition_point(|c| *c <= wanted).min(cells.partition_point(|c| *c < end));
        let at = row * width + column;
        let along = ((wanted - until(at)) / (self.running[at] - until(at))).clamp(0.0, 1.0);
        let edge = |y: usize| (PI * y as f64 / height as f64).cos();
        let z = edge(row) + down * (edge(row + 1) - edge(row));
        let across = (1.0 - z * z).max(0.0).sqrt();
        let azimuth = TAU * (0.5 - (column as f64 + along) / width as f64);
        let direction = [across * azimuth.cos(), across * azimuth.sin(), z];
        (direction, self.radiance(direction), (self.running[at] - until(at)) / (total * self.solid_angle(row)))
    }

    /// Probability density per steradian of a direction in [`Self::sample`].
    pub fn density(&self, direction: [f64; 3]) -> f64 {
        let [x, y] = self.place(direction);
        let (x, y) = ((x as usize).min(self.width - 1), (y as usize).min(self.height - 1));
        let at = y * self.width + x;
        let weight = self.running[at] - if at == 0 { 0.0 } else { self.running[at - 1] };
        weight / (self.running[self.width * self.height - 1] * self.solid_angle(y))
    }

    /// Rotates the environment about z, anticlockwise seen from above; exact for whole pixels, otherwise interpolated.
    pub fn turned(&self, azimuth: f64) -> Self {
        let shift = (azimuth / TAU).rem_euclid(1.0) * self.width as f64;
        // A tiny deviation from whole pixels is a rounding error.
        let shift = if (shift - shift.round()).abs() < 1e-9 { shift.round() } else { shift };
        let (whole, part) = (shift.floor() as isize, shift.fract() as f32);
        let mut rgb = vec![[0.0; 3]; self.rgb.len()];
        rgb.par_chunks_mut(self.width).enumerate().for_each(|(y, row)| {
            for (x, out) in row.iter_mut().enumerate() {
                let [a, b] = [0, 1].map(|k| self.pixel(x as isize + whole + k, y as isize));
                *out = std::array::from_fn(|c| if part == 0.0 { a[c] } else { a[c] + part * (b[c] - a[c]) });
            }
        });
        Self::tabled(self.width, self.height, rgb)
    }

    /// The environment at half resolution; the flux from every part of the sphere is preserved.
    pub fn halved(&self) -> Self {
        let [width, height] = [self.width, self.height].map(|n| (n / 2).max(1));
        let down = parts(self.height, height, |y| -(PI * y / self.height as f64).cos());
        let along = parts(self.width, width, |x| x);
        let mut rgb = vec![[0.0_f32; 3]; width * height];
        rgb.par_chunks_mut(width).zip(&down).for_each(|(row, rows)| {
            for (out, columns) in row.iter_mut().zip(&along) {
                let mut sum = [0.0_f64; 3];
                for (y, v) in rows {
                    for (x, u) in columns {
                        let pixel = self.rgb[y * self.width + x];
                        (0..3).for_each(|c| sum[c] += u * v * f64::from(pixel[c]));
                    }
                }
                *out = sum.map(|v| v as f32);
            }
        });
        Self::tabled(width, height, rgb)
    }
}

/// Replaces infinite and NaN values of a few pixels, and reports it.
///
/// # Errors
/// `Input` if there are too many.
fn made_finite(name: &str, width: usize, rgb: &mut [[f32; 3]]) -> Result<Option<String>> {
    let bad = |pixel: &[f32; 3]| pixel.iter().any(|v| !v.is_finite());
    let count = rgb.iter().filter(|pixel| bad(pixel)).count();
    let Some(first) = rgb.iter().position(bad) else { return Ok(None) };
    if count as f64 > MAX_NOT_FINITE * rgb.len() as f64 {
        let [r, g, b] = rgb[first];
        let problem = format!(
            "has {count} pixels with infinite radiance or none, the first ({r}, {g}, {b}) in column {}, row {}",
            first % width,
            first / width
        );
        return Err(Error::input(name, problem, "give finite radiances in 99 % of the pixels"));
    }
    let brightest = rgb.as_flattened().iter().copied().filter(|v| v.is_finite()).fold(0.0_f32, f32::max);
    let [mut infinite, mut none] = [0, 0];
    for pixel in rgb.iter_mut().filter(|pixel| bad(pixel)) {
        if pixel.iter().any(|v| v.is_nan() || *v == f32::NEG_INFINITY) {
            none += 1;
            *pixel = [0.0; 3];
        } else {
            infinite += 1;
            *pixel = pixel.map(|v| v.min(brightest));
        }
    }
    let words = [
        (infinite > 0).then(|| {
            format!("pixels with infinite radiance, which counts as {brightest}, the brightest finite one: {infinite}")
        }),
        (none > 0).then(|| format!("pixels whose radiance is no number, which count as black: {none}")),
    ];
    Ok(Some(words.into_iter().flatten().collect::<Vec<_>>().join("; ")))
}

/// Overlaps between two divisions of an axis: for each of `to` cells, the indices of the overlapping `from` cells and
/// their share, by an increasing measure of their edges.
fn parts(from: usize, to: usize, measure: impl Fn(f64) -> f64) -> Vec<Vec<(usize, f64)>> {
    let step = from as f64 / to as f64;
    let cell = |k: usize| {
        let [begin, end] = [k as f64 * step, ((k + 1) as f64 * step).min(from as f64)];
        let whole = measure(end) - measure(begin);
        let part = |i: usize| (measure((i as f64 + 1.0).min(end)) - measure((i as f64).max(begin))) / whole;
        let last = (end.ceil() as usize).min(from);
        (begin as usize..last).map(|i| (i, part(i))).filter(|(_, p)| *p > 1e-12).collect()
    };
    (0..to).map(cell).collect()
}

//! Interpolation of a photograph between its pixels by cubic B-splines (Unser 1999).

use rayon::prelude::*;

/// Pole of the cubic B-spline's inverse filter, √3 − 2, and its gain.
const POLE: f32 = -0.267_949_2;
const GAIN: f32 = 6.0;

/// Number of terms of the inverse filter's initial value: the pole's 16th power is below f32 precision.
const TERMS: usize = 16;

/// Radius in pixels around unknown pixels in which interpolated values are invalid.
const SPOILED: usize = 2;

/// Rows and columns of coefficients beyond the photograph.
const MARGIN: usize = 2;

/// Interpolated light of one channel.
pub(super) struct Plane {
    pub width: usize,
    pub height: usize,
    /// Coefficients with a margin of [`MARGIN`] on every side.
    coefficients: Vec<f32>,
    /// 1 where a pixel and its neighbours are known; empty if all are.
    known: Vec<f32>,
}

impl Plane {
    /// From row-major light; NaN is unknown.
    pub(super) fn new(light: &[f32], width: usize, height: usize) -> Self {
        let (mut filled, known) = fill(light, width, height);
        to_coefficients(&mut filled, width, height);
        Self { width, height, coefficients: padded(&filled, width, height), known }
    }

    /// Light times known fraction at a position in pixels, and the known fraction: 1 inside and 0 outside of the
    /// photograph. The fraction falls over half a pixel at the border, so that line integrals have no jumps there.
    #[inline(always)]
    pub(super) fn at(&self, x: f32, y: f32) -> [f32; 2] {
        let (right, bottom) = ((self.width - 1) as f32, (self.height - 1) as f32);
        let depth = x.min(right - x).min(y.min(bottom - y));
        if depth.is_nan() || depth <= -0.5 {
            return [0.0; 2];
        }
        let (x, y) = (x.clamp(0.0, right), y.clamp(0.0, bottom));
        let known = (depth + 0.5).min(1.0) * self.known_at(x, y);
        if known == 0.0 {
            return [0.0; 2];
        }
        let (left, top) = (x as usize, y as usize);
        let (across, down) = (weights(x - left as f32), weights(y - top as f32));
        let stride = self.width + 2 * MARGIN;
        // The first of four taps precedes the pixel by one.
        let first = (top + MARGIN - 1) * stride + left + MARGIN - 1;
        let mut sum = 0.0;
        for (k, weight) in down.iter().enumerate() {
            let Some(row) = self.coefficients.get(first + k * stride..).and_then(|r| r.first_chunk::<4>()) else {
                break;
            };
            sum += weight * (row[0] * across[0] + row[1] * across[1] + row[2] * across[2] + row[3] * across[3]);
        }
        [sum * known, known]
    }

    /// Spline coefficient of a pixel, approximately its light; 0 where unknown.
    pub(super) fn coefficient(&self, x: usize, y: usize) -> f32 {
        if self.known.get(y * self.width + x) == Some(&0.0) {
            return 0.0;
        }
        self.coefficients[(y + MARGIN) * (self.width + 2 * MARGIN) + x + MARGIN]
    }

    /// Known fraction of the four pixels around a position.
    #[inline(always)]
    fn known_at(&self, x: f32, y: f32) -> f32 {
        if self.known.is_empty() {
            return 1.0;
        }
        let (left, top) = (x as usize, y as usize);
        let (right, bottom) = ((left + 1).min(self.width - 1), (top + 1).min(self.height - 1));
        let (a, b) = (x - left as f32, y - top as f32);
        let row = |y: usize| self.known[y * self.width + left] * (1.0 - a) + self.known[y * self.width + right] * a;
        row(top) * (1.0 - b) + row(bottom) * b
    }
}

/// Converts values of an image, continued by its mirror image, to interpolating spline coefficients.
pub(super) fn to_coefficients(image: &mut [f32], width: usize, height: usize) {
    image.par_chunks_mut(width).for_each(along_row);
    along_columns(image, width, height);
}

/// Weights of the four coefficients around a position.
#[inline(always)]
pub(super) fn weights(t: f32) -> [f32; 4] {
    let (u, square) = (1.0 - t, t * t);
    let cube = square * t;
    [u * u * u / 6.0, 2.0 / 3.0 - square + 0.5 * cube, 2.0 / 3.0 - u * u + 0.5 * u * u * u, cube / 6.0]
}

/// Interpolates unknown pixels along rows, and marks pixels with entirely known neighbourhoods.
fn fill(light: &[f32], width: usize, height: usize) -> (Vec<f32>, Vec<f32>) {
    let mut filled = light.to_vec();
    if light.iter().all(|l| l.is_finite()) {
        return (filled, vec![]);
    }
    filled.par_chunks_mut(width).for_each(|row| {
        let mut x = 0;
        while x < row.len() {
            let end = (x..row.len()).find(|k| row[*k].is_finite()).unwrap_or(row.len());
            let before = x.checked_sub(1).map(|k| row[k]);
            let after = row.get(end).copied();
            let (a, b) = (before.or(after).unwrap_or(0.0), after.or(before).unwrap_or(0.0));
            for (i, k) in (x..end).enumerate() {
                row[k] = a + (b - a) * (i + 1) as f32 / (end - x + 1) as f32;
            }
            x = end + 1;
        }
    });
    let mut known = vec![1.0; light.len()];
    for i in (0..light.len()).filter(|i| !light[*i].is_finite()) {
        let (x, y) = (i % width, i / width);
        for row in y.saturating_sub(SPOILED)..(y + SPOILED + 1).min(height) {
            known[row * width + x.saturating_sub(SPOILED)..row * width + (x + SPOILED + 1).min(width)].fill(0.0);
        }
    }
    (filled, known)
}

/// Converts values of a row to coefficients; the row is continued by its mirror image.
fn along_row(row: &mut [f32]) {
    let n = row.len();
    if n < 2 {
        return;
    }
    let mirrored = |k: usize| row[mirror(k as isize, n)];
    let first = (0..TERMS).rev().fold(0.0, |sum, k| mirrored(k) + POLE * sum);
    row[0] = first;
    (1..n).for_each(|k| row[k] += POLE * row[k - 1]);
    row[n - 1] = POLE / (POLE * POLE - 1.0) * (row[n - 1] + POLE * row[n - 2]);
    (0..n - 1).rev().for_each(|k| row[k] = POLE * (row[k + 1] - row[k]));
    row.iter_mut().for_each(|v| *v *= GAIN);
}

/// [`along_row`] for all columns at once, row by row.
fn along_columns(image: &mut [f32], width: usize, height: usize) {
    if height < 2 {
        return;
    }
    let mut first = vec![0.0_f32; width];
    for k in (0..TERMS).rev() {
        let row = &image[mirror(k as isize, height) * width..][..width];
        first.iter_mut().zip(row).for_each(|(f, v)| *f = v + POLE * *f);
    }
    image[..width].copy_from_slice(&first);
    for y in 1..height {
        let (above, row) = image[(y - 1) * width..(y + 1) * width].split_at_mut(width);
        row.iter_mut().zip(above).for_each(|(v, a)| *v += POLE * *a);
    }
    let (above, last) = image[(height - 2) * width..].split_at_mut(width);
    last.iter_mut().zip(above).for_each(|(v, a)| *v = POLE / (POLE * POLE - 1.0) * (*v + POLE * *a));
    for y in (0..height - 1).rev() {
        let (row, below) = image[y * width..(y + 2) * width].split_at_mut(width);
        row.iter_mut().zip(below).for_each(|(v, b)| *v = POLE * (*b - *v));
    }
    image.iter_mut().for_each(|v| *v *= GAIN);
}

/// Index in a line of `n` values that is continued by its mirror image.
fn mirror(k: isize, n: usize) -> usize {
    if n < 2 {
        return 0;
    }
    let period = 2 * (n as isize - 1);
    let k = k.rem_euclid(period);
    k.min(period - k) as usize
}

fn padded(image: &[f32], width: usize, height: usize) -> Vec<f32> {
    let stride = width + 2 * MARGIN;
    let mut out = vec![0.0; stride * (height + 2 * MARGIN)];
    out.par_chunks_mut(stride).enumerate().for_each(|(y, row)| {
        let source = &image[mirror(y as isize - MARGIN as isize, height) * width..][..width];
        row.iter_mut().enumerate().for_each(|(x, v)| *v = source[mirror(x as isize - MARGIN as isize, width)]);
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_keep_their_values_and_smooth_light_is_met_between_them() {
        let (width, height) = (61, 47);
        let light = |x: f64, y: f64| 1.0 + (0.5 * x + 0.3).sin() * (0.4 * y).cos();
        let image: Vec<f32> =
            (0..width * height).map(|i| light((i % width) as f64, (i / width) as f64) as f32).collect();
        let plane = Plane::new(&image, width, height);
        for (i, light) in image.iter().enumerate() {
            let [found, known] = plane.at((i % width) as f32, (i / width) as f32);
            assert!((found - known * light).abs() < 2e-6 && known >= 0.5, "{i}: {found} {light}");
        }
        let mut worst = 0.0_f64;
        for k in 0..1000 {
            // Away from the border, whose mirror image is another function.
            let (x, y) = (8.0 + 0.0437 * f64::from(k), 8.0 + 0.0307 * f64::from(k));
            worst = worst.max((f64::from(plane.at(x as f32, y as f32)[0]) - light(x, y)).abs());
        }
        // Error bound: (0.5 rad per pixel)⁴ · 1/384 for each direction.
        assert!(worst < 3e-4, "{worst}");
    }

    #[test]
    fn unknown_pixels_stay_unknown() {
        let mut image = vec![1.0_f32; 20 * 10];
        image[5 * 20 + 10] = f32::NAN;
        let plane = Plane::new(&image, 20, 10);
        for (x, y, known) in [
            (10.0, 5.0, 0.0),
            (12.0, 5.0, 0.0),
            (13.0, 5.0, 1.0),
            (12.25, 5.0, 0.25),
            (-0.6, 5.0, 0.0),
            (-0.25, 5.0, 0.25),
        ] {
            let [light, found] = plane.at(x, y);
            assert!((found - known).abs() < 1e-6, "{x} {y}: {found}");
            assert!((light - known).abs() < 1e-5, "{x} {y}: {light}");
        }
        for (width, height) in [(1, 1), (1, 5), (5, 1), (2, 2)] {
            let plane = Plane::new(&vec![3.0; width * height], width, height);
            assert!((plane.at((width - 1) as f32, 0.0)[0] - 1.5).abs() < 1e-5);
        }
        let nothing = Plane::new(&[f32::NAN; 12], 4, 3);
        assert_eq!(nothing.at(1.0, 1.0), [0.0; 2]);
    }
}

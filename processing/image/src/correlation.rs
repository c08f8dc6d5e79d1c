//! Normalised cross-correlation of two partly known fields for all shifts.

use super::convolution::good_size;
use nacre_fourier::Fourier;
use num_complex::Complex32;

/// Complex-valued image; values are 0 where the mask is 0.
#[derive(Clone, Debug)]
pub struct Field {
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Values, row-major.
    pub values: Vec<Complex32>,
    /// 1 where known, else 0.
    pub mask: Vec<f32>,
}

/// Normalised cross-correlation for shifts of up to the whole size, -1 to 1.
pub struct Correlation {
    width: usize,
    height: usize,
    likeness: Vec<f32>,
    overlap: Vec<f32>,
}

impl Field {
    /// Subtracts the mean of the known values.
    pub fn centered(mut self) -> Self {
        let known = self.mask.iter().sum::<f32>().max(1.0);
        let mean = self.values.iter().sum::<Complex32>() / known;
        self.values.iter_mut().zip(&self.mask).for_each(|(v, m)| *v -= mean * *m);
        self
    }
}

impl Correlation {
    /// `Σ a(x + d) b*(x)` over the geometric mean of the powers of both fields within their overlap; never NaN.
    pub fn of(a: &Field, b: &Field) -> Self {
        Self::with(a, b, |sum| sum.re)
    }

    /// As [`Self::of`], but the magnitude of the complex sum, 0 to 1: a phase common to all pixels has no effect.
    pub fn of_any_phase(a: &Field, b: &Field) -> Self {
        Self::with(a, b, Complex32::norm)
    }

    fn with(a: &Field, b: &Field, size: fn(Complex32) -> f32) -> Self {
        let width = good_size(a.width + b.width);
        let height = good_size(a.height + b.height);
        let fourier = Fourier::new([width, height]);
        let transformed = |field: &Field, value: &dyn Fn(usize) -> Complex32| {
            let mut plane = vec![Complex32::default(); width * height];
            for y in 0..field.height {
                for x in 0..field.width {
                    plane[y * width + x] = value(y * field.width + x);
                }
            }
            fourier.forward(plane)
        };
        let parts = |field: &Field| {
            [
                transformed(field, &|i| field.values[i]),
                transformed(field, &|i| Complex32::new(field.values[i].norm_sqr(), 0.0)),
                transformed(field, &|i| Complex32::new(field.mask[i], 0.0)),
            ]
        };
        let (of_a, of_b) = (parts(a), parts(b));
        let product = |p: usize, q: usize, size: fn(Complex32) -> f32| {
            let both = of_a[p].iter().zip(&of_b[q]).map(|(a, b)| a * b.conj()).collect();
            let back: Vec<Complex32> = fourier.inverse(both);
            back.into_iter().map(|v| size(v) / (width * height) as f32).collect::<Vec<f32>>()
        };
        let real = |v: Complex32| v.re;
        let (same, power_a, power_b, overlap) =
            (product(0, 0, size), product(1, 2, real), product(2, 1, real), product(2, 2, real));
        let most = power_a.iter().chain(&power_b).copied().fold(f32::MIN_POSITIVE, f32::max);
        let likeness = (0..width * height).map(|i| {
            let both = (power_a[i].max(0.0) * power_b[i].max(0.0)).sqrt();
            // Below this power, rounding errors dominate.
            if both < 1e-4 * most { 0.0 } else { (same[i] / both).clamp(-1.0, 1.0) }
        });
        Self { width, height, likeness: likeness.collect(), overlap }
    }

    fn index(&self, [dx, dy]: [i64; 2]) -> usize {
        let wrapped = |d: i64, n: usize| d.rem_euclid(n as i64) as usize;
        wrapped(dy, self.height) * self.width + wrapped(dx, self.width)
    }

    /// Correlation at a shift in pixels, right and down.
    pub fn at(&self, shift: [i64; 2]) -> f32 {
        self.likeness[self.index(shift)]
    }

    /// Number of pixels in which both are known.
    pub fn overlap(&self, shift: [i64; 2]) -> f32 {
        self.overlap[self.index(shift)]
    }

    /// Sub-pixel position of a maximum, by parabolas through its neighbours.
    pub fn between(&self, [dx, dy]: [i64; 2]) -> [f64; 2] {
        let here = self.at([dx, dy]);
        let off = |less: f32, more: f32| {
            let bend = f64::from(less - 2.0 * here + more);
            if bend < 0.0 { (0.5 * f64::from(less - more) / bend).clamp(-0.5, 0.5) } else { 0.0 }
        };
        [
            dx as f64 + off(self.at([dx - 1, dy]), self.at([dx + 1, dy])),
            dy as f64 + off(self.at([dx, dy - 1]), self.at([dx, dy + 1])),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(width: usize, height: usize, value: impl Fn(usize, usize) -> f32, known: impl Fn(usize) -> bool) -> Field {
        let mask: Vec<f32> = (0..width * height).map(|i| f32::from(u8::from(known(i)))).collect();
        let values = (0..width * height).map(|i| Complex32::new(value(i % width, i / width), 0.0) * mask[i]).collect();
        Field { width, height, values, mask }
    }

    #[test]
    fn shifts_come_back_whatever_is_masked() {
        let scene = |x: usize, y: usize| (((x * 7919 + y * 104_729) ^ (x * y)) % 97) as f32 - 48.0;
        let a = field(40, 30, |x, y| scene(x + 5, y + 9), |i| i % 11 != 3);
        let b = field(33, 37, scene, |i| i % 7 != 2);
        let found = Correlation::of(&a, &b);
        // The content of a at x is at x + (5, 9) in b: a is shifted by -(5, 9).
        assert!(found.at([-5, -9]) > 0.999, "{}", found.at([-5, -9]));
        assert!(found.at([3, 2]).abs() < 0.3);
        let both = (0..28).flat_map(|y| (0..28).map(move |x| (x, y)));
        let counted = both.filter(|(x, y)| (y * 40 + x) % 11 != 3 && ((y + 9) * 33 + x + 5) % 7 != 2).count();
        assert!((found.overlap([-5, -9]) - counted as f32).abs() < 0.1, "{counted}");
    }
}

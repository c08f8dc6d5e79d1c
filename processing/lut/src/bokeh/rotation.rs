//! Rotation of an image by any angle.

use nacre_image::catmull_rom;
use rayon::prelude::*;

/// An image; NaN where unknown.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Map {
    pub width: usize,
    pub height: usize,
    pub values: Vec<f32>,
}

impl Map {
    /// Rotates anticlockwise by `degrees`, enlarging the image as needed; NaN outside of the original. Multiples of 90°
    /// permute pixels exactly.
    pub(super) fn turned(&self, degrees: f64) -> Self {
        let quarters = degrees / 90.0;
        if quarters == quarters.round() {
            return (0..quarters.rem_euclid(4.0) as usize).fold(self.clone(), |map, _| map.quarter());
        }
        let (sin, cos) = degrees.to_radians().sin_cos();
        let (w, h) = (self.width as f64, self.height as f64);
        let width = (w * cos.abs() + h * sin.abs() - 1e-9).ceil().max(1.0) as usize;
        let height = (w * sin.abs() + h * cos.abs() - 1e-9).ceil().max(1.0) as usize;
        let middle = |size: usize| 0.5 * (size as f64 - 1.0);
        let at = |i: usize| {
            // Offset right of and below the centre, rotated back.
            let (x, y) = ((i % width) as f64 - middle(width), (i / width) as f64 - middle(height));
            self.at(middle(self.width) + x * cos - y * sin, middle(self.height) + x * sin + y * cos)
        };
        Self { width, height, values: (0..width * height).into_par_iter().map(at).collect() }
    }

    fn quarter(&self) -> Self {
        let (width, height) = (self.height, self.width);
        let at = |i: usize| self.values[(i % width) * self.width + (self.width - 1 - i / width)];
        Self { width, height, values: (0..width * height).map(at).collect() }
    }

    /// Interpolated value: cubic convolution with the Catmull-Rom kernel (Keys 1981), linear in the outermost pixels;
    /// NaN outside.
    pub(super) fn at(&self, x: f64, y: f64) -> f32 {
        let (last_x, last_y) = ((self.width - 1) as f64, (self.height - 1) as f64);
        // Tolerance for rounding errors at the border.
        if !((-1e-6..=last_x + 1e-6).contains(&x) && (-1e-6..=last_y + 1e-6).contains(&y)) {
            return f32::NAN;
        }
        let ((x0, wx), (y0, wy)) = (taps(x, self.width), taps(y, self.height));
        let mut sum = 0.0;
        for (j, wy) in wy.iter().enumerate().filter(|(_, w)| **w != 0.0) {
            for (i, wx) in wx.iter().enumerate().filter(|(_, w)| **w != 0.0) {
                // Taps outside of the image have zero weight.
                let (column, row) = (x0 + i as i64, y0 + j as i64);
                sum += wx * wy * f64::from(self.values[row as usize * self.width + column as usize]);
            }
        }
        sum as f32
    }
}

/// Index of the first of four pixels, and the weights of all four.
fn taps(at: f64, size: usize) -> (i64, [f64; 4]) {
    let at = at.clamp(0.0, (size - 1) as f64);
    let first = at.floor().min(size as f64 - 2.0).max(0.0);
    let t = at - first;
    let before = first as i64 - 1;
    if before < 0 || before + 3 >= size as i64 {
        let weights = if size == 1 { [0.0, 1.0, 0.0, 0.0] } else { [0.0, 1.0 - t, t, 0.0] };
        return (before, weights);
    }
    (before, catmull_rom(t as f32).map(f64::from))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene(width: usize, height: usize, of: &dyn Fn(f64, f64) -> f64) -> Map {
        let values = (0..width * height).map(|i| of((i % width) as f64, (i / width) as f64) as f32).collect();
        Map { width, height, values }
    }

    #[test]
    fn quarters_are_exact_and_anticlockwise() {
        let map = scene(3, 2, &|x, y| 3.0 * y + x);
        let turned = map.turned(90.0);
        // The right column becomes the top row.
        assert_eq!((turned.width, turned.height, turned.values), (2, 3, vec![2.0, 5.0, 1.0, 4.0, 0.0, 3.0]));
        assert_eq!(map.turned(-270.0), map.turned(90.0));
        assert_eq!(map.turned(180.0).values, [5.0, 4.0, 3.0, 2.0, 1.0, 0.0]);
        assert_eq!(map.turned(720.0), map);
    }

    #[test]
    fn other_angles_agree_with_the_scene_itself() {
        let of = |x: f64, y: f64| (0.3 * x).sin() + (0.2 * y).cos();
        let (map, (sin, cos)) = (scene(60, 40, &of), 27_f64.to_radians().sin_cos());
        let turned = map.turned(27.0);
        let (mut known, mut furthest) = (0, 0.0_f64);
        for (i, v) in turned.values.iter().enumerate().filter(|(_, v)| v.is_finite()) {
            let x = (i % turned.width) as f64 - 0.5 * (turned.width - 1) as f64;
            let y = (i / turned.width) as f64 - 0.5 * (turned.height - 1) as f64;
            let (x, y) = (29.5 + x * cos - y * sin, 19.5 + x * sin + y * cos);
            known += 1;
            if (2.0..57.0).contains(&x) && (2.0..37.0).contains(&y) {
                furthest = furthest.max((f64::from(*v) - of(x, y)).abs());
            }
        }
        assert!(furthest < 2e-3 && (2200..2400).contains(&known), "{furthest} {known}");
        // A single pixel has no interior for interpolation.
        assert_eq!(scene(1, 1, &of).turned(33.0).width, 2);
    }
}

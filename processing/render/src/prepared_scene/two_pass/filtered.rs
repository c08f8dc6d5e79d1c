//! Environments filtered by two passes around a pole.

use crate::environment::factor::Part;
use crate::environment::{Environment, two_pass};
use crate::light::Sky;
use crate::vector::V3;
use nacre_base::Result;
use nacre_base::progress::Progress;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Sky lookups along each side of a pixel.
const PLACES: usize = 2;

/// A sky, scaled to about the resolution of the filtered one.
pub(super) struct Source<'a> {
    sky: &'a Sky,
    map: Environment,
    width: usize,
}

impl<'a> Source<'a> {
    pub(super) fn new(sky: &'a Sky, width: usize) -> Self {
        let mut map = sky.map.clone();
        while map.width >= 2 * PLACES * width {
            map = map.halved();
        }
        Self { sky, map, width }
    }

    /// Filters around a pole: the first of the paper's rotations and the two passes (2017 CVMP, section 5.2). The
    /// second rotation takes place in the lookup.
    ///
    /// # Errors
    /// `Cancelled`.
    pub(super) fn filtered(&self, pole: V3, part: &Part, progress: &dyn Progress) -> Result<Filtered> {
        progress.check()?;
        let first = if pole.x.abs() < 0.9 { V3::x() } else { V3::y() };
        let first = (first - pole * pole.dot(&first)).normalize();
        let axes = [first, pole.cross(&first), pole];
        let (width, height) = (self.width, self.width / 2);
        let radiance = |x: f64, y: f64| {
            let (sin, cos) = (PI * y / height as f64).sin_cos();
            let (east, ahead) = (TAU * (0.5 - x / width as f64)).sin_cos();
            let towards = axes[0] * (sin * ahead) + axes[1] * (sin * east) + axes[2] * cos;
            self.map.radiance(self.sky.frame.map(|f| f.dot(&towards)))
        };
        let strength = self.sky.strength as f32 / (PLACES * PLACES) as f32;
        let pixel = |i: usize| {
            let mut sum = [0.0; 3];
            for k in 0..PLACES * PLACES {
                let [u, v] = [k % PLACES, k / PLACES].map(|k| (k as f64 + 0.5) / PLACES as f64);
                let rgb = radiance((i % width) as f64 + u, (i / width) as f64 + v);
                (0..3).for_each(|c| sum[c] += rgb[c] * strength);
            }
            sum
        };
        let turned = Environment::of(width, height, (0..width * height).into_par_iter().map(pixel).collect())?;
        Ok(Filtered { axes, width, rgb: two_pass(&turned, part, progress)? })
    }
}

/// Reflection for each mirror direction, times the cosine of view: twice as many columns as rows, row 0 at the pole.
pub(super) struct Filtered {
    axes: [V3; 3],
    width: usize,
    rgb: Vec<[f32; 3]>,
}

impl Filtered {
    /// Value in a direction, linear between pixel centres. The table rotates with the meridians about a pole, so there
    /// is no interpolation across it.
    pub(super) fn at(&self, towards: V3) -> [f64; 3] {
        let [x, y, z] = self.axes.map(|axis| axis.dot(&towards));
        let (width, height) = (self.width, self.width / 2);
        let row = (x.hypot(y).atan2(z) / PI * height as f64 - 0.5).clamp(0.0, (height - 1) as f64);
        let column = (0.5 - y.atan2(x) / TAU) * width as f64 - 0.5;
        let (left, top) = (column.floor(), (row as usize).min(height - 2));
        let (u, v) = (column - left, row - top as f64);
        let columns = [0.0, 1.0].map(|k| (left + k).rem_euclid(width as f64) as usize % width);
        let mut sum = [0.0; 3];
        for (y, down) in [(top, 1.0 - v), (top + 1, v)] {
            for (x, along) in columns.into_iter().zip([1.0 - u, u]) {
                let rgb = self.rgb[y * width + x];
                (0..3).for_each(|c| sum[c] += down * along * f64::from(rgb[c]));
            }
        }
        sum
    }
}

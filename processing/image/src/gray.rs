//! Grey images.

use crate::{Raster, Samples, read};
use nacre_base::Result;
use rayon::prelude::*;
use std::path::Path;

/// Grey image of `width · height` values in file units (not linear light), row 0 on top.
#[derive(Clone, Debug, PartialEq)]
pub struct Gray {
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// Values; never NaN.
    pub values: Vec<f32>,
}

impl Gray {
    /// Reads a photograph as the mean of its channels.
    ///
    /// # Errors
    /// As [`read()`].
    pub fn read(path: &Path) -> Result<Self> {
        Ok(Self::of(&read(path)?))
    }

    /// Mean of an image's channels.
    pub fn of(raster: &Raster) -> Self {
        let n = raster.channels;
        let mean = |value: &(dyn Fn(usize) -> f32 + Sync)| -> Vec<f32> {
            let one = |i: usize| (0..n).map(|c| value(i * n + c)).sum::<f32>() / n as f32;
            (0..raster.width * raster.height).into_par_iter().map(one).collect()
        };
        let values = match &raster.samples {
            Samples::U8(v) if n == 1 => v.par_iter().map(|v| f32::from(*v)).collect(),
            Samples::U8(v) => mean(&|i| f32::from(v[i])),
            Samples::U16(v) => mean(&|i| f32::from(v[i])),
            Samples::F32(v) => mean(&|i| if v[i].is_finite() { v[i] } else { 0.0 }),
        };
        Self { width: raster.width, height: raster.height, values }
    }

    /// Value of a pixel; beyond the border, of the nearest pixel.
    pub fn near(&self, x: i64, y: i64) -> f32 {
        let (x, y) = (x.clamp(0, self.width as i64 - 1), y.clamp(0, self.height as i64 - 1));
        self.values[y as usize * self.width + x as usize]
    }

    /// Bilinear interpolation at a position.
    pub fn at(&self, [x, y]: [f64; 2]) -> f32 {
        let (left, top) = (x.floor(), y.floor());
        let (fx, fy) = ((x - left) as f32, (y - top) as f32);
        let (left, top) = (left as i64, top as i64);
        let row = |y: i64| self.near(left, y) * (1.0 - fx) + self.near(left + 1, y) * fx;
        row(top) * (1.0 - fy) + row(top + 1) * fy
    }

    /// Reduces the image to half its size by means of 2 × 2 pixels.
    pub fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let value = |i: usize| {
            let (x, y) = (2 * (i % width), 2 * (i / width));
            let row = |y: usize| self.values[y * self.width + x] + self.values[y * self.width + x + 1];
            0.25 * (row(y) + row(y + 1))
        };
        Self { width, height, values: (0..width * height).into_par_iter().map(value).collect() }
    }

    /// Blurs rows and columns with the weights 1-2-1, a Gaussian of 0.7 px.
    pub fn softened(&self) -> Self {
        let mean = |left: f32, middle: f32, right: f32| 0.5 * middle + 0.25 * (left + right);
        let (width, last) = (self.width, self.height.saturating_sub(1));
        let mut along = vec![0.0; self.values.len()];
        along.par_chunks_mut(width).zip(self.values.par_chunks(width)).for_each(|(to, from)| {
            let end = width - 1;
            to[0] = mean(from[0], from[0], from[1.min(end)]);
            to[end] = mean(from[end.saturating_sub(1)], from[end], from[end]);
            to.iter_mut().skip(1).zip(from.windows(3)).for_each(|(to, near)| *to = mean(near[0], near[1], near[2]));
        });
        let row = |y: usize| &along[y * width..][..width];
        let mut values = vec![0.0; self.values.len()];
        values.par_chunks_mut(width).enumerate().for_each(|(y, to)| {
            let [above, middle, below] = [y.saturating_sub(1), y, (y + 1).min(last)].map(row);
            for (x, to) in to.iter_mut().enumerate() {
                *to = mean(above[x], middle[x], below[x]);
            }
        });
        Self { width, height: self.height, values }
    }
}

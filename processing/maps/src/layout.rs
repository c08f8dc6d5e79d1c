//! Geometric transformations of maps: rotation, tiling, cropping and resampling.

use super::asset::{Kind, MOST_PIXELS, Map, Maps};
use nacre_base::{Error, Result};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Arrangement of copies in an area larger than the map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Layout {
    /// Copies side by side.
    #[default]
    Repeat,
    /// Alternate copies mirrored along columns and rows, so that edges match.
    Mirror,
    /// Alternate rows of copies shifted by half a copy.
    Brick,
}

/// Tolerance in degrees within which a rotation counts as an exact multiple of 90°.
const QUARTER: f64 = 1e-9;

/// Source position (column, row), and whether the copy is mirrored in x and y.
type Source = ([f64; 2], [bool; 2]);

impl Maps {
    /// Rotates image and orientations anticlockwise by `deg`. Multiples of 90° are exact. Otherwise the map grows to
    /// hold the rotated image, its corners are masked, and values are interpolated.
    ///
    /// # Errors
    /// `Input` for a non-finite angle.
    pub fn rotated(&self, deg: f64) -> Result<Self> {
        if !deg.is_finite() || deg.abs() > 1e6 {
            return Err(Error::input("rotation", format!("is {deg}"), "give an angle in degrees"));
        }
        let deg = deg.rem_euclid(360.0);
        let quarters = (deg / 90.0).round();
        let (w, h) = (self.width as f64, self.height as f64);
        if (deg - 90.0 * quarters).abs() < QUARTER {
            let quarters = quarters as usize % 4;
            let [width, height] = if quarters % 2 == 1 { [self.height, self.width] } else { [self.width, self.height] };
            let source = move |x: f64, y: f64| match quarters {
                0 => [x, y],
                1 => [w - 1.0 - y, x],
                2 => [w - 1.0 - x, h - 1.0 - y],
                _ => [y, h - 1.0 - x],
            };
            return self.filled([width, height], quarters as f64 * 90.0, &|x, y| (source(x, y), [false; 2]));
        }
        let (sin, cos) = deg.to_radians().sin_cos();
        let size = [w * cos.abs() + h * sin.abs(), w * sin.abs() + h * cos.abs()].map(|n| (n - 1e-6).ceil());
        let middle = size.map(|n| 0.5 * (n - 1.0));
        self.filled(size.map(|n| n as usize), deg, &|x, y| {
            // Inverse rotation, with y pointing up.
            let (dx, dy) = (x - middle[0], middle[1] - y);
            let (ux, uy) = (cos * dx + sin * dy, cos * dy - sin * dx);
            ([0.5 * (w - 1.0) + ux, 0.5 * (h - 1.0) - uy], [false; 2])
        })
    }

    /// Crops or tiles the map to another size in pixels, from the upper left.
    ///
    /// # Errors
    /// `Input` for an invalid or too large size.
    pub fn laid_out(&self, size: [usize; 2], layout: Layout) -> Result<Self> {
        let (w, h) = (self.width, self.height);
        self.filled(size, 0.0, &|x, y| {
            let (x, y) = (x as usize, y as usize);
            let row = y / h;
            let x = if layout == Layout::Brick && row % 2 == 1 { x + w / 2 } else { x };
            let column = x / w;
            let flip = |copy: usize| layout == Layout::Mirror && copy % 2 == 1;
            let mirrored = [flip(column), flip(row)];
            let place = |at: usize, n: usize, flip: bool| if flip { n - 1 - at % n } else { at % n } as f64;
            ([place(x, w, mirrored[0]), place(y, h, mirrored[1])], mirrored)
        })
    }

    /// Shifts right and down by whole pixels into a frame of another size; uncovered pixels are masked.
    ///
    /// # Errors
    /// `Input` for an invalid or too large size.
    pub fn moved(&self, [dx, dy]: [i64; 2], size: [usize; 2]) -> Result<Self> {
        self.filled(size, 0.0, &|x, y| ([x - dx as f64, y - dy as f64], [false; 2]))
    }

    /// Resamples to `factor` times as many pixels along each axis; a coarser map averages over each new pixel.
    ///
    /// # Errors
    /// `Input` for a factor out of range.
    pub fn resampled(&self, factor: f64) -> Result<Self> {
        if !(1e-3..=1e3).contains(&factor) {
            return Err(Error::input("resolution", format!("changes by {factor}"), "give a factor of 0.001 to 1000"));
        }
        let size = [self.width, self.height].map(|n| ((n as f64 * factor).round() as usize).max(1));
        // Exact ratio of the rounded sizes.
        let step = [self.width as f64 / size[0] as f64, self.height as f64 / size[1] as f64];
        // One sample per covered source pixel.
        let many = step.map(|s| s.ceil().max(1.0) as usize);
        let mut new = self
            .sampled(size, 0.0, many, &|x, y| ([(x + 0.5) * step[0] - 0.5, (y + 0.5) * step[1] - 0.5], [false; 2]))?;
        for map in new.maps.values_mut() {
            for name in ["pixel_um", "pixel_mm"] {
                if let Some(pitch) = map.attributes.get(name).and_then(|t| t.parse::<f64>().ok()) {
                    map.attributes.insert(name.into(), (pitch * step[0]).to_string());
                }
            }
        }
        Ok(new)
    }

    fn filled(&self, size: [usize; 2], turn: f64, source: &(dyn Fn(f64, f64) -> Source + Sync)) -> Result<Self> {
        self.sampled(size, turn, [1, 1], source)
    }

    /// Map of another size, each pixel the mean of `many` samples over its area.
    fn sampled(
        &self,
        size: [usize; 2],
        turn_deg: f64,
        many: [usize; 2],
        source: &(dyn Fn(f64, f64) -> Source + Sync),
    ) -> Result<Self> {
        let [width, height] = size;
        if width == 0 || height == 0 || width.saturating_mul(height) > MOST_PIXELS || width.max(height) > 65_535 {
            let problem = format!("would be {width} × {height}");
            return Err(Error::input("map", problem, "ask for at most 128 Mpixel, and 65535 along a side"));
        }
        let pixel = |map: &Map, kind: Kind, i: usize| {
            let (x, y) = ((i % width) as f64, (i / width) as f64);
            let mut mean = Mean::default();
            for k in 0..many[0] * many[1] {
                let sub = |k: usize, n: usize| (k as f64 + 0.5) / n as f64 - 0.5;
                let (at, mirrored) = source(x + sub(k % many[0], many[0]), y + sub(k / many[0], many[1]));
                mean.add(self, map, kind, at, mirrored, turn_deg.to_radians());
            }
            mean.value(kind, many[0] * many[1])
        };
        let maps = self.maps.iter().map(|(kind, map)| {
            let both: Vec<[f32; 2]> = (0..width * height).into_par_iter().map(|i| pixel(map, *kind, i)).collect();
            let mask = both.iter().map(|v| f32::from(u8::from(v[0].is_finite()))).collect();
            let plane = |c: usize| both.iter().map(|v| v[c]).collect();
            // Other channels are dropped: no rule is known for transforming their values.
            let attributes = map.attributes.clone();
            (*kind, Map { value: plane(0), sigma: plane(1), mask, more: Default::default(), attributes })
        });
        Ok(Self { width, height, maps: maps.collect() })
    }
}

/// Weighted mean of values; orientations are averaged as doubled angles.
#[derive(Default)]
struct Mean {
    weight: f64,
    x: f64,
    y: f64,
    sigma: f64,
    single: Option<[f32; 2]>,
    samples: usize,
}

impl Mean {
    /// Adds the interpolated value at a position.
    fn add(&mut self, maps: &Maps, map: &Map, kind: Kind, at: [f64; 2], mirrored: [bool; 2], turn: f64) {
        let [w, h] = [maps.width as i64, maps.height as i64];
        let (left, top) = (at[0].floor(), at[1].floor());
        let (fx, fy) = (at[0] - left, at[1] - top);
        for (dx, dy, weight) in
            [(0, 0, (1.0 - fx) * (1.0 - fy)), (1, 0, fx * (1.0 - fy)), (0, 1, (1.0 - fx) * fy), (1, 1, fx * fy)]
        {
            let (x, y) = (left as i64 + dx, top as i64 + dy);
            if weight < 1e-9 || x < 0 || y < 0 || x >= w || y >= h {
                continue;
            }
            let i = (y * w + x) as usize;
            if map.mask[i] == 0.0 {
                continue;
            }
            let sigma = f64::from(map.sigma[i]);
            self.weight += weight;
            self.sigma += weight * sigma;
            self.samples += 1;
            let value = match kind {
                Kind::Period => {
                    self.x += weight * f64::from(map.value[i]);
                    map.value[i]
                }
                Kind::Orientation => {
                    let turned = moved(map.value[i], mirrored, turn);
                    let (sin, cos) = (2.0 * f64::from(turned)).sin_cos();
                    self.x += weight * cos;
                    self.y += weight * sin;
                    turned
                }
            };
            self.single = Some([value, map.sigma[i]]);
        }
    }

    /// Mean and σ; NaN if less than half of the area is known.
    fn value(&self, kind: Kind, samples: usize) -> [f32; 2] {
        if self.weight < 0.5 * samples as f64 {
            return [f32::NAN, f32::NAN];
        }
        // A value that is only moved keeps its bits.
        if let (1, Some(one)) = (self.samples, self.single) {
            return one;
        }
        // Noise of neighbours counts as fully correlated, as after smoothing, so averaging does not reduce σ.
        let sigma = (self.sigma / self.weight) as f32;
        match kind {
            Kind::Period => [(self.x / self.weight) as f32, sigma],
            Kind::Orientation => {
                // Isotropically distributed orientations have no mean.
                if self.x.hypot(self.y) < 0.5 * self.weight {
                    return [f32::NAN, f32::NAN];
                }
                [wrapped(0.5 * self.y.atan2(self.x)), sigma]
            }
        }
    }
}

/// Wraps an orientation to [0, π), also after rounding to `f32`.
pub(super) fn wrapped(theta: f64) -> f32 {
    let v = theta.rem_euclid(PI) as f32;
    if v >= std::f32::consts::PI { 0.0 } else { v }
}

/// Orientation after mirroring and rotating the image.
fn moved(theta: f32, mirrored: [bool; 2], turn: f64) -> f32 {
    // One reflection reverses the sense of angles; two are a rotation by half a turn.
    let flips = mirrored[0] != mirrored[1];
    if !flips && turn == 0.0 {
        return theta;
    }
    let theta = f64::from(theta);
    wrapped(if flips { -theta } else { theta } + turn)
}

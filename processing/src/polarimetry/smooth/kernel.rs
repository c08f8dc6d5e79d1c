//! One round of the filter: plain loops over short arrays, which the compiler turns into vector instructions.

use super::super::OrientationMaps;
use crate::progress::Progress;
use rayon::prelude::*;
use std::f32::consts::PI;

/// Pixels that are computed together.
const LANES: usize = 64;
/// Reach of the window in pixels: twice the Gaussian's σ; what lies beyond has 14 % of the weight.
const REACH: usize = 6;
/// Distance in pixels over which slopes are taken.
const BASE: usize = 3;
/// Variance of the median of nine independent values over that of their mean.
const MEDIAN_NOISE: f32 = 1.5;
/// Side of the square that a pixel is, as a variance.
const PIXEL: f32 = 1.0 / 12.0;

/// Planes of a field without and with what σ follows from.
///
/// 0 and 1: cos 2θ and sin 2θ; 2: reliability, 0 where masked; 3 and 4: mean place of what the pixel is made of, relative to
/// it, in px right and down; 5 to 7: its covariance xx, xy, yy in px²; 8 and 9: before the first round variance in rad² and
/// reliability, then means of M·D and of 1/M (see [`super`]); 10: how much of the pivot's noise is in the pixel.
pub(super) const VALUES: usize = 3;
pub(super) const TRACKED: usize = 11;

type Lane = [f32; LANES];

/// Planes of an image, row by row one after the other, inside a frame of masked pixels.
pub(super) struct Field<const PLANES: usize> {
    width: usize,
    height: usize,
    stride: usize,
    data: Vec<f32>,
}

impl<const PLANES: usize> Field<PLANES> {
    /// The map with each pixel's reliability.
    pub(super) fn new(map: &OrientationMaps, reliability: &[f32]) -> Self {
        let (width, height) = (map.width, map.height);
        let stride = width.next_multiple_of(LANES) + 2 * REACH;
        let mut field = Self { width, height, stride, data: vec![0.0; (height + 2 * REACH) * stride * PLANES] };
        let rows = field.data.par_chunks_mut(PLANES * stride).skip(REACH).take(height);
        rows.enumerate().for_each(|(y, row)| {
            for x in 0..width {
                let (i, at) = (y * width + x, REACH + x);
                if reliability[i] > 0.0 {
                    let (sin, cos) = (2.0 * map.orientation[i]).sin_cos();
                    (row[at], row[stride + at], row[2 * stride + at]) = (cos, sin, reliability[i]);
                    if PLANES == TRACKED {
                        row[8 * stride + at] = map.sigma[i] * map.sigma[i];
                        row[9 * stride + at] = reliability[i];
                    }
                }
            }
        });
        field
    }

    /// A field of the same size with nothing in it.
    pub(super) fn like(other: &Self) -> Self {
        Self { data: vec![0.0; other.data.len()], ..*other }
    }

    /// All planes of every pixel, row by row.
    pub(super) fn pixels(&self) -> impl Iterator<Item = [f32; PLANES]> {
        (0..self.width * self.height).map(|i| {
            let row = self.row(REACH + i / self.width);
            std::array::from_fn(|k| row[k * self.stride + REACH + i % self.width])
        })
    }

    fn row(&self, y: usize) -> &[f32] {
        &self.data[y * PLANES * self.stride..][..PLANES * self.stride]
    }
}

/// Standard deviation in rad of a pixel after at least one round.
pub(super) fn sigma(pixel: &[f32; TRACKED]) -> f32 {
    (pixel[8] * pixel[9] / area(pixel[5], pixel[6], pixel[7])).sqrt()
}

/// Area in px² whose even mean has as little noise as a Gaussian of this covariance.
fn area(xx: f32, xy: f32, yy: f32) -> f32 {
    let (xx, yy) = (xx.max(0.0) + PIXEL, yy.max(0.0) + PIXEL);
    4.0 * PI * (xx * yy - xy * xy).max(PIXEL * PIXEL).sqrt()
}

/// The weights.
pub(super) struct Filter {
    /// (down, right, weight) over distance, within a circle.
    taps: Vec<(usize, usize, f32)>,
    /// Variance over orientations of the median pixel, in rad², and its limits.
    angle: f32,
    limits: [f32; 2],
}

impl Filter {
    /// `space` in px; `angle` in rad for the median pixel, where it lies within the limits, and in proportion to σ for others.
    pub(super) fn new(space: f32, angle: f32, limits: [f32; 2]) -> Self {
        let reach = REACH as i32;
        let places = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (y, x)));
        let inside = places.filter(|(y, x)| x * x + y * y <= reach * reach);
        let weight = |(y, x): (i32, i32)| (-((x * x + y * y) as f32) / (2.0 * space * space)).exp();
        let taps = inside.map(|(y, x)| ((y + reach) as usize, (x + reach) as usize, weight((y, x)))).collect();
        Self { taps, angle: angle * angle, limits: limits.map(|l| l * l) }
    }

    /// 1/8σ² of the weight over orientations for a pixel of this reliability, where they slope by so much, in rad² per px². On a
    /// slope the window must reach as far as elsewhere, or the slope turns into stairs.
    #[inline(always)]
    fn steepness(&self, reliability: f32, slope: f32) -> f32 {
        const WINDOW: f32 = (REACH * REACH) as f32;
        let variance = self.angle / reliability + WINDOW * slope;
        let [low, high] = self.limits;
        let variance = if variance < high { variance } else { high };
        0.125 / if variance > low { variance } else { low }
    }

    /// One round. `first` is given in the first one: how much larger the variance per area is than the pixels' own variances
    /// say.
    pub(super) fn apply<const PLANES: usize>(
        &self,
        from: &Field<PLANES>,
        to: &mut Field<PLANES>,
        first: Option<f32>,
        progress: &dyn Progress,
    ) {
        let (stride, columns) = (from.stride, from.width.div_ceil(LANES));
        let rows = to.data.par_chunks_mut(PLANES * stride).skip(REACH).take(from.height);
        rows.enumerate().for_each(|(y, row)| {
            if progress.cancelled() {
                return;
            }
            for x in (0..columns).map(|column| column * LANES) {
                // The corner of the window; its middle is REACH farther in both directions.
                let window = Window { from, y, x };
                match first {
                    Some(correlated) => self.mean::<PLANES, true>(&window, correlated, row),
                    None => self.mean::<PLANES, false>(&window, 1.0, row),
                }
            }
        });
    }

    fn mean<const PLANES: usize, const FIRST: bool>(&self, window: &Window<PLANES>, correlated: f32, row: &mut [f32]) {
        let stride = window.from.stride;
        let here = window.at(REACH, REACH);
        if *here[2] == [0.0; LANES] {
            return;
        }
        let [c, s] = window.median();
        let (slope, mut steep) = (window.slope(), [0.0; LANES]);
        for i in 0..LANES {
            steep[i] = self.steepness(here[2][i], slope[i]);
        }
        let pivot = [c, s, steep];
        let mut sums = [[0.0_f32; LANES]; PLANES];
        for &(dy, dx, space) in &self.taps {
            let pixel = window.at(dy, dx);
            let weight = weights(&pivot, space, [pixel[0], pixel[1], pixel[2]]);
            add(&mut sums[0], &weight, pixel[0]);
            add(&mut sums[1], &weight, pixel[1]);
            sums[2].iter_mut().zip(&weight).for_each(|(sum, w)| *sum += w);
            if PLANES == TRACKED {
                let offset = [dx as f32 - REACH as f32, dy as f32 - REACH as f32];
                track::<PLANES, FIRST>(&mut sums, &weight, offset, &pixel);
                follow(&mut sums[10], &pivot, space, [pixel[0], pixel[1], pixel[2]]);
            }
        }
        for i in 0..LANES {
            let before = std::array::from_fn(|k| here[k][i]);
            let mean = finish::<PLANES, FIRST>(std::array::from_fn(|k| sums[k][i]), before, correlated);
            // Where nothing agrees with the median, the pixel stays.
            let known = here[2][i] > 0.0 && mean[0].is_finite() && mean[1].is_finite();
            for k in 0..PLANES {
                row[k * stride + REACH + window.x + i] = if k == 2 || !known { here[k][i] } else { mean[k] };
            }
        }
    }
}

/// Weights of pixels (cos 2θ, sin 2θ, reliability) about a pivot. That over the difference Δ of two orientations is
/// `(1 - (1 - cos 2Δ) / 8σ²)²`, Tukey's biweight: as bent at 0 as the Gaussian `exp(-Δ²/2σ²)`, but nothing at all from 2.2 σ on,
/// where the Gaussian's 9 % leak over edges round by round (Black et al., Robust anisotropic diffusion, 1998).
#[inline(always)]
fn weights([pc, ps, steep]: &[Lane; 3], space: f32, [c, s, reliability]: [&Lane; 3]) -> Lane {
    let mut weight = [0.0; LANES];
    for i in 0..LANES {
        let cos = c[i] * pc[i] + s[i] * ps[i];
        let root = 1.0 - steep[i] * (1.0 - cos);
        let root = if root > 0.0 { root } else { 0.0 };
        weight[i] = root * root * (space * reliability[i]);
    }
    weight
}

/// Adds a plane times its weights.
#[inline(always)]
fn add(sum: &mut Lane, weight: &Lane, plane: &Lane) {
    for i in 0..LANES {
        sum[i] += weight[i] * plane[i];
    }
}

/// Adds what σ follows from; `offset` is where the pixels lie, in px right and down.
#[inline(always)]
fn track<const PLANES: usize, const FIRST: bool>(
    sums: &mut [Lane; PLANES],
    weight: &Lane,
    offset: [f32; 2],
    pixel: &[&Lane; PLANES],
) {
    for i in 0..LANES {
        let (w, x, y) = (weight[i], offset[0] + pixel[3][i], offset[1] + pixel[4][i]);
        sums[3][i] += w * x;
        sums[4][i] += w * y;
        sums[5][i] += w * (x * x + pixel[5][i]);
        sums[6][i] += w * (x * y + pixel[6][i]);
        sums[7][i] += w * (y * y + pixel[7][i]);
        sums[8][i] += if FIRST { w * w } else { w } * pixel[8][i];
        sums[9][i] += w * pixel[9][i];
    }
}

/// Adds how much the mean follows its pivot: `Σ -w'(Δ)·Δ`, which is Σw where orientations slope so much that the pivot alone
/// decides which of them count.
#[inline(always)]
fn follow(sum: &mut Lane, [pc, ps, steep]: &[Lane; 3], space: f32, [c, s, reliability]: [&Lane; 3]) {
    for i in 0..LANES {
        let cos = c[i] * pc[i] + s[i] * ps[i];
        let root = 1.0 - steep[i] * (1.0 - cos);
        let root = if root > 0.0 { root } else { 0.0 };
        sum[i] += 2.0 * steep[i] * root * (1.0 - cos * cos) * (space * reliability[i]);
    }
}

/// From sums to a pixel, which was `before`.
#[inline(always)]
fn finish<const PLANES: usize, const FIRST: bool>(
    sums: [f32; PLANES],
    before: [f32; PLANES],
    correlated: f32,
) -> [f32; PLANES] {
    let [c, s, total] = [sums[0], sums[1], sums[2]];
    let length = (c * c + s * s).sqrt();
    let mut pixel = sums.map(|sum| sum / total);
    (pixel[0], pixel[1]) = (c / length, s / length);
    if PLANES == TRACKED {
        let (x, y) = (pixel[3], pixel[4]);
        pixel[5] -= x * x;
        pixel[6] -= x * y;
        pixel[7] -= y * y;
        if FIRST {
            let density = correlated * pixel[8] / total * area(pixel[5], pixel[6], pixel[7]);
            let measure = total * pixel[9];
            (pixel[8], pixel[9]) = (measure * density, 1.0 / measure);
        }
        mix_pivot(&mut pixel, &before, if FIRST { MEDIAN_NOISE } else { 1.0 });
    }
    pixel
}

/// Mixes the noise of the pivot into what σ follows from. Of two Gaussian kernels of covariance S and T the product integrates to
/// one over the area of (S + T)/2, so the area of the mixture is known; its covariance is scaled to that.
fn mix_pivot<const PLANES: usize>(pixel: &mut [f32; PLANES], before: &[f32; PLANES], noise: f32) {
    let share = pixel[10].clamp(0.0, 1.0);
    let wide = [pixel[5], pixel[6], pixel[7]];
    // The variance of a place within 3×3 pixels is 2/3.
    let narrow = [before[5] + 2.0 / 3.0, before[6], before[7] + 2.0 / 3.0];
    let middle: [f32; 3] = std::array::from_fn(|k| 0.5 * (wide[k] + narrow[k]));
    let of = |[xx, xy, yy]: [f32; 3]| 1.0 / area(xx, xy, yy);
    let rest = 1.0 - share;
    let squares = rest * rest * of(wide) + share * share * noise * of(narrow) + 2.0 * share * rest * of(middle);
    let mixed: [f32; 3] = std::array::from_fn(|k| rest * wide[k] + share * narrow[k]);
    let [xx, xy, yy] = [mixed[0] + PIXEL, mixed[1], mixed[2] + PIXEL];
    let scale = 1.0 / (squares * area(mixed[0], mixed[1], mixed[2]));
    (pixel[5], pixel[6], pixel[7]) = (xx * scale - PIXEL, xy * scale, yy * scale - PIXEL);
    (pixel[3], pixel[4]) = (rest * pixel[3] + share * before[3], rest * pixel[4] + share * before[4]);
}

/// Where `LANES` neighbouring pixels look.
struct Window<'a, const PLANES: usize> {
    from: &'a Field<PLANES>,
    y: usize,
    x: usize,
}

impl<const PLANES: usize> Window<'_, PLANES> {
    /// The pixels so far below and right of the window's corner.
    #[inline(always)]
    fn at(&self, dy: usize, dx: usize) -> [&Lane; PLANES] {
        const NONE: Lane = [0.0; LANES];
        let row = self.from.row(self.y + dy);
        std::array::from_fn(|k| row[k * self.from.stride + self.x + dx..].first_chunk().unwrap_or(&NONE))
    }

    /// Slope of the orientations in rad² per px².
    #[inline(always)]
    fn slope(&self) -> Lane {
        let values = |dy: usize, dx: usize| {
            let pixel = self.at(dy, dx);
            [pixel[0], pixel[1], pixel[2]]
        };
        let here = values(REACH, REACH);
        let across = flatter(&here, &values(REACH, REACH - BASE), &values(REACH, REACH + BASE));
        let down = flatter(&here, &values(REACH - BASE, REACH), &values(REACH + BASE, REACH));
        // sin 2Δ ≈ 2Δ.
        std::array::from_fn(|i| (across[i] + down[i]) / (4 * BASE * BASE) as f32)
    }

    /// Median of cos 2θ and of sin 2θ over 3×3 pixels, scaled to length 1. For a masked pixel stands the one opposite, or else
    /// the middle.
    #[inline(always)]
    fn median(&self) -> [Lane; 2] {
        let around: [[&Lane; PLANES]; 9] = std::array::from_fn(|k| self.at(REACH - 1 + k / 3, REACH - 1 + k % 3));
        let mut median = [0, 1].map(|plane| {
            let mut values: [Lane; 9] = std::array::from_fn(|k| {
                std::array::from_fn(|i| {
                    let opposite =
                        if around[8 - k][2][i] > 0.0 { around[8 - k][plane][i] } else { around[4][plane][i] };
                    if around[k][2][i] > 0.0 { around[k][plane][i] } else { opposite }
                })
            });
            for (a, b) in MEDIAN_OF_9 {
                for i in 0..LANES {
                    let (p, q) = (values[a][i], values[b][i]);
                    (values[a][i], values[b][i]) = (if p < q { p } else { q }, if p < q { q } else { p });
                }
            }
            values[4]
        });
        for i in 0..LANES {
            let [c, s] = [median[0][i], median[1][i]];
            let length = (c * c + s * s).sqrt().max(f32::MIN_POSITIVE);
            (median[0][i], median[1][i]) = (c / length, s / length);
        }
        median
    }
}

/// The slope between pixels `before` and `after` their middle, in sin 2Δ over both their distances, squared: that of the flatter
/// side, and none at a ridge, so that an edge has none either. A masked side does not count.
#[inline(always)]
fn flatter(here: &[&Lane; 3], before: &[&Lane; 3], after: &[&Lane; 3]) -> Lane {
    let mut square = [0.0; LANES];
    for i in 0..LANES {
        let sine = |p: &[&Lane; 3], q: &[&Lane; 3]| q[1][i] * p[0][i] - q[0][i] * p[1][i];
        let (left, right) = (sine(before, here), sine(here, after));
        let left = if before[2][i] > 0.0 { left } else { right };
        let right = if after[2][i] > 0.0 { right } else { left };
        let product = left * right;
        let (l, r) = (left * left, right * right);
        square[i] = if product > 0.0 { if l < r { l } else { r } } else { 0.0 };
    }
    square
}

/// Exchanges after which the middle of nine values is their median (Paeth, Graphics Gems, 1990).
const MEDIAN_OF_9: [(usize, usize); 19] = [
    (1, 2),
    (4, 5),
    (7, 8),
    (0, 1),
    (3, 4),
    (6, 7),
    (1, 2),
    (4, 5),
    (7, 8),
    (0, 3),
    (5, 8),
    (4, 7),
    (3, 6),
    (1, 4),
    (2, 5),
    (4, 7),
    (4, 2),
    (6, 4),
    (4, 2),
];

//! One iteration of the filter: plain loops over short arrays, which the compiler vectorises.

mod window;

use crate::OrientationMaps;
use nacre_base::progress::Progress;
use rayon::prelude::*;
use std::f32::consts::PI;
use window::Window;

/// Pixels processed together.
const LANES: usize = 64;
/// Radius of the window in pixels, twice the σ of the spatial weight.
const REACH: usize = 6;
/// Distance in pixels for gradients.
const BASE: usize = 3;
/// Squared difference over `BASE` pixels, in variances of a pixel's noise, from which a gradient is significant: in the
/// first iteration, and in later ones, where little noise remains.
const CERTAIN: f32 = 20.0;
const CERTAIN_LATER: f32 = 2.0;
/// Largest ratio of the squares of two consecutive steps that counts as a gradient.
const ALIKE: f32 = 4.0;
/// Ratio of the variance of the median of nine independent values to that of their mean.
const MEDIAN_NOISE: f32 = 1.5;
/// Variance of a uniform distribution over a pixel's side, in px².
const PIXEL: f32 = 1.0 / 12.0;

/// Number of planes of a field without and with the quantities for σ.
///
/// Planes 0 and 1: cos 2θ and sin 2θ. Plane 2: reliability, 0 where masked. Planes 3 and 4: mean position of the
/// averaged pixels relative to the pixel, in px right and down. Planes 5 to 7: its covariance xx, xy, yy in px². Planes
/// 8 and 9: before the first iteration variance in rad² and reliability, then means of M·D and of 1/M (see [`super`]).
/// Plane 10: weight of the pivot's noise in the pixel.
pub(super) const VALUES: usize = 3;
pub(super) const TRACKED: usize = 11;

type Lane = [f32; LANES];

/// Planes of an image, row by row in sequence, inside a frame of masked pixels.
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

    /// An empty field of the same size.
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

/// Standard deviation in rad of a pixel after at least one iteration.
pub(super) fn sigma(pixel: &[f32; TRACKED]) -> f32 {
    (pixel[8] * pixel[9] / area(pixel[5], pixel[6], pixel[7])).sqrt()
}

/// Area in px² whose uniform mean has the same noise as a Gaussian of this covariance.
fn area(xx: f32, xy: f32, yy: f32) -> f32 {
    let (xx, yy) = (xx.max(0.0) + PIXEL, yy.max(0.0) + PIXEL);
    4.0 * PI * (xx * yy - xy * xy).max(PIXEL * PIXEL).sqrt()
}

/// Parameters of the weights.
pub(super) struct Filter {
    /// (down, right, squared distance) within the window.
    taps: Vec<(usize, usize, f32)>,
    /// Variance of the median pixel in rad².
    noise: f32,
    /// Ratio of the variance of the orientation weight to that of the noise, and its limits in rad².
    wider: f32,
    limits: [f32; 2],
    /// Total number of iterations.
    rounds: f32,
}

/// Iteration number: the first one uses the pixels' own σ, later ones see less noise.
#[derive(Clone, Copy)]
pub(super) struct Round {
    /// Counted from 0.
    pub number: u32,
    /// Ratio of the variance per area to that expected from the pixels' own variances.
    pub correlated: f32,
}

impl Filter {
    /// Filter for a map whose median pixel has `sigma` rad; the orientation weight is `times` as wide as a pixel's σ,
    /// within limits in rad.
    pub(super) fn new(sigma: f32, times: f32, limits: [f32; 2], rounds: u32) -> Self {
        let reach = REACH as i32;
        let places = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| (y, x)));
        let inside = places.filter(|(y, x)| x * x + y * y < reach * reach);
        let tap = |(y, x): (i32, i32)| ((y + reach) as usize, (x + reach) as usize, (x * x + y * y) as f32);
        let noise = sigma * sigma;
        let limits = limits.map(|l| l * l);
        Self { taps: inside.map(tap).collect(), noise, wider: times * times, limits, rounds: rounds as f32 }
    }

    /// 1/8σ² of the orientation weight and 1/4σ² of the spatial weight, for the pixels of a window.
    ///
    /// At orientation gradients the window shrinks until the change over the reach of all iterations stays below the
    /// noise. A wider mean would be biased at borders and where the gradient changes.
    #[inline(always)]
    fn widths<const PLANES: usize>(&self, window: &Window<PLANES>, round: Round) -> [Lane; 2] {
        const WIDEST: f32 = 1.0 / (REACH * REACH) as f32;
        let reliability = window.at(REACH, REACH)[2];
        let [across, down] = window.slopes();
        let certain = if round.number == 0 { CERTAIN } else { CERTAIN_LATER };
        let [low, high] = self.limits;
        let mut widths = [[0.0; LANES]; 2];
        for i in 0..LANES {
            let noise = self.noise / if reliability[i] > 0.0 { reliability[i] } else { 1.0 };
            let variance = self.wider * noise;
            let variance = if variance < high { variance } else { high };
            widths[0][i] = 0.125 / if variance > low { variance } else { low };
            // sin 2Δ ≈ 2Δ.
            let least = 4.0 * certain * noise;
            let across = if across[i] > least { across[i] } else { 0.0 };
            let down = if down[i] > least { down[i] } else { 0.0 };
            let slope = (across + down) / (4 * BASE * BASE) as f32;
            let narrow = 0.25 * self.rounds * slope / noise;
            widths[1][i] = if narrow > WIDEST { narrow } else { WIDEST };
        }
        widths
    }

    /// Applies one iteration.
    pub(super) fn apply<const PLANES: usize>(
        &self,
        from: &Field<PLANES>,
        to: &mut Field<PLANES>,
        round: Round,
        progress: &dyn Progress,
    ) {
        let (stride, columns) = (from.stride, from.width.div_ceil(LANES));
        let rows = to.data.par_chunks_mut(PLANES * stride).skip(REACH).take(from.height);
        rows.enumerate().for_each(|(y, row)| {
            if progress.cancelled() {
                return;
            }
            for x in (0..columns).map(|column| column * LANES) {
                // The corner of the window; its centre is REACH farther in both directions.
                let window = Window { from, y, x };
                if round.number == 0 {
                    self.mean::<PLANES, true>(&window, round, row);
                } else {
                    self.mean::<PLANES, false>(&window, round, row);
                }
            }
        });
    }

    fn mean<const PLANES: usize, const FIRST: bool>(&self, window: &Window<PLANES>, round: Round, row: &mut [f32]) {
        let stride = window.from.stride;
        let here = window.at(REACH, REACH);
        if *here[2] == [0.0; LANES] {
            return;
        }
        let [c, s] = window.median();
        let [steep, narrow] = self.widths(window, round);
        let pivot = Pivot { c, s, steep, narrow };
        let mut sums = [[0.0_f32; LANES]; PLANES];
        for &(dy, dx, square) in &self.taps {
            let pixel = window.at(dy, dx);
            let weight = weights(&pivot, square, [pixel[0], pixel[1], pixel[2]]);
            add(&mut sums[0], &weight, pixel[0]);
            add(&mut sums[1], &weight, pixel[1]);
            sums[2].iter_mut().zip(&weight).for_each(|(sum, w)| *sum += w);
            if PLANES == TRACKED {
                let offset = [dx as f32 - REACH as f32, dy as f32 - REACH as f32];
                track::<PLANES, FIRST>(&mut sums, &weight, offset, &pixel);
                follow(&mut sums[10], &pivot, square, [pixel[0], pixel[1], pixel[2]]);
            }
        }
        for i in 0..LANES {
            let before: [f32; PLANES] = std::array::from_fn(|k| here[k][i]);
            let sum: [f32; PLANES] = std::array::from_fn(|k| sums[k][i]);
            let mean = if sum[2] > 0.0 {
                finish::<PLANES, FIRST>(sum, before, round.correlated)
            } else {
                replaced::<PLANES, FIRST>(before, [pivot.c[i], pivot.s[i]])
            };
            let known = here[2][i] > 0.0 && mean[0].is_finite() && mean[1].is_finite();
            for k in 0..PLANES {
                row[k * stride + REACH + window.x + i] = if k == 2 || !known { here[k][i] } else { mean[k] };
            }
        }
    }
}

/// Reference orientation and widths for the weights of a window.
struct Pivot {
    c: Lane,
    s: Lane,
    /// 1/8σ² of the orientation weight.
    steep: Lane,
    /// 1/4σ² of the spatial weight.
    narrow: Lane,
}

impl Pivot {
    /// Square roots of the spatial and the orientation weight, and cos 2Δ, for pixel `i` of the lane.
    #[inline(always)]
    fn roots(&self, i: usize, square: f32, c: f32, s: f32) -> [f32; 3] {
        let cos = c * self.c[i] + s * self.s[i];
        let (near, alike) = (1.0 - square * self.narrow[i], 1.0 - self.steep[i] * (1.0 - cos));
        [if near > 0.0 { near } else { 0.0 }, if alike > 0.0 { alike } else { 0.0 }, cos]
    }
}

/// Weights of pixels (cos 2θ, sin 2θ, reliability) at this squared distance.
///
/// The spatial weight `(1 - d²/4σ²)²` and the orientation weight `(1 - (1 - cos 2Δ)/8σ²)²` are Tukey's biweight. Its
/// curvature at 0 equals the Gaussian's, but it vanishes beyond about 2 σ. The Gaussian's 14 % there leak over edges in
/// every iteration (Black et al., Robust anisotropic diffusion, 1998).
#[inline(always)]
fn weights(pivot: &Pivot, square: f32, [c, s, reliability]: [&Lane; 3]) -> Lane {
    let mut weight = [0.0; LANES];
    for i in 0..LANES {
        let [near, alike, _] = pivot.roots(i, square, c[i], s[i]);
        let root = near * alike;
        weight[i] = root * root * reliability[i];
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

/// Adds the quantities for σ; `offset` is the position of the pixels, in px right and down.
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

/// Adds the dependence of the mean on its pivot: `Σ -w'(Δ)·Δ`, which equals Σw at gradients so steep that the pivot
/// alone decides which pixels count.
#[inline(always)]
fn follow(sum: &mut Lane, pivot: &Pivot, square: f32, [c, s, reliability]: [&Lane; 3]) {
    for i in 0..LANES {
        let [near, alike, cos] = pivot.roots(i, square, c[i], s[i]);
        sum[i] += 2.0 * pivot.steep[i] * near * near * alike * (1.0 - cos * cos) * reliability[i];
    }
}

/// A pixel that agrees with no neighbour takes the median's orientation; its quantities for σ are kept.
#[inline(always)]
fn replaced<const PLANES: usize, const FIRST: bool>(before: [f32; PLANES], [c, s]: [f32; 2]) -> [f32; PLANES] {
    let mut pixel = before;
    (pixel[0], pixel[1]) = (c, s);
    if PLANES == TRACKED && FIRST {
        pixel[8] *= before[9] * area(0.0, 0.0, 0.0);
        pixel[9] = 1.0 / before[9];
    }
    pixel
}

/// Converts sums to a pixel, which was `before`.
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

/// Adds the noise of the pivot to the quantities for σ. The product of two Gaussian kernels of covariance S and T
/// integrates to one over the area of (S + T)/2. The area of the mixture is thus known, and its covariance is scaled
/// accordingly.
fn mix_pivot<const PLANES: usize>(pixel: &mut [f32; PLANES], before: &[f32; PLANES], noise: f32) {
    let share = pixel[10].clamp(0.0, 1.0);
    let wide = [pixel[5], pixel[6], pixel[7]];
    // The variance of a position within 3×3 pixels is 2/3.
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

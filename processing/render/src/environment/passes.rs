//! Two-pass reflection of an environment by a low-rank table.

use super::factor::{Part, Term};
use super::{Environment, Frame};
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use pulp::Arch;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};

/// Columns of a block, small enough that the intermediate pictures stay in the cache.
const BLOCK: usize = 128;

/// Reflection of an environment by surfaces that face each direction of a sphere, with the table's `grid.meridian`
/// towards +z.
///
/// The first pass computes an intermediate picture per term and channel: at each direction, the light along the great
/// circle across the meridian, weighted by the term's curve. The second pass sums them along the meridian, weighted by
/// the other curve. Beyond a pole east and west are exchanged, so the mirrored curve applies there.
///
/// # Errors
/// `Input` for an environment with an odd number of columns, which has no opposite column across the pole; `Cancelled`.
pub fn two_pass(environment: &Environment, part: &Part, progress: &dyn Progress) -> Result<Vec<[f32; 3]>> {
    let (width, height) = (environment.width, environment.height);
    if !width.is_multiple_of(2) {
        let problem = format!("is {width} pixels wide");
        return Err(Error::input("environment", problem, "give an even number"));
    }
    let mut out = vec![[0.0; 3]; width * height];
    for c in 0..3 {
        let terms = &part.channels[c];
        let plane = Plane::new(environment, c);
        let [dx, dy] = part.grid.cell();
        let curves: Vec<Curve> = terms.iter().map(|t| Curve::new(t, dx)).collect();
        let weights: Vec<Vec<(isize, f32)>> = terms.iter().map(|t| steps(t, part, dy, height)).collect();
        let pictures = curves.iter().map(|c| c.pictures).sum::<usize>();
        progress.check()?;
        let mut between = vec![0.0_f32; height * pictures * width];
        between.par_chunks_mut(pictures.max(1) * width).enumerate().for_each(|(y, rows)| {
            let taps = taps(part, width, height, y);
            Arch::new().dispatch(
                #[inline(always)]
                || plane.across(&taps, &curves, rows),
            );
        });
        progress.check()?;
        out.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
            let mut sum = vec![0.0_f32; width];
            let between = Between { values: &between, pictures, width, height };
            Arch::new().dispatch(
                #[inline(always)]
                || between.along(y as isize, &curves, &weights, &mut sum),
            );
            row.iter_mut().zip(&sum).for_each(|(pixel, v)| pixel[c] = *v);
        });
        progress.step();
    }
    Ok(out)
}

/// One channel of an environment; each row is stored twice, so that every shift is contiguous.
struct Plane {
    width: usize,
    values: Vec<f32>,
}

/// Two neighbouring rows, each from a start column, with their weights.
struct Tap {
    columns: [usize; 2],
    rows: [usize; 2],
    /// Weights of the two columns in the two rows.
    weights: [f32; 4],
}

/// A curve across the meridian, times the cell width.
struct Curve {
    values: Vec<f32>,
    /// Index of the first intermediate picture, and their number: a curve that is neither even nor odd needs a second
    /// one beyond a pole.
    pictures: usize,
    /// Factor of the mirrored curve's picture, if it is proportional.
    parity: f32,
}

impl Curve {
    fn new(term: &Term, dx: f64) -> Self {
        let n = term.across.len();
        let most = term.across.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
        let off = |sign: f32| (0..n).all(|i| (term.across[i] - sign * term.across[n - 1 - i]).abs() <= 1e-5 * most);
        let parity = if off(1.0) { 1.0 } else { -1.0 };
        let pictures = if off(parity) { 1 } else { 2 };
        Self { values: term.across.iter().map(|v| v * dx as f32).collect(), pictures, parity }
    }
}

/// Source pixels of each grid column, for a row of the environment.
fn taps(part: &Part, width: usize, height: usize, y: usize) -> Vec<Tap> {
    let polar = PI * (y as f64 + 0.5) / height as f64;
    let tap = |i: usize| {
        let x = part.grid.x(i);
        let across = (1.0 - x * x).sqrt();
        let (sin, cos) = (polar - part.grid.lean(x)).sin_cos();
        let azimuth = x.atan2(across * sin);
        let row = x.hypot(across * sin).atan2(across * cos) / PI * height as f64 - 0.5;
        // Azimuth increases to the left.
        let column = (-azimuth / TAU * width as f64).rem_euclid(width as f64);
        let (left, top) = (column.floor(), row.floor());
        let (u, v) = ((column - left) as f32, (row - top) as f32);
        let (left, top, last) = (left as usize % width, top as isize, height as isize - 1);
        // Beyond a pole, rows continue on the opposite side.
        let place = |row: isize| match row {
            r if r < 0 => ((left + width / 2) % width, 0),
            r if r > last => ((left + width / 2) % width, last as usize),
            r => (left, r as usize),
        };
        let [(a, above), (b, below)] = [place(top), place(top + 1)];
        let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
        Tap { columns: [a, b], rows: [above, below], weights }
    };
    (0..part.grid.size[0]).map(tap).collect()
}

impl Plane {
    fn new(environment: &Environment, channel: usize) -> Self {
        let width = environment.width;
        let mut values = Vec::with_capacity(environment.height * (2 * width + 1));
        for row in environment.rgb.chunks(width) {
            values.extend(row.iter().chain(row).chain(&row[..1]).map(|p| p[channel]));
        }
        Self { width, values }
    }

    /// Computes one row of all intermediate pictures.
    #[inline(always)]
    fn across(&self, taps: &[Tap], curves: &[Curve], rows: &mut [f32]) {
        let width = self.width;
        let stride = 2 * width + 1;
        let n = taps.len();
        let mut light = [0.0_f32; BLOCK];
        for begin in (0..width).step_by(BLOCK) {
            let count = BLOCK.min(width - begin);
            for (i, tap) in taps.iter().enumerate() {
                let at = |k: usize| &self.values[tap.rows[k] * stride + tap.columns[k] + begin..][..count + 1];
                let (above, below) = (at(0), at(1));
                let [a, b, c, d] = tap.weights;
                for (k, out) in light[..count].iter_mut().enumerate() {
                    *out = a * above[k] + b * above[k + 1] + c * below[k] + d * below[k + 1];
                }
                let mut picture = 0;
                for curve in curves {
                    for weight in [curve.values[i], curve.values[n - 1 - i]].into_iter().take(curve.pictures) {
                        let row = &mut rows[picture * width + begin..][..count];
                        row.iter_mut().zip(&light[..count]).for_each(|(out, l)| *out += weight * l);
                        picture += 1;
                    }
                }
            }
        }
    }
}

/// Weights of whole rows northwards; light between two rows is divided among them.
fn steps(term: &Term, part: &Part, dy: f64, height: usize) -> Vec<(isize, f32)> {
    let place = |j: usize| part.grid.beta(j) / PI * height as f64;
    let least = place(0).floor() as isize;
    let count = (place(term.along.len() - 1).floor() as isize - least + 2) as usize;
    let mut weights = vec![0.0_f64; count];
    for (j, v) in term.along.iter().enumerate() {
        let at = place(j);
        let (k, part) = ((at.floor() as isize - least) as usize, at - at.floor());
        weights[k] += (1.0 - part) * f64::from(*v) * dy;
        weights[k + 1] += part * f64::from(*v) * dy;
    }
    let all = weights.into_iter().enumerate().map(|(k, w)| (least + k as isize, w as f32));
    all.filter(|(_, w)| *w != 0.0).collect()
}

/// Intermediate pictures: rows, and in each row all pictures.
struct Between<'a> {
    values: &'a [f32],
    pictures: usize,
    width: usize,
    height: usize,
}

impl Between<'_> {
    /// Computes one row of the result.
    #[inline(always)]
    fn along(&self, y: isize, curves: &[Curve], weights: &[Vec<(isize, f32)>], sum: &mut [f32]) {
        let (height, half) = (self.height as isize, self.width / 2);
        let mut picture = 0;
        for (curve, weights) in curves.iter().zip(weights) {
            for (step, weight) in weights {
                let to = y - step;
                let beyond = to < 0 || to >= height;
                let row = if to < 0 {
                    -1 - to
                } else if beyond {
                    2 * height - 1 - to
                } else {
                    to
                };
                let mirrored = beyond && curve.pictures == 2;
                let at = (row as usize * self.pictures + picture + usize::from(mirrored)) * self.width;
                let row = &self.values[at..][..self.width];
                if beyond {
                    let weight = if mirrored { *weight } else { weight * curve.parity };
                    let (left, right) = sum.split_at_mut(half);
                    left.iter_mut().zip(&row[half..]).for_each(|(s, v)| *s += weight * v);
                    right.iter_mut().zip(&row[..half]).for_each(|(s, v)| *s += weight * v);
                } else {
                    sum.iter_mut().zip(row).for_each(|(s, v)| *s += weight * v);
                }
            }
            picture += curve.pictures;
        }
    }
}

/// The environment in another frame: +z becomes the frame's bitangent, and the normal lies at the centre of the
/// picture. This is the first of the paper's rotation passes (2017 CVMP, section 5.2); [`turned_back`] is the second.
///
/// # Errors
/// As [`Environment::of`].
pub fn turned_to(environment: &Environment, frame: &Frame) -> Result<Environment> {
    let world = |[x, y, z]: [f64; 3]| frame.world([y, z, x]);
    Environment::of(environment.width, environment.height, resampled(environment, world))
}

/// Inverse of [`turned_to`].
///
/// # Errors
/// As [`Environment::of`].
pub fn turned_back(environment: &Environment, frame: &Frame) -> Result<Environment> {
    let map = |direction: [f64; 3]| {
        let [x, y, z] = frame.local(direction);
        [z, x, y]
    };
    Environment::of(environment.width, environment.height, resampled(environment, map))
}

fn resampled(environment: &Environment, from: impl Fn([f64; 3]) -> [f64; 3] + Sync) -> Vec<[f32; 3]> {
    let width = environment.width;
    let pixel = |i: usize| {
        let direction = environment.direction((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        environment.radiance(from(direction))
    };
    (0..environment.rgb.len()).into_par_iter().map(pixel).collect()
}

/// Clamps negative radiance to 0.
///
/// Returns the largest magnitude of negative radiance, relative to the maximum.
pub fn clamped(rgb: &mut [[f32; 3]]) -> f64 {
    let values = rgb.as_flattened_mut();
    let (low, high) = values.iter().fold((0.0_f32, 0.0_f32), |(l, h), v| (l.min(*v), h.max(*v)));
    values.iter_mut().for_each(|v| *v = v.max(0.0));
    if high > 0.0 { f64::from(-low / high) } else { 0.0 }
}

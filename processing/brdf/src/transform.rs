//! Fourier transforms of a patch, limited to low frequencies: orders beyond 2/λ are evanescent.
//!
//! Memory access dominates the cost. Data move in blocks of whole cache lines. The kept part of one set of rows stays
//! in the cache until its columns are done, and of real functions only one half is written.

use nacre_fourier::Fft;
use num_complex::Complex;
use pulp::Arch;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Number of columns, and rows, per block: a cache line.
const TOGETHER: usize = 8;

/// Number of pairs of functions whose rows are transformed before their columns.
pub(super) const AT_ONCE: usize = 2;

/// f32 or f64.
pub(super) trait Real: nacre_fourier::Real {
    fn of(value: f64) -> Self;
    fn double(self) -> f64;
}

impl Real for f32 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value as f32
    }
    #[inline(always)]
    fn double(self) -> f64 {
        f64::from(self)
    }
}

impl Real for f64 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn double(self) -> f64 {
        self
    }
}

fn zeros<T: Real>(count: usize) -> Vec<Complex<T>> {
    vec![Complex::new(T::zero(), T::zero()); count]
}

/// Kept part of a function's transform, `1/N Σ z exp(-2πi (fx x + fy y))` for the frequencies `fx = ix/width`,
/// `fy = iy/height` (y up).
///
/// `|ix|` and `|iy|` are within the plan's reach and its ellipse.
pub(super) struct Plane<T> {
    /// First column: 0 for real functions, whose other columns are conjugates, else `-reach`.
    first: isize,
    /// Factor between the value at the opposite frequency and the conjugate: 1 or -1 for a real or imaginary factor of
    /// a real function.
    sign: T,
    /// Groups of columns. Within a group, rows follow each other from the highest frequency. The last group may end
    /// with columns of zeros.
    groups: Vec<Vec<Complex<T>>>,
}

impl<T: Real> Plane<T> {
    /// Transform of a constant function.
    pub(super) fn constant(value: T) -> Self {
        let mut row = zeros(TOGETHER);
        row[0] = Complex::new(value, T::zero());
        Self { first: 0, sign: T::one(), groups: vec![row] }
    }

    /// Value at a frequency in cycles per patch; 0 outside of the kept part.
    pub(super) fn at(&self, [ix, iy]: [isize; 2]) -> Complex<T> {
        if ix < self.first {
            return if self.first == 0 {
                self.at([-ix, -iy]).conj() * self.sign
            } else {
                Complex::new(T::zero(), T::zero())
            };
        }
        let column = (ix - self.first) as usize;
        let group = self.groups.get(column / TOGETHER).map_or(&[][..], |g| g);
        let high = (group.len() / (2 * TOGETHER)) as isize;
        let row = usize::try_from(high - iy).unwrap_or(usize::MAX / (2 * TOGETHER));
        group.get(row * TOGETHER + column % TOGETHER).copied().unwrap_or(Complex::new(T::zero(), T::zero()))
    }

    /// Values of a row of frequencies, from the lowest to the highest.
    pub(super) fn row(&self, iy: isize, out: &mut [Complex<T>]) {
        out.fill(Complex::new(T::zero(), T::zero()));
        let middle = out.len() / 2;
        for (g, group) in self.groups.iter().enumerate() {
            let high = (group.len() / (2 * TOGETHER)) as isize;
            if iy.abs() > high {
                continue;
            }
            let row = |iy: isize| &group[(high - iy) as usize * TOGETHER..][..TOGETHER];
            let left = middle.saturating_add_signed(self.first) + g * TOGETHER;
            out.iter_mut().skip(left).zip(row(iy)).for_each(|(to, from)| *to = *from);
            if self.first == 0 {
                let mirrored = out[..middle].iter_mut().rev().skip((g * TOGETHER).saturating_sub(1));
                mirrored.zip(&row(-iy)[usize::from(g == 0)..]).for_each(|(to, from)| *to = from.conj() * self.sign);
            }
        }
    }
}

/// Writes patch row `y` of several functions, from the function `first` on: one line of [`Plan::stride`] numbers each.
pub(super) type Fill<'a, T> = dyn Fn(usize, usize, &mut [Complex<T>]) + Sync + 'a;

/// Extracts the kept part of a transformed line.
type Take<'a, T> = dyn Fn(&[Complex<T>], &mut [Complex<T>]) + Sync + 'a;

/// Plan for transforms of one size.
pub(super) struct Plan<T: Real> {
    width: usize,
    height: usize,
    reach: [usize; 2],
    /// Half axes of the ellipse of kept frequencies, in cycles per patch.
    axes: [f64; 2],
    rows: Arc<dyn Fft<T>>,
    columns: Arc<dyn Fft<T>>,
}

impl<T: Real> Plan<T> {
    /// Creates a plan for patches of this size. `[mx, my]` and `axes` are the largest frequencies and the half axes of
    /// their ellipse, in cycles per patch. The kept part exceeds the ellipse by up to seven columns.
    pub(super) fn new(width: usize, height: usize, [mx, my]: [usize; 2], axes: [f64; 2]) -> Self {
        Self {
            width,
            height,
            reach: [mx.min((width - 1) / 2), my.min((height - 1) / 2)],
            axes,
            rows: T::forward(width),
            columns: T::forward(height),
        }
    }

    /// Largest frequencies, in cycles per patch.
    pub(super) fn reach(&self) -> [usize; 2] {
        self.reach
    }

    /// Distance between the starts of lines in numbers: whole cache lines, and no power of two, which would map all
    /// lines to the same cache sets.
    pub(super) fn stride(width: usize) -> usize {
        width.next_multiple_of(TOGETHER) + TOGETHER
    }

    /// Transform of real values.
    pub(super) fn real(&self, values: &[T]) -> Plane<T> {
        let row = |y: usize, _: usize, line: &mut [Complex<T>]| {
            let from = &values[y * self.width..][..self.width];
            line.iter_mut().zip(from).for_each(|(to, from)| *to = Complex::new(*from, T::zero()));
        };
        let one = |_: usize| Complex::new(1.0, 0.0);
        let mut plane = None;
        self.series(1, &row, &one, |found| plane = Some(found));
        // Exactly one function was requested.
        plane.unwrap_or(Plane { first: 0, sign: T::one(), groups: vec![] })
    }

    /// Transforms several real functions, each with a real or imaginary factor. `fill` writes pairs of them as real and
    /// imaginary parts of one function.
    pub(super) fn series(
        &self,
        count: usize,
        fill: &Fill<T>,
        factor: &dyn Fn(usize) -> Complex<f64>,
        mut done: impl FnMut(Plane<T>),
    ) {
        let kept = self.reach[0] + 1;
        let pairs = count.div_ceil(2);
        let mut all = zeros(self.block(2 * AT_ONCE.min(pairs), kept) * self.height.div_ceil(TOGETHER));
        let take = |line: &[Complex<T>], both: &mut [Complex<T>]| {
            let (even, odd) = both.split_at_mut(both.len() / 2);
            Arch::new().dispatch(|| part(line, &mut even[..kept], &mut odd[..kept]));
        };
        for first in (0..pairs).step_by(AT_ONCE) {
            let here = AT_ONCE.min(pairs - first);
            let rows = &mut all[..self.block(2 * here, kept) * self.height.div_ceil(TOGETHER)];
            self.rows(rows, (here, 2, kept), &|y, lines| fill(y, first, lines), &take);
            for k in (0..2 * here).filter(|k| 2 * first + k < count) {
                let turn = if k % 2 == 0 { Complex::new(0.5, 0.0) } else { Complex::new(0.0, -0.5) };
                let n = 2 * first + k;
                let factor = factor(n);
                let sign = if factor.re.abs() < factor.im.abs() { -T::one() } else { T::one() };
                done(Plane { sign, ..self.plane(rows, (k, 2 * here), 0, turn * factor) });
            }
        }
    }

    /// Transform of complex values.
    pub(super) fn complex(&self, row: &(dyn Fn(usize, &mut [Complex<T>]) + Sync)) -> Plane<T> {
        let low = self.reach[0];
        let kept = 2 * low + 1;
        let mut rows = zeros(self.block(1, kept) * self.height.div_ceil(TOGETHER));
        let keep = |line: &[Complex<T>], out: &mut [Complex<T>]| {
            out[..low].copy_from_slice(&line[line.len() - low..]);
            out[low..kept].copy_from_slice(&line[..=low]);
        };
        self.rows(&mut rows, (1, 1, kept), row, &keep);
        self.plane(&rows, (0, 1), -(low as isize), Complex::new(1.0, 0.0))
    }

    /// Number of values in a block of rows of `functions` functions.
    fn block(&self, functions: usize, kept: usize) -> usize {
        functions * kept.div_ceil(TOGETHER) * TOGETHER * TOGETHER
    }

    /// Transforms rows. `fill` writes all lines of a row, and `take` extracts the kept part of its `each` functions
    /// from each transformed line.
    ///
    /// The order within a block of rows is: functions, groups of columns, rows.
    fn rows(
        &self,
        out: &mut [Complex<T>],
        (lines, each, kept): (usize, usize, usize),
        fill: &(dyn Fn(usize, &mut [Complex<T>]) + Sync),
        take: &Take<T>,
    ) {
        let stride = Self::stride(self.width);
        let groups = kept.div_ceil(TOGETHER);
        let room = groups * TOGETHER;
        let work = || (zeros(lines * stride), zeros(each * room), zeros(self.rows.get_inplace_scratch_len()));
        let blocks = out.par_chunks_mut(self.block(lines * each, kept)).enumerate();
        blocks.for_each_init(work, |(made, found, scratch), (b, block)| {
            for y in b * TOGETHER..self.height.min((b + 1) * TOGETHER) {
                fill(y, made);
                for (k, line) in made.chunks_mut(stride).enumerate() {
                    let line = &mut line[..self.width];
                    self.rows.process_with_scratch(line, scratch);
                    take(line, found);
                    for (group, from) in found.as_chunks::<TOGETHER>().0.iter().enumerate() {
                        let at = (k * each * groups + group) * TOGETHER + y % TOGETHER;
                        block[at * TOGETHER..][..TOGETHER].copy_from_slice(from);
                    }
                }
            }
        });
    }

    /// Transforms the columns of one of `functions` functions.
    fn plane(
        &self,
        rows: &[Complex<T>],
        (k, functions): (usize, usize),
        first: isize,
        factor: Complex<f64>,
    ) -> Plane<T> {
        let factor = factor / (self.width * self.height) as f64;
        let factor = Complex::new(T::of(factor.re), T::of(factor.im));
        let kept = self.reach[0].saturating_add_signed(-first) + 1;
        let groups = kept.div_ceil(TOGETHER);
        let block = self.block(functions, kept);
        let stride = Self::stride(self.height);
        let work = || (zeros(stride * TOGETHER), zeros(self.columns.get_inplace_scratch_len()));
        let group = |(columns, scratch): &mut (Vec<Complex<T>>, Vec<Complex<T>>), group: usize| {
            let tiles = rows.chunks_exact(block).map(|b| &b[(k * groups + group) * TOGETHER * TOGETHER..]);
            Arch::new().dispatch(|| gather(tiles, columns, stride));
            let here = TOGETHER.min(kept - group * TOGETHER);
            for column in columns.chunks_exact_mut(stride).take(here) {
                self.columns.process_with_scratch(&mut column[..self.height], scratch);
            }
            let from = first + (group * TOGETHER) as isize;
            let high = self.high([from, from + here as isize - 1]);
            let mut out = Vec::with_capacity((2 * high + 1) * TOGETHER);
            // Row numbers increase downwards, so the highest frequency is the most negative one of the columns.
            Arch::new().dispatch(|| {
                spread(columns, stride, self.height - high..self.height, factor, &mut out);
                spread(columns, stride, 0..high + 1, factor, &mut out);
            });
            out
        };
        Plane { first, sign: T::one(), groups: (0..groups).into_par_iter().map_init(work, group).collect() }
    }

    /// Highest kept frequency of columns between these two.
    fn high(&self, [left, right]: [isize; 2]) -> usize {
        let nearest = if left <= 0 && right >= 0 { 0 } else { left.abs().min(right.abs()) };
        let across = nearest as f64 / self.axes[0];
        // The cast limits infinite and too large values to the largest number.
        ((self.axes[1] * (1.0 - across * across).max(0.0).sqrt()).ceil() as usize).min(self.reach[1])
    }
}

/// Separates a joint transform into twice the transforms of the real part and of i times the imaginary part, for
/// frequencies from 0 on.
#[inline(always)]
fn part<T: Real>(both: &[Complex<T>], real: &mut [Complex<T>], imaginary: &mut [Complex<T>]) {
    (real[0], imaginary[0]) = (both[0] + both[0].conj(), both[0] - both[0].conj());
    let opposite = both.iter().skip(1).zip(both.iter().rev());
    for ((a, b), (z, w)) in real.iter_mut().zip(imaginary).skip(1).zip(opposite) {
        (*a, *b) = (*z + w.conj(), *z - w.conj());
    }
}

/// Copies columns, `stride` numbers apart, from blocks of rows.
#[inline(always)]
fn gather<'a, T: Real>(tiles: impl Iterator<Item = &'a [Complex<T>]>, columns: &mut [Complex<T>], stride: usize) {
    for (b, tile) in tiles.enumerate() {
        for (lane, column) in columns.chunks_exact_mut(stride).enumerate() {
            for (y, to) in column[b * TOGETHER..][..TOGETHER].iter_mut().enumerate() {
                *to = tile[y * TOGETHER + lane];
            }
        }
    }
}

/// Appends these rows of columns, multiplied by a factor.
#[inline(always)]
fn spread<T: Real>(
    columns: &[Complex<T>],
    stride: usize,
    rows: Range<usize>,
    factor: Complex<T>,
    out: &mut Vec<Complex<T>>,
) {
    for y in rows {
        let row: [Complex<T>; TOGETHER] = std::array::from_fn(|lane| columns[lane * stride + y] * factor);
        out.extend_from_slice(&row);
    }
}

#[cfg(test)]
mod tests {
    use super::super::expansion::{Expansion, Kind};
    use super::*;
    use num_complex::Complex64;
    use std::f64::consts::TAU;

    #[test]
    fn planes_are_sums_over_all_pixels() {
        let (w, h) = (37, 20);
        let t: Vec<f64> = (0..w * h).map(|k| 2.0 * (0.618 * (k * k) as f64).fract() - 1.0).collect();
        let axes = [0.4 * w as f64, 0.3 * h as f64];
        let plan = Plan::<f64>::new(w, h, [w, h], axes);
        let [mx, my] = plan.reach().map(|m| m as isize);
        let stride = Plan::<f64>::stride(w);
        for terms in [1, 2, 6, 7] {
            let e = Expansion::with_terms(Kind::Chebyshev, 0.0, 3.0, terms);
            let fill = |y: usize, first: usize, lines: &mut [Complex64]| {
                e.pairs(&t[y * w..][..w], |t| t, first, stride, lines);
            };
            let mut planes = vec![Plane::<f64>::constant(1.0)];
            plan.series(terms - 1, &fill, &|n| e.factor(n + 1), |p| planes.push(p));
            assert_eq!(planes.len(), terms);
            let mut row = zeros(2 * mx as usize + 1);
            for (n, plane) in planes.iter().enumerate() {
                for iy in -my..=my {
                    plane.row(iy, &mut row);
                    for ix in -mx..=mx {
                        let found = row[(ix + mx) as usize];
                        assert_eq!(found, plane.at([ix, iy]));
                        if found.norm() == 0.0 && (ix as f64 / axes[0]).hypot(iy as f64 / axes[1]) > 1.0 {
                            continue;
                        }
                        let one = |(k, t): (usize, &f64)| {
                            let turns =
                                (ix * (k % w) as isize) as f64 / w as f64 - (iy * (k / w) as isize) as f64 / h as f64;
                            Complex64::from_polar((n as f64 * t.acos()).cos(), -TAU * turns)
                        };
                        let truth = e.factor(n) * t.iter().enumerate().map(one).sum::<Complex64>() / (w * h) as f64;
                        assert!((found - truth).norm() < 1e-12, "{n} of {terms}, {ix} {iy}: {found} {truth}");
                    }
                }
            }
        }
    }
}

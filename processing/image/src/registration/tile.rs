//! Tile of all frames under assumed shifts: residual of the scene's model, and its derivative with respect to each
//! shift.

use super::resample::{TAPS, kernel};
use super::scene::Scene;
use super::sums::Sums;
use super::windows::Windows;
use nacre_base::memory::prefetch;
use nacre_base::vectors::vectorised;

/// Number of values that are processed side by side.
const LANES: usize = 8;

/// Square part of a window.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tile {
    pub(super) window: usize,
    /// Left and top in the window.
    pub(super) corner: [usize; 2],
    pub(super) side: usize,
}

impl Tile {
    /// Gradient power in one frame.
    pub(super) fn texture(&self, windows: &Windows, frame: usize) -> f64 {
        let (image, side) = (windows.get(frame, self.window), windows.side);
        let power = |y: usize| -> f64 {
            let row = |y: usize, x: usize| &image[y * side + x..][..self.side];
            let [left, right] = [row(y, self.corner[0] - 1), row(y, self.corner[0] + 1)];
            let [above, below] = [row(y - 1, self.corner[0]), row(y + 1, self.corner[0])];
            let power = |x: usize| {
                let power = (right[x] - left[x]).powi(2) + (below[x] - above[x]).powi(2);
                if power.is_finite() { power } else { 0.0 }
            };
            // Parallel sums, which the compiler vectorises.
            let (mut sums, whole) = ([0.0_f32; LANES], self.side / LANES * LANES);
            for x in (0..whole).step_by(LANES) {
                sums.iter_mut().enumerate().for_each(|(k, sum)| *sum += power(x + k));
            }
            f64::from(sums.iter().sum::<f32>() + (whole..self.side).map(power).sum::<f32>())
        };
        (self.corner[1]..self.corner[1] + self.side).map(power).sum()
    }

    /// Sums over this tile with frames corrected by `shifts`.
    pub(super) fn sums(&self, windows: &Windows, scene: &Scene, shifts: &[[f64; 2]]) -> Sums {
        let back = |(k, shift): (usize, &[f64; 2])| {
            let next = windows.get((k + 1) % shifts.len(), self.window);
            self.moved_back(windows.get(k, self.window), next, windows.side, *shift)
        };
        let mut frames: Vec<Vec<f32>> = shifts.iter().enumerate().map(back).collect();
        subtract_means(&mut frames);
        let model = scene.explain(&mut frames);
        // `frames` now holds the residuals.
        self.moments(scene, &model, &frames)
    }

    /// Sums of (A, C, S) and of the residuals over the pixels that are usable in all frames.
    fn moments(&self, scene: &Scene, model: &[Vec<f32>; 3], left: &[Vec<f32>]) -> Sums {
        let mut sums = Sums::new(left.len());
        // Gradients of A, C and S, and 1 for usable pixels; all are 0 at unusable ones.
        let [mut ax, mut ay] = self.gradient(&model[0]);
        let [mut cx, mut cy] = self.gradient(&model[1]);
        let [mut sx, mut sy] = self.gradient(&model[2]);
        let [mut a, mut c, mut s] = model.each_ref().map(|plane| self.inner(plane));
        let mut usable = vec![0.0_f32; self.side * self.side];
        vectorised(
            #[inline(always)]
            || {
                for i in 0..usable.len() {
                    let all = ax[i] + ay[i] + cx[i] + cy[i] + sx[i] + sy[i] + a[i];
                    usable[i] = if all.is_finite() { 1.0 } else { 0.0 };
                }
                for plane in [&mut ax, &mut ay, &mut cx, &mut cy, &mut sx, &mut sy, &mut a, &mut c, &mut s] {
                    clear_unusable(plane, &usable);
                }
                let gradients = [&ax, &ay, &cx, &cy, &sx, &sy];
                for (i, u) in gradients.iter().enumerate() {
                    for (j, v) in gradients.iter().enumerate().take(i + 1) {
                        sums.gradient[i][j] = dot(u, v);
                        sums.gradient[j][i] = sums.gradient[i][j];
                    }
                }
                sums.pixels = dot(&usable, &usable) as usize;
                sums.modulation = dot(&c, &c) + dot(&s, &s);
            },
        );
        for (k, ([_, cos, sin], left)) in scene.rows.iter().zip(left).enumerate() {
            let ([mut dx, mut dy], mut left) = (self.gradient(left), self.inner(left));
            vectorised(
                #[inline(always)]
                || {
                    for plane in [&mut dx, &mut dy, &mut left] {
                        clear_unusable(plane, &usable);
                    }
                    sums.slope[2 * k] = dot(&left, &ax) + cos * dot(&left, &cx) + sin * dot(&left, &sx);
                    sums.slope[2 * k + 1] = dot(&left, &ay) + cos * dot(&left, &cy) + sin * dot(&left, &sy);
                    sums.square += dot(&left, &left);
                    for (sum, (u, v)) in sums.noise.iter_mut().zip([(&dx, &dx), (&dx, &dy), (&dy, &dy)]) {
                        *sum += dot(u, v);
                    }
                },
            );
        }
        sums
    }

    /// Padded row length: a border of one pixel for gradients, rounded up to whole vectors.
    fn wide(&self) -> usize {
        (self.side + 2).next_multiple_of(LANES)
    }

    /// Plane without its border.
    fn inner(&self, plane: &[f32]) -> Vec<f32> {
        let mut inner = Vec::with_capacity(self.side * self.side);
        for row in plane.chunks(self.wide()).skip(1).take(self.side) {
            inner.extend_from_slice(&row[1..=self.side]);
        }
        inner
    }

    /// Gradient of a plane to the right and down, without its border.
    fn gradient(&self, plane: &[f32]) -> [Vec<f32>; 2] {
        let (wide, side) = (self.wide(), self.side);
        let [mut right, mut down] = [0, 1].map(|_| vec![0.0_f32; side * side]);
        vectorised(
            #[inline(always)]
            || {
                for y in 0..side {
                    let row = |y: usize, x: usize| &plane[y * wide + x..][..side];
                    let ([west, east], [above, below]) = ([row(y + 1, 0), row(y + 1, 2)], [row(y, 1), row(y + 2, 1)]);
                    let (right, down) = (&mut right[y * side..][..side], &mut down[y * side..][..side]);
                    for x in 0..side {
                        right[x] = 0.5 * (east[x] - west[x]);
                        down[x] = 0.5 * (below[x] - above[x]);
                    }
                }
            },
        );
        [right, down]
    }

    /// Tile with a border of one pixel, and a few more pixels to its right.
    ///
    /// Pixels beyond the window are read from its next row, which exists because the caller keeps tiles far enough
    /// inside. They are NaN, as are the last and the first two pixels of each row. The same position in the `next`
    /// frame is prefetched, because window rows are too far apart for the hardware prefetcher.
    fn moved_back(&self, image: &[f32], next: &[f32], side: usize, shift: [f64; 2]) -> Vec<f32> {
        let wide = self.wide();
        let weights = shift.map(|d| kernel(d - d.floor()));
        // First tap of the first pixel.
        let [left, top] = [0, 1].map(|i| (self.corner[i] as isize + shift[i].floor() as isize - 3).max(0) as usize);
        let high = self.side + 2;
        let mut across = vec![0.0_f32; wide * (high + TAPS - 1)];
        let mut out = vec![0.0_f32; wide * high];
        vectorised(
            #[inline(always)]
            || {
                for (y, out) in across.chunks_mut(wide).enumerate() {
                    let from = (top + y) * side + left;
                    prefetch(&next[from..from + wide]);
                    weighted(out, &image[from..], 1, &weights[0]);
                }
                for (y, out) in out.chunks_mut(wide).enumerate() {
                    weighted(out, &across[y * wide..], wide, &weights[1]);
                }
            },
        );
        out
    }
}

/// Weighted sums of the taps of each pixel, which are `apart` values from each other.
#[inline(always)]
fn weighted(out: &mut [f32], taps: &[f32], apart: usize, weights: &[f32; TAPS]) {
    for (i, out) in out.as_chunks_mut::<LANES>().0.iter_mut().enumerate() {
        let mut sums = [0.0; LANES];
        for (j, weight) in weights.iter().enumerate() {
            let tap: &[f32] = &taps[LANES * i + j * apart..][..LANES];
            for k in 0..LANES {
                sums[k] += weight * tap[k];
            }
        }
        *out = sums;
    }
}

/// Sets unusable pixels to zero.
#[inline(always)]
fn clear_unusable(plane: &mut [f32], usable: &[f32]) {
    for (v, usable) in plane.iter_mut().zip(usable) {
        *v = if *usable > 0.0 { *v } else { 0.0 };
    }
}

/// Sum of products, in blocks of single precision.
#[inline(always)]
fn dot(u: &[f32], v: &[f32]) -> f64 {
    const FEW: usize = 8 * LANES;
    let mut total = 0.0;
    for (u, v) in u.chunks(FEW).zip(v.chunks(FEW)) {
        let mut sums = [0.0_f32; LANES];
        let ((u, u_rest), (v, v_rest)) = (u.as_chunks::<LANES>(), v.as_chunks::<LANES>());
        for (u, v) in u.iter().zip(v) {
            for k in 0..LANES {
                sums[k] += u[k] * v[k];
            }
        }
        for k in 0..u_rest.len() {
            sums[k] += u_rest[k] * v_rest[k];
        }
        let mut sum = 0.0;
        for lane in sums {
            sum += lane;
        }
        total += f64::from(sum);
    }
    total
}

/// Subtracts each frame's mean over the pixels usable in all frames, as a drift of brightness says nothing about
/// shifts.
fn subtract_means(frames: &mut [Vec<f32>]) {
    let Some(first) = frames.first() else { return };
    let (mut sum, ones) = (vec![0.0_f32; first.len()], vec![1.0_f32; first.len()]);
    vectorised(
        #[inline(always)]
        || {
            for frame in &*frames {
                for (sum, v) in sum.iter_mut().zip(frame) {
                    *sum += v;
                }
            }
            // From here on 1 for usable pixels.
            for sum in &mut sum {
                *sum = if sum.is_finite() { 1.0 } else { 0.0 };
            }
            let count = dot(&sum, &ones).max(1.0);
            for frame in &mut *frames {
                clear_unusable(frame, &sum);
                let mean = (dot(frame, &ones) / count) as f32;
                for (v, usable) in frame.iter_mut().zip(&sum) {
                    *v = if *usable > 0.0 { *v - mean } else { f32::NAN };
                }
            }
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use nacre_base::random::Stream;

    /// Sum, and sum of the absolute values of its terms.
    #[derive(Clone, Copy, Default)]
    struct Exact(f64, f64);

    impl Exact {
        fn add(&mut self, term: f64) {
            (self.0, self.1) = (self.0 + term, self.1 + term.abs());
        }

        /// Tolerance: 16 successive additions in single precision round by at most 6e-8 of the absolute values each,
        /// and gradients and products round too.
        fn assert_is(self, found: f64) {
            assert!((found - self.0).abs() <= 2e-6 * self.1, "{found} {}", self.0);
        }
    }

    /// Comparison with the definition, pixel by pixel in double precision; an unusable pixel excludes its neighbours.
    #[test]
    fn moments_are_those_of_the_pixels_that_can_be_used() {
        let tile = Tile { window: 0, corner: [0, 0], side: 13 };
        let (wide, hole) = (tile.wide(), 5 * tile.wide() + 6);
        let plane = |seed: u64| {
            let mut stream = Stream::of(seed);
            let mut plane: Vec<f32> = (0..wide * (tile.side + 2)).map(|_| stream.next() as f32 - 0.3).collect();
            plane[hole] = f32::NAN;
            plane
        };
        let (scene, model) = (Scene::polarized(&[0.1, 0.9, 1.6, 2.5]), [plane(1), plane(2), plane(3)]);
        let left = [4, 5, 6, 7].map(plane);
        let found = tile.moments(&scene, &model, &left);
        let mut gradient = [[Exact::default(); 6]; 6];
        let (mut slope, mut noise) = ([Exact::default(); 8], [Exact::default(); 3]);
        let ([mut square, mut modulation], mut pixels) = ([Exact::default(); 2], 0);
        for i in (1..=tile.side).flat_map(|y| (1..=tile.side).map(move |x| y * wide + x)) {
            if [hole - wide, hole - 1, hole, hole + 1, hole + wide].contains(&i) {
                continue;
            }
            let at = |plane: &[f32], i: usize| f64::from(plane[i]);
            let slopes = |p: &[f32]| [0.5 * (at(p, i + 1) - at(p, i - 1)), 0.5 * (at(p, i + wide) - at(p, i - wide))];
            let [a, c, s] = [0, 1, 2].map(|k| slopes(&model[k]));
            let all = [a[0], a[1], c[0], c[1], s[0], s[1]];
            pixels += 1;
            modulation.add(at(&model[1], i).powi(2) + at(&model[2], i).powi(2));
            for (j, k) in (0..6).flat_map(|j| (0..6).map(move |k| (j, k))) {
                gradient[j][k].add(all[j] * all[k]);
            }
            for (k, ([_, cos, sin], left)) in scene.rows.iter().zip(&left).enumerate() {
                let (residual, [x, y]) = (at(left, i), slopes(left));
                for axis in 0..2 {
                    for part in [a[axis], cos * c[axis], sin * s[axis]] {
                        slope[2 * k + axis].add(residual * part);
                    }
                }
                square.add(residual * residual);
                noise.iter_mut().zip([x * x, x * y, y * y]).for_each(|(sum, v)| sum.add(v));
            }
        }
        assert_eq!((found.pixels, pixels), (164, 164));
        modulation.assert_is(found.modulation);
        square.assert_is(found.square);
        slope.iter().zip(&found.slope).for_each(|(exact, found)| exact.assert_is(*found));
        noise.iter().zip(&found.noise).for_each(|(exact, found)| exact.assert_is(*found));
        gradient
            .as_flattened()
            .iter()
            .zip(found.gradient.as_flattened())
            .for_each(|(exact, found)| exact.assert_is(*found));
    }
}

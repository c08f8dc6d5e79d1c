//! One tile of all frames, moved back by assumed shifts: how far the scene's model explains it, and what each shift
//! would change.

use super::resample::{TAPS, kernel};
use super::scene::Scene;
use super::windows::Windows;

/// A square of a window.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tile {
    pub(super) window: usize,
    /// Left and top inside the window.
    pub(super) corner: [usize; 2],
    pub(super) side: usize,
}

/// Sums over the pixels of tiles.
#[derive(Clone, Debug)]
pub(super) struct Sums {
    /// Derivative of half the sum of squares by the shifts, `[x0, y0, x1, y1, …]`.
    pub(super) slope: Vec<f64>,
    /// Moments of the gradients of (A, C, S): 6×6, rows and columns `[A.x, A.y, C.x, C.y, S.x, S.y]`.
    pub(super) gradient: [[f64; 6]; 6],
    /// Moments of the gradient of what is left over, summed over frames: xx, xy, yy.
    pub(super) noise: [f64; 3],
    /// Sum of squares of what is left over.
    pub(super) square: f64,
    /// Sum of C² + S².
    pub(super) modulation: f64,
    /// Pixels that could be used in all frames.
    pub(super) pixels: usize,
}

impl Sums {
    pub(super) fn new(frames: usize) -> Self {
        let (slope, gradient) = (vec![0.0; 2 * frames], [[0.0; 6]; 6]);
        Self { slope, gradient, noise: [0.0; 3], square: 0.0, modulation: 0.0, pixels: 0 }
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.slope.iter_mut().zip(&other.slope).for_each(|(a, b)| *a += b);
        let all = self.gradient.as_flattened_mut().iter_mut().zip(other.gradient.as_flattened());
        all.chain(self.noise.iter_mut().zip(&other.noise)).for_each(|(a, b)| *a += b);
        self.square += other.square;
        self.modulation += other.modulation;
        self.pixels += other.pixels;
    }
}

impl Tile {
    /// Power of the gradient in one frame.
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
            // Sums side by side, which the compiler makes a vector of.
            let (mut sums, whole) = ([0.0_f32; 8], self.side / 8 * 8);
            for x in (0..whole).step_by(8) {
                sums.iter_mut().enumerate().for_each(|(k, sum)| *sum += power(x + k));
            }
            f64::from(sums.iter().sum::<f32>() + (whole..self.side).map(power).sum::<f32>())
        };
        (self.corner[1]..self.corner[1] + self.side).map(power).sum()
    }

    /// Sums over this tile with frames moved back by `shifts`.
    pub(super) fn sums(&self, windows: &Windows, scene: &Scene, shifts: &[[f64; 2]]) -> Sums {
        // One pixel more on each side, for gradients.
        let wide = self.side + 2;
        let mut frames: Vec<Vec<f32>> = shifts
            .iter()
            .enumerate()
            .map(|(k, shift)| self.moved_back(windows.get(k, self.window), windows.side, *shift))
            .collect();
        subtract_means(&mut frames);
        let model = scene.explain(&mut frames);
        // `frames` now holds what is left over.
        let mut sums = Sums::new(shifts.len());
        let gradient = |plane: &[f32], i: usize| {
            [0.5 * f64::from(plane[i + 1] - plane[i - 1]), 0.5 * f64::from(plane[i + wide] - plane[i - wide])]
        };
        for i in (1..=self.side).flat_map(|y| (1..=self.side).map(move |x| y * wide + x)) {
            let [a, c, s] = [0, 1, 2].map(|p| gradient(&model[p], i));
            let all = [a[0], a[1], c[0], c[1], s[0], s[1]];
            if !all.iter().sum::<f64>().is_finite() || !model[0][i].is_finite() {
                continue;
            }
            sums.pixels += 1;
            sums.modulation += f64::from(model[1][i].powi(2) + model[2][i].powi(2));
            for (row, u) in sums.gradient.iter_mut().zip(all) {
                row.iter_mut().zip(all).for_each(|(sum, v)| *sum += u * v);
            }
            for (k, ([_, cos, sin], left)) in scene.rows.iter().zip(&frames).enumerate() {
                let residual = f64::from(left[i]);
                sums.slope[2 * k] += residual * (a[0] + cos * c[0] + sin * s[0]);
                sums.slope[2 * k + 1] += residual * (a[1] + cos * c[1] + sin * s[1]);
                sums.square += residual * residual;
                let [x, y] = gradient(left, i);
                sums.noise.iter_mut().zip([x * x, x * y, y * y]).for_each(|(sum, v)| *sum += v);
            }
        }
        sums
    }

    /// The tile with a rim of one pixel.
    fn moved_back(&self, image: &[f32], side: usize, shift: [f64; 2]) -> Vec<f32> {
        let wide = self.side + 2;
        let weights = shift.map(|d| kernel(d - d.floor()));
        // First tap of the first pixel; the caller keeps tiles this far inside their window.
        let [left, top] = [0, 1].map(|i| (self.corner[i] as isize + shift[i].floor() as isize - 3).max(0) as usize);
        let mut across = vec![0.0_f32; wide * (wide + TAPS - 1)];
        for (y, out) in across.chunks_mut(wide).enumerate() {
            let row = &image[(top + y) * side + left..][..wide + TAPS - 1];
            for (j, w) in weights[0].iter().enumerate() {
                out.iter_mut().zip(&row[j..]).for_each(|(out, v)| *out += w * v);
            }
        }
        let mut out = vec![0.0_f32; wide * wide];
        for (y, out) in out.chunks_mut(wide).enumerate() {
            for (j, w) in weights[1].iter().enumerate() {
                out.iter_mut().zip(&across[(y + j) * wide..][..wide]).for_each(|(out, v)| *out += w * v);
            }
        }
        out
    }
}

/// Takes each frame's mean over the pixels that all frames have: brightness that drifts says nothing of shifts.
fn subtract_means(frames: &mut [Vec<f32>]) {
    let Some(first) = frames.first() else { return };
    let mut sum: Vec<f32> = vec![0.0; first.len()];
    frames.iter().for_each(|f| sum.iter_mut().zip(f).for_each(|(sum, v)| *sum += v));
    let usable: Vec<bool> = sum.iter().map(|v| v.is_finite()).collect();
    let count = usable.iter().filter(|u| **u).count().max(1) as f64;
    for frame in frames {
        let total: f64 = frame.iter().zip(&usable).filter(|(_, u)| **u).map(|(v, _)| f64::from(*v)).sum();
        let mean = (total / count) as f32;
        frame.iter_mut().zip(&usable).for_each(|(v, usable)| *v = if *usable { *v - mean } else { f32::NAN });
    }
}

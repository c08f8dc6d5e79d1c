//! Windows: the parts of the photographs that are registered, distributed over the image at places of most texture.

use nacre_base::vectors::vectorised;
use rayon::prelude::*;

/// Largest side of a window in pixels.
const SIDE: usize = 256;

/// Largest number of windows along each side of the image. 16 of them are 1 Mpixel, for photographs of any size.
const ALONG: usize = 4;

/// Smallest side of a window in pixels.
pub(super) const SMALLEST: usize = 32;

/// Smoothed windows of all frames; NaN where a value is unusable.
pub(super) struct Windows {
    pub(super) side: usize,
    /// Left and top of each window.
    corners: Vec<[usize; 2]>,
    /// Windows of each frame, one after the other.
    frames: Vec<Vec<f32>>,
    width: usize,
    height: usize,
}

impl Windows {
    /// Creates windows for images of this size; images below 32 pixels have none.
    pub(super) fn new(width: usize, height: usize) -> Self {
        let side = SIDE.min(width).min(height) / SMALLEST * SMALLEST;
        Self { side, corners: Vec::new(), frames: Vec::new(), width, height }
    }

    /// The same windows at half the size; `None` if they become too small.
    pub(super) fn halved(&self) -> Option<Self> {
        let side = self.side / 2;
        if side < SMALLEST {
            return None;
        }
        let half = |frame: &Vec<f32>| {
            let mut values = vec![0.0_f32; self.corners.len() * side * side];
            let pairs = values.par_chunks_mut(side * side).zip(frame.par_chunks(self.side * self.side));
            pairs.for_each(|(out, window)| {
                for (y, out) in out.chunks_mut(side).enumerate() {
                    let [above, below] = [0, 1].map(|j| window[(2 * y + j) * self.side..].as_chunks::<2>().0);
                    for (out, (above, below)) in out.iter_mut().zip(above.iter().zip(below)) {
                        *out = 0.25 * (above[0] + above[1] + below[0] + below[1]);
                    }
                }
                smooth(out, side);
            });
            values
        };
        let frames = self.frames.iter().map(half).collect();
        Some(Self { side, corners: self.corners.clone(), frames, width: self.width / 2, height: self.height / 2 })
    }

    pub(super) fn frames(&self) -> usize {
        self.frames.len()
    }

    pub(super) fn count(&self) -> usize {
        self.corners.len()
    }

    pub(super) fn get(&self, frame: usize, window: usize) -> &[f32] {
        let area = self.side * self.side;
        &self.frames[frame][window * area..][..area]
    }

    /// Adds a frame; the first one determines the positions of the windows.
    pub(super) fn add(&mut self, row: impl Fn(usize, usize, &mut [f32], &mut [u8]) + Sync) {
        let (width, side) = (self.width, self.side);
        if self.frames.is_empty() && side > 0 {
            let mut plane = vec![0.0_f32; width * self.height];
            plane.par_chunks_mut(width).enumerate().for_each(|(y, values)| usable(&row, [0, y], values));
            self.corners = self.choose(&plane);
        }
        let mut values = vec![0.0_f32; self.corners.len() * side * side];
        values.par_chunks_mut((side * side).max(1)).zip(&self.corners).for_each(|(window, [left, top])| {
            window.chunks_mut(side).enumerate().for_each(|(y, out)| usable(&row, [*left, top + y], out));
            smooth(window, side);
        });
        self.frames.push(values);
    }

    /// Position of most texture in each of up to 4×4 equal blocks of the image.
    fn choose(&self, plane: &[f32]) -> Vec<[usize; 2]> {
        let blocks = [self.width, self.height].map(|length| (length / self.side).clamp(1, ALONG));
        let size = [self.width / blocks[0], self.height / blocks[1]];
        let places = |block: usize, axis: usize| {
            let step = (self.side / 2).min((size[axis] - self.side).max(1));
            (block * size[axis]..=(block + 1) * size[axis] - self.side).step_by(step)
        };
        (0..blocks[0] * blocks[1])
            .into_par_iter()
            .filter_map(|block| {
                let (column, row) = (block % blocks[0], block / blocks[0]);
                let places = places(row, 1).flat_map(|top| places(column, 0).map(move |left| [left, top]));
                places.map(|at| (self.texture(plane, at), at)).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, at)| at)
            })
            .collect()
    }

    /// Power of differences over two pixels, on a quarter of the window's rows and columns.
    fn texture(&self, plane: &[f32], [left, top]: [usize; 2]) -> f32 {
        let mut sum = 0.0;
        for y in (top..top + self.side - 2).step_by(2) {
            let (row, below) = (&plane[y * self.width..][..self.width], &plane[(y + 2) * self.width..][..self.width]);
            for x in (left..left + self.side - 2).step_by(2) {
                let power = (row[x + 2] - row[x]).powi(2) + (below[x] - row[x]).powi(2);
                sum += if power.is_nan() { 0.0 } else { power };
            }
        }
        sum
    }
}

/// Part of row `y` from column `left` on, with NaN for unusable values.
fn usable(row: &impl Fn(usize, usize, &mut [f32], &mut [u8]), [left, y]: [usize; 2], values: &mut [f32]) {
    let mut bad = vec![0_u8; values.len()];
    row(y, left, values, &mut bad);
    values.iter_mut().zip(bad).filter(|(_, bad)| *bad != 0).for_each(|(value, _)| *value = f32::NAN);
}

/// Binomial filter of five taps (σ = 1 px) along both axes, so that edges are sampled finely enough for interpolation.
/// NaN spreads to all pixels that it touches, and the border becomes NaN.
fn smooth(window: &mut [f32], side: usize) {
    let mut wide = vec![f32::NAN; window.len()];
    vectorised(
        #[inline(always)]
        || {
            for (out, row) in wide.chunks_mut(side).zip(window.chunks(side)) {
                binomial(&mut out[2..side - 2], [0, 1, 2, 3, 4].map(|j| &row[j..]));
            }
            window.fill(f32::NAN);
            for y in 2..side - 2 {
                let taps = [0, 1, 2, 3, 4].map(|j| &wide[(y + j - 2) * side + 2..]);
                binomial(&mut window[y * side + 2..][..side - 4], taps);
            }
        },
    );
}

#[inline(always)]
fn binomial(out: &mut [f32], mut taps: [&[f32]; 5]) {
    let n = out.len();
    for tap in &mut taps {
        *tap = &tap[..n];
    }
    let [a, b, c, d, e] = taps;
    for x in 0..n {
        out[x] = (a[x] + e[x] + 4.0 * (b[x] + d[x]) + 6.0 * c[x]) / 16.0;
    }
}

//! A sample of small pixel blocks of every view, kept after the photographs are discarded. It suffices for the scatter
//! of views about each other and about their fit, and its memory is independent of the size of the photographs.

use crate::fit::merge::Merge;
use crate::{Design, Fit, StokesMaps};
use rayon::prelude::*;

/// Side of a block in pixels.
pub(crate) const SIDE: usize = 8;

/// Pixels of a block.
pub(crate) const AREA: usize = SIDE * SIDE;

/// Maximum number of blocks, and of views: at 4 bytes per pixel, 26 MB in total.
const BLOCKS: usize = 512;
const VIEWS: usize = 200;

/// Blocks of pixels, evenly distributed over the image.
pub(crate) struct Sample {
    /// Number of blocks per row of blocks.
    columns: usize,
    /// Upper left corners of the blocks, row by row.
    corners: Vec<[usize; 2]>,
    width: usize,
    /// Pixels block by block, row by row; NaN for unusable pixels.
    views: Vec<Vec<f32>>,
}

/// Every second block, in a chessboard pattern.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Half {
    Black,
    White,
}

impl Sample {
    /// An empty sample for maps of `width` × `height` pixels.
    pub(crate) fn new(width: usize, height: usize) -> Self {
        let fit = [width / SIDE, height / SIDE];
        let (mut columns, mut rows) = (fit[0], fit[1]);
        if columns * rows > BLOCKS {
            let even = (BLOCKS as f64 * columns as f64 / rows as f64).sqrt() as usize;
            columns = even.clamp(1, columns.min(BLOCKS));
            rows = (BLOCKS / columns).min(rows);
        }
        let place = |i: usize, n: usize, fit: usize| SIDE * ((2 * i + 1) * fit / (2 * n));
        let corners = (0..rows * columns)
            .map(|i| [place(i % columns, columns, fit[0]), place(i / columns, rows, fit[1])])
            .collect();
        Self { columns: columns.max(1), corners, width, views: vec![] }
    }

    /// The same blocks without their pixels.
    pub(crate) fn emptied(&self) -> Self {
        Self { columns: self.columns, corners: self.corners.clone(), width: self.width, views: vec![] }
    }

    /// Adds the next view. `row(y, values, bad)` fills in one row as for [`Fit::add`].
    pub(crate) fn add(&mut self, row: impl Fn(usize, &mut [f32], &mut [u8]) + Sync) {
        if self.views.len() == VIEWS {
            return;
        }
        let mut view = vec![0.0_f32; self.corners.len() * AREA];
        let bands = view.par_chunks_mut(self.columns * AREA).zip(self.corners.par_chunks(self.columns));
        bands.for_each_init(
            || (vec![0.0_f32; self.width], vec![0_u8; self.width]),
            |(values, bad), (band, corners)| {
                for line in 0..SIDE {
                    let Some([_, top]) = corners.first() else { return };
                    bad.fill(0);
                    row(top + line, values, bad);
                    for (block, [left, _]) in band.chunks_mut(AREA).zip(corners) {
                        let seen = values[*left..].iter().zip(&bad[*left..]);
                        for (out, (value, bad)) in block[line * SIDE..][..SIDE].iter_mut().zip(seen) {
                            *out = if *bad == 0 { *value } else { f32::NAN };
                        }
                    }
                }
            },
        );
        self.views.push(view);
    }

    /// Number of stored views.
    pub(crate) fn views(&self) -> usize {
        self.views.len()
    }

    /// The pixels of a view, block by block.
    pub(crate) fn view(&self, k: usize) -> &[f32] {
        self.views.get(k).map_or(&[], |v| v)
    }

    /// The pixels of all views.
    pub(crate) fn all(&self) -> Vec<&[f32]> {
        self.views.iter().map(Vec::as_slice).collect()
    }

    /// Indices of the blocks of one half.
    pub(crate) fn half(&self, half: Half) -> impl Iterator<Item = usize> + Clone {
        let columns = self.columns;
        (0..self.corners.len()).filter(move |i| ((i % columns + i / columns) % 2 == 1) == (half == Half::White))
    }

    /// Map index of pixel `i` of the views.
    #[cfg(test)]
    pub(crate) fn pixel(&self, i: usize) -> usize {
        let [x, y] = self.corners[i / AREA];
        (y + i % AREA / SIDE) * self.width + x + i % SIDE
    }

    /// Blocks of every view.
    pub(crate) fn blocks(&self) -> usize {
        self.corners.len()
    }

    /// Fits Malus' law to the pixels of these blocks, using some of the views (index and angle in rad).
    pub(crate) fn solve(&self, blocks: &[usize], views: &[(usize, f64)], design: &Design) -> StokesMaps {
        let mut fit = Fit::new(blocks.len() * AREA, 1);
        for (k, psi) in views {
            let view = self.view(*k);
            fit.add(*psi, |_, values, bad| {
                for (i, (value, bad)) in values.iter_mut().zip(bad).enumerate() {
                    let seen = view[blocks[i / AREA] * AREA + i % AREA];
                    let usable = seen.is_finite();
                    (*value, *bad) = (if usable { seen } else { 0.0 }, *bad | u8::from(!usable));
                }
            });
        }
        fit.solve(design)
    }
}

/// Adds a view to the sample. `row(k, y, values, bad)` yields a row of its `k`-th photograph.
pub(crate) fn sampled(
    sample: &mut Sample,
    photographs: usize,
    merge: &Merge,
    row: impl Fn(usize, usize, &mut [f32], &mut [u8]) + Sync,
) {
    sample.add(|y, light, bad| match photographs {
        1 => row(0, y, light, bad),
        _ => merge.row(|k, light, bad| row(k, y, light, bad), light, &mut vec![0.0; light.len()], bad),
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks lie inside the image without overlap, and contain the pixels at their stated positions.
    #[test]
    fn blocks_are_spread_over_the_image() {
        for (width, height) in [(640, 480), (8, 8), (9, 4000), (4000, 9), (100, 100), (7, 100), (2448, 2048)] {
            let mut sample = Sample::new(width, height);
            assert!(sample.corners.len() <= BLOCKS && (sample.corners.is_empty() == (width < SIDE || height < SIDE)));
            for k in 0..VIEWS + 3 {
                let value = |i: usize| (i + k) as f32;
                sample.add(|y, values, _| values.iter_mut().enumerate().for_each(|(x, v)| *v = value(y * width + x)));
                if k > 2 && width > 100 {
                    break;
                }
            }
            assert!(sample.views() <= VIEWS);
            let mut met: Vec<usize> = (0..sample.view(0).len()).map(|i| sample.pixel(i)).collect();
            assert!(sample.view(1).iter().zip(&met).all(|(v, i)| *v == (i + 1) as f32));
            met.sort_unstable();
            met.dedup();
            assert!(met.len() == sample.view(0).len() && met.iter().all(|i| *i < width * height));
            let halves = [Half::Black, Half::White].map(|h| sample.half(h).count());
            assert!(
                halves[0].abs_diff(halves[1]) <= sample.corners.len().isqrt()
                    && halves[0] + halves[1] == sample.corners.len()
            );
        }
    }
}

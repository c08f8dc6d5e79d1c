//! Neighbourhood of adjacent pixels: gradients, and the median.

use super::{ALIKE, BASE, Field, LANES, Lane, REACH};

/// The neighbourhood of `LANES` adjacent pixels.
pub(super) struct Window<'a, const PLANES: usize> {
    pub(super) from: &'a Field<PLANES>,
    pub(super) y: usize,
    pub(super) x: usize,
}

impl<const PLANES: usize> Window<'_, PLANES> {
    /// The pixels at this offset below and right of the window's corner.
    #[inline(always)]
    pub(super) fn at(&self, dy: usize, dx: usize) -> [&Lane; PLANES] {
        const NONE: Lane = [0.0; LANES];
        let row = self.from.row(self.y + dy);
        std::array::from_fn(|k| row[k * self.from.stride + self.x + dx..].first_chunk().unwrap_or(&NONE))
    }

    /// Squares of sin 2Δ over `BASE` pixels, across and down.
    #[inline(always)]
    pub(super) fn slopes(&self) -> [Lane; 2] {
        let values = |dy: usize, dx: usize| {
            let pixel = self.at(dy, dx);
            [pixel[0], pixel[1], pixel[2]]
        };
        let (middle, far) = (REACH, 2 * BASE);
        let across = [middle - far, middle - BASE, middle, middle + BASE, middle + far].map(|dx| values(middle, dx));
        let down = [middle - far, middle - BASE, middle, middle + BASE, middle + far].map(|dy| values(dy, middle));
        [flatter(&across), flatter(&down)]
    }

    /// Median of cos 2θ and of sin 2θ over 3×3 pixels, normalised. A masked pixel is replaced by the opposite one, or
    /// else by the centre.
    #[inline(always)]
    #[allow(clippy::needless_range_loop, reason = "so that it becomes vector instructions")]
    pub(super) fn median(&self) -> [Lane; 2] {
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

/// The square of sin 2Δ between consecutive pixels of five, where two steps in a row are similar: an edge or noise is
/// no gradient.
#[inline(always)]
fn flatter(pixels: &[[&Lane; 3]; 5]) -> Lane {
    let mut square = [0.0; LANES];
    for i in 0..LANES {
        let sine = |k: usize| {
            let [[c, s, r], [d, t, q]] = [k, k + 1].map(|k| pixels[k].map(|plane| plane[i]));
            if r * q > 0.0 { t * c - d * s } else { 0.0 }
        };
        let pair = |a: f32, b: f32| {
            let (l, r) = (a * a, b * b);
            let (least, most) = if l < r { (l, r) } else { (r, l) };
            if a * b > 0.0 && most < ALIKE * least { least } else { 0.0 }
        };
        let [p, q, r, s] = [sine(0), sine(1), sine(2), sine(3)];
        let [left, middle, right] = [pair(p, q), pair(q, r), pair(r, s)];
        let beside = if left > right { left } else { right };
        square[i] = if middle > beside { middle } else { beside };
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

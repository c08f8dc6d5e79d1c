//! Oblong pixels: the coarser direction is interpolated to the pitch of the finer one.

use nacre_image::catmull_rom;

/// Largest relative difference of width and height of a pixel that counts as square.
pub(super) const SQUARE: f64 = 0.01;

/// Largest ratio of a pixel's sides. Beyond, most heights would be interpolated.
pub(super) const MOST: f64 = 4.0;

/// Heights on square pixels, with their new number of columns; `sides` are width and height of a pixel.
pub(super) fn squared(values: &[f64], width: usize, sides: [f64; 2]) -> (Vec<f64>, usize) {
    let [across, down] = sides;
    if across > down {
        stretched(values, width, across / down)
    } else {
        let rows = values.len() / width;
        let (columns, length) = stretched(&transposed(values, width), rows, down / across);
        (transposed(&columns, length), width)
    }
}

/// Number of heights after interpolation of `count` heights in a direction whose pixels are `ratio` times as long as
/// wide.
fn length(count: usize, ratio: f64) -> usize {
    ((count - 1) as f64 * ratio).floor() as usize + 1
}

/// Columns and rows of the result of [`squared`].
pub(super) fn size([width, rows]: [usize; 2], [across, down]: [f64; 2]) -> [usize; 2] {
    if across > down { [length(width, across / down), rows] } else { [width, length(rows, down / across)] }
}

/// Interpolates rows of `width` values to `ratio` as many values, with linear extrapolation beyond their ends.
fn stretched(values: &[f64], width: usize, ratio: f64) -> (Vec<f64>, usize) {
    let new = length(width, ratio);
    let mut all = Vec::with_capacity(values.len() / width * new);
    for row in values.chunks_exact(width) {
        let end = row[width - 1];
        let before = 2.0 * row[0] - row.get(1).unwrap_or(&end);
        let after = 2.0 * end - row[width.saturating_sub(2)];
        let at = |i: isize| match i {
            -1 => before,
            i => row.get(i as usize).copied().unwrap_or(after),
        };
        all.extend((0..new).map(|i| {
            let place = i as f64 / ratio;
            let first = place.floor() as isize;
            let weights = catmull_rom((place - place.floor()) as f32).map(f64::from);
            (-1..3).zip(weights).map(|(k, weight)| weight * at(first + k)).sum::<f64>()
        }));
    }
    (all, new)
}

fn transposed(values: &[f64], width: usize) -> Vec<f64> {
    let rows = values.len() / width;
    (0..width * rows).map(|i| values[i % rows * width + i / rows]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Wave of 2 µm period on pixels of any sides.
    fn wave(width: usize, rows: usize, [across, down]: [f64; 2]) -> Vec<f64> {
        let height = |x: f64, y: f64| (std::f64::consts::PI * (0.8 * x + 0.6 * y)).sin();
        (0..width * rows).map(|i| height((i % width) as f64 * across, (i / width) as f64 * down)).collect()
    }

    #[test]
    fn a_wave_keeps_its_shape_on_square_pixels() {
        for (sides, width, rows, new) in [([0.2, 0.1], 20, 30, [39, 30]), ([0.1, 0.25], 20, 12, [20, 28])] {
            let (found, columns) = squared(&wave(width, rows, sides), width, sides);
            assert_eq!([columns, found.len() / columns], new);
            assert_eq!(size([width, rows], sides), new);
            let truth = wave(new[0], new[1], [sides[0].min(sides[1]); 2]);
            let off = |margin: usize| {
                let inside = |i: &usize| {
                    let (x, y) = (i % columns, i / columns);
                    x.min(columns - 1 - x) >= margin && y.min(new[1] - 1 - y) >= margin
                };
                (0..found.len()).filter(inside).map(|i| (found[i] - truth[i]).abs()).fold(0.0, f64::max)
            };
            // Interpolation error of Catmull-Rom weights for a wave, |Σ weight e^(iwk) - e^(iwt)|. It is 0.00146 for
            // 12.5 pixels half-way, and 0.00175 for 13.3 pixels at 2/5. At the border a neighbour is missing.
            assert!(off(5) < 0.0018, "{sides:?}: {}", off(5));
            assert!(off(0) < 0.06, "{sides:?}: {}", off(0));
        }
    }
}

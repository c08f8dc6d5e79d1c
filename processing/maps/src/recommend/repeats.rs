//! Detection of repeated tiles and of uniform areas, by autocorrelation and gradient statistics.

use nacre_image::{Correlation, Field};
use serde::Serialize;

/// Minimum correlation of copies.
const ALIKE: f32 = 0.4;

/// Correlation, relative to the best copy, above which a shorter translation is taken as the tile.
const AS_GOOD: f32 = 0.7;

/// Factor of a peak's correlation below which the correlation must fall on the way to it.
const VALLEY: f32 = 0.8;

/// Minimum overlap of the picture with its translated copy, as a fraction.
const SEEN: f32 = 0.2;

/// Minimum sine of the angle between a tile's sides.
const APART: f64 = 0.35;

/// A tile that the sample repeats.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Repeats {
    /// Two lattice vectors in pixels of the photograph, right and down.
    pub sides_px: [[f64; 2]; 2],
    /// Number of visible copies; those at the border count in part. If too few copies can be followed from neighbour to
    /// neighbour, the number that fits into the known area.
    pub copies: f64,
    /// Mean correlation with neighbouring copies; 1 for identical copies.
    pub likeness: f64,
}

/// The smallest tile that a field repeats; `None` without repetition. `scale` is the size of the field's pixels in
/// those of the photograph.
pub(super) fn repeats(field: &Field, scale: f64) -> Option<Repeats> {
    let all = Correlation::of(field, field);
    let peaks = peaks(field, &all);
    let best = peaks.iter().map(|p| p.1).fold(0.0, f32::max);
    let mut sides: Vec<[f64; 2]> = peaks.iter().filter(|p| p.1 >= AS_GOOD * best).map(|p| all.between(p.0)).collect();
    let length = |v: &[f64; 2]| v[0].hypot(v[1]);
    sides.sort_by(|a, b| length(a).total_cmp(&length(b)));
    let first = *sides.first()?;
    let sine = |v: &[f64; 2]| (first[0] * v[1] - first[1] * v[0]).abs() / (length(&first) * length(v));
    let second = *sides.iter().find(|v| sine(v) > APART)?;
    let whole = |v: [f64; 2]| v.map(|d| d.round() as i64);
    let diagonals = [[first[0] + second[0], first[1] + second[1]], [first[0] - second[0], first[1] - second[1]]];
    let steps = [first, second, diagonals[0], diagonals[1]];
    let area = (first[0] * second[1] - first[1] * second[0]).abs();
    let likeness = steps.iter().map(|v| f64::from(all.at(whole(*v)))).sum::<f64>() / 4.0;
    let copies = f64::from(field.mask.iter().sum::<f32>()) / area;
    // A diagonal without correlation reveals an accidental peak.
    let real = diagonals.iter().all(|v| all.at(whole(*v)) > 0.5 * best);
    // The vector with the larger horizontal component comes first; both point right or down.
    let towards = |v: [f64; 2]| if v[0] + v[1] < 0.0 { v.map(|d| -d * scale) } else { v.map(|d| d * scale) };
    let [a, b] = [first, second].map(towards);
    let sides_px = if a[0].abs() >= b[0].abs() { [a, b] } else { [b, a] };
    real.then_some(Repeats { sides_px, copies, likeness })
}

/// Translations to the right or down with a local maximum of the autocorrelation, outside of the central peak.
fn peaks(field: &Field, all: &Correlation) -> Vec<([i64; 2], f32)> {
    let [w, h] = [field.width as i64, field.height as i64];
    let enough = SEEN * all.overlap([0, 0]);
    // A separate peak requires a minimum between it and the origin.
    let hill = |[dx, dy]: [i64; 2]| {
        let steps = dx.abs().max(dy.abs());
        (1..=steps).all(|k| {
            let part = |d: i64| (d as f64 * k as f64 / steps as f64).round() as i64;
            all.at([part(dx), part(dy)]) > VALLEY * all.at([dx, dy])
        })
    };
    let mut found = vec![];
    for dy in 0..h {
        for dx in -w + 1..w {
            let here = all.at([dx, dy]);
            if here < ALIKE || (dy == 0 && dx <= 0) || all.overlap([dx, dy]) < enough {
                continue;
            }
            let around = (-1..=1).flat_map(|v| (-1..=1).map(move |u| [u, v])).filter(|d| *d != [0, 0]);
            if around.map(|[u, v]| all.at([dx + u, dy + v])).all(|v| v <= here) && !hill([dx, dy]) {
                found.push(([dx, dy], here));
            }
        }
    }
    found
}

/// Kurtosis of a field's gradient: mean fourth power over squared mean square. About 2 for smooth or noisy fields,
/// higher for uniform areas with sharp edges.
pub(super) fn unevenness(field: &Field) -> f64 {
    let (w, h) = (field.width, field.height);
    let (mut square, mut fourth, mut count) = (0.0, 0.0, 0.0);
    for y in 0..h.saturating_sub(1) {
        for x in 0..w.saturating_sub(1) {
            let i = y * w + x;
            if field.mask[i] * field.mask[i + 1] * field.mask[i + w] == 0.0 {
                continue;
            }
            let right = (field.values[i + 1] - field.values[i]).norm_sqr();
            let down = (field.values[i + w] - field.values[i]).norm_sqr();
            let slope = f64::from(right + down);
            (square, fourth, count) = (square + slope, fourth + slope * slope, count + 1.0);
        }
    }
    if square > 0.0 { fourth * count / (square * square) } else { 0.0 }
}

//! Repetition in parts of a picture, for sheets with margins, on a dark table, or in oblique view.
//!
//! A margin or table differs in brightness from all print, so that it dominates the autocorrelation of the whole
//! picture. Perspective varies the size of copies. In both cases a part of the picture still reveals the tile. From
//! there, copies are followed from neighbour to neighbour.

use super::repeats::{Repeats, repeats};
use nacre_image::Field;
use std::collections::{BTreeMap, VecDeque};

/// Sides of the parts relative to the picture, and positions of their centres: -1 to 1 over the remaining space.
const PARTS: [(f64, &[[f64; 2]]); 4] = [
    (0.82, &[[0.0, 0.0]]),
    (0.66, &[[0.0, 0.0], [-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]]),
    (0.5, &[[0.0, 0.0], [-0.5, -0.5], [0.5, -0.5], [-0.5, 0.5], [0.5, 0.5]]),
    (0.36, &[[0.0, 0.0]]),
];

/// Correlation above which a tile of the whole picture is accepted without a search in its parts.
const CERTAIN: f64 = 0.75;

/// Minimum correlation and number of copies of a tile in a part.
const ALIKE: f64 = 0.5;
const IN_PART: f64 = 4.0;

/// Maximum deviation of a copy from its expected position, relative to the tile's size.
const ASTRAY: f64 = 0.07;

/// Minimum correlation of a copy with its neighbour, and number of quarters of a copy that must reach it. Fewer
/// quarters do so if half of the copy lies in a margin.
const COPY: f64 = 0.55;
const QUARTERS: usize = 3;

/// Minimum number of copies of a tile found in a part.
const FEWEST: usize = 6;

/// Maximum number of copies followed, and number of pixels compared along each axis of a tile.
const MOST: usize = 4000;
const COMPARED: f64 = 28.0;

/// Minimum side of a tile in pixels; smaller tiles have no pattern to compare.
const SHORTEST: f64 = 6.0;

/// A rectangle: left, top, width, height in pixels.
pub(super) type Part = [usize; 4];

/// The tile of a picture and the part that shows it best, or the whole picture. `of` computes the field of a part.
pub(super) fn tile(size: [usize; 2], scale: f64, of: &dyn Fn(Part) -> Field) -> (Option<Repeats>, Part) {
    let all = [0, 0, size[0], size[1]];
    let whole = of(all);
    let counted = |found: Repeats, part: Part| {
        let middle = [0, 1].map(|k| part[k] as f64 + 0.5 * part[k + 2] as f64);
        copies(&whole, found.sides_px.map(|v| v.map(|d| d / scale)), middle).map(|copies| Repeats { copies, ..found })
    };
    // Margins have room for copies but contain none.
    let first = repeats(&whole, scale)
        .map(|room| counted(room, all).map_or(room, |seen| Repeats { copies: seen.copies.min(room.copies), ..room }));
    if first.is_some_and(|r| r.likeness >= CERTAIN) {
        return (first, all);
    }
    let mut best = (first, all);
    for part in parts(size) {
        let field = of(part);
        let Some(found) = repeats(&field, scale).filter(|r| r.likeness >= ALIKE && r.copies >= IN_PART) else {
            continue;
        };
        if found.likeness <= best.0.map_or(0.0, |r| r.likeness) {
            continue;
        }
        // Fewer copies in a part do not replace a tile of the whole picture.
        let enough = |r: &Repeats| r.copies >= 0.5 * best.0.map_or(0.0, |r| r.copies);
        if let Some(found) = counted(found, part).filter(enough) {
            best = (Some(found), part);
        }
    }
    best
}

fn parts([width, height]: [usize; 2]) -> impl Iterator<Item = Part> {
    PARTS.iter().flat_map(move |(side, places)| {
        places.iter().map(move |place| {
            let along = |k: usize, n: usize| {
                let rest = n as f64 * (1.0 - side);
                [(0.5 * rest * (1.0 + place[k])) as usize, (n as f64 * side) as usize]
            };
            let ([x, w], [y, h]) = (along(0, width), along(1, height));
            [x, y, w, h]
        })
    })
}

/// Number of visible copies, starting from the centre of a part. It counts copies that are found side by side, and the
/// visible fraction of neighbours cut by the border. `None` for fewer than [`FEWEST`] copies.
fn copies(field: &Field, sides: [[f64; 2]; 2], middle: [f64; 2]) -> Option<f64> {
    let found = followed(field, sides, middle);
    let size = extent(sides);
    let inside = |at: [f64; 2]| {
        let along = |k: usize, most: usize| {
            let [low, high] = [-0.5, 0.5].map(|side| (at[k] + side * size[k]).clamp(0.0, most as f64));
            (high - low) / size[k]
        };
        along(0, field.width) * along(1, field.height)
    };
    let mut cut = BTreeMap::new();
    for (cell, at) in &found {
        for step in (-1..=1).flat_map(|m| (-1..=1).map(move |n| [m, n])) {
            let next = [cell[0] + step[0], cell[1] + step[1]];
            let place = [0, 1].map(|k| at[k] + step[0] as f64 * sides[0][k] + step[1] as f64 * sides[1][k]);
            let part = inside(place);
            if part < 1.0 && !found.contains_key(&next) {
                cut.insert(next, part);
            }
        }
    }
    (found.len() >= FEWEST).then(|| found.len() as f64 + cut.values().sum::<f64>())
}

/// Width and height of a tile's bounding box.
fn extent(sides: [[f64; 2]; 2]) -> [f64; 2] {
    [0, 1].map(|k| sides[0][k].abs() + sides[1][k].abs())
}

/// Positions of adjacent copies by their lattice steps from the first; ordered, so that sums over them are
/// reproducible.
fn followed(field: &Field, sides: [[f64; 2]; 2], middle: [f64; 2]) -> BTreeMap<[i64; 2], [f64; 2]> {
    let length = |v: [f64; 2]| v[0].hypot(v[1]);
    if sides.iter().any(|s| length(*s) < SHORTEST) {
        return BTreeMap::new();
    }
    let mut found = BTreeMap::from([([0_i64, 0_i64], middle)]);
    let mut queue = VecDeque::from([([0_i64, 0_i64], middle, sides)]);
    while let Some((cell, at, sides)) = queue.pop_front() {
        for (step, axis, sign) in [([1, 0], 0, 1.0), ([-1, 0], 0, -1.0), ([0, 1], 1, 1.0), ([0, -1], 1, -1.0)] {
            let next = [cell[0] + step[0], cell[1] + step[1]];
            if found.contains_key(&next) || found.len() >= MOST {
                continue;
            }
            let expected = [0, 1].map(|k| at[k] + sign * sides[axis][k]);
            let Some(place) = copy(field, at, expected, sides) else { continue };
            // Perspective changes the lattice vectors from copy to copy.
            let mut changed = sides;
            changed[axis] = [0, 1].map(|k| sign * (place[k] - at[k]));
            found.insert(next, place);
            queue.push_back((next, place, changed));
        }
    }
    found
}

/// Position near `near` with the best match of the tile at `from`; `None` if the correlation is too low or the tile
/// leaves the picture.
fn copy(field: &Field, from: [f64; 2], near: [f64; 2], sides: [[f64; 2]; 2]) -> Option<[f64; 2]> {
    let size = extent(sides);
    let reach = (ASTRAY * size[0].max(size[1])).ceil().max(1.0);
    let coarse = (reach / 4.0).ceil();
    let of = |to: [f64; 2]| likeness(field, from, to, size).map(|l| (to, l));
    let around = |at: [f64; 2], reach: f64, step: f64| {
        let n = (reach / step).round() as i64;
        let all = (-n..=n).flat_map(|y| (-n..=n).map(move |x| [x, y]));
        let places = all.map(|[x, y]| [at[0] + x as f64 * step, at[1] + y as f64 * step]);
        places.filter_map(of).max_by(|a, b| a.1.total_cmp(&b.1))
    };
    let (at, _) = around(near, reach, coarse)?;
    let (at, alike) = if coarse > 1.0 { around(at, coarse - 1.0, 1.0)? } else { around(at, 0.0, 1.0)? };
    let quarter = size.map(|s| 0.5 * s);
    let is_alike = |[right, down]: [f64; 2]| {
        let [a, b] = [from, at].map(|p| [p[0] + 0.5 * right * quarter[0], p[1] + 0.5 * down * quarter[1]]);
        likeness(field, a, b, quarter).is_some_and(|l| l >= COPY)
    };
    let quarters = [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]].into_iter().filter(|q| is_alike(*q)).count();
    (alike >= COPY && quarters >= QUARTERS).then_some(at)
}

/// Correlation of two rectangles centred at two positions; `None` unless both lie in the picture.
fn likeness(field: &Field, a: [f64; 2], b: [f64; 2], size: [f64; 2]) -> Option<f64> {
    let inside = |at: [f64; 2]| {
        at[0] - 0.5 * size[0] >= 0.0
            && at[1] - 0.5 * size[1] >= 0.0
            && at[0] + 0.5 * size[0] < field.width as f64
            && at[1] + 0.5 * size[1] < field.height as f64
    };
    if !inside(a) || !inside(b) {
        return None;
    }
    let step = size.map(|s| (s / COMPARED).max(1.0));
    let count = [0, 1].map(|k| (size[k] / step[k]) as usize);
    let pixel = |at: [f64; 2], i: usize, j: usize| {
        let x = (at[0] - 0.5 * size[0] + i as f64 * step[0]) as usize;
        let y = (at[1] - 0.5 * size[1] + j as f64 * step[1]) as usize;
        y.min(field.height - 1) * field.width + x.min(field.width - 1)
    };
    // Sums of weights, values (real and imaginary parts), their squares and their product.
    let mut sums = [0.0_f64; 8];
    for j in 0..count[1] {
        for i in 0..count[0] {
            let (p, q) = (pixel(a, i, j), pixel(b, i, j));
            if field.mask[p] * field.mask[q] == 0.0 {
                continue;
            }
            let (u, v) = (field.values[p], field.values[q]);
            let both = u * v.conj();
            let terms = [1.0, u.re, u.im, v.re, v.im, u.norm_sqr(), v.norm_sqr(), both.re];
            (0..8).for_each(|k| sums[k] += f64::from(terms[k]));
        }
    }
    let [n, ur, ui, vr, vi, uu, vv, uv] = sums;
    if n < 0.5 * (count[0] * count[1]) as f64 {
        return None;
    }
    let (su, sv) = (uu - (ur * ur + ui * ui) / n, vv - (vr * vr + vi * vi) / n);
    (su > 0.0 && sv > 0.0).then(|| (uv - (ur * vr + ui * vi) / n) / (su * sv).sqrt())
}

#[cfg(test)]
#[path = "windows_tests.rs"]
mod tests;

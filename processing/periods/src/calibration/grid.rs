//! Selection of the candidates that form the board.

use super::candidates::{Candidate, apart};
use std::collections::{HashMap, HashSet, VecDeque};
use std::f64::consts::FRAC_PI_2;

/// Tolerance in rad for the opposite contrast of adjacent corners, since perspective shears squares.
const ACROSS: f64 = 0.7;

/// Search radius around the expected position of a corner, relative to the step to it.
const NEAR: f64 = 0.3;

/// Maximum number of seeds from which grids are grown.
const SEEDS: usize = 240;

/// Description of the failure, as text.
pub(super) type Problem = String;

/// Candidates of a grid by column and row.
type Cells = HashMap<[i32; 2], usize>;

/// Finds a grid of `columns × rows` corners. Returns indices, row by row, in one of the grid's orientations.
pub(super) fn find(all: &[Candidate], columns: usize, rows: usize) -> Result<Vec<usize>, Problem> {
    let mut seen = HashSet::new();
    let mut largest = 0;
    let mut extent = [0, 0];
    for seed in (0..all.len()).filter(|s| all[*s].strength > 0.0).take(SEEDS) {
        if seen.contains(&seed) {
            continue;
        }
        let Some(cells) = grow(all, seed) else { continue };
        seen.extend(cells.values().copied());
        match window(all, &cells, columns, rows)? {
            Some(found) => return Ok(found),
            None if cells.len() > largest => {
                largest = cells.len();
                let (low, high) = bounds(&cells);
                extent = [high[0] - low[0] + 1, high[1] - low[1] + 1];
            }
            None => {}
        }
    }
    if largest < 4 {
        return Err("shows no board".into());
    }
    let [a, b] = extent;
    Err(format!("shows {largest} corners of a grid of {} × {}", a.max(b), a.min(b)))
}

fn bounds(cells: &Cells) -> ([i32; 2], [i32; 2]) {
    let fold = |axis: usize, pick: fn(i32, i32) -> i32, start: i32| cells.keys().map(|c| c[axis]).fold(start, pick);
    (
        [fold(0, i32::min, i32::MAX), fold(1, i32::min, i32::MAX)],
        [fold(0, i32::max, i32::MIN), fold(1, i32::max, i32::MIN)],
    )
}

/// The board within a grid. Additional corners around it would indicate another board.
fn window(all: &[Candidate], cells: &Cells, columns: usize, rows: usize) -> Result<Option<Vec<usize>>, Problem> {
    let (low, high) = bounds(cells);
    let mut best: Option<(f32, Vec<usize>)> = None;
    let mut count = 0;
    let shapes = if columns == rows { vec![[columns, rows]] } else { vec![[columns, rows], [rows, columns]] };
    for [wide, tall] in shapes {
        for top in low[1]..=high[1] + 1 - tall as i32 {
            for left in low[0]..=high[0] + 1 - wide as i32 {
                // Row by row of the board, in either orientation.
                let cell = |k: usize| {
                    let (column, row) = ((k % columns) as i32, (k / columns) as i32);
                    let turned = wide != columns;
                    let place = if turned { [left + row, top + column] } else { [left + column, top + row] };
                    cells.get(&place).copied()
                };
                let Some(found) = (0..columns * rows).map(cell).collect::<Option<Vec<usize>>>() else { continue };
                count += 1;
                let weakest = found.iter().map(|i| all[*i].strength).fold(f32::MAX, f32::min);
                if best.as_ref().is_none_or(|(other, _)| weakest > *other) {
                    best = Some((weakest, found));
                }
            }
        }
    }
    if count > 1 {
        return Err(format!("shows a board of more than {columns} × {rows} inner corners"));
    }
    Ok(best.map(|b| b.1))
}

fn minus(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0] - b[0], a[1] - b[1]]
}

fn length(a: [f64; 2]) -> f64 {
    a[0].hypot(a[1])
}

/// True if two corners can be adjacent: one is bright where the other is dark.
fn across(a: &Candidate, b: &Candidate) -> bool {
    apart(a.bright, b.bright + FRAC_PI_2) < ACROSS
}

/// Grows the grid that contains a corner.
fn grow(all: &[Candidate], seed: usize) -> Option<Cells> {
    let from = all[seed].place;
    let mut near: Vec<usize> = (0..all.len()).filter(|i| *i != seed && across(&all[seed], &all[*i])).collect();
    let distance = |i: &usize| length(minus(all[*i].place, from));
    near.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    let first = *near.first()?;
    let u = minus(all[first].place, from);
    let sideways = |i: &&usize| {
        let v = minus(all[**i].place, from);
        (u[0] * v[1] - u[1] * v[0]).abs() > 0.4 * length(u) * length(v)
    };
    let second = *near.iter().find(sideways)?;
    let v = minus(all[second].place, from);
    if length(v) > 4.0 * length(u) {
        return None;
    }
    let mut cells: Cells = HashMap::from([([0, 0], seed), ([1, 0], first), ([0, 1], second)]);
    let mut used: HashSet<usize> = [seed, first, second].into();
    let mut queue = VecDeque::from([[0, 0], [1, 0], [0, 1]]);
    while let Some(cell) = queue.pop_front() {
        for step in [[1, 0], [-1, 0], [0, 1], [0, -1]] {
            let next = [cell[0] + step[0], cell[1] + step[1]];
            if cells.contains_key(&next) || cells.len() > 2000 {
                continue;
            }
            let Some((expected, size)) = expected(all, &cells, cell, step, [u, v]) else { continue };
            let here = all[cells[&cell]];
            let off = |i: usize| length(minus(all[i].place, expected));
            let fits = |i: &usize| !used.contains(i) && off(*i) < NEAR * size && across(&here, &all[*i]);
            let found = (0..all.len()).filter(fits).min_by(|a, b| off(*a).total_cmp(&off(*b)));
            if let Some(found) = found {
                cells.insert(next, found);
                used.insert(found);
                queue.push_back(next);
            }
        }
    }
    Some(cells)
}

/// Expected position of the next corner, and length of the step. Extrapolated from the previous two, or taken from a
/// neighbouring row, or from the seed.
fn expected(
    all: &[Candidate],
    cells: &Cells,
    cell: [i32; 2],
    step: [i32; 2],
    axes: [[f64; 2]; 2],
) -> Option<([f64; 2], f64)> {
    let at = |place: [i32; 2]| cells.get(&place).map(|i| all[*i].place);
    let here = at(cell)?;
    let shift = |by: [f64; 2]| Some(([here[0] + by[0], here[1] + by[1]], length(by)));
    if let Some(before) = at([cell[0] - step[0], cell[1] - step[1]]) {
        return shift(minus(here, before));
    }
    for side in [[step[1], step[0]], [-step[1], -step[0]]] {
        let beside = [cell[0] + side[0], cell[1] + side[1]];
        if let (Some(a), Some(b)) = (at(beside), at([beside[0] + step[0], beside[1] + step[1]])) {
            return shift(minus(b, a));
        }
    }
    let axis = if step[0] != 0 { axes[0] } else { axes[1] };
    let sign = f64::from(step[0] + step[1]);
    shift([sign * axis[0], sign * axis[1]])
}

//! Detection of the inner corners of a chessboard, to a few hundredths of a pixel.

use super::candidates::{Candidate, candidates};
use super::grid;
use super::subpixel::refine;
use nacre_base::{Error, Result};
use nacre_image::Gray;

/// Longer side in pixels of the pyramid level where the search begins; corners are refined at full resolution.
const SIDE: usize = 900;

/// Minimum distance of adjacent corners in pixels.
const SMALLEST: f64 = 6.0;

/// A chessboard.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Board {
    /// Inner corners along a row.
    pub columns: usize,
    /// Inner corners along a column.
    pub rows: usize,
    /// Side of a square in mm.
    pub square_mm: f64,
}

impl Board {
    /// Validates the board.
    ///
    /// # Errors
    /// `Input`.
    pub fn check(&self) -> Result<()> {
        if ![self.columns, self.rows].iter().all(|n| (2..=64).contains(n)) || self.columns * self.rows < 6 {
            let problem = format!("is {} × {}", self.columns, self.rows);
            return Err(Error::input("board", problem, "give its inner corners, such as 9x6: 2 to 64 along a side"));
        }
        if !(1e-3..=1e5).contains(&self.square_mm) {
            let problem = format!("is {}", self.square_mm);
            return Err(Error::input("square-mm", problem, "give the side of a square, 0.001 to 100000 mm"));
        }
        Ok(())
    }

    /// Corner positions in mm, row by row from the upper left: x right, y up, z towards the viewer, origin in the
    /// centre.
    pub fn places(&self) -> Vec<[f64; 2]> {
        let middle = [0.5 * (self.columns - 1) as f64, 0.5 * (self.rows - 1) as f64];
        let place = |k: usize| {
            let (column, row) = ((k % self.columns) as f64, (k / self.columns) as f64);
            [(column - middle[0]) * self.square_mm, (middle[1] - row) * self.square_mm]
        };
        (0..self.columns * self.rows).map(place).collect()
    }

    /// True if the board is asymmetric under rotation by 180°: squares in opposite corners differ in colour.
    pub fn has_a_top(&self) -> bool {
        (self.columns + self.rows) % 2 == 1
    }
}

/// View of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// Direct view.
    Direct,
    /// View in a mirror.
    Mirrored,
}

/// Finds the corners of a board, row by row from its upper left, in pixels from the left and the top of the photograph.
///
/// The upper left is the end with a dark outermost square. If both ends have one (see [`Board::has_a_top`]), it is the
/// end further up or further left in the photograph.
///
/// # Errors
/// The reason, as text, why the photograph cannot be used.
pub fn find(image: &Gray, board: &Board, view: View) -> std::result::Result<Vec<[f64; 2]>, String> {
    let mut levels = vec![image.clone()];
    while let Some(last) = levels.last().filter(|l| l.width.max(l.height) > SIDE / 2 && l.width.min(l.height) >= 128) {
        let half = last.halved();
        levels.push(half);
    }
    // From the pyramid level nearest to the usual size to finer levels, then to coarser ones.
    let start = levels.iter().position(|l| l.width.max(l.height) <= SIDE).unwrap_or(0);
    let order = (0..=start).rev().chain(start + 1..levels.len());
    let mut problem: Option<String> = None;
    for level in order {
        let all = candidates(&levels[level]);
        match grid::find(&all, board.columns, board.rows) {
            Ok(found) => {
                let found: Vec<Candidate> = found.into_iter().map(|i| all[i]).collect();
                return finish(image, board, view, &found, level);
            }
            Err(words) => {
                problem.get_or_insert(words);
            }
        }
    }
    Err(problem.unwrap_or_else(|| "is too small".into()))
}

/// Orders and refines the corners.
fn finish(
    image: &Gray,
    board: &Board,
    view: View,
    found: &[Candidate],
    level: usize,
) -> std::result::Result<Vec<[f64; 2]>, String> {
    let scale = (1_usize << level) as f64;
    // A pixel of a coarse level covers several pixels; its centre is theirs.
    let places: Vec<[f64; 2]> = found.iter().map(|c| c.place.map(|p| (p + 0.5) * scale - 0.5)).collect();
    let order = ordered(board, view, found);
    let places: Vec<[f64; 2]> = order.into_iter().map(|i| places[i]).collect();
    let mut refined = Vec::with_capacity(places.len());
    for (k, place) in places.iter().enumerate() {
        let spacing = nearest(&places, k);
        if spacing < SMALLEST {
            return Err(format!("shows the board too small: {spacing:.1} pixels from corner to corner"));
        }
        let at = refine(image, *place, spacing)
            .ok_or_else(|| format!("has a corner that cannot be placed at {:.0}, {:.0}", place[0], place[1]))?;
        refined.push(at);
    }
    Ok(refined)
}

/// Distance to the nearest other corner.
fn nearest(places: &[[f64; 2]], k: usize) -> f64 {
    let off = |p: &[f64; 2]| (p[0] - places[k][0]).hypot(p[1] - places[k][1]);
    places.iter().enumerate().filter(|(i, _)| *i != k).map(|(_, p)| off(p)).fold(f64::MAX, f64::min)
}

/// Indices of the candidates in the board's order.
fn ordered(board: &Board, view: View, found: &[Candidate]) -> Vec<usize> {
    let (columns, rows) = (board.columns, board.rows);
    let at = |column: usize, row: usize| found[row * columns + column].place;
    let [along, down] = [at(columns - 1, 0), at(0, rows - 1)].map(|p| [p[0] - at(0, 0)[0], p[1] - at(0, 0)[1]]);
    // Rows grow downwards, so this is positive in a direct view and negative in a mirror.
    let right_handed = along[0] * down[1] - along[1] * down[0] > 0.0;
    let flip = right_handed != (view == View::Direct);
    // Index in `found` of the board's corner `k`.
    let place = |k: usize, turned: bool| {
        let (mut column, mut row) = (k % columns, k / columns);
        if turned {
            (column, row) = (columns - 1 - column, rows - 1 - row);
        }
        if flip {
            row = rows - 1 - row;
        }
        row * columns + column
    };
    let dark_outside = |turned: bool| {
        let [corner, right, below] = [0, 1, columns].map(|k| &found[place(k, turned)]);
        let inwards = [0, 1].map(|k| right.place[k] + below.place[k] - 2.0 * corner.place[k]);
        let diagonal = inwards[1].atan2(inwards[0]);
        // Bright across the diagonal: the squares on the diagonal, including the outermost one, are dark.
        super::candidates::apart(corner.bright, diagonal) > std::f64::consts::FRAC_PI_4
    };
    let turned = if board.has_a_top() {
        !dark_outside(false)
    } else {
        let [a, b] = [false, true].map(|t| found[place(0, t)].place);
        b[0] + b[1] < a[0] + a[1]
    };
    (0..columns * rows).map(|k| place(k, turned)).collect()
}

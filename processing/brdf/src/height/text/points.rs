//! Points x y z on a regular grid in any order, and profiles x z.

use super::super::formats::fault::Fault;
use super::super::stored::{Pitch, Stored};
use super::super::{MAX_PIXELS, MAX_SIDE};
use super::table::Table;

/// Largest deviation of a coordinate from the grid, in steps, for rounded coordinates.
const OFF: f64 = 0.05;

/// Largest number of columns of a list of points.
const MAX_COLUMNS: usize = 12;

/// Remedy for points that are not a grid.
const REMEDY: &str = "resample the points to a regular grid, and export a matrix or all points x y z";

/// Heights of a list of points or a profile; `None` for a matrix.
pub(super) fn of(table: &Table, width: usize) -> Result<Option<Stored>, Fault> {
    let rows = table.values.len() / width.max(1);
    let stated = table.header.columns == Some(width);
    let named = |axis: char| table.header.names.iter().position(|c| c.axis == axis);
    let names = table.header.names.len() == width;
    if width != table.width || width > MAX_COLUMNS || stated || table.values.is_empty() {
        return Ok(None);
    }
    match (named('x'), named('y'), named('z')) {
        (Some(x), Some(y), Some(z)) if names => return grid(table, [x, y, z]).map(Some),
        (Some(x), None, Some(z)) if names => return profile(table, [x, z]).map(Some),
        _ => {}
    }
    // If the header states both sizes of an image, it is a matrix, however narrow.
    let narrow = |fault| if table.header.is_sized() { Ok(None) } else { Err(fault) };
    match width {
        1 if rows > 1 => {
            let problem = format!("holds one column of {rows} numbers, and does not say where rows end");
            Err(Fault::unsupported(problem, "write rows, or columns and rows in the header (ncols, nrows)"))
        }
        2 if rows > 2 => profile(table, [0, 1]).map(Some).or_else(narrow),
        3 if rows > 3 => grid(table, [0, 1, 2]).map(Some).or_else(narrow),
        // More columns than coordinates: refused rather than read as a narrow matrix.
        4.. if rows > width && is_grid(table, width) => {
            let problem = format!("holds points of {width} numbers without names");
            Err(Fault::unsupported(problem, "keep the columns x, y and z, or name the columns"))
        }
        _ => Ok(None),
    }
}

/// Whether the first two columns contain all positions of a grid.
fn is_grid(table: &Table, width: usize) -> bool {
    let column = |k: usize| Axis::of(table.values.chunks_exact(width).map(|row| row[k]));
    match (column(0), column(1)) {
        (Some(x), Some(y)) => x.count > 1 && y.count > 1 && x.count * y.count == table.values.len() / width,
        _ => false,
    }
}

/// Evenly spaced coordinates.
struct Axis {
    from: f64,
    step: f64,
    count: usize,
}

impl Axis {
    /// Axis of the distinct values of a coordinate; `None` if they are not evenly spaced.
    fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut sorted: Vec<f64> = values.collect();
        if sorted.is_empty() || sorted.iter().any(|v| !v.is_finite()) {
            return None;
        }
        sorted.sort_unstable_by(f64::total_cmp);
        let (from, to) = (sorted[0], sorted[sorted.len() - 1]);
        sorted.dedup_by(|b, a| (*b - *a).abs() <= 1e-9 * (to - from));
        let count = sorted.len();
        let step = if count > 1 { (to - from) / (count as f64 - 1.0) } else { 0.0 };
        let even = |(k, v): (usize, &f64)| (v - from - k as f64 * step).abs() <= OFF * step;
        sorted.iter().enumerate().all(even).then_some(Self { from, step, count })
    }

    fn index(&self, value: f64) -> usize {
        if self.count > 1 { ((value - self.from) / self.step).round() as usize } else { 0 }
    }
}

/// µm per unit of a column; the header's plain unit applies to all columns.
fn unit(table: &Table, column: usize) -> Option<f64> {
    let names = &table.header.names;
    (names.len() == table.width).then(|| names[column].unit_um).flatten()
}

/// Converts columns x, y, z to rows from the top, y upwards.
fn grid(table: &Table, [x, y, z]: [usize; 3]) -> Result<Stored, Fault> {
    let rows = || table.values.chunks_exact(table.width);
    let irregular = |problem: String| Fault::unsupported(problem, REMEDY);
    let axis = |k: usize, name: &str| {
        let axis = Axis::of(rows().map(|row| row[k]));
        axis.ok_or_else(|| irregular(format!("holds points x y z whose {name} are not evenly spaced")))
    };
    let (across, up) = (axis(x, "x")?, axis(y, "y")?);
    let (width, height) = (across.count, up.count);
    let size = width.saturating_mul(height);
    let points = rows().len();
    if width < 2 || width.max(height) > MAX_SIDE || size > MAX_PIXELS || size > points.saturating_mul(2) {
        let problem = format!(
            "holds {points} points x y z at {width} different x and {height} different y, which are no regular grid"
        );
        return Err(irregular(problem));
    }
    let mut values = vec![f64::NAN; size];
    let mut seen = vec![false; size];
    for row in rows() {
        let at = (height - 1 - up.index(row[y])) * width + across.index(row[x]);
        if std::mem::replace(&mut seen[at], true) {
            return Err(irregular(format!("holds two points at x {}, y {}", row[x], row[y])));
        }
        values[at] = row[z];
    }
    let unit_x = unit(table, x).or(unit(table, y));
    let down = if height > 1 { up.step } else { across.step };
    let pitch = pitch(unit_x, [across.step, down]);
    let missing = seen.iter().filter(|s| !**s).count();
    let gaps = (missing > 0).then(|| "have no point".to_owned());
    let note = format!("points x y z on a grid of {width} x {height}, y upwards");
    Ok(Stored {
        width,
        rows: height,
        values,
        pitch,
        unit_um: unit(table, z),
        notes: vec![note],
        gaps,
        ..Stored::default()
    })
}

fn pitch(unit: Option<f64>, step: [f64; 2]) -> Pitch {
    match unit {
        Some(unit) => Pitch::Um(step.map(|s| s * unit)),
        None => Pitch::Bare(step),
    }
}

/// Converts columns x and z to one row.
fn profile(table: &Table, [x, z]: [usize; 2]) -> Result<Stored, Fault> {
    let rows = || table.values.chunks_exact(table.width);
    let axis = Axis::of(rows().map(|row| row[x])).filter(|axis| axis.count == rows().len() && axis.count > 1);
    let Some(axis) = axis else {
        let problem = "holds two columns whose first is not evenly spaced: no profile x z, and too narrow for a matrix";
        return Err(Fault::unsupported(problem, "resample the profile to even steps"));
    };
    let mut values = vec![f64::NAN; axis.count];
    for row in rows() {
        values[axis.index(row[x])] = row[z];
    }
    let note = format!("profile of {} points x z", axis.count);
    let pitch = pitch(unit(table, x), [axis.step; 2]);
    Ok(Stored {
        width: axis.count,
        rows: 1,
        values,
        pitch,
        unit_um: unit(table, z),
        notes: vec![note],
        ..Stored::default()
    })
}

//! Grids, points and profiles as text.

pub(super) mod encoding;
mod header;
mod keys;
mod number;
mod points;
mod table;
#[cfg(test)]
mod tests;
pub(super) mod unit;

use super::formats::fault::Fault;
use super::read::Scale;
use super::stored::{Pitch, Stored, ends};
use header::Header;
use nacre_base::{Error, Result};
use std::path::Path;
use table::Table;

/// Values that programs write for missing measurements.
const SENTINELS: &[f64] = &[
    -9999.0,
    -99999.0,
    -999999.0,
    -999.25,
    9999.0,
    99999.0,
    -32768.0,
    32767.0,
    -2_147_483_648.0,
    2_147_483_647.0,
    1.701_41e38,
    1e30,
    -1e30,
    1e31,
    -1e31,
    1e38,
    -1e38,
    9.969_21e36,
    3.402_823e38,
    -3.402_823e38,
    1e300,
    -1e300,
    1e10,
    -1e10,
    1e20,
    -1e20,
];

/// Smallest distance of such a value from all others, relative to their spread.
const AWAY: f64 = 5.0;

/// Remedy for ambiguous text.
const REMEDY: &str = "export the heights as a matrix of numbers with decimal points, one row a line, separated by blanks, tabs or semicolons";

/// Reads a grid of numbers, points x y z on a grid, or a profile.
pub(super) fn read(path: &Path, bytes: &[u8], scale: &Scale) -> Result<Stored> {
    let (text, encoding) = encoding::decode(bytes).map_err(|fault| fault.of(path, "text file"))?;
    let kinds =
        "give a PNG, TIFF, JPEG, BMP or EXR image, a file of an AFM or profilometer, or rows of heights as text";
    if encoding::is_binary(&text) {
        let problem = "is of no format that Nacre knows, neither an image nor a grid of numbers";
        return Err(Error::file(path, problem, kinds));
    }
    let table = Table::read(&text, scale.range_um.is_some()).map_err(|problem| {
        let remedy = if problem.starts_with("is neither") || problem.starts_with("line") { kinds } else { REMEDY };
        Error::file(path, problem, remedy)
    })?;
    drop(text);
    let mut stored = interpret(table).map_err(|fault| match fault {
        Fault::Damaged(problem) => Error::file(path, problem, "copy or export the file again"),
        Fault::Truncated(problem) => Error::file(path, problem, "copy or export the whole file again"),
        Fault::Unsupported(problem, remedy) => Error::file(path, problem, remedy),
    })?;
    if let Some(encoding) = encoding {
        stored.notes.push(format!("text in {encoding}"));
    }
    Ok(stored)
}

fn interpret(mut table: Table) -> std::result::Result<Stored, Fault> {
    if let Some(problem) = table.header.problem.take() {
        return Err(Fault::unsupported(
            format!("has a header that {problem}"),
            "correct the header, or remove it and give flags",
        ));
    }
    let header = &table.header.clone();
    let decimal = table.style.map(|style| style.decimal);
    if let (Some(number), false, Some('.')) = (&header.ambiguous, header.decimal_comma, decimal) {
        let problem = format!("has a header whose number is read as decimal or as thousands: {number}");
        return Err(Fault::unsupported(problem, "write it with a decimal point and without thousands separators"));
    }
    let whole = header.columns.zip(header.rows).filter(|(c, r)| c.checked_mul(*r) == Some(table.values.len()));
    let width = match (whole, table.ragged) {
        // One line, or wrapped lines: the header states the length of rows.
        (Some((columns, _)), _) => columns,
        (None, Some((line, found, before))) => {
            return Err(Fault::damaged(format!("line {line} has {found} heights, those before {before}")));
        }
        (None, None) => table.width,
    };
    let mut stored = match points::of(&table, width)? {
        Some(stored) => stored,
        None => {
            let values = std::mem::take(&mut table.values);
            matrix(&table, values, width)?
        }
    };
    units(header, &mut stored)?;
    gaps(header, &mut stored)?;
    if table.style.is_some_and(|style| style.decimal == ',') {
        stored.notes.push("numbers with decimal commas".into());
    }
    if let Some(channel) = &header.channel {
        stored.notes.push(format!("channel {channel}"));
    }
    Ok(stored)
}

/// Matrix of pixels.
fn matrix(table: &Table, values: Vec<f64>, width: usize) -> std::result::Result<Stored, Fault> {
    let header = &table.header;
    let rows = values.len() / width.max(1);
    if table.blocks > 1 && width == table.width {
        let problem = format!("holds {} blocks of rows with blank lines between", table.blocks);
        return Err(Fault::unsupported(problem, "keep one table of heights"));
    }
    for (name, stated, found) in [("columns", header.columns, width), ("rows", header.rows, rows)] {
        if let Some(stated) = stated.filter(|stated| *stated != found) {
            return Err(Fault::damaged(format!("has {found} {name} where its header says {stated}")));
        }
    }
    match table.stated[..] {
        [] => {}
        [a, b] if [[a, b], [b, a]].contains(&[width as f64, rows as f64]) => {}
        [a] if a == rows as f64 || a == values.len() as f64 => {}
        _ => {
            let first = table.stated.len();
            return Err(Fault::damaged(format!("line 2 has {width} heights, those before {first}")));
        }
    }
    // A stated size leaves no room for coordinates.
    if !header.is_sized() && header.columns.is_none() {
        coordinates(&values, width, rows)?;
    }
    Ok(Stored { width, rows, pitch: pitch(header, width, rows), values, ..Stored::default() })
}

/// Refuses a first column or row of indices or coordinates.
fn coordinates(values: &[f64], width: usize, rows: usize) -> std::result::Result<(), Fault> {
    // Column and row 0 may share a corner without a number.
    let column = |x: usize, from: usize| (from..rows).map(move |y| values[y * width + x]);
    let row = |y: usize, from: usize| (from..width).map(move |x| values[y * width + x]);
    let remedy = "remove it, and give the pitch with --pixel-um";
    for from in [0, 1] {
        if rows >= 3 + from && width >= 3 && runs(column(0, from)) && !alike(column(0, from), column(1, from)) {
            let problem =
                "has a first column that runs evenly, as an index or coordinates do, beside others that do not";
            return Err(Fault::unsupported(problem, remedy));
        }
        if width >= 3 + from && rows >= 2 && runs(row(0, from)) && !alike(row(0, from), row(1, from)) {
            let problem = "has a first row that runs evenly, as an index or coordinates do, above others that do not";
            return Err(Fault::unsupported(problem, remedy));
        }
    }
    Ok(())
}

/// Whether numbers are evenly spaced.
fn runs(values: impl Iterator<Item = f64> + Clone) -> bool {
    let count = values.clone().count();
    let (Some(first), Some(last)) = (values.clone().next(), values.clone().last()) else { return false };
    let step = (last - first) / (count as f64 - 1.0);
    // Few numbers may be evenly spaced by chance.
    let tolerance = step.abs() * if count < 8 { 1e-6 } else { 0.02 };
    step != 0.0 && values.enumerate().all(|(k, v)| (v - first - k as f64 * step).abs() <= tolerance)
}

/// Whether most steps of two sequences are equal.
fn alike(one: impl Iterator<Item = f64> + Clone, other: impl Iterator<Item = f64> + Clone) -> bool {
    let pairs = one.clone().zip(one.skip(1)).zip(other.clone().zip(other.skip(1)));
    let (mut same, mut all) = (0, 0);
    for ((a, b), (c, d)) in pairs {
        all += 1;
        same += usize::from((d - c - (b - a)).abs() <= 0.02 * (b - a).abs());
    }
    2 * same > all
}

/// Pitch stated by a header for a grid.
fn pitch(header: &Header, width: usize, rows: usize) -> Pitch {
    let across = header.width_um.map(|um| um / width as f64);
    let down = header.height_um.map(|um| um / rows as f64);
    let size = header.size_um.filter(|_| width == rows).map(|um| um / width as f64);
    if let Some(own) = header.pitch_um[0] {
        return Pitch::Um([own, header.pitch_um[1].unwrap_or(own)]);
    }
    match (across, down) {
        (Some(a), Some(b)) => Pitch::Um([a, b]),
        // A height alone may be that of the surface.
        (Some(a), None) => Pitch::Um([a, a]),
        _ => match (size, header.bare) {
            (Some(size), _) => Pitch::Um([size, size]),
            (None, [Some(a), b]) => Pitch::Bare([a, b.unwrap_or(a)]),
            _ => Pitch::Unknown,
        },
    }
}

/// Applies the unit of the values.
fn units(header: &Header, stored: &mut Stored) -> std::result::Result<(), Fault> {
    if let (Some(a), Some(b)) = (stored.unit_um, header.unit_um)
        && a != b
    {
        let problem = "names two different units of its heights";
        return Err(Fault::unsupported(problem, "correct the header"));
    }
    stored.unit_um = header.factor_um.or(stored.unit_um).or(header.unit_um);
    match &header.other_unit {
        Some(other) if header.factor_um.is_none() => {
            let problem = format!("holds values in {other}, which is no unit of length");
            Err(Fault::unsupported(problem, "export the channel of heights, in nm for example"))
        }
        _ => Ok(()),
    }
}

/// Marks gaps: the header's value, and values that usually denote gaps.
fn gaps(header: &Header, stored: &mut Stored) -> std::result::Result<(), Fault> {
    let nodata = header.nodata.or(header.esri.then_some(-9999.0));
    if let Some(gap) = nodata {
        let near = |v: f64| (v - gap).abs() <= 1e-6 * gap.abs();
        let count = stored.values.iter_mut().filter(|v| near(**v)).map(|v| *v = f64::NAN).count();
        if count > 0 {
            let word = format!("are gaps ({gap} by the header)");
            stored.gaps = Some(word);
            return Ok(());
        }
    }
    if stored.gaps.is_none() && stored.values.iter().any(|v| !v.is_finite()) {
        stored.gaps = Some("are gaps or no numbers (NaN, empty cells or words)".into());
        return Ok(());
    }
    let [low, high] = ends(&stored.values);
    for gap in [low, high] {
        let known = SENTINELS.iter().any(|s| (s - gap).abs() <= 1e-5 * s.abs());
        if known {
            let others = stored.values.iter().filter(|v| **v != gap);
            let [a, b] = others.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(*v), b.max(*v)]);
            let distance = (gap - a).abs().min((gap - b).abs());
            if a <= b && distance > AWAY * (b - a) {
                stored.values.iter_mut().filter(|v| **v == gap).for_each(|v| *v = f64::NAN);
                stored.gaps = Some(format!("are {gap}, which stands for gaps, far from all other heights"));
                return Ok(());
            }
        }
    }
    Ok(())
}

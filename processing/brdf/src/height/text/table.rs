//! Rows of a text grid.

use super::super::MAX_PIXELS;
use super::encoding::lines;
use super::header::Header;
use super::number::{Signs, Style, is_gap, is_row, number};

/// Largest number of values of a table: three per point.
const MAX_NUMBERS: usize = 3 * MAX_PIXELS;

/// Rows of numbers with their header.
#[derive(Debug, Default)]
pub(super) struct Table {
    pub header: Header,
    pub style: Option<Style>,
    /// Numbers per row.
    pub width: usize,
    /// Values row by row; NaN for gaps.
    pub values: Vec<f64>,
    /// First row of one or two integers that state the size.
    pub stated: Vec<f64>,
    /// Row of another length than the first: its line, and both lengths.
    pub ragged: Option<(usize, usize, usize)>,
    /// Number of blocks separated by blank lines, if any has several rows, else 0.
    pub blocks: usize,
}

/// First and last line with numbers.
struct Extent {
    first: usize,
    last: usize,
}

/// Whether a line is a comment, which does not interrupt rows.
fn is_comment(line: &str) -> bool {
    line.trim_start().starts_with(['#', '%', '!']) || line.trim_start().starts_with("//")
}

/// Lines with content.
fn contents(text: &str) -> impl Iterator<Item = (usize, &str)> {
    lines(text).filter(|(_, line)| !line.trim().is_empty())
}

fn extent(text: &str) -> Option<Extent> {
    let mut found: Option<Extent> = None;
    for (at, _) in contents(text).filter(|(_, line)| !is_comment(line) && is_row(line)) {
        found.get_or_insert(Extent { first: at, last: at }).last = at;
    }
    found
}

impl Table {
    /// Reads the rows of a text. `relative` states that only the ratio of the values matters.
    ///
    /// # Errors
    /// A line that is not a row of numbers, or numbers of ambiguous style.
    pub(super) fn read(text: &str, relative: bool) -> Result<Self, String> {
        let Some(Extent { first, last }) = extent(text) else {
            return Err("is neither an image nor a grid of numbers".into());
        };
        let mut this = Self::default();
        let mut gaps = (0, 0);
        let (mut signs, mut blocks) = (Signs::default(), Blocks::default());
        for (at, line) in lines(text) {
            if line.trim().is_empty() {
                blocks.blank();
            } else if at < first {
                gaps = (at, gap_cells(line));
                this.header.take(line);
            } else if at > last {
                trailing(at, line)?;
            } else if is_comment(line) {
                return Err(format!("line {at} is a comment or second header between rows: {:.40}", line.trim()));
            } else {
                signs.add(at, line);
                blocks.row();
            }
        }
        this.blocks = blocks.count();
        let style = signs.style(this.header.decimal_comma, relative)?;
        this.style = Some(style);
        for (at, line) in contents(text).filter(|(at, _)| (first..=last).contains(at)) {
            this.row(at, line, style)?;
        }
        if gaps.1 > 1 && gaps.1 == this.width {
            return Err(format!("line {} holds gaps only", gaps.0));
        }
        Ok(this)
    }

    fn row(&mut self, at: usize, line: &str, style: Style) -> Result<(), String> {
        let line = line.trim_matches(' ');
        // A separator at the ends of all rows does not end a cell.
        let signs = ['\t', ';', ',', '|'];
        let line = if style.ends_with { line.strip_suffix(signs).unwrap_or(line) } else { line };
        let line = if style.begins_with { line.strip_prefix(signs).unwrap_or(line) } else { line };
        let (before, mut wrong, mut gaps) = (self.values.len(), None, 0);
        let values = &mut self.values;
        style.separator.cells(line, |cell| match number(cell, style.decimal) {
            Some(value) => values.push(value),
            None if cell.is_empty() || is_gap(cell) => {
                gaps += 1;
                values.push(f64::NAN);
            }
            None => wrong = wrong.or(Some(cell)),
        });
        if let Some(cell) = wrong {
            let problem = format!("line {at} is no row of numbers: {:.40}", line.trim());
            let number = cell.contains(|c: char| c.is_ascii_digit()) && cell.len() < line.len();
            return Err(if number { format!("{problem} (the cell {cell:.24})") } else { problem });
        }
        if values.len() > MAX_NUMBERS {
            return Err(format!("holds more than {} million numbers", MAX_NUMBERS >> 20));
        }
        let count = values.len() - before;
        if self.width == 0 {
            self.width = count;
        } else if count != self.width {
            let one = before == self.width && count > self.width && gaps == 0 && self.stated.is_empty();
            if one && self.width <= 2 && values[..before].iter().all(|v| v.fract() == 0.0 && *v > 0.0) {
                self.stated = values.drain(..before).collect();
                self.width = count;
            } else if self.ragged.is_none() {
                self.ragged = Some((at, count, self.width));
            }
        }
        Ok(())
    }
}

/// Blocks of rows that blank lines separate.
#[derive(Default)]
struct Blocks {
    /// Whether a blank line followed the last row.
    blank: bool,
    /// Whether a block has several rows.
    several: bool,
    count: usize,
}

impl Blocks {
    fn blank(&mut self) {
        self.blank = true;
    }

    fn row(&mut self) {
        let begins = self.blank || self.count == 0;
        self.count += usize::from(begins);
        self.several |= !begins;
        self.blank = false;
    }

    fn count(&self) -> usize {
        if self.several { self.count } else { 0 }
    }
}

/// Number of cells of a line of gaps; 0 for other lines.
fn gap_cells(line: &str) -> usize {
    let words = line.split([' ', '\t', ';', ',', '|']).map(str::trim).filter(|w| !w.is_empty());
    if words.clone().all(is_gap) { words.count() } else { 0 }
}

/// Checks lines after the numbers.
fn trailing(at: usize, line: &str) -> Result<(), String> {
    let empty = line.trim_matches([' ', '\t', ';', ',', '|']).is_empty();
    if is_comment(line) || empty {
        return Ok(());
    }
    if gap_cells(line) > 0 {
        return Err(format!("line {at} holds gaps only: {:.40}", line.trim()));
    }
    Err(format!("line {at} is no row of numbers: {:.40}", line.trim()))
}

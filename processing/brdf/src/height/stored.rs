//! Stored heights of files, and their scale from file and options.

use super::read::Scale;
use super::squares::{self, SQUARE};
use super::{HeightField, check_size, gaps};
use nacre_base::{Error, Result};
use std::path::Path;

/// Largest relative differences of pitch and range between file and option, for rounding by users.
const SAME_PITCH: f64 = 0.01;
const SAME_RANGE: f64 = 0.05;

/// The same as a logarithm, for a pitch in units of another power of ten: log10(1.01).
const SAME_POWER: f64 = 0.0043;

/// Pixel pitch in a file.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) enum Pitch {
    /// Not stated.
    #[default]
    Unknown,
    /// Across and down, in µm.
    Um([f64; 2]),
    /// Across and down, in an unknown unit.
    Bare([f64; 2]),
}

/// Heights as stored in a file.
#[derive(Clone, Debug, Default)]
pub(super) struct Stored {
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub rows: usize,
    /// Values row by row from the top; NaN for gaps.
    pub values: Vec<f64>,
    /// Pixel pitch.
    pub pitch: Pitch,
    /// µm per unit of the values.
    pub unit_um: Option<f64>,
    /// Resolution of the values.
    pub step: Option<f64>,
    /// Notes on reading the file, for the report.
    pub notes: Vec<String>,
    /// The file's term for gaps: "are bad points".
    pub gaps: Option<String>,
}

impl Stored {
    /// Reverses the rows, for files that begin with the lowest.
    #[must_use]
    pub(super) fn upside_down(mut self) -> Self {
        let (width, rows) = (self.width, self.rows);
        for y in 0..rows / 2 {
            let (above, below) = self.values.split_at_mut((rows - 1 - y) * width);
            above[y * width..][..width].swap_with_slice(&mut below[..width]);
        }
        self
    }

    /// Height field, if file and options together determine its scale.
    pub(super) fn field(mut self, path: &Path, scale: &Scale) -> Result<HeightField> {
        let subject = path.display().to_string();
        check_size(&subject, self.width, self.rows)?;
        let word = self.gaps.as_deref().unwrap_or("are no numbers (NaN or infinite)");
        let filled = gaps::fill(path, self.width, &mut self.values, word, scale)?;
        let pixel_um = tidy(pixel_um(path, scale, self.pitch)?);
        let factor = self.factor(path, scale)?;
        let um = self.values.into_iter().map(|v| v * factor).collect();
        let (width, rows, um, resampled) = self.pitch.squared(&subject, [self.width, self.rows], um)?;
        let mut field = HeightField::new(&subject, width, rows, pixel_um, um)?;
        field.step_um = self.step.map(|step| step * factor);
        field.notes = self.notes.into_iter().chain(filled).chain(resampled).collect();
        Ok(field)
    }

    /// µm per unit of the values.
    fn factor(&self, path: &Path, scale: &Scale) -> Result<f64> {
        let [low, high] = ends(&self.values);
        let spread = high - low;
        match (scale.range_um, self.unit_um) {
            (None, Some(unit)) => Ok(unit),
            (Some(range), None) => Ok(if spread > 0.0 { range / spread } else { 1.0 }),
            (Some(range), Some(unit)) => {
                let own = unit * spread;
                if (own - range).abs() > SAME_RANGE * own.max(range) && spread > 0.0 {
                    let problem = format!("spans {own:.6} µm of height by its own unit, --range-um says {range}");
                    return Err(Error::file(path, problem, "leave out --range-um, or correct the unit in the file"));
                }
                Ok(unit)
            }
            (None, None) => {
                let problem = "does not say in which unit its heights are";
                Err(Error::file(path, problem, "give the range from lowest to highest with --range-um"))
            }
        }
    }
}

/// Lowest and highest value.
pub(super) fn ends(values: &[f64]) -> [f64; 2] {
    values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(*v), b.max(*v)])
}

/// Pixel pitch in µm from file and option, which must agree; for oblong pixels, of their shorter side.
pub(super) fn pixel_um(path: &Path, scale: &Scale, stated: Pitch) -> Result<f64> {
    let contradicts = |file: String, flag: f64| {
        let problem = format!("has pixels of {file}, --pixel-um says {flag}");
        Error::file(path, problem, "leave out --pixel-um, or correct the pitch in the file")
    };
    match (stated, scale.pixel_um) {
        (Pitch::Unknown, Some(flag)) => Ok(flag),
        (Pitch::Unknown, None) => {
            let remedy = "give their pitch with --pixel-um";
            Err(Error::file(path, "does not say how large its pixels are", remedy))
        }
        (Pitch::Um(both), flag) => {
            let own = shorter(path, both, " µm")?;
            match flag {
                Some(flag) if (flag / own - 1.0).abs() > SAME_PITCH => {
                    Err(contradicts(format!("{} µm", tidy(own)), flag))
                }
                _ => Ok(own),
            }
        }
        (Pitch::Bare(both), Some(flag)) => {
            let own = shorter(path, both, "")?;
            // Units of length differ by powers of ten; a pitch of exactly 1 counts pixels.
            let power = (flag / own).log10();
            if own == 1.0 || (power - power.round()).abs() < SAME_POWER {
                return Ok(flag);
            }
            Err(contradicts(format!("{} in a unit that is not named", tidy(own)), flag))
        }
        (Pitch::Bare(both), None) => {
            let own = shorter(path, both, "")?;
            let problem = format!("has pixels of {}, but does not say in which unit", tidy(own));
            Err(Error::file(path, problem, "give their pitch in µm with --pixel-um"))
        }
    }
}

/// Rounds off the last digits, which are errors of unit conversion.
fn tidy(value: f64) -> f64 {
    format!("{value:.11e}").parse().unwrap_or(value)
}

/// Shorter side of a pixel.
fn shorter(path: &Path, [across, down]: [f64; 2], unit: &str) -> Result<f64> {
    if !(across > 0.0 && down > 0.0 && across.is_finite() && down.is_finite()) {
        let problem = format!("has pixels of {across} by {down}{unit}");
        return Err(Error::file(path, problem, "correct their pitch in the file, or export it again"));
    }
    let ratio = (across / down).max(down / across);
    if ratio > squares::MOST {
        let problem = format!("has pixels of {across:.5} by {down:.5}{unit}, more than {} : 1", squares::MOST);
        let n = ratio.round();
        return Err(Error::file(path, problem, format!("keep every {n}th point of the finer direction")));
    }
    if ratio - 1.0 <= SQUARE { Ok(across) } else { Ok(across.min(down)) }
}

impl Pitch {
    /// Columns, rows and heights on square pixels, with a note if they were interpolated.
    ///
    /// # Errors
    /// `Input` for more pixels than a height field may have.
    pub(super) fn squared(
        self,
        subject: &str,
        [width, rows]: [usize; 2],
        values: Vec<f64>,
    ) -> Result<(usize, usize, Vec<f64>, Option<String>)> {
        let (Self::Um(sides) | Self::Bare(sides)) = self else { return Ok((width, rows, values, None)) };
        if (sides[0] / sides[1] - 1.0).abs() <= SQUARE {
            return Ok((width, rows, values, None));
        }
        let [new_width, new_rows] = squares::size([width, rows], sides);
        check_size(subject, new_width, new_rows)?;
        let (values, _) = squares::squared(&values, width, sides);
        let [across, down] = sides.map(tidy);
        let note = format!("pixels of {across} by {down} interpolated to squares: {new_width} × {new_rows} pixels");
        Ok((new_width, new_rows, values, Some(note)))
    }
}

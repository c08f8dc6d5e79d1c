//! Tabulated spectra.

use super::VISIBLE_NM;
use nacre_base::text::read_text;
use nacre_base::{Error, Result};
use std::path::Path;

/// Largest file in bytes and largest number of rows.
const MAX_BYTES: u64 = 1 << 20;
const MAX_ROWS: usize = 20_000;

/// Spectral power, linear between its points, 0 outside of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    /// Wavelengths in nm, increasing, and powers in any unit.
    points: Vec<[f64; 2]>,
}

impl Spectrum {
    /// Creates a spectrum of points (wavelength in nm, power).
    ///
    /// # Errors
    /// A description of the problem for messages.
    pub fn new(points: Vec<[f64; 2]>) -> std::result::Result<Self, String> {
        if points.len() < 2 {
            return Err(format!("has {} rows of numbers; a spectrum has at least two", points.len()));
        }
        for [nm, power] in &points {
            if !(1.0..=1e5).contains(nm) {
                return Err(format!("wavelength {nm} nm is not between 1 and 100000"));
            }
            if !(0.0..=1e30).contains(power) {
                return Err(format!("power {power} at {nm} nm is no power"));
            }
        }
        if let Some([a, b]) = points.array_windows().find(|[a, b]| a[0] >= b[0]) {
            return Err(format!("wavelengths do not rise from {} to {}", a[0], b[0]));
        }
        if points.iter().all(|p| p[1] == 0.0) {
            return Err("is dark at every wavelength".into());
        }
        Ok(Self { points })
    }

    /// Constant power 1 over the range of the observers.
    pub(super) fn equal_energy() -> Self {
        Self { points: VISIBLE_NM.map(|nm| [nm, 1.0]).to_vec() }
    }

    /// Parses rows of `wavelength_nm,power`; the first line may hold column names.
    pub(super) fn parse(text: &str) -> std::result::Result<Self, String> {
        let mut points = vec![];
        for (k, line) in text.lines().enumerate().filter(|(_, l)| !l.trim().is_empty()) {
            let numbers: Vec<Option<f64>> = line.split([',', ';', '\t']).map(|v| v.trim().parse().ok()).collect();
            match numbers.as_slice() {
                [Some(nm), Some(power), ..] => points.push([*nm, *power]),
                _ if points.is_empty() && k == 0 => {}
                _ => return Err(format!("line {} is not \"wavelength_nm,power\": {line:.60}", k + 1)),
            }
            if points.len() > MAX_ROWS {
                return Err(format!("has more than {MAX_ROWS} rows"));
            }
        }
        Self::new(points)
    }

    /// Reads a CSV file of wavelengths in nm and powers.
    ///
    /// # Errors
    /// `Input` if the file cannot be read or is not such a table.
    pub fn read(path: &Path) -> Result<Self> {
        let remedy = "give a CSV file with rows \"wavelength_nm,power\" in rising order";
        let text = read_text(path, MAX_BYTES, remedy)?;
        Self::parse(&text).map_err(|problem| Error::file(path, problem, remedy))
    }

    /// Power at a wavelength in nm.
    pub fn at(&self, nm: f64) -> f64 {
        let next = self.points.partition_point(|p| p[0] < nm);
        match (next.checked_sub(1).and_then(|k| self.points.get(k)), self.points.get(next)) {
            (_, Some([at, power])) if *at == nm => *power,
            (Some([a, low]), Some([b, high])) => low + (high - low) * (nm - a) / (b - a),
            _ => 0.0,
        }
    }

    /// Shortest and longest wavelength in nm.
    pub fn range_nm(&self) -> [f64; 2] {
        // A spectrum has at least two points.
        [self.points.first(), self.points.last()].map(|p| p.map_or(0.0, |p| p[0]))
    }

    /// Spectrum at the same wavelengths with powers mapped by `power`.
    pub(super) fn map(&self, power: impl Fn(f64) -> f64) -> Self {
        Self { points: self.points.iter().map(|[nm, p]| [*nm, power(*p)]).collect() }
    }
}

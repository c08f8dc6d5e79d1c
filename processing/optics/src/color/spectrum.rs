//! Spectra as tables.

use super::VISIBLE_NM;
use nacre_base::text::read_text;
use nacre_base::{Error, Result};
use std::path::Path;

/// Largest file that is read, in bytes, and most rows of it.
const MAX_BYTES: u64 = 1 << 20;
const MAX_ROWS: usize = 20_000;

/// Power over wavelength, linear between its points, 0 outside.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    /// Wavelength in nm, rising, and power in any unit.
    points: Vec<[f64; 2]>,
}

impl Spectrum {
    /// Of wavelengths in nm and powers.
    ///
    /// # Errors
    /// What is wrong with them, in words.
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

    /// 1 wherever the observers see.
    pub(super) fn equal_energy() -> Self {
        Self { points: VISIBLE_NM.map(|nm| [nm, 1.0]).to_vec() }
    }

    /// Reads `wavelength_nm,power` rows; one line of names may come first.
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
    /// `Input` for files that are none.
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

    /// First and last wavelength in nm.
    pub fn range_nm(&self) -> [f64; 2] {
        // There are two points at least.
        [self.points.first(), self.points.last()].map(|p| p.map_or(0.0, |p| p[0]))
    }

    /// With another power at each of its wavelengths.
    pub(super) fn map(&self, power: impl Fn(f64) -> f64) -> Self {
        Self { points: self.points.iter().map(|[nm, p]| [*nm, power(*p)]).collect() }
    }
}

//! Illuminants by name or from a CSV file.

use super::{Observer, Spectrum, VISIBLE_NM};
use nacre_base::{Error, Result};
use std::path::Path;

/// Names of the built-in illuminants.
pub const NAMES: [&str; 18] = [
    "E",
    "A",
    "A-inverse",
    "D65",
    "FL1",
    "FL2",
    "FL3",
    "FL4",
    "FL5",
    "FL6",
    "FL7",
    "FL8",
    "FL9",
    "FL10",
    "FL11",
    "FL12",
    "LED-B1",
    "LED-B3",
];

/// Wavelength at which the inverse of illuminant A is 1, in nm.
const INVERSE_AT_NM: f64 = 560.0;

/// Illuminant: the spectrum of the light on a surface.
#[derive(Clone, Debug, PartialEq)]
pub struct Illuminant {
    /// Name of a built-in illuminant, or path of its file.
    pub name: String,
    /// Spectral power in any unit.
    pub spectrum: Spectrum,
}

impl Default for Illuminant {
    /// Illuminant E (equal energy).
    fn default() -> Self {
        Self { name: "E".into(), spectrum: Spectrum::equal_energy() }
    }
}

fn table(name: &str) -> Option<&'static str> {
    Some(match name {
        "A" => include_str!("data/A.csv"),
        "D65" => include_str!("data/D65.csv"),
        "FL1" => include_str!("data/FL1.csv"),
        "FL2" => include_str!("data/FL2.csv"),
        "FL3" => include_str!("data/FL3.csv"),
        "FL4" => include_str!("data/FL4.csv"),
        "FL5" => include_str!("data/FL5.csv"),
        "FL6" => include_str!("data/FL6.csv"),
        "FL7" => include_str!("data/FL7.csv"),
        "FL8" => include_str!("data/FL8.csv"),
        "FL9" => include_str!("data/FL9.csv"),
        "FL10" => include_str!("data/FL10.csv"),
        "FL11" => include_str!("data/FL11.csv"),
        "FL12" => include_str!("data/FL12.csv"),
        "LED-B1" => include_str!("data/LED-B1.csv"),
        "LED-B3" => include_str!("data/LED-B3.csv"),
        _ => return None,
    })
}

impl Illuminant {
    /// Built-in illuminant of this name; `None` for unknown names.
    ///
    /// Names: E (equal energy), A (tungsten), A-inverse (1/A, scaled to 1 at 560 nm), D65 (daylight), FL1 to FL12
    /// (fluorescent), LED-B1 and LED-B3.
    pub fn named(name: &str) -> Option<Self> {
        if name == "E" {
            return Some(Self::default());
        }
        if name == "A-inverse" {
            let a = Self::named("A")?.spectrum;
            let one = a.at(INVERSE_AT_NM);
            return Some(Self { name: name.into(), spectrum: a.map(|power| one / power) });
        }
        let spectrum = Spectrum::parse(table(name)?).ok()?;
        Some(Self { name: name.into(), spectrum })
    }

    /// White point: X, Y, Z of a perfect diffuser, scaled to Y = 1. `None` if the light has no visible power.
    pub fn white(&self, observer: Observer) -> Option<[f64; 3]> {
        // Spectral lines of a CSV file may be narrow.
        const STEP_NM: f64 = 0.1;
        let steps = ((VISIBLE_NM[1] - VISIBLE_NM[0]) / STEP_NM) as usize;
        let mut sum = [0.0; 3];
        for k in 0..=steps {
            let nm = VISIBLE_NM[0] + STEP_NM * k as f64;
            let power = self.spectrum.at(nm);
            sum.iter_mut().zip(observer.at(nm)).for_each(|(s, seen)| *s += seen * power);
        }
        (sum[1] > 0.0).then(|| sum.map(|v| v / sum[1]))
    }

    /// Built-in illuminant of this name, or the spectrum in the CSV file of this path.
    ///
    /// # Errors
    /// `Input` if the name is neither.
    pub fn of(name: &str) -> Result<Self> {
        match Self::named(name) {
            Some(light) => Ok(light),
            None if !Path::new(name).exists() => {
                let remedy = format!("give one of {}, or a CSV file", NAMES.join(", "));
                Err(Error::input("illuminant", format!("{name:?} is neither built in nor a file"), remedy))
            }
            None => Ok(Self { name: name.into(), spectrum: Spectrum::read(Path::new(name))? }),
        }
    }
}

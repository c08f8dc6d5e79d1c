//! Comparison of image files' statements about their values with the description of the set.

use super::{FrameSet, Transfer};
use nacre_base::{Error, Result};
use nacre_image::{Curve, Details, details};
use std::path::{Path, PathBuf};

/// Relative difference of exponents attributed to rounding: gAMA 0.45455 corresponds to 2.19998.
const SAME_EXPONENT: f64 = 0.01;

/// Maximum difference of levels within a set, relative to white, since some cameras measure black for each photograph.
const SAME_LEVEL: f64 = 0.005;

impl Transfer {
    /// Transfer function of a curve; `None` for unsupported curves.
    pub fn of(curve: Curve) -> Option<Self> {
        match curve {
            Curve::Linear => Some(Self::Linear),
            Curve::Srgb => Some(Self::Srgb),
            // Exponents are significant to two digits.
            Curve::Gamma(gamma) => Some(Self::Gamma((100.0 * gamma).round() / 100.0)),
            Curve::Other => None,
        }
    }

    /// Name for `--transfer`.
    pub fn option(self) -> String {
        match self {
            Self::Linear => "linear".into(),
            Self::Srgb => "srgb".into(),
            Self::Gamma(gamma) => format!("gamma={gamma}"),
            Self::Polynomial([a, b, c]) => format!("polynomial={a},{b},{c}"),
            Self::Recover => "recover".into(),
        }
    }

    fn agrees(self, curve: Curve) -> bool {
        match (self, curve) {
            // A measured response corrects a file that means to be linear.
            (Self::Recover, _) | (Self::Linear | Self::Polynomial(_), Curve::Linear) | (Self::Srgb, Curve::Srgb) => {
                true
            }
            (Self::Gamma(a), Curve::Gamma(b)) => (a / b - 1.0).abs() < SAME_EXPONENT,
            (Self::Gamma(a), Curve::Linear) => (a - 1.0).abs() < SAME_EXPONENT,
            _ => false,
        }
    }
}

/// Statements of all files of a set.
#[derive(Default)]
pub(super) struct Stated {
    files: Vec<(PathBuf, Details)>,
}

impl Stated {
    pub fn add(&mut self, file: PathBuf, details: Details) {
        self.files.push((file, details));
    }

    /// Rejects files with different orientations or largest values.
    pub fn check(&self) -> Result<()> {
        let Some((first, wanted)) = self.files.first() else { return Ok(()) };
        for (file, found) in &self.files {
            if found.orientation != wanted.orientation {
                let problem = format!(
                    "has Exif orientation {}, but {} has {}",
                    found.orientation,
                    first.display(),
                    wanted.orientation
                );
                return Err(Error::file(file, problem, "turn the photographs alike, and remove the tag"));
            }
            let near = |a: Option<f64>, b: Option<f64>, unit: f64| match (a, b) {
                (Some(a), Some(b)) => (a - b).abs() <= SAME_LEVEL * unit,
                (a, b) => a == b,
            };
            let unit = wanted.white.unwrap_or(1.0);
            if !near(found.white, wanted.white, unit) || !near(found.black, wanted.black, unit) {
                let problem = format!("has other levels of black and white than {}", first.display());
                return Err(Error::file(file, problem, "all photographs of a set must have the same"));
            }
        }
        Ok(())
    }

    /// Fills missing black and white levels from the files; returns warnings about their other statements.
    pub fn complete(&self, set: &mut FrameSet) -> Vec<String> {
        let Some((_, first)) = self.files.first() else { return vec![] };
        let blacks: Option<Vec<f64>> = self.files.iter().map(|(_, d)| d.black).collect();
        set.white = set.white.or(first.white);
        set.black = set.black.or(blacks.map(|all| all.iter().sum::<f64>() / all.len() as f64));
        self.warnings(set.transfer)
    }

    /// Warnings about statements that contradict this transfer function or are ignored.
    fn warnings(&self, transfer: Transfer) -> Vec<String> {
        let said = |clause: &dyn Fn(&Details) -> Option<String>| {
            let all: Vec<(&Path, String)> =
                self.files.iter().filter_map(|(file, d)| Some((file.as_path(), clause(d)?))).collect();
            let (file, text) = all.first()?;
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            let more = match all.len() {
                1 => String::new(),
                2 => " (and so does one more file)".into(),
                n => format!(" (and so do {} more files)", n - 1),
            };
            Some(format!("{name} {text}{more}"))
        };
        let contradicted = said(&|d| {
            let encoding = d.encoding.as_ref().filter(|e| !transfer.agrees(e.curve))?;
            let curve = Transfer::of(encoding.curve)
                .map_or_else(|| "an unsupported curve".into(), |t| format!("transfer {}", t.option()));
            Some(format!("states {curve} ({}), but is read as {}", encoding.source, transfer.option()))
        });
        let turned = said(&|d| {
            let note = format!(
                "has Exif orientation {}, which is not applied: maps are as the sensor saw them",
                d.orientation
            );
            (d.orientation != 1).then_some(note)
        });
        let notes = said(&|d| (!d.notes.is_empty()).then(|| d.notes.join("; ")));
        [contradicted, turned, notes].into_iter().flatten().collect()
    }
}

/// Warnings about a single photograph's file, read with this transfer function and the largest value of its type as
/// white. An unreadable file has none, since reading it reports the error.
pub(super) fn warnings_of(file: &Path, transfer: Transfer) -> Vec<String> {
    let Ok(details) = details(file) else { return vec![] };
    let highest = f64::from(details.info.depth.full_scale());
    let white = details.white.filter(|white| *white < highest);
    let mut stated = Stated::default();
    stated.add(file.to_owned(), details);
    let mut all = stated.warnings(transfer);
    all.extend(white.map(|white| {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        format!("{name} is saturated from {white} up, which is not masked; nacre reconstruct hdr makes a photograph of it that is")
    }));
    all
}

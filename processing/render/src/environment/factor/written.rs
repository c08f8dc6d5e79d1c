//! Reads curves written by `nacre factor`.

use super::directions::Pattern;
use super::{Factors, Grid, MAX_RANK, Measured, Part, Term};
use crate::environment::Table;
use nacre_base::{Error, Result};
use nacre_image::{ExrMap, read_exr, size};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, PI};
use std::path::Path;

/// Maximum number of parts in a folder, as in [`Settings`](super::Settings).
const MAX_PARTS: usize = 6;

/// Maximum number of samples of a curve: the largest number of table entries along a side, plus one for an odd number.
const MAX_SAMPLES: usize = 4097;

/// Largest angle in rad between the second direction and the perpendicular to the first (two directions are at least
/// 10° apart).
const MAX_SHEAR: f64 = 80.5 * PI / 180.0;

const REMEDY: &str = "give a folder that `nacre factor` wrote, or factor the table again";

impl Factors {
    /// Reads `part-N-across.exr` and `part-N-along.exr` of a folder, and measures the residual of their sum against the
    /// given table. Each channel is multiplied by `scale`, as the entries of the table were.
    ///
    /// # Errors
    /// `Input`, which names the file, for missing parts, impossible sizes and numbers, and curves that do not match the
    /// table.
    pub fn read(folder: &Path, table: &Table, scale: [f64; 3]) -> Result<Self> {
        let file = |k: usize, name: &str| folder.join(format!("part-{k}-{name}.exr"));
        let count = (1..=MAX_PARTS).take_while(|k| file(*k, "across").exists()).count();
        if count == 0 {
            return Err(Error::file(folder, "holds no part-1-across.exr", REMEDY));
        }
        let read = |k: usize| part([file(k, "across"), file(k, "along")].each_ref().map(|p| p.as_path()), scale);
        let parts = (1..=count).map(read).collect::<Result<Vec<_>>>()?;
        let directions: Vec<f64> =
            if count > 1 { parts.iter().map(|(grid, _)| grid.across()).collect() } else { vec![] };
        let parts: Vec<Part> = parts
            .into_iter()
            .enumerate()
            .map(|(k, (grid, channels))| {
                let weight = |h| if count > 1 { super::parts::share(&directions, k, h) } else { 1.0 };
                Part::of_curves(table, grid, channels, weight)
            })
            .collect();
        let rank = parts.iter().map(Part::terms).collect();
        let measured = Measured::of(table, &parts, &directions);
        let factors = Self { parts, rank, pattern: Pattern::of(table, FRAC_PI_3), wanted: None, measured };
        // Even a single optimal curve leaves a residual below the table's norm.
        if factors.error().is_nan() || factors.error() >= 1.0 {
            let problem = format!(
                "holds curves that are off by {:.0} % of the scene's table: they are of another table, or of --kind line and the table is no line",
                100.0 * factors.error()
            );
            return Err(Error::file(folder, problem, "factor the table that the scene names"));
        }
        Ok(factors)
    }
}

/// One part, from its two files.
fn part(paths: [&Path; 2], scale: [f64; 3]) -> Result<(Grid, [Vec<Term>; 3])> {
    let refuse = |path: &Path, problem: String| Error::file(path, problem, REMEDY);
    let mut files: Vec<ExrMap> = vec![];
    for path in paths {
        // The size is checked in the header, before any data are decoded.
        let [samples, rank] = size(path)?;
        if !(2..=MAX_SAMPLES).contains(&samples) || !(1..=MAX_RANK).contains(&rank) {
            let problem =
                format!("has {rank} curves of {samples} samples; 1 to {MAX_RANK} of 2 to {MAX_SAMPLES} are expected");
            return Err(refuse(path, problem));
        }
        files.push(read_exr(path)?);
    }
    let number = |file: &ExrMap, path: &Path, name: &str, [least, most]: [f64; 2]| -> Result<f64> {
        let text = file.attributes.get(name).ok_or_else(|| refuse(path, format!("has no attribute {name}")))?;
        let value = text.trim().parse::<f64>().ok().filter(|v| (least..=most).contains(v));
        value.ok_or_else(|| {
            let shown: String = text.chars().take(40).collect();
            refuse(path, format!("has {name} = {shown:?}; a number from {least} to {most} is expected"))
        })
    };
    let limits = [
        ("meridian_deg", [-720.0, 720.0]),
        ("shear_deg", [-MAX_SHEAR.to_degrees(), MAX_SHEAR.to_degrees()]),
        ("reach_x", [1e-6, 0.999]),
        ("reach_beta", [1e-6, PI]),
    ];
    let mut values = [0.0; 4];
    for (value, (name, range)) in values.iter_mut().zip(limits) {
        *value = number(&files[0], paths[0], name, range)?;
        if number(&files[1], paths[1], name, range)? != *value {
            return Err(refuse(paths[1], format!("has another {name} than {}", shown(paths[0]))));
        }
    }
    let [meridian, shear, reach_x, reach_beta] = values;
    if files[0].height != files[1].height {
        let problem = format!("has {} curves, {} has {}", files[1].height, shown(paths[0]), files[0].height);
        return Err(refuse(paths[1], problem));
    }
    let size = [files[0].width, files[1].width];
    let grid = Grid {
        meridian: meridian.to_radians(),
        shear: shear.to_radians(),
        reach: [reach_x, reach_beta.min(FRAC_PI_2 + MAX_SHEAR)],
        size,
    };
    let mut channels = [const { vec![] }; 3];
    for (c, name) in ["R", "G", "B"].into_iter().enumerate() {
        let mut curves = vec![];
        for (file, path) in files.iter_mut().zip(paths) {
            let curve = file.take(name, path)?;
            if curve.iter().any(|v| !v.is_finite()) {
                return Err(refuse(path, format!("has a value in channel {name} that is no finite number")));
            }
            curves.push(curve);
        }
        let [across, along] = [0, 1].map(|k| curves[k].chunks(size[k]));
        let term = |(across, along): (&[f32], &[f32])| {
            let across: Vec<f32> = across.iter().map(|v| v * scale[c] as f32).collect();
            let norm = |v: &[f32]| v.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>().sqrt();
            Term { sigma: norm(&across) * norm(along), across, along: along.to_vec() }
        };
        // Channels that need fewer terms have rows of zeros.
        channels[c] = across.zip(along).map(term).filter(|t| t.sigma > 0.0).collect();
    }
    Ok((grid, channels))
}

fn shown(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

//! The operation `factor`: factorises a lookup table.

use super::{Factors, Kind, MAX_RANK, Report, Settings};
use crate::environment::passes::{clamped, two_pass};
use crate::environment::{Environment, Table, normalized_error};
use nacre_base::estimate::Work;
use nacre_base::operation::{Input, Operation};
use nacre_base::progress::Progress;
use nacre_base::{Error, OutputFolder, Result};
use nacre_image::{Attribute, write_exr, write_png8};
use nacre_optics::color::srgb_encode;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Columns of the environment in which the picture error is measured.
const TRIAL: usize = 512;

/// Time (s) and memory (bytes) of that measurement.
const TRIAL_S: f64 = 13.0;
const TRIAL_BYTES: u64 = 120 << 20;

/// Factor a lookup table into separable terms for environment lighting.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(rename = "FactorOptions", extend(
    "x-input" = "The table: lut.exr of `nacre reconstruct lut`, or a folder that holds it",
    "x-examples" = "\
Examples:
  nacre factor lut/lut.exr --max-error 0.05 --out factors
  nacre factor lut/lut.exr --rank 8 --environment studio.exr --out factors
  nacre factor lut/lut.exr --directions-deg 12,97 --kind nonnegative --out factors
  nacre factor tv/lut.exr --parts 2 --out factors

Finds the two main directions of the pattern, straightens it and splits it into sums of products of two curves, by
which two passes over a lat-long environment compute the reflected light. Writes the curves (part-N-across.exr,
part-N-along.exr), factors.png (the table, and beside it the sum of its terms) and report.json, which says whether
the table separates at all, and which method to use if not. `nacre render` takes the folder as `factors` of a
material's table (nacre schema scene)."
))]
pub struct Options {
    /// Number of terms per channel and part (default: as many as the error requires).
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 96))]
    pub rank: Option<usize>,
    /// Largest error of the table: root mean square of the residual over that of the table. No effect if the rank is
    /// given.
    #[schemars(extend("x-placeholder" = "REL"), range(min = 1e-6, max = 1.0))]
    pub max_error: f64,
    /// Factorisation: singular (singular vectors, least error), nonnegative (non-negative terms) or line (one curve
    /// along the first direction, for gratings and discs).
    pub kind: Kind,
    /// Number of parts of the table, one along each main direction.
    #[schemars(range(min = 1, max = 6))]
    pub parts: usize,
    /// The two directions in degrees, anticlockwise from the right, instead of detected ones; the second lies along the
    /// meridians.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true, "x-placeholder" = "A,B"))]
    pub directions_deg: Option<[f64; 2]>,
    /// Minimum angle between the two directions in degrees.
    #[schemars(extend("x-advanced" = true), range(min = 2.0, max = 90.0))]
    pub min_angle_deg: f64,
    /// Lat-long environment (EXR or HDR) in which the picture error is measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-file" = true))]
    pub environment: Option<PathBuf>,
    /// Layer, view or part of an OpenEXR environment that contains several pictures.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-advanced" = true))]
    pub layer: Option<String>,
}

impl Default for Options {
    fn default() -> Self {
        let Settings { rank, max_error, apart, parts, kind, .. } = Settings::default();
        let min_angle_deg = apart.to_degrees().round();
        Self { rank, max_error, kind, parts, directions_deg: None, min_angle_deg, environment: None, layer: None }
    }
}

impl Operation for Options {
    const NAME: &'static str = "factor";
    const TITLE: &'static str = "Separable terms of a lookup table, for environment lighting";
    const INPUT: Input = Input::Files;
    type Report = Report;

    fn check_options(&self) -> Result<()> {
        self.settings().check()
    }

    fn check(&self, input: &Path) -> Result<Work> {
        self.check_options()?;
        Ok(self.work(&table_in(input)?))
    }

    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Report> {
        let (begun, settings) = (Instant::now(), self.settings());
        let table = Table::read(&table_in(input)?)?;
        let read = |path: &PathBuf| Environment::read(path, self.layer.as_deref());
        let environment = self.environment.as_ref().map(read).transpose()?;
        progress.stage("factorising", 0);
        let factors = Factors::of(&table, &settings)?;
        progress.check()?;
        let mut report = factors.report(&table, settings.kind);
        if let Some(environment) = environment {
            progress.stage("measuring the picture's error", 0);
            report.warnings.extend(environment.warnings());
            let (error, negative) = measured(&factors, &table, &settings, environment, progress)?;
            (report.picture_error, report.negative) = (Some(error), Some(negative));
            if negative > 0.02 {
                let percent = 100.0 * negative;
                let words = format!(
                    "the picture falls to -{percent:.0} % of its largest radiance; --kind nonnegative does not"
                );
                report.warnings.push(words);
            }
        }
        factors.write(out, &table)?;
        report.seconds = begun.elapsed().as_secs_f64();
        Ok(report)
    }
}

/// Path of the table: the input, or `lut.exr` in it.
fn table_in(input: &Path) -> Result<PathBuf> {
    let path = if input.is_dir() { input.join("lut.exr") } else { input.to_owned() };
    if path.is_file() {
        return Ok(path);
    }
    Err(Error::file(&path, "is not there", "give the lut.exr of `nacre reconstruct lut`, or the folder that holds it"))
}

impl Options {
    fn settings(&self) -> Settings {
        Settings {
            rank: self.rank,
            max_error: self.max_error,
            apart: self.min_angle_deg.to_radians(),
            directions: self.directions_deg.map(|pair| pair.map(f64::to_radians)),
            parts: self.parts,
            kind: self.kind,
        }
    }

    /// Time, memory and disk space, from the header of the table; the reader refuses invalid headers. Measured for 256²
    /// to 1024² entries.
    fn work(&self, table: &Path) -> Work {
        /// Seconds per table entry: in one part, in several parts, as one curve.
        const EACH_S: [f64; 3] = [2.4e-6, 7.4e-6, 0.4e-6];
        let entries: usize = nacre_image::size(table).map_or(0, |[width, height]| width * height);
        let each = match (self.kind, self.parts) {
            (Kind::Line, _) => EACH_S[2],
            (_, 0 | 1) => EACH_S[0],
            _ => EACH_S[1],
        };
        let (trial_s, trial_bytes) = if self.environment.is_some() { (TRIAL_S, TRIAL_BYTES) } else { (0.0, 0) };
        Work {
            operation: "factor".into(),
            seconds: 0.02 + each * entries as f64 + trial_s,
            memory_bytes: 80 * entries as u64 + trial_bytes,
            disk_bytes: 3 * entries as u64,
            ..Work::default()
        }
    }
}

/// Error of the picture against one with all terms, and its most negative value.
fn measured(
    factors: &Factors,
    table: &Table,
    settings: &Settings,
    mut environment: Environment,
    progress: &dyn Progress,
) -> Result<(f64, f64)> {
    while environment.width > TRIAL || environment.width % 2 == 1 {
        environment = environment.halved();
    }
    let all = Settings { rank: Some(MAX_RANK), kind: Kind::Singular, parts: 1, ..*settings };
    let truth = Factors::of(table, &all)?.reflected(&environment, progress)?;
    let mut found = factors.reflected(&environment, progress)?;
    let negative = clamped(&mut found);
    Ok((normalized_error(&found, &truth), negative))
}

impl Factors {
    /// Reflection of an environment by all parts. Each part has another meridian. The result is therefore valid for
    /// surfaces that face the centre of the picture and stand upright in it; towards the poles of the parts they turn.
    ///
    /// # Errors
    /// As [`two_pass`].
    pub fn reflected(&self, environment: &Environment, progress: &dyn Progress) -> Result<Vec<[f32; 3]>> {
        let mut sum = vec![[0.0_f32; 3]; environment.rgb.len()];
        for part in &self.parts {
            let reflected = two_pass(environment, part, progress)?;
            sum.as_flattened_mut().iter_mut().zip(reflected.as_flattened()).for_each(|(s, v)| *s += v);
        }
        Ok(sum)
    }

    fn write(&self, folder: &OutputFolder, table: &Table) -> Result<()> {
        for (k, part) in self.parts.iter().enumerate() {
            let grid = &part.grid;
            let text = |v: f64| Attribute::Text(v.to_string());
            let attributes = [
                ("meridian_deg", text(grid.meridian.to_degrees())),
                ("shear_deg", text(grid.shear.to_degrees())),
                ("reach_x", text(grid.reach[0])),
                ("reach_beta", text(grid.reach[1])),
            ];
            let rank = part.channels.iter().map(Vec::len).max().unwrap_or(0);
            for (name, width) in [("across", grid.size[0]), ("along", grid.size[1])] {
                let row = |c: usize, y: usize, row: &mut [f32]| {
                    let terms = &part.channels[c];
                    match terms.get(y) {
                        Some(term) => row.copy_from_slice(if name == "across" { &term.across } else { &term.along }),
                        None => row.fill(0.0),
                    }
                };
                let file = format!("part-{}-{name}.exr", k + 1);
                write_exr(&folder.path(&file), width, rank, &["R", "G", "B"], &attributes, &row)?;
                folder.sync(&file)?;
            }
        }
        write_png8(&folder.path("factors.png"), 2 * table.size, table.size, 3, &self.picture(table))
    }

    /// The table next to the sum of its terms, both divided by the included geometric factors.
    fn picture(&self, table: &Table) -> Vec<u8> {
        let n = table.size;
        let mut light: Vec<f32> = table.rgb.iter().map(|p| p[1]).filter(|v| *v > 0.0).collect();
        light.sort_by(f32::total_cmp);
        let key = light.get(light.len() * 9 / 10).map_or(1.0, |v| v.max(f32::MIN_POSITIVE));
        let shown = |v: f32| (255.0 * srgb_encode((v / (v.max(0.0) + 2.0 * key)).clamp(0.0, 1.0))) as u8;
        let mut bytes = vec![0; 2 * n * n * 3];
        for (i, entry) in table.rgb.iter().enumerate() {
            let h = [i % n, n - 1 - i / n].map(|k| (k as f64 + 0.5) * table.cell() - table.extent);
            let found = self.value(h);
            for c in 0..3 {
                let at = (i / n * 2 * n + i % n) * 3 + c;
                bytes[at] = shown(entry[c]);
                bytes[at + 3 * n] = shown(found[c] as f32);
            }
        }
        bytes
    }

    /// Sum of all terms at a half vector of the table.
    pub fn value(&self, h: [f64; 2]) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for part in &self.parts {
            let Some((place, z)) = part.grid.position(h) else { continue };
            let [column, row] = place.map(|p| p as usize);
            (0..3).for_each(|c| sum[c] += part.at(c, column, row) / (1.0 + z).powi(2));
        }
        sum
    }
}

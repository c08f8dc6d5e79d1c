//! `nacre factor`: a table in, its factors out.

use super::{Factors, Kind, MOST_RANK, Report, Settings};
use crate::environment::passes::{clamped, two_pass};
use crate::environment::{Environment, Table, normalized_error};
use nacre_base::Result;
use nacre_base::estimate::Work;
use nacre_base::progress::Progress;
use nacre_image::{Attribute, OutputFolder, write_exr, write_png8};
use nacre_optics::color::srgb_encode;
use std::path::Path;

/// Columns of the environment in which the error of the picture is measured.
const TRIAL: usize = 512;

/// Seconds and bytes that this takes.
const TRIAL_S: f64 = 13.0;
const TRIAL_BYTES: u64 = 120 << 20;

/// What `nacre factor` does.
#[derive(Clone, Copy, Debug)]
pub struct Job<'a> {
    /// The `lut.exr`.
    pub table: &'a Path,
    /// The environment in which the error of the picture is measured.
    pub environment: Option<&'a Path>,
    /// Layer of an OpenEXR environment that has several pictures.
    pub layer: Option<&'a str>,
    /// New folder for the results.
    pub out: &'a Path,
    /// What is asked.
    pub settings: Settings,
    /// Replace results that are there.
    pub overwrite: bool,
}

/// Factorises a table and writes `part-N-across.exr`, `part-N-along.exr`, `factors.png` and `report.json`.
///
/// # Errors
/// `Input` for anything about table, environment or settings, before anything is written; `Output`; `Cancelled`.
pub fn factor(job: &Job<'_>, progress: &dyn Progress) -> Result<Report> {
    let begun = std::time::Instant::now();
    job.settings.check()?;
    progress.expect(&job.work())?;
    let folder = OutputFolder::begin(job.out, job.overwrite)?;
    let table = Table::read(job.table)?;
    let environment = job.environment.map(|path| Environment::read(path, job.layer)).transpose()?;
    progress.stage("factorising", 0);
    let factors = Factors::of(&table, &job.settings)?;
    progress.check()?;
    let mut report = factors.report(&table, job.settings.kind);
    if let Some(environment) = environment {
        progress.stage("measuring the picture's error", 0);
        report.warnings.extend(environment.warnings());
        let (error, negative) = measured(&factors, &table, &job.settings, environment, progress)?;
        (report.picture_error, report.negative) = (Some(error), Some(negative));
        if negative > 0.02 {
            let words = format!(
                "the picture falls to -{:.0} % of its largest radiance; --kind nonnegative does not",
                100.0 * negative
            );
            report.warnings.push(words);
        }
    }
    factors.write(&folder, &table)?;
    report.seconds = begun.elapsed().as_secs_f64();
    folder.write_json("report.json", &report)?;
    folder.commit()?;
    Ok(report)
}

impl Job<'_> {
    /// Time, memory and disk, by the header of the table; the reader refuses one that is not understood. Measured at 256² to 1024² entries.
    fn work(&self) -> Work {
        /// Seconds for each entry of the table: in one part, in several, as one curve.
        const EACH_S: [f64; 3] = [2.4e-6, 7.4e-6, 0.4e-6];
        let entries: usize = nacre_image::size(self.table).map_or(0, |[width, height]| width * height);
        let each = match (self.settings.kind, self.settings.parts) {
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

/// Error of the picture against one with all terms, and how negative it gets.
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
    let all = Settings { rank: Some(MOST_RANK), kind: Kind::Singular, parts: 1, ..*settings };
    let truth = Factors::of(table, &all)?.reflected(&environment, progress)?;
    let mut found = factors.reflected(&environment, progress)?;
    let negative = clamped(&mut found);
    Ok((normalized_error(&found, &truth), negative))
}

impl Factors {
    /// The reflection of an environment by all parts together. Each part has a meridian of its own, so that this is what surfaces facing
    /// the middle of the picture, upright in it, reflect; towards the poles of the parts they turn.
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

    /// The table, and beside it the sum of its terms; what is folded in is taken out again.
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

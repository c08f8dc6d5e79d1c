//! The operation `inspect`: one sheet, a folder of sheets, or the training of limits.

use crate::inspection::{Inspection, Parameters, inspect};
use crate::limits::{LEAST_SAMPLES, Limits};
use crate::output::{write_batch, write_sheet};
use crate::report::{Report, SheetReport, Verdict};
use crate::sheet::{Sheet, is_sheet, signature};
use nacre_base::estimate::Work;
use nacre_base::operation::{Input, Operation};
use nacre_base::progress::Progress;
use nacre_base::{Error, OutputFolder, Result};
use nacre_image::size;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// Maximum number of sheets of a folder.
const MOST_SHEETS: usize = 10_000;

/// Seconds per pixel of the reference, and a bound of the bytes of memory per pixel of the largest sheet. An inspection
/// of 1024² pixels took 3.6 s and 217 bytes per pixel.
const EACH_S: f64 = 3.5e-6;
const EACH_BYTES: u64 = 600;

/// Inspect sheets against a reference: register, compare and find defects.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "InspectionOptions", extend(
    "x-input" = "The sample: a result folder of `nacre reconstruct`, or a folder of such folders",
    "x-examples" = "\
Examples:
  nacre inspect sample --reference good --out inspection
  nacre inspect good-samples --reference good --train --out trained
  nacre inspect samples --reference good --limits trained/limits.toml --out inspection
  nacre inspect sample --reference design/orientation.exr --out inspection

The sample is registered to the reference: turn and shift, then homography, then a smooth
displacement. Orientation, period, presence of a grating and brightness are compared in standard
deviations of both. Connected regions that differ are defects: missing, wrong orientation, wrong
period, scratch or dirt.

Writes report.json, report.html, report.pdf, defects.csv, pictures, and difference.exr (differences,
their σ, statistic, number of the defect); of a folder of samples, a subfolder for each, index.html
and summary.csv. The exit code is 1 if a sheet exceeds the limits."
))]
pub struct Options {
    /// Reference: the results of a good sheet, or a design with orientations (result folder or EXR map).
    #[schemars(extend("x-file" = true, "x-placeholder" = "RESULT|DESIGN"))]
    pub reference: PathBuf,
    /// Limits of good sheets, a TOML file of --train (default: no defect of any class).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(extend("x-file" = true, "x-placeholder" = "TOML"))]
    pub limits: Option<PathBuf>,
    /// Train limits: the samples are good; writes limits.toml.
    #[serde(default)]
    pub train: bool,
    /// Accepted false alarms per sheet, 0.000001 to 1; it sets the threshold of differences.
    #[serde(default = "false_alarms")]
    #[schemars(extend("x-placeholder" = "NUMBER"), range(min = 1e-6, max = 1.0))]
    pub false_alarms: f64,
    /// Smallest number of connected pixels of a defect, 1 to 10000.
    #[serde(default = "min_area_px")]
    #[schemars(extend("x-advanced" = true), range(min = 1, max = 10_000))]
    pub min_area_px: usize,
    /// Largest turn of the sample from the reference in degrees, 0 to 180.
    #[serde(default = "max_turn_deg")]
    #[schemars(extend("x-advanced" = true), range(min = 0.0, max = 180.0))]
    pub max_turn_deg: f64,
}

fn false_alarms() -> f64 {
    0.1
}

fn min_area_px() -> usize {
    4
}

fn max_turn_deg() -> f64 {
    10.0
}

impl Operation for Options {
    const NAME: &'static str = "inspect";
    const TITLE: &'static str = "Defects of a sheet, by comparison with a reference";
    const INPUT: Input = Input::Maps;
    type Report = Report;

    fn check_options(&self) -> Result<()> {
        let within = |key: &str, value: f64, low: f64, high: f64| {
            let remedy = format!("give a number from {low} to {high}");
            if (low..=high).contains(&value) { Ok(()) } else { Err(Error::input(key, format!("is {value}"), remedy)) }
        };
        within("false_alarms", self.false_alarms, 1e-6, 1.0)?;
        within("min_area_px", self.min_area_px as f64, 1.0, 1e4)?;
        within("max_turn_deg", self.max_turn_deg, 0.0, 180.0)?;
        if self.train && self.limits.is_some() {
            return Err(Error::input(
                "limits",
                "does not go with --train, which writes limits",
                "leave one of them out",
            ));
        }
        Ok(())
    }

    fn check(&self, input: &Path) -> Result<Work> {
        self.check_options()?;
        self.limits.as_deref().map(Limits::read).transpose()?;
        let samples = samples(input)?;
        if self.train && samples.len() < LEAST_SAMPLES {
            let problem = format!("holds {} good samples", samples.len());
            return Err(Error::file(input, problem, format!("give a folder of at least {LEAST_SAMPLES}")));
        }
        let pixels = pixels_of(&self.reference)?;
        let mut largest = pixels;
        for path in &samples {
            largest = largest.max(pixels_of(path)?);
        }
        Ok(Work {
            operation: "inspect".into(),
            seconds: 0.1 + EACH_S * pixels as f64 * samples.len() as f64,
            memory_bytes: EACH_BYTES * largest,
            disk_bytes: 60 * pixels * samples.len() as u64,
            ..Work::default()
        })
    }

    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Report> {
        let reference = Sheet::read(&self.reference)?;
        let limits = self.limits.as_deref().map(Limits::read).transpose()?.unwrap_or_default();
        let limits_sha256 = self.limits.as_deref().map(signature).transpose()?.map(|s| s.sha256);
        let samples = samples(input)?;
        let batch = input.is_dir() && !is_sheet(input);
        let mut report = Report {
            method: "inspect",
            reference: reference.origin.clone(),
            false_alarms: self.false_alarms,
            min_area_px: self.min_area_px,
            limits,
            limits_sha256,
            trained: self.train,
            sheets: vec![],
            rejected: 0,
            inspected_s: SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs()),
            warnings: vec![],
        };
        for path in &samples {
            let sample = Sheet::read(path)?;
            let (sheet, found) = self.inspected(&reference, sample, &report.limits, progress)?;
            if !self.train {
                let folder = if batch { format!("{}/", sheet.sample.name) } else { String::new() };
                out.create_dir(folder.trim_end_matches('/'))?;
                write_sheet(out, &folder, &report, &sheet, &found)?;
            }
            report.warnings.extend(sheet.warnings.iter().map(|w| format!("{}: {w}", sheet.sample.name)));
            report.sheets.push(sheet);
        }
        if self.train {
            report.limits = Limits::trained(&report.sheets, self.false_alarms)?;
            out.write("limits.toml", report.limits.to_toml().as_bytes())?;
        }
        report.rejected = report.sheets.iter().filter(|s| s.verdict == Verdict::Reject).count();
        if batch && !self.train {
            write_batch(out, &report)?;
        }
        Ok(report)
    }

    fn missed(&self, report: &Report) -> Option<String> {
        let first = report.sheets.iter().find(|s| s.verdict == Verdict::Reject)?;
        let why = first.exceeded.first().cloned().unwrap_or_default();
        let count = match report.sheets.len() {
            1 => "rejected".into(),
            all => format!("{} of {all} sheets are rejected", report.rejected),
        };
        Some(format!("{count}: {}: {why}; see report.html", first.sample.name))
    }
}

impl Options {
    fn inspected(
        &self,
        reference: &Sheet,
        sample: Sheet,
        limits: &Limits,
        progress: &dyn Progress,
    ) -> Result<(SheetReport, Inspection)> {
        let parameters = Parameters {
            false_alarms: self.false_alarms,
            min_area_px: self.min_area_px,
            max_turn_deg: self.max_turn_deg,
            trained: limits.threshold,
        };
        let sample = if reference.has_light { sample } else { sample.without_light() };
        let plain;
        let reference = if reference.has_light && !sample.has_light {
            plain = reference.clone().without_light();
            &plain
        } else {
            reference
        };
        let found = inspect(reference, &sample, &parameters, progress).map_err(|error| match error {
            Error::Input { subject, problem, remedy } if subject == "sample" => {
                Error::input(&sample.origin.name, problem, remedy)
            }
            other => other,
        })?;
        let sheet = SheetReport::new(reference, &sample, &found);
        Ok((if self.train { sheet } else { sheet.judged(limits) }, found))
    }
}

/// Number of pixels of a result folder or map, by its header.
fn pixels_of(path: &Path) -> Result<u64> {
    let file = Some(path.join("orientation.exr")).filter(|file| file.is_file());
    let [width, height] = size(&file.unwrap_or_else(|| path.to_owned()))?;
    Ok(width as u64 * height as u64)
}

/// The result folders of an input, in the order of their names.
fn samples(input: &Path) -> Result<Vec<PathBuf>> {
    if is_sheet(input) {
        return Ok(vec![input.to_owned()]);
    }
    let remedy = "give a result folder with orientation.exr, or a folder of such folders";
    let unreadable = |e: std::io::Error| Error::file(input, format!("cannot be read: {e}"), remedy);
    let entries = std::fs::read_dir(input).map_err(unreadable)?;
    let mut found: Vec<PathBuf> =
        entries.filter_map(|e| Some(e.ok()?.path())).filter(|p| p.is_dir() && is_sheet(p)).collect();
    found.sort();
    if found.is_empty() || found.len() > MOST_SHEETS {
        return Err(Error::file(input, format!("holds {} result folders", found.len()), remedy));
    }
    Ok(found)
}

//! `nacre brdf tables`.

use super::common::{Metal, Surface};
use crate::console::Console;
use clap::ValueEnum;
use nacre_base::vacant;
use nacre_brdf::tables::{half_vector, measured, merl};
use nacre_brdf::{Report, Settings};
use nacre_capture::Failure;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `nacre brdf tables`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre brdf tables snake.exr --out snake.bsdf                      Mitsuba: <bsdf type=\"measured\">
  nacre brdf tables snake.exr --size 96 --angles 16,48 --out fine.bsdf
  nacre brdf tables bumps.exr --material aluminium --out bumps.binary   MERL, if the surface is isotropic
  nacre brdf tables shallow.exr --out lut.exr                       table material of nacre render

The ending of --out gives the format. A table cannot hold lobes that are narrower than its cells: without --coherence-um,
lobes are as wide as a cell. The report (FILE.json) states the coherence, and the error of the table, measured at random
pairs of directions.")]
pub struct Tables {
    #[command(flatten)]
    surface: Surface,
    /// Format (default: that of the ending of --out: .bsdf, .exr or .binary).
    #[arg(long)]
    format: Option<Format>,
    /// Entries along a side of the half vectors (default: 64 of mitsuba, 512 of half-vector; merl has 90).
    #[arg(long, value_name = "N")]
    size: Option<usize>,
    /// Polar angles and azimuths of the light in a Mitsuba tensor.
    #[arg(long, value_name = "THETA,PHI", default_value = "12,32", value_parser = angles)]
    angles: [usize; 2],
    /// Coherence width of the light in µm (default: that of lobes as wide as a cell).
    #[arg(long, value_name = "UM", allow_negative_numbers = true)]
    coherence_um: Option<f64>,
    #[command(flatten)]
    metal: Metal,
    /// Spectrum of the light for colours: a name or a CSV file. Spectra do not depend on it.
    #[arg(long, default_value = "D65", value_name = "NAME|FILE.csv")]
    illuminant: String,
    /// Table; a report (JSON) is written beside it.
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Replace existing files.
    #[arg(long)]
    force: bool,
}

/// Formats of tables.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// Tensor of Mitsuba's `measured` material, with spectra.
    Mitsuba,
    /// Table over half vectors, as those of `nacre reconstruct lut`.
    HalfVector,
    /// Isotropic table as in the MERL set.
    Merl,
}

/// Report fields specific to tables.
#[derive(Serialize)]
struct More {
    /// Number of entries along each axis.
    shape: Vec<usize>,
    extent: f64,
    /// Root mean square difference between table and BRDF, over the root mean square of the BRDF (measured).
    table_error: f64,
    /// Directions that `table_error` is of.
    table_error_of: &'static str,
    bytes: u64,
}

fn angles(text: &str) -> Result<[usize; 2], String> {
    let numbers: Option<Vec<usize>> = text.split(',').map(|v| v.trim().parse().ok()).collect();
    numbers.and_then(|n| n.try_into().ok()).ok_or_else(|| "give two numbers, such as 12,32".into())
}

impl Tables {
    fn format(&self) -> Result<Format, Failure> {
        let ending = self.out.extension().map(|e| e.to_string_lossy().to_lowercase());
        let of_ending = match ending.as_deref() {
            Some("bsdf") => Some(Format::Mitsuba),
            Some("exr") => Some(Format::HalfVector),
            Some("binary") => Some(Format::Merl),
            _ => None,
        };
        self.format.or(of_ending).ok_or_else(|| {
            let remedy = "give --format, or a name that ends in .bsdf, .exr or .binary";
            nacre_base::Error::file(&self.out, "does not say its format", remedy).into()
        })
    }

    /// Computes and writes the table.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let begun = Instant::now();
        let format = self.format()?;
        let json = self.out.with_extension("json");
        vacant(&[self.out.clone(), json.clone()], self.force)?;
        let settings = self.metal.add(Settings { illuminant: self.illuminant.clone(), ..Settings::default() });
        let (field, quality) = self.surface.read(self.coherence_um.unwrap_or(settings.coherence_um), console)?;
        let (out, coherence) = (&self.out, self.coherence_um);
        let table = match format {
            Format::Mitsuba => {
                let sizes = (self.size.unwrap_or(64), self.angles);
                measured(&field, &quality, &settings, coherence, sizes, out, console)
            }
            Format::HalfVector => {
                half_vector(&field, &quality, &settings, coherence, self.size.unwrap_or(512), out, console)
            }
            Format::Merl => merl(&field, &quality, &settings, coherence, out, console),
        }?;
        let report = Report {
            product: "table",
            warnings: [quality.warnings.clone(), table.warnings].concat(),
            input: self.surface.path().into(),
            quality: quality.clone(),
            error_estimate: table.choice.predicted_error.max(table.choice.measured_error.unwrap_or(0.0)),
            settings: Settings { coherence_um: table.coherence_um, ..settings },
            choice: table.choice,
            more: More {
                shape: table.shape,
                extent: table.extent,
                table_error: table.error,
                table_error_of: table.error_of,
                bytes: self.out.metadata().map_or(0, |m| m.len()),
            },
            seconds: begun.elapsed().as_secs_f64(),
            files: vec![self.out.clone(), json.clone()],
        };
        report.write(&json)?;
        let shape: Vec<String> = report.more.shape.iter().map(usize::to_string).collect();
        let text = format!(
            "table     {} entries, {:.1} MB\nerror     {:.1} % of the BRDF (root mean square, {}, measured)\nlobes     as with a coherence of {:.1} µm",
            shape.join(" × "),
            report.more.bytes as f64 / 1e6,
            100.0 * report.more.table_error,
            report.more.table_error_of,
            report.settings.coherence_um
        );
        console.result(&report.lines(&text), &report);
        Ok(())
    }
}

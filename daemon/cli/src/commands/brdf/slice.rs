//! `nacre brdf slice`.

use super::common::{List, Material, Optics, Surface, direction};
use crate::console::Console;
use nacre_base::vacant;
use nacre_brdf::output::{check_rows, write_slice};
use nacre_brdf::{Report, slice};
use nacre_capture::Failure;
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `nacre brdf slice`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre brdf slice blazed.exr --light 75,0 --wavelengths 380:780:5 --views=-90:90:0.1 --out slice.csv
  nacre brdf slice snake.png --pixel-um 0.08 --range-um 0.43 --wavelengths 550 --azimuth 90 --out along.csv

Writes FILE.csv (wavelength_nm, theta_r_deg, reflectance) and FILE.json (method and accuracy). Angles are positive towards
the azimuth; reflectance at grazing angles is NaN.")]
pub struct Slice {
    #[command(flatten)]
    surface: Surface,
    /// Direction of incident light in degrees: angle from the normal, azimuth anticlockwise from the right.
    #[arg(long, default_value = "0,0", value_name = "THETA,PHI", value_parser = direction, allow_hyphen_values = true)]
    light: [f64; 2],
    /// Wavelengths in nm: FROM:TO:STEP or a list of numbers.
    #[arg(long, default_value = "380:780:5", value_name = "LIST")]
    wavelengths: List,
    /// Viewing angles from the normal in degrees: FROM:TO:STEP or a list of numbers.
    #[arg(long, default_value = "-90:90:0.1", value_name = "LIST", allow_hyphen_values = true)]
    views: List,
    /// Azimuth of the half circle of viewing directions in degrees (default: azimuth of the light).
    #[arg(long, value_name = "PHI", allow_negative_numbers = true)]
    azimuth: Option<f64>,
    #[command(flatten)]
    optics: Optics,
    #[command(flatten)]
    material: Material,
    /// Table (CSV); a report (JSON) is written beside it.
    #[arg(long, value_name = "FILE.csv")]
    out: PathBuf,
    /// Replace existing files.
    #[arg(long)]
    force: bool,
}

/// Report fields specific to slices.
#[derive(Serialize)]
struct More {
    wavelengths: usize,
    views: usize,
}

impl Slice {
    /// Computes and writes the slice.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let begun = Instant::now();
        let json = self.out.with_extension("json");
        vacant(&[self.out.clone(), json.clone()], self.force)?;
        let (wavelengths, views) = (&self.wavelengths.0, &self.views.0);
        check_rows(wavelengths.len().saturating_mul(views.len()))?;
        let settings = self.material.add(self.optics.settings(self.light));
        settings.check()?;
        let (field, quality) = self.surface.read(settings.coherence_um, console)?;
        let slice = slice(&field, &quality, &settings, [wavelengths, views], self.azimuth, console)?;
        write_slice(&self.out, &slice)?;
        let report = Report {
            product: "slice",
            warnings: quality.warnings.clone(),
            input: self.surface.path().into(),
            quality: quality.clone(),
            settings: settings.clone(),
            choice: slice.choice.clone(),
            error_estimate: slice.error_estimate,
            more: More { wavelengths: wavelengths.len(), views: views.len() },
            seconds: begun.elapsed().as_secs_f64(),
            files: vec![self.out.clone(), json.clone()],
        };
        report.write(&json)?;
        let text = format!("slice     {} wavelengths × {} angles", wavelengths.len(), views.len());
        console.result(&report.lines(&text), &report);
        self.optics.judge(slice.error_estimate)
    }
}

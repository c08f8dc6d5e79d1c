//! `nacre brdf check`.

use super::common::{List, Optics, Surface};
use crate::console::Console;
use nacre_base::vacant;
use nacre_brdf::output::{write_check, write_check_picture};
use nacre_brdf::{Report, check};
use nacre_capture::Failure;
use std::fmt::Write;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `nacre brdf check`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre brdf check blazed.exr --light 75
  nacre brdf check snake.png --pixel-um 0.08 --range-um 0.43 --light 75 --out peaks.csv

At each wavelength, the peak angle of the first order gives a period, λ/(sin θi + sin θr). The mean and variance of these
periods are compared with the period of the heights. If a patch cuts a single grating, one of its periods represents
it. Peaks are interpolated after division by the gain. --out writes FILE.csv (wavelength_nm, theta_r_deg, period_nm,
relative), FILE.svg (plot with the grating equation) and FILE.json.")]
pub struct Check {
    #[command(flatten)]
    surface: Surface,
    /// Angle of incidence from the normal in degrees.
    #[arg(long, default_value_t = 75.0, value_name = "THETA", allow_negative_numbers = true)]
    light: f64,
    /// Azimuth of the plane of incidence in degrees (default: direction of the strongest period).
    #[arg(long, value_name = "PHI", allow_negative_numbers = true)]
    azimuth: Option<f64>,
    /// Expected period in µm (default: strongest period in the spectrum of the heights).
    #[arg(long, value_name = "A", allow_negative_numbers = true)]
    period_um: Option<f64>,
    /// Wavelengths in nm: FROM:TO:STEP or a list of numbers.
    #[arg(long, default_value = "380:780:5", value_name = "LIST")]
    wavelengths: List,
    #[command(flatten)]
    optics: Optics,
    /// Table of peaks (CSV); a plot (SVG) and a report (JSON) are written beside it.
    #[arg(long, value_name = "FILE.csv")]
    out: Option<PathBuf>,
    /// Replace existing files.
    #[arg(long)]
    force: bool,
}

impl Check {
    /// Measures the peaks of the first order and compares them with the grating equation.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let begun = Instant::now();
        let files: Vec<PathBuf> = self
            .out
            .iter()
            .flat_map(|out| [out.clone(), out.with_extension("svg"), out.with_extension("json")])
            .collect();
        vacant(&files, self.force)?;
        let settings = self.optics.settings([self.light, self.azimuth.unwrap_or(0.0)]);
        settings.check()?;
        let (field, quality) = self.surface.read(settings.coherence_um, console)?;
        let given = [self.period_um, self.azimuth];
        let found = check(&field, &quality, &settings, &self.wavelengths.0, given, console)?;
        let choice = &found.choice;
        let report = Report {
            product: "check",
            warnings: found.warnings.clone(),
            input: self.surface.path().into(),
            quality: quality.clone(),
            settings: settings.clone(),
            choice: choice.clone(),
            error_estimate: choice.predicted_error.max(choice.measured_error.unwrap_or(0.0)),
            more: &found,
            seconds: begun.elapsed().as_secs_f64(),
            files: files.clone(),
        };
        if let [csv, picture, json] = files.as_slice() {
            write_check(csv, &found)?;
            write_check_picture(picture, &found)?;
            report.write(json)?;
        }
        let mut text = format!(
            "equation  mean {:.3} nm, variance {:.4} nm², {:.1} expected, over {} wavelengths towards {:.1}°",
            found.mean_nm,
            found.variance_nm2,
            found.expected_nm,
            found.peaks.len(),
            found.azimuth_deg
        );
        if let Some(periods) = found.cut_periods {
            let _ = write!(
                text,
                "\nwhole     the patch holds {periods:.2} periods: one, averaged over all, is repeated in its place"
            );
        }
        if found.ridges.len() > 1 {
            for [nm, share] in &found.ridges {
                let _ = write!(text, "\nridge     {nm:.1} nm at {:.0} % of the wavelengths", 100.0 * share);
            }
        }
        console.result(&report.lines(&text), &report);
        self.optics.judge(report.error_estimate)
    }
}

//! `nacre reconstruct spots`.

use crate::commands::Estimating;
use crate::commands::said::lines;
use crate::commands::values::{PictureArgs, numbers};
use crate::console::Console;
use nacre_capture::Failure;
use nacre_optics::geometry;
use nacre_periods::spots::{Report, Settings, reconstruct};
use std::fmt::Write;
use std::path::PathBuf;

/// Arguments of `nacre reconstruct spots`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre reconstruct spots session --out periods
  nacre reconstruct spots session --geometry geometry.json --wavelength 560 --wavelength-sigma 1 --out periods
  nacre reconstruct spots session --polarization maps --periods 1.2,3 --out periods

with a session that was taken by a plan such as:
  kind = \"spots\"
  spots = { fringes = { count = 12, phases = 4, finest_mm = 28 } }
  extras = [\"display_black\"]

Writes orientation.exr (orientation, sigma in rad, mask), period.exr (period, sigma in µm, mask), orientation.png, period.png
and report.json. Pixels whose light no single grating explains, whose orders miss the panel, or which two gratings
explain, are masked.")]
pub struct Spots {
    /// A session of kind spots with fringes, a frames.json or a folder holding one.
    input: PathBuf,
    /// Folder for the results.
    #[arg(long)]
    out: PathBuf,
    /// Where camera, sample and panel stand (geometry.json; default: the distances of frames.json).
    #[arg(long, value_name = "FILE")]
    geometry: Option<PathBuf>,
    /// Effective wavelength of light, filter and camera together (default: that of the geometry or of frames.json).
    #[arg(long, value_name = "NM")]
    wavelength: Option<f64>,
    /// How far that may be off, one standard deviation; it goes into the σ of all periods.
    #[arg(long, value_name = "NM")]
    wavelength_sigma: Option<f64>,
    /// Width and height of the panel in mm (default: as the geometry or frames.json says).
    #[arg(long, value_name = "W,H", value_parser = pair)]
    panel: Option<[f64; 2]>,
    /// Diameter of the camera's aperture in mm (default: found from the photographs).
    #[arg(long, value_name = "MM")]
    aperture: Option<f64>,
    /// Shortest and longest period that is looked for, in µm.
    #[arg(long, value_name = "UM,UM", default_value = "0.7,4", value_parser = pair)]
    periods: [f64; 2],
    /// How far the surface may tilt from the plane, one standard deviation of the mirror direction in degrees.
    #[arg(long, value_name = "DEG", default_value_t = 0.2)]
    mirror: f64,
    /// Results of `reconstruct polarization` of the same sample and camera, which decide between gratings.
    #[arg(long, value_name = "DIR")]
    polarization: Option<PathBuf>,
    #[command(flatten)]
    pictures: PictureArgs,
    /// Replace results that are already in the folder.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    estimating: Estimating,
}

fn pair(text: &str) -> Result<[f64; 2], String> {
    numbers(text, "two numbers, such as 520,320")
}

impl Spots {
    /// Makes the maps.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let geometry = self.geometry.as_deref().map(geometry::load).transpose()?;
        let settings = Settings {
            geometry: geometry.map(Box::new),
            wavelength_nm: self.wavelength,
            wavelength_sigma_nm: self.wavelength_sigma,
            panel_mm: self.panel,
            aperture_mm: self.aperture,
            periods_um: self.periods,
            mirror_deg: self.mirror,
            palette: self.pictures.palette,
            no_scale_bar: self.pictures.bar.no_scale_bar,
            polarization: self.polarization.clone(),
            overwrite: self.force,
        };
        let report = reconstruct(&self.input, &self.out, &settings, console)?;
        let mut text = summary(&report);
        let _ = write!(text, "\nresults   {}", self.out.display());
        console.result(&text, &report);
        Ok(())
    }
}

/// The report in a few lines.
fn summary(report: &Report) -> String {
    let all = (report.width * report.height).max(1) as f64;
    let p = &report.pixels;
    let part = |n: usize| format!("{:.1} %", 100.0 * n as f64 / all);
    let mut text = format!(
        "pixels    {} × {}: {} resolved, {} without orders in reach, {} of no single grating, {} ambiguous, {} dark, {} unusable\n",
        report.width,
        report.height,
        part(p.resolved),
        part(p.no_order),
        part(p.unexplained),
        part(p.ambiguous),
        part(p.dark),
        part(p.unusable)
    );
    let _ = writeln!(
        text,
        "light     {} patterns, {} different fringes, {} nm",
        report.patterns, report.fringes, report.wavelength_nm
    );
    let said = |value: Option<f64>, factor: f64| value.map_or("unknown".into(), |v| format!("{:.3}", factor * v));
    let _ = writeln!(
        text,
        "quality   median σ {}° of orientation, {} % of period, and {:.2} % that all periods share; residual {}",
        said(report.orientation_sigma_deg, 1.0),
        said(report.period_sigma, 100.0),
        100.0 * report.period_scale_sigma,
        said(report.residual, 1.0)
    );
    if let Some([x, y]) = report.mirror_offset_deg {
        let _ = writeln!(
            text,
            "mirror    {x:.3}°, {y:.3}° from where the geometry puts it; aperture {:.1} mm",
            report.aperture_mm
        );
    }
    let _ = writeln!(text, "panel     exponent {:.3} of the assumed one", report.response.power);
    if let Some(d) = &report.discs {
        let said = d.residual.map_or("unknown".into(), |r| format!("{r:.2}"));
        let _ = writeln!(
            text,
            "discs     {} photographs, {} pixels decided, {} contradicted; residual {said}",
            d.discs, d.decided, d.contradicted
        );
    }
    if let Some(h) = &report.polarization {
        let _ = writeln!(
            text,
            "polarized offset {:.2}° (spread {:.2}° over {} pixels), {} decided, {} contradicted",
            h.offset_deg, h.spread_deg, h.shared, h.decided, h.contradicted
        );
    }
    text += &lines(&report.assumptions, &report.warnings);
    let s = &report.seconds;
    let _ = write!(
        text,
        "time      {:.2} s: reading {:.2}, aperture {:.2}, orders {:.2}, writing {:.2}",
        s.total, s.read, s.calibrate, s.solve, s.write
    );
    text
}

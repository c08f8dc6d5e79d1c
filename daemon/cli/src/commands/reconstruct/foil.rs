//! `nacre reconstruct foil`.

use crate::commands::Estimating;
use crate::commands::said::lines;
use crate::commands::values::numbers;
use crate::console::Console;
use nacre_capture::Failure;
use nacre_lut::foil::{self, Settings};
use nacre_optics::geometry;
use std::fmt::Write;
use std::path::PathBuf;

/// Arguments of `nacre reconstruct foil`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre reconstruct foil hdr.exr --geometry geometry.json --depth-um 0.08 --out spiral
  nacre reconstruct foil session --geometry geometry.json --period-um 0.8,1.5 --out spiral
  nacre synthesize spiral --size 1024,1024 --pixel-um 25 --square-px 3 --out new

Takes one photograph of the foil under a flash behind a narrow-band filter, linear and of high dynamic range, and where camera, foil and
light were (nacre calibrate geometry). Writes histogram.exr (share, sigma, coverage), histogram.png and report.json.")]
pub struct Foil {
    /// The photograph (EXR, or 16-bit PNG or TIFF in linear light), results of `reconstruct hdr`, or a session of exposures, which are
    /// merged first.
    input: PathBuf,
    /// Where camera, foil and light were (JSON; default: geometry.json beside the photograph).
    #[arg(long, value_name = "FILE")]
    geometry: Option<PathBuf>,
    /// Folder for the results.
    #[arg(long)]
    out: PathBuf,
    /// Shortest and longest period; as far as the photograph shows if not said.
    #[arg(long, value_name = "MIN,MAX", value_parser = |t: &str| numbers::<f64, 2>(t, "the shortest and the longest: 0.8,1.6"), allow_hyphen_values = true)]
    period_um: Option<[f64; 2]>,
    /// Bins of orientation and of period; as fine as pixels allow if not said.
    #[arg(long, value_name = "N,M", value_parser = |t: &str| numbers::<usize, 2>(t, "two whole numbers: 180,64"))]
    bins: Option<[usize; 2]>,
    /// Depth of the gratings: takes second and third orders out.
    #[arg(long, value_name = "UM", allow_negative_numbers = true)]
    depth_um: Option<f64>,
    /// Height of the light above the foil, for a geometry without a light: the zero order tells the rest.
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    light_height_mm: Option<f64>,
    /// Replace results that are already in the folder.
    #[arg(long, visible_alias = "overwrite")]
    force: bool,
    #[command(flatten)]
    estimating: Estimating,
}

impl Foil {
    /// Runs the reconstruction.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let settings = Settings {
            geometry: self.geometry.as_deref().map(geometry::load).transpose()?,
            period_um: self.period_um,
            bins: self.bins,
            depth_um: self.depth_um,
            light_height_mm: self.light_height_mm,
            overwrite: self.force,
        };
        let report = foil::reconstruct(&self.input, &self.out, &settings, console)?;
        let [mean, spread] = report.period_um;
        let relative = if report.relative { " (relative)" } else { "" };
        let mut text = format!(
            "dots      periods of {mean:.3} µm{relative} on average, {spread:.3} µm standard deviation\n\
             bins      {} of orientation, {} of period; {:.0} % of them are in the photograph\n",
            report.bins[0],
            report.bins[1],
            100.0 * report.covered
        );
        text += &lines(&[], &report.warnings);
        let _ = write!(text, "time      {:.2} s\nresults   {}", report.seconds, self.out.display());
        console.result(&text, &report);
        Ok(())
    }
}

//! `nacre reconstruct hdr`.

use crate::commands::Estimating;
use crate::commands::said::{lines, meets};
use crate::console::Console;
use nacre_capture::Failure;
use nacre_frames::hdr::{self, Options, Report, ResponseChoice};
use nacre_polarimetry::Align;
use std::fmt::Write;
use std::path::PathBuf;

/// Arguments of `nacre reconstruct hdr`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre reconstruct hdr photos/ --out result              exposure times from Exif; response recovered
  nacre reconstruct hdr session --out result              a session of kind exposures
  nacre reconstruct hdr photos/ --out result --response earlier/response.json

Writes hdr.exr (R G B or Y; NaN where every exposure is saturated), variance.exr, flags.exr (0 measured,
1 saturated, 2 dark in every exposure), hdr.png (tone-mapped), report.json, and response.json where a
response was recovered.")]
pub struct Hdr {
    /// Session folder, frames.json, or a folder of photographs that say their exposure times (Exif).
    input: PathBuf,
    /// Folder for the results.
    #[arg(long)]
    out: PathBuf,
    /// How values grow with light: linear, recover, or the response.json of an earlier recovery.
    ///
    /// By default as frames.json says; photographs without one are recovered from where they have 8 bits, else linear.
    #[arg(long, value_name = "linear|recover|FILE")]
    response: Option<ResponseChoice>,
    /// auto moves exposures that lie shifted against each other back, where that is worth it; off leaves them.
    #[arg(long, default_value = "auto", value_name = "auto|off")]
    align: Align,
    /// File value of a saturated pixel; by default as the photographs and frames.json say.
    #[arg(long, value_name = "VALUE")]
    white: Option<f64>,
    /// Largest acceptable relative standard deviation of a typical value; the results are written in any case, but the exit
    /// code is 1 when it is larger.
    #[arg(long, value_name = "REL")]
    max_error: Option<f64>,
    /// Replace results that are already in the folder.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    estimating: Estimating,
}

impl Hdr {
    /// Runs the reconstruction.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let response = self.response.clone().unwrap_or_default();
        let options = Options { response, align: self.align, white: self.white, overwrite: self.force };
        let report = hdr::reconstruct(&self.input, &self.out, &options, console)?;
        let mut text = summary(&report);
        let _ = write!(text, "\nresults   {}", self.out.display());
        console.result(&text, &report);
        let said = ["σ of a typical value, over itself,", "", "expose longer or take more exposures"];
        meets(self.max_error, report.error_estimate, said)
    }
}

/// The report in a few lines.
fn summary(report: &Report) -> String {
    let mut text = format!(
        "frames    {} exposure{}, {} × {} pixels, {}\n",
        report.frames.len(),
        if report.frames.len() == 1 { "" } else { "s" },
        report.width,
        report.height,
        report.channels.join(" "),
    );
    let known = report.response_sigma.map_or(String::new(), |s| format!(", known to {:.2} %", 100.0 * s));
    let _ = writeln!(text, "response  {}{known}", report.response);
    let percent = |n: usize| 100.0 * n as f64 / report.samples.all.max(1) as f64;
    let _ = writeln!(
        text,
        "samples   {:.2} % saturated in every exposure, {:.2} % dark in every exposure",
        percent(report.samples.saturated),
        percent(report.samples.dark)
    );
    if let Some(range) = report.dynamic_range {
        let _ = writeln!(text, "range     {range:.0} : 1 ({:.1} EV) measured", range.log2());
    }
    if let Some(sigma) = report.error_estimate {
        let _ = writeln!(text, "quality   σ of a typical value {:.3} % (noise {})", 100.0 * sigma, report.noise);
    }
    if report.registration.as_ref().is_some_and(|r| r.corrected) {
        let _ = writeln!(text, "aligned   exposures that lay shifted were moved back (see report.json)");
    }
    text += &lines(&[], &report.warnings);
    let s = &report.seconds;
    let _ = write!(
        text,
        "time      {:.2} s: looking {:.2}, reading and merging {:.2}, writing {:.2}",
        s.total, s.look, s.merge, s.write
    );
    text
}

//! `nacre brdf terms`.

use super::common::{Optics, Surface};
use crate::console::Console;
use nacre_base::progress::Progress;
use nacre_brdf::{TermSet, Terms as Set, TermsAbout, TermsRequest};
use nacre_capture::Failure;
use nacre_image::{OutputFolder, Precision};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;

/// Arguments of `nacre brdf terms`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre brdf terms snake.exr --out terms
  nacre brdf terms snake.exr --max-error 0.2 --out small                          a bound that permits 16 bits
  nacre brdf terms bokeh.exr --method taylor --order 1 --max-error 0.5 --out first   first order only
  nacre brdf terms coarse.exr --extent 0.5 --out near                             coarse pixels: near the mirror direction only

Writes DIR/term_000.exr and so on, and DIR/terms.json. Each EXR holds the Fourier transform (re, im) of a polynomial of the
height, with zero frequency in the middle and y up. terms.json holds number, range, precision, predicted error, and the
formula for the BRDF. The written files are read back and compared with direct sums.")]
pub struct Terms {
    #[command(flatten)]
    surface: Surface,
    #[command(flatten)]
    optics: Optics,
    /// Largest in-plane component of ωi + ωr; 2 covers all directions of light and viewer.
    #[arg(long, default_value_t = 2.0, value_name = "E", allow_negative_numbers = true)]
    extent: f64,
    /// Number format: half, float, or auto for the smaller one that meets --max-error.
    #[arg(long, default_value = "auto", value_name = "auto|half|float", value_parser = precision)]
    precision: Wanted,
    /// Folder for the terms.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Replace existing files.
    #[arg(long)]
    force: bool,
}

/// Requested precision; `None` selects the smallest one that meets the error.
#[derive(Clone, Copy)]
struct Wanted(Option<Precision>);

fn precision(text: &str) -> Result<Wanted, String> {
    match text {
        "auto" => Ok(Wanted(None)),
        "half" => Ok(Wanted(Some(Precision::Half))),
        "float" => Ok(Wanted(Some(Precision::Float))),
        _ => Err("give auto, half or float".into()),
    }
}

/// Report of the command.
#[derive(Serialize)]
struct Made<'a> {
    #[serde(flatten)]
    about: &'a TermsAbout,
    measured_error: Option<f64>,
    megabytes: f64,
    seconds: f64,
    out: &'a PathBuf,
}

impl Terms {
    /// Computes and writes the terms, then verifies the written files.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let begun = Instant::now();
        let folder = OutputFolder::begin(&self.out, self.force)?;
        let settings = self.optics.settings([0.0; 2]);
        settings.check()?;
        let (field, _) = self.surface.read(settings.coherence_um, console)?;
        let wanted = TermsRequest { extent: self.extent, precision: self.precision.0 };
        let set = TermSet::new(&field, &settings, wanted, console)?;
        set.write(&folder, console)?;
        folder.commit()?;
        console.stage("comparing with direct sums", 1);
        let read = Set::read(&self.out)?;
        let about = read.about().clone();
        let measured_error = read.measured(&field, settings.coherence_um)?;
        let [width, height] = about.reach.map(|r| 2 * r + 1);
        let bits = if about.precision == Precision::Half { 16 } else { 32 };
        let made = Made {
            about: &about,
            measured_error,
            megabytes: (about.terms * width * height * bits / 4) as f64 / 1e6,
            seconds: begun.elapsed().as_secs_f64(),
            out: &self.out,
        };
        let text = format!(
            "terms     {} {} terms of {width} × {height} frequencies, {bits} bits, {:.1} MB\nquality   error at most {:.3} % ({} \
             measured against direct sums)\ntime      {:.2} s\nwrote     {}",
            about.terms,
            about.kind,
            made.megabytes,
            100.0 * about.predicted_error,
            measured_error.map_or("nothing".into(), |e| format!("{:.4} %", 100.0 * e)),
            made.seconds,
            self.out.display()
        );
        console.result(&text, &made);
        self.optics.judge(about.predicted_error.max(measured_error.unwrap_or(0.0)))
    }
}

//! `nacre map mask`.

use crate::console::Console;
use nacre_base::operation::lines;
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_image::{OutputFolder, write_png8};
use nacre_maps::segment;
use std::path::PathBuf;

/// Arguments of `nacre map mask`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre map mask flash.jpg --out stripes
  nacre map mask flash.jpg --threshold 0.4 --out stripes

Takes a photograph of the sample under a flash. Writes mask.png (white where the sample diffracts), which `coverage` of a scene's material
takes, and report.json. A scene may also name the photograph itself: coverage = { photograph = \"flash.jpg\" }.")]
pub struct Mask {
    /// The photograph.
    photograph: PathBuf,
    /// Folder for the mask.
    #[arg(long)]
    out: PathBuf,
    /// Brightness from which the sample diffracts: 0 to 1 of the largest code, or the value of an EXR [default: where bright and dark pixels differ most].
    #[arg(long, value_name = "T")]
    threshold: Option<f64>,
    /// Replace files that are already in the folder.
    #[arg(long)]
    force: bool,
}

impl Mask {
    pub(super) fn run(&self, console: &Console) -> Result<(), Failure> {
        let folder = OutputFolder::begin(&self.out, self.force)?;
        let found = segment(&self.photograph, self.threshold)?;
        console.check()?;
        let gray: Vec<u8> = found.inside.iter().map(|inside| if *inside { 255 } else { 0 }).collect();
        write_png8(&folder.path("mask.png"), found.width, found.height, 1, &gray)?;
        folder.write_report(&found.report)?;
        folder.commit()?;
        let report = &found.report;
        let chosen = if report.automatic { "chosen by the photograph" } else { "as given" };
        let text = format!(
            "threshold {:.3} ({chosen})\nmask      {:.1} % of {} × {} pixels\n{}wrote     {}",
            report.threshold,
            100.0 * report.share,
            found.width,
            found.height,
            lines(&[], &report.warnings),
            self.out.display()
        );
        console.result(&text, report);
        Ok(())
    }
}

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

Writes mask.png (white where the sample diffracts) and report.json. The mask serves as `coverage` of a material in a scene.
A scene may also name the photograph itself: coverage = { photograph = \"flash.jpg\" }.")]
pub struct Mask {
    /// Photograph of the sample under a flash.
    photograph: PathBuf,
    /// Folder for the mask.
    #[arg(long)]
    out: PathBuf,
    /// Brightness threshold: 0 to 1 of the largest code, or an EXR value [default: the value that best separates bright
    /// and dark pixels].
    #[arg(long, value_name = "T")]
    threshold: Option<f64>,
    /// Replace existing files in the folder.
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

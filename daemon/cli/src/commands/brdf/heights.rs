//! `nacre brdf heights`.

use super::common::Surface;
use crate::commands::values::BarArgs;
use crate::console::Console;
use nacre_base::operation::lines;
use nacre_base::vacant;
use nacre_brdf::height::Quality;
use nacre_brdf::output::write_height;
use nacre_capture::Failure;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;

/// Arguments of `nacre brdf heights`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre brdf heights grating.gwy --out grating.exr
  nacre brdf heights scan.spm --channel \"Height Sensor\" --level --out scan.exr
  nacre brdf heights points.xyz --pixel-um 0.1 --range-um 0.15 --out points.exr

Writes the heights as FILE.exr (in µm, with the pixel pitch) and as FILE.png (picture).")]
pub struct Heights {
    #[command(flatten)]
    surface: Surface,
    /// Height field (EXR); a picture (PNG) is written beside it.
    #[arg(long, value_name = "FILE.exr")]
    out: PathBuf,
    #[command(flatten)]
    bar: BarArgs,
    /// Replace existing files.
    #[arg(long)]
    force: bool,
}

#[derive(Serialize)]
struct Report<'a> {
    input: PathBuf,
    quality: &'a Quality,
    files: Vec<PathBuf>,
}

impl Heights {
    /// Reads the height field and writes it as EXR.
    pub fn run(&self, console: &Console) -> Result<(), Failure> {
        let picture = self.out.with_extension("png");
        let files = vec![self.out.clone(), picture.clone()];
        vacant(&files, self.force)?;
        let (field, quality) = self.surface.read(65.0, console)?;
        write_height(&self.out, Some((&picture, !self.bar.no_scale_bar)), &field)?;
        let q = &quality;
        let mut text =
            format!("surface   {} × {} pixels of {} µm, {:.4} µm deep", q.width, q.height, q.pixel_um, q.range_um);
        for note in &q.notes {
            let _ = write!(text, "\nread      {note}");
        }
        let _ = write!(text, "\n{}", lines(&[], &q.warnings));
        let _ = write!(text, "wrote     {}\nwrote     {}", self.out.display(), picture.display());
        console.result(&text, &Report { input: self.surface.path().into(), quality: q, files });
        Ok(())
    }
}

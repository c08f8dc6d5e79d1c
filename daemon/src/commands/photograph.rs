//! `nacre sim photograph`.

use crate::Failure;
use crate::commands::toml_file;
use crate::console::Console;
use clap::Subcommand;
use nacre_processing::image::OutputFolder;
use nacre_processing::progress::Progress;
use nacre_sim::photographs::FlashPhotograph;
use std::path::PathBuf;

const REMEDY: &str = "correct it; `nacre sim photograph flash --help` shows one";

/// What is photographed.
#[derive(Subcommand)]
pub enum Photograph {
    /// A homogeneous surface under a flash behind a narrow-band filter, in several exposures.
    Flash(Flash),
}

/// Arguments of `nacre sim photograph flash`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre sim photograph flash --out photo                    an LCD from 1 m at 680 nm
  nacre sim photograph flash --scene cd.toml --out photo
  nacre reconstruct hdr photo --out hdr

with cd.toml, in which everything can be left out:
  wavelength_nm = 680
  band_nm = 10
  pixel_um = 1000
  camera_mm = 1000
  flash_mm = 1000
  surface = { grating = { profile = \"rectangular\", period_um = 1.6, depth_um = 0.12, angle_deg = 0 } }

Surfaces are lattice, grating (sinusoid, blazed, rectangular) and paper. Writes the exposures with
their frames.json, truth.exr (radiance without noise) and scene.json (all that was assumed).")]
pub struct Flash {
    /// Description of the scene (TOML); its defaults are used without it.
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Folder for the photographs.
    #[arg(long)]
    out: PathBuf,
    /// Replace files that are already in the folder.
    #[arg(long)]
    force: bool,
}

/// Renders and writes.
pub fn run(command: &Photograph, console: &Console) -> Result<(), Failure> {
    let Photograph::Flash(args) = command;
    let scene = args.scene.as_deref().map_or_else(|| Ok(FlashPhotograph::default()), |path| toml_file(path, REMEDY))?;
    scene.check()?;
    let folder = OutputFolder::begin(&args.out, args.force)?;
    console.stage("rendering", 1);
    scene.write(&folder)?;
    console.check()?;
    folder.commit()?;
    let text = format!(
        "{} exposures of {} × {} pixels at {} nm\nwrote     {}",
        scene.exposures.len(),
        scene.width,
        scene.height,
        scene.wavelength_nm,
        args.out.display()
    );
    console.result(&text, &scene);
    Ok(())
}

//! `nacre map`.

mod compare;
mod mask;

use crate::commands::derived::Whole;
use crate::console::Console;
use clap::{Subcommand, ValueEnum};
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_image::OutputFolder;
use nacre_maps::{About, Edits, Encoding, Maps, export, import};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// What to do with maps of orientation and period.
#[derive(Subcommand)]
pub enum MapCommand {
    /// Edit them: rotation, copies, other sizes, periods that follow orientations.
    Edit(Whole<Edits>),
    /// Write them as 16-bit PNGs with a short description.
    Export(Export),
    /// Read such a folder back.
    Import(Import),
    /// Lay maps of one sample by several methods over each other, and say how they agree.
    Compare(compare::Compare),
    /// Which part of a sample diffracts: what a photograph under a flash shows bright.
    Mask(mask::Mask),
}

/// Arguments of `nacre map export`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre map export result --out pack
  nacre map export result --encoding linear --out pack

exact writes two PNGs per channel, the upper and the lower half of each value's bits, and loses nothing. linear writes one, rounded to
65535 steps. maps.json says which files there are and how to read them.")]
pub struct Export {
    /// Folder with orientation.exr, period.exr or both, or one of the files.
    input: PathBuf,
    /// Folder for the PNGs.
    #[arg(long)]
    out: PathBuf,
    /// How values become samples.
    #[arg(long, default_value = "exact")]
    encoding: EncodingName,
    /// Replace files that are already in the folder.
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum EncodingName {
    Exact,
    Linear,
}

/// Arguments of `nacre map import`.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  nacre map import pack --out maps")]
pub struct Import {
    /// Folder with a maps.json.
    input: PathBuf,
    /// Folder for the maps.
    #[arg(long)]
    out: PathBuf,
    /// Replace files that are already in the folder.
    #[arg(long)]
    force: bool,
}

/// Runs it.
pub fn run(command: &MapCommand, console: &Console) -> Result<(), Failure> {
    match command {
        MapCommand::Edit(args) => args.run(console),
        MapCommand::Export(args) => args.run(console),
        MapCommand::Import(args) => args.run(console),
        MapCommand::Compare(args) => args.run(console),
        MapCommand::Mask(args) => args.run(console),
    }
}

fn finish(console: &Console, out: &Path, maps: &Maps, report: &impl Serialize) {
    let names: Vec<&str> = maps.maps.keys().map(|k| k.name()).collect();
    let text = format!(
        "maps      {} of {} × {} pixels\nwrote     {}",
        names.join(" and "),
        maps.width,
        maps.height,
        out.display()
    );
    console.result(&text, report);
}

impl Export {
    fn run(&self, console: &Console) -> Result<(), Failure> {
        let maps = Maps::read(&self.input)?;
        let encoding = match self.encoding {
            EncodingName::Exact => Encoding::Exact,
            EncodingName::Linear => Encoding::Linear,
        };
        let folder = OutputFolder::begin(&self.out, self.force)?;
        export(&maps, encoding, &folder)?;
        console.check()?;
        folder.commit()?;
        finish(console, &self.out, &maps, &About::of(&maps));
        Ok(())
    }
}

impl Import {
    fn run(&self, console: &Console) -> Result<(), Failure> {
        let maps = import(&self.input)?;
        let folder = OutputFolder::begin(&self.out, self.force)?;
        maps.write(&folder)?;
        console.check()?;
        folder.commit()?;
        finish(console, &self.out, &maps, &About::of(&maps));
        Ok(())
    }
}

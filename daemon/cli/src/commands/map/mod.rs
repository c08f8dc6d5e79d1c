//! `nacre map`.

mod compare;
mod mask;

use crate::commands::derived::Whole;
use crate::console::Console;
use clap::{Subcommand, ValueEnum};
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_image::OutputFolder;
use nacre_maps::{About, Encoding, Maps, Options, export, import};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Commands on maps of orientation and period.
#[derive(Subcommand)]
pub enum MapCommand {
    /// Edit maps: rotate, tile, resize, or derive periods from orientations.
    Edit(Whole<Options>),
    /// Export maps as 16-bit PNGs with a JSON description.
    Export(Export),
    /// Import an exported folder.
    Import(Import),
    /// Compare maps of one sample from several methods, after registration.
    Compare(compare::Compare),
    /// Segment the diffracting part of a sample from a photograph under a flash.
    Mask(mask::Mask),
}

/// Arguments of `nacre map export`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre map export result --out pack
  nacre map export result --encoding linear --out pack

exact is lossless: two PNGs per channel hold the upper and the lower half of each value's bits. linear writes one PNG per
channel, rounded to 65535 steps. maps.json lists the files and their encoding.")]
pub struct Export {
    /// Folder with orientation.exr, period.exr or both, or a single map.
    input: PathBuf,
    /// Folder for the PNGs.
    #[arg(long)]
    out: PathBuf,
    /// Encoding of values as 16-bit samples.
    #[arg(long, default_value = "exact")]
    encoding: EncodingName,
    /// Replace existing files in the folder.
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
    /// Replace existing files in the folder.
    #[arg(long)]
    force: bool,
}

/// Runs the selected command.
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

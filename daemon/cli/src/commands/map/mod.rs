//! `nacre map`.

mod compare;
mod mask;

use crate::commands::values::{PictureArgs, numbers};
use crate::commands::{Estimating, carry_out};
use crate::console::Console;
use clap::{Subcommand, ValueEnum};
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_image::OutputFolder;
use nacre_maps::{About, Curve, Edits, Encoding, Layout, Maps, export, import};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// What to do with maps of orientation and period.
#[derive(Subcommand)]
pub enum MapCommand {
    /// Change them: periods that follow orientations, scale, turn, tile, other sizes.
    Edit(Box<Edit>),
    /// Write them as 16-bit PNGs with a short description.
    Export(Export),
    /// Read such a folder back.
    Import(Import),
    /// Lay maps of one sample by several methods over each other, and say how they agree.
    Compare(compare::Compare),
    /// Which part of a sample diffracts: what a photograph under a flash shows bright.
    Mask(mask::Mask),
}

/// Arguments of `nacre map edit`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre map edit result --period quadratic=0.8,1.6 --out blend
  nacre map edit result --period sine-squared=0.8,1.6 --out waves
  nacre map edit result --rotate 30 --tile 4,3 --layout mirror --out wrap
  nacre map edit result --scale 1.05 --offset-um -0.02 --clamp 0.7,2 --out corrected

Edits are done in the order of the options below. Writes orientation.exr, period.exr (those that there are), before-after.png and
report.json.")]
pub struct Edit {
    /// Folder with orientation.exr, period.exr or both, or one of the files.
    input: PathBuf,
    /// Folder for the new maps.
    #[arg(long)]
    out: PathBuf,
    /// Turn image and orientations together, anticlockwise; multiples of 90 are exact.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    rotate: Option<f64>,
    /// So many times as many pixels along each side.
    #[arg(long, value_name = "FACTOR", allow_negative_numbers = true)]
    resample: Option<f64>,
    /// Copies along a row and a column.
    #[arg(long, value_name = "NX,NY", value_parser = sides)]
    tile: Option<[usize; 2]>,
    /// Width and height in pixels: cropped, or filled with more copies.
    #[arg(long, value_name = "W,H", value_parser = sides)]
    size: Option<[usize; 2]>,
    /// How copies lie: repeat, mirror or brick.
    #[arg(long, default_value = "repeat", value_name = "repeat|mirror|brick")]
    layout: Layout,
    /// Turn orientations alone, anticlockwise.
    #[arg(long, value_name = "DEG", allow_negative_numbers = true)]
    orientation_offset: Option<f64>,
    /// Periods that follow orientations, from the first at 0° to the second at 180°, in µm; or a CSV of orientation_deg,period_um.
    #[arg(long, value_name = "quadratic=MIN,MAX|sine-squared=MIN,MAX|FILE.csv")]
    period: Option<String>,
    /// Factor of periods.
    #[arg(long, value_name = "F", allow_negative_numbers = true)]
    scale: Option<f64>,
    /// Added to periods.
    #[arg(long, value_name = "UM", allow_negative_numbers = true)]
    offset_um: Option<f64>,
    /// Least and most period in µm.
    #[arg(long, value_name = "MIN,MAX", value_parser = |t: &str| numbers::<f64, 2>(t, "the least and the most: 0.7,2"), allow_hyphen_values = true)]
    clamp: Option<[f64; 2]>,
    #[command(flatten)]
    pictures: PictureArgs,
    /// Replace files that are already in the folder.
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    estimating: Estimating,
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

fn sides(text: &str) -> Result<[usize; 2], String> {
    numbers(text, "two whole numbers: 4,3")
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

impl Edit {
    fn run(&self, console: &Console) -> Result<(), Failure> {
        let edits = Edits {
            rotate_deg: self.rotate,
            resample: self.resample,
            tile: self.tile,
            size: self.size,
            layout: self.layout,
            orientation_offset_deg: self.orientation_offset,
            period: self.period.as_deref().map(Curve::of).transpose()?,
            scale: self.scale,
            offset_um: self.offset_um,
            clamp_um: self.clamp,
            palette: self.pictures.palette,
            no_scale_bar: self.pictures.bar.no_scale_bar,
        };
        carry_out(&edits, &self.input, &self.out, self.force, console)
    }
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

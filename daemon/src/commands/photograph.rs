//! `nacre sim photograph`.

use crate::Failure;
use crate::commands::toml_file;
use crate::console::Console;
use clap::Subcommand;
use nacre_processing::Error;
use nacre_processing::image::OutputFolder;
use nacre_processing::progress::Progress;
use nacre_sim::photographs::{BokehPhotograph, FlashPhotograph, FoilPhotograph, TilesPhotograph};
use serde::de::DeserializeOwned;
use std::path::PathBuf;

/// What is photographed.
#[derive(Subcommand)]
pub enum Photograph {
    /// A homogeneous surface under a flash behind a narrow-band filter, in several exposures.
    Flash(Flash),
    /// An out-of-focus highlight on a grating, in which dark is deep.
    Bokeh(Bokeh),
    /// Foil of random dots under a flash, in several exposures, with its geometry.json.
    Foil(Foil),
    /// A sheet of repeated tiles under a flash at several places, in narrow-band light.
    Tiles(Tiles),
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
    #[command(flatten)]
    common: Common,
}

/// Arguments of `nacre sim photograph bokeh`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre sim photograph bokeh --out photo                    blazed lines 40 µm apart, 16 pixels
  nacre sim photograph bokeh --scene lines.toml --out photo
  nacre reconstruct bokeh photo/photograph.png --psf-sigma 2 --pixel-um 2.5 --out result

with lines.toml, in which everything can be left out:
  profile = \"rectangular\"
  duty = 0.4
  period_um = 30
  angle_deg = 20
  highlight_px = 140
  blur_px = 2.5
  full_scale_e = 5000

Profiles are sinusoid, blazed and rectangular. Writes photograph.png (16 bits, linear), truth.exr (Y and
height without blur and noise) and scene.json (all that was assumed).")]
pub struct Bokeh {
    #[command(flatten)]
    common: Common,
}

/// Arguments of `nacre sim photograph foil`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre sim photograph foil --out photo                     a spiral
  nacre reconstruct foil photo --geometry photo/geometry.json --depth-um 0.08 --out result

with a scene in TOML, in which everything can be left out:
  pattern = { spiral = [1.0, 1.45] }      or { circle = 1.2 }: periods in µm
  spread_um = 0.06
  depth_um = 0.08

Writes the exposures with their frames.json, geometry.json, truth.exr (radiance without noise) and scene.json.")]
pub struct Foil {
    #[command(flatten)]
    common: Common,
}

/// Arguments of `nacre sim photograph tiles`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre sim photograph tiles --out photos                    10 × 8 tiles of polygons, 600 lines per mm, five lights
  nacre sim photograph tiles --scene sheet.toml --out photos
  nacre reconstruct flash photos --tiles 10x8 --size-mm 297x210 --out maps

with sheet.toml, in which everything can be left out:
  tiles = [10, 8]
  tile_mm = [29.7, 26.25]
  misaligned_px = 3
  wavelength_nm = 560
  lights_mm = [[0, 0, 200], [20, -10, 200]]
  light_sigma_mm = 6
  camera_mm = [0, 0, 500]
  [pattern]
  polygons = 24
  directions = 8
  periods = { mixed = [1.4, 1.66] }       # or { uniform = 1.66 }, { graded = [1.4, 1.8] }

Writes the photographs with their frames.json, one by room light, geometry.json, truth.exr (one tile) and
scene.json (all that was assumed).")]
pub struct Tiles {
    #[command(flatten)]
    common: Common,
}

/// What all photographs take.
#[derive(clap::Args)]
struct Common {
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

impl Common {
    /// The scene, as it was described.
    fn scene<T: DeserializeOwned + Default>(&self, kind: &str) -> Result<T, Error> {
        let remedy = format!("correct it; `nacre sim photograph {kind} --help` shows one");
        self.scene.as_deref().map_or_else(|| Ok(T::default()), |path| toml_file(path, &remedy))
    }

    /// Lets the photographs be written.
    fn write(&self, console: &Console, write: &dyn Fn(&OutputFolder) -> Result<(), Error>) -> Result<(), Failure> {
        let folder = OutputFolder::begin(&self.out, self.force)?;
        console.stage("rendering", 1);
        write(&folder)?;
        console.check()?;
        Ok(folder.commit()?)
    }
}

/// Renders and writes.
pub fn run(command: &Photograph, console: &Console) -> Result<(), Failure> {
    match command {
        Photograph::Flash(args) => flash(&args.common, console),
        Photograph::Bokeh(args) => bokeh(&args.common, console),
        Photograph::Foil(args) => foil(&args.common, console),
        Photograph::Tiles(args) => tiles(&args.common, console),
    }
}

fn flash(args: &Common, console: &Console) -> Result<(), Failure> {
    let scene: FlashPhotograph = args.scene("flash")?;
    scene.check()?;
    args.write(console, &|folder| scene.write(folder))?;
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

fn bokeh(args: &Common, console: &Console) -> Result<(), Failure> {
    let scene: BokehPhotograph = args.scene("bokeh")?;
    scene.check()?;
    args.write(console, &|folder| scene.write(folder))?;
    let text = format!(
        "{} × {} pixels, lines {:.2} pixels apart\nwrote     {}",
        scene.width,
        scene.height,
        scene.period_um / scene.pixel_um,
        args.out.display()
    );
    console.result(&text, &scene);
    Ok(())
}

fn foil(args: &Common, console: &Console) -> Result<(), Failure> {
    let scene: FoilPhotograph = args.scene("foil")?;
    scene.check()?;
    args.write(console, &|folder| scene.write(folder))?;
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

fn tiles(args: &Common, console: &Console) -> Result<(), Failure> {
    let scene: TilesPhotograph = args.scene("tiles")?;
    scene.check()?;
    args.write(console, &|folder| scene.write(folder))?;
    let [width, height] = scene.sheet_mm();
    let text = format!(
        "{} lights, {} × {} pixels at {} nm, {} × {} tiles on {width} × {height} mm\nwrote     {}",
        scene.lights_mm.len(),
        scene.width,
        scene.height,
        scene.wavelength_nm,
        scene.tiles[0],
        scene.tiles[1],
        args.out.display()
    );
    console.result(&text, &scene);
    Ok(())
}

//! `nacre sim photograph`.

use crate::commands::toml_file;
use crate::console::Console;
use clap::Subcommand;
use nacre_base::Error;
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_image::OutputFolder;
use nacre_sim::photographs::{BokehPhotograph, FlashPhotograph, FoilPhotograph, TilesPhotograph};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::PathBuf;

/// Kinds of simulated photographs.
#[derive(Subcommand)]
pub enum Photograph {
    /// Photograph a homogeneous surface under a flash with a narrow-band filter, in several exposures.
    Flash(Flash),
    /// Photograph an out-of-focus highlight on a grating; dark is deep.
    Bokeh(Bokeh),
    /// Photograph a random-dot foil under a flash in several exposures; writes a geometry.json.
    Foil(Foil),
    /// Photograph a sheet of repeated tiles under a flash at several positions, in narrow-band light.
    Tiles(Tiles),
}

/// Arguments of `nacre sim photograph flash`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre sim photograph flash --out photo                    an LCD from 1 m at 680 nm
  nacre sim photograph flash --scene cd.toml --out photo
  nacre reconstruct hdr photo --out hdr

with cd.toml, where every key is optional:
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

with lines.toml, where every key is optional:
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

with a scene in TOML, where every key is optional:
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

with sheet.toml, where every key is optional:
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

/// Arguments of all photographs.
#[derive(clap::Args)]
struct Common {
    /// Description of the scene (TOML; default: built-in values).
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Folder for the photographs.
    #[arg(long)]
    out: PathBuf,
    /// Replace existing files in the folder.
    #[arg(long)]
    force: bool,
}

/// Functions common to all scenes.
struct Scene<S> {
    kind: &'static str,
    check: fn(&S) -> Result<(), Error>,
    write: fn(&S, &OutputFolder) -> Result<(), Error>,
    /// One-line summary of the photographed scene.
    said: fn(&S) -> String,
}

/// Renders and writes the photographs.
pub fn run(command: &Photograph, console: &Console) -> Result<(), Failure> {
    match command {
        Photograph::Flash(args) => {
            let said = |s: &FlashPhotograph| exposures(s.exposures.len(), [s.width, s.height], s.wavelength_nm);
            let scene = Scene { kind: "flash", check: FlashPhotograph::check, write: FlashPhotograph::write, said };
            photograph(&scene, &args.common, console)
        }
        Photograph::Bokeh(args) => {
            let said = |s: &BokehPhotograph| {
                format!("{} × {} pixels, lines {:.2} pixels apart", s.width, s.height, s.period_um / s.pixel_um)
            };
            let scene = Scene { kind: "bokeh", check: BokehPhotograph::check, write: BokehPhotograph::write, said };
            photograph(&scene, &args.common, console)
        }
        Photograph::Foil(args) => {
            let said = |s: &FoilPhotograph| exposures(s.exposures.len(), [s.width, s.height], s.wavelength_nm);
            let scene = Scene { kind: "foil", check: FoilPhotograph::check, write: FoilPhotograph::write, said };
            photograph(&scene, &args.common, console)
        }
        Photograph::Tiles(args) => {
            let said = |s: &TilesPhotograph| {
                let photographs = exposures(s.exposures.len(), [s.width, s.height], s.wavelength_nm);
                let ([right, down], [width, height]) = (s.tiles, s.sheet_mm());
                let lights = s.lights_mm.len();
                format!("{photographs} under each of {lights} lights, {right} × {down} tiles on {width} × {height} mm")
            };
            let scene = Scene { kind: "tiles", check: TilesPhotograph::check, write: TilesPhotograph::write, said };
            photograph(&scene, &args.common, console)
        }
    }
}

fn exposures(count: usize, [width, height]: [usize; 2], nm: f64) -> String {
    format!("{count} exposures of {width} × {height} pixels at {nm} nm")
}

fn photograph<S: DeserializeOwned + Serialize + Default>(
    of: &Scene<S>,
    args: &Common,
    console: &Console,
) -> Result<(), Failure> {
    let remedy = format!("correct it; `nacre sim photograph {} --help` shows one", of.kind);
    let scene: S = args.scene.as_deref().map_or_else(|| Ok(S::default()), |path| toml_file(path, &remedy))?;
    (of.check)(&scene)?;
    let folder = OutputFolder::begin(&args.out, args.force)?;
    console.stage("rendering", 1);
    (of.write)(&scene, &folder)?;
    console.check()?;
    folder.commit()?;
    console.result(&format!("{}\nwrote     {}", (of.said)(&scene), args.out.display()), &scene);
    Ok(())
}

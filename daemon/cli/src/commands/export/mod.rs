//! `nacre export`.

mod bag;
mod bluesky;
mod gltf;
mod maps;
mod materialx;
mod surface;
mod usd;
mod zarr;

use crate::console::Console;
use clap::ValueEnum;
use nacre_base::Error;
use nacre_base::progress::Progress;
use nacre_brdf::Reflectance;
use nacre_capture::Failure;
use nacre_image::OutputFolder;
use serde::Serialize;
use std::path::{Path, PathBuf};
use surface::Surface;

/// Arguments of `nacre export`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre export result --out tiff                       float TIFFs with pixel pitch, for Fiji
  nacre export result --format csv --channel orientation --channel sigma --out tables
  nacre export result/orientation.exr --format npy --out arrays
  nacre export session --out bag                       BagIt folder with checksums, for archives
  nacre export session --format bluesky --out run      documents for Bluesky, Tiled and databroker
  nacre export session --format zarr --out data.zarr   maps and frames for xarray
  nacre export result --format gltf --material gold --out model

tiff, npy and csv write one file per channel, NAME.CHANNEL.tif for NAME.exr; masked pixels are
NaN, or empty in CSV. exr writes the same maps with ZIP compression, about a fifth smaller and
slower to read. bag copies a folder into data/ with SHA-256 checksums of all files (BagIt, RFC
8493). bluesky writes documents.jsonl, and the frames as TIFF, which the documents name by absolute
paths. zarr writes a group per map, and one for the frames of a session.

gltf, materialx and usd have no diffraction. They hold a metal whose highlight is stretched across
the grooves. lost.txt states all losses and assumptions.")]
pub struct Args {
    /// Folder with maps, a single map (EXR), or a session.
    input: PathBuf,
    /// New folder for the files.
    #[arg(long)]
    out: PathBuf,
    /// Format (default: bag for sessions, tiff for maps).
    #[arg(long)]
    format: Option<Format>,
    /// Metal of gltf, materialx and usd (default: aluminium).
    #[arg(long, value_name = "perfect|schlick=R0|aluminium|silver|gold|copper|nickel|chromium|silicon")]
    material: Option<Reflectance>,
    /// Only channels of this name, such as orientation; may be repeated.
    #[arg(long)]
    channel: Vec<String>,
    /// Replace existing files in the folder.
    #[arg(long)]
    force: bool,
}

/// Formats of exported files.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// 32-bit float TIFF.
    Tiff,
    /// NumPy array.
    Npy,
    /// Lines x,y,value.
    Csv,
    /// OpenEXR with ZIP compression.
    Exr,
    /// BagIt folder.
    Bag,
    /// Bluesky documents (event-model).
    Bluesky,
    /// Zarr group, version 3.
    Zarr,
    /// MaterialX document (OpenPBR surface).
    Materialx,
    /// Binary glTF file.
    Gltf,
    /// USD stage (text).
    Usd,
}

impl Format {
    /// True for materials, which hold an approximation.
    fn is_material(self) -> bool {
        matches!(self, Self::Materialx | Self::Gltf | Self::Usd)
    }
}

/// Exported files.
#[derive(Default, Serialize)]
struct Exported {
    /// Paths in the output folder.
    files: Vec<String>,
    /// Size of all files in bytes.
    bytes: u64,
    /// Problems of the input that do not prevent the export.
    warnings: Vec<String>,
    /// Losses and assumptions of the format.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    lost: Vec<String>,
}

/// Exports maps or a folder.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let is_session = args.input.join("session.json").exists();
    let format = args.format.unwrap_or(if is_session { Format::Bag } else { Format::Tiff });
    let no_channels = format == Format::Bag || format == Format::Bluesky || format.is_material();
    if no_channels && !args.channel.is_empty() {
        let problem = "applies only to tiff, npy, csv, exr and zarr";
        return Err(Error::input("--channel", problem, "leave it out, or choose another --format").into());
    }
    if args.material.is_some() && !format.is_material() {
        let problem = "applies only to gltf, materialx and usd";
        return Err(Error::input("--material", problem, "leave it out, or choose another --format").into());
    }
    let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    if absolute(&args.out).starts_with(absolute(&args.input)) {
        return Err(Error::file(&args.out, "is inside the input", "choose an --out elsewhere").into());
    }
    let folder = OutputFolder::begin(&args.out, args.force)?;
    let exported = match format {
        Format::Bag => bag::write(&args.input, is_session, &folder, console)?,
        Format::Bluesky => bluesky::write(&args.input, &args.out, &folder, console)?,
        Format::Zarr => zarr::write(&args.input, &args.channel, &folder, console)?,
        _ if format.is_material() => write_material(args, format, &folder)?,
        _ => maps::write(&args.input, format, &args.channel, &folder, console)?,
    };
    console.check()?;
    folder.commit()?;
    let mut text = format!(
        "wrote     {}: {} files, {:.1} MB",
        args.out.display(),
        exported.files.len(),
        exported.bytes as f64 / 1e6
    );
    for warning in &exported.warnings {
        text += &format!("\nwarning   {warning}");
    }
    for line in &exported.lost {
        text += &format!("\nlost      {line}");
    }
    console.result(&text, &exported);
    Ok(())
}

/// Writes a material, its texture and the statement of losses.
fn write_material(args: &Args, format: Format, folder: &OutputFolder) -> Result<Exported, Error> {
    let surface = Surface::read(&args.input, args.material.as_ref())?;
    let mut files = match format {
        Format::Gltf => vec![("surface.glb", gltf::bytes(&surface))],
        Format::Usd => vec![("surface.usda", usd::text(&surface).into_bytes())],
        _ => vec![("surface.mtlx", materialx::text(&surface).into_bytes())],
    };
    let lost = surface.lost.iter().map(|line| format!("{line}\n")).collect::<String>();
    files.push(("lost.txt", lost.into_bytes()));
    if format != Format::Gltf {
        files.push((surface::TEXTURE, surface.texture));
    }
    let mut exported = Exported { warnings: surface.warnings, lost: surface.lost, ..Exported::default() };
    for (name, bytes) in files {
        folder.write(name, &bytes)?;
        written(&mut exported, folder, name.into())?;
    }
    Ok(exported)
}

/// Adds a written file to the list.
fn written(exported: &mut Exported, folder: &OutputFolder, name: String) -> Result<(), Error> {
    let path = folder.path(&name);
    exported.bytes += path.metadata().map_err(|e| Error::output(Path::new(&name), e))?.len();
    exported.files.push(name);
    Ok(())
}

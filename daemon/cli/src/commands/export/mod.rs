//! `nacre export`.

mod bag;
mod maps;

use crate::console::Console;
use clap::ValueEnum;
use nacre_base::Error;
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_image::OutputFolder;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Arguments of `nacre export`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre export result --out tiff                       float TIFFs with pixel pitch, for Fiji and MATLAB
  nacre export result --format csv --channel orientation --channel sigma --out tables
  nacre export result/orientation.exr --format npy --out arrays
  nacre export session --out bag                       BagIt folder with checksums, for archives

tiff, npy and csv write one file per channel, NAME.CHANNEL.tif for NAME.exr; masked pixels are NaN, or empty in CSV.
exr writes the same maps with ZIP compression, about half as large and slower to read. bag copies a folder into data/
with SHA-256 checksums of all files (BagIt, RFC 8493).")]
pub struct Args {
    /// Folder with maps, a single map (EXR), or a session.
    input: PathBuf,
    /// New folder for the files.
    #[arg(long)]
    out: PathBuf,
    /// Format (default: bag for sessions, tiff for maps).
    #[arg(long)]
    format: Option<Format>,
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
}

/// Exported files.
#[derive(Serialize)]
struct Exported {
    /// Paths in the output folder.
    files: Vec<String>,
    /// Size of all files in bytes.
    bytes: u64,
    /// Problems of the input that do not prevent the export.
    warnings: Vec<String>,
}

/// Exports maps or a folder.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let is_session = args.input.join("session.json").exists();
    let format = args.format.unwrap_or(if is_session { Format::Bag } else { Format::Tiff });
    if format == Format::Bag && !args.channel.is_empty() {
        return Err(Error::input(
            "--channel",
            "a bag contains the whole folder",
            "leave it out, or choose another --format",
        )
        .into());
    }
    let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    if absolute(&args.out).starts_with(absolute(&args.input)) {
        return Err(Error::file(&args.out, "is inside the input", "choose an --out elsewhere").into());
    }
    let folder = OutputFolder::begin(&args.out, args.force)?;
    let exported = match format {
        Format::Bag => bag::write(&args.input, is_session, &folder, console)?,
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
    console.result(&text, &exported);
    Ok(())
}

/// Adds a written file to the list.
fn written(exported: &mut Exported, folder: &OutputFolder, name: String) -> Result<(), Error> {
    let path = folder.path(&name);
    exported.bytes += path.metadata().map_err(|e| Error::output(Path::new(&name), e))?.len();
    exported.files.push(name);
    Ok(())
}

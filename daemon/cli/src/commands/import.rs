//! `nacre import`: describes photographs from elsewhere in a `frames.json`.

use crate::commands::values::{BayerName, ChannelName, transfer};
use crate::console::Console;
use clap::ValueEnum;
use nacre_base::{Error, vacant};
use nacre_capture::Failure;
use nacre_capture::import::{Described, Options, angles_in_names, check_number, decode_all, describe, named_angles};
use nacre_frames::{Bayer, Channel, FILE_NAME, Frame, FrameSet, Illumination, Kind, Layout, Transfer, save};
use nacre_image::{OutputFolder, list, write_whole};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Maximum number of file names in a message.
const SHOWN: usize = 8;

/// Tolerance for angles in file names, which may be rounded or truncated to whole degrees.
const ROUNDED_DEG: f64 = 1.0;

/// Arguments of `nacre import`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre import photos/                       read angles from names: 045.png, psi_22.5deg.tif, I_-45.png, m22p5.png
  nacre import photos/ --out series          copy the photographs into series/, with frames.json
  nacre import photos/ --angles-deg 0,45,90,135 --channel g
  nacre import raw/ --kind division-of-focal-plane --layout sony
  nacre import raw/ --kind division-of-focal-plane --layout lucid-colour --channel r
  nacre import raw/ --kind division-of-focal-plane --layout 0,45,135,90 --colour rggb
  nacre import bracket/ --kind exposures --channel g

Reads exposure times and ISO from EXIF data, if present.")]
pub struct Args {
    /// Folder of photographs (PNG, TIFF, JPEG, EXR).
    folder: PathBuf,
    /// Quantity varied between the photographs.
    #[arg(long, value_enum, default_value_t = KindName::Polarization)]
    kind: KindName,
    /// Analyser angles in degrees, in order of the sorted file names (default: read from the names).
    #[arg(long, value_delimiter = ',', allow_negative_numbers = true)]
    angles_deg: Option<Vec<f64>>,
    /// Accept --angles-deg even if the file names state other angles.
    #[arg(long, requires = "angles_deg")]
    ignore_names: bool,
    /// Polarization sensor by name, or the four angles of its 2×2 pixel block: top left, top right, bottom left, bottom
    /// right.
    ///
    /// Names: sony, lucid, flir (90,45,135,0); 4d-v1 (45,90,0,135), 4d-v2 (90,135,45,0), 4d-u4 (90,45,135,0). The names
    /// sony-colour, lucid-colour and flir-colour mean 90,45,135,0 below rggb colour filters. Crops that begin at odd
    /// pixels and mirrored frames have another order.
    #[arg(long, default_value = "90,45,135,0", allow_hyphen_values = true, value_name = "NAME|A,B,C,D")]
    layout: Layout,
    /// Colour filters of a polarization sensor whose --layout is given in degrees; each filter covers 2×2 polarizers.
    #[arg(long, value_enum)]
    colour: Option<BayerName>,
    /// Illumination of the sample: circular_panel (display behind a quarter-wave retarder), linear_panel, other or
    /// unknown. With circular_panel, reconstruction yields grating orientations by default, otherwise plain
    /// polarimetry.
    #[arg(long, default_value = "unknown", value_name = "LIGHT")]
    illumination: Illumination,
    /// Transfer function of the files: linear, srgb, gamma=2.2, polynomial=A,B,C (a calibrated camera), or recover
    /// (exposures). Default: as stated in the file
    /// (gAMA, sRGB, ICC profile), else srgb for JPEG and linear for other formats.
    #[arg(long, value_parser = transfer)]
    transfer: Option<Transfer>,
    /// Channel of colour files and colour polarization sensors (default: g). luminance, for colour polarization sensors
    /// only, is the mean of the colours.
    #[arg(long, value_enum)]
    channel: Option<ChannelName>,
    /// Black level: file value without light.
    #[arg(long)]
    black: Option<f64>,
    /// File value of a saturated pixel, such as 4095 for 12-bit data in a 16-bit file.
    #[arg(long)]
    white: Option<f64>,
    /// New folder for copies of the photographs and frames.json (default: write frames.json beside the photographs).
    #[arg(long)]
    out: Option<PathBuf>,
    /// Replace an existing frames.json.
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum KindName {
    Polarization,
    DivisionOfFocalPlane,
    Exposures,
}

/// JSON output of `nacre import`.
#[derive(Serialize)]
struct Imported<'a> {
    /// Description as written.
    #[serde(flatten)]
    set: &'a FrameSet,
    /// Size and format of the photographs.
    photographs: String,
    transfer_from: String,
    /// Files of the folder in no supported photograph format.
    skipped: &'a [PathBuf],
    warnings: &'a [String],
    wrote: &'a Path,
}

/// Describes the photographs, validates the description as a reconstruction would, decodes every file, and writes the
/// frames.json.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let (files, mut skipped) = list(&args.folder)?;
    skipped.retain(|name| !name.extension().is_some_and(|e| e == "json" || e == "txt"));
    let sensor = |layout: &str| {
        format!(
            "if it is a polarization sensor's, give --kind division-of-focal-plane and its --layout: {layout} for instance, or that of the data sheet"
        )
    };
    check_number(&args.folder, &files, kind(args), sensor)?;
    let angles = angles(args, &files)?;
    let Described { mut frames, transfer_from } = describe(&args.folder, &files, angles, &options(args))?;
    frames.warnings.extend(decode_all(&frames, console)?);
    let text = save(&frames.set);
    let target = match &args.out {
        Some(out) => {
            let folder = OutputFolder::begin(out, args.force)?;
            for file in &files {
                let target = folder.path(&file.to_string_lossy());
                std::fs::copy(args.folder.join(file), &target).map_err(|e| Error::output(&out.join(file), e))?;
            }
            folder.write(FILE_NAME, text.as_bytes())?;
            folder.commit()?;
            out.join(FILE_NAME)
        }
        None => write_beside(&args.folder, &text, args.force)?,
    };
    let mut message = format!(
        "{} photographs, {}\ntransfer  {} ({transfer_from})\n{}",
        files.len(),
        frames.info,
        frames.set.transfer.option(),
        angles_by_file(&frames.set, args.angles_deg.is_some()),
    );
    if !skipped.is_empty() {
        let names: Vec<String> = skipped.iter().take(SHOWN).map(|f| f.display().to_string()).collect();
        let more = if skipped.len() > SHOWN { ", …" } else { "" };
        message += &format!("skipped   {}{more}: no format of photographs that is read\n", names.join(", "));
    }
    frames.warnings.iter().for_each(|warning| message += &format!("warning: {warning}\n"));
    message += &format!("wrote     {}\n{text}", target.display());
    let (photographs, warnings) = (frames.info.to_string(), frames.warnings.as_slice());
    let json = Imported { set: &frames.set, photographs, transfer_from, skipped: &skipped, warnings, wrote: &target };
    console.result(&message, &json);
    Ok(())
}

/// One line per photograph: file name and analyser angle.
fn angles_by_file(set: &FrameSet, given: bool) -> String {
    let source = if given { "--angles-deg" } else { "file names" };
    let line = |f: &Frame| Some(format!("  {:>8}°  {}\n", f.analyser_deg?, f.file.display()));
    let lines: String = set.frames.iter().filter_map(line).collect();
    if lines.is_empty() { lines } else { format!("angles    from {source}:\n{lines}") }
}

/// Analyser angles, given or read from the file names; `None` for photographs without an analyser.
fn angles(args: &Args, files: &[PathBuf]) -> Result<Option<Vec<f64>>, Error> {
    let Some(given) = &args.angles_deg else {
        let of_names = || named_angles(&args.folder.to_string_lossy(), files, "give --angles-deg");
        return if args.kind == KindName::Polarization { of_names().map(Some) } else { Ok(None) };
    };
    let refused = |problem: String, remedy: &str| Err(Error::input("--angles-deg", problem, remedy));
    if args.kind != KindName::Polarization {
        return refused("belongs to --kind polarization only".into(), "leave it out, or change --kind");
    }
    if given.len() != files.len() {
        let problem = format!("{} angles for {} photographs", given.len(), files.len());
        return refused(problem, "give one per photograph, in the order of the sorted names");
    }
    let contradicted = if args.ignore_names { None } else { contradicted(files, given) };
    if let Some((file, given, named)) = contradicted {
        let problem = format!("{} is given {given}°, but its name says {named}°", file.display());
        let names: Vec<String> = files.iter().take(SHOWN).map(|f| f.display().to_string()).collect();
        let more = if files.len() > SHOWN { ", …" } else { "" };
        let remedy = format!(
            "leave --angles-deg out, give the angles in the order {}{more}, or add --ignore-names if the names are wrong",
            names.join(", ")
        );
        return refused(problem, &remedy);
    }
    Ok(Some(given.clone()))
}

/// First photograph whose name contradicts the given angle, with both angles. The comparison tolerates rounding to
/// whole degrees and is modulo 180°, the analyser's period.
fn contradicted<'a>(files: &'a [PathBuf], given: &[f64]) -> Option<(&'a Path, f64, f64)> {
    let named = angles_in_names(files).ok()?;
    let far = |a: f64, b: f64| {
        let apart = (a - b).rem_euclid(180.0);
        apart.min(180.0 - apart) >= ROUNDED_DEG
    };
    let all = files.iter().map(PathBuf::as_path).zip(given.iter().copied().zip(named));
    all.map(|(file, (given, named))| (file, given, named)).find(|(_, given, named)| far(*given, *named))
}

fn kind(args: &Args) -> Kind {
    match args.kind {
        KindName::Polarization => Kind::Polarization,
        KindName::DivisionOfFocalPlane => Kind::DivisionOfFocalPlane,
        KindName::Exposures => Kind::Exposures,
    }
}

/// Import options other than the angles.
fn options(args: &Args) -> Options {
    Options {
        kind: kind(args),
        layout: Some(args.layout).filter(|_| args.kind == KindName::DivisionOfFocalPlane),
        colour: args.colour.map(Bayer::from),
        illumination: args.illumination,
        transfer: args.transfer,
        channel: args.channel.map(Channel::from),
        black: args.black,
        white: args.white,
    }
}

/// Writes `frames.json` into the folder of the photographs.
fn write_beside(folder: &Path, text: &str, force: bool) -> Result<PathBuf, Error> {
    let target = folder.join(FILE_NAME);
    vacant(std::slice::from_ref(&target), force)?;
    write_whole(&target, text.as_bytes())?;
    Ok(target)
}

//! `nacre import`: a `frames.json` for photographs taken elsewhere.

use crate::Failure;
use crate::commands::values::{ChannelName, transfer};
use crate::console::Console;
use clap::ValueEnum;
use nacre_processing::Error;
use nacre_processing::frames::{Channel, FILE_NAME, Frame, FrameSet, Kind, Transfer, check, save};
use nacre_processing::image::{OutputFolder, exposure, photographs, write_whole};
use std::path::{Path, PathBuf};

/// Arguments of `nacre import`.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  nacre import photos/                       angles from names: 045.png, psi_30deg.tif
  nacre import photos/ --out series          copies the photographs beside the frames.json
  nacre import photos/ --angles-deg 0,45,90,135 --channel g
  nacre import raw/ --kind division-of-focal-plane --layout 90,45,135,0
  nacre import bracket/ --kind exposures --channel g

Exposure times and ISO are read from EXIF where the files have it.")]
pub struct Args {
    /// Folder with the photographs (PNG, TIFF, JPEG, EXR).
    folder: PathBuf,
    /// What was varied between the photographs.
    #[arg(long, value_enum, default_value_t = KindName::Polarization)]
    kind: KindName,
    /// Analyser angles in degrees, in the order of the file names; otherwise they are read from the names.
    #[arg(long, value_delimiter = ',', allow_negative_numbers = true)]
    angles_deg: Option<Vec<f64>>,
    /// Angles of each 2×2 block of a polarization sensor: top left, top right, bottom left, bottom right.
    #[arg(long, value_delimiter = ',', default_value = "90,45,135,0", allow_negative_numbers = true)]
    layout: Vec<f64>,
    /// How the files encode light: linear, srgb, gamma=2.2, or recover (exposures). By default srgb for JPEG, linear for the rest.
    #[arg(long, value_parser = transfer)]
    transfer: Option<Transfer>,
    /// Channel of colour files: r, g or b.
    #[arg(long, value_enum)]
    channel: Option<ChannelName>,
    /// File value of no light.
    #[arg(long)]
    black: Option<f64>,
    /// File value of a saturated pixel, 4095 for 12 bit in a 16-bit file for instance.
    #[arg(long)]
    white: Option<f64>,
    /// Copy the photographs and write frames.json into this new folder, instead of beside the photographs.
    #[arg(long)]
    out: Option<PathBuf>,
    /// Replace a frames.json that is already there.
    #[arg(long)]
    force: bool,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum KindName {
    Polarization,
    DivisionOfFocalPlane,
    Exposures,
}

/// Describes the photographs, checks the description as a reconstruction does, and writes it.
pub fn run(args: &Args, console: &Console) -> Result<(), Failure> {
    let files = photographs(&args.folder)?;
    let set = describe(args, &files)?;
    let described = check(args.folder.join(FILE_NAME), set)?;
    let text = save(&described.set);
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
    let message = format!(
        "{} photographs, {}; transfer {}{}\nwrote     {}\n{text}",
        files.len(),
        described.info,
        serde_json::to_string(&described.set.transfer).unwrap_or_default(),
        if args.transfer.is_none() { " (guessed from the file type, see --transfer)" } else { "" },
        target.display()
    );
    console.result(&message, &described.set);
    Ok(())
}

/// The `frames.json` of a folder of photographs whose names hold the analyser's angles.
///
/// # Errors
/// `Input`, naming the photograph that cannot be used.
pub fn from_names(folder: &Path, green: bool) -> Result<String, Error> {
    let args = Args {
        folder: folder.to_path_buf(),
        kind: KindName::Polarization,
        angles_deg: None,
        layout: vec![],
        transfer: None,
        channel: green.then_some(ChannelName::G),
        black: None,
        white: None,
        out: None,
        force: false,
    };
    let set = describe(&args, &photographs(folder)?)?;
    Ok(save(&check(folder.join(FILE_NAME), set)?.set))
}

fn describe(args: &Args, files: &[PathBuf]) -> Result<FrameSet, Error> {
    let angles = match (args.kind, &args.angles_deg) {
        (KindName::Polarization, Some(given)) if given.len() != files.len() => {
            let problem = format!("{} angles for {} photographs", given.len(), files.len());
            return Err(Error::input("--angles-deg", problem, "give one per photograph, in the order of the names"));
        }
        (KindName::Polarization, Some(given)) => given.iter().copied().map(Some).collect(),
        (KindName::Polarization, None) => angles_from_names(&args.folder, files)?.into_iter().map(Some).collect(),
        _ => vec![None; files.len()],
    };
    let jpeg = |f: &PathBuf| f.extension().is_some_and(|e| e.to_string_lossy().to_lowercase().starts_with("jp"));
    let frames = files.iter().zip(angles).map(|(file, analyser_deg)| {
        let exif = exposure(&args.folder.join(file));
        Frame {
            analyser_deg,
            exposure_s: exif.as_ref().and_then(|e| e.seconds),
            gain: exif.as_ref().and_then(|e| e.iso).map(|iso| iso / 100.0),
            ..Frame::new(file)
        }
    });
    let layout = match (args.kind, args.layout.as_slice()) {
        (KindName::DivisionOfFocalPlane, &[a, b, c, d]) => Some([[a, b], [c, d]]),
        (KindName::DivisionOfFocalPlane, _) => {
            return Err(Error::input(
                "--layout",
                format!("{} angles", args.layout.len()),
                "give four, 90,45,135,0 for instance",
            ));
        }
        _ => None,
    };
    let kind = match args.kind {
        KindName::Polarization => Kind::Polarization,
        KindName::DivisionOfFocalPlane => Kind::DivisionOfFocalPlane,
        KindName::Exposures => Kind::Exposures,
    };
    Ok(FrameSet {
        transfer: args.transfer.unwrap_or(if files.iter().any(jpeg) { Transfer::Srgb } else { Transfer::Linear }),
        black: args.black,
        white: args.white,
        channel: args.channel.map(Channel::from),
        layout,
        ..FrameSet::new(kind, frames.collect())
    })
}

/// Angles from file names: the number before `deg`, or else the one number that differs between the names. A plain
/// counter is refused, because it would be taken for angles and give a wrong map.
fn angles_from_names(folder: &Path, files: &[PathBuf]) -> Result<Vec<f64>, Error> {
    let bad = |problem: String| {
        Error::file(
            folder,
            problem,
            "name the photographs by their angle (045.png, psi_30deg.tif) or give --angles-deg",
        )
    };
    let numbers: Vec<Vec<(f64, bool)>> =
        files.iter().map(|f| numbers(&f.file_stem().unwrap_or_default().to_string_lossy())).collect();
    if numbers.iter().all(|n| n.iter().filter(|(_, deg)| *deg).count() == 1) {
        return Ok(numbers.iter().flatten().filter(|(_, deg)| *deg).map(|(value, _)| *value).collect());
    }
    let columns = numbers.first().map_or(0, Vec::len);
    if columns == 0 || numbers.iter().any(|n| n.len() != columns) {
        return Err(bad("the file names do not all hold an angle".into()));
    }
    let column = |c: usize| numbers.iter().map(|n| n[c].0).collect::<Vec<f64>>();
    let varying: Vec<Vec<f64>> = (0..columns).map(column).filter(|v| v.iter().any(|a| *a != v[0])).collect();
    let [angles] = varying.as_slice() else {
        return Err(bad(format!("{} numbers differ between the file names", varying.len())));
    };
    let counter = angles.len() > 2 && angles.windows(2).all(|w| w[1] - w[0] == 1.0);
    if counter || angles.iter().any(|a| *a > 360.0) {
        return Err(bad(format!(
            "the numbers in the file names ({}, {}, …) do not look like angles",
            angles[0], angles[1]
        )));
    }
    Ok(angles.clone())
}

/// Numbers in a name, each with whether `deg` or `°` follows it.
fn numbers(stem: &str) -> Vec<(f64, bool)> {
    let mut found = vec![];
    let mut rest = stem;
    while let Some(start) = rest.find(|c: char| c.is_ascii_digit()) {
        let tail = &rest[start..];
        let mut end = tail.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(tail.len());
        while tail[..end].ends_with('.') {
            end -= 1;
        }
        let after = tail[end..].trim_start_matches(['_', '-', ' ']);
        let degrees = after.to_lowercase().starts_with("deg") || after.starts_with('°');
        if let Ok(value) = tail[..end].parse() {
            found.push((value, degrees));
        }
        rest = &tail[end..];
    }
    found
}

/// Writes `frames.json` beside the photographs.
fn write_beside(folder: &Path, text: &str, force: bool) -> Result<PathBuf, Error> {
    let target = folder.join(FILE_NAME);
    if target.exists() && !force {
        return Err(Error::file(&target, "is already there", "add --force to replace it"));
    }
    write_whole(&target, text.as_bytes())?;
    Ok(target)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn angles(names: &[&str]) -> Result<Vec<f64>, Error> {
        angles_from_names(Path::new("x"), &names.iter().map(PathBuf::from).collect::<Vec<_>>())
    }

    #[test]
    fn angles_are_read_from_usual_names() {
        assert_eq!(angles(&["000.png", "045.png", "090.png"]).unwrap(), [0.0, 45.0, 90.0]);
        assert_eq!(angles(&["run2_psi_0deg.tif", "run2_psi_22.5deg.tif"]).unwrap(), [0.0, 22.5]);
        assert_eq!(angles(&["cd2_0_f8.png", "cd2_30_f8.png", "cd2_60_f8.png"]).unwrap(), [0.0, 30.0, 60.0]);
        assert_eq!(angles(&["a1_15°.png", "a2_30°.png"]).unwrap(), [15.0, 30.0]);
    }

    #[test]
    fn what_is_no_angle_is_refused() {
        for names in [
            &["IMG_0001.jpg", "IMG_0002.jpg", "IMG_0003.jpg"][..],
            &["IMG_4711.jpg", "IMG_4713.jpg"],
            &["left.png", "right.png"],
            &["1_10.png", "2_20.png"],
            &["a.png", "10.png"],
        ] {
            assert!(angles(names).is_err(), "{names:?}");
        }
    }
}

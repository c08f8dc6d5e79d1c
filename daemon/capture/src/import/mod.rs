//! Description of existing photographs by a `frames.json`, with analyser angles from file names and exposures from
//! EXIF.

mod angle_names;

pub use angle_names::angles as angles_in_names;

use nacre_base::Error;
use nacre_base::progress::Progress;
use nacre_base::text::from_json;
use nacre_frames::{
    Bayer, Channel, Clipping, FILE_NAME, Frame, FrameSet, Illumination, Kind, Layout, LoadedFrames, Mosaic, Transfer,
    check, exposures, mosaic, save,
};
use nacre_image::{details, info, photographs, read};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// Description of a frame set beyond the analyser angles.
#[derive(Clone, Debug)]
pub struct Options {
    /// Quantity varied between the photographs.
    pub kind: Kind,
    /// Analyser angles of each 2×2 block of the sensor, for `DivisionOfFocalPlane`.
    pub layout: Option<Layout>,
    /// Colour filters of the sensor, for layouts without a name.
    pub colour: Option<Bayer>,
    /// Illumination of the sample.
    pub illumination: Illumination,
    /// Transfer function of the files (default: as stated in the files, else sRGB if one is a JPEG, else linear).
    pub transfer: Option<Transfer>,
    /// Channel of colour files.
    pub channel: Option<Channel>,
    /// Black level: file value without light.
    pub black: Option<f64>,
    /// File value of a saturated pixel.
    pub white: Option<f64>,
}

/// A described set of photographs.
pub struct Described {
    /// Validated frames, with warnings.
    pub frames: LoadedFrames,
    /// Source of the transfer function: "as given", "as the files state it (gAMA 0.45455)".
    pub transfer_from: String,
}

/// Describes the photographs `files` of `folder`, with one angle in degrees for each; without `angles` there is no
/// analyser. Reads headers, but no pixels.
///
/// # Errors
/// `Input`, naming the unusable photograph or option.
pub fn describe(
    folder: &Path,
    files: &[PathBuf],
    angles: Option<Vec<f64>>,
    options: &Options,
) -> Result<Described, Error> {
    let angles = angles.map_or_else(|| vec![None; files.len()], |all| all.into_iter().map(Some).collect());
    // A camera raw file whose decoder fails, perhaps after minutes, is rejected at the first file. Otherwise, only its
    // tags would be missing.
    files.iter().try_for_each(|file| info(&folder.join(file)).map(drop))?;
    let (tags, apertures) = exposures(folder, files)?;
    let frame = |((file, analyser_deg), tags): ((&PathBuf, _), nacre_frames::Tagged)| Frame {
        analyser_deg,
        exposure_s: tags.seconds,
        gain: tags.gain,
        ..Frame::new(file)
    };
    let (transfer, transfer_from) = match options.transfer {
        Some(transfer) => (transfer, "as given".to_owned()),
        None => stated_transfer(folder, files)?,
    };
    let set = FrameSet {
        transfer,
        black: options.black,
        white: options.white,
        channel: options.channel,
        layout: options.layout,
        colour: options.colour,
        illumination: options.illumination,
        ..FrameSet::new(options.kind, files.iter().zip(angles).zip(tags).map(frame).collect())
    };
    let mut frames = check(folder.join(FILE_NAME), set)?;
    frames.warnings.extend(apertures);
    Ok(Described { frames, transfer_from })
}

/// Minimum number of analyser angles that determine polarization.
const MIN_ANGLES: usize = 3;

/// Rejects fewer than three photographs behind an analyser. If one looks like a raw frame of a polarization sensor,
/// `sensor` provides the remedy, given an example of a layout name.
///
/// # Errors
/// `Input` for fewer than three, and for an unreadable one.
pub fn check_number(
    folder: &Path,
    files: &[PathBuf],
    kind: Kind,
    sensor: impl Fn(&str) -> String,
) -> Result<(), Error> {
    let [first, ..] = files else { return Ok(()) };
    if kind != Kind::Polarization || files.len() >= MIN_ANGLES {
        return Ok(());
    }
    let path = folder.join(first);
    let looks = match mosaic(&read(&path)?) {
        Some(Mosaic::Every2) => Some(("polarizers (or colour filters) on its pixels", "sony")),
        Some(Mosaic::Every4) => Some(("colour filters over blocks of 2 × 2 pixels, as over polarizers", "sony-colour")),
        None => None,
    };
    if let Some((filters, layout)) = looks {
        return Err(Error::file(&path, format!("looks like a raw frame of a sensor with {filters}"), sensor(layout)));
    }
    let problem =
        format!("holds {} photographs; polarization needs {MIN_ANGLES} analyser angles at least", files.len());
    Err(Error::file(folder, problem, "add photographs at other angles"))
}

/// Transfer function that the files state, or that is usual for their type, and its source.
fn stated_transfer(folder: &Path, files: &[PathBuf]) -> Result<(Transfer, String), Error> {
    let mut stated: Option<(&PathBuf, Transfer, String)> = None;
    for file in files {
        let Some(encoding) = details(&folder.join(file))?.encoding else { continue };
        let Some(transfer) = Transfer::of(encoding.curve) else { continue };
        match &stated {
            None => stated = Some((file, transfer, encoding.source)),
            Some((first, wanted, source)) if *wanted != transfer => {
                let declared =
                    [(*wanted, source), (transfer, &encoding.source)].map(|(t, s)| format!("{} ({s})", t.option()));
                let problem =
                    format!("states transfer {}, but {} states {}", declared[1], first.display(), declared[0]);
                return Err(Error::file(&folder.join(file), problem, "give --transfer for all of them"));
            }
            Some(_) => {}
        }
    }
    if let Some((_, transfer, source)) = stated {
        return Ok((transfer, format!("as the files state it: {source}")));
    }
    let jpeg = |f: &PathBuf| f.extension().is_some_and(|e| e.to_string_lossy().to_lowercase().starts_with("jp"));
    Ok(if files.iter().any(jpeg) {
        (Transfer::Srgb, "usual for JPEG; --transfer gives another".into())
    } else {
        (Transfer::Linear, "assumed, as the files state none; --transfer gives another".into())
    })
}

/// Decodes photographs on all cores to reject unreadable ones early; returns a warning if they clip below white.
///
/// # Errors
/// `Input` for the first unreadable photograph; `Cancelled`.
pub fn decode_all(frames: &LoadedFrames, progress: &dyn Progress) -> Result<Option<String>, Error> {
    let set = &frames.set;
    progress.stage("decoding photographs", set.frames.len() as u64);
    let clipping = Mutex::new(Clipping::default());
    let channel = set.file_channel();
    let next = Mutex::new(set.frames.iter());
    let decode = || -> Result<(), Error> {
        loop {
            progress.check()?;
            let Some(frame) = next.lock().unwrap_or_else(PoisonError::into_inner).next() else { return Ok(()) };
            let raster = read(&frames.file(&frame.file))?;
            clipping.lock().unwrap_or_else(PoisonError::into_inner).observe(&raster, channel);
            progress.step();
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get).min(set.frames.len());
    std::thread::scope(|scope| {
        let all: Vec<_> = (0..threads).map(|_| scope.spawn(decode)).collect();
        all.into_iter().try_for_each(|thread| thread.join().unwrap_or(Err(Error::Cancelled)))
    })?;
    let white = set.white.unwrap_or_else(|| frames.info.depth.full_scale().into());
    Ok(clipping.into_inner().unwrap_or_else(PoisonError::into_inner).warning(white, "--white"))
}

/// Adds `transfer` to a `frames.json` without it, as stated in its photographs.
///
/// # Errors
/// `Input` for invalid JSON, and for unreadable files.
pub fn with_transfer(folder: &Path, text: &str) -> Result<String, Error> {
    let path = folder.join(FILE_NAME);
    let bad = |problem: String| Error::file(&path, problem, "`nacre schema frames` prints what is allowed");
    let mut value: serde_json::Value = from_json(text).map_err(bad)?;
    let Some(object) = value.as_object_mut().filter(|o| !o.contains_key("transfer")) else { return Ok(text.into()) };
    let names = object.get("frames").and_then(|f| f.as_array()).into_iter().flatten();
    let files: Vec<PathBuf> = names.filter_map(|f| Some(f.get("file")?.as_str()?.into())).collect();
    if let Some(file) = files.iter().find(|f| f.components().count() != 1) {
        return Err(bad(format!("{} is no plain file name", file.display())));
    }
    let (transfer, _) = stated_transfer(folder, &files)?;
    object.insert("transfer".into(), serde_json::to_value(transfer).unwrap_or_default());
    Ok(value.to_string())
}

/// `frames.json` of uploaded photographs with analyser angles in their names.
///
/// # Errors
/// `Input`, naming the unusable photograph.
pub fn from_names(folder: &Path) -> Result<String, Error> {
    let options = Options {
        kind: Kind::Polarization,
        layout: None,
        colour: None,
        illumination: Illumination::Unknown,
        transfer: None,
        channel: None,
        black: None,
        white: None,
    };
    let files = photographs(folder)?;
    let sensor = |layout: &str| {
        format!(
            "describe it as kind division_of_focal_plane with its layout, {layout} for instance (frames.json; on the page: Polarization by)"
        )
    };
    check_number(folder, &files, options.kind, sensor)?;
    let angles = named_angles("the upload", &files, "send a frames.json that says the angles as the part frames")?;
    Ok(save(&describe(folder, &files, Some(angles), &options)?.frames.set))
}

/// Analyser angles in degrees from file names. A message names `place` as the folder, and `otherwise` as the
/// alternative to supply the angles.
///
/// # Errors
/// `Input` if the names hold no angles, or are ambiguous.
pub fn named_angles(place: &str, files: &[PathBuf], otherwise: &str) -> Result<Vec<f64>, Error> {
    let remedy = || format!("name the photographs by their angle (045.png, psi_-22.5deg.tif), or {otherwise}");
    angles_in_names(files).map_err(|problem| Error::input(place, problem, remedy()))
}

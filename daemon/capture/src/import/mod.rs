//! Photographs taken elsewhere: their `frames.json`, with analyser angles read from file names and exposures from EXIF.

mod angle_names;

pub use angle_names::angles as angles_in_names;

use nacre_base::Error;
use nacre_frames::{Channel, FILE_NAME, Frame, FrameSet, Kind, Transfer, check, save};
use nacre_image::{exposure, photographs};
use std::path::{Path, PathBuf};

/// Description of a frame set beyond the analyser angles.
#[derive(Clone, Debug)]
pub struct Options {
    /// What varies between the photographs.
    pub kind: Kind,
    /// Analyser angles in degrees of each 2×2 block of the sensor, for `DivisionOfFocalPlane`.
    pub layout: Option<[[f64; 2]; 2]>,
    /// Transfer function of the files (default: sRGB where one is a JPEG, else linear).
    pub transfer: Option<Transfer>,
    /// Channel of colour files.
    pub channel: Option<Channel>,
    /// File value of no light.
    pub black: Option<f64>,
    /// File value of a saturated pixel.
    pub white: Option<f64>,
}

/// Describes the photographs `files` of `folder`, one angle in degrees for each; without `angles` there is no analyser.
pub fn describe(folder: &Path, files: &[PathBuf], angles: Option<Vec<f64>>, options: &Options) -> FrameSet {
    let angles = angles.map_or_else(|| vec![None; files.len()], |all| all.into_iter().map(Some).collect());
    let jpeg = |f: &PathBuf| f.extension().is_some_and(|e| e.to_string_lossy().to_lowercase().starts_with("jp"));
    let frames = files.iter().zip(angles).map(|(file, analyser_deg)| {
        let exif = exposure(&folder.join(file));
        Frame {
            analyser_deg,
            exposure_s: exif.as_ref().and_then(|e| e.seconds),
            gain: exif.as_ref().and_then(|e| e.iso).map(|iso| iso / 100.0),
            ..Frame::new(file)
        }
    });
    FrameSet {
        transfer: options.transfer.unwrap_or(if files.iter().any(jpeg) { Transfer::Srgb } else { Transfer::Linear }),
        black: options.black,
        white: options.white,
        channel: options.channel,
        layout: options.layout,
        ..FrameSet::new(options.kind, frames.collect())
    }
}

/// The `frames.json` of uploaded photographs whose names hold the analyser angles; of colour files, the green channel is used where `green`
/// says so.
///
/// # Errors
/// `Input`, naming the photograph that cannot be used.
pub fn from_names(folder: &Path, green: bool) -> Result<String, Error> {
    let options = Options {
        kind: Kind::Polarization,
        layout: None,
        transfer: None,
        channel: green.then_some(Channel::G),
        black: None,
        white: None,
    };
    let files = photographs(folder)?;
    let angles = named_angles("the upload", &files, "send a frames.json that says the angles as the part frames")?;
    Ok(save(&check(folder.join(FILE_NAME), describe(folder, &files, Some(angles), &options))?.set))
}

/// The analyser angles that file names hold, in degrees. A message names `place` as the folder and `otherwise` as another way to give the
/// angles.
///
/// # Errors
/// `Input` when the names hold no angles, or can be read in two ways.
pub fn named_angles(place: &str, files: &[PathBuf], otherwise: &str) -> Result<Vec<f64>, Error> {
    let remedy = || format!("name the photographs by their angle (045.png, psi_-22.5deg.tif), or {otherwise}");
    angles_in_names(files).map_err(|problem| Error::input(place, problem, remedy()))
}

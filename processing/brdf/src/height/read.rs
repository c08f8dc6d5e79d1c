//! Height fields from files: grey images, EXR maps, files of AFMs and profilometers, text.

use super::formats::{self, Input};
use super::{HeightField, gaps, picture, text, tiff};
use nacre_base::input::{self, Unreadable};
use nacre_base::{Error, Result};
use nacre_image::budget::Operation;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Endings of files that hold height fields.
pub const EXTENSIONS: &[&str] = &[
    "png", "tif", "tiff", "jpg", "jpeg", "exr", "bmp", "txt", "asc", "csv", "dat", "tsv", "xyz", "gwy", "ibw", "x3p",
    "spm", "sdf", "nid", "ezd", "grd", "bcrf", "bcr", "000", "001", "002", "003", "004", "005", "006", "007", "008",
    "009",
];

/// Largest text or file of an instrument that is read, in bytes.
const MAX_BYTES: u64 = 256 << 20;

/// Largest image that is read, in bytes.
const MAX_IMAGE: u64 = 4 << 30;

/// Scale that the user states. It must not contradict the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scale {
    /// Distance of two pixels in µm.
    pub pixel_um: Option<f64>,
    /// Height in µm of white above black (integer images, EXR maps of relative height), or of the highest above the lowest point (text,
    /// signed and floating-point TIFF).
    pub range_um: Option<f64>,
    /// Channel of a file with several: its name, or its number from 1 (default: the first channel of heights).
    pub channel: Option<String>,
    /// Largest share of gaps that are filled by interpolation, above 0 and at most 0.5; none are filled by default.
    pub fill_gaps: Option<f64>,
}

impl Scale {
    pub(crate) fn check(&self) -> Result<()> {
        let positive = |flag: &str, value: Option<f64>| match value {
            Some(v) if !(v > 0.0 && v <= 1e4) => {
                Err(Error::input(flag, format!("is {v}"), "give a number of µm above 0, at most 10000"))
            }
            _ => Ok(()),
        };
        positive("--pixel-um", self.pixel_um)?;
        positive("--range-um", self.range_um)?;
        match self.fill_gaps.filter(|share| !(*share > 0.0 && *share <= gaps::MOST)) {
            Some(share) => {
                let remedy = format!("give the largest share of gaps, above 0 and at most {}", gaps::MOST);
                Err(Error::input("--fill-gaps", format!("is {share}"), remedy))
            }
            None => Ok(()),
        }
    }
}

/// Reads a height field, by its content whatever its name is:
///
/// - PNG, TIFF, JPEG and BMP images (grey, bright is high);
/// - EXR maps (channel `height` or the only one, in µm, with the pitch as the attribute `pixel_um`, as `nacre reconstruct bokeh` writes
///   them);
/// - files of AFMs and profilometers: Gwyddion, Igor binary waves, X3P, Nanoscope, SDF, Nanosurf, Surfer, BCR;
/// - text: rows of heights, points x y z on a grid, or profiles x z, with or without a header that states size and units.
///
/// # Errors
/// `Input` for files that cannot be read, hold no heights, or more gaps than `scale` allows, and whose scale is unknown or contradicts `scale`.
pub fn read(path: &Path, scale: &Scale) -> Result<HeightField> {
    scale.check()?;
    let mut head = [0_u8; 4];
    let cannot = |e| unreadable(path, &Unreadable::System(e));
    let count = open(path)?.read(&mut head).map_err(cannot)?;
    let image = match &head[..count] {
        [0x76, 0x2f, 0x31, 0x01] => picture::map as fn(&Path, &Scale) -> Result<HeightField>,
        [b'I', b'I', 42 | 43, 0] | [b'M', b'M', 0, 42 | 43] => tiff::read,
        [0x89, b'P', b'N', b'G'] | [0xff, 0xd8, 0xff, _] | [b'B', b'M', ..] => picture::read,
        _ => return other(path, scale),
    };
    if scale.channel.is_some() {
        return Err(Error::file(path, "is an image, which --channel does not apply to", "leave out --channel"));
    }
    Operation::Heights.check_file(path)?;
    image(path, scale)
}

/// Opens an image, whose decoder has limits of its own.
pub(super) fn open(path: &Path) -> Result<File> {
    input::open(path, MAX_IMAGE).map_err(|error| unreadable(path, &error))
}

fn unreadable(path: &Path, error: &Unreadable) -> Error {
    let remedy = match error {
        Unreadable::System(_) => "check the path",
        Unreadable::NotAFile(_) => "give an image, a file of an AFM, or rows of heights as text",
        Unreadable::TooLarge { .. } => "crop it",
    };
    Error::file(path, error, remedy)
}

/// Files that are no images.
fn other(path: &Path, scale: &Scale) -> Result<HeightField> {
    let bytes = input::read(path, MAX_BYTES).map_err(|error| match error {
        Unreadable::TooLarge { .. } => {
            let problem = format!("is no image and larger than the {} MiB that are read", MAX_BYTES >> 20);
            Error::file(path, problem, "crop the heights")
        }
        error => unreadable(path, &error),
    })?;
    if let Some(format) = formats::recognise(&bytes) {
        let input = Input { bytes: &bytes, channel: scale.channel.as_deref() };
        let stored = (format.read)(&input).map_err(|fault| fault.of(path, format.name))?;
        return stored.field(path, scale);
    }
    if let Some(name) = formats::unread(&bytes) {
        let problem = format!("is of a format that Nacre does not read: {name}");
        return Err(Error::file(path, problem, "export the heights as Gwyddion file (.gwy), X3P or text"));
    }
    if scale.channel.is_some() {
        return Err(Error::file(path, "is text, which --channel does not apply to", "leave out --channel"));
    }
    text::read(path, &bytes, scale)?.field(path, scale)
}

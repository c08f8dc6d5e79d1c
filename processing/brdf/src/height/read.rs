//! Height fields from files: grey images, EXR maps, files of AFMs and profilometers, text.

use super::formats::{self, Input};
use super::{HeightField, gaps, picture, text, tiff};
use nacre_base::input::{self, Unreadable};
use nacre_base::{Error, Result};
use nacre_image::budget::Operation;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// File extensions of height fields.
pub const EXTENSIONS: &[&str] = &[
    "png", "tif", "tiff", "jpg", "jpeg", "exr", "bmp", "txt", "asc", "csv", "dat", "tsv", "xyz", "gwy", "ibw", "x3p",
    "spm", "sdf", "nid", "ezd", "grd", "bcrf", "bcr", "000", "001", "002", "003", "004", "005", "006", "007", "008",
    "009",
];

/// Largest text or instrument file in bytes.
const MAX_BYTES: u64 = 256 << 20;

/// Largest image file in bytes.
const MAX_IMAGE: u64 = 4 << 30;

/// Scale stated by the user. It must not contradict the file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Scale {
    /// Pixel pitch in µm.
    pub pixel_um: Option<f64>,
    /// Height in µm between black and white (integer images, EXR maps of relative height), or between the lowest and
    /// the highest point (text, signed and floating-point TIFF).
    pub range_um: Option<f64>,
    /// Channel of a file with several: its name, or its number from 1 (default: the first height channel).
    pub channel: Option<String>,
    /// Largest fraction of gaps to fill by interpolation, above 0 and at most 0.5; by default none are filled.
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

/// Reads a height field in a format recognised by its content:
///
/// - PNG, TIFF, JPEG and BMP images (grey, bright is high);
/// - EXR maps (channel `height` or the only one, in µm, with the pitch as attribute `pixel_um`), as written by
///   `nacre reconstruct bokeh`;
/// - files of AFMs and profilometers: Gwyddion, Igor binary waves, X3P, Nanoscope, SDF, Nanosurf, Surfer, BCR;
/// - text: rows of heights, points x y z on a grid, or profiles x z, with or without a header of size and units.
///
/// # Errors
/// `Input` for files that cannot be read, hold no heights, or have more gaps than `scale` allows. Also if the scale is
/// unknown or contradicts `scale`.
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

/// Opens an image, whose decoder checks its size.
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

/// Reads files other than images.
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

//! Reads photographs: PNG, JPEG, TIFF, BMP, OpenEXR and Radiance HDR, told apart by their first bytes.
//!
//! Bad input is an [`Error::Input`] in plain words, never a panic and never a half-decoded picture. Sizes are
//! checked against the header before anything is allocated for pixels.

use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use super::fault::{Decoded, Fault};
use super::raster::{Info, Raster};
use super::source::{Source, decode, open};
use super::{bmp, jpeg, openexr, png, radiance, tif};
use nacre_base::Result;

/// File name endings of the formats that [`read`] understands, in lower case.
pub const EXTENSIONS: &[&str] = &["png", "tif", "tiff", "jpg", "jpeg", "exr"];

pub(super) enum Format {
    Png,
    Jpeg,
    Tiff,
    Exr,
    Bmp,
    Radiance,
}

pub(super) fn sniff(source: &mut Source) -> Decoded<Format> {
    let mut magic = Vec::with_capacity(8);
    source.by_ref().take(8).read_to_end(&mut magic)?;
    source.seek(SeekFrom::Start(0))?;
    match magic.as_slice() {
        [0x89, b'P', b'N', b'G', ..] => Ok(Format::Png),
        [0xff, 0xd8, 0xff, ..] => Ok(Format::Jpeg),
        [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Ok(Format::Tiff),
        [0x76, 0x2f, 0x31, 0x01, ..] => Ok(Format::Exr),
        [b'B', b'M', ..] => Ok(Format::Bmp),
        [b'#', b'?', ..] => Ok(Format::Radiance),
        _ => Err(Fault::unusable(
            "is not a PNG, JPEG, TIFF, BMP, EXR or Radiance HDR image",
            "convert it to one of these",
        )),
    }
}

/// Reads only the header of an image file: no pixel is decoded and no memory taken for any.
///
/// # Errors
/// `Error::Input` when the file cannot be read, is no image of a known format, or is beyond the size limits.
pub fn info(path: &Path) -> Result<Info> {
    decode(path, || header(open(path)?))
}

fn header(mut source: Source) -> Decoded<Info> {
    match sniff(&mut source)? {
        Format::Png => png::info(source),
        Format::Jpeg => jpeg::info(source),
        Format::Tiff => tif::info(source),
        Format::Exr => openexr::info(source),
        Format::Bmp => bmp::info(source),
        Format::Radiance => radiance::info(source),
    }
}

/// Width and height of an image file, by its header alone; an OpenEXR file may have any channels.
///
/// # Errors
/// As [`info`].
pub fn size(path: &Path) -> Result<[usize; 2]> {
    decode(path, || {
        let mut source = open(path)?;
        match sniff(&mut source)? {
            Format::Exr => openexr::layer_size(source),
            _ => header(source).map(|info| [info.width, info.height]),
        }
    })
}

/// Reads an image file whole.
///
/// # Errors
/// `Error::Input` as for [`info`], and when the file is truncated, damaged or of a kind that is not read (CMYK,
/// signed or 32-bit integers, unknown EXR channels).
pub fn read(path: &Path) -> Result<Raster> {
    read_into(path, vec![])
}

/// [`read`] that uses the memory of an image of the same size and depth again, where the format can.
pub fn read_into(path: &Path, spare: Vec<u16>) -> Result<Raster> {
    decode(path, || {
        let mut source = open(path)?;
        match sniff(&mut source)? {
            Format::Png => png::read(source, spare),
            Format::Jpeg => jpeg::read(source),
            Format::Tiff => tif::read(source),
            Format::Exr => openexr::read(source),
            Format::Bmp => bmp::read(source),
            Format::Radiance => radiance::read(source),
        }
    })
}

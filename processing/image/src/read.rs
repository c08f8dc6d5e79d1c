//! Reads photographs: PNG, JPEG, TIFF, BMP, WebP, OpenEXR, Radiance HDR, FITS, NPY and camera raw files, distinguished
//! by their content.
//!
//! Bad input gives an [`nacre_base::Error::Input`] with a message, never a panic or a partly decoded picture. The sizes
//! in the header are checked before memory is allocated for pixels.

use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use super::fault::{Decoded, Fault};
use super::raster::{Info, Raster};
use super::source::{Source, decode, open};
use super::{bmp, fits, foreign, jpeg, npy, openexr, png, radiance, raw, tif, webp};
use nacre_base::Result;

/// File extensions of photographs in the formats of [`read`], in lower case.
#[cfg(not(feature = "raw"))]
pub const EXTENSIONS: &[&str] =
    &["png", "tif", "tiff", "jpg", "jpeg", "bmp", "exr", "hdr", "webp", "fits", "fit", "fts", "npy"];
/// File extensions of photographs in the formats of [`read`], in lower case.
#[cfg(feature = "raw")]
pub const EXTENSIONS: &[&str] = &[
    "png", "tif", "tiff", "jpg", "jpeg", "bmp", "exr", "hdr", "webp", "fits", "fit", "fts", "npy", "dng", "cr2", "cr3",
    "nef", "nrw", "arw", "raf", "orf", "rw2", "rwl", "pef", "srw", "3fr", "erf", "mef", "dcr", "kdc",
];

/// Number of bytes by which formats are distinguished: up to the mark of DICOM.
const HEAD: u64 = 132;

#[derive(Clone, Copy)]
pub(super) enum Format {
    Png,
    Jpeg,
    Tiff,
    Exr,
    Bmp,
    Radiance,
    WebP,
    Fits,
    Npy,
    Raw(raw::Kind),
}

pub(super) fn sniff(source: &mut Source) -> Decoded<Format> {
    let mut head = vec![];
    source.by_ref().take(HEAD).read_to_end(&mut head)?;
    source.seek(SeekFrom::Start(0))?;
    if let Some(kind) = raw::by_magic(&head) {
        return Ok(Format::Raw(kind));
    }
    match head.as_slice() {
        [0x89, b'P', b'N', b'G', ..] => Ok(Format::Png),
        [0xff, 0xd8, 0xff, ..] => Ok(Format::Jpeg),
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => {
            Ok(raw::by_tags(source)?.map_or(Format::Tiff, Format::Raw))
        }
        [b'I', b'I', 43, 0, ..] | [b'M', b'M', 0, 43, ..] => Ok(Format::Tiff),
        [0x76, 0x2f, 0x31, 0x01, ..] => Ok(Format::Exr),
        [b'B', b'M', ..] => Ok(Format::Bmp),
        [b'#', b'?', ..] => Ok(Format::Radiance),
        [b'R', b'I', b'F', b'F', _, _, _, _, b'W', b'E', b'B', b'P', ..] => Ok(Format::WebP),
        [0x93, b'N', b'U', b'M', b'P', b'Y', ..] => Ok(Format::Npy),
        _ if head.starts_with(b"SIMPLE  =") => Ok(Format::Fits),
        _ => Err(foreign::refusal(&head).unwrap_or_else(|| {
            Fault::unusable(
                "is not a PNG, JPEG, TIFF, BMP, WebP, EXR, Radiance HDR, FITS, NPY or camera raw image",
                "convert it to one of these",
            )
        })),
    }
}

/// Reads the header of an image file. No pixel is decoded, and no memory allocated for pixels.
///
/// # Errors
/// `Error::Input` if the file cannot be read, has no known image format, or exceeds the size limits.
pub fn info(path: &Path) -> Result<Info> {
    decode(path, || {
        let mut source = open(path)?;
        let format = sniff(&mut source)?;
        header(path, source, format)
    })
}

pub(super) fn header(path: &Path, source: Source, format: Format) -> Decoded<Info> {
    match format {
        Format::Png => png::info(source),
        Format::Jpeg => jpeg::info(source),
        Format::Tiff => tif::info(source),
        Format::Exr => openexr::info(source),
        Format::Bmp => bmp::info(source),
        Format::Radiance => radiance::info(source),
        Format::WebP => webp::info(source),
        Format::Fits => fits::info(source),
        Format::Npy => npy::info(source),
        Format::Raw(kind) => raw::info(path, source, kind),
    }
}

/// Width and height of an image file from its header; an OpenEXR file may have any channels.
///
/// # Errors
/// As [`info`].
pub fn size(path: &Path) -> Result<[usize; 2]> {
    decode(path, || {
        let mut source = open(path)?;
        match sniff(&mut source)? {
            Format::Exr => openexr::layer_size(source),
            format => header(path, source, format).map(|info| [info.width, info.height]),
        }
    })
}

/// Reads an image file.
///
/// # Errors
/// `Error::Input` as for [`info`], and if the file is truncated, damaged or of an unsupported kind (CMYK, signed or
/// 32-bit integers, unknown EXR channels).
pub fn read(path: &Path) -> Result<Raster> {
    read_into(path, vec![])
}

/// As [`read`], reusing the memory of an image of the same size and depth if the format permits.
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
            Format::WebP => webp::read(source),
            Format::Fits => fits::read(source),
            Format::Npy => npy::read(source),
            Format::Raw(kind) => raw::read(path, source, kind),
        }
    })
}

/// Exposure settings of a camera raw file; `None` for other files.
pub(super) fn taken(path: &Path) -> Option<raw::Taken> {
    let taken = decode(path, || {
        let mut source = open(path)?;
        Ok(match sniff(&mut source)? {
            Format::Raw(kind) => raw::exposure(path, source, kind),
            _ => None,
        })
    });
    taken.ok().flatten()
}

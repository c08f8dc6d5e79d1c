//! Writers for maps (OpenEXR, `f32`) and pictures (PNG).
//!
//! The EXR container is written here rather than by the `exr` crate, which keeps attributes in a hash map. Here rows
//! are written as they are computed, no plane is copied, and equal maps give equal bytes.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

use ::image::codecs::png::{CompressionType, FilterType, PngEncoder};
use ::image::{ExtendedColorType, ImageEncoder};
use half::f16;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::raster::MAX_SIDE;
use nacre_base::write_whole;
use nacre_base::{Error, Result};

/// Value of a custom attribute in an EXR header.
#[derive(Debug, Clone, PartialEq)]
pub enum Attribute {
    /// Stored as `double`.
    Number(f64),
    /// Stored as `string`, UTF-8.
    Text(String),
    /// CIE chromaticities (x, y) of red, green, blue and white, for the attribute `chromaticities`.
    Chromaticities([[f32; 2]; 4]),
}

impl Attribute {
    /// Chromaticities of linear sRGB: the primaries of Rec. 709, white D65.
    pub const SRGB: Self = Self::Chromaticities([[0.64, 0.33], [0.3, 0.6], [0.15, 0.06], [0.3127, 0.329]]);
}

/// Precision of the samples of an EXR.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    /// 16 bits: relative error 2⁻¹¹ from 6·10⁻⁵ up to the maximum of 65504; values below 6·10⁻⁸ become 0.
    Half,
    /// 32 bits.
    Float,
}

impl Precision {
    fn bytes(self) -> usize {
        if self == Self::Half { 2 } else { 4 }
    }
}

/// Approximate bytes per batch of rows, which are computed in parallel.
const BATCH_BYTES: usize = 4 << 20;
/// Longest name of a channel or attribute in bytes; names above 31 set a flag in the header.
const LONGEST_NAME: usize = 255;

/// Writes `f32` planes as an uncompressed scan-line EXR, which preserves NaN and infinities.
///
/// `fill(channel, row, values)` writes one row (`width` values) of the channel with this index in `channels`. Several
/// threads call it, for rows in any order. Channels may be given in any order.
///
/// # Errors
/// `Error::Output` if the system refuses, or for an invalid size or name (empty, duplicate, too long).
pub fn write_exr(
    path: &Path,
    width: usize,
    height: usize,
    channels: &[&str],
    attributes: &[(&str, Attribute)],
    fill: &(dyn Fn(usize, usize, &mut [f32]) + Sync),
) -> Result<()> {
    write_exr_as(path, Precision::Float, [width, height], channels, attributes, fill)
}

/// As [`write_exr`], with a choice of precision.
///
/// # Errors
/// As [`write_exr`].
pub fn write_exr_as(
    path: &Path,
    precision: Precision,
    [width, height]: [usize; 2],
    channels: &[&str],
    attributes: &[(&str, Attribute)],
    fill: &(dyn Fn(usize, usize, &mut [f32]) + Sync),
) -> Result<()> {
    let write = || {
        let (order, sorted) = in_order(channels);
        let header = exr_header(precision, Compression::None, [width, height], &sorted, attributes)?;
        let mut file = File::create(path)?;
        file.write_all(&header)?;
        let chunk = 8 + width * order.len() * precision.bytes();
        file.write_all(&offset_table(header.len(), height, chunk))?;
        let batch = (BATCH_BYTES / chunk).clamp(1, height);
        let mut bytes = vec![0_u8; batch * chunk];
        for first in (0..height).step_by(batch) {
            let rows = batch.min(height - first);
            let part = &mut bytes[..rows * chunk];
            part.par_chunks_exact_mut(chunk).enumerate().for_each_init(
                || vec![0.0; width],
                |values, (row, chunk)| fill_chunk(chunk, first + row, (&order, precision), values, fill),
            );
            file.write_all(part)?;
        }
        Ok(())
    };
    write().map_err(|error| Error::output(path, error))
}

/// Encodes one row: row number, byte count, then the channels by name.
fn fill_chunk(
    chunk: &mut [u8],
    row: usize,
    (order, precision): (&[usize], Precision),
    values: &mut [f32],
    fill: &(dyn Fn(usize, usize, &mut [f32]) + Sync),
) {
    let (head, data) = chunk.split_at_mut(8);
    head[..4].copy_from_slice(&(row as u32).to_le_bytes());
    head[4..].copy_from_slice(&(data.len() as u32).to_le_bytes());
    for (&channel, target) in order.iter().zip(data.chunks_exact_mut(values.len() * precision.bytes())) {
        fill(channel, row, values);
        if precision == Precision::Half {
            for (bytes, value) in target.as_chunks_mut::<2>().0.iter_mut().zip(&*values) {
                *bytes = f16::from_f32(*value).to_le_bytes();
            }
        } else {
            for (bytes, value) in target.as_chunks_mut::<4>().0.iter_mut().zip(&*values) {
                *bytes = value.to_le_bytes();
            }
        }
    }
}

/// Byte position of every row's chunk, 8 bytes each.
fn offset_table(header: usize, rows: usize, chunk: usize) -> Vec<u8> {
    (0..rows).flat_map(|row| ((header + rows * 8 + row * chunk) as u64).to_le_bytes()).collect()
}

/// Indices and names of channels in the order of the file, which is that of their names.
pub(super) fn in_order<'a>(channels: &[&'a str]) -> (Vec<usize>, Vec<&'a str>) {
    let mut order: Vec<usize> = (0..channels.len()).collect();
    order.sort_by_key(|&i| channels[i]);
    let sorted = order.iter().map(|&i| channels[i]).collect();
    (order, sorted)
}

/// Compression of an EXR, with its number in the format.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Compression {
    None = 0,
    /// Deflate of blocks of 16 rows.
    Zip = 3,
}

/// Magic number, version and attributes, as in "OpenEXR File Layout" (openexr.com).
pub(super) fn exr_header(
    precision: Precision,
    compression: Compression,
    [width, height]: [usize; 2],
    channels: &[&str],
    custom: &[(&str, Attribute)],
) -> io::Result<Vec<u8>> {
    let refuse = |what: &str| Err(io::Error::new(io::ErrorKind::InvalidInput, what.to_string()));
    let names = || channels.iter().copied().chain(custom.iter().map(|(name, _)| *name));
    if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) {
        return refuse("an image side must have 1 to 65535 pixels");
    }
    if channels.is_empty() || channels.windows(2).any(|pair| pair[0] == pair[1]) {
        return refuse("channels must have names of their own");
    }
    if names().any(|name| name.is_empty() || name.len() > LONGEST_NAME || name.contains('\0')) {
        return refuse("a channel or attribute name is empty or too long");
    }
    let long_names = if names().any(|name| name.len() > 31) { 0x400_u32 } else { 0 };
    let mut out = vec![0x76, 0x2f, 0x31, 0x01];
    out.extend((2 | long_names).to_le_bytes());

    let mut list = Vec::new();
    for name in channels {
        list.extend(name.bytes().chain([0]));
        // Type, not perceptually linear, reserved, sampling 1 x 1.
        let kind = if precision == Precision::Half { 1_u32 } else { 2 };
        for word in [kind, 0, 1, 1] {
            list.extend(word.to_le_bytes());
        }
    }
    list.push(0);
    let window: Vec<u8> =
        [0, 0, width as u32 - 1, height as u32 - 1].iter().flat_map(|side| side.to_le_bytes()).collect();
    put(&mut out, "channels", "chlist", &list);
    put(&mut out, "compression", "compression", &[compression as u8]);
    put(&mut out, "dataWindow", "box2i", &window);
    put(&mut out, "displayWindow", "box2i", &window);
    put(&mut out, "lineOrder", "lineOrder", &[0]);
    put(&mut out, "pixelAspectRatio", "float", &1.0_f32.to_le_bytes());
    put(&mut out, "screenWindowCenter", "v2f", &[0; 8]);
    put(&mut out, "screenWindowWidth", "float", &1.0_f32.to_le_bytes());
    for (name, value) in custom {
        match value {
            Attribute::Number(number) => put(&mut out, name, "double", &number.to_le_bytes()),
            Attribute::Text(text) => put(&mut out, name, "string", text.as_bytes()),
            Attribute::Chromaticities(points) => {
                let bytes: Vec<u8> = points.as_flattened().iter().flat_map(|v| v.to_le_bytes()).collect();
                put(&mut out, name, "chromaticities", &bytes);
            }
        }
    }
    out.push(0);
    Ok(out)
}

fn put(out: &mut Vec<u8>, name: &str, kind: &str, value: &[u8]) {
    out.extend(name.bytes().chain([0]).chain(kind.bytes()).chain([0]));
    out.extend((value.len() as u32).to_le_bytes());
    out.extend(value);
}

/// Writes an 8-bit PNG of 1 (grey) or 3 (RGB) interleaved channels, `width · height · channels` samples.
///
/// # Errors
/// `Error::Output` if the system refuses, or the number of samples does not match the size.
pub fn write_png8(path: &Path, width: usize, height: usize, channels: usize, samples: &[u8]) -> Result<()> {
    let color = if channels == 1 { ExtendedColorType::L8 } else { ExtendedColorType::Rgb8 };
    write_png(path, [width, height], samples, color)
}

/// Writes a 16-bit grey PNG of `width · height` samples atomically.
///
/// # Errors
/// `Error::Output` if the system refuses, or the number of samples does not match the size.
pub fn write_png16_gray(path: &Path, width: usize, height: usize, samples: &[u16]) -> Result<()> {
    let encoded = encode_png16_gray(width, height, samples).map_err(|error| Error::output(path, error))?;
    write_whole(path, &encoded)
}

/// Encodes `width · height` samples as a 16-bit grey PNG; equal samples give equal bytes.
///
/// # Errors
/// `InvalidInput` if the number of samples does not match the size.
pub fn encode_png16_gray(width: usize, height: usize, samples: &[u16]) -> io::Result<Vec<u8>> {
    let bytes: Vec<u8> = samples.iter().flat_map(|sample| sample.to_ne_bytes()).collect();
    encode_png([width, height], &bytes, ExtendedColorType::L16)
}

/// Encodes 1 (grey) or 3 (RGB) interleaved channels as an 8-bit PNG.
///
/// # Errors
/// `InvalidInput` if the number of samples does not match the size.
pub fn encode_png8(width: usize, height: usize, channels: usize, samples: &[u8]) -> io::Result<Vec<u8>> {
    let color = if channels == 1 { ExtendedColorType::L8 } else { ExtendedColorType::Rgb8 };
    encode_png([width, height], samples, color)
}

/// Encodes in memory first to keep the system's error of a failing write; the encoder would turn it into text.
fn write_png(path: &Path, size: [usize; 2], bytes: &[u8], color: ExtendedColorType) -> Result<()> {
    let encoded = encode_png(size, bytes, color).map_err(|error| Error::output(path, error))?;
    std::fs::write(path, encoded).map_err(|error| Error::output(path, error))
}

fn encode_png(size: [usize; 2], bytes: &[u8], color: ExtendedColorType) -> io::Result<Vec<u8>> {
    let pixels = size[0].checked_mul(size[1]).filter(|_| size[0].min(size[1]) > 0 && size[0].max(size[1]) <= MAX_SIDE);
    if pixels.map(|n| n * usize::from(color.bits_per_pixel()) / 8) != Some(bytes.len()) {
        let words = format!("{} bytes for a picture of {} x {} pixels", bytes.len(), size[0], size[1]);
        return Err(io::Error::new(io::ErrorKind::InvalidInput, words));
    }
    let mut encoded = Vec::new();
    PngEncoder::new_with_quality(&mut encoded, CompressionType::Fast, FilterType::Up)
        .write_image(bytes, size[0] as u32, size[1] as u32, color)
        .map_err(io::Error::other)?;
    Ok(encoded)
}

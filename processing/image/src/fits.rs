//! FITS files: the image of the primary header and data unit, or the only image extension if the primary unit is empty.
//!
//! The first row of FITS is at the bottom and becomes the last one (row 0 on top), unless the keyword `ROWORDER` is
//! `TOP-DOWN`. Values are `BZERO + BSCALE · stored`. Unsigned bytes and 16-bit integers (`BZERO = 32768`) stay
//! integers; all other types become `f32`.

use std::collections::HashMap;
use std::io::{Read, Seek, SeekFrom};

use super::fault::{Decoded, Fault};
use super::raster::{Depth, Info, Raster, Samples, zeroed};
use super::source::Source;

/// Bytes per block; headers and data consist of whole blocks.
const BLOCK: usize = 2880;
/// Bytes per card, which holds one keyword.
const CARD: usize = 80;
/// Largest number of blocks of a header (100,800 keywords).
const MAX_BLOCKS: usize = 2800;
/// Largest number of units that are searched for an image.
const MAX_UNITS: usize = 64;
const EXPORT: &str = "export one image of it as 16-bit or floating-point FITS or TIFF";

/// Type of a stored value.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Stored {
    U8,
    I16,
    I32,
    F32,
    F64,
}

/// Size and type of an image, from its header.
#[derive(Debug, PartialEq)]
struct Image {
    info: Info,
    stored: Stored,
    zero: f64,
    scale: f64,
    /// Stored integer of undefined values.
    blank: Option<i64>,
    top_down: bool,
    /// Saturation level (keyword `SATURATE`).
    saturated: Option<f64>,
}

/// Keywords and their values as text; strings are without quotes.
type Header = HashMap<String, String>;

pub(super) fn info(mut source: Source) -> Decoded<Info> {
    image(&mut source).map(|image| image.info)
}

/// Black and white level: from the keyword `SATURATE`, or the largest signed 16-bit integer.
pub(super) fn levels(mut source: Source) -> Decoded<Option<[f64; 2]>> {
    let image = image(&mut source)?;
    let integers = (image.stored == Stored::I16).then(|| image.zero + image.scale * f64::from(i16::MAX));
    Ok(image.saturated.or(integers).filter(|white| *white > 0.0).map(|white| [0.0, white]))
}

pub(super) fn read(mut source: Source) -> Decoded<Raster> {
    let image = image(&mut source)?;
    let Info { width, height, channels, depth } = image.info;
    let bytes = image.stored.bytes();
    let mut row = zeroed::<u8>(width * bytes)?;
    let mut samples = match depth {
        Depth::U8 => Samples::U8(zeroed(image.info.len())?),
        Depth::U16 => Samples::U16(zeroed(image.info.len())?),
        Depth::F32 => Samples::F32(zeroed(image.info.len())?),
    };
    for channel in 0..channels {
        for y in 0..height {
            source.read_exact(&mut row)?;
            let y = if image.top_down { y } else { height - 1 - y };
            for (x, stored) in row.chunks_exact(bytes).enumerate() {
                let at = (y * width + x) * channels + channel;
                match &mut samples {
                    Samples::U8(out) => out[at] = stored[0],
                    // Stored as signed integers, offset by 32768.
                    Samples::U16(out) => out[at] = u16::from_be_bytes([stored[0], stored[1]]) ^ 0x8000,
                    Samples::F32(out) => out[at] = image.value(stored),
                }
            }
        }
    }
    image.info.raster(samples)
}

impl Stored {
    fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::I16 => 2,
            Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

impl Image {
    /// Value of stored bytes; NaN if undefined.
    fn value(&self, bytes: &[u8]) -> f32 {
        let mut word = [0; 8];
        word[..bytes.len()].copy_from_slice(bytes);
        let bits = u64::from_be_bytes(word);
        let stored = match self.stored {
            Stored::U8 => (bits >> 56) as i64,
            Stored::I16 => (bits as i64) >> 48,
            Stored::I32 => (bits as i64) >> 32,
            Stored::F32 => return self.scaled(f32::from_bits((bits >> 32) as u32).into()),
            Stored::F64 => return self.scaled(f64::from_bits(bits)),
        };
        if self.blank == Some(stored) { f32::NAN } else { self.scaled(stored as f64) }
    }

    fn scaled(&self, stored: f64) -> f32 {
        (self.zero + self.scale * stored) as f32
    }
}

/// Finds the image, and places the source at its data. Further images are ignored; several without a primary one are
/// ambiguous.
fn image(source: &mut Source) -> Decoded<Image> {
    let length = source.get_ref().metadata()?.len();
    source.seek(SeekFrom::Start(0))?;
    let mut found: Option<(Image, u64)> = None;
    for unit in 0..MAX_UNITS {
        let Some(header) = header(source)? else { break };
        let axes = axes(&header)?;
        let kind = if unit == 0 { "IMAGE" } else { header.get("XTENSION").map_or("", String::as_str) };
        let bits = number(&header, "BITPIX")?.unwrap_or(0.0);
        if header.get("ZIMAGE").is_some_and(|z| z == "T") {
            return Err(Fault::unusable("is a compressed FITS image (fpack)", "decompress it with `funpack`"));
        }
        let product = axes.iter().try_fold(u64::from(!axes.is_empty()), |all, n| all.checked_mul(*n));
        let extra = number(&header, "PCOUNT")?.unwrap_or(0.0).max(0.0) as u64;
        let Some(bytes) = product.and_then(|n| n.checked_add(extra)?.checked_mul((bits.abs() as u64) / 8)) else {
            return Err(Fault::damaged("the sizes in its header overflow"));
        };
        let start = source.stream_position()?;
        if kind == "IMAGE" && bytes > 0 {
            if found.is_some() {
                return Err(Fault::unusable("is a FITS file of several images", EXPORT));
            }
            let image = describe(&header, &axes, bits)?;
            let end = start.saturating_add(bytes);
            if end > length {
                return Err(Fault::damaged(format!("the pixels end at byte {end}, the file at {length}")));
            }
            if unit == 0 {
                return Ok(image);
            }
            found = Some((image, start));
        }
        let skipped = bytes.div_ceil(BLOCK as u64).checked_mul(BLOCK as u64).and_then(|n| i64::try_from(n).ok());
        source.seek_relative(skipped.ok_or_else(|| Fault::damaged("the sizes in its header overflow"))?)?;
    }
    let (image, start) = found.ok_or_else(|| Fault::unusable("is a FITS file without an image", EXPORT))?;
    source.seek(SeekFrom::Start(start))?;
    Ok(image)
}

/// Reads the keywords of the next unit; `None` at the end of the file.
fn header(source: &mut Source) -> Decoded<Option<Header>> {
    let mut header = Header::new();
    for index in 0..MAX_BLOCKS {
        let mut block = Vec::with_capacity(BLOCK);
        source.by_ref().take(BLOCK as u64).read_to_end(&mut block)?;
        match block.len() {
            0 if index == 0 => return Ok(None),
            BLOCK => {}
            _ => return Err(Fault::damaged("its header has no END")),
        }
        if index == 0 && !block.starts_with(b"SIMPLE  ") && !block.starts_with(b"XTENSION") {
            // Bytes after the last unit are allowed.
            return Ok(None);
        }
        for card in block.chunks_exact(CARD) {
            let keyword = String::from_utf8_lossy(&card[..8]).trim_end().to_owned();
            if keyword == "END" {
                return Ok(Some(header));
            }
            if let Some(value) = value(card) {
                header.entry(keyword).or_insert(value);
            }
        }
    }
    Err(Fault::damaged("its header has no END"))
}

/// Value of a card `KEYWORD = value / comment`.
fn value(card: &[u8]) -> Option<String> {
    let text = String::from_utf8_lossy(card.get(8..)?);
    let text = text.strip_prefix("= ")?.trim();
    match text.strip_prefix('\'') {
        Some(quoted) => Some(quoted.split('\'').next().unwrap_or_default().trim_end().to_owned()),
        None => Some(text.split('/').next().unwrap_or_default().trim().to_owned()),
    }
}

/// Number in the header, also with Fortran's exponent `D`.
fn number(header: &Header, keyword: &str) -> Decoded<Option<f64>> {
    let Some(text) = header.get(keyword).filter(|text| !text.is_empty()) else { return Ok(None) };
    match text.replace(['D', 'd'], "E").parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(Some(number)),
        _ => Err(Fault::damaged(format!("its keyword {keyword} is '{text}', not a number"))),
    }
}

/// Lengths of the axes, fastest first, without trailing axes of length 1.
fn axes(header: &Header) -> Decoded<Vec<u64>> {
    let count = number(header, "NAXIS")?.ok_or_else(|| Fault::damaged("its header has no NAXIS"))?;
    if !(0.0..=999.0).contains(&count) {
        return Err(Fault::damaged(format!("its keyword NAXIS is {count}")));
    }
    let mut axes = vec![];
    for axis in 1..=count as usize {
        let keyword = format!("NAXIS{axis}");
        let length = number(header, &keyword)?.ok_or_else(|| Fault::damaged(format!("its header has no {keyword}")))?;
        if length < 0.0 || length.fract() != 0.0 {
            return Err(Fault::damaged(format!("its keyword {keyword} is {length}")));
        }
        axes.push(length as u64);
    }
    while axes.len() > 2 && axes.last() == Some(&1) {
        axes.pop();
    }
    Ok(axes)
}

fn describe(header: &Header, axes: &[u64], bits: f64) -> Decoded<Image> {
    let (size, channels) = match *axes {
        [width, height] => ([width, height], 1),
        [width, height, 3] => ([width, height], 3),
        _ => {
            let sides = axes.iter().map(u64::to_string).collect::<Vec<_>>().join(" x ");
            let problem = format!("is a FITS array of {sides} values, neither one plane nor three (red, green, blue)");
            return Err(Fault::unusable(problem, EXPORT));
        }
    };
    let filters = ["BAYERPAT", "COLORTYP"].into_iter().filter_map(|k| Some((k, header.get(k)?)));
    let mosaic =
        |pattern: &str| pattern.len() >= 4 && pattern.bytes().all(|c| b"RGBCMYEW".contains(&c.to_ascii_uppercase()));
    if let Some((keyword, pattern)) = filters.into_iter().find(|(_, p)| channels == 1 && mosaic(p)) {
        let problem = format!("holds a mosaic of colour filters ({keyword} = {pattern}), which is not read from FITS");
        return Err(Fault::unusable(
            problem,
            "debayer it at half size (superpixel) without white balance, or convert it to DNG",
        ));
    }
    let stored = match bits as i64 {
        8 => Stored::U8,
        16 => Stored::I16,
        32 => Stored::I32,
        -32 => Stored::F32,
        -64 => Stored::F64,
        other => return Err(Fault::unusable(format!("is a FITS image of BITPIX = {other}"), EXPORT)),
    };
    let zero = number(header, "BZERO")?.unwrap_or(0.0);
    let scale = number(header, "BSCALE")?.unwrap_or(1.0);
    let whole = matches!(stored, Stored::U8 | Stored::I16 | Stored::I32);
    let blank = number(header, "BLANK")?.filter(|_| whole).map(|b| b as i64);
    let depth = match stored {
        Stored::U8 if zero == 0.0 && scale == 1.0 && blank.is_none() => Depth::U8,
        Stored::I16 if zero == 32_768.0 && scale == 1.0 && blank.is_none() => Depth::U16,
        _ => Depth::F32,
    };
    let info = Info::checked(size, channels, depth, channels as u64, depth.bytes().max(stored.bytes()) as u64)?;
    let top_down = header.get("ROWORDER").is_some_and(|order| order.eq_ignore_ascii_case("TOP-DOWN"));
    let saturated = number(header, "SATURATE")?;
    Ok(Image { info, stored, zero, scale, blank, top_down, saturated })
}

//! TIFF files: integers of 1 to 16 bits and floats of 16, 32 and 64 bits (as `f32`), grey or RGB, of the first page in
//! full resolution.

use std::borrow::Cow;
use std::fmt;

use tiff::TiffError;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::{SampleFormat, Tag};

use super::details::{Details, encoding};
use super::exif::ORIENTATIONS;
use super::fault::{Decoded, FLOATS, Fault, SAME_DEPTH};
use super::raster::{Depth, Info, MAX_BYTES, Raster, Samples};
use super::source::Source;
use super::tif_chunks::{Layout, unpack};

/// Largest number of pages that are read.
const MAX_PAGES: usize = 1000;

/// Bits of the tag NewSubfileType: a reduced copy of another page, or a mask.
const REDUCED_OR_MASK: u32 = 1 | 4;

/// Compression method that only the library decodes.
const FAX4: u32 = 4;

/// Compression method with JPEG strips or tiles.
const JPEG: u32 = 7;

/// Type of the samples of a page.
#[derive(Clone, Copy)]
pub(super) enum Sample {
    /// Integers of 1 to 16 bits.
    Unsigned(u8),
    /// Floating point of 16, 32 or 64 bits.
    Float(u8),
}

impl Sample {
    pub fn bits(self) -> u8 {
        match self {
            Self::Unsigned(bits) | Self::Float(bits) => bits,
        }
    }

    /// Value with all bits set.
    pub fn largest(self) -> u64 {
        u64::MAX >> (64 - u32::from(self.bits()))
    }

    fn depth(self) -> Depth {
        match self {
            Self::Unsigned(..=8) => Depth::U8,
            Self::Unsigned(_) => Depth::U16,
            Self::Float(_) => Depth::F32,
        }
    }
}

impl fmt::Display for Sample {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = if matches!(self, Self::Float(_)) { "floating-point" } else { "integer" };
        write!(f, "{}-bit {kind}", self.bits())
    }
}

pub(super) fn info(source: Source) -> Decoded<Info> {
    open(source).map(|page| page.info)
}

pub(super) fn read(source: Source) -> Decoded<Raster> {
    let mut page = open(source)?;
    if page.compression == FAX4 {
        return fax(page);
    }
    let layout = Layout::of(&mut page.decoder, page.info, page.stored, page.sample)?;
    page.info.raster(layout.read(page.decoder.inner())?)
}

/// Reads black and white pages with fax compression.
fn fax(mut page: Page) -> Decoded<Raster> {
    let DecodingResult::U8(bytes) = page.decoder.read_image().map_err(fault)? else {
        return Err(Fault::damaged("more than one bit per pixel, compressed by CCITT Group 4"));
    };
    let mut values = Vec::with_capacity(page.info.len());
    for row in bytes.chunks_exact(page.info.width.div_ceil(8)) {
        let mut bits = vec![];
        unpack(row, page.info.width, 1, &mut bits);
        values.extend(bits.into_iter().map(|v| v as u8));
    }
    page.info.raster(Samples::U8(values))
}

/// Adds the statements of tags about values, and the number of pages.
pub(super) fn describe(source: &mut Source, details: &mut Details) -> Decoded<()> {
    let source = Source::with_capacity(1 << 16, source.get_ref().try_clone()?);
    let mut page = open(source)?;
    if matches!(page.sample, Sample::Unsigned(bits) if bits != 8 && bits != 16) {
        details.white = Some(page.sample.largest() as f64);
    }
    let profile = page.decoder.find_tag(Tag::IccProfile).map_err(fault)?;
    details.encoding = profile.and_then(|p| p.into_u8_vec().ok()).and_then(|p| encoding(&p));
    let orientation = page.decoder.find_tag_unsigned::<u16>(Tag::Orientation).map_err(fault)?;
    details.orientation = orientation.filter(|o| ORIENTATIONS.contains(o)).unwrap_or(1);
    if page.full > 1 {
        details.notes.push(format!("has {} pages, of which the first is read", page.full));
    }
    Ok(())
}

/// Decoder at the page that is read.
struct Page {
    decoder: Decoder<Source>,
    info: Info,
    /// Number of channels in the file.
    stored: usize,
    sample: Sample,
    compression: u32,
    /// Number of pages in full resolution.
    full: usize,
}

fn open(source: Source) -> Decoded<Page> {
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MAX_BYTES as usize;
    limits.intermediate_buffer_size = MAX_BYTES as usize;
    limits.ifd_value_size = 16 << 20;
    let mut decoder = Decoder::new(source).map_err(fault)?.with_limits(limits);
    let full = to_first_full_page(&mut decoder)?;
    let compression = compression(&mut decoder)?;
    let (channels, stored) = channels(&mut decoder, compression)?;
    let sample = sample(&mut decoder)?;
    if compression == JPEG && !(matches!(sample, Sample::Unsigned(8)) && [1, 3].contains(&stored)) {
        let problem = format!("is a TIFF of {stored} {sample} channels compressed by JPEG, which is not read");
        return Err(Fault::unusable(problem, "save it with LZW, Deflate or no compression"));
    }
    let (width, height) = decoder.dimensions().map_err(fault)?;
    let bytes = u64::from(sample.bits()).div_ceil(8);
    let info = Info::checked([width.into(), height.into()], channels, sample.depth(), stored as u64, bytes)?;
    Ok(Page { decoder, info, stored, sample, compression, full })
}

/// Moves to the first page that is neither a reduced copy nor a mask; returns the number of such pages.
fn to_first_full_page(decoder: &mut Decoder<Source>) -> Decoded<usize> {
    let is_full = |decoder: &mut Decoder<Source>| -> Decoded<bool> {
        let kind = decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType).map_err(fault)?.unwrap_or(0);
        // In the older tag, 2 is a reduced copy.
        let old = decoder.find_tag_unsigned::<u32>(Tag::SubfileType).map_err(fault)?.unwrap_or(1);
        Ok(kind & REDUCED_OR_MASK == 0 && old != 2)
    };
    let mut pages = vec![is_full(decoder)?];
    while decoder.more_images() && pages.len() < MAX_PAGES {
        // Pages after an unreadable one are not counted.
        if decoder.next_image().is_err() {
            break;
        }
        pages.push(is_full(decoder)?);
    }
    let first = pages.iter().position(|full| *full).unwrap_or(0);
    if pages.len() > 1 {
        decoder.seek_to_image(first).map_err(fault)?;
    }
    Ok(pages.into_iter().filter(|full| *full).count())
}

fn tag(decoder: &mut Decoder<Source>, tag: Tag, default: u32) -> Decoded<u32> {
    Ok(decoder.find_tag_unsigned(tag).map_err(fault)?.unwrap_or(default))
}

/// Compression method; unsupported ones are refused by name.
fn compression(decoder: &mut Decoder<Source>) -> Decoded<u32> {
    if tag(decoder, Tag::FillOrder, 1)? == 2 {
        return Err(Fault::unusable("is a TIFF with FillOrder 2, which is not read", "save it with FillOrder 1"));
    }
    let method = tag(decoder, Tag::Compression, 1)?;
    let name: Cow<str> = match method {
        1 | FAX4 | 5 | 7 | 8 | 32_773 | 32_946 => return Ok(method),
        2 | 3 => "CCITT Group 3".into(),
        6 => "JPEG of TIFF 6".into(),
        34_712 => "JPEG 2000".into(),
        34_887 => "LERC".into(),
        34_925 => "LZMA".into(),
        34_933 => "PNG".into(),
        22_610 | 34_934 => "JPEG XR".into(),
        50_000 => "Zstandard".into(),
        50_001 => "WebP".into(),
        50_002 | 52_546 => "JPEG XL".into(),
        other => format!("method {other}").into(),
    };
    let problem = format!("is a TIFF compressed by {name}, which is not read");
    Err(Fault::unusable(problem, "save it with LZW, Deflate or no compression"))
}

/// Number of channels to keep, and of stored channels. Colour differences (YCbCr) are converted for JPEG data only.
fn channels(decoder: &mut Decoder<Source>, compression: u32) -> Decoded<(usize, usize)> {
    let stored = tag(decoder, Tag::SamplesPerPixel, 1)? as usize;
    let kind: Cow<str> = match (tag(decoder, Tag::PhotometricInterpretation, 1)?, stored) {
        (0 | 1, 1 | 2) => return Ok((1, stored)),
        (2, 3 | 4) | (6, 3) if compression == JPEG && stored == 3 => return Ok((3, 3)),
        (2, 3 | 4) => return Ok((3, stored)),
        (3, _) => "palette".into(),
        (4, _) => "mask".into(),
        (5, _) => "CMYK".into(),
        (6, _) => "YCbCr".into(),
        (8..=10, _) => "CIE L*a*b*".into(),
        (32_803, _) => "colour filter mosaic".into(),
        (_, n) => format!("{n} channels").into(),
    };
    Err(Fault::unusable(format!("is a TIFF of kind {kind}, neither grey nor RGB"), SAME_DEPTH))
}

fn sample(decoder: &mut Decoder<Source>) -> Decoded<Sample> {
    let bits = decoder.find_tag_unsigned_vec::<u16>(Tag::BitsPerSample).map_err(fault)?.unwrap_or(vec![1]);
    let formats = decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat).map_err(fault)?;
    let format = formats.and_then(|f| f.first().copied()).map_or(SampleFormat::Uint, SampleFormat::from_u16_exhaustive);
    let first = bits.first().copied().unwrap_or(1);
    if bits.iter().any(|b| *b != first) {
        return Err(Fault::unusable(format!("is a TIFF with {bits:?} bits in its channels"), SAME_DEPTH));
    }
    let kind = match (format, first) {
        (SampleFormat::Uint | SampleFormat::Void, 1..=16) => return Ok(Sample::Unsigned(first as u8)),
        (SampleFormat::IEEEFP, 16 | 32 | 64) => return Ok(Sample::Float(first as u8)),
        (SampleFormat::Uint | SampleFormat::Void, _) => "unsigned integers",
        (SampleFormat::Int, _) => "signed integers",
        (SampleFormat::IEEEFP, _) => "floating-point samples",
        (SampleFormat::Unknown(5 | 6), _) => "complex numbers",
        _ => "samples of an unknown format",
    };
    Err(Fault::unusable(format!("is a TIFF of {first}-bit {kind}"), FLOATS))
}

pub(super) fn fault(error: TiffError) -> Fault {
    match error {
        TiffError::IoError(error) => error.into(),
        TiffError::UnsupportedError(error) => Fault::unusable(format!("cannot be decoded: {error}"), SAME_DEPTH),
        other => Fault::damaged(other),
    }
}

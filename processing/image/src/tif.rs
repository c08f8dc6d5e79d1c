//! TIFF: integers of 1 to 16 bits, 16, 32 and 64-bit floats (as `f32`), grey or RGB, of the first page in full resolution.

use std::borrow::Cow;

use tiff::TiffError;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::{SampleFormat, Tag};

use super::details::{Details, encoding};
use super::exif::ORIENTATIONS;
use super::fault::{Decoded, Fault};
use super::raster::{Depth, Info, MAX_BYTES, Raster, Samples, keep_channels};
use super::source::Source;
use super::tif_packed::{self, unpack};

/// Pages that are looked at.
const MAX_PAGES: usize = 1000;

/// Bits of the tag NewSubfileType: a page that is a small copy of another one, or a mask.
const REDUCED_OR_MASK: u32 = 1 | 4;

pub(super) fn info(source: Source) -> Decoded<Info> {
    open(source).map(|page| page.info)
}

pub(super) fn read(source: Source) -> Decoded<Raster> {
    let mut page = open(source)?;
    let (info, stored, kept) = (page.info, page.stored, page.info.channels);
    if page.bits > 8 && page.bits < 16 {
        let values = tif_packed::read(&mut page.decoder, info, stored, page.bits)?;
        return info.raster(Samples::U16(keep_channels(values, stored, kept)));
    }
    let mut result = DecodingResult::U8(vec![]);
    let layout = page.decoder.read_image_to_buffer(&mut result).map_err(fault)?;
    let planes = layout.planes.max(1);
    let samples = match result {
        DecodingResult::U8(v) if page.bits < 8 => {
            let row = v.len() / info.height.max(1);
            Samples::U8(unpack(&v, row, info.width * stored, page.bits)?.into_iter().map(|v| v as u8).collect())
        }
        DecodingResult::U8(v) => Samples::U8(keep_channels(interleaved(v, planes), stored, kept)),
        DecodingResult::U16(v) => Samples::U16(keep_channels(interleaved(v, planes), stored, kept)),
        DecodingResult::F16(v) => floats(v.into_iter().map(|x| x.to_f32()).collect(), planes, stored, kept),
        DecodingResult::F32(v) => floats(v, planes, stored, kept),
        DecodingResult::F64(v) => floats(v.into_iter().map(|x| x as f32).collect(), planes, stored, kept),
        _ => return Err(Fault::unsupported("is a TIFF of signed or wide integers")),
    };
    info.raster(samples)
}

/// Adds what the tags say about values, and how many pages there are.
pub(super) fn describe(source: &mut Source, details: &mut Details) -> Decoded<()> {
    let source = Source::with_capacity(1 << 16, source.get_ref().try_clone()?);
    let mut page = open(source)?;
    if page.bits < 16 && page.bits != 8 {
        details.white = Some(f64::from((1_u32 << page.bits) - 1));
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

/// One plane after the other, as pixels of all planes.
fn interleaved<T: Copy>(samples: Vec<T>, planes: usize) -> Vec<T> {
    if planes < 2 {
        return samples;
    }
    let plane = samples.len() / planes;
    (0..plane).flat_map(|i| (0..planes).map(move |p| p * plane + i)).map(|i| samples[i]).collect()
}

fn floats(samples: Vec<f32>, planes: usize, stored: usize, kept: usize) -> Samples {
    Samples::F32(keep_channels(interleaved(samples, planes), stored, kept))
}

/// A decoder at the page that is read.
struct Page {
    decoder: Decoder<Source>,
    info: Info,
    /// Channels in the file.
    stored: usize,
    /// Bits per sample.
    bits: u8,
    /// Pages in full resolution.
    full: usize,
}

fn open(source: Source) -> Decoded<Page> {
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MAX_BYTES as usize;
    limits.intermediate_buffer_size = MAX_BYTES as usize;
    limits.ifd_value_size = 16 << 20;
    let mut decoder = Decoder::new(source).map_err(fault)?.with_limits(limits);
    let full = to_first_full_page(&mut decoder)?;
    check_compression(&mut decoder)?;
    let (channels, stored, bits) = channels(&mut decoder)?;
    let depth = depth(&mut decoder, bits)?;
    let (width, height) = decoder.dimensions().map_err(fault)?;
    let bytes = u64::from(bits).div_ceil(8);
    let info = Info::checked([width.into(), height.into()], channels, depth, stored as u64, bytes)?;
    Ok(Page { decoder, info, stored, bits, full })
}

/// Goes to the first page that is no reduced copy and no mask; returns how many there are.
fn to_first_full_page(decoder: &mut Decoder<Source>) -> Decoded<usize> {
    let is_full = |decoder: &mut Decoder<Source>| -> Decoded<bool> {
        let kind = decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType).map_err(fault)?.unwrap_or(0);
        // Of the older tag, 2 is a reduced copy.
        let old = decoder.find_tag_unsigned::<u32>(Tag::SubfileType).map_err(fault)?.unwrap_or(1);
        Ok(kind & REDUCED_OR_MASK == 0 && old != 2)
    };
    let mut pages = vec![is_full(decoder)?];
    while decoder.more_images() && pages.len() < MAX_PAGES {
        // Pages behind one that cannot be read are not counted.
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

/// Refuses methods of compression that the decoder does not have, by name.
fn check_compression(decoder: &mut Decoder<Source>) -> Decoded<()> {
    let method = decoder.find_tag_unsigned::<u16>(Tag::Compression).map_err(fault)?.unwrap_or(1);
    let name: Cow<str> = match method {
        1 | 4 | 5 | 7 | 8 | 32_773 | 32_946 => return Ok(()),
        2 | 3 => "CCITT Group 3".into(),
        6 => "JPEG of TIFF 6".into(),
        34_712 => "JPEG 2000".into(),
        34_887 => "LERC".into(),
        34_925 => "LZMA".into(),
        50_000 => "Zstandard".into(),
        50_001 => "WebP".into(),
        50_002 | 52_546 => "JPEG XL".into(),
        other => format!("method {other}").into(),
    };
    let problem = format!("is a TIFF compressed by {name}, which is not read");
    Err(Fault::unusable(problem, "save it with LZW, Deflate or no compression"))
}

/// Channels to keep, channels stored, bits per sample.
fn channels(decoder: &mut Decoder<Source>) -> Decoded<(usize, usize, u8)> {
    use tiff::ColorType as C;
    match decoder.colortype().map_err(fault)? {
        C::Gray(bits) => Ok((1, 1, bits)),
        // The decoder's word for grey with one extra sample.
        C::GrayA(bits) | C::Multiband { bit_depth: bits, num_samples: 2 } => Ok((1, 2, bits)),
        C::RGB(bits) => Ok((3, 3, bits)),
        C::RGBA(bits) => Ok((3, 4, bits)),
        other => Err(Fault::unsupported(format!("is a TIFF of kind {other:?}, neither grey nor RGB"))),
    }
}

fn depth(decoder: &mut Decoder<Source>, bits: u8) -> Decoded<Depth> {
    let formats = decoder.find_tag_unsigned_vec::<u16>(Tag::SampleFormat).map_err(fault)?;
    let format = formats.and_then(|f| f.first().copied()).map_or(SampleFormat::Uint, SampleFormat::from_u16_exhaustive);
    match (format, bits) {
        (SampleFormat::Uint, 1..=8) => Ok(Depth::U8),
        (SampleFormat::Uint, 9..=16) => Ok(Depth::U16),
        (SampleFormat::IEEEFP, 16 | 32 | 64) => Ok(Depth::F32),
        (format, bits) => Err(Fault::unsupported(format!("is a TIFF of {bits}-bit {format:?} samples"))),
    }
}

pub(super) fn fault(error: TiffError) -> Fault {
    match error {
        TiffError::IoError(error) => error.into(),
        TiffError::UnsupportedError(error) => Fault::unsupported(format!("cannot be decoded: {error}")),
        other => Fault::damaged(other),
    }
}

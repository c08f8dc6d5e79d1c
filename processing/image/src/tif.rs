//! TIFF: 8 and 16-bit integers, 16, 32 and 64-bit floats (as `f32`), grey or RGB, first page.

use tiff::TiffError;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::{SampleFormat, Tag};

use super::fault::{Decoded, Fault};
use super::raster::{Depth, Info, MAX_BYTES, Raster, Samples, keep_channels};
use super::source::Source;

pub(super) fn info(source: Source) -> Decoded<Info> {
    open(source).map(|(_, info, _)| info)
}

pub(super) fn read(source: Source) -> Decoded<Raster> {
    let (mut decoder, info, stored) = open(source)?;
    let kept = info.channels;
    let samples = match decoder.read_image().map_err(fault)? {
        DecodingResult::U8(v) => Samples::U8(keep_channels(v, stored, kept)),
        DecodingResult::U16(v) => Samples::U16(keep_channels(v, stored, kept)),
        DecodingResult::F16(v) => floats(v.into_iter().map(|x| x.to_f32()).collect(), stored, kept),
        DecodingResult::F32(v) => floats(v, stored, kept),
        DecodingResult::F64(v) => floats(v.into_iter().map(|x| x as f32).collect(), stored, kept),
        _ => return Err(Fault::unsupported("is a TIFF of signed or wide integers")),
    };
    info.raster(samples)
}

fn floats(samples: Vec<f32>, stored: usize, kept: usize) -> Samples {
    Samples::F32(keep_channels(samples, stored, kept))
}

/// The decoder, what the header says, and how many channels are stored.
fn open(source: Source) -> Decoded<(Decoder<Source>, Info, usize)> {
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MAX_BYTES as usize;
    limits.intermediate_buffer_size = MAX_BYTES as usize;
    limits.ifd_value_size = 16 << 20;
    let mut decoder = Decoder::new(source).map_err(fault)?.with_limits(limits);
    let (channels, stored, bits) = channels(&mut decoder)?;
    let depth = depth(&mut decoder, bits)?;
    if stored > 1 && decoder.find_tag_unsigned::<u16>(Tag::PlanarConfiguration).map_err(fault)? == Some(2) {
        return Err(Fault::unsupported("is a TIFF with its channels in separate planes"));
    }
    let (width, height) = decoder.dimensions().map_err(fault)?;
    let bytes = u64::from(bits).div_ceil(8);
    let info = Info::checked([width.into(), height.into()], channels, depth, stored as u64, bytes)?;
    Ok((decoder, info, stored))
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
        (SampleFormat::Uint, 8) => Ok(Depth::U8),
        (SampleFormat::Uint, 16) => Ok(Depth::U16),
        (SampleFormat::IEEEFP, 16 | 32 | 64) => Ok(Depth::F32),
        (format, bits) => Err(Fault::unsupported(format!("is a TIFF of {bits}-bit {format:?} samples"))),
    }
}

fn fault(error: TiffError) -> Fault {
    match error {
        TiffError::IoError(error) => error.into(),
        TiffError::UnsupportedError(error) => Fault::unsupported(format!("cannot be decoded: {error}")),
        other => Fault::damaged(other),
    }
}

//! WebP files: still pictures of 8 bits, RGB, lossy or lossless.

use image_webp::{DecodingError, WebPDecoder};

use super::fault::{Decoded, Fault, SAME_DEPTH};
use super::raster::{Depth, Info, Raster, Samples, keep_channels, zeroed};
use super::source::Source;

/// Memory besides the pixels, in bytes.
const SIDE_BYTES: usize = 64 << 20;

pub(super) fn info(source: Source) -> Decoded<Info> {
    open(source).map(|(_, info, _)| info)
}

pub(super) fn read(source: Source) -> Decoded<Raster> {
    let (mut decoder, info, stored) = open(source)?;
    let mut samples = zeroed::<u8>(info.width * info.height * stored)?;
    if decoder.output_buffer_size() != Some(samples.len()) {
        return Err(Fault::damaged("the decoder and the header disagree about the size"));
    }
    decoder.read_image(&mut samples).map_err(fault)?;
    info.raster(Samples::U8(keep_channels(samples, stored, info.channels)))
}

/// Decoder, header information, and number of stored channels.
fn open(source: Source) -> Decoded<(WebPDecoder<Source>, Info, usize)> {
    let mut decoder = WebPDecoder::new(source).map_err(fault)?;
    decoder.set_memory_limit(SIDE_BYTES);
    if decoder.is_animated() {
        return Err(Fault::unusable("is an animated WebP", "save one picture of it as PNG"));
    }
    let (width, height) = decoder.dimensions();
    let stored = if decoder.has_alpha() { 4 } else { 3 };
    let info = Info::checked([width.into(), height.into()], 3, Depth::U8, stored as u64, 1)?;
    Ok((decoder, info, stored))
}

fn fault(error: DecodingError) -> Fault {
    match error {
        DecodingError::IoError(error) => error.into(),
        DecodingError::UnsupportedFeature(words) => Fault::unusable(format!("cannot be decoded: {words}"), SAME_DEPTH),
        other => Fault::damaged(other),
    }
}

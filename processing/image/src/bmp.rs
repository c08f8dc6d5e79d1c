//! BMP files: palettes and RGB, as 8 bits.

use ::image::codecs::bmp::BmpDecoder;
use ::image::{ColorType, ImageDecoder};

use super::fault::{Decoded, Fault, SAME_DEPTH};
use super::raster::{Depth, Info, Raster, Samples, keep_channels, zeroed};
use super::source::Source;

pub(super) fn info(source: Source) -> Decoded<Info> {
    open(source).map(|(_, info, _)| info)
}

pub(super) fn read(source: Source) -> Decoded<Raster> {
    let (decoder, info, stored) = open(source)?;
    let bytes = usize::try_from(decoder.total_bytes()).map_err(Fault::damaged)?;
    let mut buffer = zeroed::<u8>(bytes)?;
    decoder.read_image(&mut buffer)?;
    info.raster(Samples::U8(keep_channels(buffer, stored, info.channels)))
}

fn open(source: Source) -> Decoded<(BmpDecoder<Source>, Info, usize)> {
    let decoder = BmpDecoder::new(source)?;
    let color = decoder.color_type();
    let channels = match color {
        ColorType::L8 => 1,
        ColorType::Rgb8 | ColorType::Rgba8 => 3,
        other => return Err(Fault::unusable(format!("is a BMP of kind {other:?}"), SAME_DEPTH)),
    };
    let (width, height) = decoder.dimensions();
    let per_pixel = u64::from(color.bytes_per_pixel());
    let info = Info::checked([width.into(), height.into()], channels, Depth::U8, 1, per_pixel)?;
    Ok((decoder, info, usize::from(color.channel_count())))
}

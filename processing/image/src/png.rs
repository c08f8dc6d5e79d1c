//! PNG: 8 and 16 bits, grey or RGB; palettes and smaller depths are expanded to 8 bits.

use ::image::codecs::png::PngDecoder;
use ::image::{ColorType, ImageDecoder, Limits};

use super::fault::{Decoded, Fault};
use super::raster::{Depth, Info, Raster, Samples, keep_channels, zeroed};
use super::source::Source;

/// Memory for everything but the pixels: one row, text and colour profile chunks.
const SIDE_BYTES: u64 = 64 << 20;

pub(super) fn info(source: Source) -> Decoded<Info> {
    open(source).map(|(_, info, _)| info)
}

/// Decodes into `spare` where that is as long as the picture needs.
pub(super) fn read(source: Source, spare: Vec<u16>) -> Decoded<Raster> {
    let (decoder, info, stored) = open(source)?;
    let bytes = usize::try_from(decoder.total_bytes()).map_err(Fault::damaged)?;
    let samples = match info.depth {
        Depth::U8 => {
            let mut buffer = zeroed::<u8>(bytes)?;
            decoder.read_image(&mut buffer)?;
            Samples::U8(keep_channels(buffer, stored, info.channels))
        }
        _ => {
            // Decoded in place: memory that is new to the program takes time, a second buffer a twentieth of the decoding.
            let mut buffer = if spare.len() == bytes / 2 { spare } else { zeroed::<u16>(bytes / 2)? };
            decoder.read_image(bytemuck::cast_slice_mut(&mut buffer))?;
            Samples::U16(keep_channels(buffer, stored, info.channels))
        }
    };
    info.raster(samples)
}

/// The decoder, what the header says, and how many channels are stored.
fn open(source: Source) -> Decoded<(PngDecoder<Source>, Info, usize)> {
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(SIDE_BYTES);
    let decoder = PngDecoder::with_limits(source, limits)?;
    let color = decoder.color_type();
    let (channels, depth) = match color {
        ColorType::L8 | ColorType::La8 => (1, Depth::U8),
        ColorType::Rgb8 | ColorType::Rgba8 => (3, Depth::U8),
        ColorType::L16 | ColorType::La16 => (1, Depth::U16),
        ColorType::Rgb16 | ColorType::Rgba16 => (3, Depth::U16),
        other => return Err(Fault::unsupported(format!("is a PNG of kind {other:?}"))),
    };
    let (width, height) = decoder.dimensions();
    let per_pixel = u64::from(color.bytes_per_pixel());
    let info = Info::checked([width.into(), height.into()], channels, depth, 1, per_pixel)?;
    Ok((decoder, info, usize::from(color.channel_count())))
}

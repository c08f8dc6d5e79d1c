//! Radiance HDR (RGBE) pictures in.

use super::fault::{Decoded, Fault};
use super::raster::{Depth, Info, Raster, Samples, zeroed};
use super::source::Source;
use ::image::ImageDecoder;
use ::image::codecs::hdr::HdrDecoder;

fn decoder(source: Source) -> Decoded<(HdrDecoder<Source>, Info)> {
    let decoder = HdrDecoder::new(source).map_err(Fault::damaged)?;
    let (width, height) = decoder.dimensions();
    let info = Info::checked([width.into(), height.into()], 3, Depth::F32, 3, 4)?;
    Ok((decoder, info))
}

pub(super) fn info(source: Source) -> Decoded<Info> {
    decoder(source).map(|(_, info)| info)
}

pub(super) fn read(source: Source) -> Decoded<Raster> {
    let (decoder, info) = decoder(source)?;
    let mut samples = zeroed::<f32>(info.len())?;
    decoder.read_image(bytemuck::cast_slice_mut(&mut samples)).map_err(Fault::damaged)?;
    info.raster(Samples::F32(samples))
}

//! PNG files: 8 and 16 bits, grey or RGB; palettes and smaller depths are expanded to 8 bits.

use ::image::codecs::png::PngDecoder;
use ::image::{ColorType, ImageDecoder, Limits};

use std::io::{ErrorKind, Read, Seek, SeekFrom};

use super::details::{Curve, Details, Encoding, encoding, part};
use super::exif;
use super::fault::{Decoded, Fault, SAME_DEPTH};
use super::raster::{Depth, Info, Raster, Samples, keep_channels, zeroed};
use super::source::Source;

/// Memory besides the pixels in bytes: one row, text and colour profile chunks.
const SIDE_BYTES: u64 = 64 << 20;

pub(super) fn info(source: Source) -> Decoded<Info> {
    open(source).map(|(_, info, _)| info)
}

/// Decodes into `spare` if it has the length of the image.
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
            // Decodes in place: new memory costs time, and a second buffer a twentieth of the decoding time.
            let mut buffer = if spare.len() == bytes / 2 { spare } else { zeroed::<u16>(bytes / 2)? };
            decoder.read_image(bytemuck::cast_slice_mut(&mut buffer))?;
            Samples::U16(keep_channels(buffer, stored, info.channels))
        }
    };
    info.raster(samples)
}

/// Decoder, header information, and number of stored channels.
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
        other => return Err(Fault::unusable(format!("is a PNG of kind {other:?}"), SAME_DEPTH)),
    };
    let (width, height) = decoder.dimensions();
    let per_pixel = u64::from(color.bytes_per_pixel());
    let info = Info::checked([width.into(), height.into()], channels, depth, 1, per_pixel)?;
    Ok((decoder, info, usize::from(color.channel_count())))
}

/// Largest colour profile, compressed or not, and largest block of tags, in bytes.
const MAX_PROFILE: u64 = 16 << 20;

/// Transfer characteristics in cICP (ITU-T H.273).
const CICP_LINEAR: u8 = 8;
const CICP_SRGB: u8 = 13;

/// Adds the statements of chunks before the pixels. For the transfer curve, the first of cICP, iCCP, sRGB and gAMA
/// applies (PNG, third edition, 4.3).
pub(super) fn describe(source: &mut Source, details: &mut Details) -> Decoded<()> {
    source.seek(SeekFrom::Start(8))?;
    let mut stated: [Option<Encoding>; 4] = [const { None }; 4];
    let say = |curve, source: &str| Some(Encoding { curve, source: source.into() });
    loop {
        let mut head = [0; 8];
        match source.read_exact(&mut head) {
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Err(Fault::damaged("no picture data")),
            other => other?,
        }
        let [l0, l1, l2, l3, kind @ ..] = head;
        let length = u64::from(u32::from_be_bytes([l0, l1, l2, l3]));
        let limit = if [*b"iCCP", *b"eXIf"].contains(&kind) { MAX_PROFILE } else { 16 };
        let content = part(source, length, limit)?.unwrap_or_default();
        match (&kind, content.as_slice()) {
            (b"IDAT" | b"IEND", _) => break,
            (b"cICP", [_, transfer, ..]) => {
                let curve = match *transfer {
                    CICP_LINEAR => Curve::Linear,
                    CICP_SRGB => Curve::Srgb,
                    _ => Curve::Other,
                };
                stated[0] = say(curve, &format!("cICP, transfer {transfer}"));
            }
            (b"eXIf", tags) => details.orientation = exif::orientation_in(tags.to_vec()).unwrap_or(1),
            (b"iCCP", chunk) => stated[1] = profile(chunk).and_then(|p| encoding(&p)),
            (b"sRGB", _) => stated[2] = say(Curve::Srgb, "sRGB chunk"),
            (b"gAMA", &[a, b, c, d]) => {
                let exponent = f64::from(u32::from_be_bytes([a, b, c, d])) / 1e5;
                stated[3] = say(Curve::of_exponent(exponent), &format!("gAMA {exponent}"));
            }
            (b"acTL", &[a, b, c, d, ..]) if u32::from_be_bytes([a, b, c, d]) > 1 => {
                let frames = u32::from_be_bytes([a, b, c, d]);
                details.notes.push(format!("is an animation of {frames} frames, of which the first is read"));
            }
            _ => {}
        }
        // The checksum.
        source.seek(SeekFrom::Current(4))?;
    }
    details.encoding = stated.into_iter().flatten().next();
    Ok(())
}

/// Profile in an iCCP chunk, which holds name, zero byte, method, and deflated bytes.
fn profile(chunk: &[u8]) -> Option<Vec<u8>> {
    let name = chunk.iter().position(|b| *b == 0)?;
    let mut profile = Vec::new();
    flate2::read::ZlibDecoder::new(chunk.get(name + 2..)?).take(MAX_PROFILE).read_to_end(&mut profile).ok()?;
    Some(profile)
}

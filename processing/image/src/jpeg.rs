//! JPEG files: 8 bits, grey or RGB.
//!
//! The decoder fills truncated images with grey, so the segments are parsed here first. An image is complete if it has
//! its end marker (that of an embedded thumbnail does not count), or if it does not depend on bytes after its data.

use std::io::{BufRead, ErrorKind, Read, Seek, SeekFrom};

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use super::fault::{Decoded, Fault, SAME_DEPTH};
use super::raster::{Depth, Info, MAX_PIXELS, MAX_SIDE, Raster, Samples, zeroed};
use super::source::Source;

const START_OF_SCAN: u8 = 0xda;
const END_OF_IMAGE: u8 = 0xd9;
const HUFFMAN_TABLES: u8 = 0xc4;
/// Frames with arithmetic coding, which have no Huffman tables.
const ARITHMETIC: [u8; 4] = [0xc9, 0xca, 0xcb, 0xcd];

/// Frames of JPEG-LS (ITU-T T.87).
const JPEG_LS: u8 = 0xf7;

/// Progressive frames, whose scans refine the image.
const PROGRESSIVE: [u8; 4] = [0xc2, 0xc6, 0xca, 0xce];
const NO_END: &str = "no end of image marker";

/// Motion JPEG marker, placed after the start marker of files without Huffman tables. The decoder then uses the tables
/// of ITU-T T.81, K.3.
const MOTION_JPEG: [u8; 18] = *b"\xff\xe0\x00\x10AVI1\0\0\0\0\0\0\0\0\0\0";

/// Missing parts of a JPEG without which it can be decoded.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Missing {
    /// End marker.
    pub end: bool,
    /// Huffman tables.
    pub tables: bool,
}

pub(super) fn info(mut source: Source) -> Decoded<Info> {
    header(&mut source)
}

/// Finds missing parts.
pub(super) fn missing(source: &mut Source) -> Decoded<Missing> {
    header(source)?;
    source.seek(SeekFrom::Start(2))?;
    let (mut scans, mut tables, mut progressive) = (0, false, false);
    let end = loop {
        match next_marker(source) {
            Ok(END_OF_IMAGE) => break true,
            Ok(marker) => {
                scans += usize::from(marker == START_OF_SCAN);
                progressive |= PROGRESSIVE.contains(&marker);
                tables |= scans == 0 && (marker == HUFFMAN_TABLES || ARITHMETIC.contains(&marker));
                segment(source)?;
            }
            // The last of several scans may be missing altogether.
            Err(_) if scans == 1 && !progressive => break false,
            Err(fault) => return Err(fault),
        }
    };
    if scans == 0 {
        return Err(Fault::damaged("no picture data before the end marker"));
    }
    Ok(Missing { end: !end, tables: !tables })
}

/// Bytes appended to files without an end marker. An image that depends on them is truncated.
const TAILS: [&[u8]; 2] = [b"\xff\xd9", b"\x3a\xc5\x96\x0f\x71\xe8\x4d\xb2\x1b\x64\xa9\x53\xff\xd9"];

pub(super) fn read(mut source: Source) -> Decoded<Raster> {
    let info = header(&mut source)?;
    let missing = missing(&mut source)?;
    source.seek(SeekFrom::Start(0))?;
    let mut file = Vec::new();
    if missing.tables {
        file.extend([0xff, 0xd8]);
        file.extend(MOTION_JPEG);
        source.seek(SeekFrom::Start(2))?;
    }
    source.read_to_end(&mut file)?;
    if !missing.end {
        return info.raster(Samples::U8(pixels(&file, info)?));
    }
    let length = file.len();
    let mut with = |tail: &[u8]| {
        file.truncate(length);
        file.extend(tail);
        pixels(&file, info)
    };
    let [whole, other] = TAILS.map(&mut with);
    let whole = whole?;
    if other.is_ok_and(|other| other == whole) {
        return info.raster(Samples::U8(whole));
    }
    Err(Fault::damaged(NO_END))
}

/// Decodes the bytes of a file.
fn pixels(file: &[u8], info: Info) -> Decoded<Vec<u8>> {
    let color = if info.channels == 1 { ColorSpace::Luma } else { ColorSpace::RGB };
    let mut decoder = decoder(file, color);
    decoder.decode_headers().map_err(Fault::damaged)?;
    if decoder.output_buffer_size() != Some(info.len()) {
        return Err(Fault::damaged("the decoder and the header disagree about the size"));
    }
    let mut samples = zeroed(info.len())?;
    decoder.decode_into(&mut samples).map_err(Fault::damaged)?;
    Ok(samples)
}

/// Decodes a strip or tile of a TIFF with `columns` columns and `least` to `most` rows. `ycc` selects conversion of
/// three channels from YCbCr to RGB.
pub(super) fn chunk(file: &[u8], [columns, least, most]: [usize; 3], channels: usize, ycc: bool) -> Decoded<Vec<u8>> {
    let color = match (channels, ycc) {
        (1, _) => ColorSpace::Luma,
        (_, true) => ColorSpace::RGB,
        // Without an Adobe marker the decoder assumes YCbCr; this output does not convert.
        (_, false) => ColorSpace::YCbCr,
    };
    let mut decoder = decoder(file, color);
    decoder.decode_headers().map_err(Fault::damaged)?;
    let size = decoder.dimensions().filter(|(width, height)| *width == columns && (least..=most).contains(height));
    let bytes = size.map(|(width, height)| width * height * channels).filter(|n| *n <= channels * MAX_PIXELS);
    if bytes.is_none() || decoder.output_buffer_size() != bytes {
        return Err(Fault::damaged("a strip or tile holds a JPEG of another size"));
    }
    let mut samples = zeroed(bytes.unwrap_or(0))?;
    decoder.decode_into(&mut samples).map_err(Fault::damaged)?;
    Ok(samples)
}

fn decoder(file: &[u8], color: ColorSpace) -> JpegDecoder<ZCursor<&[u8]>> {
    let options = DecoderOptions::default()
        .set_strict_mode(false)
        .set_max_width(MAX_SIDE)
        .set_max_height(MAX_SIDE)
        .jpeg_set_out_colorspace(color);
    JpegDecoder::new_with_options(ZCursor::new(file), options)
}

/// Reads up to and including the frame header.
fn header(source: &mut Source) -> Decoded<Info> {
    source.seek(SeekFrom::Start(2))?;
    loop {
        let marker = next_marker(source)?;
        match marker {
            HUFFMAN_TABLES | 0xc8 | 0xcc => _ = segment(source)?,
            0xc0..=0xcf | JPEG_LS => {
                let frame = frame(&segment(source)?);
                return coding(marker).map_or(frame, |coding| {
                    let problem = format!("is a JPEG with {coding}, which is not read");
                    Err(Fault::unusable(problem, SAME_DEPTH))
                });
            }
            START_OF_SCAN | END_OF_IMAGE => return Err(Fault::damaged("no frame header before the picture data")),
            _ => _ = segment(source)?,
        }
    }
}

/// Name of an unsupported coding by the marker of its frame (ITU-T T.81, table B.1). `None` for supported frames:
/// baseline, extended and progressive with Huffman coding.
fn coding(marker: u8) -> Option<&'static str> {
    match marker {
        0xc0..=0xc2 => None,
        0xc3 | 0xcb => Some("lossless coding"),
        0xc5..=0xc7 | 0xcd..=0xcf => Some("hierarchical coding"),
        JPEG_LS => Some("JPEG-LS coding"),
        _ => Some("arithmetic coding"),
    }
}

fn frame(segment: &[u8]) -> Decoded<Info> {
    let &[bits, h1, h0, w1, w0, components, ..] = segment else {
        return Err(Fault::damaged("the frame header is too short"));
    };
    let refuse = |kind: String| Err(Fault::unusable(format!("is a JPEG of {kind}, which is not read"), SAME_DEPTH));
    if bits != 8 {
        return refuse(format!("{bits} bits per sample"));
    }
    match components {
        1 | 3 => {}
        4 => return refuse("four components (CMYK)".into()),
        n => return refuse(format!("{n} components")),
    }
    let size = [u16::from_be_bytes([w1, w0]).into(), u16::from_be_bytes([h1, h0]).into()];
    Info::checked(size, components.into(), Depth::U8, components.into(), 1)
}

/// Finds the next marker other than a restart, and skips entropy-coded data.
fn next_marker(source: &mut Source) -> Decoded<u8> {
    loop {
        source.skip_until(0xff)?;
        let mut byte = 0xff;
        while byte == 0xff {
            byte = read_byte(source)?;
        }
        if !matches!(byte, 0 | 1 | 0xd0..=0xd8) {
            return Ok(byte);
        }
    }
}

fn read_byte(source: &mut Source) -> Decoded<u8> {
    let mut byte = [0];
    match source.read_exact(&mut byte) {
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => Err(Fault::damaged(NO_END)),
        other => Ok(other.map(|()| byte[0])?),
    }
}

/// Content of the segment whose marker was just read (at most 64 KiB).
fn segment(source: &mut Source) -> Decoded<Vec<u8>> {
    let length = u16::from_be_bytes([read_byte(source)?, read_byte(source)?]);
    let mut content = vec![0; usize::from(length.saturating_sub(2))];
    source.read_exact(&mut content)?;
    Ok(content)
}

/// Largest ICC profile in bytes; 255 segments hold 16 MiB.
const MAX_PROFILE: usize = 16 << 20;

/// ICC profile, assembled from its segments.
pub(super) fn profile(source: &mut Source) -> Decoded<Option<Vec<u8>>> {
    source.seek(SeekFrom::Start(2))?;
    let mut profile = Vec::new();
    loop {
        match next_marker(source)? {
            START_OF_SCAN | END_OF_IMAGE => break,
            0xe2 => {
                let content = segment(source)?;
                // After the name: number of the segment, and number of segments.
                if let Some(part) = content.strip_prefix(b"ICC_PROFILE\0").and_then(|rest| rest.get(2..))
                    && profile.len() + part.len() <= MAX_PROFILE
                {
                    profile.extend(part);
                }
            }
            _ => _ = segment(source)?,
        }
    }
    Ok(Some(profile).filter(|p| !p.is_empty()))
}

//! JPEG: 8 bits, grey or RGB.
//!
//! The decoder fills what a truncated file lacks with grey, so the segments are walked here first: a picture
//! counts as whole only when its end marker is there (the one of an embedded thumbnail does not count).

use std::io::{BufRead, ErrorKind, Read, Seek, SeekFrom};

use ::image::ImageDecoder;
use ::image::codecs::jpeg::JpegDecoder;

use super::fault::{Decoded, Fault};
use super::raster::{Depth, Info, Raster, Samples, zeroed};
use super::source::Source;

const END_OF_IMAGE: u8 = 0xd9;

pub(super) fn info(mut source: Source) -> Decoded<Info> {
    header(&mut source)
}

pub(super) fn read(mut source: Source) -> Decoded<Raster> {
    let info = header(&mut source)?;
    let mut scans = 0;
    loop {
        match next_marker(&mut source)? {
            END_OF_IMAGE => break,
            marker => {
                scans += usize::from(marker == 0xda);
                segment(&mut source)?;
            }
        }
    }
    if scans == 0 {
        return Err(Fault::damaged("no picture data before the end marker"));
    }
    source.seek(SeekFrom::Start(0))?;
    let decoder = JpegDecoder::new(source)?;
    if decoder.total_bytes() != info.len() as u64 {
        return Err(Fault::damaged("the decoder and the header disagree about the size"));
    }
    let mut samples = zeroed(info.len())?;
    decoder.read_image(&mut samples)?;
    info.raster(Samples::U8(samples))
}

/// Reads up to and including the frame header.
fn header(source: &mut Source) -> Decoded<Info> {
    source.seek(SeekFrom::Start(2))?;
    loop {
        let marker = next_marker(source)?;
        match marker {
            0xc4 | 0xc8 | 0xcc => _ = segment(source)?,
            0xc0..=0xcf => return frame(&segment(source)?),
            0xda | END_OF_IMAGE => return Err(Fault::damaged("no frame header before the picture data")),
            _ => _ = segment(source)?,
        }
    }
}

fn frame(segment: &[u8]) -> Decoded<Info> {
    let &[bits, h1, h0, w1, w0, components, ..] = segment else {
        return Err(Fault::damaged("the frame header is too short"));
    };
    if bits != 8 {
        return Err(Fault::unsupported(format!("is a JPEG of {bits} bits per sample")));
    }
    if components != 1 && components != 3 {
        return Err(Fault::unsupported(format!("is a JPEG of {components} components (CMYK?)")));
    }
    let size = [u16::from_be_bytes([w1, w0]).into(), u16::from_be_bytes([h1, h0]).into()];
    Info::checked(size, components.into(), Depth::U8, components.into(), 1)
}

/// The next marker other than a restart; skips entropy-coded data.
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
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => Err(Fault::damaged("no end of image marker")),
        other => Ok(other.map(|()| byte[0])?),
    }
}

/// The content of the segment whose marker was just read (at most 64 KiB).
fn segment(source: &mut Source) -> Decoded<Vec<u8>> {
    let length = u16::from_be_bytes([read_byte(source)?, read_byte(source)?]);
    let mut content = vec![0; usize::from(length.saturating_sub(2))];
    source.read_exact(&mut content)?;
    Ok(content)
}

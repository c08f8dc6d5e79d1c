//! Check of the sizes in a raw file before decoding. The decoder trusts them, and a failed allocation would end the
//! program.

use std::io::{Read, Seek, SeekFrom};

use crate::fault::{Decoded, Fault};
use crate::raster::MAX_PIXELS;
use crate::source::Source;

use super::boxes;
use super::recognise::{Kind, Layout, PANASONIC};
use super::tags::{
    Entry, HEIGHT, SAMPLES_PER_PIXEL, STRIP_COUNTS, STRIP_OFFSETS, TILE_COUNTS, TILE_HEIGHT, TILE_OFFSETS, TILE_WIDTH,
    Tags, WIDTH,
};

/// Largest raw file in bytes; it is read whole (the largest cameras write 300 MiB).
pub(super) const MAX_FILE: u64 = 1 << 30;
/// Largest number of samples of a mosaic: two per pixel of the largest picture.
pub(super) const MAX_SAMPLES: u64 = 2 * MAX_PIXELS as u64;
/// Bytes that a tag may claim regardless of the file's size. Maker notes contain tags that claim more than exists.
pub(super) const HARMLESS: u64 = 64 << 20;
/// Largest number of strips or tiles that are checked.
const MOST_PIECES: u32 = 65_536;
/// Tags of width and height: standard, Fujifilm, Panasonic.
pub(super) const SIDES: [[u16; 2]; 2] = [[WIDTH, HEIGHT], [0xf001, 0xf002]];
const PANASONIC_SIDES: [[u16; 2]; 2] = [[WIDTH, HEIGHT], [2, 3]];

/// Refuses a file with sizes beyond the limits.
pub(super) fn check(source: &mut Source, kind: Kind) -> Decoded<()> {
    let length = source.get_ref().metadata()?.len();
    if length > MAX_FILE {
        return Err(Fault::too_large(format!(
            "is larger than {} MiB, too large for a camera raw file",
            MAX_FILE >> 20
        )));
    }
    match kind.layout {
        Layout::Tiff if kind.name == PANASONIC => tiff(source, 0, length, PANASONIC_SIDES)?,
        Layout::Dng | Layout::Tiff => tiff(source, 0, length, SIDES)?,
        Layout::Fujifilm => fujifilm(source, length)?,
        Layout::Boxes => boxes::check(source, length)?,
        Layout::Other => {}
    }
    source.seek(SeekFrom::Start(0))?;
    Ok(())
}

/// Checks all directories of a TIFF header.
pub(super) fn tiff(source: &mut Source, base: u64, length: u64, sides: [[u16; 2]; 2]) -> Decoded<()> {
    let mut tags = Tags::read(source, base, true);
    if tags.endless {
        return Err(Fault::damaged("its directories of tags are a loop"));
    }
    let mut all = tags.directories.iter().chain(&tags.makers).flatten();
    if let Some(entry) = all.find(|e| e.bytes() > length.max(HARMLESS)) {
        return Err(Fault::damaged(format!("tag {} claims {} bytes", entry.tag, entry.bytes())));
    }
    for directory in 0..tags.directories.len() {
        let mut side = |tag| tags.first(directory, tag).map(u64::from);
        let planes = side(SAMPLES_PER_PIXEL).unwrap_or(1).max(1);
        let tile = [side(TILE_WIDTH), side(TILE_HEIGHT)].map(|s| s.unwrap_or(1).max(1));
        for [width, height] in sides {
            let (Some(width), Some(height)) = (side(width), side(height)) else { continue };
            samples([width.next_multiple_of(tile[0]), height.next_multiple_of(tile[1]), planes])?;
        }
        for [offsets, counts] in [[STRIP_OFFSETS, STRIP_COUNTS], [TILE_OFFSETS, TILE_COUNTS], [0xf007, 0xf008]] {
            let Some(entry) = tags.find(directory, offsets) else { continue };
            if let Some(counts) = tags.find(directory, counts) {
                within(&mut tags, [entry, counts], base, length)?;
            }
            lossless_jpegs(&mut tags, entry)?;
        }
    }
    Ok(())
}

/// Checks that the pixels end before the file does; decoders would fill missing ones.
fn within(tags: &mut Tags<'_>, [offsets, counts]: [Entry; 2], base: u64, length: u64) -> Decoded<()> {
    for index in 0..offsets.count.min(MOST_PIECES) {
        let (Some(start), Some(count)) = (tags.number(offsets, index), tags.number(counts, index)) else { continue };
        let end = base + u64::from(start) + u64::from(count);
        // The largest offset means none.
        if start != u32::MAX && end > length {
            return Err(Fault::damaged(format!("the pixels end at byte {end}, the file at {length}")));
        }
    }
    Ok(())
}

/// Checks the headers of lossless JPEG data, whose sizes the decoder trusts.
fn lossless_jpegs(tags: &mut Tags<'_>, offsets: Entry) -> Decoded<()> {
    for index in 0..offsets.count.min(MOST_PIECES) {
        let Some(start) = tags.number(offsets, index).map(u64::from) else { continue };
        if tags.bytes_at(start) != Some([0xff, 0xd8]) {
            continue;
        }
        let mut at = start + 2;
        while let Some([0xff, marker, high, low]) = tags.bytes_at(at) {
            if let 0xc3 = marker
                && let Some([_, h1, h0, w1, w0, planes]) = tags.bytes_at(at + 4)
            {
                let [width, height] = [[w1, w0], [h1, h0]].map(|side| u16::from_be_bytes(side).into());
                samples([width, height, planes.into()])?;
            }
            if matches!(marker, 0xc3 | 0xda) {
                break;
            }
            at += 2 + u64::from(u16::from_be_bytes([high, low]));
        }
    }
    Ok(())
}

/// Checks the Exif tags of the embedded JPEG, the directory of the mosaic, and the sizes in Fujifilm's table.
fn fujifilm(source: &mut Source, length: u64) -> Decoded<()> {
    let mut header = [0; 28];
    source.seek(SeekFrom::Start(84))?;
    source.read_exact(&mut header)?;
    let word = |at: usize| u64::from(u32::from_be_bytes([header[at], header[at + 1], header[at + 2], header[at + 3]]));
    let [jpeg, table, mosaic] = [word(0), word(8), word(16)];
    tiff(source, jpeg + 12, length, SIDES)?;
    tiff(source, mosaic, length, SIDES)?;
    let mut at = table + 4;
    let mut record = [0; 8];
    for _ in 0..4000 {
        source.seek(SeekFrom::Start(at))?;
        if source.read_exact(&mut record).is_err() {
            break;
        }
        let [tag, size, first, second] = [0, 2, 4, 6].map(|i| u16::from_be_bytes([record[i], record[i + 1]]));
        if tag == 0x100 {
            samples([first.into(), second.into(), 1])?;
        }
        at += 4 + u64::from(size);
    }
    Ok(())
}

pub(super) fn samples(sides: [u64; 3]) -> Decoded<()> {
    let [width, height, planes] = sides;
    if width.saturating_mul(height).saturating_mul(planes) > MAX_SAMPLES {
        let limit = MAX_SAMPLES >> 20;
        return Err(Fault::too_large(format!(
            "is {width} x {height} pixels, more than the {limit} Mpixel of a camera raw file"
        )));
    }
    Ok(())
}

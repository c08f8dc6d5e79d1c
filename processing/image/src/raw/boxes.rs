//! Check of the boxes of a CR3 file before decoding, because the decoder trusts their sizes and counts.

use std::io::{Read, Seek, SeekFrom};

use crate::fault::{Decoded, Fault};
use crate::source::Source;

use super::limits::{HARMLESS, SIDES, samples, tiff};

/// Largest number of boxes of a file, and deepest nesting.
const BOXES: usize = 4096;
const DEPTH: usize = 16;
/// Identifier of the box that holds Canon's boxes.
const CANON: [u8; 16] =
    [0x85, 0xc0, 0xb6, 0x87, 0x82, 0x0f, 0x11, 0xe0, 0x81, 0x11, 0xf4, 0xce, 0x46, 0x2b, 0x6a, 0x48];

/// Box: its name, its first byte after the header, and its end.
struct Boxed {
    name: [u8; 4],
    body: u64,
    end: u64,
}

/// Refuses a file with boxes that exceed the enclosing box or the size limits.
pub(super) fn check(source: &mut Source, length: u64) -> Decoded<()> {
    let mut pending = vec![(0, length, 0)];
    let mut count = 0;
    while let Some((mut at, end, depth)) = pending.pop() {
        while at < end {
            let found = header(source, at, end)?;
            count += 1;
            if count > BOXES || depth > DEPTH {
                return Err(Fault::damaged("more boxes than a camera writes"));
            }
            if let Some(skipped) = content(source, &found, length)? {
                pending.push((found.body + skipped, found.end, depth + 1));
            }
            at = found.end;
        }
    }
    Ok(())
}

/// Header of the box at an offset within a box that ends at `end`.
fn header(source: &mut Source, at: u64, end: u64) -> Decoded<Boxed> {
    let [size, name] = bytes::<8>(source, at).map(|b| [[b[0], b[1], b[2], b[3]], [b[4], b[5], b[6], b[7]]])?;
    let (size, head) = match u32::from_be_bytes(size) {
        1 => (u64::from_be_bytes(bytes(source, at + 8)?), 16),
        size => (size.into(), 8),
    };
    if size < head || size > end.saturating_sub(at) {
        let name = String::from_utf8_lossy(&name).into_owned();
        return Err(Fault::damaged(format!("its box {name} of {size} bytes is not within the one around it")));
    }
    Ok(Boxed { name, body: at + head, end: at + size })
}

/// Checks a box. For a box of boxes, returns the number of bytes before the first one.
fn content(source: &mut Source, found: &Boxed, length: u64) -> Decoded<Option<u64>> {
    let word =
        |source: &mut Source, skip: u64| bytes(source, found.body + skip).map(|b| u64::from(u32::from_be_bytes(b)));
    match &found.name {
        b"moov" | b"trak" | b"mdia" | b"minf" | b"stbl" | b"dinf" => return Ok(Some(0)),
        b"uuid" if bytes::<16>(source, found.body)? == CANON => return Ok(Some(16)),
        b"stsd" => return Ok(Some(8)),
        b"CRAW" => return Ok(Some(82)),
        b"CCTP" => return Ok(Some(12)),
        b"CDI1" => return Ok(Some(4)),
        b"CMP1" => {
            samples([word(source, 8)?, word(source, 12)?, 1])?;
            samples([word(source, 16)?, word(source, 20)?, 1])?;
        }
        b"stsz" => values(word(source, 8)?, length)?,
        b"stsc" | b"stts" | b"co64" | b"stco" => values(word(source, 4)?, length)?,
        b"CTMD" => values(word(source, 8)?, length)?,
        b"CMT1" | b"CMT2" | b"CMT3" | b"CMT4" => tiff(source, found.body, length, SIDES)?,
        _ => {}
    }
    Ok(None)
}

fn values(count: u64, length: u64) -> Decoded<()> {
    if count > length.min(HARMLESS) {
        return Err(Fault::damaged(format!("a box claims {count} values")));
    }
    Ok(())
}

fn bytes<const N: usize>(source: &mut Source, at: u64) -> Decoded<[u8; N]> {
    let mut bytes = [0; N];
    source.seek(SeekFrom::Start(at))?;
    source.read_exact(&mut bytes)?;
    Ok(bytes)
}

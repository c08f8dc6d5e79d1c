//! Writer of ZIP-compressed OpenEXR files, for pictures and exported maps.
//!
//! Like [`write_exr`](crate::write_exr), it keeps the order of attributes, so that equal maps give equal bytes. The
//! `exr` crate does not.

use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::Path;

use flate2::Compression as Level;
use flate2::write::ZlibEncoder;
use rayon::prelude::*;

use super::write::{Attribute, Compression, Precision, exr_header, in_order};
use nacre_base::{Error, Result};

/// Rows of a block of ZIP compression ("OpenEXR File Layout").
const ROWS: usize = 16;

/// Level of deflate, as OpenEXR's default: higher ones gain little on floats.
const LEVEL: u32 = 4;

/// Blocks that are compressed at once.
const BATCH: usize = 16;

/// Writes `f32` planes as a scan-line EXR with ZIP compression, which preserves NaN and infinities. Arguments as those
/// of [`write_exr`](crate::write_exr).
///
/// # Errors
/// As [`write_exr`](crate::write_exr).
pub fn write_exr_zip(
    path: &Path,
    [width, height]: [usize; 2],
    channels: &[&str],
    attributes: &[(&str, Attribute)],
    fill: &(dyn Fn(usize, usize, &mut [f32]) + Sync),
) -> Result<()> {
    let write = || {
        let (order, sorted) = in_order(channels);
        let header = exr_header(Precision::Float, Compression::Zip, [width, height], &sorted, attributes)?;
        let mut file = File::create(path)?;
        file.write_all(&header)?;
        let blocks = height.div_ceil(ROWS);
        let mut offsets = Vec::with_capacity(blocks);
        let mut at = header.len() + 8 * blocks;
        file.write_all(&vec![0; 8 * blocks])?;
        for first in (0..blocks).step_by(BATCH) {
            let batch = first..(first + BATCH).min(blocks);
            let encoded: Vec<Vec<u8>> = batch
                .into_par_iter()
                .map(|block| block_bytes(block * ROWS..((block + 1) * ROWS).min(height), width, &order, fill))
                .collect::<io::Result<_>>()?;
            for bytes in encoded {
                offsets.extend((at as u64).to_le_bytes());
                at += bytes.len();
                file.write_all(&bytes)?;
            }
        }
        file.seek(SeekFrom::Start(header.len() as u64))?;
        file.write_all(&offsets)
    };
    write().map_err(|error| Error::output(path, error))
}

/// A block: number of its first row, number of bytes, and the compressed rows. Rows that compression does not shorten
/// are stored as they are.
fn block_bytes(
    rows: std::ops::Range<usize>,
    width: usize,
    order: &[usize],
    fill: &(dyn Fn(usize, usize, &mut [f32]) + Sync),
) -> io::Result<Vec<u8>> {
    let mut plain = Vec::with_capacity(rows.len() * order.len() * width * 4);
    let mut values = vec![0.0; width];
    for row in rows.clone() {
        for &channel in order {
            fill(channel, row, &mut values);
            plain.extend(values.iter().flat_map(|v| v.to_le_bytes()));
        }
    }
    let mut encoder = ZlibEncoder::new(vec![], Level::new(LEVEL));
    encoder.write_all(&predicted(&plain))?;
    let packed = encoder.finish()?;
    let data = if packed.len() < plain.len() { packed } else { plain };
    let mut bytes = (rows.start as u32).to_le_bytes().to_vec();
    bytes.extend((data.len() as u32).to_le_bytes());
    bytes.extend(data);
    Ok(bytes)
}

/// Even bytes, then odd bytes, each as the difference from the byte before it plus 128.
fn predicted(plain: &[u8]) -> Vec<u8> {
    let mut bytes: Vec<u8> = plain.iter().step_by(2).chain(plain.iter().skip(1).step_by(2)).copied().collect();
    for k in (1..bytes.len()).rev() {
        bytes[k] = bytes[k].wrapping_sub(bytes[k - 1]).wrapping_add(128);
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::read_exr;

    #[test]
    fn compressed_maps_are_read_by_the_exr_crate() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("map.exr");
        let value = |c: usize, x: usize, y: usize| {
            if (x, y) == (3, 20) { f32::NAN } else { (x as f32 * 0.37).sin() + y as f32 * 1e-3 + c as f32 }
        };
        let attributes = [("unit", Attribute::Text("rad".into())), ("chromaticities", Attribute::SRGB)];
        // The last block has fewer rows; the second channel comes first in the file.
        write_exr_zip(&path, [61, 37], &["sigma", "orientation"], &attributes, &|c, y, row| {
            row.iter_mut().enumerate().for_each(|(x, v)| *v = value(c, x, y));
        })
        .unwrap();
        let map = read_exr(&path).unwrap();
        assert_eq!((map.width, map.height, map.attributes["unit"].as_str()), (61, 37, "rad"));
        for (c, name) in ["sigma", "orientation"].into_iter().enumerate() {
            for (k, found) in map.channels[name].iter().enumerate() {
                assert_eq!(found.to_bits(), value(c, k % 61, k / 61).to_bits());
            }
        }
    }
}

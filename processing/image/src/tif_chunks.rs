//! Values of TIFF files by strip or tile and by row: any number of bits, interleaved or with one plane per channel.
//!
//! Predictors are those of TIFF 6 (section 14) and Technical Note 3 (floating point).

use std::io::{BufRead, Cursor, Read, Seek, SeekFrom};

use flate2::bufread::ZlibDecoder;
use half::f16;
use tiff::decoder::{ChunkType, Decoder};
use tiff::tags::{ByteOrder, Tag};

use super::fault::{Decoded, Fault};
use super::jpeg;
use super::raster::{Info, MAX_SIDE, Samples, zeroed};
use super::source::Source;
use super::tif::{Sample, fault};
use super::tif_codecs::{Lzw, PackBits};

/// Values of the tag Predictor.
const HORIZONTAL: u32 = 2;
const FLOATING_POINT: u32 = 3;

/// Longest row of a strip or tile in bytes: four doubles per column, for tiles that extend beyond the picture.
const MAX_ROW: usize = 2 * MAX_SIDE * 4 * 8;

/// Division of a page into strips or tiles ("chunks").
pub(super) struct Layout {
    info: Info,
    /// Columns and rows of a chunk; the last strip may have fewer rows.
    chunk: [usize; 2],
    tiled: bool,
    /// Channels per chunk; 1 if each channel has separate chunks.
    channels: usize,
    planes: usize,
    /// Position and length of each chunk in the file.
    places: Vec<[u64; 2]>,
    sample: Sample,
    compression: u32,
    /// Whether JPEG data hold luminance and colour differences (YCbCr).
    ycc: bool,
    tables: Vec<u8>,
    predictor: u32,
    /// Whether 0 is white.
    inverted: bool,
    big_endian: bool,
}

impl Layout {
    /// Layout of the decoder's current page, which has `stored` channels.
    pub fn of(decoder: &mut Decoder<Source>, info: Info, stored: usize, sample: Sample) -> Decoded<Self> {
        let tag = |decoder: &mut Decoder<Source>, tag| decoder.find_tag_unsigned::<u32>(tag).map_err(fault);
        let number = |decoder: &mut Decoder<Source>, of, default| Ok::<_, Fault>(tag(decoder, of)?.unwrap_or(default));
        let tiled = decoder.get_chunk_type() == ChunkType::Tile;
        let height = info.height as u32;
        let (chunk, offsets, lengths) = if tiled {
            let chunk = [number(decoder, Tag::TileWidth, 0)?, number(decoder, Tag::TileLength, 0)?];
            (chunk, Tag::TileOffsets, Tag::TileByteCounts)
        } else {
            let rows = number(decoder, Tag::RowsPerStrip, height)?.clamp(1, height);
            ([info.width as u32, rows], Tag::StripOffsets, Tag::StripByteCounts)
        };
        if chunk.contains(&0) {
            return Err(Fault::damaged("its tiles have no size"));
        }
        let separate = stored > 1 && number(decoder, Tag::PlanarConfiguration, 1)? == 2;
        let offsets = decoder.get_tag_u64_vec(offsets).map_err(fault)?;
        let lengths = decoder.get_tag_u64_vec(lengths).map_err(fault)?;
        let photometric = number(decoder, Tag::PhotometricInterpretation, 1)?;
        let tables = decoder.find_tag(Tag::JPEGTables).map_err(fault)?;
        let layout = Self {
            info,
            chunk: chunk.map(|n| n as usize),
            tiled,
            channels: if separate { 1 } else { stored },
            planes: if separate { stored } else { 1 },
            places: offsets.into_iter().zip(lengths).map(|(offset, length)| [offset, length]).collect(),
            sample,
            compression: number(decoder, Tag::Compression, 1)?,
            ycc: photometric == 6,
            tables: tables.and_then(|t| t.into_u8_vec().ok()).unwrap_or_default(),
            predictor: number(decoder, Tag::Predictor, 1)?,
            inverted: photometric == 0,
            big_endian: decoder.byte_order() == ByteOrder::BigEndian,
        };
        layout.check()?;
        Ok(layout)
    }

    fn check(&self) -> Decoded<()> {
        let needed = self.planes.saturating_mul(self.per_plane());
        if self.places.len() < needed {
            return Err(Fault::damaged(format!("{} strips or tiles of {needed}", self.places.len())));
        }
        if self.row_bytes() > MAX_ROW {
            return Err(Fault::damaged(format!("tiles of {} columns for {}", self.chunk[0], self.info.width)));
        }
        let known = match self.predictor {
            1 | HORIZONTAL => true,
            FLOATING_POINT => matches!(self.sample, Sample::Float(_)),
            _ => false,
        };
        if !known {
            return Err(Fault::damaged(format!("predictor {} with {} samples", self.predictor, self.sample)));
        }
        Ok(())
    }

    fn per_plane(&self) -> usize {
        self.info.width.div_ceil(self.chunk[0]) * self.info.height.div_ceil(self.chunk[1])
    }

    fn row_bytes(&self) -> usize {
        let bits = self.channels.saturating_mul(usize::from(self.sample.bits()));
        self.chunk[0].saturating_mul(bits).div_ceil(8)
    }

    /// Reads the channels that are kept.
    pub fn read(&self, source: &mut Source) -> Decoded<Samples> {
        let white = self.sample.largest();
        let level = |v: u64| if self.inverted { white - v } else { v };
        let light = |v: f32| if self.inverted { 1.0 - v } else { v };
        Ok(match self.sample {
            Sample::Unsigned(..=8) => Samples::U8(self.assembled(source, |v| level(v) as u8)?),
            Sample::Unsigned(_) => Samples::U16(self.assembled(source, |v| level(v) as u16)?),
            Sample::Float(16) => Samples::F32(self.assembled(source, |v| light(f16::from_bits(v as u16).to_f32()))?),
            Sample::Float(32) => Samples::F32(self.assembled(source, |v| light(f32::from_bits(v as u32)))?),
            Sample::Float(_) => Samples::F32(self.assembled(source, |v| light(f64::from_bits(v) as f32))?),
        })
    }

    /// Pixels of all chunks, with values converted from their bits by `convert`.
    fn assembled<T: Copy + Default>(&self, source: &mut Source, convert: impl Fn(u64) -> T) -> Decoded<Vec<T>> {
        let Info { width, height, channels: kept, .. } = self.info;
        let mut all = zeroed::<T>(self.info.len())?;
        let mut bytes = zeroed::<u8>(self.row_bytes())?;
        let mut values = vec![];
        let across = width.div_ceil(self.chunk[0]);
        let each = self.channels.min(kept);
        for index in 0..self.planes.min(kept) * self.per_plane() {
            let (plane, index_in_plane) = (index / self.per_plane(), index % self.per_plane());
            let left = index_in_plane % across * self.chunk[0];
            let top = index_in_plane / across * self.chunk[1];
            let columns = self.chunk[0].min(width - left);
            let mut chunk = self.chunk(source, index, self.chunk[1].min(height - top))?;
            for row in all.chunks_exact_mut(width * kept).skip(top).take(self.chunk[1]) {
                chunk.read_exact(&mut bytes)?;
                self.values(&mut bytes, &mut values);
                let pixels = row[left * kept..][..columns * kept].chunks_exact_mut(kept);
                for (pixel, values) in pixels.zip(values.chunks_exact(self.channels)) {
                    let into = pixel[plane..].iter_mut().zip(&values[..each]);
                    into.for_each(|(into, value)| *into = convert(*value));
                }
            }
        }
        Ok(all)
    }

    /// Decompressed bytes of a chunk, of which `rows` rows are needed.
    fn chunk<'a>(&self, source: &'a mut Source, index: usize, rows: usize) -> Decoded<Box<dyn Read + 'a>> {
        let [offset, length] = self.places[index];
        let needed = (rows * self.row_bytes()) as u64;
        // Some writers omit the length of uncompressed data.
        if self.compression == 1 && length > 0 && length < needed {
            return Err(Fault::damaged(format!("strip or tile {index} has {length} bytes of {needed}")));
        }
        source.seek(SeekFrom::Start(offset))?;
        let compressed = source.take(length);
        Ok(match self.compression {
            1 => Box::new(compressed.into_inner()),
            5 => Box::new(Lzw::new(compressed)),
            7 => Box::new(Cursor::new(self.jpeg(compressed, rows)?)),
            32_773 => Box::new(PackBits::new(compressed)),
            _ => Box::new(ZlibDecoder::new(compressed)),
        })
    }

    /// Decodes a JPEG chunk, whose tables may be in a tag (TIFF Technical Note 2).
    fn jpeg(&self, mut compressed: impl BufRead, rows: usize) -> Decoded<Vec<u8>> {
        let mut file = vec![];
        if let Some(tables) = self.tables.strip_suffix(b"\xff\xd9") {
            file.extend(tables);
            compressed.read_exact(&mut [0; 2])?;
        }
        compressed.read_to_end(&mut file)?;
        let most = if self.tiled { self.chunk[1] } else { rows };
        jpeg::chunk(&file, [self.chunk[0], rows, most], self.channels, self.ycc)
    }

    /// Values of a row of a chunk, as unsigned integers of their bits.
    fn values(&self, row: &mut [u8], values: &mut Vec<u64>) {
        let bits = self.sample.bits();
        values.clear();
        match bits {
            _ if self.predictor == FLOATING_POINT => shuffled(row, self.channels, usize::from(bits / 8), values),
            8 => values.extend(row.iter().map(|v| u64::from(*v))),
            16 | 32 | 64 => values.extend(row.chunks_exact(usize::from(bits / 8)).map(|bytes| {
                let add = |value: u64, byte: &u8| value << 8 | u64::from(*byte);
                if self.big_endian { bytes.iter().fold(0, add) } else { bytes.iter().rev().fold(0, add) }
            })),
            _ => unpack(row, self.chunk[0] * self.channels, bits, values),
        }
        if self.predictor == HORIZONTAL {
            for i in self.channels..values.len() {
                values[i] = values[i].wrapping_add(values[i - self.channels]) & self.sample.largest();
            }
        }
    }
}

/// Inverts the floating-point predictor: byte differences, with the most significant bytes of all values first.
fn shuffled(row: &mut [u8], channels: usize, size: usize, values: &mut Vec<u64>) {
    for i in channels..row.len() {
        row[i] = row[i].wrapping_add(row[i - channels]);
    }
    let count = row.len() / size;
    let value = |i: usize| (0..size).fold(0, |value, byte| value << 8 | u64::from(row[byte * count + i]));
    values.extend((0..count).map(value));
}

/// Unpacks consecutive values of `bits` bits, most significant bit first; rows begin at a byte (TIFF 6, section 8).
pub(super) fn unpack(row: &[u8], count: usize, bits: u8, values: &mut Vec<u64>) {
    let (mut waiting, mut ready, mut rest) = (0_u64, 0, row.iter());
    values.extend((0..count).map(|_| {
        while ready < bits {
            waiting = waiting << 8 | u64::from(rest.next().copied().unwrap_or(0));
            ready += 8;
        }
        ready -= bits;
        waiting >> ready & ((1 << bits) - 1)
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_any_width_are_unpacked() {
        let unpacked = |row: &[u8], count, bits| {
            let mut values = vec![];
            unpack(row, count, bits, &mut values);
            values
        };
        assert_eq!(unpacked(&[0x12, 0x34, 0x56], 2, 12), [0x123, 0x456]);
        assert_eq!(unpacked(&[0b1000_0000, 0b0111_1111, 0b1100_0000], 2, 10), [0x201, 0x3fc]);
        assert_eq!(unpacked(&[0b1010_0000], 3, 1), [1, 0, 1]);
    }

    #[test]
    fn floats_are_put_together_of_differences_of_bytes() {
        // 1.0 and 2.0 of one channel are 3f80 0000 and 4000 0000.
        let mut row = [0x3f, 1, 0x80 - 0x40, 0x80, 0, 0, 0, 0];
        let mut values = vec![];
        shuffled(&mut row, 1, 4, &mut values);
        assert_eq!(values.iter().map(|v| f32::from_bits(*v as u32)).collect::<Vec<_>>(), [1.0, 2.0]);
    }
}

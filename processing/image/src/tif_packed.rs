//! Samples of 9 to 15 bits of TIFF files, stored one after the other without regard to bytes; rows begin at a byte (TIFF 6, section 8).

use std::io::{Read, Seek, SeekFrom};

use tiff::decoder::{ChunkType, Decoder};
use tiff::tags::Tag;

use super::fault::{Decoded, Fault};
use super::raster::{Info, zeroed};
use super::source::Source;
use super::tif::fault;

/// Reads the values of all channels, pixel by pixel.
pub(super) fn read(decoder: &mut Decoder<Source>, info: Info, stored: usize, bits: u8) -> Decoded<Vec<u16>> {
    let tag = |decoder: &mut Decoder<Source>, tag| decoder.find_tag_unsigned::<u32>(tag).map_err(fault);
    let kind = format!("is a TIFF of {bits}-bit samples");
    let compressed = tag(decoder, Tag::Compression)?.unwrap_or(1) != 1;
    let planes = stored > 1 && tag(decoder, Tag::PlanarConfiguration)?.unwrap_or(1) != 1;
    // The older way round of bits within bytes.
    let reversed = tag(decoder, Tag::FillOrder)?.unwrap_or(1) != 1;
    for (unread, what) in [
        (compressed, "that is compressed"),
        (planes, "with its channels in separate planes"),
        (reversed, "with FillOrder 2"),
        (decoder.get_chunk_type() == ChunkType::Tile, "in tiles"),
    ] {
        if unread {
            return Err(Fault::unusable(
                format!("{kind} {what}, which is not read"),
                "save it with 16 bits per sample",
            ));
        }
    }
    let inverted = tag(decoder, Tag::PhotometricInterpretation)? == Some(0);
    let offsets = decoder.get_tag_u64_vec(Tag::StripOffsets).map_err(fault)?;
    let lengths = decoder.get_tag_u64_vec(Tag::StripByteCounts).map_err(fault)?;
    let rows = tag(decoder, Tag::RowsPerStrip)?.map_or(info.height, |rows| rows as usize).clamp(1, info.height);
    let values = info.width * stored;
    let row_bytes = (values * usize::from(bits)).div_ceil(8);
    if offsets.len().min(lengths.len()) < info.height.div_ceil(rows) {
        return Err(Fault::damaged(format!("{} strips of {rows} rows for {} rows", offsets.len(), info.height)));
    }
    let mut all = Vec::with_capacity(values * info.height);
    let mut strip = zeroed::<u8>(rows * row_bytes)?;
    for (k, (offset, length)) in offsets.iter().zip(&lengths).take(info.height.div_ceil(rows)).enumerate() {
        let here = rows.min(info.height - k * rows) * row_bytes;
        if *length < here as u64 {
            return Err(Fault::damaged(format!("strip {k} has {length} bytes of {here}")));
        }
        let file = decoder.inner();
        file.seek(SeekFrom::Start(*offset))?;
        file.read_exact(&mut strip[..here])?;
        all.extend(unpack(&strip[..here], row_bytes, values, bits)?);
    }
    if inverted {
        let white = (1_u16 << bits) - 1;
        all.iter_mut().for_each(|v| *v = white - *v);
    }
    Ok(all)
}

/// The values in rows of bytes, most significant bits first.
pub(super) fn unpack(bytes: &[u8], row_bytes: usize, values: usize, bits: u8) -> Decoded<Vec<u16>> {
    if row_bytes * 8 < values * usize::from(bits) {
        return Err(Fault::damaged("rows are shorter than the header says"));
    }
    let mut all = Vec::with_capacity(bytes.len() / row_bytes.max(1) * values);
    for row in bytes.chunks_exact(row_bytes.max(1)) {
        let (mut waiting, mut count, mut rest) = (0_u32, 0, row.iter());
        for _ in 0..values {
            while count < bits {
                waiting = waiting << 8 | u32::from(rest.next().copied().unwrap_or(0));
                count += 8;
            }
            count -= bits;
            all.push((waiting >> count & ((1 << bits) - 1)) as u16);
        }
    }
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::unpack;

    #[test]
    fn values_of_any_width_are_unpacked_by_rows() {
        assert_eq!(unpack(&[0x12, 0x34, 0x56, 0xab, 0xcd, 0xef], 3, 2, 12).unwrap(), [0x123, 0x456, 0xabc, 0xdef]);
        assert_eq!(unpack(&[0b1000_0000, 0b0111_1111, 0b1100_0000], 3, 2, 10).unwrap(), [0x201, 0x3fc]);
        assert_eq!(unpack(&[0b1010_0000], 1, 3, 1).unwrap(), [1, 0, 1]);
        assert!(unpack(&[0, 0], 2, 2, 12).is_err());
    }
}

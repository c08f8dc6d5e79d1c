//! Conversion of camera pixel formats to codes of one channel.

use super::formats::{Layout, PixelFormat};
use std::panic::catch_unwind;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Maximum side of a picture. Larger values indicate a driver error.
pub const MAX_SIDE: usize = 32768;
/// Maximum number of pixels of a picture.
pub const MAX_PIXELS: usize = 150_000_000;

/// Format and size of a stream's pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Format of a pixel.
    pub format: PixelFormat,
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Bytes from one row to the next; 0 for rows without padding.
    pub stride: usize,
}

impl Picture {
    /// Checks size and stride.
    ///
    /// # Errors
    /// An invalid size, or a stride shorter than a row.
    pub fn check(&self) -> Result<(), String> {
        let Self { format, width, height, stride } = *self;
        let sides = (1..=MAX_SIDE).contains(&width) && (1..=MAX_SIDE).contains(&height);
        if !sides || width * height > MAX_PIXELS {
            return Err(format!("a size of {width} × {height}"));
        }
        if (stride != 0 && stride < format.row_bytes(width)) || stride > 16 * MAX_SIDE {
            return Err(format!("rows of {width} pixels in {stride} bytes"));
        }
        Ok(())
    }

    /// Whether each frame is a JPEG file.
    pub fn is_jpeg(&self) -> bool {
        self.format.layout == Layout::Jpeg
    }

    /// Unpacks the payload to codes of one channel, row-major; a Bayer mosaic is kept.
    ///
    /// # Errors
    /// The defect of the payload: it is too short, or no JPEG file of this size.
    pub fn unpack(&self, payload: &[u8]) -> Result<Vec<u16>, String> {
        self.check()?;
        if self.is_jpeg() {
            // A panic of the decoder is treated as any other decoding error: the frame is bad.
            return catch_unwind(|| self.decode(payload))
                .unwrap_or_else(|_| Err("a JPEG file that its decoder fails on".into()));
        }
        let row_bytes = self.format.row_bytes(self.width);
        let stride = if self.stride == 0 { row_bytes } else { self.stride };
        // The padding after the last row may be missing.
        let needed = stride * (self.height - 1) + row_bytes;
        if payload.len() < needed {
            return Err(format!("{} of {needed} bytes", payload.len()));
        }
        // The low bits of an incomplete group at a row's end are in the padding.
        let whole = self.format.group_bytes(self.width).min(stride);
        let mut codes = Vec::with_capacity(self.width * self.height);
        for row in payload.chunks(stride).take(self.height) {
            unpack_row(self.format.layout, &row[..whole.min(row.len())], self.width, &mut codes);
        }
        Ok(codes)
    }

    fn decode(&self, payload: &[u8]) -> Result<Vec<u16>, String> {
        let Some((start, rest)) = payload.split_first_chunk::<2>() else { return Err("no JPEG file".into()) };
        let marked = [&start[..], MOTION_JPEG, rest].concat();
        // Some cameras pad their files with zeros.
        let end = marked.iter().rposition(|b| *b != 0).map_or(0, |last| last + 1);
        if marked[..end].ends_with(&[0xFF, 0xD9]) {
            return self.luma(&marked);
        }
        // Some cameras omit the end marker. A truncated file decodes differently with different trailing bytes, since
        // the decoder takes them for data.
        let [whole, other] = TAILS.map(|tail| self.luma(&[&marked, tail].concat()));
        let whole = whole?;
        if other.is_ok_and(|other| other == whole) { Ok(whole) } else { Err("a JPEG file without its end".into()) }
    }

    fn luma(&self, file: &[u8]) -> Result<Vec<u16>, String> {
        let options = DecoderOptions::default()
            .jpeg_set_out_colorspace(ColorSpace::Luma)
            .set_max_width(self.width)
            .set_max_height(self.height)
            .set_strict_mode(false);
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(file), options);
        decoder.decode_headers().map_err(|e| format!("no JPEG file: {e}"))?;
        if decoder.dimensions() != Some((self.width, self.height)) {
            return Err(format!("a JPEG file of another size: {:?}", decoder.dimensions()));
        }
        let luma = decoder.decode().map_err(|e| format!("a damaged JPEG file: {e}"))?;
        if luma.len() != self.width * self.height {
            return Err(format!("a JPEG file of {} values", luma.len()));
        }
        Ok(luma.into_iter().map(u16::from).collect())
    }
}

/// Segment that makes the decoder use the Huffman tables of Motion JPEG (ITU T.81, K.3) if a file has none.
const MOTION_JPEG: &[u8] = b"\xff\xe0\x00\x10AVI1\0\0\0\0\0\0\0\0\0\0";

/// Trailing bytes tried for files without an end marker.
const TAILS: [&[u8]; 2] = [b"\xff\xd9", b"\x3a\xc5\x96\x0f\x71\xe8\x4d\xb2\x1b\x64\xa9\x53\xff\xd9"];

/// Unpacks a row that has all bytes of `width` pixels.
fn unpack_row(layout: Layout, row: &[u8], width: usize, codes: &mut Vec<u16>) {
    let end = codes.len() + width;
    match layout {
        Layout::Bytes | Layout::LumaPlane => codes.extend(row.iter().map(|b| u16::from(*b))),
        Layout::Words => codes.extend(row.as_chunks::<2>().0.iter().map(|w| u16::from_le_bytes(*w))),
        Layout::LumaFirst => codes.extend(row.iter().step_by(2).map(|b| u16::from(*b))),
        Layout::LumaSecond => codes.extend(row.iter().skip(1).step_by(2).map(|b| u16::from(*b))),
        Layout::TenPacked => row.chunks(5).for_each(|group| unpack_group(group, 4, 2, codes)),
        Layout::TwelvePacked => row.chunks(3).for_each(|group| unpack_group(group, 2, 4, codes)),
        Layout::FourteenPacked => row.chunks(7).for_each(|group| unpack_group(group, 4, 6, codes)),
        Layout::TenBits => codes.extend((0..width).map(|pixel| ten_bits(row, pixel))),
        Layout::Jpeg => {}
    }
    codes.resize(end, 0);
}

/// Unpacks a group: the upper bytes of `pixels` codes, then `low` further bits of each, the first pixel's lowest. In a
/// group truncated at a row's end the missing low bits are zero.
fn unpack_group(group: &[u8], pixels: usize, low: usize, codes: &mut Vec<u16>) {
    let rest = group.iter().skip(pixels).rev().fold(0u32, |bits, byte| bits << 8 | u32::from(*byte));
    let code = |(i, high): (usize, &u8)| {
        let bits = (rest >> (i * low)) & ((1 << low) - 1);
        (u16::from(*high) << low) | bits as u16
    };
    codes.extend(group.iter().take(pixels).enumerate().map(code));
}

/// Ten bits of a row without gaps, highest bit first.
fn ten_bits(row: &[u8], pixel: usize) -> u16 {
    let first = 10 * pixel / 8;
    let bytes = [0, 1].map(|i| row.get(first + i).copied().unwrap_or(0));
    (u16::from_be_bytes(bytes) >> (6 - 10 * pixel % 8)) & 1023
}

#[cfg(test)]
mod tests {
    use super::super::fake::{grey_jpeg, pack_row};
    use super::super::formats::FORMATS;
    use super::*;
    use proptest::prelude::*;

    fn picture(name: &str, width: usize, height: usize, stride: usize) -> Picture {
        Picture { format: PixelFormat::named(name).unwrap(), width, height, stride }
    }

    proptest! {
        #[test]
        fn packed_pixels_are_unpacked(
            index in 0usize..51, width in 1usize..40, height in 1usize..6, gap in 0usize..9, seed: u64,
        ) {
            let format = FORMATS[index];
            // Without padding, groups are complete in real pictures.
            let stride = format.group_bytes(width).max(format.row_bytes(width)) + gap;
            let picture = Picture { format, width, height, stride };
            let codes: Vec<u16> = (0..width * height)
                .map(|i| (seed.wrapping_mul(i as u64 + 1).rotate_left(17) as u16) & format.white())
                .collect();
            let mut bytes = Vec::new();
            for row in codes.chunks(width) {
                bytes.extend(pack_row(format, row));
                bytes.resize(bytes.len().div_ceil(stride) * stride, 99);
            }
            prop_assert_eq!(picture.unpack(&bytes), Ok(codes.clone()));
            if stride == format.row_bytes(width) {
                prop_assert_eq!(Picture { stride: 0, ..picture }.unpack(&bytes), Ok(codes));
            }
            let short = stride * (height - 1) + format.row_bytes(width) - 1;
            prop_assert!(picture.unpack(&bytes[..short]).is_err());
        }

        #[test]
        fn no_payload_is_too_wild(
            index in 0usize..53, width in 0usize..70, height in 0usize..9, stride in 0usize..200, bytes: Vec<u8>,
        ) {
            let picture = Picture { format: FORMATS[index], width, height, stride };
            if let Ok(codes) = picture.unpack(&bytes) {
                prop_assert_eq!(codes.len(), width * height);
            }
        }
    }

    #[test]
    fn packed_groups_are_as_the_kernel_documents_them() {
        // Y10P: bytes Y'0[9:2] Y'1[9:2] Y'2[9:2] Y'3[9:2], then Y'3[1:0] Y'2[1:0] Y'1[1:0] Y'0[1:0].
        let ten = picture("Y10P", 4, 1, 0).unpack(&[0xFF, 0x00, 0x80, 0x01, 0b11_10_01_00]);
        assert_eq!(ten, Ok(vec![0x3FC, 0x001, 0x202, 0x007]));
        let twelve = picture("pBCC", 2, 1, 0).unpack(&[0xAB, 0x12, 0x3C]);
        assert_eq!(twelve, Ok(vec![0xABC, 0x123]));
        // pBEE: the fifth byte holds bits 1-0 of the second pixel above bits 5-0 of the first, and so on.
        let fourteen = picture("pBEE", 4, 1, 0).unpack(&[0xFF, 0, 0, 0x80, 0b0100_0001, 0b0010_0000, 0b1111_1100]);
        assert_eq!(fourteen, Ok(vec![0x3FC1, 0x0001, 0x0002, 0x203F]));
        // Y10B: bits in the order of the pixels, highest first.
        let bits = picture("Y10B", 4, 1, 0).unpack(&[0xFF, 0b1100_0000, 0b0001_1000, 0b0000_0000, 0x03]);
        assert_eq!(bits, Ok(vec![0x3FF, 0x001, 0x200, 0x003]));
    }

    #[test]
    fn a_jpeg_file_gives_its_luma_and_a_cut_one_does_not_pass_for_whole() {
        let file = include_bytes!("grey.jpg");
        let codes = picture("MJPG", 16, 8, 0).unpack(file).unwrap();
        assert!(codes.len() == 128 && codes.iter().all(|c| (118..=138).contains(c)), "{codes:?}");
        assert!(picture("MJPG", 8, 8, 0).unpack(file).is_err(), "another size");
        for cut in 0..file.len() - 2 {
            assert!(picture("MJPG", 16, 8, 0).unpack(&file[..cut]).is_err(), "{cut}");
        }
        assert_eq!(picture("MJPG", 16, 8, 0).unpack(&file[..file.len() - 2]).as_ref(), Ok(&codes), "without its end");
        let padded = [file.as_slice(), &[0; 9]].concat();
        assert_eq!(picture("MJPG", 16, 8, 0).unpack(&padded), Ok(codes));
    }

    #[test]
    fn huffman_tables_may_be_missing_and_quantization_tables_may_not() {
        let [file, huffman, quantization] = [grey_jpeg(&[]), grey_jpeg(&[0xc4]), grey_jpeg(&[0xdb])];
        assert!(huffman.len() < file.len() && quantization.len() < file.len());
        let unpack = |file: &[u8]| picture("MJPG", 16, 8, 0).unpack(file);
        assert_eq!(unpack(&huffman), unpack(&file));
        assert!(unpack(&quantization).is_err());
    }
}

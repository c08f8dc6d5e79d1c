//! Conversion of camera pixel formats to codes of one channel.

use std::panic::catch_unwind;
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

/// Maximum side of a picture. Larger values indicate a driver error.
pub const MAX_SIDE: usize = 32768;
/// Maximum number of pixels of a picture.
pub const MAX_PIXELS: usize = 150_000_000;

/// Memory layout of a row of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// One byte per pixel.
    Bytes,
    /// Two bytes per pixel, little endian.
    Words,
    /// Four pixels in five bytes: four upper bytes, then two low bits of each.
    TenPacked,
    /// Two pixels in three bytes: two upper bytes, then four low bits of each.
    TwelvePacked,
    /// A byte of luma, then a byte of chroma.
    LumaFirst,
    /// A byte of chroma, then a byte of luma.
    LumaSecond,
    /// A JPEG file per frame.
    Jpeg,
}

/// A supported pixel format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelFormat {
    /// FourCC code of the format.
    pub fourcc: [u8; 4],
    /// Layout of a row.
    pub layout: Layout,
    /// Bits per code.
    pub bits: u32,
}

const fn format(fourcc: &[u8; 4], layout: Layout, bits: u32) -> PixelFormat {
    PixelFormat { fourcc: *fourcc, layout, bits }
}

/// All supported formats in order of preference: raw before processed, more bits before fewer.
pub const FORMATS: [PixelFormat; 35] = [
    format(b"BYR2", Layout::Words, 16),
    format(b"GB16", Layout::Words, 16),
    format(b"GR16", Layout::Words, 16),
    format(b"RG16", Layout::Words, 16),
    format(b"Y16 ", Layout::Words, 16),
    format(b"Y14 ", Layout::Words, 14),
    format(b"BG12", Layout::Words, 12),
    format(b"GB12", Layout::Words, 12),
    format(b"BA12", Layout::Words, 12),
    format(b"RG12", Layout::Words, 12),
    format(b"Y12 ", Layout::Words, 12),
    format(b"pBCC", Layout::TwelvePacked, 12),
    format(b"pGCC", Layout::TwelvePacked, 12),
    format(b"pgCC", Layout::TwelvePacked, 12),
    format(b"pRCC", Layout::TwelvePacked, 12),
    format(b"Y12P", Layout::TwelvePacked, 12),
    format(b"BG10", Layout::Words, 10),
    format(b"GB10", Layout::Words, 10),
    format(b"BA10", Layout::Words, 10),
    format(b"RG10", Layout::Words, 10),
    format(b"Y10 ", Layout::Words, 10),
    format(b"pBAA", Layout::TenPacked, 10),
    format(b"pGAA", Layout::TenPacked, 10),
    format(b"pgAA", Layout::TenPacked, 10),
    format(b"pRAA", Layout::TenPacked, 10),
    format(b"Y10P", Layout::TenPacked, 10),
    format(b"BA81", Layout::Bytes, 8),
    format(b"GBRG", Layout::Bytes, 8),
    format(b"GRBG", Layout::Bytes, 8),
    format(b"RGGB", Layout::Bytes, 8),
    format(b"GREY", Layout::Bytes, 8),
    format(b"YUYV", Layout::LumaFirst, 8),
    format(b"UYVY", Layout::LumaSecond, 8),
    format(b"MJPG", Layout::Jpeg, 8),
    format(b"JPEG", Layout::Jpeg, 8),
];

impl PixelFormat {
    /// The format of this name, with or without trailing blanks.
    pub fn named(name: &str) -> Option<Self> {
        FORMATS.into_iter().find(|f| f.name() == name.trim_end())
    }

    /// The format of this FourCC code.
    pub fn of(fourcc: [u8; 4]) -> Option<Self> {
        FORMATS.into_iter().find(|f| f.fourcc == fourcc)
    }

    /// Name without trailing blanks.
    pub fn name(&self) -> String {
        String::from_utf8_lossy(&self.fourcc).trim_end().to_owned()
    }

    /// Largest code.
    pub fn white(&self) -> u16 {
        u16::try_from((1u32 << self.bits) - 1).unwrap_or(u16::MAX)
    }

    /// Whether codes are sensor counts, as far as the format shows: luma of a colour picture is processed.
    pub fn raw(&self) -> bool {
        !matches!(self.layout, Layout::LumaFirst | Layout::LumaSecond | Layout::Jpeg)
    }

    /// Bytes of a row of `width` pixels.
    pub fn row_bytes(&self, width: usize) -> usize {
        match self.layout {
            Layout::Bytes => width,
            Layout::Words => 2 * width,
            Layout::TenPacked => (5 * width).div_ceil(4),
            Layout::TwelvePacked => (3 * width).div_ceil(2),
            Layout::LumaFirst | Layout::LumaSecond => 4 * width.div_ceil(2),
            Layout::Jpeg => 0,
        }
    }
}

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
        let mut codes = Vec::with_capacity(self.width * self.height);
        for row in payload.chunks(stride).take(self.height) {
            unpack_row(self.format.layout, &row[..row_bytes], self.width, &mut codes);
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

/// `row` has all bytes of `width` pixels.
fn unpack_row(layout: Layout, row: &[u8], width: usize, codes: &mut Vec<u16>) {
    let end = codes.len() + width;
    match layout {
        Layout::Bytes => codes.extend(row.iter().map(|b| u16::from(*b))),
        Layout::Words => codes.extend(row.as_chunks::<2>().0.iter().map(|w| u16::from_le_bytes(*w))),
        Layout::LumaFirst => codes.extend(row.iter().step_by(2).map(|b| u16::from(*b))),
        Layout::LumaSecond => codes.extend(row.iter().skip(1).step_by(2).map(|b| u16::from(*b))),
        Layout::TenPacked => row.chunks(5).for_each(|group| unpack_group(group, 4, 2, codes)),
        Layout::TwelvePacked => row.chunks(3).for_each(|group| unpack_group(group, 2, 4, codes)),
        Layout::Jpeg => {}
    }
    codes.resize(end, 0);
}

/// Unpacks a group: the upper bytes of `pixels` codes, then one byte with `low` further bits of each, the first pixel's
/// lowest. In a group truncated at a row's end the missing low bits are zero.
fn unpack_group(group: &[u8], pixels: usize, low: usize, codes: &mut Vec<u16>) {
    let rest = group.get(pixels).copied().unwrap_or(0);
    let code = |(i, high): (usize, &u8)| {
        let bits = (rest >> (i * low)) & ((1 << low) - 1);
        (u16::from(*high) << low) | u16::from(bits)
    };
    codes.extend(group.iter().take(pixels).enumerate().map(code));
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn picture(name: &str, width: usize, height: usize, stride: usize) -> Picture {
        Picture { format: PixelFormat::named(name).unwrap(), width, height, stride }
    }

    /// Packs codes as a camera would.
    fn pack(picture: &Picture, codes: &[u16]) -> Vec<u8> {
        let row_bytes = picture.format.row_bytes(picture.width);
        let group = |row: &[u16], pixels: usize, low: usize| -> Vec<u8> {
            let group = |g: &[u16]| -> Vec<u8> {
                let rest = g.iter().enumerate().map(|(i, c)| ((c & ((1 << low) - 1)) as u8) << (i * low)).sum();
                let high = g.iter().map(|c| (c >> low) as u8).chain(std::iter::repeat_n(0, pixels - g.len()));
                high.chain([rest]).collect()
            };
            row.chunks(pixels).flat_map(group).collect()
        };
        let mut bytes = Vec::new();
        for row in codes.chunks(picture.width) {
            let mut stored: Vec<u8> = match picture.format.layout {
                Layout::Bytes => row.iter().map(|c| *c as u8).collect(),
                Layout::Words => row.iter().flat_map(|c| c.to_le_bytes()).collect(),
                Layout::LumaFirst => row.iter().flat_map(|c| [*c as u8, 77]).collect(),
                Layout::LumaSecond => row.iter().flat_map(|c| [77, *c as u8]).collect(),
                Layout::TenPacked => group(row, 4, 2),
                Layout::TwelvePacked => group(row, 2, 4),
                Layout::Jpeg => panic!("not packed here"),
            };
            stored.resize(picture.stride.max(row_bytes), 99);
            bytes.extend(stored);
        }
        bytes
    }

    proptest! {
        #[test]
        fn packed_pixels_are_unpacked(
            index in 0usize..33, width in 1usize..20, height in 1usize..6, gap in 0usize..9, seed: u64,
        ) {
            let format = FORMATS[index];
            // Packed groups are complete in real pictures.
            let width = match format.layout { Layout::TenPacked => 4 * width, Layout::TwelvePacked => 2 * width, _ => width };
            let stride = if gap == 0 { 0 } else { format.row_bytes(width) + gap };
            let picture = Picture { format, width, height, stride };
            let codes: Vec<u16> = (0..width * height)
                .map(|i| (seed.wrapping_mul(i as u64 + 1).rotate_left(17) as u16) & format.white())
                .collect();
            let bytes = pack(&picture, &codes);
            prop_assert_eq!(picture.unpack(&bytes), Ok(codes));
            let short = stride.max(format.row_bytes(width)) * (height - 1) + format.row_bytes(width) - 1;
            prop_assert!(picture.unpack(&bytes[..short]).is_err());
        }

        #[test]
        fn no_payload_is_too_wild(
            index in 0usize..35, width in 0usize..70, height in 0usize..9, stride in 0usize..200, bytes: Vec<u8>,
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
    }

    #[test]
    fn names_are_found_with_and_without_their_blanks_and_are_different() {
        assert_eq!(PixelFormat::named("Y16"), PixelFormat::named("Y16 "));
        assert_eq!(PixelFormat::named("XYZW"), None);
        assert_eq!(PixelFormat::of(*b"Y10 ").map(|f| f.white()), Some(1023));
        for (i, f) in FORMATS.iter().enumerate() {
            assert!(FORMATS[..i].iter().all(|g| g.fourcc != f.fourcc), "{}", f.name());
        }
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
        assert_eq!(picture("MJPG", 16, 8, 0).unpack(&without_tables(file)).as_ref(), Ok(&codes));
        let padded = [file.as_slice(), &[0; 9]].concat();
        assert_eq!(picture("MJPG", 16, 8, 0).unpack(&padded), Ok(codes));
    }
    /// A JPEG file without its Huffman tables.
    fn without_tables(file: &[u8]) -> Vec<u8> {
        let (mut bare, mut at) = (file[..2].to_vec(), 2);
        while file[at + 1] != 0xda {
            let end = at + 2 + usize::from(u16::from_be_bytes([file[at + 2], file[at + 3]]));
            if file[at + 1] != 0xc4 {
                bare.extend(&file[at..end]);
            }
            at = end;
        }
        bare.extend(&file[at..]);
        bare
    }
}

//! Pixel formats of cameras.

/// Memory layout of a row of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// One byte per pixel.
    Bytes,
    /// Two bytes per pixel, little endian.
    Words,
    /// Four pixels in five bytes (MIPI RAW10): four upper bytes, then two low bits of each.
    TenPacked,
    /// Two pixels in three bytes (MIPI RAW12): two upper bytes, then four low bits of each.
    TwelvePacked,
    /// Four pixels in seven bytes (MIPI RAW14): four upper bytes, then six low bits of each.
    FourteenPacked,
    /// Ten bits per pixel without gaps, highest bit first.
    TenBits,
    /// A byte of luma, then a byte of chroma.
    LumaFirst,
    /// A byte of chroma, then a byte of luma.
    LumaSecond,
    /// One byte of luma per pixel. Chroma follows after the last row, or is in further planes.
    LumaPlane,
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
pub const FORMATS: [PixelFormat; 53] = [
    format(b"BYR2", Layout::Words, 16),
    format(b"GB16", Layout::Words, 16),
    format(b"GR16", Layout::Words, 16),
    format(b"RG16", Layout::Words, 16),
    format(b"Y16 ", Layout::Words, 16),
    format(b"Y14 ", Layout::Words, 14),
    format(b"pBEE", Layout::FourteenPacked, 14),
    format(b"pGEE", Layout::FourteenPacked, 14),
    format(b"pgEE", Layout::FourteenPacked, 14),
    format(b"pREE", Layout::FourteenPacked, 14),
    format(b"Y14P", Layout::FourteenPacked, 14),
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
    format(b"Y10B", Layout::TenBits, 10),
    format(b"BA81", Layout::Bytes, 8),
    format(b"GBRG", Layout::Bytes, 8),
    format(b"GRBG", Layout::Bytes, 8),
    format(b"RGGB", Layout::Bytes, 8),
    format(b"GREY", Layout::Bytes, 8),
    format(b"YUYV", Layout::LumaFirst, 8),
    format(b"UYVY", Layout::LumaSecond, 8),
    format(b"NV12", Layout::LumaPlane, 8),
    format(b"NV21", Layout::LumaPlane, 8),
    format(b"NV16", Layout::LumaPlane, 8),
    format(b"NV61", Layout::LumaPlane, 8),
    format(b"YU12", Layout::LumaPlane, 8),
    format(b"YV12", Layout::LumaPlane, 8),
    format(b"NM12", Layout::LumaPlane, 8),
    format(b"NM21", Layout::LumaPlane, 8),
    format(b"NM16", Layout::LumaPlane, 8),
    format(b"NM61", Layout::LumaPlane, 8),
    format(b"YM12", Layout::LumaPlane, 8),
    format(b"YM21", Layout::LumaPlane, 8),
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

    /// True for raw formats. Luma and JPEG have passed the camera's colour processing.
    pub fn raw(&self) -> bool {
        !matches!(self.layout, Layout::LumaFirst | Layout::LumaSecond | Layout::LumaPlane | Layout::Jpeg)
    }

    /// Bytes of a row of `width` pixels.
    pub fn row_bytes(&self, width: usize) -> usize {
        match self.layout {
            Layout::Bytes | Layout::LumaPlane => width,
            Layout::Words => 2 * width,
            Layout::TenPacked | Layout::TenBits => (5 * width).div_ceil(4),
            Layout::TwelvePacked => (3 * width).div_ceil(2),
            Layout::FourteenPacked => (7 * width).div_ceil(4),
            Layout::LumaFirst | Layout::LumaSecond => 4 * width.div_ceil(2),
            Layout::Jpeg => 0,
        }
    }

    /// Bytes of a row of `width` pixels whose last group is complete, for formats of groups.
    pub fn group_bytes(&self, width: usize) -> usize {
        let pixels = match self.layout {
            Layout::TenPacked | Layout::FourteenPacked => 4,
            Layout::TwelvePacked => 2,
            _ => 1,
        };
        self.row_bytes(width.next_multiple_of(pixels))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn raw_formats_come_first_and_bits_decrease() {
        let processed = FORMATS.iter().skip_while(|f| f.raw());
        assert!(processed.clone().count() > 0 && processed.clone().all(|f| !f.raw()));
        let bits: Vec<u32> = FORMATS.iter().filter(|f| f.raw()).map(|f| f.bits).collect();
        assert!(bits.is_sorted_by(|a, b| a >= b), "{bits:?}");
    }
}

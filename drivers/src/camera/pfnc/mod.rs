//! Pixel formats of GenICam's Pixel Format Naming Convention (PFNC), and their conversion to codes of one channel.
//!
//! A name states the filter mosaic, the bits per code and the packing: `BayerRG12p` is a Bayer mosaic of 12-bit codes
//! without gaps. The 32-bit value of a format holds the bits that a pixel occupies in its second byte. Formats of more
//! than one channel per pixel (RGB, YUV, computed Stokes images) are not supported: a camera has processed them.

mod codes;

pub use codes::{CODES, code_of};

/// Maximum side of a picture. Larger values indicate a driver error.
pub const MAX_SIDE: usize = 32768;
/// Maximum number of pixels of a picture.
pub const MAX_PIXELS: usize = 150_000_000;

/// Filters on the sensor's pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Mosaic {
    /// None: every pixel has the same filter.
    Mono,
    /// Colour filters.
    Bayer,
    /// Polarizers in four directions.
    Polarized,
    /// Polarizers in four directions, below colour filters.
    BayerPolarized,
}

/// Packing of codes in bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// One or two bytes per pixel, little endian; unused high bits are zero.
    Whole,
    /// Without gaps, the lowest bit first (PFNC suffix `p`).
    Lsb,
    /// Two pixels in three bytes (GigE Vision suffix `Packed`): high bits of the first, low bits of both, high bits of
    /// the second. The first pixel's low bits are in the low half of the middle byte.
    Gige,
}

/// A supported pixel format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelFormat {
    /// Filters on the pixels.
    pub mosaic: Mosaic,
    /// Bits per code: 8, 10, 12, 14 or 16.
    pub bits: u32,
    /// Packing of the codes.
    pub packing: Packing,
}

/// Prefixes of names, longest first. `PolarizeMono` is Lucid's name for raw codes of a polarization sensor,
/// `PolarizedMono` that of The Imaging Source, `Polarized` that of Teledyne FLIR.
const PREFIXES: [(&str, Mosaic); 9] = [
    ("BayerRGPolarized", Mosaic::BayerPolarized),
    ("PolarizedMono", Mosaic::Polarized),
    ("PolarizeMono", Mosaic::Polarized),
    ("Polarized", Mosaic::Polarized),
    ("BayerGR", Mosaic::Bayer),
    ("BayerRG", Mosaic::Bayer),
    ("BayerGB", Mosaic::Bayer),
    ("BayerBG", Mosaic::Bayer),
    ("Mono", Mosaic::Mono),
];

/// Suffixes of names.
const SUFFIXES: [(&str, u32, Packing); 10] = [
    ("8", 8, Packing::Whole),
    ("10", 10, Packing::Whole),
    ("10p", 10, Packing::Lsb),
    ("10Packed", 10, Packing::Gige),
    ("12", 12, Packing::Whole),
    ("12p", 12, Packing::Lsb),
    ("12Packed", 12, Packing::Gige),
    ("14", 14, Packing::Whole),
    ("14p", 14, Packing::Lsb),
    ("16", 16, Packing::Whole),
];

impl PixelFormat {
    /// The format of this name; `None` if it is unknown or has several channels.
    pub fn named(name: &str) -> Option<Self> {
        PREFIXES.iter().find_map(|(prefix, mosaic)| {
            let suffix = name.strip_prefix(prefix)?;
            let (_, bits, packing) = SUFFIXES.iter().find(|(known, ..)| *known == suffix)?;
            Some(Self { mosaic: *mosaic, bits: *bits, packing: *packing })
        })
    }

    /// Largest code.
    pub fn white(&self) -> u16 {
        u16::try_from((1u32 << self.bits.min(16)) - 1).unwrap_or(u16::MAX)
    }

    /// Bits that a pixel occupies, as in the second byte of the format's value.
    pub fn occupied_bits(&self) -> u32 {
        match self.packing {
            Packing::Whole if self.bits <= 8 => 8,
            Packing::Whole => 16,
            Packing::Lsb => self.bits,
            Packing::Gige => 12,
        }
    }

    /// Whether a format's 32-bit value agrees with its name in the bits that a pixel occupies.
    pub fn fits(&self, code: u32) -> bool {
        (code >> 16) & 0xFF == self.occupied_bits()
    }

    /// Order of preference: more bits before fewer, raw mosaics before `Mono`, unpacked before packed. Cameras with a
    /// mosaic compute `Mono` from it.
    pub fn preference(&self) -> (u32, Mosaic, u8) {
        let packing = match self.packing {
            Packing::Whole => 2,
            Packing::Lsb => 1,
            Packing::Gige => 0,
        };
        (self.bits, self.mosaic, packing)
    }
}

/// Format and size of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Format of a pixel.
    pub format: PixelFormat,
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Unused bytes after each row. Without them, packed codes continue across the ends of rows.
    pub padding: usize,
}

impl Picture {
    /// Checks size and padding.
    ///
    /// # Errors
    /// The invalid size or padding.
    pub fn check(&self) -> Result<(), String> {
        let Self { width, height, padding, .. } = *self;
        let sides = (1..=MAX_SIDE).contains(&width) && (1..=MAX_SIDE).contains(&height);
        if !sides || width * height > MAX_PIXELS {
            return Err(format!("a size of {width} × {height}"));
        }
        if padding > MAX_SIDE {
            return Err(format!("{padding} bytes between rows"));
        }
        Ok(())
    }

    /// Size of the payload in bytes.
    pub fn bytes(&self) -> usize {
        let Self { format, width, height, padding } = *self;
        match padding {
            0 => packed_bytes(format, width * height),
            _ => height * (packed_bytes(format, width) + padding),
        }
    }

    /// Unpacks the payload to codes of one channel, row-major; a mosaic is kept.
    ///
    /// # Errors
    /// An invalid size, or a payload that is too short.
    pub fn unpack(&self, payload: &[u8]) -> Result<Vec<u16>, String> {
        self.check()?;
        let Self { format, width, height, padding } = *self;
        let row = packed_bytes(format, width);
        // The padding after the last row may be missing.
        let needed = self.bytes() - padding;
        let Some(payload) = payload.get(..needed) else {
            return Err(format!("{} of {needed} bytes", payload.len()));
        };
        let mut codes = Vec::with_capacity(width * height);
        if padding == 0 {
            unpack_run(format, payload, width * height, &mut codes);
        } else {
            for bytes in payload.chunks(row + padding) {
                unpack_run(format, bytes.get(..row).unwrap_or(bytes), width, &mut codes);
            }
        }
        Ok(codes)
    }
}

/// Bytes of a run of `pixels` codes.
fn packed_bytes(format: PixelFormat, pixels: usize) -> usize {
    match format.packing {
        // The last pixel of an odd number fills two of three bytes.
        Packing::Gige => (3 * pixels).div_ceil(2),
        _ => (pixels * format.occupied_bits() as usize).div_ceil(8),
    }
}

/// Appends `pixels` codes from `bytes`.
fn unpack_run(format: PixelFormat, bytes: &[u8], pixels: usize, codes: &mut Vec<u16>) {
    let end = codes.len() + pixels;
    match format.packing {
        Packing::Whole if format.bits <= 8 => codes.extend(bytes.iter().map(|b| u16::from(*b))),
        Packing::Whole => codes.extend(bytes.as_chunks::<2>().0.iter().map(|w| u16::from_le_bytes(*w))),
        Packing::Lsb => unpack_lsb(bytes, format.bits, pixels, codes),
        Packing::Gige => {
            // The low bits of a pixel fill 2 or 4 bits of its half of the middle byte.
            let low = format.bits.saturating_sub(8);
            let mask = (1 << low) - 1;
            for group in bytes.chunks(3) {
                let middle = group.get(1).copied().unwrap_or(0);
                let code = |high: &u8, rest: u8| (u16::from(*high) << low) | u16::from(rest & mask);
                codes.extend(group.first().map(|high| code(high, middle)));
                codes.extend(group.get(2).map(|high| code(high, middle >> 4)));
            }
        }
    }
    codes.resize(end, 0);
}

/// Unpacks codes without gaps, the lowest bit of the first byte first.
fn unpack_lsb(bytes: &[u8], bits: u32, pixels: usize, codes: &mut Vec<u16>) {
    let mask = (1u32 << bits) - 1;
    let (mut buffer, mut filled) = (0u32, 0);
    let mut rest = bytes.iter();
    for _ in 0..pixels {
        while filled < bits {
            let Some(byte) = rest.next() else { return };
            buffer |= u32::from(*byte) << filled;
            filled += 8;
        }
        codes.push((buffer & mask) as u16);
        buffer >>= bits;
        filled -= bits;
    }
}

#[cfg(test)]
mod tests;

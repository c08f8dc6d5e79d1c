//! Images in memory: samples, sizes and their limits, and buffers for decoders.

use std::fmt;

use super::fault::{Decoded, Fault};

/// Longest side of an image, in pixels.
pub const MAX_SIDE: usize = 65_535;
/// Largest number of pixels of an image (128 Mpixel).
pub const MAX_PIXELS: usize = 128 << 20;
/// Largest decoded image or image file in bytes (4 GiB).
pub(super) const MAX_BYTES: u64 = 4 << 30;

/// Samples in the type of the file; half floats, doubles and EXR integers become `f32`.
#[derive(Debug, Clone, PartialEq)]
pub enum Samples {
    /// 0 to 255.
    U8(Vec<u8>),
    /// 0 to 65,535.
    U16(Vec<u16>),
    /// Any value, also NaN and infinities.
    F32(Vec<f32>),
}

/// Image: `samples[(row · width + column) · channels + channel]`, row 0 on top.
///
/// Pixels are in the order of the file; an orientation tag (Exif) is not applied.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    /// Pixels per row, 1 to [`MAX_SIDE`].
    pub width: usize,
    /// Number of rows, 1 to [`MAX_SIDE`].
    pub height: usize,
    /// 1 (grey) or 3 (red, green, blue). Alpha is dropped.
    pub channels: usize,
    /// `width · height · channels` values.
    pub samples: Samples,
}

/// Size and type of an image, from the header of its file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Info {
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// 1 (grey) or 3 (red, green, blue).
    pub channels: usize,
    /// Type of a sample.
    pub depth: Depth,
}

/// Type of a sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// Integers 0 to 255.
    U8,
    /// Integers 0 to 65,535.
    U16,
    /// Floating point.
    F32,
}

impl Depth {
    /// Bytes of a sample in memory.
    pub fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::F32 => 4,
        }
    }

    /// Value of a saturated sample: 255, 65535 or 1.0.
    pub fn full_scale(self) -> f32 {
        match self {
            Self::U8 => 255.0,
            Self::U16 => 65_535.0,
            Self::F32 => 1.0,
        }
    }
}

impl fmt::Display for Depth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::U8 => "8-bit",
            Self::U16 => "16-bit",
            Self::F32 => "32-bit float",
        })
    }
}

impl fmt::Display for Info {
    /// Formats as "640 x 480 pixels, 16-bit grey".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let color = if self.channels == 1 { "grey" } else { "RGB" };
        write!(f, "{} x {} pixels, {} {color}", self.width, self.height, self.depth)
    }
}

impl Raster {
    /// Size and type of the image.
    pub fn info(&self) -> Info {
        let depth = match self.samples {
            Samples::U8(_) => Depth::U8,
            Samples::U16(_) => Depth::U16,
            Samples::F32(_) => Depth::F32,
        };
        Info { width: self.width, height: self.height, channels: self.channels, depth }
    }
}

impl Info {
    /// Description within the size limits. `stored` is the number of channels in the file (with alpha), `bytes` is the
    /// size of a sample there.
    pub(super) fn checked(size: [u64; 2], channels: usize, depth: Depth, stored: u64, bytes: u64) -> Decoded<Self> {
        let [width, height] = check_size(size, stored.saturating_mul(bytes))?;
        Ok(Self { width, height, channels, depth })
    }

    /// Number of samples of the raster.
    pub(super) fn len(&self) -> usize {
        self.width * self.height * self.channels
    }

    /// Raster of these samples.
    ///
    /// # Errors
    /// If the decoder delivered another number of samples than the header announced.
    pub(super) fn raster(self, samples: Samples) -> Decoded<Raster> {
        let len = match &samples {
            Samples::U8(v) => v.len(),
            Samples::U16(v) => v.len(),
            Samples::F32(v) => v.len(),
        };
        if len != self.len() {
            return Err(Fault::damaged(format!("{len} samples where the header says {}", self.len())));
        }
        Ok(Raster { width: self.width, height: self.height, channels: self.channels, samples })
    }
}

/// Checks width and height against the limits, and converts them.
pub(super) fn check_size(size: [u64; 2], bytes_per_pixel: u64) -> Decoded<[usize; 2]> {
    let [width, height] = size;
    let refuse = |limit: String| Err(Fault::too_large(format!("is {width} x {height} pixels, {limit}")));
    if width == 0 || height == 0 {
        return Err(Fault::damaged(format!("the header says {width} x {height} pixels")));
    }
    if width.max(height) > MAX_SIDE as u64 {
        return refuse(format!("more than {MAX_SIDE} along a side"));
    }
    if width * height > MAX_PIXELS as u64 {
        return refuse(format!("more than {} Mpixel", MAX_PIXELS >> 20));
    }
    if (width * height).saturating_mul(bytes_per_pixel) > MAX_BYTES {
        return refuse(format!("more than {} GiB when decoded", MAX_BYTES >> 30));
    }
    Ok([width as usize, height as usize])
}

/// Allocates a zeroed buffer; a fault if there is not enough memory.
pub(super) fn zeroed<T: Clone + Default>(len: usize) -> Decoded<Vec<T>> {
    let mut probe = Vec::<T>::new();
    if probe.try_reserve_exact(len).is_err() {
        return Err(Fault::too_large("does not fit into memory".into()));
    }
    drop(probe);
    Ok(vec![T::default(); len])
}

/// Keeps the first `kept` of every `stored` interleaved channels.
pub(super) fn keep_channels<T: Copy>(mut samples: Vec<T>, stored: usize, kept: usize) -> Vec<T> {
    if kept < stored {
        let pixels = samples.len() / stored;
        for pixel in 0..pixels {
            samples.copy_within(pixel * stored..pixel * stored + kept, pixel * kept);
        }
        samples.truncate(pixels * kept);
    }
    samples
}

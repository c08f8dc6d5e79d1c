//! Reads photographs: PNG, JPEG, TIFF, BMP, OpenEXR and Radiance HDR, told apart by their first bytes.
//!
//! Bad input is an [`Error::Input`] in plain words, never a panic and never a half-decoded picture. Sizes are
//! checked against the header before anything is allocated for pixels.

use std::fmt;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use super::{bmp, jpeg, openexr, png, radiance, tif};
use nacre_base::guard::guarded;
use nacre_base::{Error, Result};

/// File name endings of the formats that [`read`] understands, in lower case.
pub const EXTENSIONS: &[&str] = &["png", "tif", "tiff", "jpg", "jpeg", "exr"];

/// Longest side of an image, in pixels.
pub const MAX_SIDE: usize = 65_535;
/// Most pixels of an image (64 Mpixel).
pub const MAX_PIXELS: usize = 64 << 20;
/// Most bytes that one decoded image or one image file may take (4 GiB).
pub(super) const MAX_BYTES: u64 = 4 << 30;

/// What to do about a damaged file.
const RENEW: &str = "copy or export the file again";

/// Samples as the file stores them; half floats, doubles and EXR integers become `f32`.
#[derive(Debug, Clone, PartialEq)]
pub enum Samples {
    /// 0 to 255.
    U8(Vec<u8>),
    /// 0 to 65,535.
    U16(Vec<u16>),
    /// Any value, NaN and infinities included.
    F32(Vec<f32>),
}

/// An image: `samples[(row · width + column) · channels + channel]`, row 0 on top.
///
/// Pixels are in the order of the file: an orientation tag (Exif) is not applied.
#[derive(Debug, Clone, PartialEq)]
pub struct Raster {
    /// Pixels per row, 1 to [`MAX_SIDE`].
    pub width: usize,
    /// Rows, 1 to [`MAX_SIDE`].
    pub height: usize,
    /// 1 (grey) or 3 (red, green, blue). Alpha is dropped.
    pub channels: usize,
    /// `width · height · channels` values.
    pub samples: Samples,
}

/// What the header of an image file says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Info {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
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

    /// The value of a saturated sample: 255, 65535 or 1.0.
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
    /// As in "640 x 480 pixels, 16-bit grey".
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let color = if self.channels == 1 { "grey" } else { "RGB" };
        write!(f, "{} x {} pixels, {} {color}", self.width, self.height, self.depth)
    }
}

impl Raster {
    /// What its file's header says.
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
    /// Checked description; `stored` is the number of channels in the file (alpha included), `bytes` their size.
    pub(super) fn checked(size: [u64; 2], channels: usize, depth: Depth, stored: u64, bytes: u64) -> Decoded<Self> {
        let [width, height] = check_size(size, stored.saturating_mul(bytes))?;
        Ok(Self { width, height, channels, depth })
    }

    /// Number of samples of the raster.
    pub(super) fn len(&self) -> usize {
        self.width * self.height * self.channels
    }

    /// The raster with these samples.
    ///
    /// # Errors
    /// When the decoder delivered another number of samples than the header promised.
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

/// Width and height as usable numbers, or why an image of that size is refused.
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

/// Why a decoder gave up; becomes an [`Error::Input`] once the path is known.
#[derive(Debug)]
pub(super) struct Fault {
    problem: String,
    remedy: &'static str,
}

/// Result of a decoder.
pub(super) type Decoded<T> = std::result::Result<T, Fault>;

impl Fault {
    /// The content contradicts itself or ends early.
    pub(super) fn damaged(words: impl fmt::Display) -> Self {
        Self { problem: format!("is truncated or damaged: {words}"), remedy: RENEW }
    }

    /// A valid file of a kind that is not read.
    pub(super) fn unsupported(words: impl fmt::Display) -> Self {
        Self { problem: words.to_string(), remedy: "convert it to an 8 or 16-bit grey or RGB PNG or TIFF" }
    }

    fn too_large(problem: String) -> Self {
        Self { problem, remedy: "crop or scale it down" }
    }

    fn unusable(problem: impl fmt::Display, remedy: &'static str) -> Self {
        Self { problem: problem.to_string(), remedy }
    }

    /// The error that a user sees.
    pub(super) fn at(self, path: &Path) -> Error {
        Error::file(path, self.problem, self.remedy)
    }
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::NotFound => Self::unusable("does not exist", "check the path"),
            io::ErrorKind::UnexpectedEof => Self::damaged("the file ends too early"),
            // What decoders say through an I/O error about content, rather than what the system says.
            io::ErrorKind::InvalidData | io::ErrorKind::InvalidInput | io::ErrorKind::Other => Self::damaged(error),
            _ => Self::unusable(format!("cannot be read: {error}"), "check the path, its permissions and the disk"),
        }
    }
}

/// An open image file, at its start.
pub(super) type Source = BufReader<File>;

enum Format {
    Png,
    Jpeg,
    Tiff,
    Exr,
    Bmp,
    Radiance,
}

/// Opens a regular, not empty, not gigantic file.
pub(super) fn open(path: &Path) -> Decoded<Source> {
    let meta = std::fs::metadata(path)?;
    if meta.is_dir() {
        return Err(Fault::unusable("is a folder, not an image", "name one image file"));
    }
    if !meta.is_file() {
        return Err(Fault::unusable("is not a regular file", "name an image file"));
    }
    if meta.len() == 0 {
        return Err(Fault::unusable("is empty", RENEW));
    }
    if meta.len() > MAX_BYTES {
        return Err(Fault::too_large(format!("is larger than {} GiB", MAX_BYTES >> 30)));
    }
    Ok(BufReader::with_capacity(1 << 16, File::open(path)?))
}

fn sniff(source: &mut Source) -> Decoded<Format> {
    let mut magic = Vec::with_capacity(8);
    source.by_ref().take(8).read_to_end(&mut magic)?;
    source.seek(SeekFrom::Start(0))?;
    match magic.as_slice() {
        [0x89, b'P', b'N', b'G', ..] => Ok(Format::Png),
        [0xff, 0xd8, 0xff, ..] => Ok(Format::Jpeg),
        [b'I', b'I', 42 | 43, 0, ..] | [b'M', b'M', 0, 42 | 43, ..] => Ok(Format::Tiff),
        [0x76, 0x2f, 0x31, 0x01, ..] => Ok(Format::Exr),
        [b'B', b'M', ..] => Ok(Format::Bmp),
        [b'#', b'?', b'R', ..] => Ok(Format::Radiance),
        _ => Err(Fault::unusable(
            "is not a PNG, JPEG, TIFF, BMP, EXR or Radiance HDR image",
            "convert it to one of these",
        )),
    }
}

/// Runs a decoder on the file at `path`; its panic is damage of the file, like any other.
pub(super) fn decode<T>(path: &Path, decoder: impl FnOnce() -> Decoded<T>) -> Result<T> {
    guarded(decoder).unwrap_or_else(|panic| Err(Fault::unusable(panic, RENEW))).map_err(|fault| fault.at(path))
}

/// Reads only the header of an image file: no pixel is decoded and no memory taken for any.
///
/// # Errors
/// `Error::Input` when the file cannot be read, is no image of a known format, or is beyond the size limits.
pub fn info(path: &Path) -> Result<Info> {
    decode(path, || header(open(path)?))
}

fn header(mut source: Source) -> Decoded<Info> {
    match sniff(&mut source)? {
        Format::Png => png::info(source),
        Format::Jpeg => jpeg::info(source),
        Format::Tiff => tif::info(source),
        Format::Exr => openexr::info(source),
        Format::Bmp => bmp::info(source),
        Format::Radiance => radiance::info(source),
    }
}

/// Width and height of an image file, by its header alone; an OpenEXR file may have any channels.
///
/// # Errors
/// As [`info`].
pub fn size(path: &Path) -> Result<[usize; 2]> {
    decode(path, || {
        let mut source = open(path)?;
        match sniff(&mut source)? {
            Format::Exr => openexr::layer_size(source),
            _ => header(source).map(|info| [info.width, info.height]),
        }
    })
}

/// Reads an image file whole.
///
/// # Errors
/// `Error::Input` as for [`info`], and when the file is truncated, damaged or of a kind that is not read (CMYK,
/// signed or 32-bit integers, unknown EXR channels).
pub fn read(path: &Path) -> Result<Raster> {
    read_into(path, vec![])
}

/// [`read`] that uses the memory of an image of the same size and depth again, where the format can.
pub fn read_into(path: &Path, spare: Vec<u16>) -> Result<Raster> {
    decode(path, || {
        let mut source = open(path)?;
        match sniff(&mut source)? {
            Format::Png => png::read(source, spare),
            Format::Jpeg => jpeg::read(source),
            Format::Tiff => tif::read(source),
            Format::Exr => openexr::read(source),
            Format::Bmp => bmp::read(source),
            Format::Radiance => radiance::read(source),
        }
    })
}

/// A zeroed buffer, or a fault when the memory is not there.
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

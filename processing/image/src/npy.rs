//! NumPy arrays (NPY): real numbers of 8 to 64 bits, height × width, or height × width × 1 or 3, row 0 on top.
//!
//! Unsigned integers of 8 and 16 bits stay integers; all other types become `f32`.

use std::io::{Read, Seek};

use ::half::f16;

use super::fault::{Decoded, Fault};
use super::raster::{Depth, Info, Raster, Samples, zeroed};
use super::source::Source;

/// Largest header in bytes.
const MAX_HEADER: usize = 1 << 16;
const SAVE: &str = "save an array of height x width or height x width x 3 numbers with `numpy.save`";

/// Kind and size of a number.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Unsigned(usize),
    Signed(usize),
    Float(usize),
}

#[derive(Debug, PartialEq)]
struct Array {
    info: Info,
    kind: Kind,
    little: bool,
    /// Whether the first axis is the fastest.
    fortran: bool,
}

pub(super) fn info(mut source: Source) -> Decoded<Info> {
    header(&mut source).map(|array| array.info)
}

/// Black and white level of signed integers of 8 and 16 bits: 0 and the largest integer.
pub(super) fn levels(mut source: Source) -> Decoded<Option<[f64; 2]>> {
    Ok(match header(&mut source)?.kind {
        Kind::Signed(1) => Some([0.0, i8::MAX.into()]),
        Kind::Signed(2) => Some([0.0, i16::MAX.into()]),
        _ => None,
    })
}

pub(super) fn read(mut source: Source) -> Decoded<Raster> {
    let array = header(&mut source)?;
    let bytes = array.kind.bytes();
    let mut chunk = zeroed::<u8>(bytes * 4096)?;
    let mut samples = match array.info.depth {
        Depth::U8 => Samples::U8(zeroed(array.info.len())?),
        Depth::U16 => Samples::U16(zeroed(array.info.len())?),
        Depth::F32 => Samples::F32(zeroed(array.info.len())?),
    };
    let mut done = 0;
    while done < array.info.len() {
        let count = (array.info.len() - done).min(4096);
        let chunk = &mut chunk[..count * bytes];
        source.read_exact(chunk)?;
        for (index, number) in chunk.chunks_exact_mut(bytes).enumerate() {
            if !array.little {
                number.reverse();
            }
            let at = array.place(done + index);
            match &mut samples {
                Samples::U8(out) => out[at] = number[0],
                Samples::U16(out) => out[at] = u16::from_le_bytes([number[0], number[1]]),
                Samples::F32(out) => out[at] = array.kind.value(number),
            }
        }
        done += count;
    }
    array.info.raster(samples)
}

impl Kind {
    fn bytes(self) -> usize {
        let (Self::Unsigned(bytes) | Self::Signed(bytes) | Self::Float(bytes)) = self;
        bytes
    }

    /// Number in these bytes, least significant byte first.
    fn value(self, bytes: &[u8]) -> f32 {
        let mut word = [0; 8];
        word[..bytes.len()].copy_from_slice(bytes);
        let bits = u64::from_le_bytes(word);
        match self {
            Self::Unsigned(_) => bits as f32,
            Self::Signed(bytes) => {
                let unused = 64 - 8 * bytes as u32;
                (((bits << unused) as i64) >> unused) as f32
            }
            Self::Float(2) => f16::from_bits(bits as u16).to_f32(),
            Self::Float(4) => f32::from_bits(bits as u32),
            Self::Float(_) => f64::from_bits(bits) as f32,
        }
    }
}

impl Array {
    /// Index in the raster of a number by its index in the file.
    fn place(&self, index: usize) -> usize {
        if !self.fortran {
            return index;
        }
        let Info { width, height, channels, .. } = self.info;
        let (y, rest) = (index % height, index / height);
        (y * width + rest % width) * channels + rest / width
    }
}

/// Reads the description of the array, and places the source at its first number.
fn header(source: &mut Source) -> Decoded<Array> {
    let mut start = [0; 8];
    source.read_exact(&mut start)?;
    let length = match start[6] {
        1 => {
            let mut length = [0; 2];
            source.read_exact(&mut length)?;
            usize::from(u16::from_le_bytes(length))
        }
        2 | 3 => {
            let mut length = [0; 4];
            source.read_exact(&mut length)?;
            u32::from_le_bytes(length) as usize
        }
        version => return Err(Fault::unusable(format!("is an NPY file of version {version}"), SAVE)),
    };
    if length > MAX_HEADER {
        return Err(Fault::damaged(format!("a header of {length} bytes")));
    }
    let mut text = vec![0; length];
    source.read_exact(&mut text)?;
    let array = parse(&String::from_utf8_lossy(&text))?;
    let needed = source.stream_position()? + (array.info.len() * array.kind.bytes()) as u64;
    let found = source.get_ref().metadata()?.len();
    if needed > found {
        return Err(Fault::damaged(format!("the numbers end at byte {needed}, the file at {found}")));
    }
    if needed < found {
        return Err(Fault::unusable("holds more than one array", "save one photograph per file"));
    }
    Ok(array)
}

/// Parses a Python dictionary such as `{'descr': '<u2', 'fortran_order': False, 'shape': (480, 640), }`.
fn parse(text: &str) -> Decoded<Array> {
    let missing = |key: &str| Fault::damaged(format!("its header has no '{key}'"));
    let after = |key: &str| {
        let value = text.split_once(&format!("'{key}'")).or_else(|| text.split_once(&format!("\"{key}\"")));
        value.and_then(|(_, rest)| rest.trim_start().strip_prefix(':')).map(str::trim_start).ok_or_else(|| missing(key))
    };
    let fortran = match after("fortran_order")? {
        rest if rest.starts_with("True") => true,
        rest if rest.starts_with("False") => false,
        _ => return Err(missing("fortran_order")),
    };
    let shape =
        after("shape")?.strip_prefix('(').and_then(|rest| rest.split_once(')')).ok_or_else(|| missing("shape"))?.0;
    let sides = shape.split(',').map(str::trim).filter(|side| !side.is_empty());
    // Python 2 wrote long integers with an L.
    let sides: Result<Vec<u64>, _> = sides.map(|side| side.trim_end_matches('L').parse()).collect();
    let sides = sides.map_err(|_| Fault::damaged(format!("its shape is ({shape})")))?;
    let (kind, little) = number(after("descr")?)?;
    let (size, channels) = match *sides {
        [height, width] | [height, width, 1] => ([width, height], 1),
        [height, width, 3] => ([width, height], 3),
        _ => {
            return Err(Fault::unusable(
                format!("is an array of shape ({shape}), no image of one or three channels"),
                SAVE,
            ));
        }
    };
    let depth = match kind {
        Kind::Unsigned(1) => Depth::U8,
        Kind::Unsigned(2) => Depth::U16,
        _ => Depth::F32,
    };
    let info = Info::checked(size, channels, depth, channels as u64, kind.bytes().max(depth.bytes()) as u64)?;
    Ok(Array { info, kind, little, fortran })
}

/// Type of the numbers, and whether they are little-endian.
fn number(descr: &str) -> Decoded<(Kind, bool)> {
    let quote = descr.chars().next().filter(|c| matches!(c, '\'' | '"'));
    let Some(code) = quote.and_then(|q| descr[1..].split(q).next()) else {
        return Err(Fault::unusable("is an array of records (structured type)", SAVE));
    };
    let (order, rest) = code.split_at_checked(1).unwrap_or_default();
    let kind = match rest {
        "u1" => Kind::Unsigned(1),
        "u2" => Kind::Unsigned(2),
        "u4" => Kind::Unsigned(4),
        "u8" => Kind::Unsigned(8),
        "i1" => Kind::Signed(1),
        "i2" => Kind::Signed(2),
        "i4" => Kind::Signed(4),
        "i8" => Kind::Signed(8),
        "f2" => Kind::Float(2),
        "f4" => Kind::Float(4),
        "f8" => Kind::Float(8),
        _ => {
            return Err(Fault::unusable(
                format!("is an array of type '{code}', not of real numbers up to 64 bits"),
                SAVE,
            ));
        }
    };
    match order {
        "<" | "|" => Ok((kind, true)),
        ">" => Ok((kind, false)),
        // Native byte order of the writing machine; assumed to be little-endian.
        "=" => Ok((kind, true)),
        _ => Err(Fault::unusable(format!("is an array of type '{code}'"), SAVE)),
    }
}

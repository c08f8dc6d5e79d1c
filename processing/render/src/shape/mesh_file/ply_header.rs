//! Headers of PLY files.

use super::fault::{Decoded, Fault};

const REMEDY: &str = "export the mesh again as PLY 1.0";

/// Encoding of the numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    BigEndian,
    LittleEndian,
}

/// Type of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// Bytes of a number in binary files.
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// A value, or a list preceded by its length.
#[derive(Clone, Debug)]
pub(super) struct Property {
    pub name: String,
    pub kind: Kind,
    /// Type of a list's length.
    pub length: Option<Kind>,
}

/// Elements of one name, in the order of the file.
#[derive(Clone, Debug)]
pub(super) struct Element {
    pub name: String,
    pub count: usize,
    pub properties: Vec<Property>,
}

/// Header of a file.
#[derive(Debug)]
pub(super) struct Header {
    pub encoding: Encoding,
    pub elements: Vec<Element>,
    /// Number of bytes and lines before the data.
    pub bytes: usize,
    pub lines: usize,
}

fn bad(line: usize, problem: impl std::fmt::Display) -> Fault {
    Fault::refused(format!("line {line}: {problem}"), REMEDY)
}

/// Reads a header, whose lines end in LF, CR or both.
pub(super) fn header(bytes: &[u8]) -> Decoded<Header> {
    let (mut encoding, mut elements) = (None, Vec::<Element>::new());
    let (mut at, mut number) = (0, 0);
    // If lines end in CR only, an LF after the last one is the first byte of the data.
    let cr = bytes.iter().position(|b| *b == b'\r').filter(|k| bytes.get(k + 1) != Some(&b'\n')).is_some();
    while at < bytes.len() {
        number += 1;
        let end = bytes[at..].iter().position(|b| matches!(b, b'\n' | b'\r')).map_or(bytes.len(), |n| at + n);
        let line = String::from_utf8_lossy(&bytes[at..end]).into_owned();
        at = if !cr && bytes[end..].starts_with(b"\r\n") { end + 2 } else { end + 1 };
        let words: Vec<&str> = line.split_whitespace().collect();
        match words.as_slice() {
            ["end_header", ..] => {
                let encoding = encoding.ok_or_else(|| Fault::damaged("has a header without a format"))?;
                return Ok(Header { encoding, elements, bytes: at.min(bytes.len()), lines: number });
            }
            [] | ["ply" | "comment" | "obj_info", ..] => {}
            ["format", name, ..] => {
                encoding = Some(match *name {
                    "ascii" => Encoding::Ascii,
                    "binary_big_endian" => Encoding::BigEndian,
                    "binary_little_endian" => Encoding::LittleEndian,
                    other => return Err(bad(number, format!("unknown format {other:?}"))),
                });
            }
            ["element", name, count, ..] => {
                let count = count.parse().map_err(|_| bad(number, format!("{count:?} is no count of elements")))?;
                elements.push(Element { name: (*name).into(), count, properties: vec![] });
            }
            ["property", rest @ ..] => {
                let property = property(rest).map_err(|problem| bad(number, problem))?;
                let element = elements.last_mut().ok_or_else(|| bad(number, "a property before the first element"))?;
                element.properties.push(property);
            }
            _ => return Err(bad(number, format!("unknown statement {line:?}"))),
        }
    }
    Err(Fault::damaged("ends within its header"))
}

fn property(words: &[&str]) -> Result<Property, String> {
    let kind = |word: &str| Kind::named(word).ok_or_else(|| format!("unknown type {word:?}"));
    match words {
        ["list", length, of, name, ..] => {
            let length = Some(kind(length)?);
            if matches!(length, Some(Kind::F32 | Kind::F64)) {
                return Err(format!("lists of {name} have a length that is no integer"));
            }
            Ok(Property { name: (*name).into(), kind: kind(of)?, length })
        }
        [of, name, ..] => Ok(Property { name: (*name).into(), kind: kind(of)?, length: None }),
        _ => Err("a property without a type and a name".into()),
    }
}

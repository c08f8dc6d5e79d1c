//! Numbers in binary files; every read is checked against the end of the file.

use super::fault::{Fault, Outcome};

/// Type of stored numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::height) enum Kind {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    F32,
    F64,
}

impl Kind {
    /// Bytes per number.
    pub(in crate::height) fn size(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Whether numbers are integers, with a resolution of one unit.
    pub(in crate::height) fn is_integer(self) -> bool {
        !matches!(self, Self::F32 | Self::F64)
    }

    /// Integer type of this number of bytes.
    pub(in crate::height) fn integer(bytes: usize, signed: bool) -> Option<Self> {
        Some(match (bytes, signed) {
            (1, false) => Self::U8,
            (1, true) => Self::I8,
            (2, false) => Self::U16,
            (2, true) => Self::I16,
            (4, false) => Self::U32,
            (4, true) => Self::I32,
            _ => return None,
        })
    }
}

/// Byte order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::height) enum Order {
    Little,
    Big,
}

/// Reads the first `count` numbers of `bytes`.
pub(in crate::height) fn numbers(bytes: &[u8], count: usize, kind: Kind, order: Order) -> Outcome<Vec<f64>> {
    let need = count.checked_mul(kind.size()).ok_or_else(|| Fault::damaged("a count overflows"))?;
    let Some(bytes) = bytes.get(..need) else {
        return Err(Fault::Truncated(format!("{need} bytes of heights expected, {} found", bytes.len())));
    };
    fn each<const N: usize>(bytes: &[u8], order: Order, number: impl Fn([u8; N]) -> f64) -> Vec<f64> {
        let one = |chunk: &[u8]| {
            let mut word = [0; N];
            word.copy_from_slice(chunk);
            if order == Order::Big {
                word.reverse();
            }
            number(word)
        };
        bytes.chunks_exact(N).map(one).collect()
    }
    Ok(match kind {
        Kind::U8 => each(bytes, order, |[b]: [u8; 1]| f64::from(b)),
        Kind::I8 => each(bytes, order, |b| f64::from(i8::from_le_bytes(b))),
        Kind::U16 => each(bytes, order, |b| f64::from(u16::from_le_bytes(b))),
        Kind::I16 => each(bytes, order, |b| f64::from(i16::from_le_bytes(b))),
        Kind::U32 => each(bytes, order, |b| f64::from(u32::from_le_bytes(b))),
        Kind::I32 => each(bytes, order, |b| f64::from(i32::from_le_bytes(b))),
        Kind::F32 => each(bytes, order, |b| f64::from(f32::from_le_bytes(b))),
        Kind::F64 => each(bytes, order, f64::from_le_bytes),
    })
}

/// Read position in a file.
#[derive(Clone, Debug)]
pub(in crate::height) struct Cursor<'a> {
    rest: &'a [u8],
    order: Order,
}

impl<'a> Cursor<'a> {
    pub(in crate::height) fn new(bytes: &'a [u8], order: Order) -> Self {
        Self { rest: bytes, order }
    }

    pub(in crate::height) fn is_empty(&self) -> bool {
        self.rest.is_empty()
    }

    /// Reads bytes.
    pub(in crate::height) fn take(&mut self, count: usize) -> Outcome<&'a [u8]> {
        match self.rest.split_at_checked(count) {
            Some((taken, rest)) => {
                self.rest = rest;
                Ok(taken)
            }
            None => Err(Fault::Truncated(format!("{count} bytes expected, {} left", self.rest.len()))),
        }
    }

    fn number(&mut self, kind: Kind) -> Outcome<f64> {
        let bytes = self.take(kind.size())?;
        Ok(numbers(bytes, 1, kind, self.order)?[0])
    }

    pub(in crate::height) fn u8(&mut self) -> Outcome<u8> {
        Ok(self.number(Kind::U8)? as u8)
    }

    pub(in crate::height) fn u16(&mut self) -> Outcome<u16> {
        Ok(self.number(Kind::U16)? as u16)
    }

    pub(in crate::height) fn i16(&mut self) -> Outcome<i16> {
        Ok(self.number(Kind::I16)? as i16)
    }

    pub(in crate::height) fn i32(&mut self) -> Outcome<i32> {
        Ok(self.number(Kind::I32)? as i32)
    }

    pub(in crate::height) fn u32(&mut self) -> Outcome<u32> {
        Ok(self.number(Kind::U32)? as u32)
    }

    pub(in crate::height) fn f64(&mut self) -> Outcome<f64> {
        self.number(Kind::F64)
    }

    /// Reads text up to a zero byte.
    pub(in crate::height) fn text(&mut self) -> Outcome<String> {
        let Some(end) = self.rest.iter().position(|b| *b == 0) else {
            return Err(Fault::Truncated("a text has no end".into()));
        };
        let text = String::from_utf8_lossy(&self.rest[..end]).into_owned();
        self.rest = &self.rest[end + 1..];
        Ok(text)
    }

    /// Reads text in a field of fixed size, without trailing zero bytes and spaces; Latin-1 unless it is UTF-8.
    pub(in crate::height) fn field(&mut self, size: usize) -> Outcome<String> {
        Ok(latin(self.take(size)?))
    }
}

/// Text up to a zero byte; Latin-1 unless it is UTF-8.
pub(in crate::height) fn latin(bytes: &[u8]) -> String {
    let bytes = bytes.split(|b| *b == 0).next().unwrap_or_default();
    let text =
        std::str::from_utf8(bytes).map_or_else(|_| bytes.iter().map(|b| char::from(*b)).collect(), str::to_owned);
    text.trim().to_owned()
}

//! SDF files (ISO 25178-71), as text (`aISO-1.0`) or binary (`bISO-1.0`), and their older form BCR-1.0. Lengths are in
//! metres.

use super::super::stored::{Pitch, Stored};
use super::super::text::encoding;
use super::bytes::{Cursor, Kind, Order, numbers};
use super::fault::{Fault, Outcome};
use super::keys::Keys;
use super::{Input, size};

const TEXT: [&[u8]; 2] = [b"aISO-1.0", b"aBCR-1.0"];
const BINARY: [&[u8]; 2] = [b"bISO-1.0", b"bBCR-1.0"];

pub(super) fn is(bytes: &[u8]) -> bool {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    TEXT.iter().chain(&BINARY).any(|magic| bytes.starts_with(magic)) || utf16(bytes)
}

fn utf16(bytes: &[u8]) -> bool {
    let head = &bytes[..bytes.len().min(64) & !1];
    encoding::decode(head).is_ok_and(|(text, _)| TEXT.iter().any(|magic| text.as_bytes().starts_with(magic)))
}

pub(super) fn read(input: &Input) -> Outcome<Stored> {
    if BINARY.iter().any(|magic| input.bytes.starts_with(magic)) { binary(input.bytes) } else { text(input.bytes) }
}

/// Numbers of the header.
struct Head {
    width: usize,
    rows: usize,
    scales: [f64; 3],
    kind: Kind,
}

impl Head {
    fn new(points: i64, profiles: i64, scales: [f64; 3], compression: i64, kind: i64) -> Outcome<Self> {
        let (width, rows) = size(points, profiles)?;
        if compression != 0 {
            let problem = format!("its heights are compressed (method {compression})");
            return Err(Fault::unsupported(problem, "export it without compression"));
        }
        let kind = match kind {
            0 => Kind::U8,
            1 => Kind::U16,
            2 => Kind::U32,
            3 => Kind::F32,
            4 => Kind::I8,
            5 => Kind::I16,
            6 => Kind::I32,
            7 => Kind::F64,
            other => return Err(Fault::damaged(format!("its DataType {other} is unknown"))),
        };
        // Some programs write 0 or NaN for a missing scale.
        if !scales.iter().all(|s| s.is_finite() && *s > 0.0) {
            let [x, y, z] = scales;
            return Err(Fault::damaged(format!("its scales are {x}, {y} and {z} m")));
        }
        Ok(Self { width, rows, scales, kind })
    }

    /// Profiles begin with the lowest row, y = 0.
    fn stored(self, values: Vec<f64>, how: &str) -> Stored {
        let [x, y, z] = self.scales.map(|s| s * 1e6);
        let y = if self.rows > 1 { y } else { x };
        let stored = Stored {
            width: self.width,
            rows: self.rows,
            values,
            pitch: Pitch::Um([x, y]),
            unit_um: Some(z),
            step: self.kind.is_integer().then_some(1.0),
            notes: vec![format!("SDF file (ISO 25178-71), {how}, y upwards")],
            gaps: Some("are bad points (BAD)".into()),
        };
        stored.upside_down()
    }
}

/// A line `*` begins the data.
fn text(bytes: &[u8]) -> Outcome<Stored> {
    let (text, _) = encoding::decode(bytes)?;
    let mut keys = Keys::default();
    let mut lines = text.split(['\n', '\r']);
    lines.next();
    let mut found = false;
    for line in lines.by_ref() {
        if line.trim() == "*" {
            found = true;
            break;
        }
        keys.line(line, '=');
    }
    if !found {
        return Err(Fault::Truncated("its header has no end (*)".into()));
    }
    let scales = [keys.number("xscale")?, keys.number("yscale")?, keys.number("zscale")?];
    let compression = if keys.get("compression").is_some() { keys.integer("compression")? } else { 0 };
    let kind = if keys.get("datatype").is_some() { keys.integer("datatype")? } else { 7 };
    let head = Head::new(keys.integer("numpoints")?, keys.integer("numprofiles")?, scales, compression, kind)?;
    let count = head.width * head.rows;
    let mut values = Vec::with_capacity(count.min(bytes.len()));
    for word in lines.flat_map(str::split_whitespace) {
        if word.starts_with('*') {
            break;
        }
        let value = match word {
            w if w.eq_ignore_ascii_case("BAD") || w.eq_ignore_ascii_case("NAN") => f64::NAN,
            w => w
                .parse()
                .or_else(|_| w.replacen(',', ".", 1).parse())
                .map_err(|_| Fault::damaged(format!("{w:.40} stands where a height is expected")))?,
        };
        if values.len() == count {
            return Err(Fault::damaged(format!("it has more than {} x {} heights", head.width, head.rows)));
        }
        values.push(value);
    }
    if values.len() < count {
        return Err(Fault::Truncated(format!("{count} heights expected, {} found", values.len())));
    }
    Ok(head.stored(values, "text"))
}

fn binary(bytes: &[u8]) -> Outcome<Stored> {
    let mut at = Cursor::new(bytes, Order::Little);
    at.take(8 + 10 + 12 + 12)?;
    let (points, profiles) = (at.u16()?, at.u16()?);
    let scales = [at.f64()?, at.f64()?, at.f64()?];
    at.f64()?;
    let (compression, kind) = (at.u8()?, at.u8()?);
    at.u8()?;
    let head = Head::new(points.into(), profiles.into(), scales, compression.into(), kind.into())?;
    let count = head.width * head.rows;
    let mut values = numbers(at.take(count * head.kind.size())?, count, head.kind, Order::Little)?;
    // Bad points hold the minimum of a signed type, or the maximum of an unsigned one.
    let bad = match head.kind {
        Kind::U8 => f64::from(u8::MAX),
        Kind::U16 => f64::from(u16::MAX),
        Kind::U32 => f64::from(u32::MAX),
        Kind::I8 => f64::from(i8::MIN),
        Kind::I16 => f64::from(i16::MIN),
        Kind::I32 => f64::from(i32::MIN),
        Kind::F32 | Kind::F64 => f64::INFINITY,
    };
    values.iter_mut().filter(|v| **v == bad || v.abs() >= 3.4e38).for_each(|v| *v = f64::NAN);
    Ok(head.stored(values, "binary"))
}

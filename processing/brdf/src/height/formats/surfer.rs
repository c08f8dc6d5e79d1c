//! Grids of Golden Software's Surfer: text (`DSAA`) and version 6 binary (`DSBB`), rows from the lowest y.

use super::super::stored::{Pitch, Stored};
use super::bytes::{Cursor, Kind, Order, numbers};
use super::fault::{Fault, Outcome};
use super::{Input, size};

/// Smallest value of blank points.
const BLANK: f64 = 1.701_41e38;

pub(super) fn is(bytes: &[u8]) -> bool {
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let follows =
        |magic: &[u8]| text.strip_prefix(magic).is_some_and(|rest| rest.first().is_some_and(u8::is_ascii_whitespace));
    follows(b"DSAA") || bytes.starts_with(b"DSBB") || bytes.starts_with(b"DSRB")
}

pub(super) fn read(input: &Input) -> Outcome<Stored> {
    match input.bytes {
        [b'D', b'S', b'R', b'B', ..] => {
            Err(Fault::unsupported("it is a grid of Surfer 7", "save it as Surfer 6 text grid (.grd, DSAA)"))
        }
        [b'D', b'S', b'B', b'B', ..] => binary(input.bytes),
        _ => text(input.bytes),
    }
}

/// Ranges of x, y and z.
struct Head {
    ends: [[f64; 2]; 3],
}

impl Head {
    fn stored(self, width: usize, rows: usize, mut values: Vec<f64>) -> Outcome<Stored> {
        let near = BLANK * (1.0 - 1e-5);
        values.iter_mut().filter(|v| **v >= near).for_each(|v| *v = f64::NAN);
        let known = values.iter().filter(|v| v.is_finite());
        let [low, high] = known.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(*v), b.max(*v)]);
        let [from, to] = self.ends[2];
        let near = 1e-3 * (to - from).abs().max(high - low) + 1e-5 * low.abs().max(high.abs());
        if low <= high && ((low - from).abs() > near || (high - to).abs() > near) {
            let problem = format!("its heights go from {low} to {high}, its header says from {from} to {to}");
            return Err(Fault::damaged(problem));
        }
        let step = |[a, b]: [f64; 2], count: usize| (b - a) / (count as f64 - 1.0);
        let across = step(self.ends[0], width);
        let down = if rows > 1 { step(self.ends[1], rows) } else { across };
        let gaps = Some("are blank".into());
        let notes = vec!["Surfer grid, y upwards".into()];
        let stored =
            Stored { width, rows, values, pitch: Pitch::Bare([across, down]), notes, gaps, ..Stored::default() };
        Ok(stored.upside_down())
    }
}

fn text(bytes: &[u8]) -> Outcome<Stored> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let text = String::from_utf8_lossy(bytes);
    let mut words = text.split_whitespace().skip(1);
    let mut number = || -> Outcome<f64> {
        let word = words.next().ok_or_else(|| Fault::Truncated("it ends within its numbers".into()))?;
        let value = word.parse().or_else(|_| word.replacen(',', ".", 1).parse::<f64>());
        value.map_err(|_| Fault::damaged(format!("{word:.40} stands where a number is expected")))
    };
    let counts = [number()? as i64, number()? as i64];
    let ends = [[number()?, number()?], [number()?, number()?], [number()?, number()?]];
    let (width, rows) = size(counts[0], counts[1])?;
    let mut values = Vec::with_capacity((width * rows).min(bytes.len()));
    for _ in 0..width * rows {
        values.push(number()?);
    }
    if number().is_ok() {
        return Err(Fault::damaged(format!("it has more than {width} x {rows} heights")));
    }
    Head { ends }.stored(width, rows, values)
}

fn binary(bytes: &[u8]) -> Outcome<Stored> {
    let mut at = Cursor::new(&bytes[4..], Order::Little);
    let counts = [i64::from(at.i16()?), i64::from(at.i16()?)];
    let mut pair = || -> Outcome<[f64; 2]> { Ok([at.f64()?, at.f64()?]) };
    let ends = [pair()?, pair()?, pair()?];
    let (width, rows) = size(counts[0], counts[1])?;
    let values = numbers(at.take(4 * width * rows)?, width * rows, Kind::F32, Order::Little)?;
    Head { ends }.stored(width, rows, values)
}

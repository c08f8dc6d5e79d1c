//! Gwyddion's native format: a tree of named, typed components, little-endian.

use super::super::stored::{Pitch, Stored};
use super::super::text::unit::unit_um;
use super::bytes::{Cursor, Kind, Order, numbers};
use super::fault::{Fault, Outcome};
use super::{Channel, Input, choose, size};
use std::collections::BTreeMap;

/// Deepest nesting of objects, and largest number of components, that are read.
const DEPTH: usize = 12;
const MOST: usize = 200_000;

pub(super) fn is(bytes: &[u8]) -> bool {
    bytes.starts_with(b"GWYP") || bytes.starts_with(b"GWYO")
}

/// Value of a component, of the types that heights need.
enum Value<'a> {
    Number(f64),
    Text(String),
    Doubles(&'a [u8]),
    Object(String, Object<'a>),
    Other,
}

type Object<'a> = BTreeMap<String, Value<'a>>;

struct Reader {
    components: usize,
}

impl Reader {
    fn object<'a>(&mut self, at: &mut Cursor<'a>, depth: usize) -> Outcome<(String, Object<'a>)> {
        let name = at.text()?;
        let bytes = at.u32()? as usize;
        let mut inside = Cursor::new(at.take(bytes)?, Order::Little);
        let mut all = Object::new();
        while !inside.is_empty() {
            self.components += 1;
            if depth > DEPTH || self.components > MOST {
                return Err(Fault::damaged("its objects are nested too deep, or too many"));
            }
            let key = inside.text()?;
            let value = self.value(&mut inside, depth)?;
            all.insert(key, value);
        }
        Ok((name, all))
    }

    fn value<'a>(&mut self, at: &mut Cursor<'a>, depth: usize) -> Outcome<Value<'a>> {
        let kind = at.u8()?;
        Ok(match kind {
            b'b' | b'c' => Value::Number(f64::from(at.u8()?)),
            b'i' => Value::Number(f64::from(at.i32()?)),
            b'q' => {
                at.take(8)?;
                Value::Other
            }
            b'd' => Value::Number(at.f64()?),
            b's' => Value::Text(at.text()?),
            b'o' => {
                let (name, object) = self.object(at, depth + 1)?;
                Value::Object(name, object)
            }
            b'D' => Value::Doubles(array(at, 8)?),
            b'B' | b'C' => skip(array(at, 1)?),
            b'I' => skip(array(at, 4)?),
            b'Q' => skip(array(at, 8)?),
            b'S' => {
                for _ in 0..at.u32()? {
                    at.text()?;
                }
                Value::Other
            }
            b'O' => {
                for _ in 0..at.u32()? {
                    self.components += 1;
                    self.object(at, depth + 1)?;
                }
                Value::Other
            }
            other => return Err(Fault::damaged(format!("a component has the unknown type {:?}", char::from(other)))),
        })
    }
}

fn array<'a>(at: &mut Cursor<'a>, bytes: usize) -> Outcome<&'a [u8]> {
    let count = at.u32()? as usize;
    at.take(count.saturating_mul(bytes))
}

fn skip(_: &[u8]) -> Value<'_> {
    Value::Other
}

fn number(object: &Object, key: &str) -> Option<f64> {
    match object.get(key)? {
        Value::Number(value) => Some(*value),
        _ => None,
    }
}

fn unit(object: &Object, key: &str) -> String {
    match object.get(key) {
        Some(Value::Object(_, unit)) => match unit.get("unitstr") {
            Some(Value::Text(text)) => text.clone(),
            _ => String::new(),
        },
        _ => String::new(),
    }
}

/// Image of a channel or mask.
fn field<'a, 'b>(root: &'b Object<'a>, key: &str) -> Option<&'b Object<'a>> {
    match root.get(key) {
        Some(Value::Object(name, object)) if name == "GwyDataField" => Some(object),
        _ => None,
    }
}

pub(super) fn read(input: &Input) -> Outcome<Stored> {
    if input.bytes.starts_with(b"GWYO") {
        return Err(Fault::unsupported("it is of Gwyddion 1", "open it with a newer Gwyddion and save it again"));
    }
    let mut at = Cursor::new(&input.bytes[4..], Order::Little);
    let (_, root) = Reader { components: 0 }.object(&mut at, 0)?;
    let mut ids: Vec<u32> = root
        .keys()
        .filter_map(|key| key.strip_prefix('/')?.strip_suffix("/data")?.parse().ok())
        .filter(|id| field(&root, &format!("/{id}/data")).is_some())
        .collect();
    ids.sort_unstable();
    if ids.is_empty() {
        return Err(Fault::unsupported("it holds no image", "export an image from Gwyddion"));
    }
    let channel = |id: &u32| {
        let image = field(&root, &format!("/{id}/data"));
        let unit = image.map(|image| unit(image, "si_unit_z")).unwrap_or_default();
        let name = match root.get(&format!("/{id}/data/title")) {
            Some(Value::Text(title)) => title.trim().to_owned(),
            _ => format!("image {id}"),
        };
        Channel { name, unit_um: unit_um(&unit), unit }
    };
    let channels: Vec<Channel> = ids.iter().map(channel).collect();
    let (found, note) = choose(&channels, input.channel)?;
    let Some(image) = field(&root, &format!("/{}/data", ids[found])) else {
        return Err(Fault::damaged("its channel is gone"));
    };
    let mut stored = heights(image)?;
    let pixels = (stored.width, stored.rows);
    stored.unit_um = channels[found].unit_um;
    stored.notes = vec!["Gwyddion file".into(), note];
    if let Some(mask) = field(&root, &format!("/{}/mask", ids[found])) {
        let mask = heights(mask)?;
        if (mask.width, mask.rows) != pixels {
            return Err(Fault::damaged("its mask has another size than its image"));
        }
        let mut masked = stored.values.iter_mut().zip(&mask.values).filter(|(_, m)| **m > 0.5).peekable();
        if masked.peek().is_some() {
            masked.for_each(|(v, _)| *v = f64::NAN);
            stored.gaps = Some("are masked".into());
        }
    }
    Ok(stored)
}

/// Values and lateral size of an image.
fn heights(image: &Object) -> Outcome<Stored> {
    let need = |key: &str| number(image, key).ok_or_else(|| Fault::damaged(format!("an image has no {key}")));
    let (width, rows) = size(need("xres")? as i64, need("yres")? as i64)?;
    let Some(Value::Doubles(data)) = image.get("data") else {
        return Err(Fault::damaged("an image has no data"));
    };
    if data.len() != 8 * width * rows {
        return Err(Fault::damaged(format!("an image of {width} x {rows} pixels has {} heights", data.len() / 8)));
    }
    let values = numbers(data, width * rows, Kind::F64, Order::Little)?;
    let lateral = unit(image, "si_unit_xy");
    let real = [need("xreal")? / width as f64, need("yreal")? / rows as f64];
    let pitch = match unit_um(&lateral) {
        Some(unit) => Pitch::Um(real.map(|r| r * unit)),
        None if lateral.is_empty() => Pitch::Bare(real),
        None => {
            let problem = format!("its pixels are measured in {lateral:?}, no unit of length");
            return Err(Fault::unsupported(problem, "name another channel with --channel"));
        }
    };
    Ok(Stored { width, rows, values, pitch, ..Stored::default() })
}

//! Igor binary waves (WaveMetrics technical note 3): version 5 with up to four dimensions, versions 1 to 3 with one.

use super::super::stored::{Pitch, Stored};
use super::super::text::unit::unit_um;
use super::bytes::{Cursor, Kind, Order, latin, numbers};
use super::fault::{Fault, Outcome};
use super::{Channel, Input, choose, size};

/// Bytes of the headers of file and wave in version 5.
const FILE_5: usize = 64;
const WAVE_5: usize = 320;
/// Bytes of the wave header in older versions.
const WAVE_2: usize = 110;
/// Bytes of a dimension label.
const LABEL: usize = 32;

/// Byte order and version.
fn version(bytes: &[u8]) -> Option<(Order, u16)> {
    let word = [*bytes.first()?, *bytes.get(1)?];
    match (u16::from_le_bytes(word), u16::from_be_bytes(word)) {
        (v @ (1 | 2 | 3 | 5), _) => Some((Order::Little, v)),
        (_, v @ (1 | 2 | 3 | 5)) => Some((Order::Big, v)),
        _ => None,
    }
}

/// Bytes of the file header, and offset of its field for the size of the wave.
fn head(version: u16) -> (usize, usize) {
    match version {
        1 => (8, 2),
        2 => (16, 2),
        3 => (20, 2),
        _ => (FILE_5, 4),
    }
}

/// Whether version, number type and size are consistent. The two bytes of the version occur in many other files.
pub(super) fn is(bytes: &[u8]) -> bool {
    let Some((order, version)) = version(bytes) else { return false };
    let (file, field) = head(version);
    let at = |place: usize| Some(Cursor::new(bytes.get(place..)?, order));
    let whole = at(field).and_then(|mut c| c.i32().ok()).unwrap_or(-1);
    let (place, least) = if version == 5 { (file + 16, WAVE_5) } else { (file, WAVE_2) };
    let kind = at(place).and_then(|mut c| c.i16().ok()).unwrap_or(-1);
    whole >= least as i32 && (1..=0x7f).contains(&kind)
}

/// Type of the numbers.
fn kind(code: i16) -> Outcome<Kind> {
    Ok(match code & !0x40 {
        0x02 => Kind::F32,
        0x04 => Kind::F64,
        0x08 if code & 0x40 != 0 => Kind::U8,
        0x08 => Kind::I8,
        0x10 if code & 0x40 != 0 => Kind::U16,
        0x10 => Kind::I16,
        0x20 if code & 0x40 != 0 => Kind::U32,
        0x20 => Kind::I32,
        0 => return Err(Fault::unsupported("it holds text", "export the wave of heights")),
        other if other & 1 == 1 => {
            return Err(Fault::unsupported("it holds complex numbers", "export the wave of heights"));
        }
        other => return Err(Fault::damaged(format!("its numbers are of the unknown type {other}"))),
    })
}

pub(super) fn read(input: &Input) -> Outcome<Stored> {
    match version(input.bytes) {
        Some((order, 5)) => five(input, order),
        Some((order, version)) => old(input, order, version),
        None => Err(Fault::damaged("its version is unknown")),
    }
}

/// Header of version 5.
struct Five {
    formula: usize,
    note: usize,
    long_units: usize,
    long_dims: [usize; 4],
    labels: [usize; 4],
    points: i32,
    kind: Kind,
    dims: [i32; 4],
    steps: [f64; 4],
    unit: String,
    units: [String; 4],
}

impl Five {
    fn read(bytes: &[u8], order: Order) -> Outcome<Self> {
        let mut at = Cursor::new(bytes, order);
        at.take(8)?;
        let mut length = || at.i32().and_then(|n| usize::try_from(n).map_err(|_| Fault::damaged("a size is negative")));
        let (formula, note, long_units) = (length()?, length()?, length()?);
        let long_dims = [length()?, length()?, length()?, length()?];
        let labels = [length()?, length()?, length()?, length()?];
        at.take(12 + 12)?;
        let (points, kind) = (at.i32()?, kind(at.i16()?)?);
        at.take(2 + 6 + 2 + 32 + 4 + 4)?;
        let dims = [at.i32()?, at.i32()?, at.i32()?, at.i32()?];
        let steps = [at.f64()?, at.f64()?, at.f64()?, at.f64()?];
        at.take(32)?;
        let unit = at.field(4)?;
        let units = [at.field(4)?, at.field(4)?, at.field(4)?, at.field(4)?];
        Ok(Self { formula, note, long_units, long_dims, labels, points, kind, dims, steps, unit, units })
    }
}

fn five(input: &Input, order: Order) -> Outcome<Stored> {
    let mut head = Five::read(input.bytes, order)?;
    let [nx, ny, layers, chunks] = head.dims;
    if chunks > 1 || nx < 1 {
        return Err(Fault::unsupported(
            format!("it has {nx} x {ny} x {layers} x {chunks} numbers"),
            "export one image",
        ));
    }
    let (width, rows) = size(nx.into(), ny.max(1).into())?;
    let layers = usize::try_from(layers.max(1)).unwrap_or(1);
    let image = width * rows;
    if usize::try_from(head.points).ok() != image.checked_mul(layers) {
        return Err(Fault::damaged(format!("it has {} numbers in {width} x {rows} x {layers} places", head.points)));
    }
    let begin = FILE_5 + WAVE_5;
    let bytes = image * layers * head.kind.size();
    let mut rest = Cursor::new(input.bytes.get(begin..).unwrap_or_default(), order);
    let data = rest.take(bytes)?;
    let labels = extras(&mut rest, &mut head, layers)?;
    let unit = unit_um(&head.unit);
    let channel = |k: usize| {
        let name = labels.get(k).filter(|l| !l.is_empty()).cloned().unwrap_or_else(|| format!("layer {}", k + 1));
        // All layers, phases and currents among them, share one stated unit.
        let (unit_um, unit) = if is_height(&name) { (unit, head.unit.clone()) } else { (None, "another unit".into()) };
        Channel { name, unit_um, unit }
    };
    let channels: Vec<Channel> = (0..layers.min(256)).map(channel).collect();
    let found = match (head.unit.is_empty(), layers) {
        // Without a unit, --range-um states it.
        (true, 1) => (0, channels[0].name.clone()),
        _ => choose(&channels, input.channel)?,
    };
    let size = head.kind.size();
    let values = numbers(&data[found.0 * image * size..], image, head.kind, order)?;
    let notes = vec!["Igor binary wave, version 5".into(), found.1];
    let step = head.kind.is_integer().then_some(1.0);
    let steps = if rows > 1 { [head.steps[0], head.steps[1]] } else { [head.steps[0]; 2] };
    let pitch = pitch(steps, [&head.units[0], &head.units[usize::from(rows > 1)]])?;
    let stored = Stored { width, rows, values, pitch, unit_um: unit, step, notes, ..Stored::default() };
    Ok(stored.upside_down())
}

/// Whether the layer of this label may hold heights; unknown labels may.
fn is_height(name: &str) -> bool {
    let lower = name.to_lowercase();
    !super::OTHERS
        .iter()
        .chain(&["freq", "dissipation", "bias", "user", "drive", "loss", "tan"])
        .any(|w| lower.contains(w))
}

/// Reads long units, which replace the short ones, and the labels of the layers.
fn extras(rest: &mut Cursor, head: &mut Five, layers: usize) -> Outcome<Vec<String>> {
    rest.take(head.formula)?;
    rest.take(head.note)?;
    let long = |rest: &mut Cursor, bytes: usize, unit: &mut String| -> Outcome<()> {
        let text = latin(rest.take(bytes)?);
        if !text.is_empty() {
            *unit = text;
        }
        Ok(())
    };
    long(rest, head.long_units, &mut head.unit)?;
    for k in 0..4 {
        long(rest, head.long_dims[k], &mut head.units[k])?;
    }
    rest.take(head.labels[0].saturating_add(head.labels[1]))?;
    let labels = rest.take(head.labels[2])?;
    // The first label is that of the whole dimension.
    Ok(labels.chunks(LABEL).skip(1).take(layers).map(latin).collect())
}

fn pitch(steps: [f64; 2], units: [&str; 2]) -> Outcome<Pitch> {
    let steps = steps.map(f64::abs);
    match units.map(unit_um) {
        [Some(a), Some(b)] => Ok(Pitch::Um([steps[0] * a, steps[1] * b])),
        [None, None] if units == ["", ""] => Ok(Pitch::Bare(steps)),
        _ => {
            let problem = format!("its axes are in {:?} and {:?}, no units of length", units[0], units[1]);
            Err(Fault::unsupported(problem, "export an image over lengths"))
        }
    }
}

/// Versions 1 to 3: one dimension, a profile.
fn old(input: &Input, order: Order, version: u16) -> Outcome<Stored> {
    let (begin, _) = head(version);
    let mut at = Cursor::new(input.bytes.get(begin..).unwrap_or_default(), order);
    let kind = kind(at.i16()?)?;
    at.take(4 + 20 + 2 + 2 + 4)?;
    let (unit, x_unit, points) = (at.field(4)?, at.field(4)?, at.i32()?);
    at.take(2)?;
    let step = at.f64()?;
    let (width, _) = size(points.into(), 1)?;
    let data = input.bytes.get(begin + WAVE_2..).unwrap_or_default();
    let values = numbers(data, width, kind, order)?;
    if !unit.is_empty() && unit_um(&unit).is_none() {
        return Err(Fault::unsupported(
            format!("its values are in {unit:?}, no unit of length"),
            "export the wave of heights",
        ));
    }
    let notes = vec![format!("Igor binary wave, version {version}"), format!("profile of {width} points")];
    let pitch = pitch([step; 2], [&x_unit, &x_unit])?;
    let step = kind.is_integer().then_some(1.0);
    Ok(Stored { width, rows: 1, values, pitch, unit_um: unit_um(&unit), step, notes, ..Stored::default() })
}

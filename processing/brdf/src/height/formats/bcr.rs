//! BCR-STM and BCRF files (Image Metrology): a header of `key = value` of fixed size, then 16-bit integers or floats
//! from the top.

use super::super::stored::{Pitch, Stored};
use super::super::text::unit::unit_um;
use super::bytes::{Kind, Order, numbers};
use super::fault::{Fault, Outcome};
use super::keys::Keys;
use super::{Input, size};

/// Largest header in bytes.
const MOST: usize = 1 << 20;

/// Text of the header, and number of bytes per character.
fn head(bytes: &[u8], length: usize) -> (String, usize) {
    let head = &bytes[..bytes.len().min(length) & !1];
    let wide = head.starts_with(&[0xff, 0xfe]) || head.starts_with(b"f\0i\0l\0e\0");
    if wide {
        let units = head.as_chunks::<2>().0.iter().map(|pair| u16::from_le_bytes(*pair));
        let text: String = char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect();
        return (text.trim_start_matches('\u{feff}').to_owned(), 2);
    }
    (head.iter().map(|b| char::from(*b)).collect(), 1)
}

pub(super) fn is(bytes: &[u8]) -> bool {
    let (text, _) = head(bytes, 64);
    let compact: String = text.lines().next().unwrap_or_default().chars().filter(|c| !c.is_whitespace()).collect();
    compact.starts_with("fileformat=bcr")
}

pub(super) fn read(input: &Input) -> Outcome<Stored> {
    let keys_of = |length: usize| {
        let (text, wide) = head(input.bytes, length);
        let mut keys = Keys::default();
        text.split(['\n', '\r']).filter(|l| !l.starts_with(['%', '#'])).for_each(|l| keys.line(l, '='));
        (keys, wide)
    };
    let (first, wide) = keys_of(2048);
    let begin = if first.get("headersize").is_some() { first.integer("headersize")? } else { 2048 };
    let begin = usize::try_from(begin).ok().and_then(|n| n.checked_mul(wide)).filter(|n| *n <= MOST);
    let begin = begin.ok_or_else(|| Fault::damaged("its header size makes no sense"))?;
    let (keys, _) = keys_of(begin);
    let kind = match keys.need("fileformat")? {
        "bcrf" | "bcrf_unicode" => Kind::F32,
        "bcrstm" | "bcrstm_unicode" => Kind::I16,
        other => return Err(Fault::unsupported(format!("it is of the variant {other:.20}"), "export it as bcrf")),
    };
    let (width, rows) = size(keys.integer("xpixels")?, keys.integer("ypixels")?)?;
    let order = if keys.get("intelmode") == Some("0") { Order::Big } else { Order::Little };
    let mut values = numbers(input.bytes.get(begin..).unwrap_or_default(), width * rows, kind, order)?;
    let void = keys.get("voidpixels").and_then(|v| v.parse::<f64>().ok()).filter(|v| *v != 0.0);
    // Some files state the value of invalid points, others their number; these mark invalid points by the largest
    // integer.
    let void = void.map(|v| if kind.is_integer() && v.abs() < 32_767.0 { 32_767.0 } else { v });
    // In floats, the largest value marks gaps.
    values.iter_mut().filter(|v| Some(**v) == void || v.abs() > 1.7e38).for_each(|v| *v = f64::NAN);
    let unit = |key: &str| unit_um(keys.get(key).unwrap_or("nm"));
    let (Some(x), Some(y)) = (unit("xunit"), unit("yunit")) else {
        return Err(Fault::unsupported("its pixels are not measured in lengths", "export an image over lengths"));
    };
    let Some(z) = unit("zunit") else {
        let problem = format!("it holds values in {}", keys.get("zunit").unwrap_or_default());
        return Err(Fault::unsupported(problem, "export the image of heights"));
    };
    let scale = if keys.get("bit2nm").is_some() { keys.number("bit2nm")? } else { 1.0 };
    let pitch = [x * keys.number("xlength")? / width as f64, y * keys.number("ylength")? / rows as f64];
    let gaps = Some("are void pixels".into());
    let step = kind.is_integer().then_some(1.0);
    let notes = vec!["BCR-STM file".into()];
    Ok(Stored { width, rows, values, pitch: Pitch::Um(pitch), unit_um: Some(z * scale), step, notes, gaps })
}

//! Nanoscope files of Digital Instruments, Veeco and Bruker, version 4.3 and newer: a text header, then images of
//! integers, lowest line first. Height = value / 2^bits · hard scale · sensitivity.

use super::super::stored::{Pitch, Stored, ends};
use super::super::text::unit::{quantity, unit_um};
use super::bytes::{Kind, Order, latin, numbers};
use super::fault::{Fault, Outcome};
use super::keys::Keys;
use super::{Channel, Input, choose, size};

/// Largest header in bytes.
const HEADER: usize = 4 << 20;

/// Largest value, with some margin, of a 16-bit image in 32-bit fields.
const SHORT: f64 = 40_000.0;

pub(super) fn is(bytes: &[u8]) -> bool {
    [&b"\\*File list"[..], b"\\*Force file list", b"\\*EC File list", b"*File list"]
        .iter()
        .any(|magic| bytes.starts_with(magic))
}

/// Sections of the header in their order.
fn sections(bytes: &[u8]) -> Vec<(String, Keys)> {
    let head = &bytes[..bytes.len().min(HEADER)];
    let mut all: Vec<(String, Keys)> = vec![];
    for line in head.split(|b| *b == b'\n') {
        let line = latin(line);
        if let Some(name) = line.strip_prefix("\\*") {
            if name.eq_ignore_ascii_case("File list end") {
                break;
            }
            all.push((name.trim().to_lowercase(), Keys::default()));
        } else if let (Some(pair), Some((_, keys))) = (line.strip_prefix('\\'), all.last_mut()) {
            let (key, value) = pair.split_once(": ").unwrap_or((pair.trim_end_matches(':'), ""));
            keys.add(key, value);
        } else if !all.is_empty() && !line.is_empty() {
            break;
        }
    }
    all
}

/// Image of the file.
struct Image {
    offset: usize,
    length: usize,
    stated: usize,
    width: usize,
    rows: usize,
    pitch: Pitch,
    channel: Channel,
}

pub(super) fn read(input: &Input) -> Outcome<Stored> {
    let remedy = "open it in NanoScope Analysis and save the image of heights";
    if !input.bytes.starts_with(b"\\*File list") {
        return Err(Fault::unsupported("it holds force curves, or is older than version 4.3", remedy));
    }
    let sections = sections(input.bytes);
    let lists: Vec<&Keys> =
        sections.iter().filter(|(name, _)| name == "ciao image list").map(|(_, keys)| keys).collect();
    if lists.is_empty() {
        return Err(Fault::unsupported("it holds no image that version 4.3 or newer wrote", remedy));
    }
    let images = lists.iter().map(|list| image(list, &sections)).collect::<Outcome<Vec<_>>>()?;
    let channel = |c: &Channel| Channel { name: c.name.clone(), unit_um: c.unit_um, unit: c.unit.clone() };
    let channels: Vec<Channel> = images.iter().map(|i| channel(&i.channel)).collect();
    let (found, note) = choose(&channels, input.channel)?;
    let image = &images[found];
    let (values, bits) = values(input.bytes, image)?;
    let unit_um = channels[found].unit_um.map(|whole| whole / 2_f64.powi(bits));
    Ok(Stored {
        width: image.width,
        rows: image.rows,
        values,
        pitch: image.pitch,
        unit_um,
        step: Some(1.0),
        notes: vec![format!("Nanoscope file, {bits}-bit heights"), note],
        gaps: None,
    }
    .upside_down())
}

/// Integers of an image, and the number of bits of its full scale.
fn values(bytes: &[u8], image: &Image) -> Outcome<(Vec<f64>, i32)> {
    let count = image.width * image.rows;
    let size = match image.length / count {
        2 | 3 => 2,
        4.. => 4,
        _ => {
            let problem = format!("an image of {} x {} pixels has {} bytes", image.width, image.rows, image.length);
            return Err(Fault::damaged(problem));
        }
    };
    // Newer programs state 2 bytes but write 4.
    let size = if image.length == count * image.stated { image.stated } else { size };
    let data = bytes.get(image.offset..).unwrap_or_default();
    let text = |b: &u8| b.is_ascii_digit() || b.is_ascii_whitespace() || b"+-.,;eE".contains(b);
    if data.iter().take(count * size).all(text) {
        return Err(Fault::unsupported(
            "its heights are text",
            "save it in the Nanoscope format, or remove the header",
        ));
    }
    let kind = if size == 4 { Kind::I32 } else { Kind::I16 };
    let values = numbers(data, count, kind, Order::Little)?;
    let [low, high] = ends(&values);
    let bits = if size == 4 && (image.stated == 4 || low.abs().max(high.abs()) > SHORT) { 32 } else { 16 };
    Ok((values, bits))
}

fn image(list: &Keys, sections: &[(String, Keys)]) -> Outcome<Image> {
    let (width, rows) = size(list.integer("samps/line")?, list.integer("number of lines")?)?;
    let whole =
        |key: &str| usize::try_from(list.integer(key)?).map_err(|_| Fault::damaged(format!("{key} is negative")));
    let stated = whole("bytes/pixel")?;
    if !matches!(stated, 2 | 4) {
        return Err(Fault::damaged(format!("its numbers have {stated} bytes")));
    }
    let name = list.ending("image data").unwrap_or_default();
    let name = name.split('"').nth(1).or_else(|| name.split(['[', ']']).nth(1)).unwrap_or(name).to_owned();
    let (unit_um, unit) = z_scale(list, sections)?;
    let channel = Channel { name, unit_um, unit };
    let pitch = pitch(list, sections, [width, rows])?;
    Ok(Image { offset: whole("data offset")?, length: whole("data length")?, stated, width, rows, pitch, channel })
}

/// Full scale in µm (if a length) and unit, from `V [Sens. Zsens] (0.006713867 V/LSB) 440.0 V` and
/// `@Sens. Zsens: V 14.2 nm/V`.
fn z_scale(list: &Keys, sections: &[(String, Keys)]) -> Outcome<(Option<f64>, String)> {
    let wrong = |text: &str| Fault::damaged(format!("its Z scale {text:.60} cannot be read"));
    let text = list.ending(":z scale").or_else(|| list.get("@z scale")).ok_or_else(|| wrong("is missing; it"))?;
    let soft = text.split_once('[').and_then(|(_, rest)| rest.split_once(']')).map(|(name, _)| name.trim());
    let after = text.rsplit_once(')').map_or(text, |(_, after)| after);
    let after = after.trim_start_matches(|c: char| c == 'V' || c.is_whitespace());
    let (hard, hard_unit) = quantity(after).ok_or_else(|| wrong(text))?;
    let Some(soft) = soft.filter(|name| !name.is_empty()) else {
        return Ok((unit_um(hard_unit).map(|um| hard * um), hard_unit.to_owned()));
    };
    let key = format!("@{}", soft.to_lowercase());
    let Some(value) = sections.iter().find_map(|(_, keys)| keys.get(&key)) else {
        return Ok((None, format!("a unit of {soft}, which its header does not state")));
    };
    let value = value.trim_start_matches(|c: char| c == 'V' || c.is_whitespace());
    let (factor, unit) = quantity(value).ok_or_else(|| wrong(value))?;
    let (length, per) = unit.split_once('/').unwrap_or((unit, ""));
    let volts = |unit: &str| match unit.trim() {
        "V" => Some(1.0),
        "mV" => Some(1e-3),
        _ => None,
    };
    let ratio = match (volts(hard_unit), volts(per)) {
        (Some(hard), Some(per)) => Some(hard / per),
        _ => (hard_unit.trim() == per.trim()).then_some(1.0),
    };
    Ok((unit_um(length).zip(ratio).map(|(um, ratio)| hard * factor * um * ratio), unit.to_owned()))
}

/// Pixel pitch from the image's `Scan Size: 10 10 ~m`, or one number for both axes.
fn pitch(list: &Keys, sections: &[(String, Keys)], [width, rows]: [usize; 2]) -> Outcome<Pitch> {
    let scan =
        || sections.iter().filter(|(name, _)| name.contains("scan list")).find_map(|(_, keys)| keys.get("scan size"));
    let text = list.get("scan size").or_else(scan).ok_or_else(|| Fault::damaged("its header has no Scan Size"))?;
    let wrong = || Fault::damaged(format!("its Scan Size is {text:.40}"));
    let (across, rest) = quantity(text).ok_or_else(wrong)?;
    let (down, unit) = match quantity(rest) {
        Some((down, unit)) => (Some(down), unit),
        None => (None, rest),
    };
    let unit = unit_um(unit).ok_or_else(wrong)?;
    let pixel = across * unit / width as f64;
    Ok(Pitch::Um([pixel, down.map_or(pixel, |d| d * unit / rows as f64)]))
}

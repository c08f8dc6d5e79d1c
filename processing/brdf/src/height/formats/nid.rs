//! Nanosurf files (`.nid`, `.ezd`): sections of `key=value`, then `#!` and the images in the order of their groups,
//! lowest line first.

use super::super::stored::{Pitch, Stored};
use super::super::text::unit::unit_um;
use super::bytes::{Kind, Order, latin, numbers};
use super::fault::{Fault, Outcome};
use super::keys::Keys;
use super::{Channel, Input, choose, size};

/// Largest number of groups, and of images per group.
const MOST: i64 = 64;

pub(super) fn is(bytes: &[u8]) -> bool {
    bytes.starts_with(b"[DataSet]")
}

/// Image and its position in the file.
struct Image<'a> {
    keys: &'a Keys,
    offset: usize,
    width: usize,
    rows: usize,
    kind: Kind,
}

pub(super) fn read(input: &Input) -> Outcome<Stored> {
    let Some(end) = input.bytes.windows(2).position(|w| w == b"#!") else {
        return Err(Fault::Truncated("its header has no end (#!)".into()));
    };
    let (head, data) = (&input.bytes[..end], &input.bytes[end + 2..]);
    let mut sections: Vec<(String, Keys)> = vec![];
    for line in head.split(|b| *b == b'\n').map(latin) {
        if let Some(name) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
            sections.push((name.to_owned(), Keys::default()));
        } else if let Some((_, keys)) = sections.last_mut() {
            keys.line(&line, '=');
        }
    }
    let images = images(&sections)?;
    if images.is_empty() {
        return Err(Fault::unsupported("it holds no image", "export an image of heights"));
    }
    let channel = |image: &Image| {
        let unit = image.keys.get("dim2unit").unwrap_or_default().to_owned();
        let [frame, name] = ["frame", "dim2name"].map(|key| image.keys.get(key).unwrap_or_default());
        Channel { name: format!("{frame} ({name})"), unit_um: unit_um(&unit), unit }
    };
    let channels: Vec<Channel> = images.iter().map(channel).collect();
    let (found, note) = choose(&channels, input.channel)?;
    let Image { keys, offset, width, rows, kind } = images[found];
    let order = if keys.get("saveorder") == Some("Motorola") { Order::Big } else { Order::Little };
    let values = numbers(data.get(offset..).unwrap_or_default(), width * rows, kind, order)?;
    let unit = |key: &str| unit_um(keys.get(key).unwrap_or_default());
    let [Some(x), Some(y)] = [unit("dim0unit"), unit("dim1unit")] else {
        return Err(Fault::unsupported(
            "its image is not measured over lengths",
            "name another channel with --channel",
        ));
    };
    let pitch = [x * keys.number("dim0range")? / width as f64, y * keys.number("dim1range")? / rows as f64];
    let full = keys.number("dim2range")? / 2_f64.powi(8 * kind.size() as i32);
    Ok(Stored {
        width,
        rows,
        values,
        pitch: Pitch::Um(pitch),
        unit_um: channels[found].unit_um.map(|um| um * full),
        step: Some(1.0),
        notes: vec!["Nanosurf file".into(), note],
        gaps: None,
    }
    .upside_down())
}

fn images(sections: &[(String, Keys)]) -> Outcome<Vec<Image<'_>>> {
    let section = |name: &str| sections.iter().find(|(known, _)| known == name).map(|(_, keys)| keys);
    let Some(set) = section("DataSet") else { return Err(Fault::damaged("it has no section DataSet")) };
    let (mut all, mut offset) = (vec![], 0_usize);
    for group in 0..set.integer("groupcount")?.clamp(0, MOST) {
        let count = set.integer(&format!("gr{group}-count")).unwrap_or(0);
        for channel in 0..count.clamp(0, MOST) {
            let name = set.get(&format!("gr{group}-ch{channel}"));
            let Some(keys) = name.and_then(section) else { continue };
            if keys.get("savemode").is_some_and(|mode| mode != "Binary") {
                return Err(Fault::unsupported("its images are saved as text", "save it as binary"));
            }
            let (width, rows) = size(keys.integer("points")?, keys.integer("lines")?)?;
            let bytes = usize::try_from(keys.integer("savebits")? / 8).unwrap_or(0);
            let signed = keys.get("savesign") == Some("Signed");
            let kind =
                Kind::integer(bytes, signed).ok_or_else(|| Fault::damaged("its numbers have an unknown size"))?;
            all.push(Image { keys, offset, width, rows, kind });
            offset = offset.saturating_add(width * rows * bytes);
        }
    }
    Ok(all)
}

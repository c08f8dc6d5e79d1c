//! Files of AFMs and profilometers, one module per format, recognised by their content.

mod bcr;
mod bytes;
pub(super) mod fault;
mod gwy;
mod ibw;
mod keys;
mod nanoscope;
mod nid;
mod others;
mod sdf;
mod surfer;
#[cfg(test)]
mod tests;
mod x3p;

use super::stored::Stored;
use fault::{Fault, Outcome};

/// File in memory, and the requested channel.
pub(super) struct Input<'a> {
    pub bytes: &'a [u8],
    pub channel: Option<&'a str>,
}

/// Format: its name in messages, its recognition, and its reader.
pub(super) struct Format {
    pub name: &'static str,
    pub is: fn(&[u8]) -> bool,
    pub read: fn(&Input) -> Outcome<Stored>,
}

/// All supported formats.
pub(super) const FORMATS: &[Format] = &[
    Format { name: "Gwyddion file (.gwy)", is: gwy::is, read: gwy::read },
    Format { name: "Igor binary wave (.ibw)", is: ibw::is, read: ibw::read },
    Format { name: "X3P file (ISO 25178-72)", is: x3p::is, read: x3p::read },
    Format { name: "Nanoscope file (Bruker)", is: nanoscope::is, read: nanoscope::read },
    Format { name: "SDF file (ISO 25178-71)", is: sdf::is, read: sdf::read },
    Format { name: "Nanosurf file (.nid)", is: nid::is, read: nid::read },
    Format { name: "Surfer grid", is: surfer::is, read: surfer::read },
    Format { name: "BCR-STM file", is: bcr::is, read: bcr::read },
];

/// Format of a file by its content.
pub(super) fn recognise(bytes: &[u8]) -> Option<&'static Format> {
    FORMATS.iter().find(|format| (format.is)(bytes))
}

pub(super) use others::name as unread;

/// Channel of a file.
pub(super) struct Channel {
    pub name: String,
    /// µm per unit of its values, if these are lengths.
    pub unit_um: Option<f64>,
    /// Unit as written in the file.
    pub unit: String,
}

/// Words in the names of height channels, best first, and of other channels with units of length.
const HEIGHTS: &[&str] =
    &["height", "topograph", "zsensor", "z sensor", "z-axis", "höhe", "hauteur", "altura", "topo", "surface"];
const OTHERS: &[&str] =
    &["amplitude", "deflection", "error", "phase", "friction", "lateral", "current", "adhesion", "potential"];

/// Requested channel (by name or number from 1), or else the first height channel; with a note for the report.
pub(super) fn choose(channels: &[Channel], wish: Option<&str>) -> Outcome<(usize, String)> {
    let names = || channels.iter().map(|c| c.name.as_str()).take(24).collect::<Vec<_>>().join(", ");
    let wrong = |problem: String| Fault::unsupported(problem, "name a channel of heights with --channel");
    let found = match wish {
        Some(wish) => {
            let lower = wish.trim().to_lowercase();
            let named = channels.iter().position(|c| c.name.to_lowercase() == lower);
            let number = lower.parse::<usize>().ok().and_then(|n| n.checked_sub(1)).filter(|n| *n < channels.len());
            let found = named.or(number).ok_or_else(|| wrong(format!("it has no channel {wish}, but {}", names())))?;
            if channels[found].unit_um.is_none() {
                let (name, unit) = (&channels[found].name, &channels[found].unit);
                return Err(wrong(format!("its channel {name} holds values in {unit:?}, no heights")));
            }
            found
        }
        None => best(channels).ok_or_else(|| wrong(format!("it holds no channel of heights, but {}", names())))?,
    };
    let name = &channels[found].name;
    let note = match channels.len() {
        1 => format!("channel {name}"),
        n => format!("channel {name} ({} of {n}: {})", found + 1, names()),
    };
    Ok((found, note))
}

fn best(channels: &[Channel]) -> Option<usize> {
    let holds = |c: &Channel, words: &[&str]| words.iter().any(|w| c.name.to_lowercase().contains(w));
    let lengths = || channels.iter().enumerate().filter(|(_, c)| c.unit_um.is_some());
    let plain = || lengths().filter(|(_, c)| !holds(c, OTHERS));
    let named = HEIGHTS.iter().find_map(|word| plain().find(|(_, c)| holds(c, &[word])));
    named.or_else(|| plain().next()).map(|(k, _)| k)
}

/// Size of an image from numbers in a file.
pub(super) fn size(width: i64, rows: i64) -> Outcome<(usize, usize)> {
    let side = |n: i64| usize::try_from(n).ok().filter(|n| (1..=1 << 24).contains(n));
    match (side(width), side(rows)) {
        (Some(w), Some(h)) if w.saturating_mul(h) <= super::MAX_PIXELS => Ok((w, h)),
        (Some(_), Some(_)) => {
            let problem = format!("it has {width} x {rows} pixels, more than {} Mpixel", super::MAX_PIXELS >> 20);
            Err(Fault::unsupported(problem, "crop it"))
        }
        _ => Err(Fault::damaged(format!("it says that it has {width} x {rows} pixels"))),
    }
}

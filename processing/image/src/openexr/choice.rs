//! Choice of the picture in an OpenEXR file: layers, views and parts by their names.

use exr::meta::header::Header;

use super::{EXPORT, utf8};
use crate::fault::{Decoded, Fault};

/// Last components of layer names that denote the complete picture among render passes (Blender, renderers).
const WHOLE: [&str; 3] = ["combined", "beauty", "rgba"];

/// Channels of a picture by their indices in the header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Channels {
    Grey(usize),
    Rgb([usize; 3]),
    /// Luminance Y, and the differences (R - Y)/Y and (B - Y)/Y.
    Chroma([usize; 3]),
}

impl Channels {
    /// Number of channels of the picture: 1 (grey) or 3.
    pub(super) fn count(self) -> usize {
        if matches!(self, Self::Grey(_)) { 1 } else { 3 }
    }
}

/// Picture in a file.
#[derive(Clone, Debug)]
pub(super) struct Choice {
    /// Index of its header.
    pub header: usize,
    pub channels: Channels,
    pub notes: Vec<String>,
}

struct Candidate {
    header: usize,
    /// Name of its part, layer and view; empty if it is the only picture.
    name: String,
    /// Whether its channel names have no layer prefix.
    root: bool,
    channels: Channels,
}

/// Chooses the picture named `wanted`, or else the only one or the main one of the file.
///
/// # Errors
/// If there is no picture, or none of several is named; `remedy` describes how to name one.
pub(super) fn choose(headers: &[Header], wanted: Option<&str>, remedy: &'static str) -> Decoded<Choice> {
    let candidates = candidates(headers);
    let names = || candidates.iter().map(|c| shown(&c.name)).collect::<Vec<_>>().join(", ");
    let chosen = match (wanted, candidates.as_slice()) {
        (_, []) => return only_channel(headers),
        (Some(wanted), all) => {
            let exact = all.iter().find(|c| c.name == wanted);
            let similar = || all.iter().find(|c| c.name.eq_ignore_ascii_case(wanted));
            exact.or_else(similar).ok_or_else(|| {
                Fault::unusable(format!("has no layer {wanted:?} with a picture; it has {}", names()), remedy)
            })?
        }
        (None, [only]) => only,
        (None, all) => main(headers, all)
            .ok_or_else(|| Fault::unusable(format!("has {} pictures: {}", all.len(), names()), remedy))?,
    };
    let mut notes = vec![];
    if candidates.len() > 1 && wanted.is_none() {
        let others = candidates.iter().filter(|c| c.name != chosen.name).map(|c| shown(&c.name));
        let others: Vec<String> = others.collect();
        notes.push(format!("shows the layer {}; not {}", shown(&chosen.name), others.join(", ")));
    }
    Ok(Choice { header: chosen.header, channels: chosen.channels, notes })
}

fn shown(name: &str) -> String {
    if name.is_empty() { "R, G, B without a layer".into() } else { format!("{name:?}") }
}

/// Picture without a layer name (the default view), or the only one whose name denotes the complete picture.
fn main<'a>(headers: &[Header], all: &'a [Candidate]) -> Option<&'a Candidate> {
    let only = |mut of: Box<dyn Iterator<Item = &'a Candidate> + 'a>| of.next().filter(|_| of.next().is_none());
    let whole = |c: &&Candidate| {
        let last = c.name.rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
        WHOLE.contains(&last.as_str())
    };
    let root = if headers.len() == 1 { only(Box::new(all.iter().filter(|c| c.root))) } else { None };
    root.or_else(|| only(Box::new(all.iter().filter(whole))))
}

/// The only channel of a file without R, G and B, whatever its name.
fn only_channel(headers: &[Header]) -> Decoded<Choice> {
    let flat = headers.iter().position(|header| !header.deep);
    let header = flat.ok_or_else(|| Fault::unusable("has only deep layers, which are not read", EXPORT))?;
    let names: Vec<String> = headers[header].channels.list.iter().map(|c| utf8(&c.name)).collect();
    if names.len() == 1 {
        return Ok(Choice { header, channels: Channels::Grey(0), notes: vec![] });
    }
    let problem = format!("has the channels {}; a picture has R, G and B, or one channel", names.join(", "));
    Err(Fault::unusable(problem, EXPORT))
}

/// All pictures of all flat parts.
fn candidates(headers: &[Header]) -> Vec<Candidate> {
    let mut all: Vec<Candidate> = vec![];
    for (index, header) in headers.iter().enumerate().filter(|(_, header)| !header.deep) {
        let names: Vec<String> = header.channels.list.iter().map(|c| utf8(&c.name)).collect();
        let mut layers: Vec<&str> = names.iter().map(|name| split(name).0).collect();
        layers.sort_unstable();
        layers.dedup();
        let part =
            header.own_attributes.layer_name.as_ref().filter(|_| headers.len() > 1).map(utf8).unwrap_or_default();
        for layer in layers {
            let Some(channels) = picture(&names, layer) else { continue };
            let name = match (part.as_str(), layer) {
                (part, layer) if layer.starts_with(part) => layer.to_owned(),
                (part, "") => part.to_owned(),
                (part, layer) => format!("{part}.{layer}"),
            };
            all.push(Candidate { header: index, name, root: layer.is_empty(), channels });
        }
    }
    // Parts of several views may share a name.
    for k in 0..all.len() {
        let view = headers[all[k].header].own_attributes.view_name.as_ref().map(utf8);
        if let Some(view) = view.filter(|_| all.iter().filter(|c| c.name == all[k].name).count() > 1) {
            all[k].name = if all[k].name.is_empty() { view } else { format!("{}.{view}", all[k].name) };
        }
    }
    all
}

/// Layer and name of a channel: `ViewLayer.Combined` and `R` for `ViewLayer.Combined.R`.
fn split(name: &str) -> (&str, &str) {
    name.rsplit_once('.').unwrap_or(("", name))
}

/// Picture of a layer: R, G and B, or Y with or without RY and BY. X, Y, Z are a vector, not a colour.
fn picture(names: &[String], layer: &str) -> Option<Channels> {
    let find = |wanted: &str| {
        names.iter().position(|name| {
            let (own, name) = split(name);
            own == layer && name.eq_ignore_ascii_case(wanted)
        })
    };
    let three = |[a, b, c]: [&str; 3]| Some([find(a)?, find(b)?, find(c)?]);
    let rgb = three(["R", "G", "B"]).or_else(|| three(["red", "green", "blue"])).map(Channels::Rgb);
    let chroma = three(["Y", "RY", "BY"]).map(Channels::Chroma);
    let grey = find("Y").filter(|_| find("X").is_none()).map(Channels::Grey);
    rgb.or(chroma).or(grey)
}

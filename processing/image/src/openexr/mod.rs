//! OpenEXR input: one flat layer within its display window, any compression; half, float or integer samples as `f32`.

mod choice;
mod chroma;
mod layer;
mod rows;

use std::collections::BTreeMap;
use std::path::Path;

use exr::meta::attribute::{AttributeValue, EnvironmentMap, Text};
use exr::meta::header::Header;

use super::fault::{Decoded, Fault};
use super::light::{Light, Samples3};
use super::primaries::Primaries;
use super::raster::{Depth, Info, Raster, Samples, zeroed};
use super::source::{Source, decode, open};
use choice::Channels;
use layer::Layer;
use nacre_base::{Error, Result};

pub use rows::{ExrHeader, read_exr_header, read_exr_rows};

/// Remedy for unsupported features of OpenEXR.
const EXPORT: &str = "export it as OpenEXR with R, G and B in one flat layer";

/// Remedy for a photograph with several pictures.
const SEPARATE: &str = "export the layer that you mean as a file of its own";

/// EXR file as named planes.
#[derive(Debug, Clone, PartialEq)]
pub struct ExrMap {
    /// Pixels per row.
    pub width: usize,
    /// Number of rows.
    pub height: usize,
    /// One plane of `width · height` values per channel, row 0 on top.
    pub channels: BTreeMap<String, Vec<f32>>,
    /// Custom text and number attributes, as text.
    pub attributes: BTreeMap<String, String>,
}

impl ExrMap {
    /// Removes a channel from the map that was read from `path`, and returns it.
    ///
    /// # Errors
    /// `Input` if there is no channel of that name.
    pub fn take(&mut self, name: &str, path: &Path) -> Result<Vec<f32>> {
        self.channels
            .remove(name)
            .ok_or_else(|| Error::file(path, format!("has no channel {name}"), "give a map that has one"))
    }
}

/// Reads all channels and attributes of the first flat layer of an EXR file. Pixels outside of its data window are NaN.
///
/// # Errors
/// `Error::Input` if the file cannot be read, is not an EXR, is damaged, or exceeds the size limits.
pub fn read_exr(path: &Path) -> Result<ExrMap> {
    decode(path, || read_map(open(path)?))
}

fn read_map(source: Source) -> Decoded<ExrMap> {
    let layer = Layer::first(source)?;
    let [width, height] = layer.window.size;
    let count = layer.header().channels.list.len();
    let mut planes = (0..count).map(|_| zeroed::<f32>(width * height)).collect::<Decoded<Vec<_>>>()?;
    if !layer.window.is_full() {
        planes.iter_mut().for_each(|plane| plane.fill(f32::NAN));
    }
    let names: Vec<String> = layer.header().channels.list.iter().map(|c| utf8(&c.name)).collect();
    let attributes = attributes(layer.header());
    layer.decode(|channel, start, line| {
        let plane = &mut planes[channel][start..start + line.len()];
        plane.copy_from_slice(line);
    })?;
    Ok(ExrMap { width, height, channels: names.into_iter().zip(planes).collect(), attributes })
}

/// Reads one channel of the first flat layer of an EXR file and its number of pixels per row; `None` if there is no
/// channel of that name. The other channels take no memory.
///
/// # Errors
/// As [`read_exr`].
pub fn read_exr_channel(path: &Path, name: &str) -> Result<Option<(Vec<f32>, usize)>> {
    decode(path, || {
        let layer = Layer::first(open(path)?)?;
        let [width, height] = layer.window.size;
        let Some(wanted) = layer.header().channels.list.iter().position(|c| utf8(&c.name) == name) else {
            return Ok(None);
        };
        let mut plane = zeroed::<f32>(width * height)?;
        if !layer.window.is_full() {
            plane.fill(f32::NAN);
        }
        layer.decode(|channel, start, line| {
            if channel == wanted {
                plane[start..start + line.len()].copy_from_slice(line);
            }
        })?;
        Ok(Some((plane, width)))
    })
}

fn attributes(header: &Header) -> BTreeMap<String, String> {
    let all = header.own_attributes.other.iter().chain(&header.shared_attributes.other);
    let known = all.filter_map(|(name, value)| Some((utf8(name), plain(value)?)));
    let standard = [("comments", &header.own_attributes.comments), ("software", &header.own_attributes.software_name)];
    let standard = standard.into_iter().filter_map(|(name, text)| Some((name.to_string(), utf8(text.as_ref()?))));
    known.chain(standard).collect()
}

fn plain(value: &AttributeValue) -> Option<String> {
    match value {
        AttributeValue::F64(x) => Some(x.to_string()),
        AttributeValue::F32(x) => Some(x.to_string()),
        AttributeValue::I32(x) => Some(x.to_string()),
        AttributeValue::Text(x) => Some(utf8(x)),
        _ => None,
    }
}

fn utf8(text: &Text) -> String {
    String::from_utf8_lossy(text.as_slice()).into_owned()
}

pub(super) fn layer_size(source: Source) -> Decoded<[usize; 2]> {
    layer::size(source)
}

pub(super) fn info(source: Source) -> Decoded<Info> {
    let (_, choice, [width, height]) = chroma::open(source, None, SEPARATE)?;
    Ok(Info { width, height, channels: choice.channels.count(), depth: Depth::F32 })
}

/// Reads a photograph in the primaries of the file, black outside of its data window.
pub(super) fn read(source: Source) -> Decoded<Raster> {
    let (opened, choice, [width, height]) = chroma::open(source, None, SEPARATE)?;
    let info = Info { width, height, channels: choice.channels.count(), depth: Depth::F32 };
    info.raster(Samples::F32(opened.picture(&choice)?))
}

/// Attributes that name the colour space of a file.
const SPACES: [&str; 3] = ["colorInteropID", "oiio:ColorSpace", "colorSpace"];

/// Primaries by the chromaticities of a header, or by the name of its colour space. Names of non-linear spaces are
/// noted.
fn primaries(header: &Header, notes: &mut Vec<String>) -> Option<Primaries> {
    if let Some(chromaticities) = header.shared_attributes.chromaticities {
        return Some(Primaries::from_exr(chromaticities));
    }
    let attributes = attributes(header);
    let (key, space) = SPACES.iter().find_map(|key| Some((key, attributes.get(*key)?)))?;
    let primaries = Primaries::of_space(space);
    if primaries.is_none() {
        notes.push(format!("{key} is {space:?}, which is not a known linear space; read as linear Rec. 709"));
    }
    primaries
}

/// Reads a light source with notes on the file; `layer` names one of several pictures.
pub(super) fn read_light(source: Source, layer: Option<&str>) -> Decoded<Light> {
    let name_it =
        "name one (layer = \"NAME\" of a light in a scene, --layer NAME of nacre factor), or export it as a file";
    let (opened, choice, size) = chroma::open(source, layer, name_it)?;
    let header = opened.header();
    if header.own_attributes.environment_map == Some(EnvironmentMap::Cube) {
        let remedy = "convert it to a lat-long (equirectangular) picture";
        return Err(Fault::unusable("is an environment on the faces of a cube", remedy));
    }
    let mut notes = choice.notes.clone();
    notes.extend(opened.window().note());
    let primaries = primaries(header, &mut notes);
    let samples = opened.picture(&choice)?;
    let samples = match choice.channels {
        Channels::Grey(_) => Samples3::Grey(samples),
        _ => Samples3::Rgb(samples),
    };
    Light::new(size, samples, primaries, notes)
}

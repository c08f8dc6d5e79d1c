//! Maps as 16-bit PNGs with a JSON description, for programs without EXR support.
//!
//! A PNG sample has 16 bits and a value 32. `exact` therefore writes two pictures per channel: the upper and the lower
//! half of a value's bits, in an order-preserving encoding. The upper picture alone shows the map, with larger values
//! brighter. Every value is restored to the bit, including NaN. `linear` writes one picture with a stated step;
//! restored values differ by at most half a step.

use super::asset::{Kind, MOST_PIXELS, Map, Maps};
use nacre_base::text::{from_json, read_text};
use nacre_base::{Error, Result};
use nacre_image::{OutputFolder, Samples, info, read, write_png16_gray};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Component, Path};

/// File name of the description.
pub const PACK: &str = "maps.json";

/// Maximum size of the description in bytes, and maximum number of channels.
const MAX_BYTES: u64 = 1 << 20;
const MOST_CHANNELS: usize = 32;

/// Sample value of unknown pixels in a `linear` picture.
const UNKNOWN: u16 = 65_535;

/// Encoding of values as 16-bit samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Encoding {
    /// Two pictures per channel, nothing lost.
    #[default]
    Exact,
    /// One picture per channel, rounded to 65,535 steps.
    Linear,
}

/// The description.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Pack {
    /// Version of this format: 1.
    nacre_maps: u32,
    width: usize,
    height: usize,
    /// Explanation of the encodings, for human readers.
    #[serde(default)]
    about: BTreeMap<String, String>,
    maps: BTreeMap<String, PackedMap>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PackedMap {
    attributes: BTreeMap<String, String>,
    channels: BTreeMap<String, PackedChannel>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, tag = "encoding", rename_all = "lowercase")]
enum PackedChannel {
    Exact { high: String, low: String },
    Linear { file: String, zero: f64, step: f64 },
}

fn about() -> BTreeMap<String, String> {
    [
        (
            "exact",
            "bits = high * 65536 + low; a float's bits are bits ^ 0x80000000 where high >= 32768, else ~bits (32 bits)",
        ),
        ("linear", "value = zero + step * sample; 65535 is unknown (NaN)"),
        ("rows", "row 0 on top; orientation in rad, [0, pi), anticlockwise from right; period in µm"),
    ]
    .map(|(k, v)| (k.to_owned(), v.to_owned()))
    .into()
}

/// Order-preserving bits: larger values have larger bits.
fn ordered(value: f32) -> u32 {
    let bits = value.to_bits();
    if bits >> 31 == 1 { !bits } else { bits ^ 0x8000_0000 }
}

/// Inverse of [`ordered`].
fn value(ordered: u32) -> f32 {
    f32::from_bits(if ordered >> 31 == 1 { ordered ^ 0x8000_0000 } else { !ordered })
}

/// Writes maps as PNGs with `maps.json` into a folder.
///
/// # Errors
/// `Output` if writing fails. `Input` for channel names that are no valid file names, and for infinite values with
/// `linear`.
pub fn export(maps: &Maps, encoding: Encoding, folder: &OutputFolder) -> Result<()> {
    let mut packed = BTreeMap::new();
    for (kind, map) in &maps.maps {
        let mut channels = BTreeMap::new();
        for (name, plane) in map.planes(*kind) {
            if !plain(name) {
                let problem = format!("{name:?} cannot be a file name");
                return Err(Error::input(kind.name(), problem, "rename the channel to letters, digits, - and _"));
            }
            let stem = format!("{}.{name}", kind.name());
            let write =
                |file: &str, samples: &[u16]| write_png16_gray(&folder.path(file), maps.width, maps.height, samples);
            let channel = match encoding {
                Encoding::Exact => {
                    let (high, low) = (format!("{stem}.high.png"), format!("{stem}.low.png"));
                    write(&high, &plane.iter().map(|v| (ordered(*v) >> 16) as u16).collect::<Vec<_>>())?;
                    write(&low, &plane.iter().map(|v| ordered(*v) as u16).collect::<Vec<_>>())?;
                    PackedChannel::Exact { high, low }
                }
                Encoding::Linear => {
                    let file = format!("{stem}.png");
                    let (zero, step, samples) = linear(plane, &stem)?;
                    write(&file, &samples)?;
                    PackedChannel::Linear { file, zero, step }
                }
            };
            channels.insert(name.to_owned(), channel);
        }
        packed.insert(kind.name().to_owned(), PackedMap { attributes: map.attributes.clone(), channels });
    }
    let pack = Pack { nacre_maps: 1, width: maps.width, height: maps.height, about: about(), maps: packed };
    folder.write_json(PACK, &pack)
}

/// Zero point, step and samples of a plane.
fn linear(plane: &[f32], name: &str) -> Result<(f64, f64, Vec<u16>)> {
    if plane.iter().any(|v| v.is_infinite()) {
        return Err(Error::input(name, "has infinite values", "export it with --encoding exact"));
    }
    let known = || plane.iter().filter(|v| v.is_finite()).map(|v| f64::from(*v));
    let (low, high) = (known().fold(f64::MAX, f64::min), known().fold(f64::MIN, f64::max));
    let (zero, step) =
        if low < high { (low, (high - low) / f64::from(UNKNOWN - 1)) } else { (low.min(f64::from(f32::MAX)), 1.0) };
    let sample = |v: &f32| if v.is_nan() { UNKNOWN } else { ((f64::from(*v) - zero) / step).round() as u16 };
    Ok((zero, step, plane.iter().map(sample).collect()))
}

/// True if a name consists of letters, digits, - and _ only.
fn plain(name: &str) -> bool {
    !name.is_empty() && name.len() < 64 && name.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c))
}

/// Reads a folder written by [`export`], or one of the same format.
///
/// # Errors
/// `Input`, naming the file and the problem.
pub fn import(input: &Path) -> Result<Maps> {
    let path = if input.is_dir() { input.join(PACK) } else { input.to_path_buf() };
    let remedy = format!("give a folder with a {PACK} as `nacre map export` writes it");
    let bad = |problem: String| Error::file(&path, problem, &remedy);
    let text = read_text(&path, MAX_BYTES, &remedy)?;
    let pack: Pack = from_json(&text).map_err(bad)?;
    if pack.nacre_maps != 1 {
        return Err(bad(format!("is version {}; version 1 can be read", pack.nacre_maps)));
    }
    let count = pack.width.checked_mul(pack.height).filter(|n| (1..=MOST_PIXELS).contains(n));
    let Some(count) = count else { return Err(bad(format!("is {} × {} pixels", pack.width, pack.height))) };
    if pack.maps.values().map(|m| m.channels.len()).sum::<usize>() > MOST_CHANNELS {
        return Err(bad(format!("has more than {MOST_CHANNELS} channels")));
    }
    let folder = path.parent().unwrap_or(Path::new("."));
    let mut maps = BTreeMap::new();
    for (name, packed) in &pack.maps {
        let kind = Kind::ALL.into_iter().find(|k| k.name() == name);
        let Some(kind) = kind else { return Err(bad(format!("{name:?} is neither orientation nor period"))) };
        let mut planes = BTreeMap::new();
        for (name, channel) in &packed.channels {
            let samples = |file: &str| picture(folder, file, [pack.width, pack.height], &bad);
            let plane: Vec<f32> = match channel {
                PackedChannel::Exact { high, low } => {
                    let (high, low) = (samples(high)?, samples(low)?);
                    high.iter().zip(&low).map(|(h, l)| value(u32::from(*h) << 16 | u32::from(*l))).collect()
                }
                PackedChannel::Linear { file, zero, step } => {
                    let one = |s: &u16| if *s == UNKNOWN { f32::NAN } else { (zero + step * f64::from(*s)) as f32 };
                    samples(file)?.iter().map(one).collect()
                }
            };
            planes.insert(name.clone(), plane);
        }
        let mut take =
            |name: &str| planes.remove(name).ok_or_else(|| bad(format!("{}: has no channel {name}", kind.name())));
        let (value, sigma, mask) = (take(kind.name())?, take("sigma")?, take("mask")?);
        maps.insert(kind, Map { value, sigma, mask, more: planes, attributes: packed.attributes.clone() });
    }
    if maps.is_empty() || count == 0 {
        return Err(bad("holds no map".into()));
    }
    Ok(Maps { width: pack.width, height: pack.height, maps })
}

/// Reads a 16-bit grey picture beside the description.
fn picture(folder: &Path, file: &str, size: [usize; 2], bad: &dyn Fn(String) -> Error) -> Result<Vec<u16>> {
    let mut parts = Path::new(file).components();
    if !matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None)) {
        return Err(bad(format!("{file:?} is no file beside it")));
    }
    let path = folder.join(file);
    let found = info(&path)?;
    if [found.width, found.height] != size {
        return Err(Error::file(&path, format!("is {found}"), format!("{PACK} says {} × {}", size[0], size[1])));
    }
    match read(&path)? {
        raster if raster.channels == 1 => match raster.samples {
            Samples::U16(samples) => Ok(samples),
            _ => Err(Error::file(&path, format!("is {found}"), "give a 16-bit grey PNG")),
        },
        _ => Err(Error::file(&path, format!("is {found}"), "give a 16-bit grey PNG")),
    }
}

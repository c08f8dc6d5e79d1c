//! Statements of image files about their pixel values, besides size and type: transfer curve, levels of black and white, orientation, and
//! parts of the file that are not read.

use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use moxcms::{ColorProfile, ParametricCurve, ToneReprCurve};

use super::fault::Decoded;
use super::raster::Info;
use super::read::{Format, header, sniff};
use super::source::{Source, decode, open};
use super::{exif, fits, jpeg, npy, png, raw, tif};
use nacre_base::Result;

/// Statements of a file about its pixel values.
#[derive(Clone, Debug, PartialEq)]
pub struct Details {
    /// Size and type of its pixels.
    pub info: Info,
    /// How values encode light, where the file says so.
    pub encoding: Option<Encoding>,
    /// Largest value that a pixel can have, where it is not the largest of its type: 4095 for 12 bits.
    pub white: Option<f64>,
    /// File value of no light, where the file states it.
    pub black: Option<f64>,
    /// Exif orientation that viewers would apply; 1 is none.
    pub orientation: u16,
    /// Parts of the file that are not read or are missing, each a clause: "has 3 pages, of which the first is read".
    pub notes: Vec<String>,
}

impl Details {
    /// Takes black and white as the file states them.
    fn levels(&mut self, levels: Option<[f64; 2]>) {
        (self.black, self.white) = levels.map_or((None, None), |[black, white]| (Some(black), Some(white)));
    }
}

/// How values encode light, and where the file says so.
#[derive(Clone, Debug, PartialEq)]
pub struct Encoding {
    /// The curve.
    pub curve: Curve,
    /// Part of the file: "gAMA 0.45455", "ICC profile".
    pub source: String,
}

/// A curve from light to file values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Curve {
    /// Values are proportional to light.
    Linear,
    /// The curve of IEC 61966-2-1.
    Srgb,
    /// Value = light^(1/gamma).
    Gamma(f64),
    /// Any other curve, which is not supported.
    Other,
}

/// Largest distance of two curves that count as one, in light between 0 and 1: rounding of 16-bit tables and of gAMA.
const SAME_CURVE: f64 = 0.002;

impl Curve {
    /// From the exponent of gAMA: value = light^exponent.
    pub(super) fn of_exponent(exponent: f64) -> Self {
        match exponent {
            e if !(0.1..=10.0).contains(&e) => Self::Other,
            // Rounded to five digits in files.
            e if (e - 1.0).abs() < 1e-4 => Self::Linear,
            e => Self::Gamma(1.0 / e),
        }
    }

    /// Light at a file value between 0 and 1; `None` for curves that are not read.
    pub fn light(self, value: f64) -> Option<f64> {
        match self {
            Self::Linear => Some(value),
            Self::Srgb if value <= 0.040_45 => Some(value / 12.92),
            Self::Srgb => Some(((value + 0.055) / 1.055).powf(2.4)),
            Self::Gamma(gamma) => Some(value.powf(gamma)),
            Self::Other => None,
        }
    }

    /// The curve that a function from value to light is.
    fn of(light: impl Fn(f64) -> f64) -> Self {
        let exponent = light(0.5).ln() / 0.5_f64.ln();
        let far = |curve: Self| {
            let points = (0..=64).map(|i| f64::from(i) / 64.0);
            points.map(|v| (light(v) - curve.light(v).unwrap_or(f64::NAN)).abs()).fold(0.0, f64::max)
        };
        let near = [Self::Linear, Self::Srgb, Self::Gamma(exponent)].into_iter().find(|c| far(*c) < SAME_CURVE);
        near.unwrap_or(Self::Other)
    }

    /// The transfer curve of an ICC profile; `None` without a valid profile or curve.
    pub(super) fn of_profile(profile: &[u8]) -> Option<Self> {
        let profile = ColorProfile::new_from_slice(profile).ok()?;
        Some(match profile.green_trc.or(profile.gray_trc)? {
            ToneReprCurve::Lut(table) => match table.as_slice() {
                [] => Self::Linear,
                // Unsigned fixed point with eight bits after the point.
                [gamma] => Self::of(|v| v.powf(f64::from(*gamma) / 256.0)),
                table => {
                    let last = table.len() - 1;
                    Self::of(|v| {
                        let at = v * last as f64;
                        let (low, high) = (at.floor() as usize, at.ceil() as usize);
                        let [a, b] = [low, high].map(|i| f64::from(table[i.min(last)]) / 65_535.0);
                        a + (b - a) * at.fract()
                    })
                }
            },
            ToneReprCurve::Parametric(parameters) => {
                let c = ParametricCurve::new(&parameters)?;
                let [g, a, b, linear, d, e, f] = [c.g, c.a, c.b, c.c, c.d, c.e, c.f].map(f64::from);
                Self::of(|v| if v < d { linear * v + f } else { (a * v + b).max(0.0).powf(g) + e })
            }
        })
    }
}

/// Reads everything of a photograph but its pixels.
///
/// # Errors
/// As [`info`](super::info).
pub fn details(path: &Path) -> Result<Details> {
    decode(path, || of(path))
}

fn of(path: &Path) -> Decoded<Details> {
    let mut source = open(path)?;
    let format = sniff(&mut source)?;
    let info = header(path, source, format)?;
    // Decoders keep the file that they were given.
    let source = &mut open(path)?;
    let mut details = Details { info, encoding: None, white: None, black: None, orientation: 1, notes: vec![] };
    match format {
        Format::Png => png::describe(source, &mut details)?,
        Format::Jpeg => {
            let missing = jpeg::missing(source)?;
            let note = |missing: bool, text: &str| missing.then(|| text.to_owned());
            details.notes.extend(note(missing.end, "has no end marker, but data for every block"));
            details.notes.extend(note(missing.tables, "has no Huffman tables; those of Motion JPEG are used"));
            source.seek(SeekFrom::Start(0))?;
            details.encoding = jpeg::profile(source)?.and_then(|p| encoding(&p));
            details.orientation = exif::orientation(path).unwrap_or(1);
        }
        Format::Tiff => tif::describe(source, &mut details)?,
        Format::Exr | Format::Radiance => {
            details.encoding = Some(Encoding { curve: Curve::Linear, source: "file format".into() });
        }
        Format::Bmp | Format::WebP => {}
        Format::Fits => details.levels(fits::levels(open(path)?)?),
        Format::Npy => details.levels(npy::levels(open(path)?)?),
        Format::Raw(kind) => {
            details.encoding = Some(Encoding { curve: Curve::Linear, source: "camera raw file".into() });
            details.levels(raw::levels(path, open(path)?, kind)?);
        }
    }
    Ok(details)
}

/// The encoding that an ICC profile states.
pub(super) fn encoding(profile: &[u8]) -> Option<Encoding> {
    Curve::of_profile(profile).map(|curve| Encoding { curve, source: "ICC profile".into() })
}

/// Reads at most `limit` bytes of a part of a file that has `length`; `None` for longer ones.
pub(super) fn part(source: &mut Source, length: u64, limit: u64) -> Decoded<Option<Vec<u8>>> {
    if length > limit {
        source.seek(SeekFrom::Current(length.try_into().unwrap_or(i64::MAX)))?;
        return Ok(None);
    }
    let mut bytes = Vec::new();
    source.by_ref().take(length).read_to_end(&mut bytes)?;
    Ok(Some(bytes))
}

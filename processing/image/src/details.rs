//! Statements of image files about their pixel values: transfer curve, black and white level, orientation, and parts of
//! the file that are not read.

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
    /// Transfer curve, if the file states it.
    pub encoding: Option<Encoding>,
    /// Largest possible pixel value, if it is not that of the sample type: 4095 for 12 bits.
    pub white: Option<f64>,
    /// Black level in file values, if the file states it.
    pub black: Option<f64>,
    /// Exif orientation for viewers, 1 to 8; 1 is unchanged.
    pub orientation: u16,
    /// Clauses about parts of the file that are missing or not read: "has 3 pages, of which the first is read".
    pub notes: Vec<String>,
}

impl Details {
    /// Sets black and white level from the file's statements.
    fn levels(&mut self, levels: Option<[f64; 2]>) {
        (self.black, self.white) = levels.map_or((None, None), |[black, white]| (Some(black), Some(white)));
    }
}

/// Transfer curve with its source in the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Encoding {
    /// Transfer curve.
    pub curve: Curve,
    /// Part of the file that states it: "gAMA 0.45455", "ICC profile".
    pub source: String,
}

/// Transfer curve from light to file values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Curve {
    /// Values are proportional to light.
    Linear,
    /// Curve of sRGB (IEC 61966-2-1).
    Srgb,
    /// Power law: value = light^(1/gamma).
    Gamma(f64),
    /// Any other curve; not supported.
    Other,
}

/// Largest difference in light (0 to 1) of two curves that count as equal: covers the rounding of 16-bit tables and of
/// gAMA.
const SAME_CURVE: f64 = 0.002;

impl Curve {
    /// Curve of a gAMA exponent: value = light^exponent.
    pub(super) fn of_exponent(exponent: f64) -> Self {
        match exponent {
            e if !(0.1..=10.0).contains(&e) => Self::Other,
            // Files round the exponent to five digits.
            e if (e - 1.0).abs() < 1e-4 => Self::Linear,
            e => Self::Gamma(1.0 / e),
        }
    }

    /// Light at a file value between 0 and 1; `None` for unsupported curves.
    pub fn light(self, value: f64) -> Option<f64> {
        match self {
            Self::Linear => Some(value),
            Self::Srgb if value <= 0.040_45 => Some(value / 12.92),
            Self::Srgb => Some(((value + 0.055) / 1.055).powf(2.4)),
            Self::Gamma(gamma) => Some(value.powf(gamma)),
            Self::Other => None,
        }
    }

    /// Classifies a function from value to light.
    fn of(light: impl Fn(f64) -> f64) -> Self {
        let exponent = light(0.5).ln() / 0.5_f64.ln();
        let far = |curve: Self| {
            let points = (0..=64).map(|i| f64::from(i) / 64.0);
            points.map(|v| (light(v) - curve.light(v).unwrap_or(f64::NAN)).abs()).fold(0.0, f64::max)
        };
        let near = [Self::Linear, Self::Srgb, Self::Gamma(exponent)].into_iter().find(|c| far(*c) < SAME_CURVE);
        near.unwrap_or(Self::Other)
    }

    /// Transfer curve of an ICC profile; `None` without a valid profile or curve.
    pub(super) fn of_profile(profile: &[u8]) -> Option<Self> {
        let profile = ColorProfile::new_from_slice(profile).ok()?;
        Some(match profile.green_trc.or(profile.gray_trc)? {
            ToneReprCurve::Lut(table) => match table.as_slice() {
                [] => Self::Linear,
                // Unsigned fixed point with eight fractional bits.
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

/// Reads the statements of a photograph about its values, without its pixels.
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
    // Decoders keep the file that they are given.
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

/// Encoding stated by an ICC profile.
pub(super) fn encoding(profile: &[u8]) -> Option<Encoding> {
    Curve::of_profile(profile).map(|curve| Encoding { curve, source: "ICC profile".into() })
}

/// Reads `length` bytes of a file; `None` if they exceed `limit`.
pub(super) fn part(source: &mut Source, length: u64, limit: u64) -> Decoded<Option<Vec<u8>>> {
    if length > limit {
        source.seek(SeekFrom::Current(length.try_into().unwrap_or(i64::MAX)))?;
        return Ok(None);
    }
    let mut bytes = Vec::new();
    source.by_ref().take(length).read_to_end(&mut bytes)?;
    Ok(Some(bytes))
}

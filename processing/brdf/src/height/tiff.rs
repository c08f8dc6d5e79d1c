//! Height maps as TIFF: signed, wide and floating-point samples; pitch and unit of ImageJ, OME or the resolution.

#[cfg(test)]
mod tests;

use super::picture;
use super::read::Scale;
use super::stored::{Pitch, Stored};
use super::text::unit::unit_um;
use super::{HeightField, check_size};
use nacre_base::guard::guarded;
use nacre_base::{Error, Result};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use tiff::decoder::ifd::Value;
use tiff::decoder::{Decoder, DecodingResult, Limits};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

/// Largest decoded samples in bytes: 64-bit samples of the largest height field.
const MAX_BYTES: usize = 8 * super::MAX_PIXELS;

/// Largest pitch in µm that is accepted from a resolution per inch or centimetre; many programs write 72 to 1200 dots
/// per inch by default.
const BELIEVED: f64 = 10.0;

type Image = Decoder<BufReader<File>>;

/// Reads a height map.
pub(super) fn read(path: &Path, scale: &Scale) -> Result<HeightField> {
    let decoded = guarded(|| decode(path, scale));
    decoded.unwrap_or_else(|panic| Err(Error::file(path, panic, "copy or export the file again")))
}

fn fault(path: &Path, error: TiffError) -> Error {
    match error {
        TiffError::UnsupportedError(error) => Error::file(
            path,
            format!("is a TIFF that cannot be decoded: {error}"),
            "export it as uncompressed TIFF or as PNG",
        ),
        TiffError::LimitsExceeded => Error::file(path, "is a TIFF beyond the limits", "crop it"),
        other => Error::file(path, format!("is a truncated or damaged TIFF: {other}"), "copy or export the file again"),
    }
}

fn decode(path: &Path, scale: &Scale) -> Result<HeightField> {
    let fault = |error| fault(path, error);
    let file = super::read::open(path)?;
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MAX_BYTES;
    limits.intermediate_buffer_size = MAX_BYTES;
    limits.ifd_value_size = 16 << 20;
    let mut image = Decoder::new(BufReader::new(file)).map_err(fault)?.with_limits(limits);
    instrument(path, &mut image)?;
    let stated = Stated::read(&mut image);
    let gray = matches!(image.colortype(), Ok(ColorType::Gray(_)));
    let formats = image.find_tag_unsigned_vec::<u16>(Tag::SampleFormat).map_err(fault)?;
    let format = formats.and_then(|f| f.first().copied()).unwrap_or(1);
    let bits = image
        .find_tag_unsigned_vec::<u16>(Tag::BitsPerSample)
        .map_err(fault)?
        .and_then(|b| b.first().copied())
        .unwrap_or(1);
    // Grey values from black to white, and colours, are read as images.
    if !gray || (format == 1 && bits <= 16 && stated.unit_um.is_none()) {
        drop(image);
        let mut field = picture::with_pitch(path, scale, stated.pitch)?;
        field.notes = stated.notes;
        return Ok(field);
    }
    let (width, rows) = image.dimensions().map_err(fault)?;
    let (width, rows) = (width as usize, rows as usize);
    check_size(&path.display().to_string(), width, rows)?;
    let (values, kind) = samples(image.read_image().map_err(fault)?);
    let mut notes = vec![format!("TIFF of {kind} samples; a range is from the lowest to the highest")];
    notes.extend(stated.notes);
    let step = (!kind.starts_with("float")).then_some(1.0);
    Stored { width, rows, values, pitch: stated.pitch, unit_um: stated.unit_um, step, notes, gaps: None }
        .field(path, scale)
}

fn samples(decoded: DecodingResult) -> (Vec<f64>, &'static str) {
    fn all<T: Copy>(values: Vec<T>, number: impl Fn(T) -> f64) -> Vec<f64> {
        values.into_iter().map(number).collect()
    }
    match decoded {
        DecodingResult::U8(v) => (all(v, f64::from), "unsigned 8-bit"),
        DecodingResult::U16(v) => (all(v, f64::from), "unsigned 16-bit"),
        DecodingResult::U32(v) => (all(v, f64::from), "unsigned 32-bit"),
        DecodingResult::U64(v) => (all(v, |v| v as f64), "unsigned 64-bit"),
        DecodingResult::I8(v) => (all(v, f64::from), "signed 8-bit"),
        DecodingResult::I16(v) => (all(v, f64::from), "signed 16-bit"),
        DecodingResult::I32(v) => (all(v, f64::from), "signed 32-bit"),
        DecodingResult::I64(v) => (all(v, |v| v as f64), "signed 64-bit"),
        DecodingResult::F16(v) => (all(v, |v| f64::from(v.to_f32())), "floating-point 16-bit"),
        DecodingResult::F32(v) => (all(v, f64::from), "floating-point 32-bit"),
        DecodingResult::F64(v) => (v, "floating-point 64-bit"),
    }
}

/// Refuses TIFFs of instruments that store the heights in private tags, beside a picture.
fn instrument(path: &Path, image: &mut Image) -> Result<()> {
    let mut has = |tag: u16| image.find_tag(Tag::from_u16_exhaustive(tag)).ok().flatten().is_some();
    let name = match () {
        () if has(50434) || has(50432) => "Park Systems",
        () if has(32768) && has(32769) => "JPK",
        () => return Ok(()),
    };
    let problem = format!("is a TIFF of {name}, whose heights are in private tags");
    Err(Error::file(path, problem, "export the heights as Gwyddion file (.gwy), X3P or text"))
}

/// Scale stated by the tags.
#[derive(Default)]
struct Stated {
    pitch: Pitch,
    unit_um: Option<f64>,
    notes: Vec<String>,
}

impl Stated {
    fn read(image: &mut Image) -> Self {
        let text =
            image.find_tag(Tag::ImageDescription).ok().flatten().and_then(|v| v.into_string().ok()).unwrap_or_default();
        let mut this = Self::default();
        let per = [Tag::XResolution, Tag::YResolution].map(|tag| rational(image, tag));
        let unit = image.find_tag_unsigned::<u16>(Tag::ResolutionUnit).ok().flatten().unwrap_or(2);
        let key = |name: &str| text.lines().find_map(|l| l.trim().strip_prefix(name)?.strip_prefix('='));
        if text.starts_with("ImageJ=") {
            // Non-ASCII units are written as escapes.
            let name = key("unit").unwrap_or_default().trim().replace("\\u00B5", "µ").replace("\\u00b5", "µ");
            if let (Some(um), [Some(x), Some(y)]) = (unit_um(&name).or_else(|| other_unit(&name)), per) {
                this.pitch = Pitch::Um([um / x, um / y]);
                this.notes.push(format!("pitch {:.6} µm from ImageJ's unit {name}", um / x));
            }
            this.calibration(&key);
        } else if let Some(both) = ome(&text) {
            this.pitch = Pitch::Um(both);
            this.notes.push(format!("pitch {:.6} µm from the OME description", both[0]));
        }
        if let (Pitch::Unknown, [Some(x), Some(y)], Some((um, name))) = (this.pitch, per, dots(unit))
            && um / x < BELIEVED
        {
            this.pitch = Pitch::Um([um / x, um / y]);
            this.notes.push(format!("pitch {:.6} µm from the resolution of {x} pixels per {name}", um / x));
        }
        if image.more_images() {
            this.notes.push("the first of several pages".into());
        }
        this
    }

    /// ImageJ's calibration `cf=0`, `c0`, `c1` with `vunit`: values in a unit of length.
    fn calibration<'a>(&mut self, key: &impl Fn(&str) -> Option<&'a str>) {
        let number = |name: &str| key(name).and_then(|v| v.trim().parse::<f64>().ok());
        if let (Some("0"), Some(slope), Some(unit)) =
            (key("cf").map(str::trim), number("c1"), key("vunit").and_then(unit_um))
            && slope > 0.0
        {
            self.unit_um = Some(slope * unit);
        }
    }
}

fn other_unit(name: &str) -> Option<f64> {
    (name == "inch" || name == "in").then_some(25_400.0)
}

/// µm per unit of the resolution.
fn dots(unit: u16) -> Option<(f64, &'static str)> {
    match unit {
        2 => Some((25_400.0, "inch")),
        3 => Some((10_000.0, "cm")),
        _ => None,
    }
}

fn rational(image: &mut Image, tag: Tag) -> Option<f64> {
    let value = match image.find_tag(tag).ok().flatten()? {
        Value::Rational(a, b) => f64::from(a) / f64::from(b),
        Value::Float(v) => f64::from(v),
        Value::Double(v) => v,
        _ => return None,
    };
    (value.is_finite() && value > 0.0).then_some(value)
}

/// `PhysicalSizeX` and `PhysicalSizeY` of OME-XML in µm.
fn ome(text: &str) -> Option<[f64; 2]> {
    if !text.contains("<OME") {
        return None;
    }
    let options = roxmltree::ParsingOptions { nodes_limit: 1 << 20, ..Default::default() };
    let xml = roxmltree::Document::parse_with_options(text, options).ok()?;
    let pixels = xml.descendants().find(|n| n.tag_name().name() == "Pixels")?;
    let side = |name: &str| {
        let unit = pixels.attribute(format!("{name}Unit").as_str()).map_or(Some(1.0), unit_um)?;
        pixels.attribute(name)?.parse::<f64>().ok().map(|v| v * unit).filter(|um| *um > 0.0)
    };
    Some([side("PhysicalSizeX")?, side("PhysicalSizeY")?])
}

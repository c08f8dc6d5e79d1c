//! Height fields from files: grey images, EXR maps, text grids.

use super::{HeightField, check_size};
use nacre_base::{Error, Result};
use nacre_image::{Depth, Raster, Samples};
use std::io::Read;
use std::path::Path;

/// Endings of files that hold height fields.
pub const EXTENSIONS: &[&str] = &["png", "tif", "tiff", "jpg", "jpeg", "exr", "bmp", "txt", "asc", "csv", "dat"];

/// Largest text grid that is read, in bytes.
const MAX_TEXT: u64 = 256 << 20;

/// Largest relative difference of a pixel's width and height.
const SQUARE: f64 = 0.01;

/// What is known of the scale beside the file; it has precedence over what the file says.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Scale {
    /// Distance of two pixels in µm.
    pub pixel_um: Option<f64>,
    /// Height in µm of white above black (images, EXR maps of relative height), or of the highest above the lowest point (text).
    pub range_um: Option<f64>,
}

impl Scale {
    pub(crate) fn check(&self) -> Result<()> {
        let positive = |what: &str, value: Option<f64>| match value {
            Some(v) if !(v > 0.0 && v <= 1e4) => {
                Err(Error::input(what, format!("is {v}"), "give a number of µm above 0, at most 10000"))
            }
            _ => Ok(()),
        };
        positive("--pixel-um", self.pixel_um)?;
        positive("--range-um", self.range_um)
    }

    fn pixel(&self, path: &Path, found: Option<f64>) -> Result<f64> {
        self.pixel_um.or(found).ok_or_else(|| {
            Error::file(path, "does not say how large its pixels are", "give their pitch with --pixel-um")
        })
    }
}

/// Reads a height field: PNG, TIFF, JPEG and BMP images (grey, bright is high), EXR maps (channel `height` or the only one, in µm, with
/// the pitch as the attribute `pixel_um`, as `nacre reconstruct bokeh` writes them), and text grids with or without a header that tells
/// size and units (as AFM programs write them).
///
/// # Errors
/// `Input` for what cannot be read, holds no numbers, or whose scale nobody has said.
pub fn read(path: &Path, scale: &Scale) -> Result<HeightField> {
    scale.check()?;
    // Opening a pipe waits for its writer.
    if std::fs::metadata(path).is_ok_and(|there| !there.is_file()) {
        return Err(Error::file(path, "is no file", "give an image, or rows of heights as text"));
    }
    let mut head = [0_u8; 4];
    let opened = std::fs::File::open(path).and_then(|mut f| f.read(&mut head));
    let count = opened.map_err(|e| Error::file(path, format!("cannot be read: {e}"), "check the path"))?;
    match &head[..count] {
        [0x76, 0x2f, 0x31, 0x01] => map(path, scale),
        [0x89, b'P', b'N', b'G']
        | [0xff, 0xd8, 0xff, _]
        | [b'I', b'I', 42 | 43, 0]
        | [b'M', b'M', 0, 42 | 43]
        | [b'B', b'M', ..] => picture(path, scale),
        _ => text(path, scale),
    }
}

fn picture(path: &Path, scale: &Scale) -> Result<HeightField> {
    let info = nacre_image::info(path)?;
    check_size(&path.display().to_string(), info.width, info.height)?;
    let pixel_um = scale.pixel(path, None)?;
    let range = scale.range_um.ok_or_else(|| {
        Error::file(path, "does not say how high white is above black", "give this height with --range-um")
    })?;
    let raster = nacre_image::read(path)?;
    let full = f64::from(info.depth.full_scale());
    let um = grey(path, &raster)?.into_iter().map(|v| v / full * range).collect();
    let mut field = HeightField::new(&path.display().to_string(), info.width, info.height, pixel_um, um)?;
    field.step_um = (info.depth != Depth::F32).then_some(range / full);
    Ok(field)
}

/// Values of a grey image, which may be stored as RGB.
fn grey(path: &Path, raster: &Raster) -> Result<Vec<f64>> {
    let values: Vec<f64> = match &raster.samples {
        Samples::U8(v) => v.iter().map(|v| f64::from(*v)).collect(),
        Samples::U16(v) => v.iter().map(|v| f64::from(*v)).collect(),
        Samples::F32(v) => v.iter().map(|v| f64::from(*v)).collect(),
    };
    if raster.channels == 1 {
        return Ok(values);
    }
    let full = f64::from(raster.info().depth.full_scale());
    let colored = |rgb: &[f64]| (rgb[0] - rgb[1]).abs().max((rgb[1] - rgb[2]).abs()) > 0.02 * full;
    if let Some(at) = values.chunks_exact(3).position(colored) {
        let (x, y) = (at % raster.width, at / raster.width);
        let problem = format!("is coloured (column {x}, row {y}), so no height can be told from it");
        return Err(Error::file(path, problem, "export the heights as grey values, without a colour scale"));
    }
    Ok(values.chunks_exact(3).map(|rgb| rgb.iter().sum::<f64>() / 3.0).collect())
}

fn map(path: &Path, scale: &Scale) -> Result<HeightField> {
    let info = nacre_image::info(path)?;
    check_size(&path.display().to_string(), info.width, info.height)?;
    let mut map = nacre_image::read_exr(path)?;
    let name = match map.channels.keys().collect::<Vec<_>>()[..] {
        [only] => only.clone(),
        _ => "height".into(),
    };
    let values = map.take(&name, path)?;
    let number = |name: &str| map.attributes.get(name).and_then(|v| v.parse::<f64>().ok());
    let pixel_um = scale.pixel(path, number("pixel_um"))?;
    let in_um = map.attributes.get("units").is_some_and(|u| u.starts_with("µm"));
    let factor = match (scale.range_um, in_um) {
        (Some(range), false) => range,
        (None, true) => 1.0,
        (Some(_), true) => {
            return Err(Error::file(path, "already holds heights in µm", "leave out --range-um"));
        }
        (None, false) => {
            let problem = "holds relative heights: its attribute `units` is not µm";
            return Err(Error::file(path, problem, "give the height of the value 1 with --range-um"));
        }
    };
    let um = values.into_iter().map(|v| f64::from(v) * factor).collect();
    HeightField::new(&path.display().to_string(), map.width, map.height, pixel_um, um)
}

/// What the header of a text grid says.
#[derive(Debug, Default)]
struct Header {
    columns: Option<usize>,
    rows: Option<usize>,
    width_um: Option<f64>,
    height_um: Option<f64>,
    pixel_um: Option<f64>,
    unit_um: Option<f64>,
}

/// µm of a unit of length.
fn unit_um(name: &str) -> Option<f64> {
    Some(match name.trim().trim_matches(['[', ']', '(', ')']) {
        "m" => 1e6,
        "mm" => 1e3,
        // Micro sign, Greek letter, and what is left of the micro sign in other encodings.
        "µm" | "μm" | "um" | "~m" | "\u{fffd}m" => 1.0,
        "nm" => 1e-3,
        "Å" | "A" => 1e-4,
        "pm" => 1e-6,
        _ => return None,
    })
}

impl Header {
    /// Takes in `Name : value unit`, `# Name: value unit`, or `name value`; other lines say nothing.
    fn take(&mut self, line: &str) {
        let line = line.trim_start_matches(['#', '%', ';', ' ']);
        let split = line.split_once([':', '=']).or_else(|| line.split_once(char::is_whitespace));
        let Some((name, value)) = split else { return };
        let (name, value) = (name.trim().to_lowercase(), value.trim());
        let mut words = value.split_whitespace();
        let (number, unit) = (words.next().and_then(|w| w.parse::<f64>().ok()), words.next().and_then(unit_um));
        let count = || number.filter(|n| (1.0..1e6).contains(n)).map(|n| n as usize);
        let length = || Some(number? * unit?);
        match name.as_str() {
            "image width" | "ncols" | "columns" | "xpixels" => self.columns = count(),
            "image height" | "nrows" | "rows" | "ypixels" => self.rows = count(),
            "real width" | "width" => self.width_um = length(),
            "real height" | "height" => self.height_um = length(),
            "pixel_um" => self.pixel_um = number,
            "z unit" | "value units" | "height unit" => self.unit_um = unit_um(value),
            _ => {}
        }
    }
}

fn text(path: &Path, scale: &Scale) -> Result<HeightField> {
    let bad = |problem: String| {
        Error::file(path, problem, "give a PNG, TIFF, JPEG, BMP or EXR image, or rows of heights as text")
    };
    let meta = std::fs::metadata(path).map_err(|e| bad(format!("cannot be read: {e}")))?;
    if !meta.is_file() || meta.len() > MAX_TEXT {
        return Err(bad(format!("is no height field: a file of at most {} MiB is", MAX_TEXT >> 20)));
    }
    let bytes = std::fs::read(path).map_err(|e| bad(format!("cannot be read: {e}")))?;
    let (mut header, mut values, mut width) = (Header::default(), Vec::new(), 0);
    for (k, line) in String::from_utf8_lossy(&bytes).lines().enumerate().filter(|(_, l)| !l.trim().is_empty()) {
        let words = line.split([',', ';', '\t', ' ']).map(str::trim).filter(|w| !w.is_empty());
        let row: Option<Vec<f64>> = words.map(|w| w.parse().ok()).collect();
        match row.filter(|r| !r.is_empty()) {
            Some(row) if width == 0 || row.len() == width => {
                width = row.len();
                values.extend(row);
            }
            Some(row) => return Err(bad(format!("line {} has {} heights, those before {width}", k + 1, row.len()))),
            None if width == 0 => header.take(line),
            None => return Err(bad(format!("line {} is no row of numbers: {line:.40}", k + 1))),
        }
    }
    if width == 0 {
        return Err(bad("is neither an image nor a grid of numbers".into()));
    }
    grid(path, scale, &header, width, values)
}

/// The field of a text grid.
fn grid(path: &Path, scale: &Scale, header: &Header, width: usize, mut values: Vec<f64>) -> Result<HeightField> {
    // All in one line: the header tells where rows end.
    let width = match (header.columns, header.rows) {
        (Some(c), Some(r)) if width == values.len() && c.checked_mul(r) == Some(width) => c,
        _ => width,
    };
    let rows = values.len() / width;
    for (what, said, found) in [("columns", header.columns, width), ("rows", header.rows, rows)] {
        if said.is_some_and(|said| said != found) {
            let problem = format!("has {found} {what} where its header says {}", said.unwrap_or(0));
            return Err(Error::file(path, problem, "copy or export the file again"));
        }
    }
    let across = header.width_um.map(|um| um / width as f64);
    let down = header.height_um.map(|um| um / rows as f64);
    if let (Some(a), Some(b)) = (across, down)
        && (a / b - 1.0).abs() > SQUARE
    {
        let problem = format!("has pixels of {a:.5} by {b:.5} µm");
        return Err(Error::file(path, problem, "resample it to square pixels"));
    }
    let pixel_um = scale.pixel(path, header.pixel_um.or(across).or(down))?;
    let finite = values.iter().filter(|v| v.is_finite());
    let [low, high] = finite.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(*v), b.max(*v)]);
    let factor = match (scale.range_um, header.unit_um) {
        (Some(range), _) if high > low => range / (high - low),
        (Some(_), _) => 1.0,
        (None, Some(unit)) => unit,
        (None, None) => {
            let problem = "does not say in which unit its heights are";
            return Err(Error::file(path, problem, "give the range from lowest to highest with --range-um"));
        }
    };
    values.iter_mut().for_each(|v| *v *= factor);
    HeightField::new(&path.display().to_string(), width, rows, pixel_um, values)
}

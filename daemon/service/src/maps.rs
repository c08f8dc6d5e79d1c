//! Maps as pictures, tables and NumPy arrays.

use super::files;
use super::heavy::Plane;
use super::problem::{Answer, Problem};
use nacre_image::{MASKED, Palette, Rgb, Samples, encode_png8, read, read_exr_channel, viridis};
use std::io;
use std::ops::Range;
use std::path::Path;

/// Widest picture in pixels.
const MAX_WIDTH: usize = 16_384;

/// Part of a map to draw, and the picture's width.
pub struct View {
    /// Most pixels per row of the picture.
    pub width: usize,
    /// Left, top, width and height in pixels of the map. Default: the whole map.
    pub region: Option<[usize; 4]>,
    /// Colour map of angles.
    pub palette: Palette,
}

/// Files, channels and names of maps that have a name of their own, the first of each name that a result has.
const NAMED: [(&str, &str, &str); 12] = [
    ("orientation", "orientation.exr", "orientation"),
    ("sigma", "orientation.exr", "sigma"),
    ("sigma", "aolp.exr", "sigma"),
    ("mask", "orientation.exr", "mask"),
    ("mask", "aolp.exr", "mask"),
    ("aolp", "aolp.exr", "aolp"),
    ("dolp", "aolp.exr", "dolp"),
    ("sigma_dolp", "aolp.exr", "sigma_dolp"),
    ("smoothed", "smoothed.exr", "orientation"),
    ("period", "period.exr", "period"),
    ("period_sigma", "period.exr", "sigma"),
    ("s0", "stokes.exr", "S0"),
];

/// File in `folder` and channel of a map by its name. Names outside of [`NAMED`] are those of a file and its channel:
/// `hdr.R` is the channel R of hdr.exr. Without orientations, σ and mask are those of the angle of polarization.
pub fn source(folder: &Path, name: &str) -> Option<(String, String)> {
    let mut named = NAMED.iter().filter(|(known, ..)| *known == name).peekable();
    if let Some((_, file, channel)) = named.peek().copied() {
        let there = named.find(|(_, file, _)| folder.join(file).exists());
        let (file, channel) = there.map_or((file, channel), |(_, file, channel)| (file, channel));
        return Some(((*file).to_owned(), (*channel).to_owned()));
    }
    let (stem, channel) = name.split_once('.')?;
    let is_plain = !stem.is_empty() && !channel.is_empty() && !name.contains(['/', '\\', '\0']);
    is_plain.then(|| (format!("{stem}.exr"), channel.to_owned()))
}

/// Name of a channel of a file in `folder`.
pub fn name_of(folder: &Path, file: &str, channel: &str) -> String {
    let named = NAMED.iter().filter(|(_, f, c)| (*f, *c) == (file, channel)).map(|(name, ..)| *name);
    let mut named = named.filter(|name| source(folder, name).is_some_and(|(f, c)| f == file && c == channel));
    named.next().map_or_else(|| format!("{}.{channel}", file.trim_end_matches(".exr")), str::to_owned)
}

/// Problem of a map that does not exist.
pub fn missing(name: &str) -> Problem {
    let name: String = name.chars().take(80).collect();
    Problem::not_found(format!("map {name:?}")).remedy("GET /api/v1/reconstructions/ID/maps lists the maps of a result")
}

/// One plane of a result folder, and its width in pixels.
///
/// # Errors
/// `not-found` when there is no such map.
pub fn plane(folder: &Path, name: &str) -> Answer<(Vec<f32>, usize)> {
    let (file, channel) = source(folder, name).ok_or_else(|| missing(name))?;
    read_exr_channel(&folder.join(file), &channel).ok().flatten().ok_or_else(|| missing(name))
}

type Encode = dyn Fn(usize, usize, usize, &[u8]) -> io::Result<Vec<u8>>;

/// Header with the values of the darkest and the lightest colour of a picture; σ in degrees.
pub fn range_header(name: &str, plane: &[f32]) -> (&'static str, String) {
    let unit = if name == "sigma" { 180.0 / std::f32::consts::PI } else { 1.0 };
    let [low, high] = range(name, plane).map(|v| v * unit);
    ("x-nacre-range", format!("{low},{high}"))
}

/// Header with the colour map of angles.
pub fn palette_header(palette: Palette) -> (&'static str, String) {
    ("x-nacre-palette", palette.to_string())
}

/// Colour map of angles in the pictures of a result folder. Reports of early versions, which used hues only, do not
/// name it.
pub fn palette(folder: &Path) -> Palette {
    #[derive(serde::Deserialize)]
    struct Report {
        palette: Palette,
    }
    let report = files::report(folder).ok();
    report.and_then(|bytes| serde_json::from_slice(&bytes).ok()).map_or(Palette::Hsv, |report: Report| report.palette)
}

/// Picture of a plane: angles in the colours of the palette, other values from dark to light over their range.
///
/// # Errors
/// A sentence when the view is empty.
pub fn picture(name: &str, plane: &[f32], width: usize, view: &View, encode: &Encode) -> Result<Vec<u8>, String> {
    let height = plane.len() / width.max(1);
    let [left, top, w, h] = view.region.unwrap_or([0, 0, width, height]);
    let (left, top) = (left.min(width), top.min(height));
    let (w, h) = (w.min(width - left), h.min(height - top));
    if w == 0 || h == 0 {
        return Err(format!("the region holds no pixel of the map, which is {width} × {height}"));
    }
    let color = colors(name, plane, view.palette);
    let step = w.div_ceil(view.width.clamp(1, MAX_WIDTH)).max(1);
    let (columns, rows) = (w.div_ceil(step), h.div_ceil(step));
    let mut bytes = Vec::with_capacity(3 * columns * rows);
    for y in (top..top + h).step_by(step) {
        bytes.extend((left..left + w).step_by(step).flat_map(|x| color(plane[y * width + x])));
    }
    encode(columns, rows, 3, &bytes).map_err(|e| e.to_string())
}

/// Values of the darkest and the lightest colour: σ and DoLP from 0, so that pictures are comparable; periods over
/// their own range.
pub fn range(name: &str, plane: &[f32]) -> [f32; 2] {
    let mut sorted: Vec<f32> = plane.iter().copied().filter(|v| v.is_finite()).step_by(17).collect();
    sorted.sort_unstable_by(f32::total_cmp);
    let at = |q: f64| sorted.get(((sorted.len().max(1) - 1) as f64 * q) as usize).copied().unwrap_or(0.0);
    [if matches!(name, "s0" | "period") { at(0.01) } else { 0.0 }, at(0.99)]
}

fn colors(name: &str, plane: &[f32], palette: Palette) -> Box<dyn Fn(f32) -> Rgb> {
    match name {
        "orientation" | "smoothed" | "aolp" => {
            let table = palette.table();
            Box::new(move |v| table.color(v))
        }
        "mask" => Box::new(|v| if v > 0.5 { [240, 240, 240] } else { MASKED }),
        _ => {
            let [low, high] = range(name, plane);
            let scale = if high > low { 1.0 / (high - low) } else { 0.0 };
            Box::new(move |v| if v.is_finite() { viridis((v - low) * scale) } else { MASKED })
        }
    }
}

/// Grey picture of `level(i)`, 0 to 1, with a display's gamma and at most `most` pixels per row.
///
/// # Errors
/// Those of the encoder.
pub fn grey(
    width: usize,
    height: usize,
    most: usize,
    level: &dyn Fn(usize) -> f32,
    encode: &Encode,
) -> io::Result<Vec<u8>> {
    let step = width.div_ceil(most.clamp(1, MAX_WIDTH)).max(1);
    let (columns, rows) = (width.div_ceil(step), height.div_ceil(step));
    let mut bytes = Vec::with_capacity(columns * rows);
    for y in (0..height).step_by(step) {
        bytes.extend((0..width).step_by(step).map(|x| (255.0 * level(y * width + x).powf(1.0 / 2.2)) as u8));
    }
    encode(columns, rows, 1, &bytes)
}

/// Reduced picture of a stored frame, scaled to its brightest pixel.
///
/// # Errors
/// `not-found` if the file is not a frame.
pub fn thumbnail(path: &Path, width: usize) -> Answer<Vec<u8>> {
    let raster = read(path).map_err(|_| Problem::not_found("such frame"))?;
    let Samples::U16(codes) = &raster.samples else { return Err(Problem::not_found("such frame")) };
    let top = f32::from(codes.iter().copied().max().unwrap_or(1).max(1));
    let level = |i: usize| f32::from(codes[i]) / top;
    grey(raster.width, raster.height, width, &level, &encode_png8).map_err(|e| Problem::bad(e.to_string()))
}

/// Rows of a plane as CSV.
pub fn csv_rows(plane: &Plane, rows: Range<usize>) -> Vec<u8> {
    nacre_image::csv_rows(rows_of(plane, &rows), plane.width, rows.start)
}

/// Rows of a plane in the format of a NumPy array.
pub fn npy_rows(plane: &Plane, rows: Range<usize>) -> Vec<u8> {
    nacre_image::npy_rows(rows_of(plane, &rows))
}

fn rows_of<'a>(plane: &'a Plane, rows: &Range<usize>) -> &'a [f32] {
    &plane.values[rows.start * plane.width..rows.end * plane.width]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regions_are_cut_to_the_map() {
        let plane = vec![0.5_f32; 20 * 10];
        let size = |region, width| {
            let encode = |w: usize, h: usize, _: usize, _: &[u8]| Ok(vec![w as u8, h as u8]);
            picture("sigma", &plane, 20, &View { width, region, palette: Palette::Cyclic }, &encode)
        };
        assert_eq!(size(None, 100).unwrap(), [20, 10]);
        assert_eq!(size(None, 5).unwrap(), [5, 3]);
        assert_eq!(size(Some([15, 5, 100, 100]), 100).unwrap(), [5, 5]);
        assert!(size(Some([20, 0, 5, 5]), 100).is_err());
        assert!(size(Some([usize::MAX, 0, usize::MAX, 5]), 100).is_err());
    }
}

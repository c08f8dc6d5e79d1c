//! Recommendation of a method for a sample, from one photograph or an orientation map.
//!
//! Flash photographs require copies: each position of a tile must be seen at many half vectors, which only a repeated
//! tile provides. They also require areas with a single grating each, because neighbouring pixels confirm each other.
//! Continuous or unique patterns suit fringes on the panel (absolute periods per pixel) or polarization (orientations
//! under any light).

mod repeats;
mod windows;

pub use repeats::Repeats;

use crate::{Kind, Maps};
use nacre_base::statistics::median;
use nacre_base::{Error, Result};
use nacre_image::{Canvas, Field, Gray, MASKED, Palette};
use num_complex::Complex32;
use repeats::unevenness;
use serde::Serialize;
use std::path::Path;

/// Longest side in pixels for the analysis; repetition is a coarse structure.
const LONGEST: usize = 640;

/// Minimum number of copies for flash photographs. 30 copies under five lights leave few positions unseen (studies
/// `flash`); a dozen require more lights.
const FEWEST: f64 = 12.0;

/// Gradient kurtosis above which areas count as uniform. Smooth fields have 1.5 to 2, noise has 2.
const DISCRETE: f64 = 3.0;

/// Upper limit of contrast, relative to its median.
const FAR: f32 = 3.0;

/// Window of the local mean brightness, as a fraction (1/6) of the longest side.
const LIGHTING: usize = 6;

/// Required quantities.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Need {
    /// Orientations and absolute periods.
    #[default]
    Period,
    /// Orientations only.
    Orientation,
}

impl std::str::FromStr for Need {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        match text {
            "period" => Ok(Self::Period),
            "orientation" => Ok(Self::Orientation),
            _ => Err(format!("{text:?} is neither period nor orientation")),
        }
    }
}

/// Recommended method.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Advice {
    /// Photographs under a flash at several positions.
    Flash,
    /// Fringes on the panel.
    Spots,
    /// Photographs behind an analyser.
    Polarization,
}

/// Analysis of a sample and the recommended method.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Colour map of angles in the picture of a map.
    pub palette: Palette,
    /// Repeated tile, if any.
    pub repeats: Option<Repeats>,
    /// Gradient kurtosis: mean fourth power of the slopes over their squared mean square.
    pub unevenness: f64,
    /// True if the sample consists of uniform areas.
    pub discrete: bool,
    /// Recommended method.
    pub advice: Advice,
    /// Reason for the recommendation.
    pub why: String,
    /// Second-best method.
    pub otherwise: String,
    /// Limitations of the analysis.
    pub warnings: Vec<String>,
}

/// Analyses a photograph, or a folder or file with an orientation map.
///
/// # Errors
/// `Input` for any other file.
pub fn recommend(input: &Path, need: Need, palette: Palette) -> Result<(Report, Canvas)> {
    let is_map = input.is_dir()
        || input.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr")) && { Maps::read(input).is_ok() };
    let ReducedInput { source, shown, scale, warning } =
        if is_map { of_map(input, palette)? } else { of_photograph(input)? };
    let (repeats, part) = windows::tile(source.size(), scale, &|part| source.part(part));
    let unevenness = unevenness(&source.part(part));
    let discrete = unevenness > DISCRETE;
    let (advice, why, otherwise) = judged(repeats.as_ref(), discrete, need);
    let mut warnings: Vec<String> = warning.into_iter().collect();
    if (0.7 * DISCRETE..1.4 * DISCRETE).contains(&unevenness) {
        warnings.push(format!(
            "whether areas are even within themselves is a close call (slopes: {unevenness:.1}, the limit is {DISCRETE})"
        ));
    }
    if repeats.is_none_or(|r| r.copies < 4.0) {
        warnings.push(
            "a tile that is seen fewer than four times is not taken for one: photograph all of the sample".into(),
        );
    }
    let size = source.size().map(|n| (n as f64 * scale).round() as usize);
    let picture = picture(source.size(), &shown, repeats.as_ref(), part, scale);
    let [width, height] = size;
    Ok((Report { width, height, palette, repeats, unevenness, discrete, advice, why, otherwise, warnings }, picture))
}

fn judged(repeats: Option<&Repeats>, discrete: bool, need: Need) -> (Advice, String, String) {
    let tiled = repeats.filter(|r| r.copies >= FEWEST);
    match (tiled, discrete, need) {
        (Some(r), true, _) => (
            Advice::Flash,
            format!(
                "a tile has room for {:.0} copies and is made of even areas: a flash at {} places shows each of them from all sides, and tells \
                 orientations and absolute periods without a stage",
                r.copies,
                if r.copies < 25.0 { "ten or more" } else { "five" }
            ),
            "fringes on the panel (spots) see each copy by itself, and need a calibrated panel".into(),
        ),
        (_, _, Need::Orientation) => (
            Advice::Polarization,
            format!("{}; orientations come from any light behind an analyser", unsuited(repeats, discrete)),
            "fringes on the panel (spots) tell absolute periods as well".into(),
        ),
        (_, _, Need::Period) => (
            Advice::Spots,
            format!(
                "{}; fringes on the panel tell orientation and absolute period of every pixel by itself",
                unsuited(repeats, discrete)
            ),
            "polarization tells orientations in any light, without periods; both together settle what fringes leave ambiguous".into(),
        ),
    }
}

/// Reason why flash photographs are unsuitable.
fn unsuited(repeats: Option<&Repeats>, discrete: bool) -> String {
    match repeats {
        None => "nothing is repeated".into(),
        Some(r) if r.copies < FEWEST => format!("a tile has room for {:.0} copies only", r.copies),
        Some(_) if !discrete => "what is repeated changes gradually within the tile".into(),
        Some(_) => "flash photographs do not suit it".into(),
    }
}

/// Input picture, reduced by `scale` relative to the file.
struct ReducedInput {
    source: Source,
    shown: Vec<[u8; 3]>,
    scale: f64,
    warning: Option<String>,
}

enum Source {
    Photograph(Gray),
    Map(Field),
}

impl Source {
    fn size(&self) -> [usize; 2] {
        match self {
            Self::Photograph(g) => [g.width, g.height],
            Self::Map(f) => [f.width, f.height],
        }
    }

    /// A rectangle of the source with its lighting and mean removed.
    fn part(&self, [left, top, width, height]: windows::Part) -> Field {
        let from = |i: usize| (top + i / width) * self.size()[0] + left + i % width;
        let all = 0..width * height;
        match self {
            Self::Photograph(g) => {
                without_lighting(&Gray { width, height, values: all.map(|i| g.values[from(i)]).collect() })
            }
            Self::Map(f) => {
                let values = all.clone().map(|i| f.values[from(i)]).collect();
                Field { width, height, values, mask: all.map(|i| f.mask[from(i)]).collect() }.centered()
            }
        }
    }
}

fn of_photograph(path: &Path) -> Result<ReducedInput> {
    let mut gray = Gray::read(path)?;
    let full = gray.width;
    while gray.width.max(gray.height) > LONGEST {
        gray = gray.halved();
    }
    if gray.width.min(gray.height) < 32 {
        let problem = format!("is {} × {} pixels", gray.width, gray.height);
        return Err(Error::file(path, problem, "give a photograph of 32 pixels and more along each side"));
    }
    let scale = full as f64 / gray.width as f64;
    let top = gray.values.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
    let clipped = gray.values.iter().filter(|v| **v >= 0.995 * top).count() as f64 / gray.values.len() as f64;
    let shown = gray.values.iter().map(|v| [(255.0 * (v / top).max(0.0).sqrt()) as u8; 3]).collect();
    let warning = (clipped > 0.02).then(|| {
        format!("{:.0} % of the photograph are as bright as can be: highlights hide what lies in them", 100.0 * clipped)
    });
    Ok(ReducedInput { source: Source::Photograph(gray), shown, scale, warning })
}

/// Brightness relative to the local mean, minus one. Extreme contrast, such as that of a table beside the sample, is
/// limited to a multiple of the median.
fn without_lighting(gray: &Gray) -> Field {
    let (w, h) = (gray.width, gray.height);
    let reach = (w.max(h) / (2 * LIGHTING)).max(4);
    let mut sums = vec![0.0_f64; (w + 1) * (h + 1)];
    for y in 0..h {
        let mut row = 0.0;
        for x in 0..w {
            row += f64::from(gray.values[y * w + x]);
            sums[(y + 1) * (w + 1) + x + 1] = sums[y * (w + 1) + x + 1] + row;
        }
    }
    let value = |i: usize| {
        let (x, y) = (i % w, i / w);
        let [left, right] = [x.saturating_sub(reach), (x + reach + 1).min(w)];
        let [top, bottom] = [y.saturating_sub(reach), (y + reach + 1).min(h)];
        let at = |x: usize, y: usize| sums[y * (w + 1) + x];
        let sum = at(right, bottom) - at(left, bottom) - at(right, top) + at(left, top);
        let mean = sum / ((right - left) * (bottom - top)) as f64;
        Complex32::new(if mean > 0.0 { (f64::from(gray.values[i]) / mean - 1.0) as f32 } else { 0.0 }, 0.0)
    };
    let mut values: Vec<Complex32> = (0..w * h).map(value).collect();
    let mut sizes: Vec<f32> = values.iter().map(|v| v.re.abs()).collect();
    let most = FAR * median(&mut sizes).unwrap_or(0.0);
    values.iter_mut().for_each(|v| v.re = v.re.clamp(-most, most));
    Field { width: w, height: h, values, mask: vec![1.0; w * h] }.centered()
}

fn of_map(input: &Path, palette: Palette) -> Result<ReducedInput> {
    let mut maps = Maps::read(input)?;
    let full = maps.width;
    let longest = maps.width.max(maps.height);
    if longest > LONGEST {
        maps = maps.resampled(LONGEST as f64 / longest as f64)?;
    }
    let remedy = "give a folder with orientation.exr, or a photograph";
    let Some(map) = maps.maps.get(&Kind::Orientation) else {
        return Err(Error::file(input, "holds no orientations", remedy));
    };
    if map.known() < 1000 {
        return Err(Error::file(input, format!("knows {} pixels", map.known()), "give a map that knows 1000 at least"));
    }
    let line = |(v, m): (&f32, &f32)| if *m > 0.0 { Complex32::from_polar(1.0, 2.0 * v) } else { Complex32::default() };
    let values = map.value.iter().zip(&map.mask).map(line).collect();
    let colors = palette.table();
    let color = |(v, m): (&f32, &f32)| if *m > 0.0 { colors.color(*v) } else { MASKED };
    let shown = map.value.iter().zip(&map.mask).map(color).collect();
    let field = Field { width: maps.width, height: maps.height, values, mask: map.mask.clone() };
    let scale = full as f64 / field.width as f64;
    Ok(ReducedInput { source: Source::Map(field), shown, scale, warning: None })
}

/// The analysed picture, with the outlines of a tile and its neighbours in the centre of the best part.
fn picture(
    [width, height]: [usize; 2],
    shown: &[[u8; 3]],
    repeats: Option<&Repeats>,
    part: windows::Part,
    scale: f64,
) -> Canvas {
    let mut canvas = Canvas::new(width, height, [0; 3]);
    for (i, color) in shown.iter().enumerate() {
        canvas.set(i % width, i / width, *color);
    }
    let Some(r) = repeats else { return canvas };
    let [a, b] = r.sides_px.map(|v| v.map(|d| d / scale));
    let start = [0, 1].map(|k| part[k] as f64 + 0.5 * part[k + 2] as f64 - 0.5 * (a[k] + b[k]));
    let mut line = |from: [f64; 2], along: [f64; 2], color: [u8; 3]| {
        let steps = (2.0 * along[0].hypot(along[1])).ceil();
        for k in 0..=steps as usize {
            let at = [0, 1].map(|c| from[c] + along[c] * k as f64 / steps);
            for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)] {
                let place = [at[0] + dx, at[1] + dy];
                if place[0] >= 0.0 && place[1] >= 0.0 && place[0] < width as f64 && place[1] < height as f64 {
                    canvas.set(place[0] as usize, place[1] as usize, color);
                }
            }
        }
    };
    for (m, n) in [(-1, 0), (1, 0), (0, -1), (0, 1), (0, 0)] {
        let color = if (m, n) == (0, 0) { [255, 60, 60] } else { [255, 200, 60] };
        let corner = [0, 1].map(|c| start[c] + f64::from(m) * a[c] + f64::from(n) * b[c]);
        line(corner, a, color);
        line(corner, b, color);
        line([corner[0] + a[0], corner[1] + a[1]], b, color);
        line([corner[0] + b[0], corner[1] + b[1]], a, color);
    }
    canvas
}

#[cfg(test)]
mod tests;

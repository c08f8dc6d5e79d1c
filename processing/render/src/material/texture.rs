//! Pictures over (u, v).

use crate::scene::{Color, Coverage, Value};
use crate::vector::number;
use nacre_base::{Error, Result};
use nacre_frames::Transfer;
use nacre_image::{Light, Raster, Samples, read, read_light};
use nacre_maps::{Kind, Maps, segment};
use std::path::Path;

/// A picture with N channels, row 0 at the top (v = 1).
pub(crate) struct Picture<const N: usize> {
    pub width: usize,
    pub height: usize,
    pub values: Vec<[f32; N]>,
}

/// A constant or a picture.
pub(crate) enum Over<const N: usize> {
    Same([f64; N]),
    Picture(Picture<N>),
}

impl<const N: usize> Picture<N> {
    /// The pixel at a position; (u, v) are periodic.
    fn nearest(&self, [u, v]: [f64; 2]) -> [f32; N] {
        let x = ((u - u.floor()) * self.width as f64) as usize;
        let y = ((1.0 - (v - v.floor())) * self.height as f64) as usize;
        self.values[y.min(self.height - 1) * self.width + x.min(self.width - 1)]
    }

    /// Bilinear interpolation between pixel centres; edge values continue.
    fn smooth(&self, [u, v]: [f64; 2]) -> [f64; N] {
        // Exactly 1 is the edge of the last pixel, not of the first.
        let wrap = |t: f64| if (0.0..=1.0).contains(&t) { t } else { t - t.floor() };
        let x = wrap(u) * self.width as f64 - 0.5;
        let y = (1.0 - wrap(v)) * self.height as f64 - 0.5;
        let (left, top) = (x.floor(), y.floor());
        let (fx, fy) = (x - left, y - top);
        let at = |i: f64, j: f64| {
            let x = (left + i).clamp(0.0, self.width as f64 - 1.0) as usize;
            let y = (top + j).clamp(0.0, self.height as f64 - 1.0) as usize;
            self.values[y * self.width + x].map(f64::from)
        };
        let [a, b, c, d] = [at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0), at(1.0, 1.0)];
        std::array::from_fn(|k| (a[k] * (1.0 - fx) + b[k] * fx) * (1.0 - fy) + (c[k] * (1.0 - fx) + d[k] * fx) * fy)
    }
}

impl<const N: usize> Over<N> {
    /// Value at a position.
    pub(crate) fn at(&self, uv: [f64; 2]) -> [f64; N] {
        match self {
            Self::Same(value) => *value,
            Self::Picture(picture) => picture.smooth(uv),
        }
    }
}

/// Reads a picture. Values of 8 and 16 bits are scaled to 0 to 1, and linearised by the sRGB curve if they are colours.
/// Colours of other primaries are converted to Rec. 709.
fn picture<const N: usize>(path: &Path, color: bool, [low, high]: [f32; 2]) -> Result<Picture<N>> {
    let light = if color { read_light(path, None).ok() } else { None };
    let raster = match light {
        Some(Light { width, height, rgb, .. }) => {
            Raster { width, height, channels: 3, samples: Samples::F32(rgb.into_flattened()) }
        }
        None => read(path)?,
    };
    let info = raster.info();
    let (channels, full) = (raster.channels, info.depth.full_scale());
    let values: Vec<f32> = match raster.samples {
        Samples::U8(v) => v.into_iter().map(|v| f32::from(v) / full).collect(),
        Samples::U16(v) => v.into_iter().map(|v| f32::from(v) / full).collect(),
        Samples::F32(v) => v,
    };
    let integer = info.depth != nacre_image::Depth::F32;
    let decode = |v: f32| if color && integer { Transfer::Srgb.decode(v) } else { v };
    let pixel = |p: &[f32]| -> [f32; N] {
        std::array::from_fn(|k| {
            let mean = p.iter().sum::<f32>() / p.len() as f32;
            decode(if N == 1 { mean } else { p[k.min(p.len() - 1)] })
        })
    };
    let values: Vec<[f32; N]> = values.chunks_exact(channels).map(pixel).collect();
    if let Some(i) = values.iter().position(|p| p.iter().any(|v| !(low..=high).contains(v))) {
        let problem = format!("has {:?} in column {}, row {}", values[i], i % info.width, i / info.width);
        return Err(Error::file(path, problem, format!("give values from {low} to {high}")));
    }
    Ok(Picture { width: info.width, height: info.height, values })
}

/// Reads a number or a grey picture.
///
/// # Errors
/// `Input` for other values, and for numbers out of range.
pub(crate) fn value(key: &str, of: &Value, folder: &Path, limits: [f64; 2]) -> Result<Over<1>> {
    match of {
        Value::Number(v) => Ok(Over::Same([number(key, *v, limits)?])),
        Value::File(file) => picture(&folder.join(file), false, limits.map(|v| v as f32)).map(Over::Picture),
    }
}

/// Reads a coverage; also returns warnings.
///
/// # Errors
/// `Input` unless it is a number from 0 to 1, a picture, or a photograph with a bright and a dark part.
pub(crate) fn coverage(key: &str, of: &Coverage, folder: &Path) -> Result<(Over<1>, Vec<String>)> {
    match of {
        Coverage::Number(v) => Ok((Over::Same([number(key, *v, [0.0, 1.0])?]), vec![])),
        Coverage::File(file) => Ok((Over::Picture(picture(&folder.join(file), false, [0.0, 1.0])?), vec![])),
        Coverage::Bright(bright) => {
            let found = segment(&folder.join(&bright.photograph), bright.threshold)?;
            let values = found.inside.iter().map(|inside| [f32::from(u8::from(*inside))]).collect();
            let warnings = found.report.warnings.iter().map(|w| format!("{key}: {w}")).collect();
            Ok((Over::Picture(Picture { width: found.width, height: found.height, values }), warnings))
        }
    }
}

/// Reads a colour or a colour picture, 0 to 1.
///
/// # Errors
/// `Input` for other values.
pub(crate) fn color(key: &str, of: &Color, folder: &Path) -> Result<Over<3>> {
    match of {
        Color::Rgb(rgb) if rgb.iter().all(|v| (0.0..=1.0).contains(v)) => Ok(Over::Same(rgb.map(f64::from))),
        Color::Rgb(rgb) => Err(Error::input(key, format!("is {rgb:?}"), "give three numbers from 0 to 1")),
        Color::File(file) => picture(&folder.join(file), true, [0.0, 1.0]).map(Over::Picture),
    }
}

/// Reads normals from a picture: (n + 1)/2, or n itself in an EXR with negative values.
///
/// # Errors
/// `Input` for a picture without normals.
pub(crate) fn normals(file: &Path) -> Result<Over<3>> {
    let mut normals = picture::<3>(file, false, [-1.0, 1.0])?;
    let signed = normals.values.iter().any(|n| n.iter().any(|v| *v < 0.0));
    for (i, n) in normals.values.iter_mut().enumerate() {
        if !signed {
            *n = n.map(|v| 2.0 * v - 1.0);
        }
        if n[2] <= 0.0 {
            let problem =
                format!("has a normal that points down in column {}, row {}", i % normals.width, i / normals.width);
            return Err(Error::file(file, problem, "give normals of the surface's own frame, up positive"));
        }
    }
    Ok(Over::Picture(normals))
}

/// Orientation (rad) and period (µm) as pictures; NaN where masked.
pub(crate) struct Grooves {
    pub orientation: Option<Picture<1>>,
    pub period: Option<Picture<1>>,
    /// Standard deviation of the orientation, for display only.
    pub sigma: Option<Vec<f32>>,
    pub repeat: [f64; 2],
    pub longest_um: f64,
}

impl Grooves {
    /// Reads orientation and period maps.
    ///
    /// # Errors
    /// `Input` for other files.
    pub(crate) fn read(path: &Path, repeat: [f64; 2]) -> Result<Self> {
        let maps = Maps::read(path)?;
        let (width, height) = (maps.width, maps.height);
        let of = |kind: Kind| {
            let map = maps.maps.get(&kind)?;
            let known = map.value.iter().zip(&map.mask);
            let values = known.map(|(v, m)| [if *m > 0.0 { *v } else { f32::NAN }]).collect();
            Some(Picture { width, height, values })
        };
        let (orientation, period) = (of(Kind::Orientation), of(Kind::Period));
        let sigma = maps.maps.get(&Kind::Orientation).map(|map| map.sigma.clone());
        let longest_um = period
            .as_ref()
            .map_or(0.0, |p| p.values.iter().filter(|v| v[0].is_finite()).fold(0.0_f64, |m, v| m.max(v[0].into())));
        Ok(Self { orientation, period, sigma, repeat, longest_um })
    }

    /// Whether it has orientations, and periods.
    pub(crate) fn has(&self) -> [bool; 2] {
        [self.orientation.is_some(), self.period.is_some()]
    }

    /// Orientation and period at a position, if the maps have them; `None` if either is masked.
    pub(crate) fn at(&self, uv: [f64; 2]) -> Option<[Option<f64>; 2]> {
        let uv = [0, 1].map(|k| uv[k] * self.repeat[k]);
        let of = |picture: &Option<Picture<1>>| match picture {
            Some(picture) => {
                let [v] = picture.nearest(uv);
                if v.is_finite() { Some(Some(f64::from(v))) } else { None }
            }
            None => Some(None),
        };
        Some([of(&self.orientation)?, of(&self.period)?])
    }
}

//! Lookup tables over half vectors, as written by `nacre reconstruct lut`.

use nacre_base::{Error, Result};
use nacre_image::read_exr;
use nacre_optics::color::linear_srgb;
use std::path::Path;

/// Smallest and largest number of entries along a side.
const SIZES: std::ops::RangeInclusive<usize> = 4..=4096;

/// A lookup table `S_d` over the tangential part of `h = ωi + ωo`, in linear sRGB. A surface then reflects
/// `f_r = (1 + ωi·ωo)² / (cos θi cos θo) · S_d(h)` (2017 TOG, Eq. 9); the factor `4π² F²` is included in the table.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Entries along a side.
    pub size: usize,
    /// Largest component of `h`: entries are the centres of `size` cells from `-extent` to `extent`.
    pub extent: f64,
    /// Row by row; `h` increases to the right and upwards, so the first row is the uppermost.
    pub rgb: Vec<[f32; 3]>,
    /// Fraction of unmeasured entries, which count as dark.
    pub unknown: f64,
}

impl Table {
    /// A table from given entries.
    ///
    /// # Errors
    /// `Input` for invalid sizes, extents or entries.
    pub fn of(size: usize, extent: f64, rgb: Vec<[f32; 3]>) -> Result<Self> {
        Self::checked("table", size, extent, rgb)
    }

    fn checked(subject: &str, size: usize, extent: f64, mut rgb: Vec<[f32; 3]>) -> Result<Self> {
        let bad = |problem: String, remedy: &str| Err(Error::input(subject, problem, remedy));
        if !SIZES.contains(&size) || rgb.len() != size * size {
            let problem = format!("has {} entries for {size} x {size}", rgb.len());
            return bad(problem, "give a square table of 4 to 4096 entries along a side");
        }
        if !(extent > 0.0 && extent <= 2.0) {
            return bad(format!("reaches half vectors of {extent}"), "give one that reaches more than 0 and at most 2");
        }
        if rgb.as_flattened().iter().any(|v| v.is_infinite()) {
            return bad("holds infinite light".into(), "make the table anew");
        }
        let unknown = rgb.iter().filter(|p| p.iter().any(|v| v.is_nan())).count();
        if unknown == rgb.len() {
            return bad("knows no entry".into(), "make the table anew");
        }
        rgb.iter_mut().filter(|p| p.iter().any(|v| v.is_nan())).for_each(|p| *p = [0.0; 3]);
        let unknown = unknown as f64 / rgb.len() as f64;
        Ok(Self { size, extent, rgb, unknown })
    }

    /// A table sampled from a function of `h`.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn from_fn(size: usize, extent: f64, value: impl Fn([f64; 2]) -> [f64; 3]) -> Result<Self> {
        if !SIZES.contains(&size) {
            return Self::of(size, extent, vec![]);
        }
        let cell = 2.0 * extent / size as f64;
        let at = |i: usize| {
            let [x, y] = [i % size, size - 1 - i / size].map(|k| (k as f64 + 0.5) * cell - extent);
            value([x, y]).map(|v| v as f32)
        };
        Self::of(size, extent, (0..size * size).map(at).collect())
    }

    /// Reads the `lut.exr` of `nacre reconstruct lut`; a warped table is resampled to equidistant entries.
    ///
    /// # Errors
    /// `Input`, which names the file, if it is not such a table.
    pub fn read(path: &Path) -> Result<Self> {
        let Lut { size, extent, warp, rgb, unknown, .. } = Lut::read(path)?;
        let table = Self { size, extent, rgb, unknown };
        if warp == 1.0 {
            return Ok(table);
        }
        let even = |v: f64| v.signum() * (v.abs() / extent).powf(1.0 / warp) * extent;
        let even = Self::from_fn(size, extent, |h| table.at(h.map(even)).map(f64::from))?;
        Ok(Self { unknown, ..even })
    }

    /// Side of a cell.
    pub fn cell(&self) -> f64 {
        2.0 * self.extent / self.size as f64
    }

    /// Value at a half vector, interpolated between cell centres; 0 outside the table.
    #[inline]
    pub fn at(&self, [x, y]: [f64; 2]) -> [f32; 3] {
        if !(x.abs() <= self.extent && y.abs() <= self.extent) {
            return [0.0; 3];
        }
        let last = (self.size - 1) as f64;
        let place = |v: f64| ((v + self.extent) / self.cell() - 0.5).clamp(0.0, last);
        let (u, v) = (place(x), last - place(y));
        let (left, top) = ((u as usize).min(self.size - 2), (v as usize).min(self.size - 2));
        let (u, v) = ((u - left as f64) as f32, (v - top as f64) as f32);
        let i = top * self.size + left;
        let [a, b, c, d] = [i, i + 1, i + self.size, i + self.size + 1].map(|i| self.rgb[i]);
        std::array::from_fn(|k| (1.0 - v) * ((1.0 - u) * a[k] + u * b[k]) + v * ((1.0 - u) * c[k] + u * d[k]))
    }
}

/// Remedy for files that are not a lookup table.
pub(crate) const LUT_REMEDY: &str = "give the lut.exr of `nacre reconstruct lut`";

/// A `lut.exr` as written.
pub(crate) struct Lut {
    pub size: usize,
    pub extent: f64,
    /// Entries are equidistant in the `warp`-th root of the half vector over the extent.
    pub warp: f64,
    /// Name of the illuminant of the entries.
    pub illuminant: String,
    /// X, Y and Z of white under the illuminant, if the table contains it.
    pub white: Option<[f64; 3]>,
    /// Linear sRGB; unknown entries are dark.
    pub rgb: Vec<[f32; 3]>,
    /// Fraction of unknown entries.
    pub unknown: f64,
}

impl Lut {
    /// Reads and checks a lookup table.
    ///
    /// # Errors
    /// `Input`, which names the file, if it is not a lookup table.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let mut map = read_exr(path)?;
        let refuse = |problem: String| Err(Error::file(path, problem, LUT_REMEDY));
        let number = |name: &str| map.attributes.get(name).and_then(|t| t.trim().parse::<f64>().ok());
        let Some(extent) = number("extent") else {
            return refuse("does not say how far it reaches (attribute extent)".into());
        };
        let warp = number("warp").unwrap_or(1.0);
        if !((1.0..=15.0).contains(&warp) && warp % 2.0 == 1.0) {
            return refuse(format!("is warped by {warp}"));
        }
        let (width, height) = (map.width, map.height);
        if width != height {
            return refuse(format!("is {width} x {height} entries, not square"));
        }
        let illuminant = map.attributes.get("illuminant").cloned().unwrap_or_else(|| "E".into());
        let white = map.attributes.get("white").and_then(|text| {
            let numbers: Vec<f64> = text.split_whitespace().filter_map(|v| v.parse().ok()).collect();
            <[f64; 3]>::try_from(numbers).ok().filter(|v| v.iter().all(|v| (0.0..=100.0).contains(v)) && v[1] > 0.0)
        });
        let mut take = |name: &str| {
            map.take(name, path)
                .map_err(|_| Error::file(path, format!("has no channel {name}; a table has X, Y and Z"), LUT_REMEDY))
        };
        let [x, y, z] = [take("X")?, take("Y")?, take("Z")?];
        if [&x, &y, &z].into_iter().flatten().any(|v| v.is_infinite()) {
            return refuse("holds infinite light".into());
        }
        let rgb = (0..x.len()).map(|i| linear_srgb([x[i], y[i], z[i]])).collect();
        let Table { size, extent, rgb, unknown } = Table::checked(&path.display().to_string(), width, extent, rgb)?;
        Ok(Self { size, extent, warp, illuminant, white, rgb, unknown })
    }
}

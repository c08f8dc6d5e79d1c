//! Lookup tables over half vectors (2017 TOG): `f = S(ωi + ωo) (1 + ωi·ωo)² / (cos θi cos θo)` per channel of linear
//! sRGB.

use crate::environment::factor::{Factors, Settings};
use crate::environment::{self, Entry, LUT_REMEDY, Lut, Reflected, correlate, entry, light};
use nacre_base::progress::Silent;
use nacre_base::{Error, Result};
use nacre_optics::color::{Illuminant, Observer, linear_srgb};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Maximum number of entries along a side for albedo and sampling.
const COARSE: usize = 192;

/// Sines of view along a side of the albedo texture for graphics cards.
pub(crate) const VIEWS: usize = 81;

/// Maximum number of entries along a side that are factorised: environments for two passes have no finer pixels.
const FACTORED: usize = 256;

/// A prepared lookup table.
pub(crate) struct Table {
    pub size: usize,
    pub extent: f64,
    pub warp: f64,
    /// Linear sRGB, relative to the table's illuminant.
    pub rgb: Vec<[f32; 3]>,
    /// Fraction of unknown entries, which count as dark.
    pub unknown: f64,
    /// Reflection of a white sky: the albedo times the cosine of view, before scaling.
    white: Reflected,
    pub scale: f64,
    pub lossless: bool,
    /// Folder of its factorisation, if the scene names one.
    pub factors: Option<PathBuf>,
    /// White under the table's illuminant, in linear sRGB of the file's entries.
    white_point: [f64; 3],
    /// Cumulative sum over coarse entries, and their number along a side.
    running: Vec<f64>,
    coarse: usize,
}

impl Table {
    /// Reads a `lut.exr`.
    ///
    /// # Errors
    /// `Input` for other files.
    pub(crate) fn read(path: &Path, observer: Observer, albedo: f64, lossless: bool) -> Result<Self> {
        let lut = Lut::read(path)?;
        // The table's illuminant name must not be opened as a file: the table may come from an untrusted source.
        let white = match (Illuminant::named(&lut.illuminant), lut.white) {
            (Some(light), _) => light.white(observer),
            (None, white) => white,
        };
        let Some(white) = white else {
            let name: String = lut.illuminant.chars().take(60).collect();
            let problem = format!("is of a light {name:?} and does not say what is white under it");
            return Err(Error::file(path, problem, "make the table again, or under a light that is built in"));
        };
        let white = linear_srgb(white.map(|v| v as f32)).map(f64::from);
        let relative = |p: &[f32; 3]| [0, 1, 2].map(|c| (f64::from(p[c]) / white[c]) as f32);
        let rgb: Vec<[f32; 3]> = lut.rgb.iter().map(relative).collect();
        if rgb.iter().all(|v| v.iter().all(|c| *c <= 0.0)) {
            return Err(Error::file(path, "is dark everywhere", LUT_REMEDY));
        }
        let size = lut.size;
        let mut table = Self {
            white: Reflected::default(),
            size,
            extent: lut.extent,
            warp: lut.warp,
            rgb,
            unknown: lut.unknown,
            scale: 1.0,
            lossless,
            factors: None,
            white_point: white,
            running: vec![],
            coarse: size.min(COARSE),
        };
        table.prepare();
        table.white = correlate(
            COARSE,
            |h| table.around(h, 2.0 / COARSE as f64),
            |_| light(COARSE, 1.0 / COARSE as f64, |_| 1.0),
            &Silent,
        )?;
        let most = table.white.at([0.0, 0.0, 1.0]).into_iter().fold(0.0, f64::max);
        table.scale = albedo / most.max(1e-300);
        Ok(table)
    }

    /// The resampled table and its factorisation. It is read from the table's folder, or computed with as many terms as
    /// the error requires; at most `rank` terms in either case.
    ///
    /// # Errors
    /// `Input` for a folder without curves of this table.
    pub(crate) fn factored(&self, rank: Option<usize>, max_error: f64) -> Result<(Factors, environment::Table)> {
        let table = self.even()?;
        let factors = match (&self.factors, rank) {
            (None, _) => Factors::of(&table, &Settings { rank, max_error, ..Settings::default() })?,
            (Some(folder), None) => Factors::read(folder, &table, self.white_point.map(|v| 1.0 / v))?,
            (Some(folder), Some(rank)) => {
                Factors::read(folder, &table, self.white_point.map(|v| 1.0 / v))?.truncated(&table, rank)
            }
        };
        Ok((factors, table))
    }

    /// The table with entries equidistant in the half vector: its original entries, or means of them if it has more
    /// than [`FACTORED`] along a side.
    fn even(&self) -> Result<environment::Table> {
        if self.warp == 1.0 && self.size <= FACTORED {
            return environment::Table::of(self.size, self.extent, self.rgb.clone());
        }
        let n = self.size.min(FACTORED);
        let cell = 2.0 * self.extent / n as f64;
        let many = 2 * self.size.div_ceil(n);
        let within = |k: usize| ((k as f64 + 0.5) / many as f64 - 0.5) * cell;
        environment::Table::from_fn(n, self.extent, |[x, y]| {
            let mut sum = [0.0; 3];
            for k in 0..many * many {
                let rgb = self.raw([x + within(k % many), y + within(k / many)]);
                (0..3).for_each(|c| sum[c] += rgb[c] / (many * many) as f64);
            }
            sum
        })
    }

    /// Prepares sampling: means over coarse entries.
    fn prepare(&mut self) {
        let n = self.coarse;
        let cell = 2.0 * self.extent / n as f64;
        let middle = |k: usize| (k as f64 + 0.5) * cell - self.extent;
        let mut coarse: Vec<[f64; 3]> = vec![[0.0; 3]; n * n];
        let many = self.size.div_ceil(n).max(1) * 2;
        coarse.par_iter_mut().enumerate().for_each(|(i, out)| {
            for s in 0..many * many {
                let sub = |k: usize| ((k as f64 + 0.5) / many as f64 - 0.5) * cell;
                let rgb = self.raw([middle(i % n) + sub(s % many), middle(i / n) + sub(s / many)]);
                (0..3).for_each(|c| out[c] += rgb[c] / (many * many) as f64);
            }
        });
        let mut sum = 0.0;
        let brightest = coarse.iter().map(|v| v.iter().sum::<f64>()).fold(0.0, f64::max);
        self.running = coarse
            .iter()
            .map(|v| {
                // Every entry has a positive probability.
                sum += v.iter().sum::<f64>().max(0.0) + 1e-4 * brightest;
                sum
            })
            .collect();
    }

    /// Mean over a cell of half vectors, so that edges and details narrower than a cell have the correct weight.
    pub(crate) fn around(&self, [x, y]: [f64; 2], cell: f64) -> Entry {
        // An even number: the table's edge may run through the centre of a cell, which it then halves exactly.
        let count = 2 * (0.5 * cell * self.size as f64 / self.extent).ceil().clamp(2.0, 8.0) as usize;
        let at = |k: usize| ((k as f64 + 0.5) / count as f64 - 0.5) * cell;
        let mut sum = [[0.0; 3]; 3];
        if x.abs().max(y.abs()) > self.extent + cell {
            return sum;
        }
        for i in 0..count * count {
            let h = [x + at(i % count), y + at(i / count)];
            let part = entry(self.raw(h), h);
            sum.as_flattened_mut().iter_mut().zip(part.as_flattened()).for_each(|(s, p)| *s += p);
        }
        sum.map(|power| power.map(|v| v / (count * count) as f64))
    }

    /// Albedo times cos θ at [`VIEWS`] sines of view along a side; beyond the circle, the value at its rim.
    pub(crate) fn albedo(&self) -> impl Iterator<Item = [f64; 3]> + '_ {
        (0..VIEWS * VIEWS).map(|i| {
            let at = |k: usize| (2.0 * k as f64 / (VIEWS - 1) as f64 - 1.0) * 0.999;
            let [x, y] = [at(i % VIEWS), at(i / VIEWS)];
            let shrink = (0.999 / x.hypot(y).max(1e-9)).min(1.0);
            let [x, y] = [x * shrink, y * shrink];
            self.albedo_cos([x, y, (1.0 - x * x - y * y).max(0.0).sqrt()])
        })
    }

    /// The table's original entry at a half vector, by linear interpolation; dark outside.
    pub(crate) fn raw(&self, h: [f64; 2]) -> [f64; 3] {
        let place = |v: f64| {
            let even = (v / self.extent).abs().powf(1.0 / self.warp).copysign(v);
            (even + 1.0) * 0.5 * self.size as f64 - 0.5
        };
        if h[0].abs() > self.extent || h[1].abs() > self.extent {
            return [0.0; 3];
        }
        // The first row is the uppermost.
        let (x, y) = (place(h[0]), place(-h[1]));
        let last = self.size as f64 - 1.0;
        let (left, top) = (x.clamp(0.0, last).floor().min(last - 1.0), y.clamp(0.0, last).floor().min(last - 1.0));
        let (fx, fy) = ((x - left).clamp(0.0, 1.0), (y - top).clamp(0.0, 1.0));
        let at = |i: usize, j: usize| self.rgb[(top as usize + j) * self.size + left as usize + i];
        let [a, b, c, d] = [at(0, 0), at(1, 0), at(0, 1), at(1, 1)];
        [0, 1, 2].map(|k| {
            let [a, b, c, d] = [a[k], b[k], c[k], d[k]].map(f64::from);
            (a * (1.0 - fx) + b * fx) * (1.0 - fy) + (c * (1.0 - fx) + d * fx) * fy
        })
    }

    /// Albedo times cos θ of a direction of view.
    fn albedo_cos(&self, view: [f64; 3]) -> [f64; 3] {
        self.white.at(view).map(|v| v * self.scale)
    }

    /// BRDF times the cosine of incidence, linear sRGB under the table's illuminant.
    pub(crate) fn scattered(&self, light: [f64; 3], view: [f64; 3]) -> [f64; 3] {
        if light[2] <= 0.0 || view[2] <= 0.0 {
            return [0.0; 3];
        }
        let dot: f64 = (0..3).map(|k| light[k] * view[k]).sum();
        let gain = self.scale * (1.0 + dot).powi(2);
        let whole = self.whole(view);
        let rgb = self.raw([light[0] + view[0], light[1] + view[1]]);
        [0, 1, 2].map(|c| rgb[c] * gain / whole[c])
    }

    /// Divisor of the reflected light for a direction of view, which prevents reflection of more than the incident
    /// light.
    pub(crate) fn whole(&self, view: [f64; 3]) -> [f64; 3] {
        let least = if self.lossless { 1e-9 } else { view[2].max(1e-9) };
        self.albedo_cos(view).map(|albedo| albedo.max(least))
    }

    /// Cells along a side for sampling half vectors, and the share of draws of each; rows go up.
    pub(crate) fn shares(&self) -> (usize, Vec<f64>) {
        let total = self.running.last().copied().unwrap_or(1.0);
        let before = std::iter::once(&0.0).chain(&self.running);
        (self.coarse, self.running.iter().zip(before).map(|(to, from)| (to - from) / total).collect())
    }

    /// A direction of light from two numbers from 0 to 1; it may lie below the horizon.
    pub(crate) fn sample(&self, view: [f64; 3], u: [f64; 2]) -> Option<[f64; 3]> {
        let n = self.coarse;
        let total = self.running[n * n - 1];
        let wanted = u[0] * total;
        let k = self.running.partition_point(|r| *r <= wanted).min(n * n - 1);
        let before = if k == 0 { 0.0 } else { self.running[k - 1] };
        let within = [((wanted - before) / (self.running[k] - before)).clamp(0.0, 1.0), u[1]];
        let cell = 2.0 * self.extent / n as f64;
        let h = [(k % n) as f64 + within[0], (k / n) as f64 + within[1]].map(|v| v * cell - self.extent);
        let [x, y] = [h[0] - view[0], h[1] - view[1]];
        let square = x * x + y * y;
        (square < 1.0).then(|| [x, y, (1.0 - square).sqrt()])
    }

    /// Density of [`Self::sample`] per solid angle.
    pub(crate) fn density(&self, light: [f64; 3], view: [f64; 3]) -> f64 {
        let n = self.coarse;
        let cell = 2.0 * self.extent / n as f64;
        let place = |k: usize| ((light[k] + view[k] + self.extent) / cell).floor();
        let (x, y) = (place(0), place(1));
        let inside = |v: f64| v >= 0.0 && v < n as f64;
        if !(inside(x) && inside(y)) {
            return 0.0;
        }
        let k = y as usize * n + x as usize;
        let before = if k == 0 { 0.0 } else { self.running[k - 1] };
        (self.running[k] - before) / self.running[n * n - 1] / (cell * cell) * light[2]
    }
}

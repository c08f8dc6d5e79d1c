//! Spectra over wave numbers `ν = 1/λ` (1/µm), and their tristimulus values.

use crate::light::viewer::{RANGE, Viewer};
use crate::scene;
use crate::vector::number;
use nacre_base::{Error, Result};
use nacre_brdf::RANGE_NM;
use nacre_optics::color::{Illuminant, Observer, linear_srgb, xyz_of_linear_srgb};
use nalgebra::Matrix3;
use std::path::Path;

/// Number of points of a table.
const POINTS: usize = 2001;

/// Standard deviation of a spectral line in nm.
const LINE_NM: f64 = 0.85;

/// Boundaries of the three parts of D65 that represent linear sRGB, and width of their transition, in nm.
const MEET_NM: [f64; 2] = [495.0, 585.0];
const SOFT_NM: f64 = 12.0;

/// A light's spectrum as seen by a viewer.
pub(crate) struct Seen {
    /// X, Y, Z (or three bands) per wave number, at equidistant wave numbers; the observer's Y of the whole light is 1.
    pub table: Vec<[f64; 3]>,
    /// First wave number and step.
    pub first: f64,
    pub step: f64,
    /// Wave-number step at which sums over the spectrum alone are accurate.
    pub fine: f64,
    /// Contributions to X, Y, Z (or to the bands) of unit red, green and blue reflectance in linear sRGB.
    colors: [[f64; 3]; 3],
    /// Linear sRGB of the light itself, as seen by the observer.
    pub rgb: [f64; 3],
}

/// Equidistant wave numbers over a range, with the weights of the trapezoid rule.
fn points([from, to]: [f64; 2]) -> impl Iterator<Item = (f64, f64)> {
    let step = (to - from) / (POINTS - 1) as f64;
    (0..POINTS).map(move |k| (from + step * k as f64, if k == 0 || k == POINTS - 1 { 0.5 * step } else { step }))
}

/// dλ/dν in nm, times 1e-3.
fn per_number(number: f64) -> f64 {
    1.0 / (number * number)
}

impl Seen {
    /// Tabulates a power over wavelengths, within a range of wave numbers; `None` if the observer does not see it.
    fn tabled(range: [f64; 2], viewer: Viewer, error: f64, power: impl Fn(f64) -> f64) -> Option<Self> {
        let weight = |number: f64| power(1e3 / number) * per_number(number);
        let white: f64 =
            points(range).map(|(number, w)| viewer.observer.at(1e3 / number)[1] * weight(number) * w).sum();
        if white.is_nan() || white <= 0.0 {
            return None;
        }
        let own = viewer.range();
        let both = [range[0].max(own[0]), range[1].min(own[1])];
        let range = if both[0] < both[1] { both } else { own };
        let step = (range[1] - range[0]) / (POINTS - 1) as f64;
        let seen = |number: f64| viewer.at(1e3 / number).map(|v| v * weight(number) / white);
        let table: Vec<[f64; 3]> = points(range).map(|(number, _)| seen(number)).collect();
        let sum = |stride: usize| {
            let mut sum = [0.0; 6];
            for (k, w) in table.iter().enumerate().step_by(stride) {
                let end = if k == 0 || k == POINTS - 1 { 0.5 } else { 1.0 };
                // Tested against a flat and a linear spectrum.
                let rise = k as f64 / POINTS as f64;
                (0..3).for_each(|c| {
                    sum[c] += w[c] * step * stride as f64 * end;
                    sum[c + 3] += w[c] * step * stride as f64 * end * rise;
                });
            }
            sum
        };
        let truth = sum(1);
        let off = |stride: usize| sum(stride).iter().zip(truth).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
        let scale = if viewer.bands.is_some() { truth[..3].iter().fold(0.0_f64, |m, v| m.max(*v)) } else { 1.0 };
        // Strides that divide the table, from the coarsest. If a finer one fails, a coarser one passed only by
        // coincidence.
        let strides = [125, 100, 80, 50, 40, 25, 20, 16, 10, 8, 5, 4, 2, 1];
        let right = strides.iter().rposition(|s| off(*s) > error * scale).map_or(0, |k| (k + 1).min(strides.len() - 1));
        let rgb = linear_srgb([0, 1, 2].map(|c| truth[c] as f32)).map(f64::from);
        let colors = [0, 1, 2].map(|k| xyz([0, 1, 2].map(|c| if c == k { rgb[k] } else { 0.0 })));
        Some(Self { table, first: range[0], step, fine: step * strides[right] as f64, colors, rgb })
    }

    /// Prepares a described spectrum; the error of sums over it is below `error`.
    ///
    /// # Errors
    /// `Input` for invalid and invisible lights.
    pub(crate) fn new(subject: &str, of: &scene::Spectrum, folder: &Path, viewer: Viewer, error: f64) -> Result<Self> {
        let found = match of {
            scene::Spectrum::LineNm(nm) => {
                let nm = number(subject, *nm, RANGE_NM)?;
                let range = [nm + 6.0 * LINE_NM, nm - 6.0 * LINE_NM].map(|nm| 1e3 / nm);
                Self::tabled(range, viewer, error, |at| (-0.5 * ((at - nm) / LINE_NM).powi(2)).exp())
            }
            scene::Spectrum::Named(name) => {
                let light = match Illuminant::named(name) {
                    Some(light) => light,
                    None if folder.join(name).exists() => Illuminant::of(&folder.join(name).to_string_lossy())?,
                    None => Illuminant::of(name)?,
                };
                Self::tabled(RANGE, viewer, error, |nm| light.spectrum.at(nm))
            }
        };
        let mut seen = found
            .ok_or_else(|| Error::input(subject, "has no light between 380 and 780 nm", "give another spectrum"))?;
        if viewer.bands.is_some() {
            seen.colors = Parts::new(viewer.observer, error)?.colors(&seen);
        }
        Ok(seen)
    }

    /// Linear sRGB of the light after reflection by a surface of this linear sRGB reflectance.
    #[inline]
    pub(crate) fn reflected(&self, rgb: [f64; 3]) -> [f64; 3] {
        let [r, g, b] = &self.colors;
        [0, 1, 2].map(|c| rgb[0] * r[c] + rgb[1] * g[c] + rgb[2] * b[c])
    }

    /// X, Y and Z per wave number.
    #[inline]
    pub(crate) fn at(&self, number: f64) -> [f64; 3] {
        let place = (number - self.first) / self.step;
        if !(0.0..=(POINTS - 1) as f64).contains(&place) {
            return [0.0; 3];
        }
        let k = (place as usize).min(POINTS - 2);
        let share = place - k as f64;
        let (a, b) = (&self.table[k], &self.table[k + 1]);
        [0, 1, 2].map(|c| a[c] + share * (b[c] - a[c]))
    }

    /// First and last wave number.
    pub(crate) fn range(&self) -> [f64; 2] {
        [self.first, self.first + self.step * (POINTS - 1) as f64]
    }
}

/// Spectra for linear sRGB: white is D65, and every colour is reproduced exactly. They are mixtures of three parts of
/// D65 that meet at 495 and 585 nm; the mixture of a saturated colour may be negative in places.
pub(crate) struct Upsampling {
    light: Seen,
    parts: Parts,
}

/// Factors on D65 that represent red, green and blue, over the visible wave numbers.
struct Parts(Vec<[f64; 3]>);

fn d65(viewer: Viewer, error: f64) -> Result<Seen> {
    Seen::new("environment", &scene::Spectrum::Named("D65".into()), Path::new(""), viewer, error)
}

impl Parts {
    fn new(observer: Observer, error: f64) -> Result<Self> {
        let light = d65(observer.into(), error)?;
        let raw = |k: usize| {
            let nm = 1e3 / (light.first + light.step * k as f64);
            let [low, high] = MEET_NM.map(|at| 0.5 + 0.5 * libm::tanh((nm - at) / SOFT_NM));
            [high, low - low * high, 1.0 - low]
        };
        // Colours of the three parts; the inverse matrix gives the mixture for a colour.
        let mut colors = Matrix3::<f64>::zeros();
        let mut sums = [[0.0; 3]; 3];
        for (k, w) in light.table.iter().enumerate() {
            let part = raw(k);
            for (j, sum) in sums.iter_mut().enumerate() {
                (0..3).for_each(|c| sum[c] += part[j] * w[c] * light.step);
            }
        }
        for (j, sum) in sums.iter().enumerate() {
            let rgb = linear_srgb(sum.map(|v| v as f32));
            (0..3).for_each(|c| colors[(c, j)] = f64::from(rgb[c]));
        }
        let inverse = colors.try_inverse().unwrap_or_else(Matrix3::identity);
        // The light's colour differs slightly from (1, 1, 1), since the range of 380 to 780 nm is truncated; white must
        // reproduce it.
        let shift: [f64; 3] = [0, 1, 2].map(|c| inverse.row(c).sum());
        let part = |k: usize| {
            let part = raw(k);
            [0, 1, 2].map(|c| (0..3).map(|j| part[j] * inverse[(j, c)] / shift[j]).sum())
        };
        Ok(Self((0..POINTS).map(part).collect()))
    }

    fn at(&self, number: f64) -> [f64; 3] {
        let place = (number - RANGE[0]) / (RANGE[1] - RANGE[0]) * (POINTS - 1) as f64;
        self.0[(place.round().max(0.0) as usize).min(POINTS - 1)]
    }

    /// Colours of unit red, green and blue reflectance under a light.
    fn colors(&self, light: &Seen) -> [[f64; 3]; 3] {
        let mut sums = [[0.0; 3]; 3];
        for ((number, weight), seen) in points(light.range()).zip(&light.table) {
            for (sum, part) in sums.iter_mut().zip(self.at(number)) {
                (0..3).for_each(|c| sum[c] += part * seen[c] * weight);
            }
        }
        sums
    }
}

impl Upsampling {
    pub(crate) fn new(viewer: Viewer, error: f64) -> Result<Self> {
        let parts = Parts::new(viewer.observer, error)?;
        let mut light = d65(viewer, error)?;
        if viewer.bands.is_none() {
            // Every colour is reproduced exactly.
            light.colors = [0, 1, 2].map(|k| xyz([0, 1, 2].map(|c| if c == k { 1.0 } else { 0.0 })));
        }
        Ok(Self { light, parts })
    }

    /// Contributions of unit red, green and blue to X, Y and Z (or to the bands) per wave number: by colour, then by X,
    /// Y, Z.
    pub(crate) fn at(&self, number: f64) -> [[f64; 3]; 3] {
        let xyz = self.light.at(number);
        self.parts.at(number).map(|p| xyz.map(|v| v * p))
    }

    /// X, Y, Z (or the bands) of linear sRGB.
    #[inline]
    pub(crate) fn seen(&self, rgb: [f64; 3]) -> [f64; 3] {
        self.light.reflected(rgb)
    }

    /// Wave-number step at which sums over the spectrum alone are accurate.
    pub(crate) fn fine(&self) -> f64 {
        self.light.fine
    }

    /// Smallest and largest visible wave number.
    pub(crate) fn range(&self) -> [f64; 2] {
        self.light.range()
    }
}

/// X, Y, Z of linear sRGB.
fn xyz(rgb: [f64; 3]) -> [f64; 3] {
    xyz_of_linear_srgb(rgb.map(|v| v as f32)).map(f64::from)
}

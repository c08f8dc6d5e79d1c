//! Light over wave numbers `ν = 1/λ` (1/µm), and what an observer sees of it.

use super::scene;
use super::vector::number;
use crate::color::{Illuminant, Observer, linear_srgb, xyz_of_linear_srgb};
use crate::surface::RANGE_NM;
use crate::{Error, Result};
use nalgebra::Matrix3;
use std::path::Path;

/// Least and most wave number that is seen, in 1/µm.
pub(super) const RANGE: [f64; 2] = [1e3 / RANGE_NM[1], 1e3 / RANGE_NM[0]];

/// Points of a table.
const POINTS: usize = 2001;

/// Width of a line: its standard deviation in nm.
const LINE_NM: f64 = 0.85;

/// Where parts of a spectrum that stands for linear sRGB meet, in nm, and how softly.
const MEET_NM: [f64; 2] = [495.0, 585.0];
const SOFT_NM: f64 = 12.0;

/// A light's spectrum as an observer sees it.
pub(super) struct Seen {
    /// X, Y, Z per wave number, at even wave numbers; that of Y adds up to 1.
    pub table: Vec<[f64; 3]>,
    /// First wave number and distance of two.
    pub first: f64,
    pub step: f64,
    /// Distance of wave numbers at which sums over the spectrum alone are right.
    pub fine: f64,
    /// Linear sRGB of the light itself.
    pub rgb: [f64; 3],
}

impl Seen {
    fn tabled(range: [f64; 2], observer: Observer, error: f64, power: impl Fn(f64) -> f64) -> Option<Self> {
        let step = (range[1] - range[0]) / (POINTS - 1) as f64;
        let weight = |k: usize| {
            let number = range[0] + step * k as f64;
            let nm = 1e3 / number;
            // dλ = dν/ν².
            observer.at(nm).map(|c| c * power(nm) / (number * number))
        };
        let mut table: Vec<[f64; 3]> = (0..POINTS).map(weight).collect();
        let sum = |stride: usize| {
            let mut sum = [0.0; 6];
            for (k, w) in table.iter().enumerate().step_by(stride) {
                let end = if k == 0 || k == POINTS - 1 { 0.5 } else { 1.0 };
                // Against a flat and a rising spectrum.
                let rise = k as f64 / POINTS as f64;
                (0..3).for_each(|c| {
                    sum[c] += w[c] * step * stride as f64 * end;
                    sum[c + 3] += w[c] * step * stride as f64 * end * rise;
                });
            }
            sum
        };
        let truth = sum(1);
        let white = truth[1];
        if white.is_nan() || white <= 0.0 {
            return None;
        }
        let off = |stride: usize| sum(stride).iter().zip(truth).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs()));
        // Strides that divide the table, from the coarsest; a finer one that is wrong means that a coarse one was right by chance.
        let strides = [125, 100, 80, 50, 40, 25, 20, 16, 10, 8, 5, 4, 2, 1];
        let right = strides.iter().rposition(|s| off(*s) > error * white).map_or(0, |k| (k + 1).min(strides.len() - 1));
        table.iter_mut().for_each(|w| w.iter_mut().for_each(|v| *v /= white));
        let xyz = [0, 1, 2].map(|c| (truth[c] / white) as f32);
        let rgb = linear_srgb(xyz).map(f64::from);
        Some(Self { table, first: range[0], step, fine: step * strides[right] as f64, rgb })
    }

    /// Of a description; sums over it are to be off by less than `error`.
    ///
    /// # Errors
    /// `Input` for lights that are none, or that nobody sees.
    pub(super) fn new(
        subject: &str,
        of: &scene::Spectrum,
        folder: &Path,
        observer: Observer,
        error: f64,
    ) -> Result<Self> {
        let dark = || Error::input(subject, "has no light between 380 and 780 nm", "give another spectrum");
        match of {
            scene::Spectrum::LineNm(nm) => {
                let nm = number(subject, *nm, RANGE_NM)?;
                let range = [nm + 6.0 * LINE_NM, nm - 6.0 * LINE_NM].map(|nm| 1e3 / nm);
                Self::tabled(range, observer, error, |at| (-0.5 * ((at - nm) / LINE_NM).powi(2)).exp()).ok_or_else(dark)
            }
            scene::Spectrum::Named(name) => {
                let light = match Illuminant::named(name) {
                    Some(light) => light,
                    None if folder.join(name).exists() => Illuminant::of(&folder.join(name).to_string_lossy())?,
                    None => Illuminant::of(name)?,
                };
                Self::tabled(RANGE, observer, error, |nm| light.spectrum.at(nm)).ok_or_else(dark)
            }
        }
    }

    /// X, Y and Z per wave number.
    #[inline]
    pub(super) fn at(&self, number: f64) -> [f64; 3] {
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
    pub(super) fn range(&self) -> [f64; 2] {
        [self.first, self.first + self.step * (POINTS - 1) as f64]
    }
}

/// Spectra for linear sRGB: white is D65, and every colour is seen as itself. Three parts of D65 that meet at 495 and 585 nm are mixed; the
/// mixture of a saturated colour can be negative somewhere.
pub(super) struct Upsampling {
    light: Seen,
    /// Parts of the spectrum that stand for red, green and blue, over the table's wave numbers.
    parts: Vec<[f64; 3]>,
}

impl Upsampling {
    pub(super) fn new(observer: Observer, error: f64) -> Result<Self> {
        let name = scene::Spectrum::Named("D65".into());
        let light = Seen::new("environment", &name, Path::new(""), observer, error)?;
        let raw = |k: usize| {
            let nm = 1e3 / (light.first + light.step * k as f64);
            let [low, high] = MEET_NM.map(|at| 0.5 + 0.5 * libm::tanh((nm - at) / SOFT_NM));
            [high, low - low * high, 1.0 - low]
        };
        // Colours of the three parts; the inverse tells how much of each a colour takes.
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
        // The light's own colour is not quite (1, 1, 1), as 380 to 780 nm is not all: white is to be it.
        let shift: [f64; 3] = [0, 1, 2].map(|c| inverse.row(c).sum());
        let parts = (0..POINTS)
            .map(|k| {
                let part = raw(k);
                [0, 1, 2].map(|c| (0..3).map(|j| part[j] * inverse[(j, c)] / shift[j]).sum())
            })
            .collect();
        Ok(Self { light, parts })
    }

    /// What red, green and blue of 1 add to X, Y and Z per wave number: by colour, then by X, Y, Z.
    pub(super) fn at(&self, number: f64) -> [[f64; 3]; 3] {
        let xyz = self.light.at(number);
        let k = (((number - self.light.first) / self.light.step).round().max(0.0) as usize).min(POINTS - 1);
        self.parts[k].map(|p| xyz.map(|v| v * p))
    }

    /// Distance of wave numbers at which sums over the spectrum alone are right.
    pub(super) fn fine(&self) -> f64 {
        self.light.fine
    }
}

/// X, Y, Z of linear sRGB.
pub(super) fn xyz(rgb: [f64; 3]) -> [f64; 3] {
    xyz_of_linear_srgb(rgb.map(|v| v as f32)).map(f64::from)
}

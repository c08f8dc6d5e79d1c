//! Spectral kernel that a table entry integrates along its ray.
//!
//! An order photographed at radius s with wavelength λm appears at radius r = s·λ/λm with wavelength λ. Each entry is
//! therefore an integral along its ray of the photograph (2017 paper, Eq. 15): `∫ (λm/λ)ⁿ L(r·λm/λ) P(λ) x̄(λ) dλ`.
//! With q = ln(λ/λm) it becomes a convolution over ln r: `∫ L(ln r − q) K(q) dq`, `K(q) = e^(−nq) P x̄ λ`, with the
//! same kernel for all entries.

use nacre_image::catmull_rom;
use nacre_optics::color::{Illuminant, Observer, VISIBLE_NM};

/// Maximum integration step in nm; lamp spectra are tabulated at 1 or 5 nm and interpolated linearly.
const FINE_NM: f64 = 0.25;

/// Fraction of the light that the default extent of a table may omit.
const IGNORED: f64 = 0.02;

/// X, Y, Z and coverage of one sample of the photograph.
pub(super) type Weight = [f32; 4];

/// Spectral weights of the light along a ray.
#[derive(Clone, Debug)]
pub(super) struct Kernel {
    pub wavelength_nm: f64,
    pub exponent: f64,
    pub observer: Observer,
    pub illuminant: Illuminant,
    /// Spectral window that the photograph represents: weight 0 to 1 over wavelength.
    window: Window,
}

/// Spectral window of one of several photographs: a triangle over three wavelengths; a missing outer slope is constant.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Window {
    pub below_nm: Option<f64>,
    pub middle_nm: f64,
    pub above_nm: Option<f64>,
}

impl Window {
    fn at(&self, nm: f64) -> f64 {
        let slope =
            |other: Option<f64>| other.map_or(1.0, |o| (1.0 - (nm - self.middle_nm) / (o - self.middle_nm)).max(0.0));
        if nm < self.middle_nm { slope(self.below_nm) } else { slope(self.above_nm) }
    }
}

/// Centres of fine wavelength intervals.
fn fine([from, to]: [f64; 2]) -> impl Iterator<Item = f64> {
    (0..((to - from) / FINE_NM) as usize).map(move |k| from + (k as f64 + 0.5) * FINE_NM)
}

/// Kernel sampled at uniform steps of ln r.
pub(super) struct Steps {
    /// Sample distance in ln r.
    pub step: f64,
    /// q of the first weight, in steps.
    pub first: isize,
    pub weights: Vec<Weight>,
}

impl Kernel {
    /// Kernel of a photograph that represents all wavelengths.
    pub(super) fn new(wavelength_nm: f64, exponent: f64, observer: Observer, illuminant: Illuminant) -> Self {
        Self { wavelength_nm, exponent, observer, illuminant, window: Window::default() }
    }

    /// Kernel of a photograph that represents the wavelengths of a window.
    pub(super) fn of_window(self, window: Window) -> Self {
        Self { wavelength_nm: window.middle_nm, window, ..self }
    }

    /// Range of contributing wavelengths in nm.
    fn range_nm(&self) -> [f64; 2] {
        let [low, high] = self.illuminant.spectrum.range_nm();
        let low = low.max(VISIBLE_NM[0]).max(self.window.below_nm.unwrap_or(0.0));
        [low, high.min(VISIBLE_NM[1]).min(self.window.above_nm.unwrap_or(f64::MAX))]
    }

    /// ln(λ/λm) of the shortest and the longest contributing wavelength.
    pub(super) fn range(&self) -> [f64; 2] {
        self.range_nm().map(|nm| (nm / self.wavelength_nm).ln())
    }

    /// λm/λ for the mean visible wavelength: ratio of the photograph's radius to the entry's radius.
    pub(super) fn stretch(&self) -> f64 {
        let add = |(sum, all): (f64, f64), nm: f64| {
            let y = self.density(nm, 1.0)[1];
            (sum + y * nm, all + y)
        };
        let (sum, all) = fine(self.range_nm()).fold((0.0, 0.0), add);
        if all > 0.0 { self.wavelength_nm * all / sum } else { 1.0 }
    }

    /// Wavelength in nm below which 2 % of X + Y + Z lies.
    pub(super) fn shortest_nm(&self) -> f64 {
        let seen = |nm: f64| self.density(nm, 1.0).iter().sum::<f64>();
        let (all, mut sum) = (fine(self.range_nm()).map(seen).sum::<f64>(), 0.0);
        let reached = |nm: &f64| {
            sum += seen(*nm);
            sum >= IGNORED * all
        };
        fine(self.range_nm()).find(reached).unwrap_or(self.range_nm()[0])
    }

    /// Y of uniform light, by which tables are normalised.
    fn white(&self) -> f64 {
        let seen = |nm: f64| self.illuminant.spectrum.at(nm) * self.observer.at(nm)[1];
        fine(VISIBLE_NM).map(|nm| seen(nm) * FINE_NM).sum()
    }

    /// P x̄, P ȳ and P z̄ times (λm/λ)ⁿ per nm, relative to white.
    fn density(&self, nm: f64, white: f64) -> [f64; 3] {
        let power = self.illuminant.spectrum.at(nm) * self.window.at(nm) / white;
        let factor = power * (self.wavelength_nm / nm).powf(self.exponent);
        self.observer.at(nm).map(|seen| factor * seen)
    }

    /// Integral of (X + Y + Z) over all wavelengths of the light, to which coverage refers. Excludes the exponent, so
    /// that the windows of several photographs sum to one.
    fn all(&self, white: f64) -> f64 {
        let seen = |nm: f64| self.illuminant.spectrum.at(nm) * self.observer.at(nm).iter().sum::<f64>();
        fine(VISIBLE_NM).map(|nm| seen(nm) * FINE_NM).sum::<f64>() / white
    }

    /// Weights at uniform steps of ln r. The kernel is integrated against piecewise cubic light, so that spectral lines
    /// narrower than a step are not blurred.
    pub(super) fn steps(&self, step: f64) -> Steps {
        let [low, high] = self.range();
        // Cubic interpolation needs one more sample on either side.
        let first = (low / step).floor() as isize - 1;
        let count = ((high / step).ceil() as isize - first + 3).max(4) as usize;
        let (white, mut sums) = (self.white(), vec![[0.0_f64; 4]; count]);
        let all = self.all(white);
        let [from, to] = self.range_nm();
        // A whole number of intervals per nm, so that the kinks of tabulated spectra fall on interval boundaries.
        let width = 1.0 / FINE_NM.min(0.25 * step * from).recip().ceil();
        let n = ((to - from) / width).round().max(1.0) as usize;
        for k in 0..n {
            let nm = from + (k as f64 + 0.5) * width;
            let place = (nm / self.wavelength_nm).ln() / step - first as f64;
            let left = (place as usize).clamp(1, count - 3);
            let weight = self.weight(nm, width, white, all);
            for (sum, part) in sums[left - 1..left + 3].iter_mut().zip(catmull_rom((place - left as f64) as f32)) {
                sum.iter_mut().zip(weight).for_each(|(s, w)| *s += f64::from(part) * w);
            }
        }
        Steps { step, first, weights: sums.into_iter().map(|w| w.map(|v| v as f32)).collect() }
    }

    /// Weights of a wavelength interval.
    fn weight(&self, nm: f64, width: f64, white: f64, all: f64) -> [f64; 4] {
        let [x, y, z] = self.density(nm, white).map(|d| d * width);
        let flat = (self.wavelength_nm / nm).powf(-self.exponent);
        [x, y, z, (x + y + z) * flat / all]
    }

    /// Wavelengths at fixed steps, integrated by the trapezoidal rule as in the paper: λm/λ and weight of each.
    pub(super) fn fixed(&self, step_nm: f64) -> Vec<(f32, Weight)> {
        let (white, [from, to]) = (self.white(), self.range_nm());
        let all = self.all(white);
        let first = (from / step_nm).ceil() as usize;
        let last = (to / step_nm).floor() as usize;
        let at = |k: usize| {
            let nm = k as f64 * step_nm;
            let weight = self.weight(nm, step_nm, white, all).map(|w| w as f32);
            ((self.wavelength_nm / nm) as f32, weight)
        };
        (first..=last).map(at).collect()
    }
}

impl Steps {
    /// λm/λ and weight of each sample.
    pub(super) fn taps(&self) -> Vec<(f32, Weight)> {
        let factor = |k: usize| (-(self.first + k as isize) as f64 * self.step).exp() as f32;
        self.weights.iter().enumerate().map(|(k, w)| (factor(k), *w)).collect()
    }
}

//! Fourier transforms of a patch's expansion terms, and the power density of `exp(ikwh)` from them.

use super::expansion::Expansion;
use super::geometry::Window;
use super::height::HeightField;
use super::transform::{AT_ONCE, Plan, Plane, Real};
use num_complex::Complex;
use pulp::Arch;

/// Largest memory of the transforms, in bytes.
pub(super) const MOST_BYTES: usize = 3 << 30;

/// Group size to which the number of terms is padded.
const LANES: usize = 8;

/// Slot of frequencies without light, for which no transform is stored.
const DARK: u32 = u32::MAX;

/// Heights normalised to -1 to 1, as the expansions need them.
pub(super) struct Relief<'a> {
    pub width: usize,
    pub height: usize,
    pub size_um: [f64; 2],
    /// Half the range in µm.
    pub half_um: f64,
    middle_um: f64,
    um: &'a [f64],
}

impl<'a> Relief<'a> {
    pub(super) fn new(field: &'a HeightField) -> Self {
        let [low, high] = field.ends_um();
        let (middle_um, half_um) = (0.5 * (low + high), (0.5 * (high - low)).max(1e-9));
        let (width, height) = (field.width, field.height);
        Self { width, height, size_um: field.size_um(), half_um, middle_um, um: &field.um }
    }

    /// Map from heights to -1 to 1.
    fn scale(&self) -> impl Fn(f64) -> f64 + use<> {
        let (middle, by) = (self.middle_um, 1.0 / self.half_um);
        move |h| ((h - middle) * by).clamp(-1.0, 1.0)
    }

    /// All heights, from -1 to 1.
    pub(super) fn scaled(&self) -> Vec<f64> {
        self.um.iter().copied().map(self.scale()).collect()
    }
}

/// Largest spatial frequencies, in 1/µm.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Largest components to the right and up.
    pub frequency: [f64; 2],
    /// Largest magnitude.
    pub length: f64,
}

impl From<[f64; 2]> for Limits {
    fn from(frequency: [f64; 2]) -> Self {
        Self { frequency, length: f64::INFINITY }
    }
}

/// Number of frequencies to each side up to the limits, in cycles per patch.
pub(super) fn reach(relief: &Relief, limits: Limits) -> [usize; 2] {
    let count = |f: f64, um: f64, n: usize| ((f * um).ceil() as usize).min((n - 1) / 2);
    let [x, y] = limits.frequency;
    [count(x, relief.size_um[0], relief.width), count(y, relief.size_um[1], relief.height)]
}

/// Peak memory in bytes while a bank is computed, for a patch with `height` rows.
pub(super) fn bytes<T: Real>(reach: [usize; 2], height: usize, expansion: &Expansion) -> usize {
    let plane = (2 * reach[0] + 1) * (2 * reach[1] + 1);
    let rows = (2 * reach[0] + 1) * height * if expansion.is_real() { AT_ONCE } else { 1 };
    (2 * plane * expansion.terms.next_multiple_of(LANES) + rows) * 2 * size_of::<T>()
}

/// Transforms of the terms of an expansion.
pub(super) struct Bank<T: Real> {
    pub expansion: Expansion,
    size_um: [f64; 2],
    half_um: f64,
    reach: [isize; 2],
    /// Index among the stored frequencies, or [`DARK`].
    slots: Vec<u32>,
    padded: usize,
    /// For each stored frequency, the real parts of all terms, then the imaginary parts.
    values: Vec<T>,
}

/// Transforms of the terms of an expansion, each with its factor, for frequencies within limits; also the number of
/// frequencies to the right and up.
pub(super) fn planes<T: Real>(
    relief: &Relief,
    expansion: &Expansion,
    limits: Limits,
    mut step: impl FnMut(),
) -> ([usize; 2], Vec<Plane<T>>) {
    let plan =
        Plan::<T>::new(relief.width, relief.height, reach(relief, limits), relief.size_um.map(|um| limits.length * um));
    let mut planes = Vec::with_capacity(expansion.terms);
    let heights = |y: usize| &relief.um[y * relief.width..][..relief.width];
    let scale = relief.scale();
    if expansion.is_real() {
        let stride = Plan::<T>::stride(relief.width);
        let fill = |y: usize, first: usize, lines: &mut [Complex<T>]| {
            expansion.pairs(heights(y), &scale, first, stride, lines);
        };
        planes.push(Plane::constant(T::one()));
        step();
        plan.series(expansion.terms - 1, &fill, &|n| expansion.factor(n + 1), |plane| {
            planes.push(plane);
            step();
        });
    } else {
        for term in 0..expansion.terms {
            let node = expansion.node(term);
            let fill = |y: usize, line: &mut [Complex<T>]| {
                for (to, h) in line.iter_mut().zip(heights(y)) {
                    let (sin, cos) = (node * scale(*h)).sin_cos();
                    *to = Complex::new(T::of(cos), T::of(-sin));
                }
            };
            planes.push(plan.complex(&fill));
            step();
        }
    }
    (plan.reach(), planes)
}

/// Working memory of a thread.
pub(super) struct Scratch<T> {
    near: Vec<(u32, f64)>,
    across: Vec<f64>,
    exact: Vec<f64>,
    coefficients: Vec<T>,
}

impl<T> Default for Scratch<T> {
    fn default() -> Self {
        Self { near: vec![], across: vec![], exact: vec![], coefficients: vec![] }
    }
}

impl<T: Real> Bank<T> {
    /// Computes the transforms. Frequencies are omitted that together hold less than a fraction `dark` of the light.
    pub(super) fn new(
        relief: &Relief,
        expansion: Expansion,
        limits: impl Into<Limits>,
        dark: f64,
        step: impl FnMut(),
    ) -> Self {
        let (reach, planes) = planes(relief, &expansion, limits.into(), step);
        let row = |n: usize, iy: isize, out: &mut [Complex<T>]| planes[n].row(iy, out);
        Self::pack(expansion, (relief.size_um, relief.half_um), reach, dark, row)
    }

    /// Bank from existing transforms of a patch of this size and half range of heights.
    ///
    /// `row(term, iy, out)` writes a term's transform for a row of frequencies, from the lowest.
    pub(super) fn pack(
        expansion: Expansion,
        (size_um, half_um): ([f64; 2], f64),
        reach: [usize; 2],
        dark: f64,
        row: impl Fn(usize, isize, &mut [Complex<T>]),
    ) -> Self {
        let reach = reach.map(|r| r as isize);
        let across = 2 * reach[0] as usize + 1;
        let padded = expansion.terms.next_multiple_of(LANES);
        let count = across * (2 * reach[1] as usize + 1);
        // All omitted frequencies together hold less than `dark` of the light.
        let least = (dark / count as f64).sqrt() / expansion.terms as f64;
        let (mut slots, mut values) = (vec![DARK; count], vec![]);
        let mut rows = vec![Complex::new(T::zero(), T::zero()); across * expansion.terms];
        for (slots, iy) in slots.chunks_mut(across).zip(-reach[1]..) {
            rows.chunks_mut(across).enumerate().for_each(|(n, out)| row(n, iy, out));
            for (k, slot) in slots.iter_mut().enumerate() {
                let terms = || rows[k..].iter().step_by(across);
                if terms().all(|c| c.norm_sqr().double() < least * least) {
                    continue;
                }
                *slot = (values.len() / (2 * padded)) as u32;
                let padding = || std::iter::repeat_n(T::zero(), padded - expansion.terms);
                values.extend(terms().map(|c| c.re).chain(padding()));
                values.extend(terms().map(|c| c.im).chain(padding()));
            }
        }
        Self { expansion, size_um, half_um, reach, slots, padded, values }
    }

    /// Omits all frequencies (in cycles per patch) for which `which` is false.
    pub(super) fn keep(&mut self, which: impl Fn([isize; 2]) -> bool) {
        let across = 2 * self.reach[0] + 1;
        for (k, slot) in self.slots.iter_mut().enumerate() {
            let at = [k as isize % across - self.reach[0], k as isize / across - self.reach[1]];
            if !which(at) {
                *slot = DARK;
            }
        }
    }

    /// Stored frequencies in cycles per patch.
    pub(super) fn lit(&self) -> impl Iterator<Item = [isize; 2]> {
        let across = 2 * self.reach[0] + 1;
        let lit = self.slots.iter().enumerate().filter(|(_, slot)| **slot != DARK);
        lit.map(move |(k, _)| [k as isize % across - self.reach[0], k as isize / across - self.reach[1]])
    }

    /// Fraction of the frequencies that are stored.
    pub(super) fn share(&self) -> f64 {
        self.bright() as f64 / self.slots.len() as f64
    }

    /// Number of stored frequencies.
    pub(super) fn bright(&self) -> usize {
        self.slots.iter().filter(|s| **s != DARK).count()
    }

    /// Collects the stored frequencies within `radius` of `place` (both in 1/µm), with their window weights.
    fn near(&self, place: [f64; 2], window: Window, radius: f64, scratch: &mut Scratch<T>) {
        let [cx, cy] = [place[0] * self.size_um[0], place[1] * self.size_um[1]];
        let range = |c: f64, um: f64, most: isize| {
            let r = radius * um;
            [((c - r).ceil() as isize).max(-most), ((c + r).floor() as isize).min(most)]
        };
        let [left, right] = range(cx, self.size_um[0], self.reach[0]);
        let [low, high] = range(cy, self.size_um[1], self.reach[1]);
        scratch.near.clear();
        if right < left {
            return;
        }
        let scale = -0.5 / (window.sigma * window.sigma);
        scratch.across.clear();
        let across = (left..=right).map(|ix| (scale * ((ix as f64 - cx) / self.size_um[0]).powi(2)).exp());
        scratch.across.extend(across);
        for iy in low..=high {
            let first = ((iy + self.reach[1]) * (2 * self.reach[0] + 1) + left + self.reach[0]) as usize;
            let slots = &self.slots[first..=first + (right - left) as usize];
            if slots.iter().all(|s| *s == DARK) {
                continue;
            }
            let down = window.peak() * (scale * ((iy as f64 - cy) / self.size_um[1]).powi(2)).exp();
            let lit = slots.iter().zip(&scratch.across).filter(|(s, _)| **s != DARK);
            scratch.near.extend(lit.map(|(s, w)| (*s, w * down)));
        }
    }

    /// Evaluates the functions of X of all terms.
    fn coefficients(&self, x: f64, scratch: &mut Scratch<T>) {
        scratch.exact.resize(self.expansion.terms, 0.0);
        self.expansion.coefficients(x, &mut scratch.exact);
        scratch.coefficients.clear();
        scratch.coefficients.extend(scratch.exact.iter().map(|c| T::of(*c)));
        scratch.coefficients.resize(self.padded, T::zero());
    }

    /// Power density in µm² at a spatial frequency in 1/µm, for `q = k (cos θi + cos θr)` in 1/µm.
    pub(super) fn density(
        &self,
        place: [f64; 2],
        q: f64,
        window: Window,
        radius: f64,
        scratch: &mut Scratch<T>,
    ) -> f64 {
        self.near(place, window, radius, scratch);
        if scratch.near.is_empty() {
            return 0.0;
        }
        self.coefficients(q * self.half_um, scratch);
        let Scratch { near, coefficients, .. } = scratch;
        Arch::new().dispatch(|| {
            let mut sum = 0.0;
            for (slot, weight) in near.iter() {
                let [re, im] = self.amplitude(*slot, coefficients);
                sum += weight * (re * re + im * im);
            }
            sum
        })
    }

    /// Amplitude of a stored frequency.
    #[inline(always)]
    fn amplitude(&self, slot: u32, coefficients: &[T]) -> [f64; 2] {
        let both = &self.values[slot as usize * 2 * self.padded..][..2 * self.padded];
        let (re, im) = both.split_at(self.padded);
        [dot(re, coefficients), dot(im, coefficients)]
    }

    /// Amplitude at a frequency in cycles per patch for `q` in 1/µm; 0 if it is not stored.
    pub(super) fn amplitude_at(&self, [ix, iy]: [isize; 2], q: f64, scratch: &mut Scratch<T>) -> [f64; 2] {
        if ix.abs() > self.reach[0] || iy.abs() > self.reach[1] {
            return [0.0; 2];
        }
        let slot = self.slots[((iy + self.reach[1]) * (2 * self.reach[0] + 1) + ix + self.reach[0]) as usize];
        if slot == DARK {
            return [0.0; 2];
        }
        self.coefficients(q * self.half_um, scratch);
        self.amplitude(slot, &scratch.coefficients)
    }

    /// Total power of all stored frequencies for `q`; 1 if none is omitted.
    #[cfg(test)]
    pub(super) fn total(&self, q: f64) -> f64 {
        let mut scratch = Scratch::default();
        self.coefficients(q * self.half_um, &mut scratch);
        (self.slots.iter().filter(|s| **s != DARK))
            .map(|slot| {
                let [re, im] = self.amplitude(*slot, &scratch.coefficients);
                re * re + im * im
            })
            .sum()
    }
}

#[inline(always)]
fn dot<T: Real>(a: &[T], b: &[T]) -> f64 {
    let mut sums = [T::zero(); LANES];
    for (a, b) in a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0) {
        for k in 0..LANES {
            sums[k] = sums[k] + a[k] * b[k];
        }
    }
    sums.iter().map(|s| s.double()).sum()
}

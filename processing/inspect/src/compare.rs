//! Differences of a registered sample from its reference, pixel by pixel, in standard deviations.

use crate::image::{Image, gaussian, phasor};
use crate::refine::Refined;
use crate::robust::{dot, double, fitted, local_scale, powers};
use crate::sheet::Sheet;
use nacre_base::statistics::{median, quantile};
use num_complex::{Complex32, Complex64};
use rayon::prelude::*;

/// Blur of both sheets in pixels. It lets interpolation reproduce edges, and averages the noise over about 18 pixels.
pub const BLUR_PX: f64 = 1.2;

/// Width of the edge of both pictures that is not compared, in pixels: there the blur lacks neighbours.
const MARGIN_PX: usize = 3;

/// Degree of the smooth background in both coordinates: of the gain of the polarization, its zero, and the brightness.
const GAIN_DEGREE: i32 = 2;
const ZERO_DEGREE: i32 = 1;
const LIGHT_DEGREE: i32 = 3;

/// Number of pixels that a background is fitted to at most.
const MOST_POINTS: usize = 40_000;

/// Medians and 90th percentiles of |z| of two components (Rayleigh) and of one (normal).
const MEDIAN_2: f32 = 1.1774;
const MEDIAN_1: f32 = 0.6745;
const PERCENTILE_90_2: f32 = 2.1460;
const PERCENTILE_90_1: f32 = 1.6449;

/// Edges: the share of pixels that are less structured, the share of edges that the term explains, and its smallest
/// value. Sampled by pixels and blurred, edges that lie otherwise differ by up to 7 % of the structure within the blur,
/// in 99 % of the structured pixels of eleven simulated sheets. Thresholds are at least five times the smallest value.
const STEEP: f64 = 0.9;
const AT_EDGES: f64 = 0.9;
const LEAST_EDGE: f32 = 0.03;

/// The same for orientations without brightness and for periods, of which pixels at edges hold no mean.
const LEAST_EDGE_NONLINEAR: f32 = 0.16;

/// Relative difference of two captures of one sheet that the smooth background does not explain. It turns an
/// orientation by 0.15°.
const SYSTEMATIC: f32 = 0.005;

/// The same for the logarithm of the brightness.
const SYSTEMATIC_LIGHT: f32 = 0.003;

/// Smallest standard deviation of the degree of polarization, the logarithm of the brightness and that of the period,
/// for designs and noise-free maps.
const LEAST: f32 = 1e-3;

/// Share of a blurred pixel that is overexposed above which the pixel is.
const OVEREXPOSED: f32 = 0.2;

/// Statistic of a pixel that is overexposed in the sample alone, in standard deviations.
const CERTAIN: f32 = 100.0;

/// One quantity: difference of the sample from the reference, and its standard deviation.
#[derive(Clone, Debug, Default)]
pub struct Difference {
    /// Sample minus reference, after the smooth background; NaN where it is not compared.
    pub value: Vec<f32>,
    /// Standard deviation, all known terms included.
    pub sigma: Vec<f32>,
}

/// Differences in the frame of the reference.
pub struct Differences {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Whether a pixel of the reference is seen in the sample.
    pub compared: Vec<bool>,
    /// Degree of polarization at twice the orientation: reference.
    pub reference: Vec<Complex32>,
    /// The same of the sample, after the background; NaN outside.
    pub sample: Vec<Complex32>,
    /// Standard deviation of each component of their difference.
    pub sigma: Vec<f32>,
    /// Logarithm of the brightness; empty if not known.
    pub light: Difference,
    /// Logarithm of the period; empty if not measured in both.
    pub period: Difference,
    /// Pixels that are overexposed in the sample alone.
    pub overexposed: Vec<bool>,
    /// Largest deviation of the quantities in standard deviations; 0 outside.
    pub statistic: Vec<f32>,
    /// Turn of the polarization of the sample relative to the reference in rad, by turn of the sheet and offset.
    pub turned: f64,
    /// Standard deviation of `turned` in rad.
    pub turned_sigma: f64,
    /// Residuals at edges of the reference, relative to the structure that pixels do not resolve.
    pub edge: f64,
}

/// Values of the sample at the pixels of the reference.
struct Warped {
    values: Vec<Option<[f32; 3]>>,
    variance: Vec<f32>,
    overexposed: Vec<bool>,
}

impl Differences {
    /// Compares two sheets.
    pub fn of(reference: &Sheet, sample: &Sheet, refined: &Refined) -> Self {
        let (width, height) = (reference.image.width, reference.image.height);
        let size = [width, height];
        let fixed = reference.image.blurred(BLUR_PX);
        let (fixed_variance, fixed_over) = blurred_noise(reference);
        let warped = Warped::of(size, sample, refined);
        let compared =
            (0..width * height).map(|i| warped.values[i].is_some() && fixed_over[i] < OVEREXPOSED && is_inner(size, i));
        let compared: Vec<bool> = compared.collect();
        let overexposed = (0..width * height).map(|i| compared[i] && warped.overexposed[i]).collect::<Vec<bool>>();
        let a: Vec<Complex32> = (0..width * height).map(|i| fixed.phasor(i)).collect();
        let raw = |i: usize| warped.values[i].map_or(Complex32::new(f32::NAN, f32::NAN), phasor);
        let b: Vec<Complex32> = (0..width * height).map(raw).collect();
        let gain = refined.gain.norm() as f32;
        let noise = |i: usize| {
            let own = fixed_variance[i] / fixed.values[i][2].powi(2);
            let other = warped.values[i].map_or(0.0, |v| warped.variance[i] / v[2].powi(2).max(1e-30));
            (own + gain * gain * other).sqrt().max(LEAST)
        };
        let noise: Vec<f32> = (0..width * height).map(noise).collect();
        let unit = |i: usize| refined.transform.unit((i % width) as f64, (i / width) as f64);
        let usable: Vec<usize> = (0..width * height).filter(|i| compared[*i] && !overexposed[*i]).collect();
        let some: Vec<usize> = usable.iter().copied().step_by(usable.len().div_ceil(MOST_POINTS).max(1)).collect();

        let terms = |i: usize, row: &mut Vec<Complex64>| background_terms(unit(i), double(b[i]), row);
        let fit = fitted(&some, &terms, &|i| double(a[i]), &|i| noise[i].into());
        let turned = fit.as_ref().map_or(refined.gain.arg(), |f| f[0].arg());
        let predicted = |i: usize| {
            let mut row = vec![];
            terms(i, &mut row);
            let value = fit.as_ref().map_or(refined.gain * double(b[i]), |f| dot(f, &row));
            Complex32::new(value.re as f32, value.im as f32)
        };
        let s: Vec<Complex32> =
            (0..width * height).into_par_iter().map(|i| if compared[i] { predicted(i) } else { b[i] }).collect();

        let slope = unresolved(&reference.image, &phasor);
        let off = |i: usize| (s[i] - a[i]).norm();
        let noise = scaled(size, &compared, &off, &noise, MEDIAN_2);
        let lit = reference.has_light && sample.has_light;
        let least = if lit { LEAST_EDGE } else { LEAST_EDGE_NONLINEAR };
        let edge = edge_share(&some, &off, &noise, &slope, PERCENTILE_90_2, least);
        let sigma = with_edges(&noise, &slope, edge);
        let sigma: Vec<f32> = sigma.iter().zip(&a).map(|(s, a)| s.hypot(SYSTEMATIC * a.norm())).collect();
        let light = light(size, &reference.image, &fixed, &warped, &noise, &compared, &some, &unit, lit);
        let period = period(size, reference, sample, refined, &compared, &slope);
        let statistic = (0..width * height)
            .map(|i| {
                let one = |d: &Difference| d.value.get(i).map_or(0.0, |v| (v / d.sigma[i]).abs());
                let rest = one(&light).max(one(&period));
                let own = if compared[i] { off(i) / sigma[i] } else { 0.0 };
                let all = [own, rest].into_iter().filter(|v| v.is_finite()).fold(0.0, f32::max);
                if overexposed[i] { all.max(CERTAIN) } else { all }
            })
            .collect();
        let turned_sigma = turn_sigma(&usable, &a, &sigma);
        Self {
            width,
            height,
            compared,
            reference: a,
            sample: s,
            sigma,
            light,
            period,
            overexposed,
            statistic,
            turned: -turned,
            turned_sigma,
            edge: edge.into(),
        }
    }

    /// Share of the reference that is seen in the sample.
    pub fn overlap(&self) -> f64 {
        self.compared.iter().filter(|c| **c).count() as f64 / self.compared.len().max(1) as f64
    }

    /// Difference of the orientation of a pixel in rad, and its standard deviation; `None` where one has no grating.
    pub fn orientation(&self, i: usize) -> Option<[f32; 2]> {
        let (a, s) = (self.reference[i], self.sample[i]);
        let least = a.norm().min(s.norm());
        let known = self.compared[i] && !self.overexposed[i] && least > 3.0 * self.sigma[i];
        known.then(|| [0.5 * (s * a.conj()).arg(), 0.5 * self.sigma[i] / least])
    }

    /// Difference of the degree of polarization of a pixel, by which the presence of a grating is judged.
    pub fn presence(&self, i: usize) -> Option<f32> {
        let of = |c: Complex32| c.norm();
        (self.compared[i] && !self.overexposed[i]).then(|| of(self.sample[i]) - of(self.reference[i]))
    }
}

/// Terms of the background of the polarization: a smooth gain, a smooth zero, and mirrored polarization, which an
/// imperfect analyser adds.
fn background_terms(unit: [f64; 2], sample: Complex64, row: &mut Vec<Complex64>) {
    row.clear();
    row.extend(powers(unit, GAIN_DEGREE).map(|p| p * sample));
    row.extend(powers(unit, ZERO_DEGREE).map(Complex64::from));
    row.push(sample.conj());
}

/// Whether a pixel is far enough from the edge of the picture for its blur to be complete.
fn is_inner([width, height]: [usize; 2], i: usize) -> bool {
    let within = |v: usize, count: usize| v >= MARGIN_PX && v + MARGIN_PX < count;
    within(i % width, width) && within(i / width, height)
}

impl Warped {
    fn of([width, height]: [usize; 2], sample: &Sheet, refined: &Refined) -> Self {
        let blurred = sample.image.blurred(BLUR_PX);
        let (variance, over) = blurred_noise(sample);
        let noise: Vec<[f32; 3]> = variance.into_iter().zip(over).map(|(v, o)| [v, o, 0.0]).collect();
        let noise = Image { values: noise, ..blurred.clone() };
        let place = |i: usize| refined.transform.at((i % width) as f64, (i / width) as f64);
        let inner = |[x, y]: [f64; 2]| {
            let within = |v: f64, count: usize| v >= MARGIN_PX as f64 && v + MARGIN_PX as f64 <= count as f64 - 1.0;
            within(x, sample.image.width) && within(y, sample.image.height)
        };
        let value = |i: usize| Some(place(i)).filter(|at| inner(*at)).and_then(|at| blurred.at(at));
        let values: Vec<Option<[f32; 3]>> =
            (0..width * height).into_par_iter().map(|i| value(i).filter(|v| v[2] > 0.0)).collect();
        let noise: Vec<[f32; 3]> =
            (0..width * height).into_par_iter().map(|i| noise.at(place(i)).unwrap_or_default()).collect();
        let variance = noise.iter().map(|n| n[0].max(0.0)).collect();
        Self { values, variance, overexposed: noise.iter().map(|n| n[1] > OVEREXPOSED).collect() }
    }
}

/// Variance of each component of the blurred polarized part, and the overexposed share of the blur.
fn blurred_noise(sheet: &Sheet) -> (Vec<f32>, Vec<f32>) {
    let kernel = gaussian(BLUR_PX);
    let one: f32 = kernel.iter().map(|k| k * k).sum();
    let over = |i: usize| f32::from(u8::from(sheet.overexposed[i]));
    let values = (0..sheet.sigma.len()).map(|i| [sheet.sigma[i].powi(2), over(i), 0.0]).collect();
    let blurred = Image { values, ..sheet.image.clone() }.blurred(BLUR_PX);
    (blurred.values.iter().map(|v| v[0] * one * one).collect(), blurred.values.iter().map(|v| v[1]).collect())
}

/// Structure that pixels do not resolve: standard deviation of a value within the blur, the largest of a pixel and its
/// neighbours. Sampling, interpolation and registration err in proportion to it.
fn unresolved(image: &Image, value: &(dyn Fn([f32; 3]) -> Complex32 + Sync)) -> Vec<f32> {
    let (width, height) = (image.width, image.height);
    let moments = image.values.iter().map(|v| {
        let value = value(*v);
        [value.re, value.im, value.norm_sqr()]
    });
    let moments = Image { values: moments.collect(), ..*image }.blurred(BLUR_PX);
    let own: Vec<f32> = moments.values.iter().map(|m| (m[2] - m[0] * m[0] - m[1] * m[1]).max(0.0).sqrt()).collect();
    let around = |i: usize| {
        let (x, y) = ((i % width) as i64, (i / width) as i64);
        let near = (-1..=1).flat_map(|v| (-1..=1).map(move |u| [x + u, y + v]));
        let inside = near.filter(|[u, v]| *u >= 0 && *v >= 0 && *u < width as i64 && *v < height as i64);
        inside.map(|[u, v]| own[v as usize * width + u as usize]).fold(0.0, f32::max)
    };
    (0..width * height).into_par_iter().map(around).collect()
}

/// Residual of registration and interpolation, relative to the slope of the reference.
///
/// With it, the differences of most of the steepest pixels are explained by noise. A floor accounts for undersampled
/// edges.
fn edge_share(
    some: &[usize],
    off: &dyn Fn(usize) -> f32,
    noise: &[f32],
    slope: &[f32],
    percentile: f32,
    floor: f32,
) -> f32 {
    let mut steep: Vec<f32> = some.iter().map(|i| slope[*i]).collect();
    let least = quantile(&mut steep, STEEP).unwrap_or(0.0).max(1e-6);
    let share = |i: &usize| {
        let excess = off(*i).powi(2) - (percentile * noise[*i]).powi(2);
        excess.max(0.0).sqrt() / (percentile * slope[*i])
    };
    let chosen = some.iter().filter(|i| slope[**i] >= least);
    let mut shares: Vec<f32> = chosen.map(share).filter(|s| s.is_finite()).collect();
    quantile(&mut shares, AT_EDGES).unwrap_or(0.0).max(floor)
}

/// Noise scaled to the residuals of the neighbourhood.
fn scaled(size: [usize; 2], compared: &[bool], off: &dyn Fn(usize) -> f32, noise: &[f32], of_median: f32) -> Vec<f32> {
    let deviation = |i: usize| Some(off(i) / noise[i]).filter(|d| compared[i] && d.is_finite());
    let scale = local_scale(size, &deviation, of_median);
    (0..noise.len()).map(|i| noise[i] * scale(i)).collect()
}

/// Standard deviations of noise and edges.
fn with_edges(noise: &[f32], slope: &[f32], edge: f32) -> Vec<f32> {
    noise.iter().zip(slope).map(|(n, s)| n.hypot(edge * s)).collect()
}

#[allow(clippy::too_many_arguments, reason = "one call, and each is another plane")]
fn light(
    size: [usize; 2],
    reference: &Image,
    fixed: &Image,
    warped: &Warped,
    noise: &[f32],
    compared: &[bool],
    some: &[usize],
    unit: &dyn Fn(usize) -> [f64; 2],
    known: bool,
) -> Difference {
    if !known {
        return Difference::default();
    }
    let count = size[0] * size[1];
    let log = |i: usize| warped.values[i].map_or(f32::NAN, |v| (v[2] / fixed.values[i][2]).ln());
    // The brightness averages all frames, and is half as noisy in variance as a polarized component.
    let noise: Vec<f32> = noise.iter().map(|n| (n * std::f32::consts::FRAC_1_SQRT_2).max(LEAST)).collect();
    let terms = |i: usize, row: &mut Vec<Complex64>| {
        row.clear();
        row.extend(powers(unit(i), LIGHT_DEGREE).map(Complex64::from));
    };
    let fit = fitted(some, &terms, &|i| Complex64::from(f64::from(log(i))), &|i| noise[i].into());
    let smooth = |i: usize| {
        let mut row = vec![];
        terms(i, &mut row);
        fit.as_ref().map_or(0.0, |f| dot(f, &row).re as f32)
    };
    let value: Vec<f32> = (0..count).map(|i| if compared[i] { log(i) - smooth(i) } else { f32::NAN }).collect();
    let slope = unresolved(reference, &|v| Complex32::new(v[2], 0.0));
    let slope: Vec<f32> = slope.iter().zip(&fixed.values).map(|(s, v)| s / v[2]).collect();
    let off = |i: usize| value[i].abs();
    let noise = scaled(size, compared, &off, &noise, MEDIAN_1);
    let edge = edge_share(some, &off, &noise, &slope, PERCENTILE_90_1, LEAST_EDGE);
    let sigma = with_edges(&noise, &slope, edge).iter().map(|s| s.hypot(SYSTEMATIC_LIGHT)).collect();
    Difference { value, sigma }
}

/// Logarithms of periods, at the nearest pixel of the sample.
fn period(
    size: [usize; 2],
    reference: &Sheet,
    sample: &Sheet,
    refined: &Refined,
    compared: &[bool],
    slope: &[f32],
) -> Difference {
    let (Some(fixed), Some(other)) = (&reference.periods, &sample.periods) else { return Difference::default() };
    let (width, height) = (sample.image.width, sample.image.height);
    let both = |i: usize| {
        let at = refined.transform.at((i % size[0]) as f64, (i / size[0]) as f64).map(f64::round);
        let inside = at[0] >= 0.0 && at[1] >= 0.0 && at[0] < width as f64 && at[1] < height as f64;
        let k = inside.then(|| at[1] as usize * width + at[0] as usize)?;
        let value = (other.value[k] / fixed.value[i]).ln();
        let sigma = (other.sigma[k] / other.value[k]).hypot(fixed.sigma[i] / fixed.value[i]);
        (compared[i] && value.is_finite()).then(|| [value, if sigma.is_finite() { sigma.max(LEAST) } else { LEAST }])
    };
    let all: Vec<Option<[f32; 2]>> = (0..size[0] * size[1]).map(both).collect();
    let Some(usual) = median(all.iter().flatten().map(|v| v[0]).collect::<Vec<_>>()) else {
        return Difference::default();
    };
    let value: Vec<f32> = all.iter().map(|v| v.map_or(f32::NAN, |v| v[0] - usual)).collect();
    let noise: Vec<f32> = all.iter().map(|v| v.map_or(1.0, |v| v[1])).collect();
    let some: Vec<usize> = (0..value.len()).filter(|i| value[*i].is_finite()).collect();
    let off = |i: usize| value[i].abs();
    let known: Vec<bool> = value.iter().map(|v| v.is_finite()).collect();
    let noise = scaled(size, &known, &off, &noise, MEDIAN_1);
    let edge = edge_share(&some, &off, &noise, slope, PERCENTILE_90_1, LEAST_EDGE_NONLINEAR);
    let sigma = with_edges(&noise, slope, edge);
    Difference { value, sigma }
}

/// Standard deviation in rad of the common turn, from the noise of all pixels; blurred pixels share noise.
fn turn_sigma(usable: &[usize], a: &[Complex32], sigma: &[f32]) -> f64 {
    let shared = 4.0 * std::f64::consts::PI * BLUR_PX * BLUR_PX;
    let sum: f64 = usable.iter().map(|i| f64::from(a[*i].norm_sqr() / sigma[*i].powi(2))).sum();
    (shared / sum.max(1e-30)).sqrt()
}

//! Selection of the cheapest summation method that meets the requested error.
//!
//! Interpolation errors between rays are measured on the photograph itself, those along rays on a few entries.
//! Computation time is predicted by counting operations.

use super::kernel::{Kernel, Weight};
use super::rays::{Fineness, Layout};
use super::table::{Grid, INNER_PX, Method, Source, angle};
use nacre_image::catmull_rom;
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::Serialize;
use std::f64::consts::TAU;

/// Candidate spacings of rays and samples in quarters of a pixel, and candidate strides from samples to rows of the
/// table.
const QUARTERS: [usize; 6] = [8, 6, 4, 3, 2, 1];
const EVERY: [usize; 3] = [4, 2, 1];

/// Sample spacing of single entries, in pixels of the photograph.
const SINGLE_PX: f64 = 0.5;

/// Radius around the zero order, as a fraction of the photograph's shorter side, whose light is excluded: it does not
/// represent the diffraction orders.
const INSIDE: f64 = 0.075;

/// Fraction of the total squared light below which a region counts as black.
const TRACES: f64 = 1e-8;

/// Safety factor: the predicted error, itself a sample, must stay below this fraction of the requested one.
const MARGIN: f64 = 0.5;

/// Maximum memory of an octave's entries in bytes; two copies exist while they are sorted.
const MEMORY: usize = 1 << 30;

/// CPU time in ns of one photograph sample, of one sample weight for 16 rays, and of one entry interpolated from an
/// octave. Measured with the example `lookup_table` on one machine; only the ratios matter.
const SAMPLE_NS: f64 = 15.0;
const WEIGHT_NS: f64 = 4.7;
const ENTRY_NS: f64 = 45.0;

/// Selected summation method and its predicted cost.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "LutChoice")]
pub struct Choice {
    /// `rays`, `single` or `fixed`.
    pub method: &'static str,
    /// Spacing of rays and samples at the rim, in pixels of the photograph; `None` for `fixed`.
    pub spacing_px: Option<f64>,
    /// Spacing of wavelengths in nm; for `fixed` only.
    pub step_nm: Option<f64>,
    /// Predicted root mean square error at the rim, relative to the root mean square of the table there.
    pub predicted_error: Option<f64>,
    /// Predicted CPU time in s.
    pub predicted_s: f64,
    /// Reason for the choice.
    pub why: String,
}

/// Measured interpolation errors.
pub(super) struct Trial {
    /// Between rays, for each of [`QUARTERS`].
    across: [f64; QUARTERS.len()],
    /// Along a ray, for spacings in quarters of a pixel.
    along: Vec<(usize, f64)>,
}

impl Trial {
    pub(super) fn new(source: &Source, kernel: &Kernel, grid: &Grid) -> Self {
        let radius = (grid.extent / source.scale).max(2.0 * INNER_PX);
        let rings = Rings::of(source);
        Self { across: across(source, &rings), along: along(source, kernel, radius, &rings) }
    }

    fn error(&self, quarters: usize, every: usize) -> f64 {
        let across = QUARTERS.iter().zip(self.across).find(|(q, _)| **q == quarters).map_or(1.0, |(_, e)| e);
        let along = self.along.iter().find(|(q, _)| *q == quarters * every).map_or(1.0, |(_, e)| *e);
        across.hypot(along)
    }
}

/// Sum of squared errors of interpolation with a stride of `every` samples, and sum of squared samples.
fn interpolation(fine: &[f32], every: usize) -> [f64; 2] {
    let (mut square, mut all) = (0.0, 0.0);
    for k in every..fine.len().saturating_sub(2 * every) {
        let (left, share) = (k / every * every, (k % every) as f32 / every as f32);
        let four = catmull_rom(share);
        let found: f32 = (0..4).map(|j| four[j] * fine[left + j * every - every]).sum();
        square += f64::from(found - fine[k]).powi(2);
        all += f64::from(fine[k]).powi(2);
    }
    [square, all]
}

/// Root mean square interpolation error relative to the root mean square of the samples. All lines are pooled: dark
/// lines hold mostly noise, whose relative error is meaningless.
fn together(lines: &[Vec<f32>], every: usize) -> f64 {
    let add = |[a, b]: [f64; 2], line: &Vec<f32>| {
        let [square, all] = interpolation(line, every);
        [a + square, b + all]
    };
    let [square, all] = lines.iter().fold([0.0; 2], add);
    if all > 0.0 { (square / all).sqrt() } else { 0.0 }
}

/// Squared light of the photograph summed into `bins`; `bin` maps distance from the zero order in pixels and angle of
/// the half vector to a bin.
fn squares(source: &Source, bins: usize, bin: impl Fn(f32, f32) -> Option<usize> + Sync) -> Vec<f64> {
    const ROWS: usize = 64;
    let (plane, [x0, y0]) = (source.plane, source.center.map(|c| c as f32));
    let strip = |strip: usize| {
        let mut sums = vec![0.0; bins];
        for y in strip * ROWS..((strip + 1) * ROWS).min(plane.height) {
            for x in 0..plane.width {
                let light = f64::from(plane.coefficient(x, y));
                let (u, v) = (x0 - x as f32, y as f32 - y0);
                if light != 0.0
                    && let Some(k) = bin((u * u + v * v).sqrt(), angle(u, v))
                {
                    sums[k.min(bins - 1)] += light * light;
                }
            }
        }
        sums
    };
    // Added in order, so that sums are reproducible.
    let strips: Vec<Vec<f64>> = (0..plane.height.div_ceil(ROWS)).into_par_iter().map(strip).collect();
    let mut all = vec![0.0; bins];
    strips.iter().for_each(|strip| all.iter_mut().zip(strip).for_each(|(sum, s)| *sum += s));
    all
}

/// Squared light of the photograph in rings of one pixel, outside of the zero order's surroundings.
struct Rings(Vec<f64>);

impl Rings {
    fn of(source: &Source) -> Self {
        let (plane, [x, y]) = (source.plane, source.center);
        let far = |c: f64, n: usize| c.abs().max((c - n as f64).abs());
        let inside = (INSIDE * plane.width.min(plane.height) as f64) as f32;
        let count = far(x, plane.width).hypot(far(y, plane.height)).ceil() as usize + 1;
        Self(squares(source, count, |r, _| (r >= inside).then_some(r as usize)))
    }

    /// The rings between two radii in pixels, at least one.
    fn between(&self, [inner, outer]: [f64; 2]) -> &[f64] {
        let last = self.0.len() - 1;
        let first = (inner as usize).min(last);
        &self.0[first..=(outer as usize).clamp(first, last)]
    }

    /// True if light between two radii exceeds the traces that interpolation leaves in a black background; also true
    /// for a black photograph.
    fn lit(&self, radii: [f64; 2]) -> bool {
        self.between(radii).iter().sum::<f64>() >= TRACES * self.0.iter().sum::<f64>()
    }
}

/// The central bins of `count` parts with equal sums; evenly spaced bins if all sums are 0.
fn middles(sums: &[f64], count: usize) -> Vec<usize> {
    let all: f64 = sums.iter().sum();
    let part = |k: usize| (k as f64 + 0.5) / count as f64;
    if all == 0.0 {
        return (0..count).map(|k| (part(k) * sums.len() as f64) as usize).collect();
    }
    let mut sum = 0.0;
    let reached: Vec<f64> = sums
        .iter()
        .map(|s| {
            sum += s / all;
            sum
        })
        .collect();
    (0..count).map(|k| reached.partition_point(|r| *r < part(k)).min(sums.len() - 1)).collect()
}

/// Interpolation error between rays, on circles around the zero order through its light: near the rim or, if that is
/// black, further inside.
fn across(source: &Source, rings: &Rings) -> [f64; QUARTERS.len()] {
    const CIRCLES: usize = 4;
    let half = 0.5 * source.plane.width.min(source.plane.height) as f64;
    let rim = [0.45 * half, 0.9 * half];
    let radii = if rings.lit(rim) { rim } else { [0.0, 0.9 * half] };
    let circle = |bin: usize| {
        let radius = radii[0].floor() + bin as f64 + 0.5;
        let count = ((TAU * radius * 4.0) as usize).clamp(64, 8192);
        let at = |k: usize| {
            let angle = 0.25 * k as f64 / radius;
            let place = [source.center[0] + radius * angle.cos(), source.center[1] - radius * angle.sin()];
            source.plane.at(place[0] as f32, place[1] as f32)[0]
        };
        (0..count).map(at).collect::<Vec<f32>>()
    };
    let circles: Vec<Vec<f32>> = middles(rings.between(radii), CIRCLES).into_iter().map(circle).collect();
    QUARTERS.map(|q| together(&circles, q))
}

/// Interpolation error along a few rays through entries that sum light: near the rim or, if that is black, further
/// inside.
fn along(source: &Source, kernel: &Kernel, rim: f64, rings: &Rings) -> Vec<(usize, f64)> {
    const RAYS: usize = 16;
    const ENTRIES: usize = 100;
    const INWARD: f64 = 0.9;
    let [low, high] = kernel.range();
    let first = |radius: f64| 0.9 * radius;
    let seen = |radius: f64| [first(radius) * (-high).exp(), (first(radius) + 0.25 * ENTRIES as f64) * (-low).exp()];
    let mut radii = std::iter::successors(Some(rim), |r| Some(INWARD * r)).take_while(|r| *r >= 2.0 * INNER_PX);
    let radius = radii.find(|r| rings.lit(seen(*r))).unwrap_or(rim);
    let (first, [near, far]) = (first(radius), seen(radius));
    let taps = kernel.steps(SINGLE_PX / radius).taps();
    let bins = (TAU * radius).ceil() as usize;
    let light = squares(source, bins, |r, angle| {
        (near..far).contains(&f64::from(r)).then(|| (f64::from(angle) / TAU * bins as f64) as usize)
    });
    let ray = |bin: usize| -> Vec<f32> {
        let angle = TAU * (bin as f64 + 0.5) / bins as f64;
        let at = |i: usize| {
            let r = first + 0.25 * i as f64;
            source.sum(&taps, (r * angle.cos()) as f32, (r * angle.sin()) as f32)[1]
        };
        (0..ENTRIES).map(at).collect()
    };
    let rays: Vec<Vec<f32>> = middles(&light, RAYS).into_iter().map(ray).collect();
    let mut spacings: Vec<usize> = QUARTERS.iter().flat_map(|q| EVERY.map(|e| q * e)).collect();
    spacings.sort_unstable();
    spacings.dedup();
    spacings.into_iter().map(|q| (q, together(&rays, q))).collect()
}

/// CPU time of a method in s, and whether memory suffices.
fn cost(source: &Source, kernel: &Kernel, grid: &Grid, method: Method) -> (f64, bool) {
    let corner = grid.extent / source.scale * 2.0_f64.sqrt();
    let entries = (grid.size * grid.size) as f64;
    let [low, high] = kernel.range();
    let (mut ns, mut fits) = (0.0, true);
    match method {
        Method::Fixed { step_nm } => {
            let span = kernel.wavelength_nm * (high.exp() - low.exp());
            ns += entries * span / step_nm * SAMPLE_NS;
        }
        Method::Single { spacing_px } => {
            // Entries are evenly distributed, hence three quarters of them lie in the outermost octave.
            let mut outer = corner;
            while outer > INNER_PX {
                ns += 0.75 * entries * (outer / corner).powi(2) * (high - low) * outer / spacing_px * SAMPLE_NS;
                outer *= 0.5;
            }
        }
        Method::Rays(mut fineness) => {
            let mut outer = corner;
            while outer > INNER_PX {
                let layout = Layout::new(outer, kernel, fineness);
                fineness = fineness.inward();
                fits &= layout.bytes() <= MEMORY;
                ns += (layout.rays * layout.samples) as f64 * SAMPLE_NS;
                ns += (layout.rays / 16 * layout.rows * layout.taps) as f64 * WEIGHT_NS;
                outer *= 0.5;
            }
            ns += entries * ENTRY_NS;
        }
    }
    (ns * 1e-9, fits)
}

/// The cheapest method whose predicted error is within the requested one.
pub(super) fn choose(source: &Source, kernel: &Kernel, grid: &Grid, wanted: f64) -> (Method, Choice) {
    let trial = Trial::new(source, kernel, grid);
    let rays = QUARTERS.iter().flat_map(|q| EVERY.map(|every| (*q, every))).map(|(quarters, every)| {
        let method = Method::Rays(Fineness { spacing_px: 0.25 * quarters as f64, every });
        (method, trial.error(quarters, every))
    });
    // Single entries are not interpolated; their error is that of half-pixel sampling.
    let single = (Method::Single { spacing_px: SINGLE_PX }, trial.error(1, 1));
    let mut all: Vec<(Method, f64, f64)> = rays
        .chain([single])
        .filter_map(|(method, error)| {
            let (seconds, fits) = cost(source, kernel, grid, method);
            fits.then_some((method, error, seconds))
        })
        .collect();
    all.sort_by(|a, b| a.2.total_cmp(&b.2));
    let meets = all.iter().find(|(_, error, _)| *error <= MARGIN * wanted);
    let finest = || all.iter().min_by(|a, b| a.1.total_cmp(&b.1));
    // Single entries always fit into memory, so the list is never empty.
    let (method, error, seconds) = meets.or_else(finest).copied().unwrap_or((single.0, single.1, 0.0));
    let limit = 100.0 * MARGIN * wanted;
    let why = if meets.is_some() {
        format!("the cheapest that, tried out on the photograph, is off by less than {limit:.3} %")
    } else {
        format!("the finest there is; the photograph is too sharp, or too noisy, for {limit:.3} %")
    };
    (method, describe(method, Some(error), seconds, why))
}

/// A method selected by the user.
pub(super) fn given(source: &Source, kernel: &Kernel, grid: &Grid, method: Method) -> Choice {
    describe(method, None, cost(source, kernel, grid, method).0, "asked for".into())
}

fn describe(method: Method, predicted_error: Option<f64>, predicted_s: f64, why: String) -> Choice {
    let (method, spacing_px, step_nm) = match method {
        Method::Rays(fineness) => ("rays", Some(fineness.spacing_px), None),
        Method::Single { spacing_px } => ("single", Some(spacing_px), None),
        Method::Fixed { step_nm } => ("fixed", None, Some(step_nm)),
    };
    Choice { method, spacing_px, step_nm, predicted_error, predicted_s, why }
}

/// Number of entries at the rim, and of entries anywhere, used to verify a table.
const CHECKED: usize = 256;

/// Sample spacing of the verification, in pixels.
const CHECK_PX: f64 = 0.25;

/// Ratio of the mean squared light of checked entries to that of the rim, below which the check has missed the rim's
/// light.
const MISSED: f64 = 1e-4;

/// Root mean square error of sampled entries against a finer sum, relative to their root mean square: the larger of rim
/// and whole table. Second value: the relative change at the rim when the zero order moves by `moved` pixels. `None`
/// without light.
pub(super) fn check(kernels: &[(Kernel, &Source)], grid: &Grid, table: &[Weight], moved: f64) -> [Option<f64>; 2] {
    let (size, half) = (grid.size, grid.size / 2);
    let rim = (0.6 * half as f64) as usize;
    // Multiples of irrational ratios distribute positions evenly over rim and table.
    let part = |k: usize, ratio: f64, n: usize| ((k as f64 * ratio).fract() * n as f64) as usize;
    let of_rim = |k: usize| {
        let across = rim + part(k, 0.754_877_666_2, half - rim);
        let across = if k.is_multiple_of(2) { half + across } else { half - 1 - across.min(half - 1) };
        [across.min(size - 1), part(k, 0.618_033_988_75, size)]
    };
    let anywhere = |k: usize| [part(k, 0.754_877_666_2, size), part(k, 0.569_840_290_998, size)];
    let finer: Vec<_> = kernels
        .iter()
        .map(|(kernel, source)| {
            let radius = grid.extent / source.scale * 2.0_f64.sqrt();
            (kernel.steps(CHECK_PX / radius.max(INNER_PX)).taps(), *source)
        })
        .collect();
    let of = |[x, y]: [usize; 2], shift: f32| {
        let sum = |du: f32, dv: f32| {
            let of_source = |(taps, s): &(Vec<_>, &Source)| {
                let place = [grid.at(x), grid.at(y)].map(|h| (h / s.scale) as f32);
                shifted(s, taps, place, [du, dv])
            };
            finer.iter().map(of_source).sum::<f64>()
        };
        let truth = sum(0.0, 0.0);
        let found = f64::from(table[(size - 1 - y) * size + x][1]);
        let displaced = if shift == 0.0 {
            0.0
        } else {
            0.5 * ((sum(shift, 0.0) - truth).powi(2) + (sum(0.0, shift) - truth).powi(2))
        };
        [(found - truth).powi(2), displaced, truth * truth]
    };
    let add = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|c| a[c] + b[c]);
    let all = |places: &(dyn Fn(usize) -> [usize; 2] + Sync), shift: f32| {
        // Added in order, so that the result does not depend on the number of threads.
        let each: Vec<[f64; 3]> = (0..CHECKED).into_par_iter().map(|k| of(places(k), shift)).collect();
        each.into_iter().fold([0.0; 3], add)
    };
    let mean = |from: usize, bands: bool| {
        let far = |i: usize| {
            let [x, y] = [i % size, i / size].map(|k| k.abs_diff(half));
            if bands { x >= from } else { x.max(y) >= from }
        };
        let squares = (0..table.len()).filter(|i| far(*i)).map(|i| f64::from(table[i][1]).powi(2));
        let (sum, count) = squares.fold((0.0, 0_u32), |(sum, count), square| (sum + square, count + 1));
        CHECKED as f64 * sum / f64::from(count.max(1))
    };
    // Lower bounds that detect a missed rim, or a rim with mere traces of light.
    let (least, dark) = (MISSED * mean(rim, true), TRACES * mean((2.0 * INSIDE * half as f64) as usize, false));
    let relative = |square: f64, all: f64| (all > dark).then(|| (square / all.max(least)).sqrt());
    let ([off, displaced, light], [off_all, _, light_all]) = (all(&of_rim, moved as f32), all(&anywhere, 0.0));
    let worse = [relative(off, light), relative(off_all, light_all)].into_iter().flatten().reduce(f64::max);
    [worse.filter(|_| light > dark), relative(displaced, light)]
}

/// Y of an entry, with the zero order displaced by (du, dv) pixels.
fn shifted(source: &Source, taps: &[(f32, Weight)], [u, v]: [f32; 2], [du, dv]: [f32; 2]) -> f64 {
    let center = [source.center[0] + f64::from(du), source.center[1] + f64::from(dv)];
    f64::from(Source { plane: source.plane, center, scale: source.scale }.sum(taps, u, v)[1])
}

//! Reflected light of a grating's orders: lobes under small lights, sums over orders and wavelengths under
//! environments.

use crate::light::spectrum::Seen;
use crate::light::viewer::RANGE;
use crate::material::SAMPLES;
use crate::material::diffraction::grating::{Grating, Groove, Scratch};
use crate::material::diffraction::memory::{Kept, Memory, NODES};
use crate::material::shading::{Above, Accuracy};
use std::f64::consts::{PI, TAU};

/// Smallest number of wave numbers per sample under an environment.
const FEWEST: f64 = 12.0;

/// A Gaussian in the plane of spatial frequencies.
#[derive(Clone, Copy)]
pub(crate) struct Blur {
    /// Variance due to coherence, 1/µm².
    coherence: f64,
    /// Variances and covariance of the light's direction cosines.
    light: [f64; 3],
}

impl Blur {
    /// Combines lobes of a width (1/µm) with a light of angular width `light` (rad) from a direction. The light is
    /// round perpendicular to its direction, so its direction cosines have the covariance `σ² (1 - s sᵀ)`.
    pub(crate) fn new(sigma: f64, light: f64, from: [f64; 3]) -> Self {
        let [x, y, _] = from;
        let square = light * light;
        Self { coherence: sigma * sigma, light: [square * (1.0 - x * x), square * (1.0 - y * y), -square * x * y] }
    }

    /// Inverse of the covariance at a wave number (xx, yy, xy), and its determinant.
    fn inverse(&self, number: f64) -> ([f64; 3], f64) {
        let square = number * number;
        let [a, b, c] = self.light.map(|v| v * square);
        let (a, b) = (a + self.coherence, b + self.coherence);
        let det = a * b - c * c;
        ([b / det, a / det, -c / det], det)
    }

    /// Density at a spatial frequency, µm².
    pub(crate) fn at(&self, [x, y]: [f64; 2], number: f64) -> f64 {
        let ([a, b, c], det) = self.inverse(number);
        (-0.5 * (a * x * x + b * y * y + 2.0 * c * x * y)).exp() / (TAU * det.sqrt())
    }

    /// Wave number at which the line `ν t - g` is closest to 0 (Mahalanobis distance), its standard deviation along the
    /// line, and the squared distance there.
    pub(crate) fn nearest(&self, t: [f64; 2], g: [f64; 2]) -> [f64; 3] {
        let mut at = 0.5 * (RANGE[0] + RANGE[1]);
        let mut found = [at, f64::INFINITY, 0.0];
        for _ in 0..2 {
            let ([a, b, c], _) = self.inverse(at.clamp(RANGE[0], RANGE[1]));
            let product =
                |p: [f64; 2], q: [f64; 2]| a * p[0] * q[0] + b * p[1] * q[1] + c * (p[0] * q[1] + p[1] * q[0]);
            let square = product(t, t);
            if square < 1e-12 {
                return [at, f64::INFINITY, product(g, g)];
            }
            at = product(t, g) / square;
            let off = [0, 1].map(|k| at * t[k] - g[k]);
            found = [at, 1.0 / square.sqrt(), product(off, off)];
        }
        found
    }
}

/// Equidistant wave numbers with at most this step and the weights of the trapezoid rule; `each` receives both.
fn trapezoid([from, to]: [f64; 2], step: f64, mut each: impl FnMut(f64, f64)) {
    if from >= to {
        return;
    }
    let count = ((to - from) / step).ceil().clamp(1.0, 20_000.0) as usize;
    let step = (to - from) / count as f64;
    for k in 0..=count {
        let end = if k == 0 || k == count { 0.5 } else { 1.0 };
        each(from + step * k as f64, end * step);
    }
}

/// Integral over wave numbers of a smooth density along `ν t`, within `[from, to]`, as X, Y, Z.
pub(crate) fn along(
    seen: &Seen,
    [from, to]: [f64; 2],
    width: f64,
    accuracy: &Accuracy,
    mut value: impl FnMut(f64) -> f64,
) -> [f64; 3] {
    let range = seen.range();
    let step = accuracy.fixed.unwrap_or_else(|| (width * accuracy.step).min(seen.fine));
    let mut sum = [0.0; 3];
    trapezoid([from.max(range[0]), to.min(range[1])], step, |number, weight| {
        let value = value(number) * weight;
        if value > 0.0 {
            sum.iter_mut().zip(seen.at(number)).for_each(|(s, w)| *s += w * value);
        }
    });
    sum
}

/// Powers of orders, linear between the tabulated wave numbers.
struct Powers<'a> {
    grating: &'a Grating,
    view: [f64; 3],
    groove: Groove,
    kept: &'a mut Kept,
    scratch: &'a mut Scratch,
}

impl Powers<'_> {
    fn node(&mut self, k: usize, order: i32) -> Option<f64> {
        let Kept { known, nodes } = &mut *self.kept;
        if !known[k] {
            let number = RANGE[0] + (RANGE[1] - RANGE[0]) * k as f64 / NODES as f64;
            nodes[k].clear();
            self.grating.orders(self.view, self.groove, number, self.scratch, |o| nodes[k].push((o.order, o.power)));
            known[k] = true;
        }
        nodes[k].iter().find(|o| o.0 == order).map(|o| o.1)
    }

    /// Power of an order at a wave number; an order that is evanescent at one node takes the value of the other.
    fn at(&mut self, order: i32, number: f64) -> f64 {
        let place = ((number - RANGE[0]) / (RANGE[1] - RANGE[0]) * NODES as f64).clamp(0.0, NODES as f64);
        let k = (place as usize).min(NODES - 1);
        let share = place - k as f64;
        match [self.node(k, order), self.node(k + 1, order)] {
            [Some(a), Some(b)] => a + share * (b - a),
            [Some(one), None] | [None, Some(one)] => one,
            [None, None] => 0.0,
        }
    }
}

/// Cosine of the angle to the half vector.
pub(crate) fn half_cos(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0.5 * (1.0 + a[0] * b[0] + a[1] * b[1] + a[2] * b[2])).clamp(0.0, 1.0).sqrt()
}

/// BRDF of a grating under a small light, integrated over its spectrum: X, Y, Z.
///
/// `f = R Σ P_m N(ν t - m g) ν²`, with t the tangential part of `ωi + ωr`, g the grating vector in 1/µm, N the combined
/// lobe of coherence and light, and P_m the balanced power. Powers cached in `memory` belong to this point and view.
pub(crate) fn lit(
    grating: &Grating,
    groove: Groove,
    [view, light]: [[f64; 3]; 2],
    (width, seen): (f64, &Seen),
    accuracy: &Accuracy,
    Memory { kept, scratch, .. }: &mut Memory,
) -> [f64; 3] {
    let t = [view[0] + light[0], view[1] + light[1]];
    let blur = Blur::new(grating.sigma, width, light);
    let cos = half_cos(view, light);
    let range = seen.range();
    let mut sum = [0.0; 3];
    let mut powers = Powers { grating, view, groove, kept, scratch };
    // Orders with a visible wavelength, from the component along the grating vector.
    let along_g = (t[0] * groove.across[0] + t[1] * groove.across[1]) * groove.period_um;
    let margin = (accuracy.reach + 1.0) * groove.period_um * (blur.coherence.sqrt() + range[1] * width);
    let ends = [along_g * range[0], along_g * range[1]];
    let [low, high] = [ends[0].min(ends[1]) - margin, ends[0].max(ends[1]) + margin];
    let most = f64::from(grating.orders);
    for order in low.ceil().max(-most) as i32..=high.floor().min(most) as i32 {
        let g = groove.across.map(|a| a * f64::from(order) / groove.period_um);
        let [middle, deviation, square] = blur.nearest(t, g);
        if square > accuracy.reach * accuracy.reach {
            continue;
        }
        let [from, to] = match deviation.is_finite() {
            true => [middle - accuracy.reach * deviation, middle + accuracy.reach * deviation],
            false => range,
        };
        if from > range[1] || to < range[0] {
            continue;
        }
        let part = along(seen, [from, to], deviation, accuracy, |number| {
            let off = [0, 1].map(|k| number * t[k] - g[k]);
            let density = blur.at(off, number) * powers.at(order, number);
            density * number * number * grating.reflectance.at(cos, 1e3 / number)
        });
        sum.iter_mut().zip(part).for_each(|(s, p)| *s += p);
    }
    sum
}

/// Light of an environment diffracted towards a direction of view: X, Y, Z. The wave numbers of a pass are so dense
/// that the first order moves by at most a pixel of the environment. Four numbers from 0 to 1 shift them together, and
/// blur the lobes.
pub(crate) fn under(
    above: &Above,
    (grating, groove): (&Grating, Groove),
    view: [f64; 3],
    u: [f64; 4],
    accuracy: &Accuracy,
    scratch: &mut Scratch,
) -> [f64; 3] {
    let pixel = PI / above.sky.map.height as f64;
    // d(mλ/a) = -m dν/(a ν²).
    let moved = pixel * groove.period_um * RANGE[0] * RANGE[0];
    let [least, most] = above.sky.upsampling.range();
    let step = accuracy.fixed.unwrap_or_else(|| moved.min(above.sky.fine()).max((RANGE[1] - RANGE[0]) / 96.0));
    // The wave numbers are divided among the samples of a pass; a narrower spectrum needs fewer.
    let fewest = (FEWEST * (most - least) / (RANGE[1] - RANGE[0])).ceil().max(4.0);
    let count = ((most - least) / (step * SAMPLES as f64)).ceil().max(fewest) as usize;
    let step = (most - least) / count as f64;
    // Box and Muller: a normal offset of the lobes.
    let radius = grating.sigma * (-2.0 * u[1].max(1e-12).ln()).sqrt();
    let offset = [radius * (TAU * u[2]).cos(), radius * (TAU * u[2]).sin()];
    let mut sum = [0.0; 3];
    for k in 0..count {
        let number = least + step * (k as f64 + u[0]);
        let colors = above.sky.upsampling.at(number);
        let shift = offset.map(|o| o / number);
        grating.orders(view, groove, number, scratch, |order| {
            if order.power < 1e-6 {
                return;
            }
            let [mut x, mut y] = [order.from[0] + shift[0], order.from[1] + shift[1]];
            let mut square = x * x + y * y;
            if square >= 1.0 {
                // No lobe extends below the horizon.
                [x, y] = [order.from[0], order.from[1]];
                square = (x * x + y * y).min(1.0);
            }
            let from = [x, y, (1.0 - square).max(0.0).sqrt()];
            let power = order.power * grating.reflectance.at(half_cos(view, from), 1e3 / number) * step;
            let rgb = above.radiance(from);
            for (color, part) in rgb.iter().zip(&colors) {
                (0..3).for_each(|c| sum[c] += color * part[c] * power);
            }
        });
    }
    sum
}

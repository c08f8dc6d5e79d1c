//! Richardson-Lucy deconvolution (Richardson 1972, Lucy 1974).
//!
//! Each iteration blurs the estimate, divides the photograph by it, blurs the ratio with the mirrored point spread
//! function, and multiplies the estimate by the result. The estimate stays positive, and its likelihood under Poisson
//! noise rises in each step. [`Deconvolution`] performs single iterations; [`deconvolve`] iterates with a stopping
//! rule.
//!
//! Light beyond the edges is unknown, not zero. The estimate therefore extends beyond the photograph by the radius of
//! the point spread function. The ratio is divided by the fraction of each pixel's light inside the photograph (Bertero
//! and Boccacci 2005). Unknown pixels (NaN) are treated alike. [`Edges::Zero`] is the textbook method.

mod blur;
mod kernel;
mod plane;
mod psf;
mod run;
mod steps;
mod stop;
#[cfg(test)]
mod tests;

pub use psf::{MAX_PSF_SIDE, MAX_SIGMA, Psf};
pub use run::{Deconvolved, Iterations, deconvolve};

use blur::Blur;
use nacre_base::{Error, Result};
use plane::Plane;
use rayon::prelude::*;
use std::ops::Range;
use steps::{Inverse, Leap, Ratio, Update, Weights};
use stop::Freedom;

/// Maximum number of pixels; eight planes of this size are in memory.
pub const MAX_PIXELS: usize = 64 << 20;

/// Lower bound of an extrapolated pixel relative to its current value, because a pixel near zero recovers only slowly.
const KEPT: f32 = 0.1;

/// Lower bound of measured light relative to the mean.
const LEAST: f64 = 1e-12;

/// Light to deconvolve, top row first; NaN where unknown.
#[derive(Clone, Copy, Debug)]
pub struct Image<'a> {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width · height` values.
    pub light: &'a [f32],
}

/// Treatment of light beyond the edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Edges {
    /// Unmeasured light.
    #[default]
    Unknown,
    /// Zero, as in textbooks; darkens the image near the edges and causes ringing there.
    Zero,
}

/// Variance of a pixel's light: `shot · light + floor`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Variance per unit of light.
    pub shot: f64,
    /// Variance at zero light.
    pub floor: f64,
}

/// Variant of the algorithm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Method {
    /// Treatment of light beyond the edges.
    pub edges: Edges,
    /// Vector extrapolation from the last two estimates before each iteration (Biggs and Andrews 1997).
    pub accelerate: bool,
    /// Uniform initial estimate; `None` selects the mean light.
    pub start: Option<f32>,
}

impl Default for Method {
    fn default() -> Self {
        Self { edges: Edges::Unknown, accelerate: true, start: None }
    }
}

impl Method {
    /// The variant of scikit-image's `richardson_lucy` with `clip=False`.
    pub fn textbook() -> Self {
        Self { edges: Edges::Zero, accelerate: false, start: Some(0.5) }
    }
}

/// State of a deconvolution.
pub struct Deconvolution {
    blur: Blur,
    /// Horizontal and vertical extension of the estimate beyond the photograph, in pixels.
    margin: [usize; 2],
    size: [usize; 2],
    /// Columns and rows whose residuals enter the misfit. Light from beyond the edges is free and fits residuals near
    /// them, which would bias the misfit below its expectation.
    counted: [Range<usize>; 2],
    /// Number of known pixels among them.
    known: usize,
    weights: Weights,
    /// Light plus the shift of [`Weights`]; 0 where unknown.
    measured: Plane,
    ratio: Plane,
    gain: Option<Plane>,
    estimate: Plane,
    leaps: Option<Leaps>,
    freedom: Freedom,
    iterations: usize,
}

/// Misfit between the blurred estimate and the photograph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Misfit {
    /// Mean of squared residual over variance (reduced χ²): 1 for pure noise before any fit; 0 without a noise model.
    pub found: f64,
    /// Expected value of `found` for pure noise: the fraction of degrees of freedom not yet used.
    pub expected: f64,
    /// Expected squared error in predicting another photograph, in units of the mean variance, up to a constant
    /// (Mallows 1973).
    pub cost: f64,
}

/// State of the acceleration.
struct Leaps {
    /// The last two estimates; [`Deconvolution::estimate`] is the point extrapolated from them.
    now: Plane,
    before: Plane,
    step: Plane,
}

impl Deconvolution {
    /// Starts a deconvolution. `noise` adds signal-independent noise to the Poisson model, so that dark pixels get
    /// their correct weight.
    ///
    /// # Errors
    /// `Input` for an image that is too small, too large, black or entirely unknown, and for a point spread function
    /// larger than the image.
    pub fn new(image: &Image, psf: &Psf, noise: Option<Noise>, method: &Method) -> Result<Self> {
        let [right, up] = psf.reach();
        let (width, height) = (image.width, image.height);
        let (known, mean) = check(image, psf)?;
        let zero = method.edges == Edges::Zero;
        if zero && known < width * height {
            let problem = "has pixels that are not known, which zeros beyond the edges leave no place for";
            return Err(Error::input("photograph", problem, "take edges as unknown"));
        }
        let margin = if zero { [0, 0] } else { [right, up] };
        let full = [width + 2 * margin[0], height + 2 * margin[1]];
        let blur = Blur::new(psf, full);
        let plane = || Plane::new(full[0], full[1], blur.zeros());
        let weights = weights(noise, mean);
        let mut measured = plane();
        let least = (mean * LEAST) as f32;
        for y in 0..height {
            let row = &image.light[y * width..][..width];
            let target = measured.row_mut(y + margin[1])[margin[0]..].iter_mut().zip(row);
            // Noise can drive light below zero, while 0 itself marks unknown pixels.
            target.for_each(|(m, v)| match (v.is_finite(), zero) {
                (false, _) => *m = 0.0,
                (true, true) => *m = *v,
                (true, false) => *m = (v + weights.shift).max(least),
            });
        }
        let mut estimate = plane();
        let start = method.start.unwrap_or(mean as f32);
        let gain = (!zero).then(|| gain(&blur, &measured, plane()));
        for y in 0..full[1] {
            match &gain {
                None => estimate.row_mut(y).fill(start),
                Some(gain) => estimate.row_mut(y).iter_mut().zip(gain.row(y)).for_each(|(v, g)| {
                    *v = if *g > 0.0 { start } else { 0.0 };
                }),
            }
        }
        let leaps = method.accelerate.then(|| Leaps { now: estimate.clone(), before: estimate.clone(), step: plane() });
        let counted = match noise {
            Some(_) => [(width, margin[0], right), (height, margin[1], up)].map(inner),
            None => [0..0, 0..0],
        };
        let [columns, rows] = &counted;
        let pixels = rows.clone().flat_map(|y| &measured.row(y)[columns.clone()]).filter(|v| **v != 0.0);
        let known = pixels.clone().count();
        let freedom = Freedom::new(psf.power(Freedom::frequencies()), pixels.copied(), &weights);
        let ratio = plane();
        let size = [width, height];
        let iterations = 0;
        Ok(Self {
            blur,
            margin,
            size,
            counted,
            known,
            weights,
            measured,
            ratio,
            gain,
            estimate,
            leaps,
            freedom,
            iterations,
        })
    }

    /// Blurs the estimate and computes the misfit.
    pub fn compare(&mut self) -> Misfit {
        let (measured, weights, counted) = (&self.measured, self.weights, &self.counted);
        let works = self.ratio.bands().map(|out| Ratio { measured, out, weights, counted, misfit: [0.0; 2] });
        let [weighted, plain] = self.blur.apply(&self.estimate, false, works).map(|sum| sum / self.known.max(1) as f64);
        let [expected, unspent] = self.freedom.unused();
        Misfit { found: weighted, expected, cost: plain / self.freedom.variance() - 2.0 * unspent }
    }

    /// Updates the estimate with the ratio from the last [`Self::compare`].
    pub fn update(&mut self) {
        let gain = self.gain.as_ref();
        self.iterations += 1;
        let Some(Leaps { now, before, step }) = &mut self.leaps else {
            self.blur.apply(&self.ratio, true, self.estimate.bands().map(|estimate| Update { estimate, gain }));
            self.freedom.account(0.0);
            return;
        };
        std::mem::swap(now, before);
        let from = &self.estimate;
        let bands = now.bands().zip(step.bands());
        let works = bands.map(|(to, step)| Leap { from, gain, to, step, products: [0.0; 2] });
        let [across, square] = self.blur.apply(&self.ratio, true, works);
        // The first step has no predecessor to extrapolate from.
        let far = if square > 0.0 { (across / square).clamp(0.0, 1.0) as f32 } else { 0.0 };
        let (now, before) = (&*now, &*before);
        self.estimate.bands().for_each(|mut band| {
            for y in band.first..band.first + band.rows() {
                let pairs = now.row(y).iter().zip(before.row(y));
                let on = pairs.map(|(now, before)| (now + far * (now - before)).max(KEPT * now));
                band.row(y).iter_mut().zip(on).for_each(|(v, on)| *v = on);
            }
        });
        self.freedom.account(far.into());
    }

    /// Number of completed iterations.
    pub fn iterations(&self) -> usize {
        self.iterations
    }

    /// Current estimate, cropped to the size of the photograph.
    pub fn light(&self) -> Vec<f32> {
        let [x, y] = self.margin;
        let rows = (0..self.size[1]).flat_map(|row| &self.estimate.row(row + y)[x..x + self.size[0]]);
        rows.copied().collect()
    }
}

/// Positions along an axis whose residuals enter the misfit: `length` from `start` on, without a border at both ends.
/// The border is as wide as the point spread function's reach, but at most an eighth of the length.
fn inner((length, start, reach): (usize, usize, usize)) -> Range<usize> {
    let edge = reach.min(length / 8);
    start + edge..start + length - edge
}

/// Rejects invalid input; returns the number of known pixels and their mean.
fn check(image: &Image, psf: &Psf) -> Result<(usize, f64)> {
    let (width, height) = (image.width, image.height);
    let bad = |problem: String, remedy: &str| Err(Error::input("photograph", problem, remedy));
    if width == 0 || height == 0 || image.light.len() != width * height {
        return bad(format!("has {} values for {width} x {height} pixels", image.light.len()), "give an image");
    }
    if width * height > MAX_PIXELS {
        return bad(
            format!("has {width} x {height} pixels, at most {} Mpixel are deconvolved", MAX_PIXELS >> 20),
            "crop it",
        );
    }
    let [right, up] = psf.reach();
    let [across, down] = [2 * right + 1, 2 * up + 1];
    if across > width || down > height {
        let problem =
            format!("of {width} x {height} pixels is smaller than the point spread function of {across} x {down}");
        return bad(problem, "give a larger part of it, or a smaller point spread function");
    }
    let (known, sum) =
        image.light.iter().filter(|v| v.is_finite()).fold((0, 0.0), |(n, sum), v| (n + 1, sum + f64::from(*v)));
    if known == 0 {
        return bad("has no pixel that is known".into(), "give another one");
    }
    let mean = sum / known as f64;
    if !(mean > 0.0 && mean < 1e30) {
        return bad(format!("has a mean light of {mean:.3}, which must be above 0"), "check its black level");
    }
    Ok((known, mean))
}

/// Weights of the noise model. The shift makes the variance proportional to shifted light, as for photons; it does not
/// exceed the mean light.
fn weights(noise: Option<Noise>, mean: f64) -> Weights {
    let Some(Noise { shot, floor }) = noise else { return Weights::default() };
    let shift = if shot > 0.0 { (floor / shot).min(mean) } else { 0.0 };
    let rest = (floor - shot * shift).max(mean * mean * 1e-14);
    Weights { shift: shift as f32, slope: shot as f32, rest: rest as f32 }
}

/// Reciprocal of the measured fraction of each pixel's light.
fn gain(blur: &Blur, measured: &Plane, mut out: Plane) -> Plane {
    let mut mask = out.clone();
    for y in 0..mask.height {
        mask.row_mut(y).iter_mut().zip(measured.row(y)).for_each(|(m, v)| *m = if *v == 0.0 { 0.0 } else { 1.0 });
    }
    blur.apply(&mask, true, out.bands().map(Inverse));
    out
}

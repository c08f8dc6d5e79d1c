//! Richardson-Lucy deconvolution (Richardson 1972, Lucy 1974).
//!
//! An estimate is blurred, the photograph divided by that, the ratio blurred with the mirrored point spread function, and the
//! estimate multiplied by it: light stays positive, and in each step the estimate becomes likelier where the noise is that of
//! counted photons. [`Deconvolution`] does one iteration at a time; [`deconvolve`] all of them and stops in time.
//!
//! What lies beyond the edges was not measured, which is not the same as nothing: the estimate reaches as far as the point
//! spread function does beyond the photograph, and the ratio is divided by how much of a pixel's light fell into the photograph
//! (Bertero and Boccacci 2005). Pixels that are not known (NaN) are treated alike. [`Edges::Zero`] is the textbook's way.

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

/// Most pixels that are deconvolved; eight planes of them are in memory.
pub const MAX_PIXELS: usize = 64 << 20;

/// An extrapolation takes no light below this share of what it is, since what is almost nothing only grows slowly.
const KEPT: f32 = 0.1;

/// What was measured is taken for at least this share of the mean.
const LEAST: f64 = 1e-12;

/// Light to be deconvolved, row 0 on top; NaN where it is not known.
#[derive(Clone, Copy, Debug)]
pub struct Image<'a> {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `width · height` values.
    pub light: &'a [f32],
}

/// What lies beyond the edges.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Edges {
    /// Something that was not measured.
    #[default]
    Unknown,
    /// Nothing: the textbook's choice, which darkens what is near to an edge and lets it ring.
    Zero,
}

/// Variance of a pixel, `shot · light + floor`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Variance per unit of light.
    pub shot: f64,
    /// Variance in the dark.
    pub floor: f64,
}

/// How it is done.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Method {
    /// What lies beyond the edges.
    pub edges: Edges,
    /// Each iteration starts from a point that is extrapolated from the last two (Biggs and Andrews 1997).
    pub accelerate: bool,
    /// Light to start with everywhere; none for the mean.
    pub start: Option<f32>,
}

impl Default for Method {
    fn default() -> Self {
        Self { edges: Edges::Unknown, accelerate: true, start: None }
    }
}

impl Method {
    /// As scikit-image's `richardson_lucy` does it with `clip=False`.
    pub fn textbook() -> Self {
        Self { edges: Edges::Zero, accelerate: false, start: Some(0.5) }
    }
}

/// A deconvolution under way.
pub struct Deconvolution {
    blur: Blur,
    /// Pixels by which the estimate reaches beyond the photograph.
    margin: [usize; 2],
    size: [usize; 2],
    /// Columns and rows whose misfits count: what is blurred from beyond the edges can be anything, so that misfits there are smaller
    /// than freedom that was spent says.
    counted: [Range<usize>; 2],
    /// Pixels that are known among them.
    known: usize,
    weights: Weights,
    /// Light with the shift of [`Weights`], 0 where it is not known.
    measured: Plane,
    ratio: Plane,
    gain: Option<Plane>,
    estimate: Plane,
    leaps: Option<Leaps>,
    freedom: Freedom,
    iterations: usize,
}

/// How far the blurred estimate is from the photograph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Misfit {
    /// Mean of the squares over their variances: 1 where it is the noise's and nothing was fitted yet, 0 where no noise was given.
    pub found: f64,
    /// What noise leaves of that: the share of the degrees of freedom that were not spent.
    pub expected: f64,
    /// Squared error that another photograph is expected to be predicted with, over the mean variance and but for a constant (Mallows 1973).
    pub cost: f64,
}

/// What acceleration remembers.
struct Leaps {
    /// The last two estimates; [`Deconvolution::estimate`] is the point that was extrapolated from them.
    now: Plane,
    before: Plane,
    step: Plane,
}

impl Deconvolution {
    /// Begins; `noise` also makes dark pixels count by what they are worth.
    ///
    /// # Errors
    /// `Input` for an image that is too small, too large, black or nowhere known, and a point spread function that is larger than it.
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
            // Noise may take light below what can be, but a 0 says that it is not known.
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

    /// Blurs the estimate and compares it with the photograph.
    pub fn compare(&mut self) -> Misfit {
        let (measured, weights, counted) = (&self.measured, self.weights, &self.counted);
        let works = self.ratio.bands().map(|out| Ratio { measured, out, weights, counted, misfit: [0.0; 2] });
        let [weighted, plain] = self.blur.apply(&self.estimate, false, works).map(|sum| sum / self.known.max(1) as f64);
        let [expected, unspent] = self.freedom.left();
        Misfit { found: weighted, expected, cost: plain / self.freedom.variance() - 2.0 * unspent }
    }

    /// Improves the estimate, by what the last [`Self::compare`] found.
    pub fn update(&mut self) {
        let gain = self.gain.as_ref();
        self.iterations += 1;
        let Some(Leaps { now, before, step }) = &mut self.leaps else {
            self.blur.apply(&self.ratio, true, self.estimate.bands().map(|estimate| Update { estimate, gain }));
            self.freedom.spend(0.0);
            return;
        };
        std::mem::swap(now, before);
        let from = &self.estimate;
        let bands = now.bands().zip(step.bands());
        let works = bands.map(|(to, step)| Leap { from, gain, to, step, products: [0.0; 2] });
        let [across, square] = self.blur.apply(&self.ratio, true, works);
        // The first step has none before it.
        let far = if square > 0.0 { (across / square).clamp(0.0, 1.0) as f32 } else { 0.0 };
        let (now, before) = (&*now, &*before);
        self.estimate.bands().for_each(|mut band| {
            for y in band.first..band.first + band.rows() {
                let pairs = now.row(y).iter().zip(before.row(y));
                let on = pairs.map(|(now, before)| (now + far * (now - before)).max(KEPT * now));
                band.row(y).iter_mut().zip(on).for_each(|(v, on)| *v = on);
            }
        });
        self.freedom.spend(far.into());
    }

    /// Iterations that were done.
    pub fn iterations(&self) -> usize {
        self.iterations
    }

    /// What [`Self::compare`] blurs, as large as the photograph.
    pub fn light(&self) -> Vec<f32> {
        let [x, y] = self.margin;
        let rows = (0..self.size[1]).flat_map(|row| &self.estimate.row(row + y)[x..x + self.size[0]]);
        rows.copied().collect()
    }
}

/// Places along an axis whose misfits count: `length` from `start` on, but for what the point spread function reaches of it from
/// either end, or an eighth of it.
fn inner((length, start, reach): (usize, usize, usize)) -> Range<usize> {
    let edge = reach.min(length / 8);
    start + edge..start + length - edge
}

/// Refuses what cannot be deconvolved; the number of known pixels and their mean.
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

/// The shift makes the variance grow in proportion, as that of photons does, as far as it is not larger than the light.
fn weights(noise: Option<Noise>, mean: f64) -> Weights {
    let Some(Noise { shot, floor }) = noise else { return Weights::default() };
    let shift = if shot > 0.0 { (floor / shot).min(mean) } else { 0.0 };
    let rest = (floor - shot * shift).max(mean * mean * 1e-14);
    Weights { shift: shift as f32, slope: shot as f32, rest: rest as f32 }
}

/// One over how much of each pixel's light was measured.
fn gain(blur: &Blur, measured: &Plane, mut out: Plane) -> Plane {
    let mut mask = out.clone();
    for y in 0..mask.height {
        mask.row_mut(y).iter_mut().zip(measured.row(y)).for_each(|(m, v)| *m = if *v == 0.0 { 0.0 } else { 1.0 });
    }
    blur.apply(&mask, true, out.bands().map(Inverse));
    out
}

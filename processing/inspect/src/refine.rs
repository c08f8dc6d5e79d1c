//! Registration to fractions of a pixel: similarity, then homography, then a smooth displacement.

use crate::image::{Image, phasor};
use crate::transform::{Freedom, Transform};
use nacre_base::Result;
use nacre_base::progress::Progress;
use nacre_base::statistics::median;
use nalgebra::{DMatrix, DVector};
use num_complex::{Complex32, Complex64};
use rayon::prelude::*;

/// Number of pixels that a step uses at most.
const MOST_POINTS: usize = 60_000;

/// Steps per level, and the displacement in pixels below which a level ends.
const MOST_STEPS: usize = 25;
const CONVERGED_PX: f64 = 2e-3;

/// Residuals beyond this many robust standard deviations have no weight (Tukey's biweight).
const TUKEY: f32 = 4.685;

/// Fall of the robust residual that a freer transform must bring, as a share.
const WORTH: f64 = 0.005;

/// A registration and its quality.
#[derive(Clone, Debug)]
pub struct Refined {
    /// The mapping.
    pub transform: Transform,
    /// Kind of the mapping.
    pub freedom: Freedom,
    /// Standard deviation of the shift in pixels.
    pub sigma_px: f64,
    /// Reference over sample: ratio of the polarization, and its turn, common to all pixels.
    pub gain: Complex64,
}

/// One level: blurred images, the gradient of the sample, and the pixels of the reference that are used.
struct Level {
    reference: Image,
    sample: Image,
    points: Vec<usize>,
}

/// Residuals of a transform.
struct Sums {
    normal: DMatrix<f64>,
    right: DVector<f64>,
    scale: f64,
    gain: Complex64,
}

/// Refines a registration that is off by up to `start_px` pixels.
///
/// # Errors
/// `Cancelled`.
pub fn refine(
    reference: &Image,
    sample: &Image,
    start: Transform,
    start_px: f64,
    progress: &dyn Progress,
) -> Result<Refined> {
    let mut transform = start;
    let mut blur = start_px.max(1.0);
    let mut level = Level::of(reference, sample, blur);
    loop {
        transform = level.converged(transform, Freedom::Similarity, progress)?.0;
        if blur <= 1.0 {
            break;
        }
        blur = (0.5 * blur).max(1.0);
        level = Level::of(reference, sample, blur);
    }
    let (mut transform, mut sums) = level.converged(transform, Freedom::Similarity, progress)?;
    let mut freedom = Freedom::Similarity;
    for freer in [Freedom::Homography, Freedom::Smooth] {
        let (tried, found) = level.converged(transform.clone(), freer, progress)?;
        if found.scale < (1.0 - WORTH) * sums.scale {
            (transform, sums, freedom) = (tried, found, freer);
        }
    }
    let inverse = sums.normal.clone().try_inverse();
    let variance = inverse.map_or(f64::NAN, |inverse| inverse[(0, 0)] + inverse[(1, 1)]);
    // Parameters are in units of half the longer side.
    let half = 0.5 * reference.width.max(reference.height) as f64;
    let sigma_px = half * sums.scale * (0.5 * variance).max(0.0).sqrt();
    Ok(Refined { transform, freedom, sigma_px, gain: sums.gain })
}

impl Level {
    fn of(reference: &Image, sample: &Image, blur: f64) -> Self {
        let count = reference.values.len();
        let step = ((count as f64 / MOST_POINTS as f64).sqrt().ceil() as usize).max(1);
        let points = (0..count)
            .filter(|i| (i % reference.width).is_multiple_of(step) && (i / reference.width).is_multiple_of(step))
            .collect();
        Self { reference: reference.blurred(blur), sample: sample.blurred(blur), points }
    }

    /// The transform after steps of Gauss and Newton, and its sums.
    fn converged(&self, start: Transform, freedom: Freedom, progress: &dyn Progress) -> Result<(Transform, Sums)> {
        let mut transform = start;
        let mut best: Option<(Transform, Sums)> = None;
        for _ in 0..MOST_STEPS {
            progress.check()?;
            let sums = self.sums(&transform, freedom);
            let step = damped(&sums);
            let worse = best.as_ref().is_some_and(|(_, before)| sums.scale > 1.0001 * before.scale);
            if worse {
                break;
            }
            best = Some((transform.clone(), sums));
            let Some(step) = step else { break };
            let mut next = transform.clone();
            next.step(step.as_slice());
            let moved = self.largest_move(&transform, &next);
            transform = next;
            if moved < CONVERGED_PX {
                break;
            }
        }
        Ok(best.unwrap_or_else(|| {
            let sums = self.sums(&transform, freedom);
            (transform, sums)
        }))
    }

    fn largest_move(&self, a: &Transform, b: &Transform) -> f64 {
        let [w, h] = [self.reference.width, self.reference.height].map(|n| n as f64 - 1.0);
        let off = |(x, y): (f64, f64)| {
            let (p, q) = (a.at(x, y), b.at(x, y));
            (p[0] - q[0]).hypot(p[1] - q[1])
        };
        [(0.0, 0.0), (w, 0.0), (0.0, h), (w, h), (0.5 * w, 0.5 * h)].into_iter().map(off).fold(0.0, f64::max)
    }

    /// Normal equations of a step, with weights from the robust scale of the residuals.
    fn sums(&self, transform: &Transform, freedom: Freedom) -> Sums {
        let pairs: Vec<(usize, Complex32, Complex32)> = self
            .points
            .par_iter()
            .filter_map(|i| {
                let at = transform.at((i % self.reference.width) as f64, (i / self.reference.width) as f64);
                Some((*i, self.reference.phasor(*i), phasor(self.sample.at(at)?)))
            })
            .collect();
        let (gain, scale) = gain(&pairs);
        let gain32 = Complex32::new(gain.re as f32, gain.im as f32);
        let n = match freedom {
            Freedom::Similarity => 4,
            Freedom::Homography => 8,
            Freedom::Smooth => 22,
        };
        let zero = || (DMatrix::zeros(n, n), DVector::zeros(n), Vec::with_capacity(n));
        let add = |(mut normal, mut right, mut all): (DMatrix<f64>, DVector<f64>, Vec<[f64; 2]>),
                   (i, a, b): &(usize, Complex32, Complex32)| {
            let residual = a - gain32 * b;
            let weight = tukey(residual.norm() / scale.max(1e-9) as f32);
            let (x, y) = ((i % self.reference.width) as f64, (i / self.reference.width) as f64);
            let place = transform.at(x, y);
            let slope = |dx: f64, dy: f64| {
                let side = |s: f64| self.sample.at([place[0] + s * dx, place[1] + s * dy]).map(phasor);
                Some((side(0.5)? - side(-0.5)?) * gain32)
            };
            let (Some(along), Some(down), true) = (slope(1.0, 0.0), slope(0.0, 1.0), weight > 0.0) else {
                return (normal, right, all);
            };
            transform.derivatives(freedom, x, y, &mut all);
            let weight = f64::from(weight);
            let [a, d] = [along, down].map(|c| Complex64::new(c.re.into(), c.im.into()));
            let r = Complex64::new(residual.re.into(), residual.im.into());
            // Inner products of real and imaginary parts.
            let dot = |p: Complex64, q: Complex64| p.re * q.re + p.im * q.im;
            let (aa, ad, dd, ar, dr) = (dot(a, a), dot(a, d), dot(d, d), dot(a, r), dot(d, r));
            for j in 0..n {
                let [p, q] = all[j];
                right[j] += weight * (p * ar + q * dr);
                let (left, below) = (p * aa + q * ad, p * ad + q * dd);
                for k in 0..=j {
                    normal[(j, k)] += weight * (left * all[k][0] + below * all[k][1]);
                }
            }
            (normal, right, all)
        };
        let chunks: Vec<_> = pairs.par_chunks(4096).map(|chunk| chunk.iter().fold(zero(), add)).collect();
        let (mut normal, right, _) = chunks.into_iter().fold(zero(), |s, c| (s.0 + c.0, s.1 + c.1, s.2));
        for j in 0..n {
            for k in 0..j {
                normal[(k, j)] = normal[(j, k)];
            }
        }
        Sums { normal, right, scale, gain }
    }
}

/// Tukey's biweight.
pub fn tukey(deviation: f32) -> f32 {
    let t = deviation / TUKEY;
    if t.abs() < 1.0 { (1.0 - t * t).powi(2) } else { 0.0 }
}

/// The common gain by reweighted least squares, and the robust standard deviation per component.
fn gain(pairs: &[(usize, Complex32, Complex32)]) -> (Complex64, f64) {
    let mut gain = Complex64::default();
    let mut scale = f64::INFINITY;
    for _ in 0..4 {
        let g = Complex32::new(gain.re as f32, gain.im as f32);
        let (top, bottom) = pairs.iter().fold((Complex64::default(), 0.0), |(top, bottom), (_, a, b)| {
            let weight = if scale.is_finite() { tukey((a - g * b).norm() / scale as f32) } else { 1.0 };
            let product = a * b.conj() * weight;
            (top + Complex64::new(product.re.into(), product.im.into()), bottom + f64::from(weight * b.norm_sqr()))
        });
        if bottom <= 0.0 {
            break;
        }
        gain = top / bottom;
        let g = Complex32::new(gain.re as f32, gain.im as f32);
        // The median of a Rayleigh distribution is 1.1774 standard deviations of a component.
        scale = median(pairs.iter().map(|(_, a, b)| (a - g * b).norm()).collect::<Vec<_>>())
            .map_or(f64::INFINITY, |m| f64::from(m) / 1.1774)
            .max(1e-9);
    }
    (gain, scale)
}

/// The step; slightly damped, so that directions that the image does not determine stay at rest.
fn damped(sums: &Sums) -> Option<DVector<f64>> {
    let mut normal = sums.normal.clone();
    let mean = normal.trace() / normal.nrows() as f64;
    for k in 0..normal.nrows() {
        normal[(k, k)] = normal[(k, k)] * (1.0 + 1e-6) + 1e-6 * mean;
    }
    normal.cholesky().map(|c| c.solve(&sums.right))
}

//! Present accuracy of the orientations during a series, and the analyser angle that would improve it most.

use crate::fit::bracket::noise_of_bracket;
use crate::fit::merge::{Merge, clear_of_white};
use crate::fit::noise::Covariance;
use crate::orient;
use crate::{Design, FrameNoise, MASK_SNR, NoiseSource, Running, StokesMaps};
use nacre_base::Result;
use nacre_base::statistics::quantile;
use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;

/// Number of pixels for σ and for the comparison of angles.
const PIXELS: usize = 100_000;
const COMPARED: usize = 2048;

/// Quantile of σ over the pixels that is compared with the target.
const QUANTILE: f64 = 0.9;

/// A target σ is unreachable if the smallest reachable one exceeds it by this factor.
pub const UNREACHABLE_FACTOR: f64 = 1.2;

/// Gain of an angle, relative to the best one's, that counts as equal.
const AS_GOOD: f64 = 0.99;

/// Present knowledge of the orientations, under the sinusoid model, on a sample of the pixels.
pub struct Precision {
    design: Design,
    angles: Vec<f64>,
    noise: Vec<FrameNoise>,
    source: NoiseSource,
    maps: StokesMaps,
    sigma: Vec<f32>,
    /// Noise of the exposures of the next view, and white.
    next: Next,
}

/// The exposures of a future view.
struct Next {
    noise: Vec<FrameNoise>,
    /// Linear value up to which each exposure is not saturated.
    limits: Vec<f64>,
}

impl Running {
    /// Accuracy of the orientations so far.
    ///
    /// # Errors
    /// `Input` while the angles do not determine an orientation.
    pub fn precision(&self) -> Result<Precision> {
        let views = &self.views[..self.accumulator.views()];
        let angles: Vec<f64> = views.iter().map(|v| v.angle).collect();
        let design = Design::new(&angles)?;
        let pixels = self.frames.info.width * self.frames.info.height;
        let step = (pixels as f64 / PIXELS as f64).sqrt().ceil().max(1.0) as usize;
        let mut maps = self.accumulator.thinned(step).solve(&design);
        let (noise, source) = self.noise(&mut maps, &design);
        let sigma = orient(&mut maps, &design, &noise, 0.0).sigma;
        let next = self.next(&noise);
        Ok(Precision { design, angles, noise, source, maps, sigma, next })
    }

    /// The next view is assumed to be exposed as the last one.
    fn next(&self, noise: &[FrameNoise]) -> Next {
        let bracket = self.views.get(self.accumulator.views().saturating_sub(1)).map_or(0, |v| v.bracket);
        let bracket = self.brackets.get(bracket).map_or(&[][..], |b| b);
        let stated = noise_of_bracket(&self.frames, &self.linearizer, bracket);
        // Ratio of estimated to stated noise.
        let (found, before) = (noise.last(), Merge::together(&stated));
        let factor = found.map_or(1.0, |n| (n.shot + n.floor) / (before.shot + before.floor));
        let scaled = |n: &FrameNoise| FrameNoise { shot: n.shot * factor, floor: n.floor * factor };
        let limits = clear_of_white(&self.frames, &self.linearizer, bracket);
        let scales = bracket.iter().map(|k| self.frames.set.frames[*k].scale());
        Next {
            noise: stated.iter().map(scaled).collect(),
            limits: scales.zip(limits).map(|(scale, margin)| scale * (1.0 - margin)).collect(),
        }
    }
}

impl Next {
    /// Variance of the merged exposures at this intensity; `None` where all are saturated.
    fn variance(&self, intensity: f64) -> Option<f64> {
        let usable = self.noise.iter().zip(&self.limits).filter(|(_, limit)| intensity < **limit);
        let weight: f64 = usable.map(|(n, _)| 1.0 / (n.shot * intensity.max(0.0) + n.floor)).sum();
        (weight > 0.0).then(|| 1.0 / weight)
    }
}

impl Precision {
    /// Number of analyser positions so far.
    pub fn angles(&self) -> usize {
        self.angles.len()
    }

    /// 90th percentile of σ in rad over the pixels with an orientation; `None` if there are none.
    pub fn sigma(&self) -> Option<f64> {
        self.quantile(1.0)
    }

    /// Lower bound of σ after `angles` analyser positions, with σ proportional to the inverse root of their number;
    /// `None` if no pixel will have an orientation.
    ///
    /// Modulations have a relative error of twice σ, and σ varies with them between equal pixels. Its 90th percentile
    /// is therefore overestimated at present by up to 1.28 times that.
    pub fn least_sigma_after(&self, angles: usize) -> Option<f64> {
        const SCATTER: f64 = 1.28 * 2.0;
        let factor = (self.angles.len() as f64 / angles.max(1) as f64).sqrt();
        let then = self.quantile(factor)?;
        Some(then / (1.0 + SCATTER * (then / factor).min(0.5 / f64::from(MASK_SNR))))
    }

    /// Whether the noise behind σ is known and not assumed.
    pub fn is_certain(&self) -> bool {
        self.source != NoiseSource::Assumed
    }

    fn quantile(&self, factor: f64) -> Option<f64> {
        let scaled = self.sigma.iter().zip(&self.maps.s0).filter(|(_, s0)| **s0 > 0.0).map(|(s, _)| s * factor as f32);
        let mut carrying: Vec<f32> = scaled.filter(|s| *s <= 0.5 / MASK_SNR).collect();
        quantile(&mut carrying, QUANTILE).map(f64::from)
    }

    /// The candidate angle (rad) that reduces σ most: the mean over the pixels of the ratio of the variance after it to
    /// that before. Among equally good angles the one farthest from those taken, which reveals more of deviations from
    /// a sinusoid. `None` without candidates.
    pub fn best_angle(&self, candidates: &[f64]) -> Option<f64> {
        let pixels = self.compared();
        let gains: Vec<f64> = candidates.par_iter().map(|psi| 1.0 - self.left_by(*psi, &pixels)).collect();
        let best = gains.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let as_good = candidates.iter().zip(&gains).filter(|(_, gain)| **gain >= best - (1.0 - AS_GOOD) * best.abs());
        // The first of equals, so that rounding has no effect.
        as_good
            .map(|(psi, _)| (*psi, self.distance(*psi)))
            .fold(None, |best: Option<(f64, f64)>, (psi, far)| match best {
                Some((_, before)) if far <= before + 1e-9 => best,
                _ => Some((psi, far)),
            })
            .map(|(psi, _)| psi)
    }

    /// Distance in rad modulo 180° to the nearest angle taken.
    fn distance(&self, psi: f64) -> f64 {
        use std::f64::consts::PI;
        let to = |taken: &f64| {
            let apart = (psi - taken).rem_euclid(PI);
            apart.min(PI - apart)
        };
        self.angles.iter().map(to).fold(f64::INFINITY, f64::min)
    }

    /// Pixels for the comparison of angles: those with an orientation, or all with light if there are none.
    fn compared(&self) -> Vec<usize> {
        let lit = |i: &usize| self.maps.s0[*i] > 0.0 && self.sigma[*i] > 0.0;
        let carries = |i: &usize| lit(i) && self.sigma[*i] <= 0.5 / MASK_SNR;
        let mut pixels: Vec<usize> = (0..self.sigma.len()).filter(carries).collect();
        if pixels.is_empty() {
            pixels = (0..self.sigma.len()).filter(lit).collect();
        }
        let step = pixels.len().div_ceil(COMPARED).max(1);
        pixels.into_iter().step_by(step).collect()
    }

    /// Mean over pixels of the ratio of the orientation's variance after another view at `psi` to the present one.
    fn left_by(&self, psi: f64, pixels: &[usize]) -> f64 {
        let x = Vector3::new(1.0, (2.0 * psi).cos(), (2.0 * psi).sin());
        let now = Covariance::new(&self.design, &self.noise, &self.maps.covariance);
        let after = self.maps.covariance.is_empty().then(|| self.with(psi)).flatten();
        let left = |i: &usize| {
            let fitted = [self.maps.s0[*i], self.maps.s1[*i], self.maps.s2[*i]].map(|v| 0.5 * v);
            let before = across(now.at(*i, fitted), fitted);
            let covariance = match &after {
                Some(after) => after.at(*i, fitted),
                None => self.added(*i, fitted, &x),
            };
            across(covariance, fitted) / before
        };
        pixels.iter().map(left).sum::<f64>() / pixels.len().max(1) as f64
    }

    /// The covariance with one more view, if all pixels of a view have equal weights.
    fn with(&self, psi: f64) -> Option<Covariance<'static>> {
        let angles: Vec<f64> = self.angles.iter().copied().chain([psi]).collect();
        let noise: Vec<FrameNoise> = self.noise.iter().copied().chain(self.noise.last().copied()).collect();
        Some(Covariance::new(&Design::new(&angles).ok()?, &noise, &[]))
    }

    /// The covariance of (C, S) at a pixel after an observation `x` is added to a weighted fit (Sherman and Morrison).
    fn added(&self, i: usize, [a, c, s]: [f32; 3], x: &Vector3<f64>) -> [f32; 3] {
        let [aa, ac, as_, cc, cs, ss] = self.maps.covariance.get(i).map_or([f32::NAN; 6], |v| *v).map(f64::from);
        let now = Matrix3::new(aa, ac, as_, ac, cc, cs, as_, cs, ss);
        let Some(variance) = self.next.variance(x.dot(&Vector3::new(a, c, s).map(f64::from))) else {
            return [now[(1, 1)], now[(1, 2)], now[(2, 2)]].map(|v| v as f32);
        };
        let gain = now * x;
        let after = now - gain * gain.transpose() / (variance + x.dot(&gain));
        [after[(1, 1)], after[(1, 2)], after[(2, 2)]].map(|v| v as f32)
    }
}

/// Variance across the modulation, from `[var C, cov(C, S), var S]`, up to the modulation's size.
fn across([cc, cs, ss]: [f32; 3], [_, c, s]: [f32; 3]) -> f64 {
    f64::from(s * s * cc - 2.0 * s * c * cs + c * c * ss)
}

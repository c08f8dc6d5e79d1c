//! Orientation, σ and mask of every pixel under a circle or a curve.
//!
//! Pixels are processed in runs; every step is a loop over a run that the compiler vectorises.

mod table;

pub(crate) use table::{Table, distance2};

use crate::film::correction::Correction;
use crate::film::curve::Curve;
use crate::film::models::{Candidate, Model};
use crate::fit::noise::Covariance;
use crate::orientation::orient::{MASK_SNR, Misfit, OrientationMaps, fold, phases};
use crate::{Design, FrameNoise, StokesMaps};
use nacre_base::vector_atan::{atan2, folded};
use nacre_base::vectors::vectorised;
use rayon::prelude::*;
use std::f32::consts::FRAC_PI_2;

/// Pixels in a run: their data fit into the processor's first-level cache.
const RUN: usize = 512;

/// Runs per task of a thread.
const RUNS: usize = 8;

/// Distance from the curve in standard deviations beyond which a pixel does not follow the model; the excess also
/// counts as error along the curve.
const OUTLIER_SIGMAS: f32 = 3.0;

/// Model and corrections applied to the maps.
pub(crate) struct Inversion<'a> {
    pub design: &'a Design,
    pub noise: &'a [FrameNoise],
    pub model: &'a Candidate,
    pub correction: Option<&'a Correction>,
    /// Offset added to every orientation, in rad.
    pub offset: f64,
}

/// Orientation, σ and mask of every pixel under a model, and the number of pixels of metal without a grating. For the
/// sinusoid it equals [`orient`](crate::orientation::orient()). σ reuses the memory of `residual`.
pub(crate) fn invert_curve(maps: &StokesMaps, residual: Vec<f32>, inversion: &Inversion) -> (OrientationMaps, usize) {
    let Inversion { design, noise, model, correction, offset } = *inversion;
    let inverse = match (model.model, model.center) {
        (Model::Sinusoid, _) if correction.is_none() => {
            return (phases(maps, residual, design, noise, offset), 0);
        }
        (_, Some(center)) => Inverse::Circle(Circle::new(center, &model.curve)),
        (_, None) => Inverse::Curve(Box::new(Table::new(model.curve))),
    };
    let mut sigma = residual;
    let pixels = Pixels {
        maps,
        covariance: Covariance::new(design, noise, &maps.covariance),
        misfit: Misfit::new(design, noise, maps),
        correction,
        offset: fold(offset as f32),
    };
    let mut orientation = vec![0.0_f32; maps.s0.len()];
    const BLOCK: usize = RUNS * RUN;
    let blocks = orientation.par_chunks_mut(BLOCK).zip(sigma.par_chunks_mut(BLOCK)).enumerate();
    let mirrors = blocks.map_init(Box::<Run>::default, |run, (block, (theta, sigma))| {
        let runs = theta.chunks_mut(RUN).zip(sigma.chunks_mut(RUN)).enumerate();
        runs.map(|(k, (theta, sigma))| pixels.project(&inverse, block * BLOCK + k * RUN, run, theta, sigma))
            .sum::<usize>()
    });
    let mirrors = mirrors.sum();
    (OrientationMaps { width: maps.width, height: maps.height, orientation, sigma }, mirrors)
}

/// Shared inputs of all pixels.
struct Pixels<'a> {
    maps: &'a StokesMaps,
    covariance: Covariance<'a>,
    misfit: Misfit,
    correction: Option<&'a Correction>,
    offset: f32,
}

/// Points (S1/S0, S2/S0) of a run of pixels.
pub(crate) struct Run {
    /// Half of S0.
    light: [f32; RUN],
    pub(crate) x: [f32; RUN],
    pub(crate) y: [f32; RUN],
    /// Variance of x, covariance, variance of y.
    pub(crate) variance: [[f32; RUN]; 3],
    /// Orientation of the projections in rad.
    pub(crate) theta: [f32; RUN],
    /// Its standard deviation in rad; infinite if another branch of the curve is as likely.
    pub(crate) sigma: [f32; RUN],
    /// 1 for metal without a grating; σ is then infinite.
    pub(crate) mirror: [u8; RUN],
}

impl Default for Run {
    fn default() -> Self {
        let plane = [0.0; RUN];
        Self { light: plane, x: plane, y: plane, variance: [plane; 3], theta: plane, sigma: plane, mirror: [0; RUN] }
    }
}

impl Pixels<'_> {
    /// Processes the pixels from `first` on: `sigma` holds residuals and is replaced by σ. Returns the number of pixels
    /// of metal without a grating.
    fn project(&self, inverse: &Inverse, first: usize, run: &mut Run, theta: &mut [f32], sigma: &mut [f32]) -> usize {
        vectorised(
            #[inline(always)]
            || match &self.covariance {
                Covariance::Alike(all) => self.points(first, sigma, run, |_, fitted| Covariance::linear(all, fitted)),
                Covariance::Each(own) => self.points(first, sigma, run, |i, _| own[first + i]),
            },
        );
        let count = theta.len();
        if let Some(correction) = self.correction {
            for i in 0..count {
                let [x, y] = correction.straightened(first + i, [run.x[i], run.y[i]], run.variance.map(|v| v[i]));
                (run.x[i], run.y[i]) = (x, y);
            }
        }
        match inverse {
            Inverse::Circle(circle) => vectorised(
                #[inline(always)]
                || circle.project(run, count),
            ),
            Inverse::Curve(table) => table.project_run(run, count),
        }
        vectorised(
            #[inline(always)]
            || {
                let (light, at) = (&run.light[..count], &run.theta[..count]);
                for (i, (theta, sigma)) in theta.iter_mut().zip(sigma.iter_mut()).enumerate() {
                    let found = run.sigma[i];
                    *sigma = found.min(FRAC_PI_2);
                    let carries = (found <= 0.5 / MASK_SNR) & (light[i] > 0.0);
                    *theta = if carries { folded(folded(at[i]) + self.offset) } else { f32::NAN };
                }
                run.mirror[..count].iter().zip(light).map(|(mirror, a)| usize::from(*mirror != 0 && *a > 0.0)).sum()
            },
        )
    }

    /// Computes the points with their variances, widened according to the residual.
    #[inline(always)]
    fn points(&self, first: usize, residual: &[f32], run: &mut Run, covariance: impl Fn(usize, [f32; 3]) -> [f32; 6]) {
        let count = residual.len();
        let [s0, s1, s2] = [&self.maps.s0, &self.maps.s1, &self.maps.s2].map(|plane| &plane[first..][..count]);
        let [va, vb, vc] = &mut run.variance;
        for i in 0..count {
            let fitted @ [a, c, s] = [0.5 * s0[i], 0.5 * s1[i], 0.5 * s2[i]];
            let widened = self.misfit.factor(a, residual[i]);
            let variance = Covariance::ratios(covariance(i, fitted), fitted);
            (run.light[i], run.x[i], run.y[i]) = (a, c / a, s / a);
            (va[i], vb[i], vc[i]) = (variance[0] * widened, variance[1] * widened, variance[2] * widened);
        }
    }
}

enum Inverse {
    Circle(Circle),
    Curve(Box<Table>),
}

struct Circle {
    center: [f32; 2],
    radius: f32,
}

impl Circle {
    fn new(center: [f64; 2], curve: &Curve) -> Self {
        let at = curve.at(0.0);
        let radius = (at[0] - center[0]).hypot(at[1] - center[1]) as f32;
        Self { center: center.map(|v| v as f32), radius }
    }

    #[inline(always)]
    fn project(&self, run: &mut Run, count: usize) {
        let [va, vb, vc] = run.variance.each_ref().map(|v| &v[..count]);
        for i in 0..count {
            let (x, y) = (run.x[i] - self.center[0], run.y[i] - self.center[1]);
            let square = x * x + y * y;
            let across = (y * y * va[i] - 2.0 * x * y * vb[i] + x * x * vc[i]) / square;
            let along = (x * x * va[i] + 2.0 * x * y * vb[i] + y * y * vc[i]) / square;
            let off = square.sqrt() - self.radius;
            let excess = (off * off - OUTLIER_SIGMAS * OUTLIER_SIGMAS * along).max(0.0);
            run.theta[i] = 0.5 * atan2(y, x);
            run.sigma[i] = 0.5 * ((across + excess) / square).sqrt();
        }
        run.mirror[..count].fill(0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Fit;
    use crate::synthetic::even_angles;
    use std::f64::consts::PI;

    /// Metal without a grating is masked and counted; gratings and dark pixels are not.
    #[test]
    fn metal_without_a_grating_is_counted() {
        let mut curve = Curve::circle([0.05, 0.02], 0.3);
        curve.mirror = Some([0.05, 0.02]);
        let (model, center) = (Model::Curve, None);
        let model = Candidate {
            model,
            extended: &[],
            parameters: 4,
            curve,
            center,
            prior: 0.0,
            information_gain: None,
            widened: 1.0,
            uncertain: 0.0,
            film: None,
        };
        let angles = even_angles(6);
        let design = Design::new(&angles).unwrap();
        let noise = [FrameNoise { shot: 0.0, floor: 1e-6 }; 6];
        let pixels = 60;
        let mut fit = Fit::new(pixels, 1);
        for psi in &angles {
            fit.add(*psi, |_, values, _| {
                for (i, value) in values.iter_mut().enumerate() {
                    let [x, y] = if i % 3 == 0 { [0.05, 0.02] } else { curve.at(PI * i as f64 / pixels as f64) };
                    let light = if i % 3 == 1 { 0.0 } else { 0.5 };
                    *value = (light * (1.0 + x * (2.0 * psi).cos() + y * (2.0 * psi).sin())) as f32;
                }
            });
        }
        let inversion = Inversion { design: &design, noise: &noise, model: &model, correction: None, offset: 0.0 };
        let mut maps = fit.solve(&design);
        let residual = std::mem::take(&mut maps.residual);
        let (map, mirrors) = invert_curve(&maps, residual, &inversion);
        assert_eq!(mirrors, pixels / 3);
        for (i, theta) in map.orientation.iter().enumerate() {
            let wanted = PI * i as f64 / pixels as f64;
            let off = crate::angle_difference(f64::from(*theta), wanted).abs();
            assert!(if i % 3 == 2 { off < 0.01 } else { theta.is_nan() }, "{i}: {theta}");
        }
    }
}

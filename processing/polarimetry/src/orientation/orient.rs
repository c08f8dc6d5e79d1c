//! The `sinusoid` model: the fitted phase is the orientation, with its uncertainty and a mask.

use crate::fit::noise::Covariance;
use crate::{Design, FrameNoise, StokesMaps};
use nacre_base::statistics::chi_square_quantile;
use nacre_base::vector_atan::{atan2, folded};
use nacre_base::vectors::vectorised;
use rayon::prelude::*;
use std::f32::consts::{FRAC_PI_2, PI};

/// Signal-to-noise ratio of the modulation from which a pixel has an orientation, corresponding to σ(θ) ≤ 1/8 rad =
/// 7.2°. Pure noise passes with probability e⁻⁸ = 0.03 %.
pub const MASK_SNR: f32 = 4.0;

/// χ² quantile (1 in 100,000), in standard deviations of a normal distribution, above which a residual is not noise.
/// The pixel then does not follow the model, and its σ is multiplied by the factor that explains the residual.
const MISFIT_Z: f64 = 4.27;

/// Orientation per pixel, NaN where masked.
pub struct OrientationMaps {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Orientation in `[0, π)` rad, up to an unknown offset common to all pixels (2018 paper, section 5.3).
    pub orientation: Vec<f32>,
    /// Standard deviation of the orientation in rad due to noise; in written maps also due to the model and to edges.
    /// It is not masked, so that it shows why a pixel is.
    pub sigma: Vec<f32>,
}

/// Orientation, σ and mask of every pixel. `noise` has one entry per frame of `design`; `offset` (rad) is added to all
/// orientations, for absolute orientations if one is known.
///
/// σ(θ) follows from the 3×3 covariance of (A, C, S): with (C, S) the modulation and t the unit vector across it,
/// `σ = sqrt(tᵀ Cov t) / (2 |(C, S)|)`.
///
/// Consumes the residual map, whose memory σ reuses.
pub fn orient(maps: &mut StokesMaps, design: &Design, noise: &[FrameNoise], offset: f64) -> OrientationMaps {
    let residual = std::mem::take(&mut maps.residual);
    phases(maps, residual, design, noise, offset)
}

/// As [`orient`], without mutable access to the maps.
pub(crate) fn phases(
    maps: &StokesMaps,
    residual: Vec<f32>,
    design: &Design,
    noise: &[FrameNoise],
    offset: f64,
) -> OrientationMaps {
    let mut sigma = residual;
    let covariance = Covariance::new(design, noise, &maps.covariance);
    let misfit = Misfit::new(design, noise, maps);
    let offset = fold(offset as f32);
    let mut orientation = vec![0.0_f32; maps.s0.len()];
    const BLOCK: usize = 4096;
    orientation.par_chunks_mut(BLOCK).zip(sigma.par_chunks_mut(BLOCK)).enumerate().for_each(
        |(block, (theta, sigma))| {
            let first = block * BLOCK;
            let fitted = [&maps.s0, &maps.s1, &maps.s2].map(|plane| &plane[first..][..theta.len()]);
            vectorised(
                #[inline(always)]
                || match &covariance {
                    Covariance::Alike(all) => {
                        phases_of(fitted, theta, sigma, &misfit, offset, |_, fitted| Covariance::linear(all, fitted));
                    }
                    Covariance::Each(own) => phases_of(fitted, theta, sigma, &misfit, offset, |i, _| own[first + i]),
                },
            );
        },
    );
    OrientationMaps { width: maps.width, height: maps.height, orientation, sigma }
}

/// Orientations and σ of a run of pixels; `sigma` initially holds residuals.
#[inline(always)]
fn phases_of(
    [s0, s1, s2]: [&[f32]; 3],
    theta: &mut [f32],
    sigma: &mut [f32],
    misfit: &Misfit,
    offset: f32,
    covariance: impl Fn(usize, [f32; 3]) -> [f32; 6],
) {
    let count = theta.len();
    let (s0, s1, s2, sigma) = (&s0[..count], &s1[..count], &s2[..count], &mut sigma[..count]);
    for i in 0..count {
        let fitted @ [a, c, s] = [0.5 * s0[i], 0.5 * s1[i], 0.5 * s2[i]];
        let [_, _, _, vc, vcs, vs] = covariance(i, fitted);
        let modulation = (c * c + s * s).sqrt();
        // The unit vector is computed first: products of tiny modulations with variances would underflow, and σ would
        // be 0.
        let (u, v) = (c / modulation, s / modulation);
        let across = (v * v * vc - 2.0 * u * v * vcs + u * u * vs).max(0.0);
        let widened = (across * misfit.factor(a, sigma[i])).sqrt();
        let snr = modulation / widened;
        sigma[i] = (0.5 / snr).min(FRAC_PI_2);
        let carries = (snr >= MASK_SNR) & (a > 0.0);
        theta[i] = if carries { folded(0.5 * atan2(s, c) + offset) } else { f32::NAN };
    }
}

/// Increases the variance of pixels whose residual exceeds the noise.
pub(crate) struct Misfit {
    freedom: f32,
    limit: f32,
    shot: f32,
    floor: f32,
}

impl Misfit {
    pub(crate) fn new(design: &Design, noise: &[FrameNoise], maps: &StokesMaps) -> Self {
        let (freedom, n) = (design.freedom(), noise.len().max(1) as f64);
        let shot = (noise.iter().map(|f| f.shot).sum::<f64>() / n) as f32;
        let floor = (noise.iter().map(|f| f.floor).sum::<f64>() / n) as f32;
        let limit = if freedom > 0 { chi_square_quantile(freedom, MISFIT_Z) as f32 } else { f32::INFINITY };
        // The residual of weighted maps is χ² already.
        let (shot, floor) = if maps.covariance.is_empty() { (shot, floor) } else { (0.0, 1.0) };
        Self { freedom: freedom.max(1) as f32, limit, shot, floor }
    }

    #[inline(always)]
    pub(crate) fn factor(&self, a: f32, residual: f32) -> f32 {
        let chi_square = residual / (self.shot * a + self.floor).max(f32::MIN_POSITIVE);
        if chi_square > self.limit { chi_square / self.freedom } else { 1.0 }
    }
}

/// Folds an angle into `[0, π)`.
pub(crate) fn fold(angle: f32) -> f32 {
    let folded = angle.rem_euclid(PI);
    if folded >= PI { 0.0 } else { folded }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Fit, NoiseModel, Stokes, angle_difference};
    use proptest::prelude::*;

    fn angles(n: usize, start: f64) -> Vec<f64> {
        (0..n).map(|k| start + std::f64::consts::PI * k as f64 / n as f64).collect()
    }

    fn fit_of(pixels: &[Stokes], psi: &[f64], noise: impl Fn(usize, usize, f64) -> f64 + Sync) -> StokesMaps {
        let mut fit = Fit::new(pixels.len(), 1);
        for (k, &angle) in psi.iter().enumerate() {
            fit.add(angle, |_, values, _| {
                for (i, v) in values.iter_mut().enumerate() {
                    let clean = pixels[i].through_analyser(angle);
                    *v = (clean + noise(k, i, clean)) as f32;
                }
            });
        }
        fit.solve(&Design::new(psi).unwrap())
    }

    /// Deterministic normal deviates by Box and Muller on a hash.
    fn normal(k: u64, i: u64) -> f64 {
        let hash = |mut z: u64| {
            z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
        };
        let seed = k << 40 | i << 1;
        let (u, v) = (hash(seed).max(1e-300), hash(seed | 1));
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }

    #[test]
    fn differences_of_orientations_wrap() {
        let d = |a: f64, b: f64| angle_difference(a.to_radians(), b.to_radians()).to_degrees();
        assert!((d(1.0, 179.0) - 2.0).abs() < 1e-9 && (d(179.0, 1.0) + 2.0).abs() < 1e-9);
    }

    proptest! {
        /// Noise-free sinusoids are recovered exactly, for any angle set.
        #[test]
        fn exact_without_noise(start in 0.0..3.0f64, n in 3usize..20, s0 in 0.1..10.0f64, dolp in 0.01..0.99f64, aolp in 0.0..3.1f64) {
            let s = Stokes { s0, s1: s0 * dolp * (2.0 * aolp).cos(), s2: s0 * dolp * (2.0 * aolp).sin(), s3: 0.0 };
            let psi = angles(n, start);
            let mut maps = fit_of(&[s], &psi, |_, _, _| 0.0);
            for (got, wanted) in [(maps.s0[0], s.s0), (maps.s1[0], s.s1), (maps.s2[0], s.s2)] {
                prop_assert!((f64::from(got) - wanted).abs() < 2e-6 * s0, "{got} {wanted}");
            }
            let noise = vec![FrameNoise { shot: 0.0, floor: 1e-14 * s0 * s0 }; n];
            let map = orient(&mut maps, &Design::new(&psi).unwrap(), &noise, 0.0);
            prop_assert!(angle_difference(map.orientation[0].into(), aolp).abs() < 1e-4 / dolp.min(0.1));
        }

        /// Rotating sample and analyser together by δ rotates the map by δ and changes nothing else.
        #[test]
        fn turning_sample_and_analyser_turns_the_map(delta in -3.0..3.0f64, aolp in 0.0..3.1f64) {
            let at = |angle: f64| Stokes { s0: 1.0, s1: 0.4 * (2.0 * angle).cos(), s2: 0.4 * (2.0 * angle).sin(), s3: 0.0 };
            let (before, after) = (angles(7, 0.2), angles(7, 0.2 + delta));
            let noise = [FrameNoise { shot: 1e-6, floor: 1e-9 }; 7];
            let run = |s: Stokes, psi: &[f64]| orient(&mut fit_of(&[s], psi, |_, _, _| 0.0), &Design::new(psi).unwrap(), &noise, 0.0);
            let (a, b) = (run(at(aolp), &before), run(at(aolp + delta), &after));
            prop_assert!(angle_difference(b.orientation[0].into(), f64::from(a.orientation[0]) + delta).abs() < 1e-5);
            prop_assert!((a.sigma[0] / b.sigma[0] - 1.0).abs() < 1e-3);
        }
    }

    /// σ equals the scatter of repeated noisy fits within 5 %; with 20,000 repeats the scatter is known to 0.5 %.
    #[test]
    fn sigma_matches_the_scatter_of_repeats() {
        let camera = NoiseModel { full_scale_e: 8000.0, read_noise_e: 12.0 };
        let cases: [(f64, f64, Vec<f64>); 3] = [
            (0.3, 0.4, angles(12, 0.0)),
            (0.1, 2.2, angles(4, 0.3)),
            (0.5, 1.0, vec![0.0, 0.3, 0.9, 1.0, 2.0]), // uneven: C and S are correlated
        ];
        for (case, (dolp, aolp, psi)) in cases.into_iter().enumerate() {
            let s =
                Stokes { s0: 1.2, s1: 1.2 * dolp * (2.0 * aolp).cos(), s2: 1.2 * dolp * (2.0 * aolp).sin(), s3: 0.0 };
            let (exposure, gain) = (0.5, 2.0);
            let noise = vec![camera.frame(gain, 1.0 / (exposure * gain), 0.0); psi.len()];
            let n = 20_000;
            let mut maps = fit_of(&vec![s; n], &psi, |k, i, clean| {
                (noise[k].shot * clean + noise[k].floor).sqrt() * normal((100 * case + k) as u64, i as u64)
            });
            let map = orient(&mut maps, &Design::new(&psi).unwrap(), &noise, 0.0);
            let errors: Vec<f64> =
                map.orientation.iter().map(|&t| angle_difference(t.into(), aolp)).filter(|e| e.is_finite()).collect();
            assert!(errors.len() > n * 99 / 100);
            let scatter = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
            let mut sigmas = map.sigma.clone();
            sigmas.sort_by(f32::total_cmp);
            let sigma = f64::from(sigmas[n / 2]);
            assert!((sigma / scatter - 1.0).abs() < 0.05, "case {case}: σ {sigma} scatter {scatter}");
        }
    }

    /// Modulation due to rounding is masked, also where subnormal numbers are flushed to zero.
    #[test]
    fn modulation_of_rounding_is_masked() {
        nacre_base::numeric::flush_subnormals();
        let psi = angles(4, 0.0);
        let noise = [FrameNoise { shot: 1e-5, floor: 1e-6 }; 4];
        let pixels: Vec<Stokes> = (0..4000)
            .map(|i| {
                let tiny = 10_f64.powi(-(i % 45)) * 1e-6;
                Stokes { s0: 0.5, s1: -tiny, s2: -0.7 * tiny, s3: 0.0 }
            })
            .collect();
        let (s1, s2) = (pixels.iter().map(|p| p.s1 as f32).collect(), pixels.iter().map(|p| p.s2 as f32).collect());
        let mut maps = StokesMaps { s1, s2, ..fit_of(&pixels, &psi, |_, _, _| 0.0) };
        let map = orient(&mut maps, &Design::new(&psi).unwrap(), &noise, 0.0);
        assert!(map.orientation.iter().all(|t| t.is_nan()) && map.sigma.iter().all(|s| *s > 1.0));
    }

    /// Noise alone is masked: at most e⁻⁸ of the pixels pass (here 0.03 %, tested at 0.1 %).
    #[test]
    fn pure_noise_is_masked() {
        let psi = angles(8, 0.0);
        let noise = [FrameNoise { shot: 1e-4, floor: 1e-6 }; 8];
        let mut maps = fit_of(&vec![Stokes::unpolarized(1.0); 20_000], &psi, |k, i, clean| {
            (1e-4 * clean + 1e-6).sqrt() * normal(k as u64, i as u64)
        });
        let map = orient(&mut maps, &Design::new(&psi).unwrap(), &noise, 0.0);
        let passed = map.orientation.iter().filter(|t| t.is_finite()).count();
        assert!(passed <= 20, "{passed}");
    }

    /// The noise estimated from the residuals is correct to 5 %, so σ is also correct without a noise model.
    #[test]
    fn noise_is_estimated_from_residuals() {
        let psi = angles(8, 0.1);
        let pixels: Vec<_> = (0..60_000)
            .map(|i| {
                let s0 = 0.2 + 1.6 * f64::from(i) / 60_000.0;
                Stokes { s0, s1: 0.2 * s0, s2: 0.1 * s0, s3: 0.0 }
            })
            .collect();
        let truth = FrameNoise { shot: 2e-4, floor: 3e-5 };
        let maps =
            fit_of(&pixels, &psi, |k, i, clean| (truth.shot * clean + truth.floor).sqrt() * normal(k as u64, i as u64));
        let found = crate::estimate_noise(&maps, &Design::new(&psi).unwrap()).unwrap();
        for a in [0.1, 0.5, 0.9] {
            let ratio = (found.shot * a + found.floor) / (truth.shot * a + truth.floor);
            assert!((ratio - 1.0).abs() < 0.05, "at {a}: {ratio} {found:?}");
        }
    }
}

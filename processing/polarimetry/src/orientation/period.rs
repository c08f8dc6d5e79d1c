//! The period of the grating in every pixel, from the fit that gives its orientation. Both methods rely on strong
//! assumptions; a spot scan measures the period.
//!
//! - [`relative_period`] is the 2018 paper's section 5.4, which assumes specular intensity ∝ period². This is a
//!   **heuristic**: the zero order of an infinite sinusoid does not follow that law. In scalar theory it does not
//!   depend on the period at all. Rigorously, 100 nm aluminium in air at 560 nm reflects 0.459, 0.447 and 0.455 at 2.0,
//!   1.0 and 0.7 µm. The law then gives 1 : 0.99 : 1.00 for periods of 1 : 0.5 : 0.35. Variations of light or
//!   reflectance appear as periods: ±40 % as ±20 %.
//! - [`PeriodScale`] inverts the degree of linear polarization by rigorous diffraction, for an *assumed* depth, metal
//!   and film. Its σ includes noise only; wrong assumptions add a bias. Measured without noise for periods from 1.2 to
//!   1.8 µm at 560 nm, assuming 100 nm of aluminium and the true index above except where stated:
//!
//! Mean error for each simulated grating:
//!
//! - as assumed: 0.0 % in air, 0.0 % under film (1.468)
//! - 80 nm: +28.6 % in air, +38.8 % under film
//! - 90 nm: +13.1 %, +18.0 %
//! - 110 nm: -11.1 %, -16.2 %
//! - 120 nm: -20.6 %, -31.9 %
//! - silver (0.12 + 3.45i): -2.5 %, -3.8 %
//! - gold (0.33 + 2.6i): -1.8 %, -4.1 %
//! - chromium (2.7 + 3.3i): +7.1 %, +9.7 %
//! - index above 0.1 higher: -2.5 %, -5.2 %
//!
//! The depth must therefore be known: a depth error of 10 % causes a period error of 11 to 18 %. Near a surface plasmon
//! or an order's onset, several periods correspond to one polarization; those are masked. For 0.6 to 3.0 µm, invertible
//! ranges in air are 0.60-1.05, 1.20-1.60 and 1.68-3.0 µm; under film 0.60-0.75, 0.81-0.97 and 1.15-3.0 µm.
//!
//! Birefringent film and front reflection also change the polarization and are not modelled.

use crate::{OrientationMaps, StokesMaps};
use nacre_base::{Error, Result};
use nacre_optics::rcwa::{Grating, RatioTable};
use num_complex::Complex;
use rayon::prelude::*;

/// The degree of polarization must be invertible over this many σ on both sides.
const SURE: f64 = 2.0;

/// Period per pixel, NaN where masked.
pub struct PeriodMaps {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Period in µm.
    pub period_um: Vec<f32>,
    /// Standard deviation in µm due to noise; NaN where masked, and everywhere for heuristic periods.
    pub sigma_um: Vec<f32>,
}

/// **Heuristic** relative period (2018 paper, section 5.4): the square root of the mean intensity relative to the
/// brightest pixel with an orientation, mapped from 0..1 to `range_um` (µm). Only its rank order is meaningful, and
/// only for uniform light and reflectance; it has no σ.
///
/// # Errors
/// For a range other than two increasing numbers of µm, 0 or more.
pub fn relative_period(maps: &StokesMaps, orientation: &OrientationMaps, range_um: [f64; 2]) -> Result<PeriodMaps> {
    let [low, high] = range_um;
    if !(low >= 0.0 && high > low && high.is_finite()) {
        let problem = format!("found {low} to {high} µm");
        return Err(Error::input("range of periods", problem, "give two rising numbers, 0 or more"));
    }
    let lit = |(s0, theta): (&f32, &f32)| if theta.is_finite() { *s0 } else { f32::NAN };
    let brightest = maps.s0.iter().zip(&orientation.orientation).map(lit).fold(0.0, f32::max);
    let period = |s0: f32| (low + (high - low) * f64::from(s0.max(0.0) / brightest).sqrt()) as f32;
    let pixels = maps.s0.par_iter().zip(&orientation.orientation);
    let period_um = pixels.map(lit).map(|s0| if s0.is_nan() { s0 } else { period(s0) }).collect();
    Ok(PeriodMaps { width: maps.width, height: maps.height, period_um, sigma_um: vec![f32::NAN; maps.s0.len()] })
}

/// Degree of linear polarization of circular light behind a grating with ratio R, without film (2018 paper, Eq. 9):
/// `|(1 - r², 2r sin ζ)| / (1 + r²)`. It is close to the contrast `|Rs - Rp|/(Rs + Rp)`, but independent of the common
/// offset of the orientations.
pub fn polarization_of(ratio: Complex<f64>) -> f64 {
    let power = ratio.norm_sqr();
    (1.0 - power).hypot(2.0 * ratio.im) / (1.0 + power)
}

/// The period as a function of the degree of linear polarization, where it is unique.
#[derive(Clone, Debug)]
pub struct PeriodScale {
    /// Values at nodes in increasing order; between two neighbours the same period intervals correspond.
    levels: Vec<f64>,
    /// For each gap between levels the unique period interval, if any: (period, value) at both its ends.
    gaps: Vec<Option<[(f64, f64); 2]>>,
    invertible: Vec<[f64; 2]>,
}

impl PeriodScale {
    /// Scale for periods in `range_um` (µm), which must contain the true period. Depth and media are those of
    /// `assumed`, whose period is ignored; the error of R is at most `max_error`.
    ///
    /// # Errors
    /// As [`RatioTable::new`].
    pub fn new(assumed: &Grating, range_um: [f64; 2], wavelength_nm: f64, max_error: f64) -> Result<Self> {
        let table = RatioTable::new(assumed, range_um, wavelength_nm, max_error)?;
        let nodes: Vec<_> = table.nodes().map(|(period, ratio)| (period, polarization_of(ratio))).collect();
        Ok(Self::of(&nodes))
    }

    fn of(nodes: &[(f64, f64)]) -> Self {
        let mut levels: Vec<f64> = nodes.iter().map(|n| n.1).collect();
        levels.sort_by(f64::total_cmp);
        levels.dedup();
        let only = |gap: &[f64]| {
            let middle = 0.5 * (gap[0] + gap[1]);
            let mut answers = nodes.windows(2).filter(|n| (n[0].1 < middle) != (n[1].1 < middle));
            let (first, second) = (answers.next()?, answers.next());
            second.is_none().then(|| [first[0], first[1]])
        };
        let gaps: Vec<_> = levels.windows(2).map(only).collect();
        let mut parts: Vec<[f64; 2]> = Vec::new();
        for (gap, segment) in levels.windows(2).zip(&gaps) {
            if let Some(segment) = segment {
                let (a, b) = (along(segment, gap[0]), along(segment, gap[1]));
                parts.push([a.min(b), a.max(b)]);
            }
        }
        parts.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let mut invertible: Vec<[f64; 2]> = Vec::new();
        for part in parts {
            match invertible.last_mut() {
                Some(last) if part[0] - last[1] < 1e-9 => last[1] = part[1],
                _ => invertible.push(part),
            }
        }
        Self { levels, gaps, invertible }
    }

    /// Ranges of period (µm, increasing) whose polarization corresponds to no other period of the range.
    pub fn invertible(&self) -> &[[f64; 2]] {
        &self.invertible
    }

    /// Period in µm and its slope (µm per unit of polarization); `None` if no period or several correspond to the
    /// polarization.
    pub fn period(&self, polarization: f64) -> Option<(f64, f64)> {
        let above = self.levels.partition_point(|l| *l <= polarization);
        let segment = self.gaps.get(above.checked_sub(1)?)?.as_ref()?;
        let slope = (segment[1].0 - segment[0].0) / (segment[1].1 - segment[0].1);
        Some((along(segment, polarization), slope))
    }

    /// Period of every pixel with an orientation. σ follows from that of the orientation: the modulation has equal
    /// errors along and across, so `σ(polarization) = 2·polarization·σ(θ)`. The contribution of the mean intensity is
    /// smaller by a factor of the polarization. A pixel is masked if its polarization within two σ corresponds to no
    /// period or to several.
    pub fn invert(&self, maps: &StokesMaps, orientation: &OrientationMaps) -> PeriodMaps {
        let pixel = |i: usize| {
            let value = f64::from(maps.s1[i].hypot(maps.s2[i]) / maps.s0[i]);
            let sigma = 2.0 * value * f64::from(orientation.sigma[i]);
            let found = self.period(value).filter(|_| {
                let side = |sign: f64| self.period(value + sign * SURE * sigma).is_some();
                orientation.orientation[i].is_finite() && side(-1.0) && side(1.0)
            });
            found.map_or((f32::NAN, f32::NAN), |(period, slope)| (period as f32, (slope.abs() * sigma) as f32))
        };
        let (period_um, sigma_um) = (0..maps.s0.len()).into_par_iter().map(pixel).unzip();
        PeriodMaps { width: maps.width, height: maps.height, period_um, sigma_um }
    }
}

/// Linear interpolation of the period.
fn along(segment: &[(f64, f64); 2], value: f64) -> f64 {
    let [(low, from), (high, to)] = *segment;
    low + (high - low) * (value - from) / (to - from)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orient;
    use crate::{Design, Fit, FrameNoise, Jones, JonesVector, Stokes};
    use nacre_optics::rcwa::{ALUMINIUM, ratio};

    const FOIL: Grating = Grating { period_um: 1.0, depth_um: 0.1, above: 1.0, below: ALUMINIUM };

    /// Light reflected by a foil of this period and orientation.
    fn light(foil: &Grating, orientation: f64) -> Stokes {
        let ratio = ratio(foil, 560.0, 1e-5).unwrap();
        Jones::grating(orientation, ratio).apply(JonesVector::circular()).stokes()
    }

    /// Sum of twelve uniform deviates from a linear congruential generator: sufficiently normal for a variance.
    fn normal(state: &mut u64) -> f64 {
        (0..12)
            .map(|_| {
                *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (*state >> 11) as f64 / (1u64 << 53) as f64
            })
            .sum::<f64>()
            - 6.0
    }

    fn measured(pixels: &[Stokes], sigma: f64) -> (StokesMaps, OrientationMaps) {
        let psi: Vec<f64> = (0..12).map(|k| f64::from(k) * 15f64.to_radians()).collect();
        let (design, mut fit) = (Design::new(&psi).unwrap(), Fit::new(pixels.len(), 1));
        for (k, angle) in psi.iter().enumerate() {
            fit.add(*angle, |_, values, _| {
                let mut state = 77 + k as u64;
                normal(&mut state);
                for (value, pixel) in values.iter_mut().zip(pixels) {
                    *value = (pixel.through_analyser(*angle) + sigma * normal(&mut state)) as f32;
                }
            });
        }
        let mut maps = fit.solve(&design);
        let noise = [FrameNoise { shot: 0.0, floor: (sigma * sigma).max(1e-14) }; 12];
        let orientation = orient(&mut maps, &design, &noise, 0.0);
        (maps, orientation)
    }

    #[test]
    fn the_scatter_of_the_period_is_its_sigma() {
        let scale = PeriodScale::new(&FOIL, [0.7, 1.0], 560.0, 1e-3).unwrap();
        let pixels: Vec<_> = (0..4000).map(|i| light_at_0_8(f64::from(i) * 0.01)).collect();
        let (maps, orientation) = measured(&pixels, 0.01);
        let found = scale.invert(&maps, &orientation);
        let n = pixels.len() as f64;
        let period = |i: usize| f64::from(found.period_um[i]);
        let mean = (0..pixels.len()).map(period).sum::<f64>() / n;
        let scatter = ((0..pixels.len()).map(|i| (period(i) - mean).powi(2)).sum::<f64>() / n).sqrt();
        let sigma = found.sigma_um.iter().map(|s| f64::from(*s)).sum::<f64>() / n;
        assert!((mean - 0.8).abs() < 1e-3, "{mean}");
        assert!((scatter / sigma - 1.0).abs() < 0.05, "{scatter} {sigma}");
    }

    /// One solution, rotated: 4000 solutions would take a minute.
    fn light_at_0_8(orientation: f64) -> Stokes {
        static R: std::sync::OnceLock<Complex<f64>> = std::sync::OnceLock::new();
        let r = *R.get_or_init(|| ratio(&Grating { period_um: 0.8, ..FOIL }, 560.0, 1e-5).unwrap());
        Jones::grating(orientation, r).apply(JonesVector::circular()).stokes()
    }

    #[test]
    fn wrong_assumptions_have_the_documented_errors() {
        let scale = PeriodScale::new(&FOIL, [1.15, 3.0], 560.0, 1e-3).unwrap();
        let chromium = Complex::new(2.7, 3.3);
        for (foil, wanted) in [
            (FOIL, 0.0),
            (Grating { depth_um: 0.09, ..FOIL }, 0.131),
            (Grating { depth_um: 0.11, ..FOIL }, -0.111),
            (Grating { below: chromium, ..FOIL }, 0.071),
        ] {
            let periods = [1.4, 1.5, 1.7, 1.8];
            let pixels = periods.map(|period_um| light(&Grating { period_um, ..foil }, 0.3));
            let (maps, orientation) = measured(&pixels, 0.0);
            let found = scale.invert(&maps, &orientation).period_um;
            let off: Vec<_> = found.iter().zip(periods).map(|(p, truth)| f64::from(*p) / truth - 1.0).collect();
            let known: Vec<_> = off.into_iter().filter(|o| o.is_finite()).collect();
            let mean = known.iter().sum::<f64>() / known.len() as f64;
            assert!(known.len() >= 2 && (mean - wanted).abs() < 0.01, "{foil:?}: {known:?}");
        }
    }

    #[test]
    fn only_unique_answers_are_given() {
        let scale = PeriodScale::of(&[(1.0, 0.0), (2.0, 1.0), (3.0, 0.5), (4.0, 2.0)]);
        let [[a, b], [c, d]] = scale.invertible() else { panic!("{:?}", scale.invertible()) };
        assert!([a - 1.0, b - 1.5, c - 10.0 / 3.0, d - 4.0].iter().all(|x| x.abs() < 1e-12));
        assert_eq!(scale.period(0.25), Some((1.25, 1.0)));
        assert!([0.7, -0.1, 2.1, f64::NAN].iter().all(|v| scale.period(*v).is_none()));
    }

    /// A pixel with a unique value is masked if its noise extends into an ambiguous range.
    #[test]
    fn uncertain_pixels_are_masked() {
        let scale = PeriodScale::of(&[(1.0, 0.0), (2.0, 1.0), (3.0, 0.5), (4.0, 2.0)]);
        let pixel = Stokes { s0: 1.0, s1: 0.45, s2: 0.0, s3: 0.0 };
        let sharp = measured(&[pixel], 1e-4);
        assert!((scale.invert(&sharp.0, &sharp.1).period_um[0] - 1.45).abs() < 1e-2);
        let (maps, mut noisy) = measured(&[pixel], 1e-4);
        noisy.sigma[0] = 0.05;
        assert!(scale.invert(&maps, &noisy).period_um[0].is_nan());
    }

    #[test]
    fn the_relative_period_is_the_papers_law() {
        let pixel = |s0: f64| Stokes { s0, s1: 0.5 * s0, s2: 0.0, s3: 0.0 };
        let (maps, mut orientation) = measured(&[pixel(4.0), pixel(1.0), pixel(0.0), pixel(9.0)], 0.0);
        orientation.orientation[3] = f32::NAN;
        let found = relative_period(&maps, &orientation, [0.5, 2.5]).unwrap().period_um;
        assert!((found[0] - 2.5).abs() < 1e-5 && (found[1] - 1.5).abs() < 1e-5, "{found:?}");
        assert!(found[2].is_nan() && found[3].is_nan());
        assert!(relative_period(&maps, &orientation, [2.0, 1.0]).is_err());
    }
}

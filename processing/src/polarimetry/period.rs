//! The period of the grating in every pixel, from the same fit that gives its orientation. Both ways assume much; the
//! measured answer is a spot scan.
//!
//! - [`relative_period`] is the 2018 paper's section 5.4: the specular intensity taken as ∝ period². This is a
//!   **heuristic**: the zero order of an infinite sinusoid does not follow that law (in scalar theory it does not
//!   depend on the period at all; rigorously, 100 nm aluminium at 560 nm reflects 0.459, 0.447 and 0.455 at 2.0, 1.0 and
//!   0.7 µm, where the law wants 1 : 0.25 : 0.12), and any unevenness of light or reflectance is read as a period.
//! - [`PeriodScale`] inverts the degree of linear polarization through Maxwell's equations, for an *assumed* depth,
//!   metal and film. Its σ is that of noise alone; wrong assumptions are a bias on top. Measured on noise-free pixels of
//!   true periods 1.2 to 1.8 µm in air at 560 nm (assumed: 100 nm, aluminium), mean error of the period:
//!
//! | pixels are made with | error | | pixels are made with | error |
//! |---|---|---|---|---|
//! TABLE
//!
//! Birefringent film and front reflection change the polarization as well and are not in the model.

use super::{OrientationMaps, StokesMaps};
use crate::rcwa::{Grating, RatioTable};
use crate::{Error, Result};
use num_complex::Complex;
use rayon::prelude::*;

/// A pixel's value must be invertible over this many σ to both sides.
const SURE: f64 = 2.0;

/// Period per pixel, NaN where masked.
pub struct PeriodMaps {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Period in µm.
    pub period_um: Vec<f32>,
    /// Standard deviation in µm from noise alone; NaN where masked, and everywhere when the period is heuristic.
    pub sigma_um: Vec<f32>,
}

/// **Heuristic** relative period (2018 paper, section 5.4): the square root of the mean intensity relative to the
/// brightest pixel with an orientation, retargeted from 0..1 to `range_um` (µm). Only its rank order has a meaning, and
/// that only where light and reflectance are even; it has no σ.
///
/// # Errors
/// A range that is not two rising numbers of µm, 0 or more.
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
    let period_um = pixels.map(|pixel| lit(pixel)).map(|s0| if s0.is_nan() { s0 } else { period(s0) }).collect();
    Ok(PeriodMaps { width: maps.width, height: maps.height, period_um, sigma_um: vec![f32::NAN; maps.s0.len()] })
}

/// Degree of linear polarization of circular light behind a grating with ratio R, without film (2018 paper, Eq. 9):
/// `|(1 - r², 2r sin ζ)| / (1 + r²)`. Close to the contrast `|Rs - Rp|/(Rs + Rp)`, but free of the orientation's gauge.
pub fn polarization_of(ratio: Complex<f64>) -> f64 {
    let power = ratio.norm_sqr();
    (1.0 - power).hypot(2.0 * ratio.im) / (1.0 + power)
}

/// The period as a function of the degree of linear polarization, where it is one.
#[derive(Clone, Debug)]
pub struct PeriodScale {
    /// Values at nodes in rising order: between two neighbours the same intervals of period answer.
    levels: Vec<f64>,
    /// Per gap between levels, the only interval of period that answers: (period, value) at both its ends.
    gaps: Vec<Option<[(f64, f64); 2]>>,
    invertible: Vec<[f64; 2]>,
}

impl PeriodScale {
    /// For periods in `range_um` (µm; the true period must be known to lie there), with the depth and the media of
    /// `assumed` (its period does not count), to `max_error` in R.
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

    /// Ranges of period (µm, rising) whose polarization belongs to no other period of the range.
    pub fn invertible(&self) -> &[[f64; 2]] {
        &self.invertible
    }

    /// Period in µm and its slope (µm per unit of polarization); None where no period or several answer.
    pub fn period(&self, polarization: f64) -> Option<(f64, f64)> {
        let above = self.levels.partition_point(|l| *l <= polarization);
        let segment = self.gaps.get(above.checked_sub(1)?)?.as_ref()?;
        let slope = (segment[1].0 - segment[0].0) / (segment[1].1 - segment[0].1);
        Some((along(segment, polarization), slope))
    }

    /// Period of every pixel that has an orientation. σ follows from the orientation's: the modulation scatters as much
    /// along as across, so `σ(polarization) = 2·polarization·σ(θ)`; what the mean intensity scatters is smaller by the
    /// polarization itself. Masked where the polarization, give or take two σ, belongs to no period or to several.
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

//! Complex reflectance ratio `R = r·exp(iζ)` (2018 paper, Eq. 6) by rigorous diffraction.

use super::{Grating, Light, Polarization, solve};
use nacre_base::{Error, Result};
use num_complex::Complex;
use rayon::prelude::*;

/// Widest relative interval of a table, largest number of nodes, and narrowest interval that is bisected, in µm.
const WIDEST: f64 = 0.1;
const MOST_NODES: usize = 2000;
const NARROWEST_UM: f64 = 1e-7;

/// Ratio R of a grating's specular Jones matrix `diag(-1, R)` along and across the grating vector, at normal incidence
/// (2018 paper, Eq. 6).
///
/// R is `-r_s / r_p` with both fields on fixed axes, so a mirror has R = -1. `max_error` is absolute.
///
/// # Errors
/// As [`solve`]; also for a grating that reflects no p-polarized light.
pub fn ratio(grating: &Grating, wavelength_nm: f64, max_error: f64) -> Result<Complex<f64>> {
    let light = Light { wavelength_nm, angle: 0.0 };
    // The error of R is (1 + |R|)/|r_p| times that of the amplitudes. A first solution at low accuracy gives this
    // factor.
    let (mut wanted, mut found) = (max_error / 4.0, None);
    for _ in 0..2 {
        let s = solve(grating, &light, Polarization::Te, wanted)?;
        let p = solve(grating, &light, Polarization::Tm, wanted)?;
        // The magnetic field keeps its sign where the electric field changes it; hence the minus in -r_s/r_p.
        let (r_s, r_p) = (s.reflected(0).amplitude, p.reflected(0).amplitude);
        let ratio = r_s / r_p;
        if !ratio.is_finite() {
            return Err(Error::input("grating", "it reflects no p-polarized light", "change its depth or period"));
        }
        found = Some(ratio);
        let needed = max_error * r_p.norm() / (1.0 + ratio.norm());
        if s.predicted_error.max(p.predicted_error) <= needed {
            break;
        }
        wanted = needed;
    }
    found.ok_or_else(|| Error::input("grating", "no ratio", "ask for a larger error"))
}

/// Polarization contrast `(Rs - Rp)/(Rs + Rp)` of the specular reflectances.
pub fn contrast(ratio: Complex<f64>) -> f64 {
    let power = ratio.norm_sqr();
    (power - 1.0) / (power + 1.0)
}

/// Offset of the sinusoid model in rad, in (-π/2, π/2]: AoLP of a grating at orientation 0 under circular light
/// `(1, -i)` without film (2018 paper, Eq. 9).
pub fn phase_offset(ratio: Complex<f64>) -> f64 {
    0.5 * (-2.0 * ratio.im).atan2(1.0 - ratio.norm_sqr())
}

/// Table of R over the period, for one depth, wavelength and pair of media.
///
/// An interval is bisected until the value at its middle is within the requested error of the linear interpolation. The
/// initial nodes enclose the anomalies, where an order begins to propagate or couples to a surface plasmon. These are
/// too narrow to be found by bisection alone.
#[derive(Clone, Debug)]
pub struct RatioTable {
    periods: Vec<f64>,
    ratios: Vec<Complex<f64>>,
    error: f64,
}

impl RatioTable {
    /// Tabulates R for periods of `grating` from `periods_um[0]` to `periods_um[1]` (µm), with an absolute error of at
    /// most `max_error`. Half of the error is allotted to the solver.
    ///
    /// # Errors
    /// As [`ratio`]; also for an empty range, or if R varies too rapidly for 1000 nodes.
    pub fn new(grating: &Grating, periods_um: [f64; 2], wavelength_nm: f64, max_error: f64) -> Result<Self> {
        let [low, high] = periods_um;
        if !(low > 0.0 && high >= low && high.is_finite()) {
            let problem = format!("found {low} to {high} µm");
            return Err(Error::input("range of periods", problem, "give two rising positive numbers"));
        }
        let at = |period_um: f64| ratio(&Grating { period_um, ..*grating }, wavelength_nm, max_error / 2.0);
        let mut periods = first_nodes(grating, [low, high], wavelength_nm / 1000.0);
        let mut ratios: Vec<_> = periods.par_iter().map(|p| at(*p)).collect::<Result<_>>()?;
        let (mut error, mut open) = (0.0_f64, vec![true; periods.len() - 1]);
        while open.contains(&true) {
            if periods.len() > MOST_NODES {
                let problem = format!("R varies too fast with the period to be tabulated to {max_error}");
                return Err(Error::input("range of periods", problem, "narrow it or ask for a larger error"));
            }
            let middle = |i: usize| 0.5 * (periods[i] + periods[i + 1]);
            let middles: Vec<_> = (0..open.len())
                .into_par_iter()
                .map(|i| open[i].then(|| at(middle(i))).transpose())
                .collect::<Result<_>>()?;
            let (mut next_periods, mut next_ratios, mut next_open) = (vec![periods[0]], vec![ratios[0]], Vec::new());
            for (i, value) in middles.into_iter().enumerate() {
                if let Some(value) = value {
                    let off = (value - 0.5 * (ratios[i] + ratios[i + 1])).norm();
                    let done = off <= max_error / 2.0 || periods[i + 1] - periods[i] < NARROWEST_UM;
                    // Where R is smooth, a node in the middle reduces the error of the interval to a quarter.
                    error = if done { error.max(off) } else { error };
                    next_periods.push(middle(i));
                    next_ratios.push(value);
                    next_open.extend([!done; 2]);
                } else {
                    next_open.push(false);
                }
                next_periods.push(periods[i + 1]);
                next_ratios.push(ratios[i + 1]);
            }
            (periods, ratios, open) = (next_periods, next_ratios, next_open);
        }
        Ok(Self { periods, ratios, error: error + max_error / 2.0 })
    }

    /// R at a period in µm; `None` outside of the table.
    pub fn at(&self, period_um: f64) -> Option<Complex<f64>> {
        let (first, last) = (*self.periods.first()?, *self.periods.last()?);
        if !(first..=last).contains(&period_um) {
            return None;
        }
        let above = self.periods.partition_point(|p| *p <= period_um);
        let (Some(high), Some(next)) = (self.periods.get(above), self.ratios.get(above)) else {
            return self.ratios.last().copied();
        };
        let (low, value) = (self.periods[above - 1], self.ratios[above - 1]);
        Some(value + (next - value) * ((period_um - low) / (high - low)))
    }

    /// R at a period in µm, clamped to the range of the table.
    pub fn nearest(&self, period_um: f64) -> Complex<f64> {
        let (first, last) = (self.periods[0], self.periods[self.periods.len() - 1]);
        self.at(period_um.clamp(first, last)).unwrap_or(self.ratios[0])
    }

    /// Nodes of the table: periods in µm, increasing, and R.
    pub fn nodes(&self) -> impl ExactSizeIterator<Item = (f64, Complex<f64>)> + '_ {
        self.periods.iter().copied().zip(self.ratios.iter().copied())
    }

    /// Predicted largest absolute error of [`RatioTable::at`]: the solver's error plus the interpolation error measured
    /// in the middle of every interval before bisection.
    pub fn error(&self) -> f64 {
        self.error
    }
}

/// Initial nodes: a coarse ladder, both sides of every period at which an order begins to propagate (`mλ/n`), and some
/// around every plasmon resonance (`mλ/n` of the plasmon).
fn first_nodes(grating: &Grating, [low, high]: [f64; 2], wavelength_um: f64) -> Vec<f64> {
    let (above, below) = (Complex::from(grating.above.powi(2)), grating.below * grating.below);
    let plasmon = (above * below / (above + below)).sqrt().re;
    let mut nodes = vec![low, high];
    let steps = ((high / low).ln() / WIDEST).ceil();
    nodes.extend((1..steps as usize).map(|i| low * (high / low).powf(i as f64 / steps)));
    let mut around = |index: f64, offsets: &[f64]| {
        let first = wavelength_um / index;
        let orders = (1..).map(|m| f64::from(m) * first).take_while(|p| *p < 1.1 * high);
        nodes.extend(orders.flat_map(|p| offsets.iter().map(move |o| p * (1.0 + o))));
    };
    around(grating.above, &[-1e-6, 1e-6]);
    if grating.below.im == 0.0 {
        around(grating.below.re, &[-1e-6, 1e-6]);
    } else if plasmon > 0.0 {
        around(plasmon, &[-0.03, -0.01, -0.003, 0.0, 0.003, 0.01, 0.03]);
    }
    nodes.retain(|p| (low..=high).contains(p));
    nodes.sort_by(f64::total_cmp);
    nodes.dedup();
    nodes
}

//! Test of a surface's BRDF by the grating equation (2014 thesis, section 5.3, with the gain divided out and the peak
//! interpolated).

use super::brdf::ends;
use super::choose::{Choice, prepare};
use super::engine::{Memory, Request};
use super::geometry::Direction;
use super::height::{HeightField, Quality};
use super::settings::Settings;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use rayon::prelude::*;
use serde::Serialize;
use std::f64::consts::TAU;

/// Largest relative deviation from the expected period in the search for the peak.
const AROUND: f64 = 0.2;

/// Samples per standard deviation of the coherence window.
const PER_SIGMA: f64 = 12.0;

/// Peak of one wavelength.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Peak {
    /// Wavelength in nm.
    pub wavelength_nm: f64,
    /// Angle of the peak from the normal in degrees, positive towards the light.
    pub theta_r_deg: f64,
    /// Period in nm from the grating equation, `λ/(sin θi + sin θr)`.
    pub period_nm: f64,
    /// Height relative to the peak of a mirror.
    pub relative: f64,
}

/// Comparison of a surface with the grating equation.
#[derive(Clone, Debug, Serialize)]
pub struct GratingCheck {
    /// Peaks by wavelength, without wavelengths whose first order is evanescent.
    pub peaks: Vec<Peak>,
    /// Expected period in nm: given, or the strongest in the spectrum of the heights.
    pub expected_nm: f64,
    /// Mean of the periods in nm.
    pub mean_nm: f64,
    /// Variance of the periods in nm².
    pub variance_nm2: f64,
    /// Ridges that alternate as the highest: period in nm, and fraction of the wavelengths.
    pub ridges: Vec<[f64; 2]>,
    /// Azimuth of the light in degrees.
    pub azimuth_deg: f64,
    /// Number of periods along the grating in a patch that cuts it. One period, averaged over the patch, was then
    /// repeated instead.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cut_periods: Option<f64>,
    /// Warnings about the patch; reports list them separately.
    #[serde(skip)]
    pub warnings: Vec<String>,
    /// Method of computation; reports list it separately.
    #[serde(skip)]
    pub choice: Choice,
}

/// Compares the peaks of the first order with the grating equation.
///
/// Light and viewing directions are in the plane of an azimuth, by default that of the strongest period.
///
/// # Errors
/// `Input` for invalid settings, for surfaces without a period, and if no first order is visible.
pub fn check(
    field: &HeightField,
    quality: &Quality,
    settings: &Settings,
    wavelengths_nm: &[f64],
    given: [Option<f64>; 2],
    progress: &dyn Progress,
) -> Result<GratingCheck> {
    settings.check()?;
    ends("wavelengths", wavelengths_nm, [200.0, 2000.0])?;
    let [period_um, azimuth_deg] = given;
    // Repeating a patch that cuts its grating would repeat the cut; one period along the grating vector replaces it.
    if let Some(grating) = quality.grating.filter(|_| quality.cut().is_some()) {
        let whole = grating.whole(field);
        let of_whole = Quality::of_whole(&whole, grating, settings.coherence_um);
        let azimuth = azimuth_deg.unwrap_or(grating.direction_deg);
        let given = [Some(period_um.unwrap_or(grating.period_um)), Some(azimuth - grating.direction_deg)];
        let found = check(&whole, &of_whole, settings, wavelengths_nm, given, progress)?;
        return Ok(GratingCheck { azimuth_deg: azimuth, cut_periods: Some(grating.periods), ..found });
    }
    let strongest = quality.periods.first();
    let refuse =
        || Error::input(&field.name, "has no period that stands out", "give --period-um and the light's azimuth");
    let period = period_um.or(strongest.map(|p| p.period_um)).ok_or_else(refuse)?;
    let azimuth = azimuth_deg.or(strongest.map(|p| p.direction_deg)).ok_or_else(refuse)?;
    if !(period > 0.0 && period < 1e4) {
        return Err(Error::input("period", format!("is {period} µm"), "give a number above 0"));
    }
    let sin_i = settings.light_deg[0].to_radians().sin();
    let light = Direction::light(settings.light_deg[0], azimuth)?;
    // Search range of frequencies that leave the surface.
    let range = |nm: f64| {
        let most = (1.0 + sin_i) * 1e3 / nm * 0.9999;
        [1.0 / period / (1.0 + AROUND), (1.0 / period * (1.0 + AROUND)).min(most)]
    };
    let seen: Vec<f64> = wavelengths_nm
        .iter()
        .copied()
        .filter(|nm| 1.0 / period < (1.0 + sin_i) * 1e3 / nm * 0.9999 && (1e-3 * nm / period - sin_i).abs() < 0.9999)
        .collect();
    if seen.is_empty() {
        let problem = format!("of {period:.3} µm sends its first order in no direction at these wavelengths");
        return Err(Error::input("period", problem, "turn the light, or give shorter wavelengths"));
    }
    let (cos_phi, sin_phi) = (azimuth.to_radians().cos(), azimuth.to_radians().sin());
    let w = |frequency: f64, nm: f64| {
        let sin_r: f64 = 1e-3 * nm * frequency - sin_i;
        light.z + (1.0 - sin_r * sin_r).max(0.0).sqrt()
    };
    let most = seen.iter().map(|nm| range(*nm)[1]).fold(0.0, f64::max);
    let q = |nm: f64, w: f64| TAU * 1e3 / nm * w;
    let qs = seen.iter().flat_map(|nm| {
        let [a, b] = range(*nm);
        // If the mirror direction is between both ends, the maximum may be there.
        let top = if (1e-3 * nm * a - sin_i) * (1e-3 * nm * b - sin_i) < 0.0 { light.z + 1.0 } else { 0.0 };
        [q(*nm, w(a, *nm)), q(*nm, w(b, *nm)), q(*nm, top.max(w(a, *nm)))]
    });
    let [least, largest] = qs.fold([f64::INFINITY, 0.0_f64], |[a, b], v| [a.min(v), b.max(v)]);
    let request = Request {
        q: [least, largest],
        frequency: [most * cos_phi.abs(), most * sin_phi.abs()],
        length: most,
        densities: seen.len() as f64 * 1000.0,
    };
    let (model, choice) = prepare(field, quality, request, settings, progress)?;
    progress.stage("wavelengths", seen.len() as u64);
    let mirror = model.mirror();
    let peak = |memory: &mut Memory, nm: f64| -> Option<Peak> {
        let [low, high] = range(nm);
        let count = (((high - low) * PER_SIGMA / model.window.sigma).ceil() as usize).clamp(8, 100_000);
        let step = (high - low) / count as f64;
        let mut at = |f: f64| model.density([f * cos_phi, f * sin_phi], q(nm, w(f, nm)), memory);
        let line: Vec<f64> = (0..=count).map(|k| at(low + step * k as f64)).collect();
        let top = (1..count)
            .filter(|k| line[*k] >= line[*k - 1] && line[*k] > line[*k + 1])
            .max_by(|a, b| line[*a].total_cmp(&line[*b]))?;
        // The logarithm of a Gaussian is a parabola.
        let [a, b, c] = [line[top - 1], line[top], line[top + 1]].map(|v| v.max(1e-300).ln());
        let frequency = low + step * (top as f64 + 0.5 * (a - c) / (a - 2.0 * b + c));
        Some(Peak {
            wavelength_nm: nm,
            theta_r_deg: (1e-3 * nm * frequency - sin_i).asin().to_degrees(),
            period_nm: 1e3 / frequency,
            relative: line[top] / mirror,
        })
    };
    let found: Vec<Option<Peak>> = seen
        .par_iter()
        .map_init(Memory::default, |memory, nm| {
            progress.step();
            if progress.cancelled() { None } else { peak(memory, *nm) }
        })
        .collect();
    progress.check()?;
    let peaks: Vec<Peak> =
        found.into_iter().flatten().filter(|p| p.period_nm.is_finite() && p.relative > 0.0).collect();
    if peaks.is_empty() {
        let problem = format!("shows no peak near to a period of {period:.3} µm in the plane of {azimuth:.1}°");
        return Err(Error::input(&field.name, problem, "check --period-um and the light's azimuth"));
    }
    let count = peaks.len() as f64;
    let mean_nm = peaks.iter().map(|p| p.period_nm).sum::<f64>() / count;
    let variance_nm2 = peaks.iter().map(|p| (p.period_nm - mean_nm).powi(2)).sum::<f64>() / count;
    let ridges = ridges(&peaks);
    Ok(GratingCheck {
        peaks,
        expected_nm: 1e3 * period,
        mean_nm,
        variance_nm2,
        ridges,
        azimuth_deg: azimuth,
        cut_periods: None,
        warnings: quality.warnings.clone(),
        choice,
    })
}

/// Groups of periods that are less than 1 % apart from the next.
fn ridges(peaks: &[Peak]) -> Vec<[f64; 2]> {
    let mut all: Vec<f64> = peaks.iter().map(|p| p.period_nm).collect();
    all.sort_by(f64::total_cmp);
    let groups = all.chunk_by(|a, b| b - a < 0.01 * a);
    groups.map(|g| [g.iter().sum::<f64>() / g.len() as f64, g.len() as f64 / all.len() as f64]).collect()
}

#[cfg(test)]
#[path = "check_tests.rs"]
mod tests;

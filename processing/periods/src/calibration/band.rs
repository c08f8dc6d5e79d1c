//! Effective wavelength of a spectral band.

use nacre_base::{Error, Result};
use nacre_optics::color::Spectrum;
use schemars::JsonSchema;

/// Integration step in nm.
const STEP_NM: f64 = 0.25;

/// Standard deviation of a spectrometer's wavelength scale in nm.
const SCALE_NM: f64 = 0.5;

/// A spectral band.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, JsonSchema)]
pub struct Band {
    /// Mean wavelength in nm, weighted by the product of all spectra.
    pub mean_nm: f64,
    /// Standard deviation of the mean in nm: spectrometer scale, and the spectrum of an unmeasured lamp.
    pub sigma_nm: f64,
    /// Standard deviation of the light about the mean, in nm; it blurs each order.
    pub spread_nm: f64,
    /// Full width at half maximum in nm.
    pub fwhm_nm: f64,
}

/// Band of a lamp (if its spectrum is known) behind a filter, as seen by a camera, whichever of the two is known.
/// `None` without either.
///
/// # Errors
/// `Input` for a lamp alone, and as [`band`] does.
pub fn band_of(lamp: Option<Spectrum>, mut others: Vec<Spectrum>) -> Result<Option<Band>> {
    if others.is_empty() {
        let remedy =
            "give the filter's or the camera's spectrum with it (--filter, --response), or the wavelength itself";
        return lamp.map_or(Ok(None), |_| Err(Error::input("lamp", "alone has no narrow band", remedy)));
    }
    let known = lamp.is_some();
    others.extend(lamp);
    band(&others, known).map(Some)
}

/// Band of light transmitted by all of the spectra (lamp, filter, camera). `lamp_known` states whether the lamp is
/// among them. Otherwise it counts as white, and the shift by a tungsten lamp (2856 K) enters the uncertainty.
///
/// # Errors
/// `Input` without spectra, and if no light is transmitted.
pub fn band(spectra: &[Spectrum], lamp_known: bool) -> Result<Band> {
    let bad = |problem: &str| Error::input("spectra", problem, "give those of lamp, filter and camera as CSV files");
    let low = spectra.iter().map(|s| s.range_nm()[0]).fold(0.0, f64::max);
    let high = spectra.iter().map(|s| s.range_nm()[1]).fold(f64::MAX, f64::min);
    if spectra.is_empty() {
        return Err(bad("are missing"));
    }
    let count = ((high - low) / STEP_NM).ceil();
    if count.is_nan() || count < 1.0 {
        return Err(bad("have no wavelength in common"));
    }
    if count > 1e6 {
        return Err(bad("reach over more than 250000 nm"));
    }
    let step = (high - low) / count;
    let values: Vec<[f64; 2]> = (0..=count as usize)
        .map(|k| {
            let nm = (low + step * k as f64).min(high);
            // Trapezoidal rule: the end points have half weight.
            let end = if k == 0 || k == count as usize { 0.5 } else { 1.0 };
            [nm, end * spectra.iter().map(|s| s.at(nm)).product::<f64>()]
        })
        .collect();
    let mean = |weight: &dyn Fn(f64) -> f64| {
        let sum: f64 = values.iter().map(|[nm, v]| v * weight(*nm)).sum();
        (values.iter().map(|[nm, v]| nm * v * weight(*nm)).sum::<f64>() / sum, sum)
    };
    let (mean_nm, sum) = mean(&|_| 1.0);
    if !(sum > 0.0 && mean_nm.is_finite()) {
        return Err(bad("let no light pass together"));
    }
    let lamp = if lamp_known { 0.0 } else { mean(&tungsten).0 - mean_nm };
    let spread_nm = (values.iter().map(|[nm, v]| v * (nm - mean_nm).powi(2)).sum::<f64>() / sum).sqrt();
    let sigma_nm = SCALE_NM.hypot(lamp);
    Ok(Band { mean_nm, sigma_nm, spread_nm, fwhm_nm: width(&values) })
}

/// Planck's law at 2856 K, relative to 560 nm.
fn tungsten(nm: f64) -> f64 {
    let power = |nm: f64| nm.powi(-5) / ((1.438_776_877e7 / (nm * 2856.0)).exp() - 1.0);
    power(nm) / power(560.0)
}

/// Distance between the first and the last crossing of half the maximum.
fn width(values: &[[f64; 2]]) -> f64 {
    let half = 0.5 * values.iter().map(|v| v[1]).fold(0.0, f64::max);
    let inside = |v: &[f64; 2]| v[1] >= half;
    let (first, last) = (values.iter().position(inside), values.iter().rposition(inside));
    let (Some(first), Some(last)) = (first, last) else { return 0.0 };
    let crossing = |low: usize, high: usize| {
        let ([a, u], [b, v]) = (values[low], values[high]);
        a + (b - a) * (half - u) / (v - u)
    };
    let left = if first > 0 { crossing(first - 1, first) } else { values[first][0] };
    let right = if last + 1 < values.len() { crossing(last + 1, last) } else { values[last][0] };
    right - left
}

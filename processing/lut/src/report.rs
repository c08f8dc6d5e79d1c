//! `report.json` of a table.

use super::choose::Choice;
use super::light::LightReport;
use super::settings::Wavelength;
use nacre_frames::hdr;
use nacre_optics::color::Observer;
use serde::Serialize;

/// Result of making a table, in words and numbers.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Always `lut`.
    pub method: &'static str,
    /// What the reader must know before trusting the result. Empty when there is nothing.
    pub warnings: Vec<String>,
    /// What the table takes for granted, which no photograph tells; the errors below do not count it.
    pub assumptions: Vec<String>,
    /// Entries of a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Largest component of the half vector.
    pub extent: f64,
    /// Power of the warp.
    pub warp: i32,
    /// Wavelength of the photograph in nm.
    pub wavelength_nm: Wavelength,
    /// Light.
    pub illuminant: String,
    /// Observer.
    pub observer: Observer,
    /// Power of λm/λ.
    pub exponent: f64,
    /// Half vector per pixel of the photograph (of the resampled one where a geometry was given).
    pub scale: f64,
    /// Place of the zero order in pixels from the left and the top of the photograph (of the resampled one's original).
    pub center: [f64; 2],
    /// Standard deviation of that, or how far a given place is from the lobe around it.
    pub center_sigma_px: Option<f64>,
    /// How entries were added up, and why so.
    pub choice: Choice,
    /// All errors that are known together: root mean square of Y at the rim (a half vector's component above 0.6 of the extent), over
    /// the table's own there.
    pub error_estimate: Option<f64>,
    /// Its part of adding up: sums against finer sums of the same photograph, at the rim or of all, whichever is worse.
    pub sum_error: Option<f64>,
    /// Its part of the photograph between its pixels: those are too coarse for what is sharper, and noise is.
    pub sampling_error: Option<f64>,
    /// Its part of what is not known of the zero order's place.
    pub center_error: Option<f64>,
    /// The light's shape, where its photograph was given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light: Option<LightReport>,
    /// How far the filter's band spreads an order at the rim, full width at half maximum in pixels of the photograph.
    pub band_px: Option<f64>,
    /// What was covered.
    pub coverage: Coverage,
    /// How the exposures were merged, when that was done first.
    pub merged: Option<hdr::Report>,
    /// Seconds spent.
    pub seconds: Seconds,
}

/// How much of the table was measured: parts of its entries.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Coverage {
    /// Mean over all entries.
    pub mean: f64,
    /// Entries of which all was measured (99 %).
    pub full: f64,
    /// Entries of which next to nothing was measured (1 %): NaN.
    pub none: f64,
}

/// What took how long.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Seconds {
    /// Reading, and merging exposures.
    pub read: f64,
    /// Adding up.
    pub table: f64,
    /// Writing.
    pub write: f64,
    /// Everything.
    pub total: f64,
}

//! `report.json` of a table.

use super::choose::Choice;
use super::light::LightReport;
use super::settings::Wavelength;
use nacre_base::operation::{Summary, lines};
use nacre_frames::hdr;
use nacre_optics::color::Observer;
use schemars::JsonSchema;
use serde::Serialize;
use std::fmt::Write;

/// Result of a lookup-table reconstruction.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "LutReport")]
pub struct Report {
    /// Always `lut`.
    pub method: &'static str,
    /// Limitations of the result; empty if none is known.
    pub warnings: Vec<String>,
    /// Unverifiable assumptions; the errors below do not include their effect.
    pub assumptions: Vec<String>,
    /// Width of the table in entries.
    pub width: usize,
    /// Height of the table in entries.
    pub height: usize,
    /// Largest component of the half vector.
    pub extent: f64,
    /// Exponent of the warp.
    pub warp: i32,
    /// Wavelength of the photograph in nm.
    pub wavelength_nm: Wavelength,
    /// Illuminant.
    pub illuminant: String,
    /// Standard observer.
    pub observer: Observer,
    /// Exponent of λm/λ.
    pub exponent: f64,
    /// Half vector per pixel of the photograph, or of the resampled photograph if a geometry was given.
    pub scale: f64,
    /// Position of the zero order in pixels from the left and the top of the photograph, before resampling.
    pub center: [f64; 2],
    /// Standard deviation of `center` in pixels, or the distance between a given position and the nearby lobe.
    pub center_sigma_px: Option<f64>,
    /// Summation method and the reason for it.
    pub choice: Choice,
    /// Combined error: root mean square of Y at the rim (a half-vector component above 0.6 of the extent), relative to
    /// the table's root mean square there.
    pub error_estimate: Option<f64>,
    /// Summation error: sums against finer sums of the same photograph, at the rim or anywhere, whichever is larger.
    pub sum_error: Option<f64>,
    /// Interpolation error between the photograph's pixels, from structure finer than a pixel and from noise.
    pub sampling_error: Option<f64>,
    /// Error due to the uncertainty of the zero order's position.
    pub center_error: Option<f64>,
    /// Properties of the extended source, if its photograph was given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light: Option<LightReport>,
    /// Blur of an order at the rim due to the filter's bandwidth: full width at half maximum in pixels of the
    /// photograph.
    pub band_px: Option<f64>,
    /// Coverage of the entries.
    pub coverage: Coverage,
    /// Report on merging the exposures, if any.
    pub merged: Option<hdr::Report>,
    /// Computation times.
    pub seconds: Seconds,
}

/// Coverage of the table, as fractions of its entries.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Coverage {
    /// Mean coverage of all entries.
    pub mean: f64,
    /// Fraction of complete entries (coverage above 0.99).
    pub full: f64,
    /// Fraction of unknown entries (coverage below 0.01), which are NaN.
    pub none: f64,
}

/// Computation times in seconds.
#[derive(Clone, Copy, Debug, Default, Serialize, JsonSchema)]
#[schemars(rename = "LutSeconds")]
pub struct Seconds {
    /// Reading, and merging of exposures.
    pub read: f64,
    /// Summation.
    pub table: f64,
    /// Writing.
    pub write: f64,
    /// Total.
    pub total: f64,
}

impl Summary for Report {
    fn summary(&self) -> String {
        let size = self.width;
        let mut text = format!("table     {size} × {size} half vectors from -{0} to {0}", self.extent);
        let _ = writeln!(text, "{}", if self.warp > 1 { format!(", warped by {}", self.warp) } else { String::new() });
        let nm = match self.wavelength_nm {
            Wavelength::Band(nm) => format!("{nm} nm"),
            Wavelength::Channels([r, g, b]) => format!("{r}, {g} and {b} nm"),
        };
        let observer = match self.observer {
            Observer::Cie1931 => "1931",
            Observer::Cie1964 => "1964",
        };
        let _ = writeln!(text, "light     {nm} photographed, {} seen by CIE {observer}", self.illuminant);
        let [x, y] = self.center;
        let sigma = self.center_sigma_px.map_or("unknown".into(), |s| format!("{s:.2}"));
        let _ = writeln!(text, "centre    {x:.2}, {y:.2} (± {sigma} pixels), {:.6} half vectors per pixel", self.scale);
        if let Some(l) = &self.light {
            let _ = writeln!(
                text,
                "shape     {} pixels of light, {:.4} half vectors from their middle (RMS)",
                l.pixels, l.spread
            );
        }
        let c = &self.choice;
        let step =
            c.spacing_px.map(|s| format!("{s} pixels")).or(c.step_nm.map(|s| format!("{s} nm"))).unwrap_or_default();
        let _ = writeln!(text, "method    {} in steps of {step}: {}", c.method, c.why);
        let percent = |v: Option<f64>| v.map_or("unknown".into(), |v| format!("{:.2} %", 100.0 * v));
        let _ = writeln!(
            text,
            "quality   error at the rim {} (adding up, measured: {}; expected: zero order's place {}, between pixels {})",
            percent(self.error_estimate),
            percent(self.sum_error),
            percent(self.center_error),
            percent(self.sampling_error)
        );
        let coverage = &self.coverage;
        let _ = writeln!(
            text,
            "coverage  {:.1} % of the entries whole, {:.1} % not at all",
            100.0 * coverage.full,
            100.0 * coverage.none
        );
        text += &lines(&self.assumptions, &self.warnings);
        let s = &self.seconds;
        let _ = write!(
            text,
            "time      {:.2} s: reading {:.2}, table {:.2}, writing {:.2}",
            s.total, s.read, s.table, s.write
        );
        text
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

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

/// Result of making a table, in words and numbers.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "LutReport")]
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
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Coverage {
    /// Mean over all entries.
    pub mean: f64,
    /// Entries of which all was measured (99 %).
    pub full: f64,
    /// Entries of which next to nothing was measured (1 %): NaN.
    pub none: f64,
}

/// What took how long.
#[derive(Clone, Copy, Debug, Default, Serialize, JsonSchema)]
#[schemars(rename = "LutSeconds")]
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

//! `report.json` of a spot scan.

use super::response::Response;
use nacre_base::operation::{Summary, lines};
use nacre_image::Palette;
use schemars::JsonSchema;
use serde::Serialize;
use std::fmt::Write;

/// Result of a spot scan, in words and numbers.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "SpotsReport")]
pub struct Report {
    /// Always `spots`.
    pub method: &'static str,
    /// What the reader must know before trusting the result. Empty when there is nothing.
    pub warnings: Vec<String>,
    /// What is taken for granted.
    pub assumptions: Vec<String>,
    /// Colours of angles in pictures.
    pub palette: Palette,
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Different fringes.
    pub fringes: usize,
    /// Frames of fringes and of even light that were used.
    pub patterns: usize,
    /// Effective wavelength in nm.
    pub wavelength_nm: f64,
    /// Periods that were looked for, in µm.
    pub periods_um: [f64; 2],
    /// Period below which no first order reaches the panel from the sample's middle, for grating vectors at 0, 15, … 165 degrees, in µm;
    /// none where none ever does.
    pub shortest_um: Vec<Option<f64>>,
    /// What became of the pixels.
    pub pixels: Counts,
    /// Median σ of the orientation in degrees.
    pub orientation_sigma_deg: Option<f64>,
    /// Median σ of the period over the period, common errors left out.
    pub period_sigma: Option<f64>,
    /// σ that all periods have in common, over the period: wavelength and geometry.
    pub period_scale_sigma: f64,
    /// σ that all orientations have in common, in degrees: geometry. Both are in the maps' σ.
    pub orientation_common_sigma_deg: f64,
    /// Median over the pixels of how far the mirror direction is from where the geometry puts it, in degrees right and up: a wrong
    /// geometry, or a tilted sample.
    pub mirror_offset_deg: Option<[f64; 2]>,
    /// Median mean square residual in σ.
    pub residual: Option<f64>,
    /// Diameter of the aperture that was found or given, in mm.
    pub aperture_mm: f64,
    /// How the panel answers.
    pub response: Response,
    /// What photographs of discs did, where there are at least four.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub discs: Option<super::discs::Told>,
    /// What the map of polarization did, where one was given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub polarization: Option<super::polarization::Helped>,
    /// Seconds spent.
    pub seconds: Seconds,
}

/// Pixels by what became of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Counts {
    /// Period and orientation are known.
    pub resolved: usize,
    /// Saturated, or no number.
    pub unusable: usize,
    /// No light that follows the fringes.
    pub dark: usize,
    /// Mirrored light only: first orders too weak, or out of reach.
    pub no_order: usize,
    /// Light that no single grating explains.
    pub unexplained: usize,
    /// Two gratings explain it.
    pub ambiguous: usize,
}

/// What took how long.
#[derive(Clone, Copy, Debug, Default, Serialize, JsonSchema)]
#[schemars(rename = "SpotsSeconds")]
pub struct Seconds {
    /// Reading and demodulating.
    pub read: f64,
    /// Finding the aperture.
    pub calibrate: f64,
    /// Finding orders.
    pub solve: f64,
    /// Writing.
    pub write: f64,
    /// Everything.
    pub total: f64,
}

impl Summary for Report {
    fn summary(&self) -> String {
        let all = (self.width * self.height).max(1) as f64;
        let p = &self.pixels;
        let part = |n: usize| format!("{:.1} %", 100.0 * n as f64 / all);
        let mut text = format!(
            "pixels    {} × {}: {} resolved, {} without orders in reach, {} of no single grating, {} ambiguous, {} dark, {} unusable\n",
            self.width,
            self.height,
            part(p.resolved),
            part(p.no_order),
            part(p.unexplained),
            part(p.ambiguous),
            part(p.dark),
            part(p.unusable)
        );
        let _ = writeln!(
            text,
            "light     {} patterns, {} different fringes, {} nm",
            self.patterns, self.fringes, self.wavelength_nm
        );
        let said = |value: Option<f64>, factor: f64| value.map_or("unknown".into(), |v| format!("{:.3}", factor * v));
        let _ = writeln!(
            text,
            "quality   median σ {}° of orientation, {} % of period, and {:.2} % that all periods share; residual {}",
            said(self.orientation_sigma_deg, 1.0),
            said(self.period_sigma, 100.0),
            100.0 * self.period_scale_sigma,
            said(self.residual, 1.0)
        );
        if let Some([x, y]) = self.mirror_offset_deg {
            let _ = writeln!(
                text,
                "mirror    {x:.3}°, {y:.3}° from where the geometry puts it; aperture {:.1} mm",
                self.aperture_mm
            );
        }
        let _ = writeln!(text, "panel     exponent {:.3} of the assumed one", self.response.power);
        if let Some(d) = &self.discs {
            let said = d.residual.map_or("unknown".into(), |r| format!("{r:.2}"));
            let _ = writeln!(
                text,
                "discs     {} photographs, {} pixels decided, {} contradicted; residual {said}",
                d.discs, d.decided, d.contradicted
            );
        }
        if let Some(h) = &self.polarization {
            let _ = writeln!(
                text,
                "polarized offset {:.2}° (spread {:.2}° over {} pixels), {} decided, {} contradicted",
                h.offset_deg, h.spread_deg, h.shared, h.decided, h.contradicted
            );
        }
        text += &lines(&self.assumptions, &self.warnings);
        let s = &self.seconds;
        let _ = write!(
            text,
            "time      {:.2} s: reading {:.2}, aperture {:.2}, orders {:.2}, writing {:.2}",
            s.total, s.read, s.calibrate, s.solve, s.write
        );
        text
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

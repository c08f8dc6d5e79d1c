//! `report.json` of the fringe reconstruction.

use super::response::Response;
use nacre_base::operation::{Summary, lines};
use nacre_image::Palette;
use schemars::JsonSchema;
use serde::Serialize;
use std::fmt::Write;

/// Result of a fringe reconstruction.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "SpotsReport")]
pub struct Report {
    /// Always `spots`.
    pub method: &'static str,
    /// Limitations of the result; empty if none is known.
    pub warnings: Vec<String>,
    /// Unverified assumptions.
    pub assumptions: Vec<String>,
    /// Colour map of angles in pictures.
    pub palette: Palette,
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Number of different fringes.
    pub fringes: usize,
    /// Number of frames with fringes or uniform light.
    pub patterns: usize,
    /// Effective wavelength in nm.
    pub wavelength_nm: f64,
    /// Searched range of periods in µm.
    pub periods_um: [f64; 2],
    /// Shortest period in µm whose first order reaches the panel from the sample's centre, for grating vectors at 0,
    /// 15, … 165 degrees; `None` where none does.
    pub shortest_um: Vec<Option<f64>>,
    /// Number of pixels by classification.
    pub pixels: Counts,
    /// Median σ of the orientation in degrees.
    pub orientation_sigma_deg: Option<f64>,
    /// Median relative σ of the period, without common errors.
    pub period_sigma: Option<f64>,
    /// Relative σ common to all periods, from wavelength and geometry.
    pub period_scale_sigma: f64,
    /// Standard deviation common to all orientations, in degrees, from the geometry. The maps' σ include both common
    /// errors.
    pub orientation_common_sigma_deg: f64,
    /// Median deviation of the mirror direction from that of the geometry, in degrees to the right and upwards.
    /// Indicates a wrong geometry or a tilted sample.
    pub mirror_offset_deg: Option<[f64; 2]>,
    /// Median reduced χ².
    pub residual: Option<f64>,
    /// Pixels with the largest reduced χ² among those resolved, at most ten, largest first.
    pub worst: Vec<PixelResidual>,
    /// Estimated or given diameter of the aperture in mm.
    pub aperture_mm: f64,
    /// Response of the panel.
    pub response: Response,
    /// Effect of disc photographs, if there are at least four.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub discs: Option<super::discs::DiscVerification>,
    /// Effect of the polarization map, if given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub polarization: Option<super::polarization::PolarizationVerification>,
    /// Computation times.
    pub seconds: Seconds,
}

/// Residual of a pixel.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct PixelResidual {
    /// Column, from the left.
    pub x: usize,
    /// Row, from the top.
    pub y: usize,
    /// Reduced χ².
    pub residual: f64,
}

/// Number of pixels by classification.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Counts {
    /// Period and orientation are determined.
    pub resolved: usize,
    /// Saturated, or not a number.
    pub unusable: usize,
    /// No light that follows the fringes.
    pub dark: usize,
    /// Mirrored light only: first orders are too weak or out of reach.
    pub no_order: usize,
    /// No single grating explains the light.
    pub unexplained: usize,
    /// Two gratings explain the light.
    pub ambiguous: usize,
}

/// Computation times in seconds.
#[derive(Clone, Copy, Debug, Default, Serialize, JsonSchema)]
#[schemars(rename = "SpotsSeconds")]
pub struct Seconds {
    /// Reading and demodulation.
    pub read: f64,
    /// Estimation of the aperture.
    pub calibrate: f64,
    /// Identification of the orders.
    pub solve: f64,
    /// Writing.
    pub write: f64,
    /// Total.
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
        let formatted =
            |value: Option<f64>, factor: f64| value.map_or("unknown".into(), |v| format!("{:.3}", factor * v));
        let _ = writeln!(
            text,
            "quality   median σ {}° of orientation, {} % of period, and {:.2} % that all periods share; residual {}",
            formatted(self.orientation_sigma_deg, 1.0),
            formatted(self.period_sigma, 100.0),
            100.0 * self.period_scale_sigma,
            formatted(self.residual, 1.0)
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
            let formatted = d.residual.map_or("unknown".into(), |r| format!("{r:.2}"));
            let _ = writeln!(
                text,
                "discs     {} photographs, {} pixels decided, {} contradicted; residual {formatted}",
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

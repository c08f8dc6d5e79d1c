//! `report.json` of a bokeh photograph.

use super::deconvolution::Noise;
use super::height::Calibration;
use super::lens::Cutoff;
use super::period::Lines;
use super::photograph::{Crop, Light};
use super::slice::Line;
use super::slits::Slits;
use nacre_base::operation::{Summary, lines};
use nacre_frames::hdr;
use schemars::JsonSchema;
use serde::Serialize;
use std::fmt::Write;

/// Results of a bokeh reconstruction.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "BokehReport")]
pub struct Report {
    /// Always `bokeh`.
    pub method: &'static str,
    /// Limitations of the result; empty if none is known.
    pub warnings: Vec<String>,
    /// Description of the photograph.
    pub photograph: String,
    /// Channel of the photograph.
    pub channel: Light,
    /// Region of the photograph; `None` for all of it.
    pub crop: Option<Crop>,
    /// Rotation of the result in degrees, anticlockwise.
    pub rotate_deg: f64,
    /// Width of the result in pixels.
    pub width: usize,
    /// Height of the result in pixels.
    pub height: usize,
    /// Report on merging, for a series of exposures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub merged: Option<hdr::Report>,
    /// Number of saturated or unknown pixels in the region; their light is extrapolated from their surroundings.
    pub unknown_pixels: usize,
    /// Point spread function: `Gaussian, σ 2.5 px`, or its file.
    pub psf: String,
    /// Convergence of the deconvolution.
    pub deconvolution: Deconvolution,
    /// Pixel size on the sample.
    pub scale: Scale,
    /// Resolution limits of the lens; `None` without lens data.
    pub cutoff: Option<Cutoff>,
    /// Position of the slice.
    pub slice: SliceReport,
    /// Lines along the slice; `None` if no period is significant.
    pub lines: Option<LinesReport>,
    /// Slits fitted to the slice through the photograph before deconvolution; `None` if the fit fails.
    pub slits: Option<SlitsReport>,
    /// Height scale.
    pub heights: Heights,
    /// Computation times.
    pub seconds: Seconds,
}

/// Convergence of the deconvolution.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Deconvolution {
    /// Number of iterations.
    pub iterations: usize,
    /// True if the stopping rule chose the number.
    pub auto: bool,
    /// True if the stopping rule ended the iterations; always true for a fixed number.
    pub converged: bool,
    /// True if the iterations were accelerated.
    pub accelerated: bool,
    /// Noise model: variance `shot · v + floor` of light `v` (white is 1); `None` with too few known pixels.
    pub noise: Option<NoiseReport>,
    /// Mean squared residual over noise variance, before the last iteration.
    pub misfit: Option<f64>,
    /// Expected value of `misfit` for pure noise.
    pub expected: Option<f64>,
}

/// Noise model and its source.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
#[schemars(rename = "BokehNoiseReport")]
pub struct NoiseReport {
    /// Variance per unit of light.
    pub shot: f64,
    /// Variance at zero light.
    pub floor: f64,
    /// `given`, or `estimated` from the photograph.
    pub source: &'static str,
}

impl NoiseReport {
    pub(super) fn new(noise: Noise, given: bool) -> Self {
        Self { shot: noise.shot, floor: noise.floor, source: if given { "given" } else { "estimated" } }
    }
}

/// Pixel size on the sample.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Scale {
    /// Pixel size in µm; `None` if unknown.
    pub pixel_um: Option<f64>,
    /// Standard deviation of the pixel size in µm, from counted lines.
    pub sigma_um: Option<f64>,
    /// Source of the pixel size: `given`, `counted lines` or `unknown`.
    pub source: &'static str,
}

/// Position of the slice.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct SliceReport {
    /// End points in pixels of the result.
    pub line: Line,
    /// Width in pixels over which each sample is averaged.
    pub width_px: usize,
    /// Angle in degrees from the slice to the grating vector, anticlockwise.
    pub tilt_deg: f64,
}

/// Lines along the slice.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct LinesReport {
    /// Period and phase in pixels.
    #[serde(flatten)]
    pub lines: Lines,
    /// Period across the lines in µm, if the pixel size is known.
    pub period_um: Option<f64>,
}

/// Slits along the slice.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct SlitsReport {
    /// Fitted parameters in pixels.
    #[serde(flatten)]
    pub slits: Slits,
    /// Spacing across the slits in µm and its standard deviation, if the pixel size is known.
    pub spacing_um: Option<[f64; 2]>,
    /// Slit width in µm and its standard deviation, if the pixel size is known.
    pub width_um: Option<[f64; 2]>,
}

/// Height scale.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Heights {
    /// `µm`, or `relative`: 0 and 1 are the 0.1 % and 99.9 % quantiles of the light.
    pub unit: &'static str,
    /// Mean light of the result, to which a calibration refers.
    pub mean_light: f64,
    /// Calibration that was used or made.
    pub calibration: Option<Calibration>,
}

/// Computation times in seconds.
#[derive(Clone, Copy, Debug, Default, Serialize, JsonSchema)]
#[schemars(rename = "BokehSeconds")]
pub struct Seconds {
    /// Reading.
    pub read: f64,
    /// Deconvolution.
    pub deconvolve: f64,
    /// Total.
    pub total: f64,
}

impl Summary for Report {
    fn summary(&self) -> String {
        let found = &self.deconvolution;
        let mut text = format!("result    {} × {} pixels, {}\n", self.width, self.height, self.psf);
        let why = match (found.auto, found.converged) {
            (true, true) => "stopped before the noise",
            (true, false) => "the most allowed",
            (false, _) => "as asked for",
        };
        let _ = writeln!(text, "sharpened {} iterations, {why}", found.iterations);
        if let Some(noise) = found.noise {
            let _ =
                writeln!(text, "noise     variance {:.2e} · light + {:.2e}, {}", noise.shot, noise.floor, noise.source);
        }
        if let Some(um) = self.scale.pixel_um {
            let sigma = self.scale.sigma_um.map_or(String::new(), |s| format!(" ± {s:.5}"));
            let _ = writeln!(text, "scale     {um:.5}{sigma} µm per pixel, {}", self.scale.source);
        }
        match self.cutoff {
            Some(c) => {
                let _ = writeln!(text, "cut-off   {:.2} µm (λ / (2 NA), NA {:.4})", c.period_um, c.numerical_aperture);
            }
            None => text.push_str("cut-off   unknown\n"),
        }
        if let Some(l) = self.lines {
            let um = l.period_um.map_or(String::new(), |um| format!(", {um:.3} µm across them"));
            let [px, sigma] = l.lines.period_px;
            let _ = writeln!(text, "lines     {:.1} along the slice, {px:.3} ± {sigma:.3} px apart{um}", l.lines.count);
        }
        if let Some(s) = self.slits {
            let ([spacing, s_sigma], [width, w_sigma]) = (s.slits.spacing_px, s.slits.width_px);
            let _ = writeln!(
                text,
                "slits     {} lit, {width:.3} ± {w_sigma:.3} px wide, {spacing:.3} ± {s_sigma:.3} px apart",
                s.slits.count
            );
        }
        if let Some(c) = &self.heights.calibration {
            let rmse = c.rmse_um.map_or(String::new(), |r| format!(", known profile off by {r:.4} µm RMS"));
            let _ = writeln!(text, "height    {:.4} µm · (light / mean - {:.4}){rmse}", c.gain_um, c.offset);
        }
        text += &lines(&[], &self.warnings);
        let s = &self.seconds;
        let _ = write!(text, "time      {:.2} s: reading {:.2}, deconvolving {:.2}", s.total, s.read, s.deconvolve);
        text
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

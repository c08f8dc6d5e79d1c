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

/// Result, in words and numbers.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "BokehReport")]
pub struct Report {
    /// Always `bokeh`.
    pub method: &'static str,
    /// What the reader must know before trusting the result. Empty when there is nothing.
    pub warnings: Vec<String>,
    /// The photograph.
    pub photograph: String,
    /// The light that was taken.
    pub channel: Light,
    /// Part of the photograph that was taken.
    pub crop: Option<Crop>,
    /// By how much the result was turned, anticlockwise.
    pub rotate_deg: f64,
    /// Pixels of a row of the result.
    pub width: usize,
    /// Its rows.
    pub height: usize,
    /// How exposures were merged, where the photograph was made of some.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub merged: Option<hdr::Report>,
    /// Pixels of the part that were saturated or not known; their light is a guess from around them.
    pub unknown_pixels: usize,
    /// The point spread function: `Gaussian, σ 2.5 px` or its file.
    pub psf: String,
    /// The deconvolution.
    pub deconvolution: Deconvolution,
    /// Size of a pixel on the sample.
    pub scale: Scale,
    /// What the lens lets through; none where the lens was not told.
    pub cutoff: Option<Cutoff>,
    /// The slice.
    pub slice: SliceReport,
    /// Lines along the slice; none where there are none.
    pub lines: Option<LinesReport>,
    /// The slice through the photograph, before deconvolution, as a row of slits; none where that comes to nothing.
    pub slits: Option<SlitsReport>,
    /// Heights.
    pub heights: Heights,
    /// Seconds spent.
    pub seconds: Seconds,
}

/// How the deconvolution went.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Deconvolution {
    /// Iterations that were done.
    pub iterations: usize,
    /// Whether the number was chosen from the noise.
    pub auto: bool,
    /// Whether they ended because another one would have fitted more noise than structure; true for a number that was asked for.
    pub converged: bool,
    /// Whether they were accelerated.
    pub accelerated: bool,
    /// Variance of the noise of light `v` (white is 1): `shot · v + floor`; none where too little is known.
    pub noise: Option<NoiseReport>,
    /// Mean squared misfit over the variance of the noise, before the last iteration.
    pub misfit: Option<f64>,
    /// What noise alone would leave of it.
    pub expected: Option<f64>,
}

/// Noise and where it comes from.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
#[schemars(rename = "BokehNoiseReport")]
pub struct NoiseReport {
    /// Variance per unit of light.
    pub shot: f64,
    /// Variance in the dark.
    pub floor: f64,
    /// `given`, or `estimated` from the photograph.
    pub source: &'static str,
}

impl NoiseReport {
    pub(super) fn new(noise: Noise, given: bool) -> Self {
        Self { shot: noise.shot, floor: noise.floor, source: if given { "given" } else { "estimated" } }
    }
}

/// Size of a pixel on the sample.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct Scale {
    /// In µm; none where nobody knows.
    pub pixel_um: Option<f64>,
    /// Its standard deviation, from counting lines.
    pub sigma_um: Option<f64>,
    /// `given`, `counted lines` or `unknown`.
    pub source: &'static str,
}

/// Where the slice is.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct SliceReport {
    /// From and to, in pixels of the result.
    pub line: Line,
    /// Pixels across that each sample is the mean of.
    pub width_px: usize,
    /// Angle from the slice to the direction across the lines, anticlockwise.
    pub tilt_deg: f64,
}

/// Lines along the slice.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct LinesReport {
    /// In pixels.
    #[serde(flatten)]
    pub lines: Lines,
    /// Distance of two lines across them, in µm, where a pixel's size is known.
    pub period_um: Option<f64>,
}

/// Slits.
#[derive(Clone, Copy, Debug, Serialize, JsonSchema)]
pub struct SlitsReport {
    /// In pixels.
    #[serde(flatten)]
    pub slits: Slits,
    /// Spacing and width across the slits, in µm, where a pixel's size is known.
    pub spacing_um: Option<[f64; 2]>,
    /// See `spacing_um`.
    pub width_um: Option<[f64; 2]>,
}

/// What heights are.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct Heights {
    /// `µm`, or `relative`: 0 for light that 0.1 % of the pixels are below, 1 for light that 0.1 % are above.
    pub unit: &'static str,
    /// Mean light of the result, which a calibration relates to.
    pub mean_light: f64,
    /// The calibration that was used or made.
    pub calibration: Option<Calibration>,
}

/// What took how long.
#[derive(Clone, Copy, Debug, Default, Serialize, JsonSchema)]
#[schemars(rename = "BokehSeconds")]
pub struct Seconds {
    /// Reading.
    pub read: f64,
    /// Deconvolving.
    pub deconvolve: f64,
    /// Everything.
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

//! Report of a factorisation.

use super::{Factors, Kind, SEPARABLE};
use crate::environment::Table;
use nacre_base::operation::{Summary, lines};
use schemars::JsonSchema;
use serde::Serialize;
use std::fmt::Write;

/// One straightened part.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct PartReport {
    /// Directions across and along the meridian in degrees, anticlockwise from the table's right.
    pub directions_deg: [f64; 2],
    /// Terms of each channel.
    pub rank: usize,
    /// Residual norm of red, green and blue, relative to the part's norm.
    pub error: [f64; 3],
    /// Largest singular values of green, relative to the first.
    pub singular_values: Vec<f64>,
    /// Files of the curves.
    pub files: [String; 2],
}

/// Report of `nacre factor`.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[schemars(rename = "FactorReport")]
pub struct Report {
    /// `low-rank`.
    pub method: &'static str,
    /// Kind of factorisation.
    pub kind: Kind,
    /// Entries along a side of the table.
    pub size: usize,
    /// Largest half-vector component.
    pub extent: f64,
    /// Main directions in degrees, the brightest first.
    pub directions_deg: Vec<f64>,
    /// Maximum over median of the light along lines through the zero order; below 1.3 a pattern has no main direction.
    pub contrast: f64,
    /// `two directions`, `one direction`, `radial` or `three directions or more`.
    pub pattern: &'static str,
    /// The parts, whose sum is the table.
    pub parts: Vec<PartReport>,
    /// Norm of the residual after all written terms, relative to the table's norm.
    pub error: f64,
    /// Largest error of a picture: root mean square over all directions, relative to its mean. A single point source
    /// has this error; environments have a smaller one.
    pub picture_error_point: f64,
    /// Error of a picture in the given environment.
    pub picture_error: Option<f64>,
    /// Most negative radiance in that environment, relative to the largest; it is clamped to 0.
    pub negative: Option<f64>,
    /// Whether the rank is low enough that two passes are the fastest method.
    pub separable: bool,
    /// Recommended method of environment lighting for this table.
    pub advice: String,
    /// Limits of the result.
    pub warnings: Vec<String>,
    /// Assumptions.
    pub assumptions: Vec<String>,
    /// Computing time in s.
    pub seconds: f64,
}

impl Summary for Report {
    fn summary(&self) -> String {
        let mut text = format!("pattern   {}, contrast {:.1}", self.pattern, self.contrast);
        for part in &self.parts {
            let [across, along] = part.directions_deg;
            let _ = write!(text, "\npart      {} terms along {across:.1}° and {along:.1}°", part.rank);
        }
        let [error, picture] = [self.error, self.picture_error_point].map(|e| 100.0 * e);
        let _ = write!(
            text,
            "\nerror     {error:.2} % of the table (measured on the written terms), at most {picture:.1} % of a picture (a single point light)"
        );
        if let Some(error) = self.picture_error {
            let _ = write!(text, "\npicture   {:.2} % in this environment", 100.0 * error);
        }
        let _ = write!(text, "\nmethod    {}\n{}", self.advice, lines(&[], &self.warnings));
        text + &format!("time      {:.2} s", self.seconds)
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

impl Factors {
    /// Norm of the residual after all written terms, relative to the table's norm.
    pub fn error(&self) -> f64 {
        (self.measured.left_out / self.measured.whole.max(f64::MIN_POSITIVE)).sqrt()
    }

    /// Normalised root mean square error of a picture of a single point source. No environment has a larger one
    /// (Young's inequality: the norm of a convolution is at most the norm of one factor times the L1 norm of the
    /// other).
    pub fn picture_error_point(&self) -> f64 {
        let light: f64 = self.parts.iter().flat_map(|p| p.albedo).sum();
        // Over three channels and a light of flux 1: rms² = ∫ D² dω / (3 · 4π), mean = Σ albedo / (3 · 4π).
        let sphere = 3.0 * 4.0 * std::f64::consts::PI;
        (self.measured.left_out / sphere).sqrt() / (light / sphere).max(f64::MIN_POSITIVE)
    }

    /// The report without the measured errors.
    pub(in crate::environment) fn report(&self, table: &Table, kind: Kind) -> Report {
        let degrees = |v: f64| v.to_degrees().rem_euclid(180.0);
        let parts: Vec<PartReport> = self
            .parts
            .iter()
            .zip(&self.rank)
            .enumerate()
            .map(|(k, (part, rank))| PartReport {
                directions_deg: [part.grid.across(), part.grid.meridian].map(degrees),
                rank: *rank,
                error: [0, 1, 2].map(|c| part.left_out(c, *rank) / part.norm[c].max(f64::MIN_POSITIVE)),
                singular_values: part.channels[1].iter().map(|t| t.sigma / part.channels[1][0].sigma).collect(),
                files: ["across", "along"].map(|name| format!("part-{}-{name}.exr", k + 1)),
            })
            .collect();
        let pattern = match self.pattern.main.len() {
            0 => "radial",
            1 => "one direction",
            2 => "two directions",
            _ => "three directions or more",
        };
        let mut warnings = vec![];
        if table.unknown > 0.0 {
            warnings.push(format!("{:.1} % of the entries were not measured and count as dark", 100.0 * table.unknown));
        }
        let terms: usize = self.rank.iter().sum();
        if terms > SEPARABLE {
            warnings.push(format!("the table does not separate: {terms} terms, {:.3} left out", self.error()));
        }
        if let Some(wanted) = self.wanted.filter(|_| self.missed()) {
            let [found, wanted] = [self.error(), wanted].map(|e| 100.0 * e);
            warnings.push(format!("the error of the table is {found:.1} %, more than the {wanted} % asked for"));
        }
        Report {
            method: "low-rank",
            kind,
            size: table.size,
            extent: table.extent,
            directions_deg: self.pattern.main.iter().copied().map(degrees).collect(),
            contrast: self.pattern.contrast,
            pattern,
            parts,
            error: self.error(),
            picture_error_point: self.picture_error_point(),
            picture_error: None,
            negative: None,
            separable: self.separable(),
            advice: self.advice(pattern, kind),
            warnings,
            assumptions: vec![
                "surfaces face the viewer: n = ωo = r (2017 CVMP, section 3.2); at grazing angles this does not hold".into(),
                "4π² F² is in the table; (1 + ωi·ωo)² and the Jacobian 1/cos θi were folded in before the factorisation".into(),
            ],
            seconds: 0.0,
        }
    }

    fn advice(&self, pattern: &str, kind: Kind) -> String {
        if self.separable() {
            return "two passes".into();
        }
        if kind == Kind::Line {
            return "--kind singular, or the exact sum along azimuths: the table is no line".into();
        }
        match pattern {
            "radial" => "the exact sum along azimuths, or for a flat sample the exact correlation: a radial pattern has no directions",
            "two directions" => "the exact sum along azimuths, or a larger --max-error: the pattern is too fine for few terms",
            "one direction" => "--kind line for a grating, or the exact sum along azimuths",
            _ => "--parts with as many parts as directions, or the exact sum along azimuths",
        }
        .into()
    }
}

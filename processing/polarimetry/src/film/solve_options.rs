//! Options of a solution.

use crate::Model;
use crate::film::camera_position::{CameraPosition, Oblique};
use crate::film::curve::Source;
use nacre_optics::polarization::Material;

/// Model, corrections and sample size of a solution.
pub struct SolveOptions {
    /// Model of the points (S1/S0, S2/S0).
    pub model: Model,
    /// Offset added to every orientation, in rad.
    pub offset: f64,
    /// Camera geometry, if the photographs contain it, and sample material.
    pub camera: Option<(CameraPosition, Material)>,
    /// Correction of oblique incidence.
    pub oblique: Oblique,
    /// Standard deviation of the analyser-angle errors in rad, if known.
    pub angle_sigma: f64,
    /// Light of the display.
    pub source: Source,
    /// Number of pixels for fits and comparison of models.
    pub pixels: usize,
}

impl SolveOptions {
    /// Default options with this model.
    pub fn of(model: Model) -> Self {
        Self {
            model,
            offset: 0.0,
            camera: None,
            oblique: Oblique::Off,
            angle_sigma: 0.0,
            source: Source::IDEAL,
            pixels: SAMPLE_PIXELS,
        }
    }
}

/// Default number of pixels for fits and comparison of models.
pub const SAMPLE_PIXELS: usize = 30_000;

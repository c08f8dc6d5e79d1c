//! Options of a solution.

use crate::Model;
use crate::film::stand::{Oblique, Stand};
use nacre_optics::polarization::Material;

/// Model, corrections and sample size of a solution.
pub struct Asked {
    /// Model of the points (S1/S0, S2/S0).
    pub model: Model,
    /// Offset added to every orientation, in rad.
    pub offset: f64,
    /// Camera geometry, if the photographs contain it, and sample material.
    pub stand: Option<(Stand, Material)>,
    /// Correction of oblique incidence.
    pub oblique: Oblique,
    /// Standard deviation of the analyser-angle errors in rad, if known.
    pub angle_sigma: f64,
    /// Number of pixels for fits and comparison of models.
    pub pixels: usize,
}

impl Asked {
    /// Default options with this model.
    pub fn of(model: Model) -> Self {
        Self { model, offset: 0.0, stand: None, oblique: Oblique::Off, angle_sigma: 0.0, pixels: CLOUD }
    }
}

/// Default number of pixels for fits and comparison of models.
pub const CLOUD: usize = 30_000;

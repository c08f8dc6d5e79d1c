//! The request to a solution.

use crate::Model;
use crate::film::stand::{Oblique, Stand};
use nacre_optics::polarization::Material;

/// Model, corrections and sample size of a solution.
pub struct Asked {
    /// Model of the points (S1/S0, S2/S0).
    pub model: Model,
    /// Added to every orientation, in rad.
    pub offset: f64,
    /// Where the camera stands, if the photographs say so.
    pub stand: Option<(Stand, Material)>,
    /// Whether what oblique incidence does is taken out.
    pub oblique: Oblique,
    /// Standard deviation of the analyser's angles in rad, where it is known.
    pub angle_sigma: f64,
    /// Pixels that models are fitted to and compared on.
    pub pixels: usize,
}

impl Asked {
    /// This model, and nothing else.
    pub fn of(model: Model) -> Self {
        Self { model, offset: 0.0, stand: None, oblique: Oblique::Off, angle_sigma: 0.0, pixels: CLOUD }
    }
}

/// Pixels that models are fitted to and compared on.
pub const CLOUD: usize = 30_000;

//! Materials of holograms: a transparent film on metal.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Materials of the sample: a transparent film on metal.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Material {
    /// Refractive index of the film; 1 for bare metal.
    pub film_index: f64,
    /// Refractive index of the metal.
    pub metal_n: f64,
    /// Extinction coefficient of the metal.
    pub metal_k: f64,
}

impl Default for Material {
    /// Packaging film (PET, polycarbonate, lacquer: 1.47 to 1.6) on aluminium.
    fn default() -> Self {
        let metal = crate::rcwa::ALUMINIUM;
        Self { film_index: 1.5, metal_n: metal.re, metal_k: metal.im }
    }
}

impl Material {
    /// Message about values out of range; `None` if all are valid.
    pub fn problem(&self) -> Option<&'static str> {
        let good = (1.0..=4.0).contains(&self.film_index)
            && (1e-3..=20.0).contains(&self.metal_n)
            && (0.0..=50.0).contains(&self.metal_k);
        (!good).then_some("film_index must be 1 to 4, metal_n 0.001 to 20 and metal_k 0 to 50")
    }
}

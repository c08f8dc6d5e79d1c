//! Notes on the computation of a material, for reports.

/// Notes on the computation of a material.
#[derive(Clone, Debug, Default, serde::Serialize, JsonSchema)]
pub struct Notes {
    /// Method, in words.
    pub method: String,
    /// Highest order.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub orders: Option<i32>,
    /// Predicted relative error of its model.
    pub predicted_error: f64,
    /// Part of a grating's light that scalar theory, balanced, has in a wrong order: about, at 45°, against Maxwell's equations for a perfect
    /// conductor. No sampling mends it, so that it is no part of what is met.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub theory_error: Option<f64>,
    /// Warnings.
    pub warnings: Vec<String>,
}
use schemars::JsonSchema;

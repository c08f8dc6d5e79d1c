//! Notes on the computation of a material, for reports.

/// Notes on the computation of a material.
#[derive(Clone, Debug, Default, serde::Serialize, JsonSchema)]
pub struct Notes {
    /// Description of the method.
    pub method: String,
    /// Highest order.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub orders: Option<i32>,
    /// Predicted relative error of its model.
    pub predicted_error: f64,
    /// Approximate share of a grating's light that balanced scalar theory places in a wrong order, at 45°, compared
    /// with rigorous solutions for a perfect conductor. Sampling does not reduce it, so it is excluded from the target
    /// error.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub theory_error: Option<f64>,
    /// Warnings.
    pub warnings: Vec<String>,
}
use schemars::JsonSchema;

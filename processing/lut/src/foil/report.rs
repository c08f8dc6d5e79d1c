//! What a measurement says of itself.

use serde::Serialize;

/// How the distribution was found, and what to beware of.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Report {
    /// Bins of orientation and of lines.
    pub bins: [usize; 2],
    /// Least and most lines per µm.
    pub lines_per_um: [f64; 2],
    /// Mean and standard deviation of the period in µm.
    pub period_um: [f64; 2],
    /// Whether periods are known up to a factor only.
    pub relative: bool,
    /// Part of the bins that the photograph shows.
    pub covered: f64,
    /// Light that was taken for background, of the brightest bin.
    pub background: f64,
    /// Where the zero order was found, in px.
    pub zero_order_px: Option<[f64; 2]>,
    /// How far from where the geometry has it, in px.
    pub zero_order_off_px: Option<f64>,
    /// What to beware of.
    pub warnings: Vec<String>,
    /// How long it took.
    pub seconds: f64,
}

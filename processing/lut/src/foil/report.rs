//! What a measurement says of itself.

use nacre_base::operation::{Summary, lines};
use schemars::JsonSchema;
use serde::Serialize;

/// How the distribution was found, and what to beware of.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "FoilReport")]
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

impl Summary for Report {
    fn summary(&self) -> String {
        let [mean, spread] = self.period_um;
        let relative = if self.relative { " (relative)" } else { "" };
        format!(
            "dots      periods of {mean:.3} µm{relative} on average, {spread:.3} µm standard deviation\n\
             bins      {} of orientation, {} of period; {:.0} % of them are in the photograph\n{}time      {:.2} s",
            self.bins[0],
            self.bins[1],
            100.0 * self.covered,
            lines(&[], &self.warnings),
            self.seconds
        )
    }

    fn warnings(&self) -> &[String] {
        &self.warnings
    }
}

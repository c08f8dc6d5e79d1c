//! Report of a measurement.

use nacre_base::operation::{Summary, lines};
use schemars::JsonSchema;
use serde::Serialize;

/// Summary of the measured distribution, and warnings.
#[derive(Clone, Debug, Default, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "FoilReport")]
pub struct Report {
    /// Number of orientation and line-density bins.
    pub bins: [usize; 2],
    /// Minimum and maximum line density per µm.
    pub lines_per_um: [f64; 2],
    /// Mean and standard deviation of the period in µm.
    pub period_um: [f64; 2],
    /// True if periods are known only up to a common factor.
    pub relative: bool,
    /// Fraction of the bins covered by the photograph.
    pub covered: f64,
    /// Background light relative to the brightest bin.
    pub background: f64,
    /// Measured position of the zero order in pixels.
    pub zero_order_px: Option<[f64; 2]>,
    /// Distance from the expected zero order in pixels.
    pub zero_order_off_px: Option<f64>,
    /// Limitations of the result.
    pub warnings: Vec<String>,
    /// Computation time in seconds.
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

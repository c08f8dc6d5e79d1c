//! Report of a product, as text and data.

use super::choose::{Choice, name};
use super::height::Quality;
use super::settings::Settings;
use nacre_base::Result;
use nacre_base::operation::lines;
use nacre_image::{json, write_whole};
use schemars::JsonSchema;
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Report of a product: input, method and errors.
#[derive(Serialize, JsonSchema)]
#[schemars(rename = "BrdfReport")]
pub struct Report<T: Serialize> {
    /// Name of the product.
    pub product: &'static str,
    /// Warnings about the result.
    pub warnings: Vec<String>,
    /// File of the height field.
    pub input: PathBuf,
    /// Quality of the height field.
    pub quality: Quality,
    /// Requested settings.
    pub settings: Settings,
    /// Method of computation.
    pub choice: Choice,
    /// Largest relative error of lobes with at least 0.1 % of the light.
    pub error_estimate: f64,
    /// Fields of this product only.
    #[serde(flatten)]
    pub more: T,
    /// Time in s.
    pub seconds: f64,
    /// Written files.
    pub files: Vec<PathBuf>,
}

impl<T: Serialize> Report<T> {
    /// Writes the report to a file.
    ///
    /// # Errors
    /// `Output` if the system refuses.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_whole(path, json(self).as_bytes())
    }

    /// Report in a few lines; `middle` describes the product.
    pub fn lines(&self, middle: &str) -> String {
        let q = &self.quality;
        let mut text =
            format!("surface   {} × {} pixels of {} µm, {:.4} µm deep", q.width, q.height, q.pixel_um, q.range_um);
        for note in &q.notes {
            let _ = write!(text, "\nread      {note}");
        }
        for p in q.periods.iter().take(3) {
            let share = 100.0 * p.share;
            let _ = write!(
                text,
                "\nperiod    {:.3} µm (± {:.3}) towards {:.1}°, {share:.0} % of the variance",
                p.period_um, p.resolution_um, p.direction_deg
            );
        }
        let c = &self.choice;
        let terms = c.terms.map_or(String::new(), |n| format!(", {n} terms"));
        let _ = write!(text, "\nmethod    {}{terms}, {} bits: {}", name(c.method), c.bits, c.why);
        let measured = match c.measured_error {
            None => "not measured".into(),
            Some(e) if e < 1e-6 => "under 0.0001 % measured".into(),
            Some(e) => format!("{:.4} % measured", 100.0 * e),
        };
        let _ = write!(text, "\nquality   error at most {:.3} % ({measured})", 100.0 * self.error_estimate);
        if !middle.is_empty() {
            let _ = write!(text, "\n{middle}");
        }
        let said = lines(&[], &self.warnings);
        let _ = write!(text, "\n{said}time      {:.2} s ({:.2} CPU-seconds expected)", self.seconds, c.predicted_s);
        for file in &self.files {
            let _ = write!(text, "\nwrote     {}", file.display());
        }
        text
    }
}

//! Options of a merge.

use super::input::check_input;
use super::reconstruct::merge_into;
use super::report::Report;
use nacre_base::estimate::Work;
use nacre_base::operation::{Operation, exceeds};
use nacre_base::progress::Progress;
use nacre_base::{OutputFolder, Result};
use nacre_image::registration::Align;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Merge exposures into one photograph of high dynamic range.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(extend(
    "x-input" = "Session folder, frames.json, or a folder of photographs that say their exposure times (Exif)",
    "x-examples" = "\
Examples:
  nacre reconstruct hdr photos/ --out result              exposure times from Exif; response recovered
  nacre reconstruct hdr session --out result              a session of kind exposures
  nacre reconstruct hdr photos/ --out result --response earlier/response.json

Writes hdr.exr (R G B or Y; NaN where every exposure is saturated), variance.exr, flags.exr (0 measured,
1 saturated, 2 dark in every exposure), hdr.png (tone-mapped), report.json, and response.json where a
response was recovered."
))]
#[schemars(rename = "HdrOptions")]
pub struct Options {
    /// Response of the camera: stated, linear, recover, or the response.json of an earlier recovery.
    ///
    /// stated is the transfer function of frames.json. Without one, the response of 8-bit photographs is recovered, and
    /// that of others is linear.
    #[schemars(extend("x-placeholder" = "stated|linear|recover|FILE", "x-file" = true, "examples" = ["stated", "linear", "recover"]))]
    pub response: ResponseChoice,
    /// auto corrects shifts between exposures where that reduces the error; off leaves them.
    pub align: Align,
    /// File value of a saturated pixel, above black; by default as the photographs and frames.json state.
    #[schemars(extend("x-advanced" = true))]
    pub white: Option<f64>,
    /// Largest acceptable relative standard deviation of a typical value.
    ///
    /// The results are written in any case; the exit code is 1 when it is larger.
    #[schemars(extend("x-advanced" = true, "x-placeholder" = "REL"))]
    pub max_error: Option<f64>,
}

/// Response of the camera.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(from = "String", into = "String")]
#[schemars(with = "String")]
pub enum ResponseChoice {
    /// The photographs' `transfer`. Without a `frames.json`, the response of 8-bit photographs is recovered, and that
    /// of others is linear.
    #[default]
    Stated,
    /// Linear response.
    Linear,
    /// Response recovered from the bracket.
    Recover,
    /// Response of an earlier recovery (response.json).
    File(PathBuf),
}

impl From<String> for ResponseChoice {
    fn from(text: String) -> Self {
        match text.as_str() {
            "stated" => Self::Stated,
            "linear" => Self::Linear,
            "recover" => Self::Recover,
            _ => Self::File(text.into()),
        }
    }
}

impl From<ResponseChoice> for String {
    fn from(choice: ResponseChoice) -> Self {
        match choice {
            ResponseChoice::Stated => "stated".into(),
            ResponseChoice::Linear => "linear".into(),
            ResponseChoice::Recover => "recover".into(),
            ResponseChoice::File(path) => path.display().to_string(),
        }
    }
}

impl Operation for Options {
    const NAME: &'static str = "hdr";
    const TITLE: &'static str = "One photograph of high dynamic range from several exposures";
    type Report = Report;

    fn check(&self, input: &Path) -> Result<Work> {
        check_input(input, self.white)
    }

    fn run(&self, input: &Path, out: &OutputFolder, progress: &dyn Progress) -> Result<Report> {
        merge_into(out, input, self, progress)
    }

    fn missed(&self, report: &Report) -> Option<String> {
        let said = ["σ of a typical value, over itself,", "", "expose longer or take more exposures"];
        exceeds(self.max_error, report.error_estimate, said)
    }
}

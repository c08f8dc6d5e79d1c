//! Capture plans: data that says what to show, rotate, expose and flash, checked and estimated before anything moves.

mod analyser;
mod check;
mod estimate;
mod fringes;
mod operation;
mod results;
mod steps;

pub use analyser::{AnalyserPlan, UntilSigma};
pub use estimate::{Estimate, Least, Limits};
pub(crate) use estimate::{approach, light_on_s};
pub(crate) use fringes::MORE;
pub use fringes::{Added, FringesPlan, Reach, UntilDecided};
pub use operation::{Method, PlannedOperation, names};
pub use steps::{Role, State, Step, groups};

use nacre_base::Version;
use nacre_drivers::Pattern;
use nacre_frames::Illumination;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Longest name, sample and operator, in characters.
const LONGEST_TEXT: usize = 200;

/// Longest notes, in characters.
const LONGEST_NOTES: usize = 10_000;

/// A capture plan (`plan.toml`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Version of the format.
    #[serde(default)]
    pub version: Version<2>,
    /// What is varied.
    pub kind: PlanKind,
    /// Name of the session, in at most 200 characters.
    #[serde(default)]
    #[schemars(length(max = 200))]
    pub name: String,
    /// What lies on the table, in at most 200 characters.
    #[serde(default)]
    #[schemars(length(max = 200))]
    pub sample: String,
    /// Who measures, in at most 200 characters.
    #[serde(default)]
    #[schemars(length(max = 200))]
    pub operator: String,
    /// Anything else, in at most 10,000 characters.
    #[serde(default)]
    #[schemars(length(max = 10_000))]
    pub notes: String,
    /// Camera settings.
    #[serde(default)]
    pub camera: CameraPlan,
    /// What the panel shows.
    #[serde(default)]
    pub display: DisplayPlan,
    /// Light that falls on the sample, for kind polarization (default: circular_panel, the panel behind its quarter-wave retarder).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub illumination: Option<Illumination>,
    /// Angles of the analyser. Kinds other than polarization do without; the analyser is then not touched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub analyser: Option<AnalyserPlan>,
    /// Exposure times in ms, for kinds exposures and flash; for kind polarization, taken at each angle and merged into one intensity:
    /// what is saturated in the long ones is measured in the short ones.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub exposures_ms: Vec<f64>,
    /// Exposure times that are worked out by metering, for kinds exposures and flash; the session then holds them as exposures_ms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bracket: Option<BracketPlan>,
    /// Where the panel lights up, for kind spots.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spots: Option<SpotsPlan>,
    /// The frames one by one, for kind free.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub steps: Vec<FreeStep>,
    /// Frames taken besides.
    #[serde(default)]
    pub extras: Vec<Extra>,
    /// Operation on the frames that follows the capture; its results are the session's `results/`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reconstruct: Option<PlannedOperation>,
}

impl Plan {
    /// Checks the lengths of texts. Sessions of earlier versions may have longer ones, so that this is for new plans.
    ///
    /// # Errors
    /// A sentence that names the key, its length and the longest allowed.
    pub fn check_texts(&self) -> Result<(), String> {
        let texts = [("name", &self.name), ("sample", &self.sample), ("operator", &self.operator)];
        let limits = texts.map(|(key, text)| (key, text, LONGEST_TEXT));
        for (key, text, longest) in limits.into_iter().chain([("notes", &self.notes, LONGEST_NOTES)]) {
            match text.chars().count() {
                length if length > longest => {
                    return Err(format!("{key} has {length} characters; shorten it to at most {longest}"));
                }
                _ => {}
            }
        }
        Ok(())
    }
}

/// A bracket of exposures: from the longest in which all but the brightest thousandth of the pixels stay below white, in even
/// steps, to one in which the darkest hundredth is well above black, or the longest that camera and flash allow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BracketPlan {
    /// How much longer each exposure is than the one before, in powers of two, 0.5 to 6.
    pub step_ev: f64,
    /// Most exposures, 2 to 16.
    pub at_most: u32,
}

impl Default for BracketPlan {
    fn default() -> Self {
        Self { step_ev: 2.0, at_most: 7 }
    }
}

/// What a plan varies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PlanKind {
    /// The angle of the analyser.
    Polarization,
    /// The exposure time, at each angle of the analyser if any are given.
    Exposures,
    /// Nothing, or the angle of the analyser, under the flash.
    Flash,
    /// Where the panel lights up, at each angle of the analyser if any are given.
    Spots,
    /// Anything, frame by frame.
    Free,
}

/// Camera settings of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CameraPlan {
    /// Exposure time in ms; metered, over the whole turn of the analyser, when it is not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure_ms: Option<f64>,
    /// `"meter"` says so in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure: Option<ExposureMode>,
    /// Gain.
    pub gain: f64,
    /// Exposures averaged into each frame, 1 to 16.
    pub average: u32,
    /// Region of interest: left, top, width, height in pixels; the whole frame when it is not given.
    pub roi: Option<[u32; 4]>,
}

/// How the exposure is found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ExposureMode {
    /// From trial frames over the whole turn of the analyser.
    Meter,
}

/// What the panel shows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DisplayPlan {
    /// The pattern.
    pub pattern: PatternKind,
    /// Middle of the disc, from the panel's middle to the right and up, in mm.
    pub center_mm: [f64; 2],
    /// Diameter of the disc in mm.
    pub diameter_mm: f64,
}

/// Patterns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PatternKind {
    /// A white disc.
    Disc,
    /// Nothing.
    Black,
}

/// A series of white discs on the panel, of fringes, or of both.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpotsPlan {
    /// Middles of discs, from the panel's middle to the right and up, in mm, in the order they are taken.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub centers_mm: Vec<[f64; 2]>,
    /// Their diameter in mm.
    #[serde(default = "disc_mm")]
    pub diameter_mm: f64,
    /// Stripes that move over the panel, for `reconstruct spots`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fringes: Option<FringesPlan>,
}

fn disc_mm() -> f64 {
    10.0
}

/// One frame of a free plan.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct FreeStep {
    /// What the panel shows; as the plan's `display` when it is not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub display: Option<DisplayPlan>,
    /// Analyser angle in degrees. Where it is not given, that of the step before, and before the first one given, that
    /// one; if none is given at all, the analyser is not touched.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub analyser_deg: Option<f64>,
    /// Whether the flash is on.
    pub flash: bool,
    /// Exposure time in ms; as the plan's `camera` says when it is not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure_ms: Option<f64>,
}

/// Frames besides the series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Extra {
    /// With the camera's shutter closed: dark current and offset.
    Dark,
    /// With panel and flash dark: ambient light and dark current. It is what reconstructions subtract; without it they
    /// subtract the dark frame.
    DisplayBlack,
}

impl DisplayPlan {
    /// As the panel understands it.
    pub fn pattern(&self) -> Pattern {
        match self.pattern {
            PatternKind::Black => Pattern::Black,
            PatternKind::Disc => Pattern::Disc { center_mm: self.center_mm, diameter_mm: self.diameter_mm },
        }
    }
}

impl Default for CameraPlan {
    fn default() -> Self {
        Self { exposure_ms: None, exposure: None, gain: 1.0, average: 1, roi: None }
    }
}

impl Default for DisplayPlan {
    fn default() -> Self {
        Self { pattern: PatternKind::Disc, center_mm: [0.0, 0.0], diameter_mm: 180.0 }
    }
}

/// The word that files use for a value.
pub fn word(value: impl Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}

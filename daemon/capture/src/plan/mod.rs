//! Capture plans: patterns, rotations, exposures and flash as data, validated and estimated before any device moves.

mod analyser;
mod calibration;
mod check;
mod estimate;
mod fringes;
mod operation;
mod results;
mod steps;

pub use analyser::{AnalyserPlan, UntilSigma};
pub use calibration::{CalibrationKind, CalibrationPlan, CalibrationsPlan};
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

/// Maximum length of name, sample and operator in characters.
const LONGEST_TEXT: usize = 200;

/// Maximum length of notes in characters.
const LONGEST_NOTES: usize = 10_000;

/// A capture plan (`plan.toml`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Version of the format.
    #[serde(default)]
    pub version: Version<2>,
    /// Quantity varied.
    pub kind: PlanKind,
    /// Name of the session (at most 200 characters).
    #[serde(default)]
    #[schemars(length(max = 200))]
    pub name: String,
    /// Sample on the bench (at most 200 characters).
    #[serde(default)]
    #[schemars(length(max = 200))]
    pub sample: String,
    /// Name of the operator (at most 200 characters).
    #[serde(default)]
    #[schemars(length(max = 200))]
    pub operator: String,
    /// Notes (at most 10,000 characters).
    #[serde(default)]
    #[schemars(length(max = 10_000))]
    pub notes: String,
    /// Camera settings.
    #[serde(default)]
    pub camera: CameraPlan,
    /// Pattern on the panel.
    #[serde(default)]
    pub display: DisplayPlan,
    /// Illumination of the sample, for kind polarization (default: circular_panel, the panel behind its quarter-wave
    /// retarder).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub illumination: Option<Illumination>,
    /// Angles of the analyser. Optional for kinds other than polarization; without it, the analyser is not moved.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub analyser: Option<AnalyserPlan>,
    /// Exposure times in ms, for kinds exposures and flash, and for the calibration of a camera. For kind polarization:
    /// captured at each angle and merged into one intensity, so that short exposures replace saturated pixels of long
    /// ones.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub exposures_ms: Vec<f64>,
    /// Exposure times determined by metering, for kinds exposures and flash; the session then states them as
    /// exposures_ms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bracket: Option<BracketPlan>,
    /// Lit positions of the panel, for kind spots.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spots: Option<SpotsPlan>,
    /// Property to measure, for kind calibration.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub calibration: Option<CalibrationPlan>,
    /// Stored calibrations that the session uses: "auto" (default), "off", or a list of their identifiers.
    #[serde(default, skip_serializing_if = "CalibrationsPlan::is_auto")]
    pub calibrations: CalibrationsPlan,
    /// The frames one by one, for kind free.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub steps: Vec<FreeStep>,
    /// Additional frames.
    #[serde(default)]
    pub extras: Vec<Extra>,
    /// Operation on the frames after the capture; its results are the session's `results/`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reconstruct: Option<PlannedOperation>,
}

impl Plan {
    /// Checks the lengths of texts. For new plans only, since sessions of earlier versions may have longer texts.
    ///
    /// # Errors
    /// A sentence with the key, its length and the maximum.
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

/// A bracket of exposures. It starts at the longest exposure at which all but the brightest 0.1 % of the pixels stay
/// below white. It continues in equal steps until the darkest 1 % is well above black, or to the longest exposure
/// permitted by camera and flash.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct BracketPlan {
    /// Ratio of successive exposures in powers of two, 0.5 to 6.
    pub step_ev: f64,
    /// Maximum number of exposures, 2 to 16.
    pub at_most: u32,
}

impl Default for BracketPlan {
    fn default() -> Self {
        Self { step_ev: 2.0, at_most: 7 }
    }
}

/// Quantity that a plan varies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PlanKind {
    /// The angle of the analyser.
    Polarization,
    /// The exposure time, at each angle of the analyser if any are given.
    Exposures,
    /// Nothing, or the angle of the analyser, under a flash.
    Flash,
    /// The lit position of the panel, at each angle of the analyser if any are given.
    Spots,
    /// Any quantity, frame by frame.
    Free,
    /// The quantity that a calibration of the bench needs.
    Calibration,
}

/// Camera settings of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CameraPlan {
    /// Exposure time in ms (default: metered, over the full rotation of the analyser).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure_ms: Option<f64>,
    /// `"meter"` requests metering explicitly.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure: Option<ExposureMode>,
    /// Camera gain.
    pub gain: f64,
    /// Number of exposures averaged into each frame, 1 to 16.
    pub average: u32,
    /// Region of interest: left, top, width, height in pixels (default: the whole frame).
    pub roi: Option<[u32; 4]>,
}

/// Method of exposure selection.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ExposureMode {
    /// Trial frames over the full rotation of the analyser.
    Meter,
}

/// Pattern on the panel.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DisplayPlan {
    /// Kind of pattern.
    pub pattern: PatternKind,
    /// Centre of the disc in mm, to the right of and above the panel's centre.
    pub center_mm: [f64; 2],
    /// Diameter of the disc in mm.
    pub diameter_mm: f64,
}

/// Kinds of patterns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PatternKind {
    /// A white disc.
    Disc,
    /// Black.
    Black,
}

/// A series of white discs on the panel, of fringes, or of both.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpotsPlan {
    /// Centres of discs in mm, to the right of and above the panel's centre, in order of capture.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub centers_mm: Vec<[f64; 2]>,
    /// Diameter of the discs in mm.
    #[serde(default = "disc_mm")]
    pub diameter_mm: f64,
    /// Fringes on the panel, for `reconstruct spots`.
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
    /// Pattern on the panel (default: the plan's `display`).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub display: Option<DisplayPlan>,
    /// Analyser angle in degrees. Default: that of the previous step; before the first stated angle, that angle. If no
    /// step states one, the analyser is not moved.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub analyser_deg: Option<f64>,
    /// True if the flash is on.
    pub flash: bool,
    /// Exposure time in ms (default: that of the plan's `camera`).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure_ms: Option<f64>,
}

/// Frames in addition to the series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Extra {
    /// With the camera's shutter closed: dark current and offset.
    Dark,
    /// With panel and flash off: ambient light and dark current. Reconstructions subtract this frame, or else the dark
    /// frame.
    DisplayBlack,
}

impl DisplayPlan {
    /// Pattern for the panel driver.
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

/// Serialised name of an enum value.
pub fn word(value: impl Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}

//! Capture plans: data that says what to show, rotate, expose and flash, checked and estimated before anything moves.

mod analyser;
mod check;
mod estimate;
mod fringes;
mod method;
mod results;
mod steps;

pub use analyser::{AnalyserPlan, UntilSigma};
pub use estimate::{Estimate, Least, Limits};
pub(crate) use estimate::{approach, light_on_s};
pub(crate) use fringes::MORE;
pub use fringes::{Added, FringesPlan, Reach, UntilDecided};
pub use method::{Method, names};
pub use steps::{Role, State, Step, groups};

use nacre_base::Error;
use nacre_base::fields::EXAMPLE_WORDS;
use nacre_drivers::Pattern;
use nacre_frames::Illumination;
use nacre_image::Palette;
use nacre_lut::bokeh;
use nacre_periods::flash;
use nacre_periods::spots;
use nacre_polarimetry::{Model, Oblique};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// Longest name, sample and operator, in characters.
const LONGEST_TEXT: usize = 200;

/// Longest notes, in characters.
const LONGEST_NOTES: usize = 10_000;

/// A capture plan (`plan.toml`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Plan {
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
    /// What to make of the frames at once, in the session's `results/`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reconstruct: Option<ReconstructPlan>,
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

/// A reconstruction that follows the capture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReconstructPlan {
    /// Which reconstruction.
    pub method: Method,
    /// Which model (default: auto under a circular panel, plain under other light).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub model: Option<Model>,
    /// Whether oblique incidence is taken out.
    #[serde(default)]
    pub oblique: Oblique,
    /// Colours of angles in pictures; those of the methods spots and flash are among their options.
    #[serde(default)]
    pub palette: Palette,
    /// Of the method lut: wavelength, scale, light and so on. What the bench says of wavelength and geometry is known without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lut: Option<Box<nacre_lut::Settings>>,
    /// Of the method bokeh: blur, scale, lens and so on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bokeh: Option<Box<bokeh::Options>>,
    /// Of the method spots: geometry, wavelength and so on. What the bench says of them is known without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spots: Option<Box<spots::Settings>>,
    /// Of the method flash: tiles, size of the sheet and so on. What the bench says of wavelength and geometry is known without it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub flash: Option<Box<flash::Settings>>,
}

impl ReconstructPlan {
    /// Options of the method polarization.
    pub fn polarization(&self) -> nacre_polarimetry::Options {
        let (model, oblique, palette) = (self.model, self.oblique, self.palette);
        nacre_polarimetry::Options { model, oblique, palette, ..Default::default() }
    }

    /// Refuses options that name files: a plan may come from elsewhere, and its results are made on this machine.
    ///
    /// # Errors
    /// The option, and its built-in values.
    fn check_files(&self) -> Result<(), String> {
        let Ok(mut options) = self.options() else { return Ok(()) };
        for field in &self.method.operation().fields().list {
            let Some(Value::String(name)) = field.file(&mut options) else { continue };
            if !field.is_built_in(name) {
                let (method, key) = (self.method.name(), field.path.join("."));
                let words = field.schema.get(EXAMPLE_WORDS).and_then(Value::as_array);
                let words = words.into_iter().flatten().filter_map(Value::as_str).collect::<Vec<_>>().join(", ");
                let remedy = if words.is_empty() { "leave it out".into() } else { format!("give one of {words}") };
                return Err(format!("reconstruct.{method}.{key} names the file {name:?}, which no plan may; {remedy}"));
            }
        }
        Ok(())
    }

    /// Options of the operation.
    ///
    /// # Errors
    /// `Input` for a method that does not begin from a session, and where needed options are missing.
    pub fn options(&self) -> Result<Value, Error> {
        // Plain data always serialises.
        fn value(options: &impl Serialize) -> Value {
            serde_json::to_value(options).unwrap_or_default()
        }
        let options = match self.method.name() {
            "polarization" => value(&self.polarization()),
            // The bench stands still.
            "hdr" => json!({ "align": "off" }),
            "lut" => self.lut.as_ref().map_or(Value::Null, value),
            "bokeh" => self.bokeh.as_ref().map(value).ok_or_else(|| {
                let remedy = "say the blur in the plan: reconstruct.bokeh.psf.sigma";
                Error::input("plan", "has no options of bokeh", remedy)
            })?,
            "spots" => self.spots.as_ref().map_or(Value::Null, value),
            "flash" => self.flash.as_ref().map_or(Value::Null, value),
            _ => {
                let problem = "makes of photographs what is made of other things";
                return Err(Error::input("plan", problem, "leave reconstruct out, and upload what it is made of"));
            }
        };
        Ok(options)
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

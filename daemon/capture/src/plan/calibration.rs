//! Sessions that measure a property of the bench, and the choice of stored calibrations for a session.

use super::{Added, AnalyserPlan, Extra, Method, Plan, PlanKind, PlannedOperation};
use crate::ids::is_id;
use nacre_drivers::CameraInfo;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Map;
use std::time::Duration;

/// Exposures of a camera's calibration relative to the metered one: the range of the evenly spaced ones, and the last,
/// which saturates.
const LEVELS: [f64; 2] = [0.02, 1.0];
const SATURATED: f64 = 2.0;

/// Defaults of a calibration: exposures, frames, angles around the crossed direction, and step of a full turn in
/// degrees.
const USUAL_LEVELS: u32 = 12;
const USUAL_FRAMES: u32 = 16;
const USUAL_CROSSED: u32 = 4;
const STEP_DEG: u32 = 15;

/// Maximum number of exposures of a camera's calibration.
pub(super) const MOST_LEVELS: usize = 64;

/// Kind of a calibration: the operation of `nacre calibrate` that measures it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CalibrationKind {
    /// Noise and levels of the camera.
    Camera,
    /// Unevenness of light and lens.
    Flat,
    /// Zero, sense and extinction of the analyser.
    Analyser,
    /// Polarization behind the retarder of the panel.
    Retarder,
    /// Offset of orientations, from a sample of known orientation.
    Orientation,
}

impl CalibrationKind {
    /// All kinds.
    pub const ALL: [Self; 5] = [Self::Camera, Self::Flat, Self::Analyser, Self::Retarder, Self::Orientation];

    /// Name, which is that of the operation.
    pub fn name(self) -> &'static str {
        match self {
            Self::Camera => "camera",
            Self::Flat => "flat",
            Self::Analyser => "analyser",
            Self::Retarder => "retarder",
            Self::Orientation => "orientation",
        }
    }

    /// Kind by its name.
    pub fn of(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }

    /// Name in a sentence.
    pub fn title(self) -> &'static str {
        match self {
            Self::Camera => "calibration of the camera",
            Self::Flat => "flat field",
            Self::Analyser => "calibration of the analyser",
            Self::Retarder => "calibration of the retarder",
            Self::Orientation => "calibration of orientations",
        }
    }
}

/// Property that a session of kind calibration measures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CalibrationPlan {
    /// Property: camera, flat, analyser or retarder. The operation of the same name computes it after the capture.
    pub of: CalibrationKind,
    /// For camera: number of exposures (default 12), evenly spaced from 2 % to 100 % of the metered exposure, and a
    /// last one of 200 %. Each is taken twice with light and twice in darkness.
    #[schemars(range(min = 4, max = 64))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub levels: Option<u32>,
    /// For camera: frames in darkness: dark (default), or display_black for a camera without shutter in a dark room.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub darkness: Option<Extra>,
    /// For flat: number of frames (default 16).
    #[schemars(range(min = 2, max = 256))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frames: Option<u32>,
    /// For analyser: number of further angles at ±1°, ±2°, … from the crossed direction, which the full turn determines
    /// (default 4).
    #[schemars(range(min = 0, max = 16))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crossed: Option<u32>,
}

/// Use of stored calibrations by a session.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum CalibrationsPlan {
    /// The newest one of each kind that was taken with the devices in use and is not too old.
    #[default]
    Auto,
    /// None.
    Off,
    /// Those with these identifiers.
    Listed(Vec<String>),
}

impl CalibrationsPlan {
    pub(super) fn is_auto(&self) -> bool {
        *self == Self::Auto
    }
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Word {
    /// The newest one of each kind that was taken with the devices in use and is not too old.
    Auto,
    /// None.
    Off,
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
enum Words {
    Word(Word),
    /// Identifiers of calibrations, at most one of each kind.
    Listed(Vec<String>),
}

impl Serialize for CalibrationsPlan {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let words = match self {
            Self::Auto => Words::Word(Word::Auto),
            Self::Off => Words::Word(Word::Off),
            Self::Listed(ids) => Words::Listed(ids.clone()),
        };
        words.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for CalibrationsPlan {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let expected = "give \"auto\", \"off\" or a list of identifiers";
        match Words::deserialize(deserializer).map_err(|_| serde::de::Error::custom(expected))? {
            Words::Word(Word::Auto) => Ok(Self::Auto),
            Words::Word(Word::Off) => Ok(Self::Off),
            Words::Listed(ids) => Ok(Self::Listed(ids)),
        }
    }
}

impl JsonSchema for CalibrationsPlan {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "CalibrationsPlan".into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        Words::json_schema(generator)
    }
}

impl Plan {
    /// Kind of calibration that the session measures.
    pub fn measures(&self) -> Option<CalibrationKind> {
        self.calibration.filter(|_| self.kind == PlanKind::Calibration).map(|c| c.of)
    }

    fn calibrates(&self, kind: CalibrationKind) -> Option<CalibrationPlan> {
        self.calibration.filter(|_| self.measures() == Some(kind))
    }

    /// Number of exposures of a camera's calibration.
    pub(super) fn levels(&self) -> Option<u32> {
        Some(self.calibrates(CalibrationKind::Camera)?.levels.unwrap_or(USUAL_LEVELS))
    }

    /// Number of frames of a flat field.
    pub(super) fn flat_frames(&self) -> Option<u32> {
        Some(self.calibrates(CalibrationKind::Flat)?.frames.unwrap_or(USUAL_FRAMES))
    }

    /// Extra frames, and how often each is taken.
    pub(super) fn extras_taken(&self) -> (Vec<Extra>, usize) {
        match self.calibrates(CalibrationKind::Camera) {
            Some(camera) => (vec![camera.darkness.unwrap_or(Extra::Dark)], 2),
            None => (self.extras.clone(), 1),
        }
    }

    /// Offsets in degrees of further angles from the crossed direction, in rising order; empty for other plans.
    pub fn crossed_offsets_deg(&self) -> Vec<f64> {
        let count = self.calibrates(CalibrationKind::Analyser).map_or(0, |c| c.crossed.unwrap_or(USUAL_CROSSED));
        let both = (1..=count).flat_map(|k| [-f64::from(k), f64::from(k)]);
        let mut offsets: Vec<f64> = both.take(count as usize).collect();
        offsets.sort_by(f64::total_cmp);
        offsets
    }

    /// True if the angles around the crossed direction are still to be added.
    pub(crate) fn awaits_crossed(&self, chosen: &[Added]) -> bool {
        chosen.is_empty() && !self.crossed_offsets_deg().is_empty()
    }

    /// Angle of the stage for the crossed direction at which all further angles are within the range of the stage.
    pub(crate) fn crossed_within(&self, crossed_deg: f64, [low, high]: [f64; 2]) -> Option<f64> {
        let offsets = self.crossed_offsets_deg();
        let fits = |at: &f64| offsets.iter().all(|offset| (low..=high).contains(&(at + offset)));
        let turned = crossed_deg.rem_euclid(180.0);
        [turned, turned + 180.0, turned - 180.0].map(thousandths).into_iter().find(fits)
    }

    /// The plan with the defaults of its kind: a full turn of the analyser, and a frame of ambient light. The operation
    /// that computes the calibration is added if its options have defaults.
    pub fn completed(mut self) -> Self {
        let Some(kind) = self.measures() else { return self };
        if matches!(kind, CalibrationKind::Analyser | CalibrationKind::Retarder) && self.analyser.is_none() {
            let turn = (0..360).step_by(STEP_DEG as usize).map(f64::from).collect();
            self.analyser = Some(AnalyserPlan::Listed(turn));
        }
        if kind != CalibrationKind::Camera && !self.extras.contains(&Extra::DisplayBlack) {
            self.extras.push(Extra::DisplayBlack);
        }
        if self.reconstruct.is_none() {
            let planned = |operation| PlannedOperation { operation, options: Map::new() };
            // The axis of a reference polarizer, or the panel's direction, has no default.
            self.reconstruct = Method::of(kind.name()).map(planned).filter(|order| order.check().is_ok());
        }
        self
    }

    /// Exposures of a camera's calibration in ms, from the metered or stated exposure; empty for other plans.
    /// `limits_s` are the camera's shortest and longest exposure in s.
    pub(crate) fn level_exposures_ms(&self, exposure: Duration, camera: &CameraInfo) -> Vec<f64> {
        let limits_s = camera.exposure_s;
        let [low, high] = LEVELS;
        let steps = self.levels().unwrap_or(0);
        let level = |k: u32| match steps - k {
            1 => SATURATED,
            _ => low + (high - low) * f64::from(k) / f64::from(steps.saturating_sub(2).max(1)),
        };
        let exposure_ms = |k: u32| {
            let seconds = (exposure.as_secs_f64() * level(k)).clamp(limits_s[0], limits_s[1]);
            let seconds = camera.at_most(seconds);
            // Whole microseconds.
            (1e6 * seconds).round() / 1e3
        };
        let mut all: Vec<f64> = (0..steps).map(exposure_ms).collect();
        // Exposures beyond the camera's limits, and between those that it offers, are equal.
        all.dedup();
        all
    }

    /// Checks the sections of a calibration, and the identifiers of stored ones.
    pub(super) fn check_calibration(&self) -> Result<(), String> {
        if let CalibrationsPlan::Listed(ids) = &self.calibrations
            && let Some(bad) = ids.iter().find(|id| !is_id(id))
        {
            return Err(format!("calibrations names {bad:?}; give identifiers of calibrations"));
        }
        let Some(plan) = self.calibration.filter(|_| self.kind == PlanKind::Calibration) else { return Ok(()) };
        let of = plan.of;
        if of == CalibrationKind::Orientation {
            return Err(
                "calibration.of is orientation; reconstruct a session of a known sample, then run `nacre calibrate \
                 orientation` on its results"
                    .into(),
            );
        }
        for (key, given, owner) in [
            ("levels", plan.levels.is_some(), CalibrationKind::Camera),
            ("darkness", plan.darkness.is_some(), CalibrationKind::Camera),
            ("frames", plan.frames.is_some(), CalibrationKind::Flat),
            ("crossed", plan.crossed.is_some(), CalibrationKind::Analyser),
        ] {
            if given && of != owner {
                return Err(format!("calibration.{key} does not belong to of = {}; remove it", of.name()));
            }
        }
        for (key, value, range) in [
            ("levels", plan.levels, 4..=MOST_LEVELS as u32),
            ("frames", plan.frames, 2..=256),
            ("crossed", plan.crossed, 0..=16),
        ] {
            if let Some(value) = value.filter(|value| !range.contains(value)) {
                return Err(format!("calibration.{key} is {value}; give {} to {}", range.start(), range.end()));
            }
        }
        if of == CalibrationKind::Camera && !self.extras.is_empty() {
            return Err(
                "extras does not belong to the calibration of a camera, which takes its dark frames; remove it".into(),
            );
        }
        if of == CalibrationKind::Camera && self.camera.average != 1 {
            return Err("camera.average must be 1 for the calibration of a camera, whose noise a mean hides".into());
        }
        let angles = self.analyser.as_ref().map_or_else(Vec::new, AnalyserPlan::known);
        match of {
            CalibrationKind::Camera | CalibrationKind::Flat if angles.len() > 1 => {
                Err(format!("analyser names several angles; give one for of = {}, or none", of.name()))
            }
            CalibrationKind::Analyser | CalibrationKind::Retarder if !angles.is_empty() && directions(&angles) < 3 => {
                Err("analyser.angles_deg needs three different directions or more; give a full turn".into())
            }
            _ => Ok(()),
        }
    }
}

/// An angle in degrees to the resolution of stages.
pub(super) fn thousandths(angle_deg: f64) -> f64 {
    (1000.0 * angle_deg).round() / 1000.0
}

/// Number of different directions of a transmission axis, to a thousandth of a degree.
fn directions(angles_deg: &[f64]) -> usize {
    let mut all: Vec<i64> =
        angles_deg.iter().map(|a| (1000.0 * a.rem_euclid(180.0)).round() as i64 % 180_000).collect();
    all.sort_unstable();
    all.dedup();
    all.len()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::steps::tests::DOCUMENTED;

    #[test]
    fn calibrations_are_checked_by_key() {
        for (text, word) in [
            ("", "calibration is missing"),
            ("calibration = { of = \"orientation\" }", "nacre calibrate orientation"),
            ("calibration = { of = \"flat\", levels = 4 }", "calibration.levels"),
            ("calibration = { of = \"camera\", levels = 3 }", "calibration.levels"),
            ("calibration = { of = \"flat\", frames = 1 }", "calibration.frames"),
            ("calibration = { of = \"retarder\", crossed = 2 }", "calibration.crossed"),
            ("calibration = { of = \"camera\" }\ncamera = { average = 2 }", "camera.average"),
            ("calibration = { of = \"camera\" }\nextras = [\"dark\"]", "extras"),
            ("calibration = { of = \"flat\" }\nanalyser = { angles_deg = [0, 90] }", "several angles"),
            ("calibration = { of = \"retarder\" }\nanalyser = { angles_deg = [0, 90, 180] }", "three different"),
            ("calibration = { of = \"retarder\" }\nexposures_ms = [1, 2]", "exposures_ms"),
            ("calibration = { of = \"flat\" }\nreconstruct = { operation = \"camera\" }", "reconstruct.operation"),
            ("calibration = { of = \"flat\" }\ncalibrations = [\"../x\"]", "calibrations"),
        ] {
            let plan: Plan = toml::from_str(&format!("kind = \"calibration\"\n{text}")).unwrap();
            let problem = plan.check_values().unwrap_err();
            assert!(problem.contains(word), "{text}: {problem}");
        }
        let other = format!("{DOCUMENTED}\ncalibration = {{ of = \"flat\" }}");
        assert!(toml::from_str::<Plan>(&other).unwrap().check_values().unwrap_err().contains("calibration"));
        for text in ["\"off\"", "\"auto\"", "[\"01ARZ3NDEKTSV4RRFFQ69G5FAV\"]"] {
            let plan: Plan = toml::from_str(&format!("calibrations = {text}\n{DOCUMENTED}")).unwrap();
            let again: Plan = serde_json::from_value(serde_json::to_value(&plan).unwrap()).unwrap();
            assert_eq!((plan.check_values(), &again), (Ok(()), &plan));
        }
        let wrong = toml::from_str::<Plan>(&format!("calibrations = \"on\"\n{DOCUMENTED}")).unwrap_err().to_string();
        assert!(wrong.contains("\"off\""), "{wrong}");
    }
}

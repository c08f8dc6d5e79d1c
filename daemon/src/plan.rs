//! Capture plans: data that says what to show, rotate and expose, checked and estimated before anything moves.

use nacre_drivers::{CameraInfo, DisplayInfo, Pattern, StageInfo};
use nacre_processing::Error;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A capture plan (`plan.toml`).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// What is varied.
    pub kind: PlanKind,
    /// Name of the session.
    #[serde(default)]
    pub name: String,
    /// What lies on the table.
    #[serde(default)]
    pub sample: String,
    /// Who measures.
    #[serde(default)]
    pub operator: String,
    /// Anything else.
    #[serde(default)]
    pub notes: String,
    /// Camera settings.
    #[serde(default)]
    pub camera: CameraPlan,
    /// What the panel shows.
    #[serde(default)]
    pub display: DisplayPlan,
    /// Angles of the analyser.
    pub analyser: AnalyserPlan,
    /// Frames taken besides.
    #[serde(default)]
    pub extras: Vec<Extra>,
    /// What to make of the frames at once, in the session's `results/`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reconstruct: Option<ReconstructPlan>,
}

/// A reconstruction that follows the capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReconstructPlan {
    /// Which reconstruction.
    pub method: PlanKind,
    /// Which model.
    #[serde(default)]
    pub model: ModelPlan,
}

/// Models of a polarization reconstruction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ModelPlan {
    /// The simplest that explains the data.
    #[default]
    Auto,
    /// The phase is the orientation.
    Sinusoid,
}

/// What a plan varies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PlanKind {
    /// The angle of the analyser.
    Polarization,
}

/// Camera settings of a plan.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CameraPlan {
    /// Exposure time in ms; metered over the whole turn of the analyser when it is not given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure_ms: Option<f64>,
    /// `"meter"` says so in words.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub exposure: Option<ExposureMode>,
    /// Gain.
    pub gain: f64,
    /// Frames averaged at each angle, 1 to 16.
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
    /// Diameter of the disc in mm.
    pub diameter_mm: f64,
}

/// Patterns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PatternKind {
    /// A white disc in the middle of the panel.
    Disc,
}

/// Angles of the analyser.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AnalyserPlan {
    /// Degrees, in the order they are taken.
    pub angles_deg: Vec<f64>,
}

/// Frames besides the series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Extra {
    /// With the panel black: ambient light and dark current, subtracted by the reconstruction.
    DisplayBlack,
}

impl Default for CameraPlan {
    fn default() -> Self {
        Self { exposure_ms: None, exposure: None, gain: 1.0, average: 1, roi: None }
    }
}

impl Default for DisplayPlan {
    fn default() -> Self {
        Self { pattern: PatternKind::Disc, diameter_mm: 180.0 }
    }
}

/// One step: a pattern, an angle, and the file its frame goes to.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// What the panel shows.
    pub pattern: Pattern,
    /// Analyser angle in degrees.
    pub analyser_deg: f64,
    /// File in the session folder.
    pub file: String,
    /// None for a frame of the series.
    pub extra: Option<Extra>,
}

/// Time and disk that a session needs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Estimate {
    /// Frames stored.
    pub frames: usize,
    /// Time that the devices need, in seconds, without metering.
    pub seconds: f64,
    /// Largest size of the frames in bytes (uncompressed).
    pub bytes: u64,
}

impl Plan {
    /// Reads and checks a plan file, apart from device limits.
    ///
    /// # Errors
    /// `Input`, naming the file and key.
    pub fn read(path: &Path) -> Result<Self, Error> {
        const LIMIT: u64 = 16 << 20;
        let bad = |problem: String| Error::file(path, problem, "correct the plan; `nacre schema plan` lists its keys");
        let size = std::fs::metadata(path).map_err(|e| bad(format!("cannot be read: {e}")))?.len();
        if size > LIMIT {
            return Err(bad(format!("has {size} bytes, at most {LIMIT} are read")));
        }
        let text = std::fs::read_to_string(path).map_err(|e| bad(format!("cannot be read: {e}")))?;
        let plan: Self = toml::from_str(&text).map_err(|e| bad(e.to_string().trim_end().to_owned()))?;
        plan.check_values().map_err(bad)?;
        Ok(plan)
    }

    /// Checks every number, apart from device limits.
    ///
    /// # Errors
    /// A sentence that names the key, what was found and what is allowed.
    pub fn check_values(&self) -> Result<(), String> {
        let angles = &self.analyser.angles_deg;
        if angles.is_empty() || angles.len() > 100_000 {
            return Err(format!("analyser.angles_deg holds {} angles; give 1 to 100000", angles.len()));
        }
        if let Some(bad) = angles.iter().find(|a| !a.is_finite() || a.abs() > 36_000.0) {
            return Err(format!("analyser.angles_deg holds {bad}; give finite degrees"));
        }
        let positive = |key: &str, value: f64| match value.is_finite() && value > 0.0 {
            true => Ok(()),
            false => Err(format!("{key} is {value}; give a number above 0")),
        };
        positive("camera.gain", self.camera.gain)?;
        positive("camera.exposure_ms", self.camera.exposure_ms.unwrap_or(1.0))?;
        positive("display.diameter_mm", self.display.diameter_mm)?;
        if self.camera.exposure_ms.is_some() && self.camera.exposure.is_some() {
            return Err("camera.exposure and camera.exposure_ms are both given; keep one".into());
        }
        match self.camera.average {
            1..=16 => Ok(()),
            n => Err(format!("camera.average is {n}; give 1 to 16")),
        }
    }

    /// Checks the plan against the devices' limits.
    ///
    /// # Errors
    /// One sentence for each key that asks too much.
    pub fn check_limits(&self, camera: &CameraInfo, display: &DisplayInfo) -> Vec<String> {
        let mut problems = vec![];
        let mut within = |key: &str, value: f64, [low, high]: [f64; 2], device: &str| {
            if !(low..=high).contains(&value) {
                problems.push(format!("{key} is {value}, but the {device} takes {low} to {high}"));
            }
        };
        if let Some(ms) = self.camera.exposure_ms {
            within("camera.exposure_ms", ms, camera.exposure_s.map(|s| 1000.0 * s), &camera.id);
        }
        within("camera.gain", self.camera.gain, camera.gain, &camera.id);
        within("display.diameter_mm", self.display.diameter_mm, [0.0, display.largest_disc_mm], &display.id);
        if let Some([left, top, width, height]) = self.camera.roi {
            let fits = |start: u32, size: u32, all: usize| size > 0 && u64::from(start) + u64::from(size) <= all as u64;
            if !fits(left, width, camera.width) || !fits(top, height, camera.height) {
                problems.push(format!(
                    "camera.roi is [{left}, {top}, {width}, {height}], but the {} has {} × {} pixels",
                    camera.id, camera.width, camera.height
                ));
            }
        }
        problems
    }

    /// The steps in order.
    pub fn steps(&self) -> Vec<Step> {
        let disc = Pattern::Disc(self.display.diameter_mm);
        let series = self.analyser.angles_deg.iter().enumerate().map(|(i, &analyser_deg)| Step {
            pattern: disc,
            analyser_deg,
            file: format!("frames/{i:04}.png"),
            extra: None,
        });
        let last = self.analyser.angles_deg.last().copied().unwrap_or_default();
        let extras = self.extras.iter().map(|extra| match extra {
            Extra::DisplayBlack => Step {
                pattern: Pattern::Black,
                analyser_deg: last,
                file: "frames/display_black.png".into(),
                extra: Some(*extra),
            },
        });
        series.chain(extras).collect()
    }

    /// Time and disk for a session with this exposure time (s): the engine's own timeline. The camera runs freely, so
    /// a fresh frame begins at the first of its beats after stage and panel stand still.
    pub fn estimate(&self, exposure_s: f64, camera: &CameraInfo, stage: &StageInfo) -> Estimate {
        let (old, beat) = (camera.exposure_now_s + camera.readout_s, exposure_s + camera.readout_s);
        // Controls act after the lag, in frames of the old exposure; the first frame after that is the first used.
        let adopted = f64::from(camera.control_lag_frames) * old;
        let mut seconds = stage.settling_s.max(old);
        let mut angle = 0.0;
        for step in self.steps() {
            for stop in crate::engine::approach(angle, step.analyser_deg) {
                seconds += (stop - angle).abs() / stage.speed_deg_s + stage.settling_s;
                angle = stop;
            }
            let begin = adopted + beat * ((seconds - adopted) / beat).ceil().max(1.0);
            seconds = begin + f64::from(self.camera.average) * beat;
        }
        let pixels = self.camera.roi.map_or(camera.width * camera.height, |[_, _, w, h]| w as usize * h as usize);
        let frames = self.steps().len();
        Estimate { frames, seconds, bytes: (frames * pixels * 2) as u64 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The plan of the documentation.
    const DOCUMENTED: &str = r#"
        kind = "polarization"
        name = "kinematic tile, first look"
        camera = { exposure_ms = 40, gain = 1.0, average = 1, roi = [0, 0, 1024, 1024] }
        display = { pattern = "disc", diameter_mm = 180 }
        analyser = { angles_deg = [0, 15, 30, 45, 60, 75, 90, 105, 120, 135, 150, 165] }
        extras = ["display_black"]
        reconstruct = { method = "polarization", model = "auto" }
    "#;

    #[test]
    fn the_documented_plan_compiles_to_its_steps() {
        let plan: Plan = toml::from_str(DOCUMENTED).unwrap();
        plan.check_values().unwrap();
        let steps = plan.steps();
        assert_eq!(steps.len(), 13);
        assert_eq!((steps[3].analyser_deg, steps[3].file.as_str()), (45.0, "frames/0003.png"));
        assert_eq!(steps[12].pattern, Pattern::Black);
    }

    #[test]
    fn wrong_plans_are_refused_by_key() {
        for (from, to, word) in [
            ("average = 1", "average = 0", "camera.average"),
            ("gain = 1.0", "gain = -1", "camera.gain"),
            ("[0, 15,", "[nan, 15,", "angles_deg"),
            ("gain = 1.0", "exposure = \"meter\"", "camera.exposure"),
            ("diameter_mm = 180", "diameter_mm = inf", "display.diameter_mm"),
        ] {
            let plan: Plan = toml::from_str(&DOCUMENTED.replace(from, to)).unwrap();
            assert!(plan.check_values().unwrap_err().contains(word));
        }
        assert!(toml::from_str::<Plan>(&DOCUMENTED.replace("extras", "extra")).is_err());
    }
}

//! What is measured: a knob, scenes, and how one setting is run on one scene.

use nacre_base::Result;
use nacre_plot::Scale;
use serde::{Deserialize, Serialize};

/// A quantity with its unit.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Axis {
    /// As a reader knows it.
    pub name: String,
    /// Unit; empty for a pure number.
    pub unit: String,
    /// How it is drawn.
    pub scale: Scale,
}

impl Axis {
    /// Drawn evenly.
    pub fn linear(name: &str, unit: &str) -> Self {
        Self { name: name.into(), unit: unit.into(), scale: Scale::Linear }
    }

    /// Drawn by its logarithm.
    pub fn log(name: &str, unit: &str) -> Self {
        Self { name: name.into(), unit: unit.into(), scale: Scale::Log }
    }

    /// Cases with names.
    pub fn names(name: &str) -> Self {
        Self { name: name.into(), unit: String::new(), scale: Scale::Names }
    }

    /// Name and unit as an axis' title: `film retardance Δn (°)`.
    pub fn title(&self) -> String {
        if self.unit.is_empty() { self.name.clone() } else { format!("{} ({})", self.name, self.unit) }
    }
}

/// One setting of the knob.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setting {
    /// The method whose knob it is; settings of one method are joined by a line.
    pub method: String,
    /// Short, as it stands beside its point: `12 frames`.
    pub label: String,
    /// The knob's value.
    pub value: f64,
    /// What the program does when nobody asks for something else.
    pub default: bool,
    /// Also drawn against the stress; a picture carries about six.
    pub in_sweep: bool,
}

impl Setting {
    /// Neither default nor left out of the sweep.
    pub fn new(method: &str, label: impl Into<String>, value: f64) -> Self {
        Self { method: method.into(), label: label.into(), value, default: false, in_sweep: true }
    }

    /// The same, marked as the program's choice.
    pub fn as_default(self) -> Self {
        Self { default: true, ..self }
    }

    /// The same, measured against the stress but not drawn.
    pub fn without_sweep(self) -> Self {
        Self { in_sweep: false, ..self }
    }
}

/// One scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// Value of the stress; the position for scenes with names.
    pub value: f64,
    /// As it stands on the axis; empty for the value itself.
    pub label: String,
}

impl Scene {
    /// A scene that its stress describes.
    pub fn new(value: f64) -> Self {
        Self { value, label: String::new() }
    }

    /// The `position`-th scene with a name.
    pub fn named(position: usize, label: impl Into<String>) -> Self {
        Self { value: position as f64, label: label.into() }
    }
}

/// Result of one setting on one scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Error in the unit of [`Study::error`], over what was not masked. None when nothing was left.
    pub error: Option<f64>,
    /// Time of the method alone, without making the scene, in s per what [`Study::time`] says.
    pub seconds: f64,
    /// Share of pixels (or values) for which the method gave no answer, 0 to 1.
    pub masked: f64,
    /// Share of all pixels that were given an answer more than five of their own standard deviations off, 0 to 1: the
    /// one forbidden outcome.
    pub wrong: f64,
    /// The error that the method or theory says to expect, in the unit of the error.
    pub predicted: Option<f64>,
}

/// Runs a setting on a scene: `(setting, scene, seed)`, the first two as positions in the study's lists. For one seed, error
/// and shares must always come out the same.
pub type Run = Box<dyn Fn(usize, usize, u64) -> Result<Outcome> + Send + Sync>;

/// A method with a knob, on scenes of rising difficulty, against a reference.
pub struct Study {
    /// Name of its files and on the command line: letters, digits and `-`.
    pub name: &'static str,
    /// Studies that are asked for together: `polarimetry`, `stress`.
    pub group: &'static str,
    /// Title of the picture.
    pub title: String,
    /// What is asked, of which scene and against which reference, in a few sentences.
    pub question: String,
    /// What the settings vary.
    pub knob: Axis,
    /// What the scenes vary.
    pub stress: Axis,
    /// What is measured.
    pub error: Axis,
    /// What the time is for: `time per megapixel`.
    pub time: Axis,
    /// What [`Outcome::predicted`] is, for the legend; empty for none.
    pub predicted: &'static str,
    /// The settings, at least five for a knob with a number.
    pub settings: Vec<Setting>,
    /// The scenes.
    pub scenes: Vec<Scene>,
    /// The scene on which time and error are set against each other.
    pub reference: usize,
    /// How a setting is run.
    pub run: Run,
}

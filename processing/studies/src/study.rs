//! Definition of a study: parameter, scenes, and a function that runs a setting on a scene.

use nacre_base::Result;
use nacre_plot::Scale;
use serde::{Deserialize, Serialize};

/// A quantity with its unit.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Axis {
    /// Name, as shown to the reader.
    pub name: String,
    /// Unit; empty for a pure number.
    pub unit: String,
    /// Scale of the axis.
    pub scale: Scale,
}

impl Axis {
    /// An axis of linear scale.
    pub fn linear(name: &str, unit: &str) -> Self {
        Self { name: name.into(), unit: unit.into(), scale: Scale::Linear }
    }

    /// An axis of logarithmic scale.
    pub fn log(name: &str, unit: &str) -> Self {
        Self { name: name.into(), unit: unit.into(), scale: Scale::Log }
    }

    /// An axis of named cases.
    pub fn names(name: &str) -> Self {
        Self { name: name.into(), unit: String::new(), scale: Scale::Names }
    }

    /// Name and unit as an axis title: `film retardance Δn (°)`.
    pub fn title(&self) -> String {
        if self.unit.is_empty() { self.name.clone() } else { format!("{} ({})", self.name, self.unit) }
    }
}

/// One setting of the parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Setting {
    /// Method of the setting; a line joins the settings of one method.
    pub method: String,
    /// Short label beside its point: `12 frames`.
    pub label: String,
    /// Value of the parameter.
    pub value: f64,
    /// Whether it is the program's default.
    pub default: bool,
    /// Whether it is drawn against the stress; a picture has room for about six.
    pub in_sweep: bool,
}

impl Setting {
    /// A setting that is drawn in the sweep and is not the default.
    pub fn new(method: &str, label: impl Into<String>, value: f64) -> Self {
        Self { method: method.into(), label: label.into(), value, default: false, in_sweep: true }
    }

    /// Marks the setting as the program's default.
    pub fn as_default(self) -> Self {
        Self { default: true, ..self }
    }

    /// Excludes the setting from the picture of the sweep; it is still measured.
    pub fn without_sweep(self) -> Self {
        Self { in_sweep: false, ..self }
    }
}

/// One scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scene {
    /// Value of the stress; the position for named scenes.
    pub value: f64,
    /// Label on the axis; empty to print the value.
    pub label: String,
}

impl Scene {
    /// A scene described by its stress value.
    pub fn new(value: f64) -> Self {
        Self { value, label: String::new() }
    }

    /// The `position`-th named scene.
    pub fn named(position: usize, label: impl Into<String>) -> Self {
        Self { value: position as f64, label: label.into() }
    }
}

/// Result of one setting on one scene.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Outcome {
    /// Error in the unit of [`Study::error`], over the unmasked pixels; `None` if all are masked.
    pub error: Option<f64>,
    /// Time of the method without the rendering of the scene, in s per unit of [`Study::time`].
    pub seconds: f64,
    /// Fraction of pixels (or values) for which the method gave no result, 0 to 1.
    pub masked: f64,
    /// Fraction of all pixels whose error exceeds five of their σ, 0 to 1. Such confidently wrong results must not
    /// occur.
    pub wrong: f64,
    /// Error predicted by the method or by theory, in the unit of the error.
    pub predicted: Option<f64>,
}

/// Runs a setting on a scene: `(setting, scene, seed)`, the first two as positions in the study's lists. Error and
/// fractions must be reproducible for a seed.
pub type Run = Box<dyn Fn(usize, usize, u64) -> Result<Outcome> + Send + Sync>;

/// A method with a parameter, on scenes of increasing difficulty, against a reference.
pub struct Study {
    /// Name of its files and on the command line: letters, digits and `-`.
    pub name: &'static str,
    /// Group of studies that are requested together: `polarimetry`, `stress`.
    pub group: &'static str,
    /// Title of the picture.
    pub title: String,
    /// Question, scene and reference of the study, in a few sentences.
    pub question: String,
    /// The parameter varied by the settings.
    pub knob: Axis,
    /// The quantity varied by the scenes.
    pub stress: Axis,
    /// The measured error.
    pub error: Axis,
    /// Quantity of the time axis: `time per megapixel`.
    pub time: Axis,
    /// Name of [`Outcome::predicted`] in the legend; empty for none.
    pub predicted: &'static str,
    /// The settings, at least five for a numeric parameter.
    pub settings: Vec<Setting>,
    /// The scenes.
    pub scenes: Vec<Scene>,
    /// The scene of the time-against-error panel.
    pub reference: usize,
    /// Runs a setting on a scene.
    pub run: Run,
}

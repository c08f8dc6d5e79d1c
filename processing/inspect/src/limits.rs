//! Limits of a good sheet: a TOML file, written by training and edited by hand.

use crate::defect::{Class, Defect};
use crate::report::{Differs, SheetReport};
use nacre_base::text::{from_toml, read_text};
use nacre_base::{Error, Result, Version};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// Maximum size of a file of limits.
const MOST_BYTES: u64 = 1 << 20;

/// Smallest number of good samples from which limits follow.
pub const LEAST_SAMPLES: usize = 3;

/// Limits of sheet-wide differences are the mean of good samples and this many standard deviations.
const SPREAD: f64 = 4.0;

/// Smallest relative margin of trained limits above the largest good sample.
const MARGIN: f64 = 1.25;

/// Euler's constant, the mean of the standard Gumbel distribution.
const EULER: f64 = 0.577_215_664_901_532_9;

/// Limits of a good sheet. Omitted quantities are not limited.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Limits {
    /// Version of the format.
    pub version: Version<1>,
    /// Smallest difference of a defect in standard deviations; it applies if it exceeds that of normal noise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub threshold: Option<f64>,
    /// Accepted false alarms per sheet for which the threshold was trained.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub false_alarms: Option<f64>,
    /// Number of good samples behind the limits; 0 if written by hand.
    pub samples: usize,
    /// Limits of the sheet as a whole.
    pub sheet: SheetLimits,
    /// Limits of defects by class.
    pub defects: BTreeMap<Class, ClassLimits>,
}

/// Limits of differences over the whole sheet.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct SheetLimits {
    /// Smallest share of the reference that the sample must show.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub min_overlap: Option<f64>,
    /// Largest root mean square difference of orientations in degrees.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_orientation_deg: Option<f64>,
    /// Largest root mean square difference of the degree of polarization.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_presence: Option<f64>,
    /// Largest root mean square difference of the logarithm of the brightness.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_brightness: Option<f64>,
    /// Largest root mean square difference of the logarithm of the period.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_period: Option<f64>,
}

/// Limits of the defects of one class.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ClassLimits {
    /// Largest number of defects.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_count: Option<usize>,
    /// Largest area of one defect in pixels of the reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_area_px: Option<f64>,
    /// Largest area of one defect in mm².
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_area_mm2: Option<f64>,
    /// Largest length of one defect in mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub max_length_mm: Option<f64>,
}

impl Default for Limits {
    fn default() -> Self {
        let none = ClassLimits { max_count: Some(0), ..ClassLimits::default() };
        Self {
            version: Version,
            threshold: None,
            false_alarms: None,
            samples: 0,
            sheet: SheetLimits::default(),
            defects: Class::ALL.map(|class| (class, none.clone())).into(),
        }
    }
}

impl Limits {
    /// Reads a TOML file.
    ///
    /// # Errors
    /// `Input`, naming file and key.
    pub fn read(path: &Path) -> Result<Self> {
        let remedy = "give a limits.toml of `nacre inspect --train`";
        let text = read_text(path, MOST_BYTES, remedy)?;
        let limits: Self = from_toml(&text).map_err(|problem| Error::file(path, problem, remedy))?;
        let unsound = limits.threshold.is_some_and(|t| !(t > 0.0 && t < 1e6));
        if unsound {
            return Err(Error::file(path, "threshold: is no positive number", remedy));
        }
        Ok(limits)
    }

    /// Limits from good samples.
    ///
    /// The largest differences exceed the threshold on a fraction `false_alarms` of sheets, if they follow a Gumbel
    /// distribution (fitted by its moments). No defect is allowed. Sheet-wide differences may lie four standard
    /// deviations above their mean.
    ///
    /// # Errors
    /// `Input` for too few samples.
    pub fn trained(good: &[SheetReport], false_alarms: f64) -> Result<Self> {
        if good.len() < LEAST_SAMPLES {
            let problem = format!("has {} readable good samples", good.len());
            return Err(Error::input("--train", problem, format!("give at least {LEAST_SAMPLES} good samples")));
        }
        let largest: Vec<f64> = good.iter().map(|s| s.largest_deviation).collect();
        let [mean, deviation] = moments(&largest);
        // Moments of few samples are uncertain: one standard error of the mean is added.
        let scale = deviation * 6.0_f64.sqrt() / std::f64::consts::PI;
        let mode = mean - EULER * scale + deviation / (good.len() as f64).sqrt();
        let gumbel = mode - scale * false_alarms.clamp(1e-9, 1.0).ln();
        let top = largest.iter().copied().fold(0.0, f64::max);
        let limit = |of: &dyn Fn(&SheetReport) -> Option<Differs>| {
            let all: Vec<f64> = good.iter().filter_map(of).map(|d| d.rms).collect();
            (all.len() == good.len()).then(|| {
                let [mean, deviation] = moments(&all);
                (mean + SPREAD * deviation).max(MARGIN * all.iter().copied().fold(0.0, f64::max))
            })
        };
        Ok(Self {
            threshold: Some(gumbel.max(top)),
            false_alarms: Some(false_alarms),
            samples: good.len(),
            sheet: SheetLimits {
                min_overlap: None,
                max_orientation_deg: limit(&|s| s.differences.orientation_deg),
                max_presence: limit(&|s| s.differences.presence),
                max_brightness: limit(&|s| s.differences.brightness),
                max_period: limit(&|s| s.differences.period),
            },
            ..Self::default()
        })
    }

    /// Limits that a sheet exceeds, one sentence each; empty for a good sheet.
    pub fn exceeded(&self, sheet: &SheetReport) -> Vec<String> {
        let mut found = vec![];
        let mut over = |name: &str, value: Option<f64>, most: Option<f64>, unit: &str| {
            if let (Some(value), Some(most)) = (value, most)
                && value > most
            {
                found.push(format!("{name} {value:.3}{unit} exceeds {most:.3}{unit}"));
            }
        };
        let (differences, limits) = (&sheet.differences, &self.sheet);
        let rms = |d: &Option<Differs>| d.as_ref().map(|d| d.rms);
        over("orientation difference", rms(&differences.orientation_deg), limits.max_orientation_deg, "°");
        over("presence difference", rms(&differences.presence), limits.max_presence, "");
        over("brightness difference", rms(&differences.brightness), limits.max_brightness, "");
        over("period difference", rms(&differences.period), limits.max_period, "");
        if let Some(least) = limits.min_overlap.filter(|least| sheet.registration.overlap < *least) {
            found.push(format!(
                "the sample shows {:.3} of the reference, less than {least:.3}",
                sheet.registration.overlap
            ));
        }
        for (class, limits) in &self.defects {
            let all: Vec<&Defect> = sheet.defects.iter().filter(|d| d.class == *class).collect();
            if let Some(most) = limits.max_count.filter(|most| all.len() > *most) {
                found.push(format!("{} of class {}, more than {most}", counted(all.len()), class.label()));
            }
            let largest = |of: &dyn Fn(&Defect) -> Option<f64>| all.iter().filter_map(|d| of(d)).reduce(f64::max);
            let mut over = |name: &str, value: Option<f64>, most: Option<f64>, unit: &str| {
                if let (Some(value), Some(most)) = (value, most)
                    && value > most
                {
                    found.push(format!(
                        "{} of {value:.3} {unit}, class {}, exceeds {most:.3} {unit}",
                        name,
                        class.label()
                    ));
                }
            };
            over("area", largest(&|d| Some(d.area_px)), limits.max_area_px, "pixels");
            over("area", largest(&|d| d.area_mm2), limits.max_area_mm2, "mm²");
            over("length", largest(&|d| d.size_mm.map(|s| s[0])), limits.max_length_mm, "mm");
        }
        found
    }

    /// The file's text.
    pub fn to_toml(&self) -> String {
        let head = "# Limits of good sheets for `nacre inspect --limits`. Lines that are deleted limit nothing.\n";
        format!("{head}{}", toml::to_string(self).unwrap_or_default())
    }
}

fn counted(count: usize) -> String {
    if count == 1 { "1 defect".into() } else { format!("{count} defects") }
}

/// Mean and standard deviation.
fn moments(values: &[f64]) -> [f64; 2] {
    let n = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / n;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    [mean, variance.sqrt()]
}

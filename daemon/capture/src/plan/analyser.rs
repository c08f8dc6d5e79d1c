//! Analyser angles: listed, or adaptive until a required σ.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Maximum number of angles of an adaptive series.
const MOST: u32 = 360;

/// Angles of the analyser: `{ angles_deg = [0, 60, 120] }`, or `{ start = 4, until_sigma_deg = 0.3, at_most = 24 }`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Keys", into = "Keys")]
pub enum AnalyserPlan {
    /// Angles in degrees, in order of capture.
    Listed(Vec<f64>),
    /// Adaptive series: each angle is added where it reduces σ most.
    Until(UntilSigma),
}

/// A series that ends at a required σ of the orientation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct UntilSigma {
    /// Number of initial angles, evenly spaced over 180°.
    pub start: u32,
    /// Required σ of the orientation in degrees, for 90 % of the pixels with an orientation.
    pub until_sigma_deg: f64,
    /// Maximum number of angles.
    pub at_most: u32,
}

/// Angles of the analyser: `angles_deg`, or `until_sigma_deg` with `start` and `at_most`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Keys {
    /// Angles in degrees, in order of capture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    angles_deg: Option<Vec<f64>>,
    /// Instead of a list: required σ of the orientation in degrees. Angles are added, each where it reduces σ most,
    /// until 90 % of the pixels with an orientation meet it. Kind polarization only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    until_sigma_deg: Option<f64>,
    /// Number of initial angles, evenly spaced over 180° (default 4).
    #[schemars(range(min = 3, max = 360))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    start: Option<u32>,
    /// Maximum number of angles (default 24).
    #[schemars(range(min = 3, max = 360))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    at_most: Option<u32>,
}

impl TryFrom<Keys> for AnalyserPlan {
    type Error = String;

    fn try_from(keys: Keys) -> Result<Self, String> {
        match (keys.angles_deg, keys.until_sigma_deg) {
            (Some(angles), None) if keys.start.is_none() && keys.at_most.is_none() => Ok(Self::Listed(angles)),
            (Some(_), None) => Err("analyser.start and at_most belong to until_sigma_deg; remove them".into()),
            (None, Some(until_sigma_deg)) => {
                let (start, at_most) = (keys.start.unwrap_or(4), keys.at_most.unwrap_or(24));
                Ok(Self::Until(UntilSigma { start, until_sigma_deg, at_most }))
            }
            (Some(_), Some(_)) => Err("analyser.angles_deg and until_sigma_deg are both given; keep one".into()),
            (None, None) => Err("analyser has no angles; give angles_deg or until_sigma_deg".into()),
        }
    }
}

impl From<AnalyserPlan> for Keys {
    fn from(plan: AnalyserPlan) -> Self {
        match plan {
            AnalyserPlan::Listed(angles) => Self { angles_deg: Some(angles), ..Self::default() },
            AnalyserPlan::Until(UntilSigma { start, until_sigma_deg, at_most }) => Self {
                until_sigma_deg: Some(until_sigma_deg),
                start: Some(start),
                at_most: Some(at_most),
                ..Self::default()
            },
        }
    }
}

impl JsonSchema for AnalyserPlan {
    fn schema_name() -> std::borrow::Cow<'static, str> {
        "AnalyserPlan".into()
    }

    fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
        Keys::json_schema(generator)
    }
}

impl AnalyserPlan {
    /// Angles captured in any case, in degrees.
    pub fn known(&self) -> Vec<f64> {
        match self {
            Self::Listed(angles) => angles.clone(),
            Self::Until(until) => (0..until.start).map(|k| 180.0 * f64::from(k) / f64::from(until.start)).collect(),
        }
    }

    /// Maximum number of angles.
    pub fn most(&self) -> usize {
        match self {
            Self::Listed(angles) => angles.len(),
            Self::Until(until) => until.at_most as usize,
        }
    }
}

impl UntilSigma {
    /// Validates all numbers.
    ///
    /// # Errors
    /// A sentence with the key, the value and the permitted range.
    pub(super) fn check(&self) -> Result<(), String> {
        let Self { start, until_sigma_deg, at_most } = *self;
        if !(until_sigma_deg.is_finite() && until_sigma_deg > 0.0) {
            return Err(format!("analyser.until_sigma_deg is {until_sigma_deg}; give degrees above 0"));
        }
        if !(3..=MOST).contains(&at_most) {
            return Err(format!("analyser.at_most is {at_most}; give 3 to {MOST}"));
        }
        if !(3..=at_most).contains(&start) {
            return Err(format!("analyser.start is {start}; give 3 to at_most, which is {at_most}"));
        }
        Ok(())
    }

    /// Representative additional angles for estimates, spread by the golden ratio, in whole degrees.
    pub(super) fn likely(&self) -> Vec<f64> {
        let golden = 0.5 * (5f64.sqrt() - 1.0);
        (self.start..self.at_most).map(|k| (180.0 * (f64::from(k) * golden).fract()).floor()).collect()
    }
}

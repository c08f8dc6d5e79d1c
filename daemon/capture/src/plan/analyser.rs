//! Which angles the analyser takes: as listed, or as many as the wanted σ needs.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Most angles of a series that ends by its σ.
const MOST: u32 = 360;

/// Angles of the analyser: `{ angles_deg = [0, 60, 120] }`, or `{ start = 4, until_sigma_deg = 0.3, at_most = 24 }`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Keys", into = "Keys")]
pub enum AnalyserPlan {
    /// Degrees, in the order they are taken.
    Listed(Vec<f64>),
    /// As many as it takes, each where it helps most.
    Until(UntilSigma),
}

/// A series that ends when the orientation is known well enough.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct UntilSigma {
    /// Angles at the beginning, evenly over 180°.
    pub start: u32,
    /// Wanted σ of the orientation in degrees: 90 % of the pixels that carry an orientation are to be as good.
    pub until_sigma_deg: f64,
    /// Most angles.
    pub at_most: u32,
}

/// Angles of the analyser: `angles_deg`, or `until_sigma_deg` with `start` and `at_most`.
#[derive(Clone, Debug, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(super) struct Keys {
    /// Degrees, in the order they are taken.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    angles_deg: Option<Vec<f64>>,
    /// In place of a list: wanted σ of the orientation in degrees. Angles are added, each where it lowers σ most, until 90 %
    /// of the pixels that carry an orientation are as good. Kind polarization only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    until_sigma_deg: Option<f64>,
    /// Angles to begin with, evenly over 180° (default 4).
    #[schemars(range(min = 3, max = 360))]
    #[serde(default, skip_serializing_if = "Option::is_none")]
    start: Option<u32>,
    /// Most angles (default 24).
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
    /// Angles that are taken in any case, in degrees.
    pub fn known(&self) -> Vec<f64> {
        match self {
            Self::Listed(angles) => angles.clone(),
            Self::Until(until) => (0..until.start).map(|k| 180.0 * f64::from(k) / f64::from(until.start)).collect(),
        }
    }

    /// Most angles.
    pub fn most(&self) -> usize {
        match self {
            Self::Listed(angles) => angles.len(),
            Self::Until(until) => until.at_most as usize,
        }
    }
}

impl UntilSigma {
    /// Checks every number.
    ///
    /// # Errors
    /// A sentence that names the key, what was found and what is allowed.
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

    /// Angles like those that will be added, for estimates: how many, spread by the golden section, in whole degrees.
    pub(super) fn likely(&self) -> Vec<f64> {
        let golden = 0.5 * (5f64.sqrt() - 1.0);
        (self.start..self.at_most).map(|k| (180.0 * (f64::from(k) * golden).fract()).floor()).collect()
    }
}

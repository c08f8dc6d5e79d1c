//! Illumination of the sample.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Illumination of the sample.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Illumination {
    /// Not stated.
    #[default]
    Unknown,
    /// Display behind a quarter-wave retarder: circular polarization, which models of gratings require (2018 paper,
    /// section 5.1).
    CircularPanel,
    /// A bare LCD: linear polarization.
    LinearPanel,
    /// Other light: lamps, flash, daylight.
    Other,
}

impl Illumination {
    /// All kinds, with their names in files and options.
    pub const ALL: [(Self, &str); 4] = [
        (Self::Unknown, "unknown"),
        (Self::CircularPanel, "circular_panel"),
        (Self::LinearPanel, "linear_panel"),
        (Self::Other, "other"),
    ];

    pub(crate) fn is_unknown(&self) -> bool {
        *self == Self::Unknown
    }
}

impl std::str::FromStr for Illumination {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = Self::ALL.into_iter().find(|(_, name)| *name == text.replace('-', "_"));
        let known = || Self::ALL.map(|(_, name)| name).join(", ");
        found.map(|(light, _)| light).ok_or_else(|| format!("{text:?} is no illumination; give one of {}", known()))
    }
}

//! Effort of a measurement.

use serde::{Deserialize, Serialize};

/// Size of the scenes and number of runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Effort {
    /// Full-size scenes, as needed for conclusions.
    Full,
    /// Small scenes and three runs. Checks that a study works; its times are not representative.
    Quick,
}

impl Effort {
    /// Returns `full` or `quick`, according to the effort.
    pub fn pick<T>(self, full: T, quick: T) -> T {
        if self == Self::Full { full } else { quick }
    }
}

/// Conditions under which two measurements are comparable.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Plan {
    /// Seed of all scenes.
    pub seed: u64,
    /// Number of repetitions, each with different scenes.
    pub runs: usize,
    /// Effort.
    pub effort: Effort,
    /// Version of the measuring program; measurements of different builds are not mixed.
    pub version: String,
}

impl Plan {
    /// Five runs of full size.
    pub fn new(seed: u64, version: &str) -> Self {
        Self { seed, runs: 5, effort: Effort::Full, version: version.into() }
    }
}

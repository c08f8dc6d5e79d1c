//! How thoroughly a study is measured.

use serde::{Deserialize, Serialize};

/// How thorough.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Effort {
    /// For conclusions.
    Full,
    /// Small scenes and three runs: shows that everything works, says little about time.
    Quick,
}

impl Effort {
    /// `full`, or `quick` for a quick look.
    pub fn pick<T>(self, full: T, quick: T) -> T {
        if self == Self::Full { full } else { quick }
    }
}

/// What makes two measurements comparable.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Plan {
    /// Seed of all scenes.
    pub seed: u64,
    /// Repetitions, each with scenes of its own.
    pub runs: usize,
    /// How thorough.
    pub effort: Effort,
    /// The program that measures; measurements of different builds are not mixed.
    pub version: String,
}

impl Plan {
    /// Five runs of full size.
    pub fn new(seed: u64, version: &str) -> Self {
        Self { seed, runs: 5, effort: Effort::Full, version: version.into() }
    }
}

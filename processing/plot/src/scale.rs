//! Scales of axes.

use serde::{Deserialize, Serialize};

/// How a quantity is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scale {
    /// Evenly.
    Linear,
    /// By its logarithm.
    Log,
    /// Not a number: cases with names, in their order.
    Names,
}

//! Knowledge of a stage's zero, without which its angles are meaningless.

/// Validity of a stage's angles.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Zero {
    /// Not found by this program, or lost after an error.
    Unchecked,
    /// The stage restarted, lost steps, or was not at its last known position.
    Forgotten,
    /// Known at the start of a movement between these angles, in degrees; its end is unknown.
    Going { from: f64, to: f64 },
    /// Known, with the axis at this position after the last movement, in degrees.
    Known(f64),
}

impl Zero {
    /// The last known position, if there is one and it differs from the present one.
    pub(super) fn left_elsewhere(self, at_deg: f64, tolerance_deg: f64) -> Option<f64> {
        match self {
            Self::Known(left) if (at_deg - left).abs() > tolerance_deg => Some(left),
            _ => None,
        }
    }
}

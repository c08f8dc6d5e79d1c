//! What is known of a stage's zero, without which its angles mean nothing.

/// Whether a stage's angles can be believed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Zero {
    /// It was not found by this program, or not since something went wrong.
    Unchecked,
    /// The stage started anew, lost steps, or was not found where it was left.
    Forgotten,
    /// It was known when a movement from here to there began, in degrees; nothing is known of its end.
    Going { from: f64, to: f64 },
    /// It was found, and this is where the axis stood after the last movement, in degrees.
    Known(f64),
}

impl Zero {
    /// Where the axis was left, if that is known and not where it stands.
    pub(super) fn left_elsewhere(self, at_deg: f64, tolerance_deg: f64) -> Option<f64> {
        match self {
            Self::Known(left) if (at_deg - left).abs() > tolerance_deg => Some(left),
            _ => None,
        }
    }
}

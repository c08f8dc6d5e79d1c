//! Camera response: light as a function of file value, one curve per channel.

use nacre_base::text::{from_json, read_text};
use nacre_base::{Error, Result};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Number of knots of a curve: the codes of an 8-bit file.
pub(super) const KNOTS: usize = 256;

/// Maximum size of the file.
const MAX_BYTES: u64 = 1 << 20;

/// Response with 256 knots from black to white for each channel, piecewise linear between them. Light is 0 at black and
/// at most 1 at white; only its ratios are meaningful.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Response {
    /// One curve, or red, green and blue.
    pub curves: Vec<Vec<f32>>,
}

impl Response {
    /// Reads a `response.json` written by [`reconstruct`](super::reconstruct).
    ///
    /// # Errors
    /// `Input` for an unreadable or different file, and for curves that do not increase.
    pub fn read(path: &Path) -> Result<Self> {
        let remedy = "give the response.json of an earlier `nacre reconstruct hdr --response recover`";
        let bad = |problem: String| Error::file(path, problem, remedy);
        let text = read_text(path, MAX_BYTES, remedy)?;
        let response: Self = from_json(&text).map_err(bad)?;
        response.problem().map_or(Ok(response), |problem| Err(bad(problem)))
    }

    /// Reason why the response is invalid, if it is.
    fn problem(&self) -> Option<String> {
        if !matches!(self.curves.len(), 1 | 3) {
            return Some(format!("has {} curves; one or three are expected", self.curves.len()));
        }
        self.curves.iter().enumerate().find_map(|(c, curve)| {
            let rises = curve.windows(2).all(|w| w[0] < w[1]);
            let ends = curve.first() == Some(&0.0) && curve.last().is_some_and(|v| *v <= 1.0);
            (curve.len() != KNOTS || !rises || !ends)
                .then(|| format!("curve {c} does not rise from 0 to at most 1 over {KNOTS} knots"))
        })
    }

    /// Light at `position`, 0 (black) to 1 (white); extrapolated linearly outside.
    pub(super) fn light(&self, channel: usize, position: f64) -> f64 {
        let curve = &self.curves[channel.min(self.curves.len() - 1)];
        let at = position * (KNOTS - 1) as f64;
        let knot = (at.floor().max(0.0) as usize).min(KNOTS - 2);
        let (low, high) = (f64::from(curve[knot]), f64::from(curve[knot + 1]));
        low + (high - low) * (at - knot as f64)
    }
}

//! Period as a function of orientation.

use nacre_base::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Maximum number of table rows.
const MAX_ROWS: usize = 20_000;

/// Relation of period and orientation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "PeriodCurve")]
pub enum Curve {
    /// `min + (max - min) (θ/π)²` (2018 paper, section 6.4, Fig. 22a): both in µm.
    Quadratic([f64; 2]),
    /// `min + (max - min) sin²(θ/2)` in µm, from min at 0° to max at 180° (2018 paper, Fig. 22b).
    SineSquared([f64; 2]),
    /// Rows of orientation in degrees, increasing, and period in µm; linear interpolation, undefined outside.
    Table(Vec<[f64; 2]>),
}

impl Curve {
    /// Validates the curve.
    ///
    /// # Errors
    /// `Input` for periods outside of 0.01 to 10000 µm, and for orientations that do not increase within 0° to 180°.
    pub(super) fn checked(self) -> Result<Self> {
        let bad = |problem: String| {
            let remedy = "give periods of 0.01 to 10000 µm, at orientations that rise from 0° to 180°";
            Err(Error::input("period curve", problem, remedy))
        };
        let possible = |um: &f64| (0.01..=1e4).contains(um);
        match &self {
            Self::Quadratic(ends) | Self::SineSquared(ends) if !ends.iter().all(possible) => {
                bad(format!("has {ends:?}"))
            }
            Self::Table(rows) if rows.len() < 2 || rows.len() > MAX_ROWS => bad(format!("has {} rows", rows.len())),
            Self::Table(rows) => {
                let wrong = rows.iter().find(|[deg, um]| !((0.0..=180.0).contains(deg) && possible(um)));
                let falls = rows.windows(2).find(|w| w[0][0] >= w[1][0]).map(|w| &w[1]);
                match wrong.or(falls) {
                    Some([deg, um]) => bad(format!("has {um} µm at {deg}°")),
                    None => Ok(self),
                }
            }
            _ => Ok(self),
        }
    }

    /// Period in µm at an orientation in rad, and its derivative in µm per rad; `None` outside of a table.
    pub fn at(&self, theta: f64) -> Option<[f64; 2]> {
        match self {
            Self::Quadratic([a, b]) => {
                let t = theta / PI;
                Some([a + (b - a) * t * t, (b - a) * 2.0 * t / PI])
            }
            Self::SineSquared([a, b]) => {
                let s = (0.5 * theta).sin();
                Some([a + (b - a) * s * s, (b - a) * 0.5 * theta.sin()])
            }
            Self::Table(rows) => {
                let deg = theta.to_degrees();
                let next = rows.partition_point(|r| r[0] <= deg);
                let next = if next == rows.len() && rows[next - 1][0] == deg { next - 1 } else { next };
                let (&[x0, y0], &[x1, y1]) = (rows.get(next.checked_sub(1)?)?, rows.get(next)?);
                let slope = (y1 - y0) / (x1 - x0);
                Some([y0 + slope * (deg - x0), slope * 180.0 / PI])
            }
        }
    }
}

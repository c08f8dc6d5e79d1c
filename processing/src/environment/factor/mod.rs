//! Tables of low rank (2017 CVMP, section 4), done right: straightened, with (1 + ωi·ωo)² and the Jacobian folded in before the
//! factorisation, and with as many intermediate pictures as terms.

mod directions;
mod job;
mod parts;
mod report;
mod straight;
mod svd;

pub use job::{Job, factor};
pub use parts::{Kind, MOST_RANK, Part, Term};
pub use report::{PartReport, Report};
pub use straight::Grid;

use super::Table;
use crate::{Error, Result};
use directions::Pattern;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, PI};

/// More terms take two passes longer than the exact sum along azimuths takes (1024 × 512, 256² entries: 15).
const SEPARABLE: usize = 16;

/// Terms by which directions are compared.
const FEW: usize = 3;

/// What is asked of a factorisation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Terms per channel and part; as many as [`Self::max_error`] needs if not said.
    pub rank: Option<usize>,
    /// Largest norm of what is left out, over the table's.
    pub max_error: f64,
    /// Least angle between the two directions, radians.
    pub apart: f64,
    /// The two directions, radians, instead of those that are found.
    pub directions: Option<[f64; 2]>,
    /// Parts that are straightened each by itself, one per main direction.
    pub parts: usize,
    /// Which factorisation.
    pub kind: Kind,
}

impl Default for Settings {
    fn default() -> Self {
        let apart = FRAC_PI_3;
        Self { rank: None, max_error: 0.05, apart, directions: None, parts: 1, kind: Kind::Singular }
    }
}

impl Settings {
    /// Refuses what makes no sense.
    ///
    /// # Errors
    /// `Input`, which names the setting.
    pub fn check(&self) -> Result<()> {
        let bad = |what: &str, problem: String, remedy: String| Err(Error::input(what, problem, remedy));
        if let Some(rank) = self.rank.filter(|r| !(1..=MOST_RANK).contains(r)) {
            return bad("rank", format!("is {rank}"), format!("give 1 to {MOST_RANK}"));
        }
        if !(1e-6..1.0).contains(&self.max_error) {
            return bad("max-error", format!("is {}", self.max_error), "give 0.000001 to 1".into());
        }
        if !(0.02..=FRAC_PI_2 + 1e-6).contains(&self.apart) {
            return bad("min-angle-deg", format!("is {:.1}", self.apart.to_degrees()), "give 2 to 90°".into());
        }
        if let Some([a, b]) = self.directions
            && ((a - b).sin().abs() < 0.17 || !(a - b).is_finite())
        {
            let problem = format!("are {:.1}° and {:.1}°", a.to_degrees(), b.to_degrees());
            return bad("directions-deg", problem, "give two that are at least 10° apart".into());
        }
        if !(1..=6).contains(&self.parts) {
            return bad("parts", format!("are {}", self.parts), "give 1 to 6".into());
        }
        Ok(())
    }
}

/// A table as a sum of products.
#[derive(Clone, Debug)]
pub struct Factors {
    /// Parts that add up to it.
    pub parts: Vec<Part>,
    /// Terms of each channel that each part keeps.
    pub rank: Vec<usize>,
    pattern: Pattern,
}

impl Factors {
    /// Factorises; keeps as many terms as the error needs, or [`MOST_RANK`].
    ///
    /// # Errors
    /// `Input` for settings that make no sense and tables that are dark.
    pub fn of(table: &Table, settings: &Settings) -> Result<Self> {
        settings.check()?;
        if table.rgb.as_flattened().iter().all(|v| *v == 0.0) {
            return Err(Error::input("table", "is dark everywhere", "make it anew"));
        }
        let pattern = Pattern::of(table, settings.apart);
        let most = settings.rank.unwrap_or(MOST_RANK);
        let several = settings.parts > 1 && pattern.main.len() > 1 && settings.directions.is_none();
        let parts = if several {
            parts::split(table, &pattern, settings.parts, settings.kind, most)
        } else {
            let along = |directions| Part::new(table, directions, settings.kind, most, |_| 1.0);
            // Spots of a lattice may be brightest along its diagonals: those that leave less out are its directions.
            let [a, b] = pattern.pair;
            let between = [0.5 * (a + b), 0.5 * (a + b) + FRAC_PI_2].map(|angle| angle.rem_euclid(PI));
            let candidates = settings.directions.map_or_else(|| vec![pattern.pair, between], |given| vec![given]);
            let left = |part: &Part| {
                let share = |c: usize| part.left_out(c, FEW.min(most)) / part.norm[c].max(f64::MIN_POSITIVE);
                (0..3).map(share).sum::<f64>()
            };
            candidates.into_iter().map(along).min_by(|p, q| left(p).total_cmp(&left(q))).into_iter().collect()
        };
        let whole: [f64; 3] = [0, 1, 2].map(|c| parts.iter().map(|p| p.norm[c].powi(2)).sum::<f64>().sqrt());
        let enough = |part: &Part| {
            let allowed = |c: usize| settings.max_error * whole[c] / (parts.len() as f64).sqrt();
            (1..MOST_RANK).find(|r| (0..3).all(|c| part.left_out(c, *r) <= allowed(c))).unwrap_or(MOST_RANK)
        };
        let rank = parts.iter().map(|p| settings.rank.unwrap_or_else(|| enough(p))).collect::<Vec<usize>>();
        let parts = parts.iter().zip(&rank).map(|(p, r)| p.truncated(*r)).collect();
        Ok(Self { parts, rank, pattern })
    }

    /// Whether so few terms do that two passes are the method of choice.
    pub fn separable(&self) -> bool {
        self.rank.iter().sum::<usize>() <= SEPARABLE
    }
}

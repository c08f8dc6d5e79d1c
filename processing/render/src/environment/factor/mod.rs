//! Low-rank factorisation of lookup tables (2017 CVMP, section 4) in straightened coordinates. The factor (1 + ωi·ωo)²
//! and the Jacobian are included before the factorisation, and two-pass rendering uses one intermediate picture per
//! term.

mod directions;
mod operation;
mod parts;
mod report;
mod straight;
mod svd;
mod tilted;
mod written;

pub use operation::Options;
pub use parts::{Kind, MAX_RANK, Part, Term};
pub use report::{PartReport, Report};
pub use straight::Grid;

use super::Table;
use directions::Pattern;
use nacre_base::{Error, Result};
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_3, PI};

/// Number of terms above which two passes take longer than the exact sum along azimuths (measured for 1024 × 512 pixels
/// and 256² entries: 15).
const SEPARABLE: usize = 16;

/// Number of terms used to compare directions.
const FEW: usize = 3;

/// Options of a factorisation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// Terms per channel and part; `None` for as many as [`Self::max_error`] requires.
    pub rank: Option<usize>,
    /// Largest norm of the residual, relative to the table's norm.
    pub max_error: f64,
    /// Minimum angle between the two directions, radians.
    pub apart: f64,
    /// The two directions in radians; `None` to detect them.
    pub directions: Option<[f64; 2]>,
    /// Number of parts, each straightened separately along one main direction.
    pub parts: usize,
    /// Kind of factorisation.
    pub kind: Kind,
}

impl Default for Settings {
    fn default() -> Self {
        let apart = FRAC_PI_3;
        Self { rank: None, max_error: 0.05, apart, directions: None, parts: 1, kind: Kind::Singular }
    }
}

impl Settings {
    /// Checks the options.
    ///
    /// # Errors
    /// `Input`, which names the option.
    pub fn check(&self) -> Result<()> {
        let bad = |what: &str, problem: String, remedy: String| Err(Error::input(what, problem, remedy));
        if let Some(rank) = self.rank.filter(|r| !(1..=MAX_RANK).contains(r)) {
            return bad("rank", format!("is {rank}"), format!("give 1 to {MAX_RANK}"));
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

/// A lookup table as a sum of separable terms.
#[derive(Clone, Debug)]
pub struct Factors {
    /// Parts of the table; their sum is the table.
    pub parts: Vec<Part>,
    /// Terms per channel of each part.
    pub rank: Vec<usize>,
    pattern: Pattern,
    /// Target error, if the rank was not given.
    wanted: Option<f64>,
    measured: Measured,
}

/// Error of the sum of all parts against the table.
#[derive(Clone, Copy, Debug, Default)]
struct Measured {
    /// Integral of the squared residual over the solid angle, summed over the channels.
    left_out: f64,
    /// Integral of the squared table.
    whole: f64,
}

impl Factors {
    /// Factorises a table with as many terms as the target error requires, at most [`MAX_RANK`].
    ///
    /// # Errors
    /// `Input` for invalid options and for black tables.
    pub fn of(table: &Table, settings: &Settings) -> Result<Self> {
        settings.check()?;
        if table.rgb.as_flattened().iter().all(|v| *v == 0.0) {
            return Err(Error::input("table", "is dark everywhere", "make it anew"));
        }
        let pattern = Pattern::of(table, settings.apart);
        let most = settings.rank.unwrap_or(MAX_RANK);
        let several = settings.parts > 1 && pattern.main.len() > 1 && settings.directions.is_none();
        let directions: Vec<f64> =
            pattern.main.iter().copied().take(if several { settings.parts } else { 0 }).collect();
        let parts = if several {
            parts::split(table, &directions, settings.kind, most)
        } else {
            vec![Self::whole(table, settings, &pattern, most)]
        };
        let norm: [f64; 3] = [0, 1, 2].map(|c| parts.iter().map(|p| p.norm[c].powi(2)).sum::<f64>().sqrt());
        let enough = |part: &Part| {
            // In the worst case the residuals of the parts add up.
            let allowed = |c: usize| settings.max_error * norm[c] / parts.len() as f64;
            (1..part.terms()).find(|r| (0..3).all(|c| part.left_out(c, *r) <= allowed(c))).unwrap_or(part.terms())
        };
        let rank: Vec<usize> =
            parts.iter().map(|p| settings.rank.unwrap_or_else(|| enough(p)).min(p.terms())).collect();
        let parts: Vec<Part> = parts.iter().zip(&rank).map(|(p, r)| p.truncated(*r)).collect();
        let wanted = settings.rank.is_none().then_some(settings.max_error);
        let measured = Measured::of(table, &parts, &directions);
        Ok(Self { parts, rank, pattern, wanted, measured })
    }

    /// The table as a single part.
    fn whole(table: &Table, settings: &Settings, pattern: &Pattern, most: usize) -> Part {
        let along = |directions| Part::new(table, directions, settings.kind, most, |_| 1.0);
        // A lattice of spots may be brightest along its diagonals. Of both pairs of directions, the one with the
        // smaller residual is used.
        let [a, b] = pattern.pair;
        let between = [0.5 * (a + b), 0.5 * (a + b) + FRAC_PI_2].map(|angle| angle.rem_euclid(PI));
        let given = settings.directions.unwrap_or(pattern.pair);
        // A line factorisation lies along the first direction.
        if settings.directions.is_some() || settings.kind == Kind::Line {
            return along(given);
        }
        let left = |part: &Part| {
            let share = |c: usize| part.left_out(c, FEW.min(most)) / part.norm[c].max(f64::MIN_POSITIVE);
            (0..3).map(share).sum::<f64>()
        };
        let (first, second) = (along(given), along(between));
        if left(&second) < left(&first) { second } else { first }
    }

    /// Truncates to at most `rank` terms per channel and part.
    #[must_use]
    pub fn truncated(&self, table: &Table, rank: usize) -> Self {
        let parts: Vec<Part> = self.parts.iter().map(|p| p.truncated(rank)).collect();
        let directions: Vec<f64> =
            if parts.len() > 1 { parts.iter().map(|p| p.grid.across()).collect() } else { vec![] };
        let measured = Measured::of(table, &parts, &directions);
        let rank = parts.iter().map(Part::terms).collect();
        Self { parts, rank, measured, pattern: self.pattern.clone(), wanted: None }
    }

    /// Whether the target error is exceeded.
    pub fn missed(&self) -> bool {
        self.wanted.is_some_and(|wanted| self.error() > wanted)
    }

    /// Whether the rank is low enough that two passes are the fastest method.
    pub fn separable(&self) -> bool {
        self.rank.iter().sum::<usize>() <= SEPARABLE && !self.missed()
    }
}

impl Measured {
    /// Measures the residual of the sum of all parts. Near its direction a part is read at its own cells, which needs
    /// no interpolation; the other parts are interpolated.
    fn of(table: &Table, parts: &[Part], directions: &[f64]) -> Self {
        let column = |(k, i): (usize, usize)| {
            let grid = &parts[k].grid;
            let mut sum = Self::default();
            for j in 0..grid.size[1] {
                let entry = grid.entry(table, i, j);
                let truth = entry.map_or([0.0; 3], |(h, square)| table.at(h).map(|v| f64::from(v) * square));
                let share = match (directions, entry) {
                    ([], _) => 1.0,
                    // Outside the table all light is zero, so the assignment to a part is irrelevant.
                    (_, None) => 1.0,
                    (directions, Some((h, _))) => parts::share(directions, k, h),
                };
                for (c, truth) in truth.into_iter().enumerate() {
                    let others = parts.iter().enumerate().filter(|(other, _)| *other != k);
                    let found: f64 = entry.map_or(0.0, |(h, _)| others.map(|(_, p)| p.between(c, h)).sum());
                    sum.left_out += share * (found + parts[k].at(c, i, j) - truth).powi(2);
                    sum.whole += share * truth.powi(2);
                }
            }
            let [dx, dy] = grid.cell();
            Self { left_out: sum.left_out * dx * dy, whole: sum.whole * dx * dy }
        };
        let columns: Vec<(usize, usize)> =
            parts.iter().enumerate().flat_map(|(k, p)| (0..p.grid.size[0]).map(move |i| (k, i))).collect();
        // Summed in a fixed order, for reproducible results.
        let sums: Vec<Self> = columns.into_par_iter().map(column).collect();
        let add = |a: Self, b: &Self| Self { left_out: a.left_out + b.left_out, whole: a.whole + b.whole };
        sums.iter().fold(Self::default(), add)
    }
}

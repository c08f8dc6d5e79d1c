//! Main directions of a pattern (2017 CVMP, section 4.2).

use super::super::Table;
use std::f64::consts::PI;

/// Number of tested angles over 180°.
const ANGLES: usize = 720;

/// Radius around the zero order that is excluded, in table entries.
const MIRROR: f64 = 5.0;

/// Contrast (maximum over median of the profile) below which a pattern has no main direction.
const ROUND: f64 = 1.3;

/// Height of a main direction's peak, as a fraction of the range from median to maximum.
const MAIN: f64 = 0.5;

/// Minimum separation of main directions, in steps of the tested angles (10°).
const APART: usize = 40;

/// Directions of a pattern.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Pattern {
    /// The two directions with the most light along rays through the zero order, separated by at least the minimum
    /// angle, radians.
    pub pair: [f64; 2],
    /// All main directions, the brightest first.
    pub main: Vec<f64>,
    /// Maximum over median of the light along rays.
    pub contrast: f64,
}

impl Pattern {
    /// Finds directions separated by at least `apart` (radians).
    pub(super) fn of(table: &Table, apart: f64) -> Self {
        let profile = smoothed(&(0..ANGLES).map(|k| ray(table, angle(k))).collect::<Vec<f64>>());
        let mut sorted = profile.clone();
        sorted.sort_by(f64::total_cmp);
        let (median, most) = (sorted[ANGLES / 2], sorted[ANGLES - 1]);
        let least = ((apart / PI * ANGLES as f64).round() as usize).clamp(1, ANGLES / 2);
        let mut peaks: Vec<usize> = (0..ANGLES)
            .filter(|k| {
                (1..=APART).all(|d| {
                    profile[*k] >= profile[(k + d) % ANGLES] && profile[*k] > profile[(k + ANGLES - d) % ANGLES]
                })
            })
            .filter(|k| profile[*k] >= median + MAIN * (most - median))
            .collect();
        peaks.sort_by(|a, b| profile[*b].total_cmp(&profile[*a]));
        let contrast = most / median.max(f64::MIN_POSITIVE);
        if contrast < ROUND {
            return Self { pair: [0.0, 0.5 * PI], main: vec![], contrast };
        }
        let first = peaks.first().copied().unwrap_or(0);
        let other = (least..=ANGLES - least).map(|d| (first + d) % ANGLES);
        let second = other.max_by(|a, b| profile[*a].total_cmp(&profile[*b])).unwrap_or((first + ANGLES / 2) % ANGLES);
        // Without a second main direction, perpendicular directions are the best choice.
        let stands_out = peaks.contains(&second);
        let second = if stands_out { refined(&profile, second) } else { refined(&profile, first) + 0.5 * PI };
        let main = peaks.iter().map(|k| refined(&profile, *k)).collect();
        Self { pair: [refined(&profile, first), second % PI], main, contrast }
    }
}

fn angle(k: usize) -> f64 {
    PI * k as f64 / ANGLES as f64
}

/// Light along a line through the zero order, in the green channel.
fn ray(table: &Table, angle: f64) -> f64 {
    let (sin, cos) = angle.sin_cos();
    let cell = table.cell();
    let steps = (table.extent / cell) as usize;
    let both = |r: f64| table.at([r * cos, r * sin])[1] + table.at([-r * cos, -r * sin])[1];
    (0..steps).map(|k| k as f64 * cell).filter(|r| *r >= MIRROR * cell).map(|r| f64::from(both(r).max(0.0))).sum()
}

/// Moving average over three angles, applied three times.
fn smoothed(profile: &[f64]) -> Vec<f64> {
    let n = profile.len();
    (0..3).fold(profile.to_vec(), |p, _| (0..n).map(|k| (p[(k + n - 1) % n] + p[k] + p[(k + 1) % n]) / 3.0).collect())
}

/// Vertex of the parabola through a peak and its neighbours.
fn refined(profile: &[f64], k: usize) -> f64 {
    let [a, b, c] = [k + ANGLES - 1, k, k + 1].map(|k| profile[k % ANGLES]);
    let curve = a - 2.0 * b + c;
    let off = if curve < 0.0 { (0.5 * (a - c) / curve).clamp(-0.5, 0.5) } else { 0.0 };
    PI * (k as f64 + off).rem_euclid(ANGLES as f64) / ANGLES as f64
}

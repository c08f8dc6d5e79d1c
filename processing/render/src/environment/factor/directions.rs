//! Main directions of a pattern (2017 CVMP, section 4.2).

use super::super::Table;
use std::f64::consts::PI;

/// Angles that are tried, over half a turn.
const ANGLES: usize = 720;

/// Entries around the zero order that are left out.
const MIRROR: f64 = 5.0;

/// A profile whose largest value is less than this times its median has no direction.
const ROUND: f64 = 1.3;

/// A direction counts as main from this part of the height between median and largest on.
const MAIN: f64 = 0.5;

/// Main directions are at least so far apart, in angles that are tried (10°).
const APART: usize = 40;

/// What a pattern looks like.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Pattern {
    /// The two directions with the most light along rays through the zero order, at least the wanted angle apart, radians.
    pub pair: [f64; 2],
    /// Every direction that stands out, the brightest first.
    pub main: Vec<f64>,
    /// Largest over median light along a ray.
    pub contrast: f64,
}

impl Pattern {
    /// Looks for directions at least `apart` (radians) from each other.
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
        // Without a second direction that stands out, the two are best at right angles.
        let stands_out = peaks.contains(&second);
        let second = if stands_out { refined(&profile, second) } else { refined(&profile, first) + 0.5 * PI };
        let main = peaks.iter().map(|k| refined(&profile, *k)).collect();
        Self { pair: [refined(&profile, first), second % PI], main, contrast }
    }
}

fn angle(k: usize) -> f64 {
    PI * k as f64 / ANGLES as f64
}

/// Light along a ray in both senses, of the channel in the middle of the spectrum.
fn ray(table: &Table, angle: f64) -> f64 {
    let (sin, cos) = angle.sin_cos();
    let cell = table.cell();
    let steps = (table.extent / cell) as usize;
    let both = |r: f64| table.at([r * cos, r * sin])[1] + table.at([-r * cos, -r * sin])[1];
    (0..steps).map(|k| k as f64 * cell).filter(|r| *r >= MIRROR * cell).map(|r| f64::from(both(r).max(0.0))).sum()
}

/// Means over three angles, three times.
fn smoothed(profile: &[f64]) -> Vec<f64> {
    let n = profile.len();
    (0..3).fold(profile.to_vec(), |p, _| (0..n).map(|k| (p[(k + n - 1) % n] + p[k] + p[(k + 1) % n]) / 3.0).collect())
}

/// The top of the parabola through a peak and its neighbours.
fn refined(profile: &[f64], k: usize) -> f64 {
    let [a, b, c] = [k + ANGLES - 1, k, k + 1].map(|k| profile[k % ANGLES]);
    let curve = a - 2.0 * b + c;
    let off = if curve < 0.0 { (0.5 * (a - c) / curve).clamp(-0.5, 0.5) } else { 0.0 };
    PI * (k as f64 + off).rem_euclid(ANGLES as f64) / ANGLES as f64
}

//! Starts of the film search: the most promising films of a grid, and those that explain a circle through the points.

use crate::film::cloud::CloudPoint;
use crate::film::curve::{Curve, Film};
use crate::film::evidence;
use crate::film::projection::{ClosestPoint, CurveSamples};
use num_complex::Complex;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// The most promising films of a grid and of the explanations of a circle: those whose curve is close to the points,
/// absolutely or relative to its length.
pub(crate) fn starts(points: &[CloudPoint], circle: &Curve, count: usize) -> Vec<Film> {
    let (mirrors, others): (Vec<_>, Vec<_>) = grid().into_iter().partition(is_mirror_like);
    let mut begun = vec![];
    for films in [mirrors, others] {
        let (near, near_for_its_length) = films.into_par_iter().map(|film| scored(points, film)).unzip();
        begun.extend(best(near, count / 8));
        begun.extend(best(near_for_its_length, count / 8));
    }
    let groups = explanations(circle);
    let each = count / 2 / groups.len().max(1);
    for films in groups {
        begun.extend(best(films.into_par_iter().map(|film| scored(points, film).1).collect(), each));
    }
    begun
}

/// The films of the grid whose curves are closest to the points.
pub(crate) fn nearest(points: &[CloudPoint], count: usize) -> Vec<Film> {
    let near = |film: Film| (distance(&CurveSamples::new(film.curve()).project(points)), film);
    best(grid().into_par_iter().map(near).collect(), count)
}

/// Distance of points from a film's curve, absolute and relative to its length.
fn scored(points: &[CloudPoint], film: Film) -> ((f64, Film), (f64, Film)) {
    let curve = film.curve();
    let closest_points = CurveSamples::new(curve).project(points);
    ((distance(&closest_points), film), (evidence::screening(points, &closest_points, &curve), film))
}

/// Total distance of points from a curve, each limited to a maximum.
fn distance(closest_points: &[ClosestPoint]) -> f64 {
    closest_points.iter().map(|f| f.distance.abs().min(1e6)).sum()
}

/// The films of smallest scores, in increasing order.
fn best(mut scored: Vec<(f64, Film)>, count: usize) -> Vec<Film> {
    scored.sort_by(|a, b| a.0.total_cmp(&b.0));
    scored.into_iter().take(count).map(|(_, film)| film).collect()
}

fn grid() -> Vec<Film> {
    let mut films = vec![];
    for ln_r in [-0.6, -0.1, 0.1, 0.6, 2.0] {
        for zeta in [3.0_f64, 12.0, 30.0, 60.0, 90.0, 120.0, 150.0, 165.0, 176.0] {
            for retardance in [2.0_f64, 6.0, 14.0, 24.0, 42.0, 65.0, 85.0] {
                for axis in 0..6 {
                    let (retardance, axis) = (retardance.to_radians(), PI * f64::from(axis) / 6.0);
                    films.push(Film { ln_r, zeta: zeta.to_radians(), retardance, axis, ..Film::NONE });
                }
            }
        }
    }
    films
}

/// Films whose curve is nearly this circle, in groups that differ in a weakly observable parameter, the phase of a/b.
/// The circle's radius gives |a/b| or |b/a|. An off-centre circle can result from the film's effect on the constant
/// part of the field, or on the part that rotates with the grating. The centre gives the film.
fn explanations(circle: &Curve) -> Vec<Vec<Film>> {
    let (a, b) = (circle.at(0.0), circle.at(FRAC_PI_2));
    let (radius, [x, y]) = (0.5 * (a[0] - b[0]).abs().min(1.98), [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])]);
    let small = (1.0 - (1.0 - radius * radius).sqrt()) / radius.max(1e-6);
    let mut groups = vec![];
    for size in [small, 1.0 / small.max(1e-6)] {
        let share = size * size / (1.0 + size * size);
        let retardance = 0.5 * (x.hypot(y) / share.max(1.0 - share)).min(1.0).asin();
        // For |a| close to |b| both effects contribute, and the centre is their sum or difference.
        for (turn, much) in (0..4).flat_map(|turn| [0.6, 1.0, 1.8].map(|much| (turn, much))) {
            let (axis, retardance) = (0.5 * y.atan2(x) + FRAC_PI_4 * f64::from(turn), much * retardance);
            let ratios = (0..8).map(|phase| {
                let k = Complex::from_polar(size, FRAC_PI_4 * f64::from(phase));
                (1.0 - k) / (1.0 + k)
            });
            let good = ratios.filter(|ratio| ratio.norm() > 1e-6 && ratio.norm() < 1e6);
            let films =
                good.map(|ratio| Film { ln_r: ratio.norm().ln(), zeta: ratio.arg(), retardance, axis, ..Film::NONE });
            groups.push(films.collect());
        }
    }
    groups
}

/// |a| > |b|: the grating acts as a mirror rather than as a half-wave plate.
fn is_mirror_like(film: &Film) -> bool {
    film.zeta.cos() < 0.0
}

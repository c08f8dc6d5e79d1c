//! Looks for the film whose curve the points lie on: from many starts, since the misfit has many minima. First by samples of the points, then,
//! once a curve runs through them, by sums of all points about it.

use super::angle_difference;
use super::cloud::{CloudPoint, SAMPLE, thinned};
use super::curve::{Curve, Film, PARAMETERS};
use super::curve_fit::{Family, Fitted};
use super::foot::{Foot, Path};
use super::likeliest::likeliest;
use super::models::{Candidate, MIXTURE, Model, SPREAD, candidates, widened};
use super::sums::summed_up;
use super::{evidence, mixture};
use num_complex::Complex;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// Points that starts are tried on, and that the best ones are followed on; the last ones are fitted to [`SAMPLE`].
const TRIED: usize = 200;
const FOLLOWED: usize = 400;

/// Curves that are tried for a few steps, that are followed, and that are fitted to more points.
const STARTS: usize = 120;
const KEPT: usize = 40;
const FINALISTS: usize = 6;

/// Orientations that differ by no more than this in rad are the same.
const SAME: f64 = 4e-3;

/// And by no more than this, places in the valley of the same minimum.
const SAME_MINIMUM: f64 = 0.1;

/// How far parameters may be expected from 0, where the points do not tell: ln r, retardance (up to 10° in the paper) and front
/// reflection of packaging films, a retarder within a few degrees, stray light of a dark room.
const EXPECTED: [f64; PARAMETERS] = [0.5, f64::INFINITY, 0.15, f64::INFINITY, 0.1, 0.1, 0.03, 0.015, 0.5];

/// And how far at most: what a model leaves out must not turn up as a film of glass fibre behind a mirror.
const LIMITS: [f64; PARAMETERS] = [10.0, f64::INFINITY, 1.65, f64::INFINITY, 0.3, 0.3, 0.1, 0.1, 1.0];

/// The film's retardance.
const RETARDANCE: usize = 2;

/// Whether the film delays as much as any that is looked for, so that the true one may delay more.
pub(super) fn at_limit(film: &Film) -> bool {
    film.retardance.abs() > 0.99 * LIMITS[RETARDANCE]
}

/// Stray light, and the parameter that only mirrors have.
const STRAY: usize = 7;
const SHADE: usize = 8;

/// A set of parameters that is fitted, and what of the light it adds to the film.
type Set = (&'static [usize], &'static [&'static str]);
const SETS: [Set; 4] = [
    (&[0, 1, 2, 3], &[]),
    (&[0, 1, 2, 3, STRAY], &["stray"]),
    (&[0, 1, 2, 3, 4, 5, STRAY], &["stray", "front"]),
    (&[0, 1, 2, 3, 4, 5, 6, STRAY], &["stray", "front", "source"]),
];

/// The same with metal without a grating in view, whose shade matters to stray light and to the front reflection only.
const MIRROR_SETS: [Set; 4] = [
    (&[0, 1, 2, 3], &["mirror"]),
    (&[0, 1, 2, 3, STRAY, SHADE], &["stray", "mirror"]),
    (&[0, 1, 2, 3, 4, 5, STRAY, SHADE], &["stray", "front", "mirror"]),
    (&[0, 1, 2, 3, 4, 5, 6, STRAY, SHADE], &["stray", "front", "source", "mirror"]),
];

/// Where a search begins.
#[derive(Clone, Copy)]
pub(super) enum Begin<'a> {
    /// At films of all kinds.
    Anywhere,
    /// At these, from a search on nearly the same points.
    At(&'a [Film]),
}

/// Points that scatter this much more about every curve (as a variance) than their noise may be metal without a grating.
const MIRRORS_IN_VIEW: f64 = 1.2;

/// Points that scatter by no more than this about a curve, as a variance over their noise, lie on it: two standard deviations of [`SAMPLE`] of them.
pub(super) const ENOUGH: f64 = 1.05;

/// The curve with four to eight free parameters, and with metal without a grating where that explains the points
/// better.
pub(super) fn curves(points: &[CloudPoint], circle: &Curve, begin: Begin<'_>) -> Vec<Candidate> {
    let of = |count| thinned(points, count);
    let samples =
        Samples { tried: of(TRIED), followed: of(FOLLOWED), last: of(SAMPLE), enough: ENOUGH, score: likelihood };
    let begun = match begin {
        Begin::Anywhere => starts(&samples.tried, circle),
        Begin::At(films) => films.to_vec(),
    };
    let (mut sets, mut found) = (&SETS, samples.search_all(&SETS, begun.clone()));
    if found.widened > MIRRORS_IN_VIEW {
        let with_mirrors = samples.search_all(&MIRROR_SETS, begun.clone());
        if with_mirrors.score < found.score {
            (sets, found) = (&MIRROR_SETS, with_mirrors);
        }
    }
    // All films that explain the points run near to the best one, and sums about it tell them apart as all points do.
    let Some(sums) = found.best.and_then(|(set, film)| about(&set, &film, points)) else { return vec![] };
    let mut films = found.films();
    if let Begin::Anywhere = begin {
        films.extend(begun);
        let near: Vec<_> =
            grid().into_par_iter().map(|film| (distance(&Path::new(film.curve()).feet(&sums)), film)).collect();
        films.extend(best(near, STARTS));
    }
    let of_sums =
        Samples { tried: sums.clone(), followed: sums.clone(), last: sums.clone(), enough: 0.0, score: |_, f| f.cost };
    let found = of_sums.search_all(sets, films);
    // What is a minimum with fewer parameters, or with more, may lead to one.
    let films = found.films();
    sets.iter().flat_map(|set| finish(set, &films, &sums, points)).collect()
}

/// Sums of all points about a film's curve, after it is fitted to them.
fn about(set: &Set, film: &Film, points: &[CloudPoint]) -> Option<Vec<CloudPoint>> {
    let fitted = with_family(set, |family, _| family.fit(points, &taken(set.0, film), 10))?;
    Some(summed_up(points, &fitted.curve))
}

/// What a search has found.
struct Found {
    /// Per set of parameters the most promising films.
    films: Vec<(Set, Vec<Film>)>,
    /// The best of all, its -2 ln likelihood, and the scatter of the points about it over their noise, as a variance.
    best: Option<(Set, Film)>,
    score: f64,
    widened: f64,
}

impl Found {
    fn films(&self) -> Vec<Film> {
        self.films.iter().flat_map(|(_, films)| films).copied().collect()
    }
}

/// Points to fit, in smaller and smaller samples, and which fit to them is better.
struct Samples {
    tried: Vec<CloudPoint>,
    followed: Vec<CloudPoint>,
    last: Vec<CloudPoint>,
    /// Points that scatter about a curve by less than this (as a variance, over their noise) need no more parameters.
    enough: f64,
    score: fn(&[CloudPoint], &Fitted) -> f64,
}

impl Samples {
    /// Searches with one set of parameters after the other. Each is begun where the one before ended and at many other places.
    fn search_all(&self, sets: &[Set], mut begun: Vec<Film>) -> Found {
        let mut found = Found { films: vec![], best: None, score: f64::INFINITY, widened: f64::INFINITY };
        for set in sets {
            let fits = self.search(set, &begun);
            let films: Vec<Film> = fits.iter().map(|(_, _, film)| *film).collect();
            let count = begun.len().max(STARTS);
            begun.splice(0..0, films.iter().take(3).flat_map(with_fronts));
            begun.splice(0..0, films.iter().copied());
            begun.truncate(count);
            if let Some((score, cost, film)) = fits.first() {
                if *score < found.score {
                    (found.score, found.best) = (*score, Some((*set, *film)));
                }
                found.widened = found.widened.min(widened(*cost, self.last.len()));
            }
            found.films.push((*set, films.into_iter().take(2).collect()));
            if found.widened < self.enough {
                break;
            }
        }
        found
    }

    /// The best films of a set with their score and cost, best first.
    fn search(&self, set: &Set, begun: &[Film]) -> Vec<(f64, f64, Film)> {
        let free = set.0;
        let score = self.score;
        with_family(set, |family, film| {
            let fits = begun.par_iter().filter_map(|start| family.fit(&self.tried, &taken(free, start), 8));
            let mut tried = best_first(fits, |f| score(&self.tried, f));
            tried.truncate(KEPT);
            let fits = tried.par_iter().filter_map(|(_, f)| family.fit(&self.followed, &f.parameters, 25));
            let first = distinct(best_first(fits, |f| score(&self.followed, f)));
            let fits = first.par_iter().filter_map(|f| family.fit(&self.last, &f.parameters, 30));
            let best = best_first(fits, |f| score(&self.last, f));
            best.iter().map(|(score, f)| (*score, f.cost, film(&f.parameters))).collect()
        })
    }
}

/// Whether orientations under two curves are the same.
pub(super) fn alike(a: &Curve, b: &Curve) -> bool {
    same_orientations(a, b, SAME)
}

/// The candidates of a set from the most promising films: the best one, and what explains the points as well with other
/// orientations.
fn finish(set: &Set, films: &[Film], sums: &[CloudPoint], points: &[CloudPoint]) -> Vec<Candidate> {
    let free = set.0;
    with_family(set, |family, film| {
        let fits = films.par_iter().filter_map(|start| family.fit(sums, &taken(free, start), 60));
        let near = distinct(best_first(fits, |f| f.cost));
        let fits = near.par_iter().take(2).filter_map(|f| family.fit(points, &f.parameters, 10));
        // What ends at a limit of what more there may be has taken something else for it.
        let inside = |f: &Fitted| {
            let mut more = free.iter().zip(&f.parameters).filter(|(k, _)| (4..SHADE).contains(*k));
            more.all(|(k, p)| p.abs() < 0.99 * LIMITS[*k])
        };
        let near = distinct(best_first(fits.filter(inside), |f| f.cost));
        near.iter().map(|fit| candidate(set, family, fit, film(&fit.parameters), points)).collect()
    })
}

fn candidate(set: &Set, family: &Family<'_>, fit: &Fitted, film: Film, points: &[CloudPoint]) -> Candidate {
    let widened = widened(fit.cost, points.len());
    Candidate {
        model: Model::Curve,
        extended: set.1,
        parameters: set.0.len() + usize::from(mirrors(set)),
        curve: fit.curve,
        center: None,
        prior: fit.prior,
        told: Some(family.told(fit, widened)),
        widened,
        uncertain: family.spread(fit, &thinned(points, SPREAD), widened),
        film: Some(film),
    }
}

/// The set of parameters that a candidate has; None for a circle.
fn set_of(like: &Candidate) -> Option<&'static Set> {
    SETS.iter().chain(&MIRROR_SETS).find(|set| like.film.is_some() && set.1 == like.extended)
}

/// A candidate's model with parameters that are fitted to other points, from where they are.
pub(super) fn refitted(like: &Candidate, points: &[CloudPoint]) -> Option<Candidate> {
    let Some(film) = like.film else { return candidates(points).into_iter().find(|c| c.model == like.model) };
    let set = set_of(like)?;
    with_family(set, |family, of| {
        let fit = family.fit(points, &taken(set.0, &film), 30)?;
        Some(candidate(set, family, &fit, of(&fit.parameters), points))
    })
}

/// The likeliest curve near a film, with the parameters of a candidate; None for a circle. Scatter is told relative to the noise as it was for the
/// candidate: that of these points may be wider already.
pub(super) fn likelier(like: &Candidate, start: Film, points: &[CloudPoint]) -> Option<Candidate> {
    let set = set_of(like)?;
    with_family(set, |family, film| {
        let fit = likeliest(family, &family.at(points, taken(set.0, &start))?, points);
        let found = candidate(set, family, &fit, film(&fit.parameters), points);
        Some(Candidate { widened: like.widened, ..found })
    })
}

/// -2 ln likelihood of points and of the parameters of a fit to them.
fn likelihood(points: &[CloudPoint], fit: &Fitted) -> f64 {
    let of_points = if points.len() < MIXTURE {
        evidence::misfit(points, &fit.curve)
    } else {
        mixture::terms(points, &fit.curve).iter().sum()
    };
    of_points + fit.prior
}

/// The same film with front reflections of all phases, weaker over mirrors: from none, a fit may end at another minimum.
fn with_fronts(film: &Film) -> Vec<Film> {
    let fronts = (0..8).map(|k| Complex::from_polar(0.1, FRAC_PI_4 * f64::from(k)));
    fronts.map(|front| Film { front: film.front + front, shade: 0.5, ..*film }).collect()
}

/// The parameters of a film that are free.
fn taken(free: &[usize], film: &Film) -> Vec<f64> {
    let all = film.to_array();
    free.iter().map(|k| all[*k].clamp(-LIMITS[*k], LIMITS[*k])).collect()
}

/// Whether a set takes some points for metal without a grating.
fn mirrors(set: &Set) -> bool {
    set.1.contains(&"mirror")
}

/// Does something with the family of films whose other parameters are 0, and the film of its parameters.
fn with_family<T>(set: &Set, work: impl FnOnce(&Family<'_>, &(dyn Fn(&[f64]) -> Film + Sync)) -> T) -> T {
    let (free, mirrors) = (set.0, mirrors(set));
    let film = |p: &[f64]| {
        let mut all = [0.0; PARAMETERS];
        for (k, value) in free.iter().zip(p) {
            all[*k] = *value;
        }
        Film::from_array(all)
    };
    let of = |all: &[f64; PARAMETERS]| -> Vec<f64> { free.iter().map(|k| all[*k]).collect() };
    let (expected, limits) = (of(&EXPECTED), of(&LIMITS));
    let curve = |p: &[f64]| if mirrors { film(p).curve_and_mirror() } else { film(p).curve() };
    work(&Family { curve: &curve, expected: &expected, limits: &limits }, &film)
}

/// Fits with their scores, the least first.
fn best_first(fits: impl ParallelIterator<Item = Fitted>, score: impl Fn(&Fitted) -> f64 + Sync) -> Vec<(f64, Fitted)> {
    let mut scored: Vec<(f64, Fitted)> = fits.map(|fit| (score(&fit), fit)).collect();
    scored.sort_by(|a, b| a.0.total_cmp(&b.0));
    scored
}

/// The first few that do not give the same orientations, up to one offset: first those of other minima, as long as they explain
/// the points nearly as well, then others of the same. With more parameters the next minimum may turn out to be the lower one.
fn distinct(fits: Vec<(f64, Fitted)>) -> Vec<Fitted> {
    let hopeless = fits.first().map_or(0.0, |(_, best)| 2.0 * best.cost);
    let (mut minima, mut others): (Vec<Fitted>, Vec<Fitted>) = (vec![], vec![]);
    for (_, fit) in fits {
        let near = |other: &Fitted, limit| same_orientations(&fit.curve, &other.curve, limit);
        if minima.len() + others.len() == FINALISTS || minima.iter().chain(&others).any(|other| near(other, SAME)) {
            continue;
        }
        let known = minima.iter().any(|other| near(other, SAME_MINIMUM));
        if known || fit.cost > hopeless { others.push(fit) } else { minima.push(fit) }
    }
    minima.append(&mut others);
    minima
}

/// Whether orientations under two curves differ by no more than `limit` in rad, but for a common offset.
fn same_orientations(a: &Curve, b: &Curve, limit: f64) -> bool {
    const PLACES: usize = 24;
    let path = Path::new(*b);
    let turns: Vec<f64> = (0..PLACES)
        .map(|k| {
            let theta = PI * k as f64 / PLACES as f64;
            let point = CloudPoint { pixel: 0, at: a.at(theta), covariance: [1.0, 0.0, 1.0], snr: 0.0 };
            path.foot(&point).theta - theta
        })
        .collect();
    let (sin, cos) = turns.iter().fold((0.0, 0.0), |(s, c), t| (s + (2.0 * t).sin(), c + (2.0 * t).cos()));
    let offset = 0.5 * f64::atan2(sin, cos);
    turns.iter().all(|t| angle_difference(*t, offset).abs() < limit)
}

/// The most promising of a grid of films, and of those that a circle through the points can mean. Promising is a curve
/// that is near to the points, or near for its length.
fn starts(points: &[CloudPoint], circle: &Curve) -> Vec<Film> {
    let (mirrors, others): (Vec<_>, Vec<_>) = grid().into_iter().partition(is_mirror_like);
    let mut begun = vec![];
    for films in [mirrors, others] {
        let (near, near_for_its_length) = films.into_par_iter().map(|film| scored(points, film)).unzip();
        begun.extend(best(near, STARTS / 8));
        begun.extend(best(near_for_its_length, STARTS / 8));
    }
    let groups = explanations(circle);
    let each = STARTS / 2 / groups.len().max(1);
    for films in groups {
        begun.extend(best(films.into_par_iter().map(|film| scored(points, film).1).collect(), each));
    }
    begun
}

/// How far points are off a film's curve, and the same for its length.
fn scored(points: &[CloudPoint], film: Film) -> ((f64, Film), (f64, Film)) {
    let curve = film.curve();
    let feet = Path::new(curve).feet(points);
    ((distance(&feet), film), (evidence::screening(points, &feet, &curve), film))
}

/// How far points are off a curve in all, each by as much as matters at most.
fn distance(feet: &[Foot]) -> f64 {
    feet.iter().map(|f| f.distance.abs().min(1e6)).sum()
}

/// The films of the least scores, the least first.
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

/// Films whose curve is nearly this circle, in groups that differ by what is hardly seen: the phase of a/b. The circle's
/// radius gives |a/b| or |b/a|, since a circle off the origin has two explanations: by what the film does to the constant
/// part of the field, or to the one that turns with the grating. Its centre gives the film.
fn explanations(circle: &Curve) -> Vec<Vec<Film>> {
    let (a, b) = (circle.at(0.0), circle.at(FRAC_PI_2));
    let (radius, [x, y]) = (0.5 * (a[0] - b[0]).abs().min(1.98), [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])]);
    let small = (1.0 - (1.0 - radius * radius).sqrt()) / radius.max(1e-6);
    let mut groups = vec![];
    for size in [small, 1.0 / small.max(1e-6)] {
        let share = size * size / (1.0 + size * size);
        let retardance = 0.5 * (x.hypot(y) / share.max(1.0 - share)).min(1.0).asin();
        // Where |a| and |b| are alike, both act, and the centre is their sum or difference.
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

/// |a| > |b|: the grating acts as a mirror more than as a half-wave plate.
fn is_mirror_like(film: &Film) -> bool {
    film.zeta.cos() < 0.0
}

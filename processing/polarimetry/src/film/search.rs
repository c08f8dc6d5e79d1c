//! Looks for the film whose curve the points lie on: from many starts, since the misfit has many minima. First by samples of the points, then,
//! once a curve runs through them, by sums of all points about it.

use crate::angle_difference;
use crate::film::cloud::{CloudPoint, SAMPLE, thinned};
use crate::film::curve::{Curve, Film, PARAMETERS};
use crate::film::curve_fit::{Expected, Family, Fitted};
use crate::film::evidence;
use crate::film::foot::Path;
use crate::film::likeliest::likeliest;
use crate::film::mixture;
use crate::film::models::{Candidate, MIXTURE, Model, SPREAD, candidates, widened};
use crate::film::starts::{nearest, starts};
use crate::film::sums::summed_up;
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

/// What is expected of parameters, where the points do not tell: ln r (gratings that polarize are rare), retardance (up to 10° in the paper) and
/// front reflection of packaging films, a retarder within a few degrees, stray light of a dark room.
const EXPECTED: [Expected; PARAMETERS] = {
    use Expected::{Anything, Mostly, Near};
    [Mostly(0.5), Anything, Near(0.15), Anything, Near(0.1), Near(0.1), Near(0.03), Near(0.015), Near(0.5)]
};

/// The parts of a front reflection, and how large each is held possible when it is told how wrong a fit may be (glass has an amplitude of 0.2). Fits expect
/// less: many films have none, and what no parameter holds is soon taken for one.
const FRONT: [usize; 2] = [4, 5];
const POSSIBLE_FRONT: Expected = Expected::Near(0.15);

/// And how far from 0 they may be at most: what a model leaves out must not turn up as a film of glass fibre behind a mirror.
const LIMITS: [f64; PARAMETERS] = [10.0, f64::INFINITY, 1.65, f64::INFINITY, 0.6, 0.6, 0.1, 0.1, 1.0];

/// The film's retardance.
const RETARDANCE: usize = 2;

/// Whether the film delays as much as any that is looked for, so that the true one may delay more.
pub(crate) fn at_limit(film: &Film) -> bool {
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

/// A grating that reflects one polarization only, which no ζ matters to. Its light is fully polarized but for the film: the circle's radius is
/// nearly 1.
pub(crate) const POLARIZER: Set = (&[2, 3], &["polarizer"]);
const POLARIZED: f64 = 0.9;

/// Near to that, ln r is hardly told, and what explains the points is no place but a valley: places along it, by ln r.
const HELD: Set = (&[1, 2, 3], &[]);
const VALLEY: [f64; 4] = [1.0, 2.0, 3.5, 5.0];

/// Where a search begins.
#[derive(Clone, Copy)]
pub(crate) enum Begin<'a> {
    /// At films of all kinds.
    Anywhere,
    /// At these, from a search on nearly the same points.
    At(&'a [Film]),
}

/// Points that scatter this much more about every curve (as a variance) than their noise may be metal without a grating.
const MIRRORS_IN_VIEW: f64 = 1.2;

/// Points that scatter by no more than this about a curve, as a variance over their noise, lie on it: two standard deviations of [`SAMPLE`] of them.
pub(crate) const ENOUGH: f64 = 1.05;

/// The curve with four to eight free parameters, and with metal without a grating where that explains the points
/// better.
pub(crate) fn curves(points: &[CloudPoint], circle: &Curve, begin: Begin<'_>) -> Vec<Candidate> {
    let of = |count| thinned(points, count);
    let samples =
        Samples { tried: of(TRIED), followed: of(FOLLOWED), last: of(SAMPLE), enough: ENOUGH, score: likelihood };
    let begun = match begin {
        Begin::Anywhere => starts(&samples.tried, circle, STARTS),
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
        films.extend(nearest(&sums, STARTS));
    }
    let of_sums =
        Samples { tried: sums.clone(), followed: sums.clone(), last: sums.clone(), enough: 0.0, score: |_, f| f.cost };
    let found = of_sums.search_all(sets, films);
    // What is a minimum with fewer parameters, or with more, may lead to one.
    let films = found.films();
    let polarized = 0.5 * (circle.at(0.0)[0] - circle.at(FRAC_PI_2)[0]).abs() > POLARIZED;
    let mut all = if polarized { finish(&POLARIZER, &films, &sums, points) } else { vec![] };
    let polarizer = all.first().and_then(|c| c.film);
    all.extend(polarizer.into_iter().flat_map(|film| along_valley(&film, &sums, points)));
    all.extend(sets.iter().flat_map(|set| finish(set, &films, &sums, points)));
    all
}

/// Candidates of the simplest set that are no minima: the best ones of given ln r, from a polarizer behind a film.
fn along_valley(polarizer: &Film, sums: &[CloudPoint], points: &[CloudPoint]) -> Vec<Candidate> {
    let at = |ln_r: &f64| {
        let start = |k: u32| Film { zeta: FRAC_PI_4 * f64::from(k), ..*polarizer };
        let film = with_family_of(&HELD, *ln_r, |family, film| {
            let fits = (0..8).filter_map(|k| family.fit(sums, &taken(HELD.0, &start(k)), 30));
            fits.min_by(|a, b| a.cost.total_cmp(&b.cost)).map(|fit| film(&fit.parameters))
        })?;
        let set = &SETS[0];
        with_family(set, |family, _| {
            Some(candidate(set, family, &family.at(points, taken(set.0, &film))?, film, points))
        })
    };
    VALLEY.par_iter().filter_map(at).collect()
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
pub(crate) fn alike(a: &Curve, b: &Curve) -> bool {
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
        // A front reflection, retarder error or stray light at its limit stands for something that the model does not hold.
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
        uncertain: family.spread(&less_told(set, fit), &thinned(points, SPREAD), widened),
        film: Some(film),
    }
}

/// A fit that knows as little of its front reflection as is held possible.
fn less_told(set: &Set, fit: &Fitted) -> Fitted {
    let mut fit = fit.clone();
    for (i, k) in set.0.iter().enumerate().filter(|(_, k)| FRONT.contains(k)) {
        fit.information[(i, i)] += POSSIBLE_FRONT.pull(0.0) - EXPECTED[*k].pull(0.0);
    }
    fit
}

/// The set of parameters that a candidate has; None for a circle.
fn set_of(like: &Candidate) -> Option<&'static Set> {
    SETS.iter().chain(&MIRROR_SETS).chain([&POLARIZER]).find(|set| like.film.is_some() && set.1 == like.extended)
}

/// A candidate's model with parameters that are fitted to other points, from where they are.
pub(crate) fn refitted(like: &Candidate, points: &[CloudPoint]) -> Option<Candidate> {
    let Some(film) = like.film else { return candidates(points).into_iter().find(|c| c.model == like.model) };
    let set = set_of(like)?;
    with_family(set, |family, of| {
        let fit = family.fit(points, &taken(set.0, &film), 30)?;
        Some(candidate(set, family, &fit, of(&fit.parameters), points))
    })
}

/// The likeliest curve near a film, with the parameters of a candidate; None for a circle. Scatter is told relative to the noise as it was for the
/// candidate: that of these points may be wider already.
pub(crate) fn likelier(like: &Candidate, start: Film, points: &[CloudPoint]) -> Option<Candidate> {
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
    with_family_of(set, if set.1 == POLARIZER.1 { LIMITS[0] } else { 0.0 }, work)
}

/// The same with this ln r, where that is no parameter.
fn with_family_of<T>(set: &Set, ln_r: f64, work: impl FnOnce(&Family<'_>, &(dyn Fn(&[f64]) -> Film + Sync)) -> T) -> T {
    let (free, mirrors) = (set.0, mirrors(set));
    let film = |p: &[f64]| {
        let mut all = [0.0; PARAMETERS];
        all[0] = ln_r;
        for (k, value) in free.iter().zip(p) {
            all[*k] = *value;
        }
        Film::from_array(all)
    };
    let expected: Vec<Expected> = free.iter().map(|k| EXPECTED[*k]).collect();
    let limits: Vec<f64> = free.iter().map(|k| LIMITS[*k]).collect();
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

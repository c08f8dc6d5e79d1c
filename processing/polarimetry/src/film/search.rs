//! Global search for the film whose curve fits the points, from many starts, since the misfit has many minima. Samples
//! of the points are used first, then, near the curve, sums of all points about it.

use crate::angle_difference;
use crate::film::cloud::{CloudPoint, SAMPLE, thinned};
use crate::film::curve::{Curve, Film, PARAMETERS, Source};
use crate::film::curve_fit::{Family, Fitted, Prior};
use crate::film::evidence;
use crate::film::max_likelihood::maximise_likelihood;
use crate::film::models::{Candidate, Model, NPMLE_MIN_POINTS, SPREAD, candidates, widened};
use crate::film::npmle;
use crate::film::projection::CurveSamples;
use crate::film::segment_means::segment_means;
use crate::film::starts::{nearest, starts};
use num_complex::Complex;
use rayon::prelude::*;
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// Points on which starts are tested, and on which the best ones are followed; the last ones are fitted to [`SAMPLE`].
const FIRST_SAMPLE: usize = 200;
const SECOND_SAMPLE: usize = 400;

/// Number of curves that are tested for a few steps, that are followed, and that are fitted to more points.
const STARTS: usize = 120;
const SECOND_STARTS: usize = 40;
const FINALISTS: usize = 6;

/// Orientation difference in rad up to which results count as equal.
const SAME: f64 = 4e-3;

/// Orientation difference in rad up to which results belong to the same minimum.
const SAME_MINIMUM: f64 = 0.1;

/// Priors of the parameters. They assume that strongly polarizing gratings are rare (ln r) and that films are packaging
/// films (retardance up to 10° in the paper, front reflection). Retarder errors are a few degrees, and stray light is
/// that of a dark room.
const PRIORS: [Prior; PARAMETERS] = {
    use Prior::{Anything, Mostly, Near};
    [Mostly(0.5), Anything, Near(0.15), Anything, Near(0.1), Near(0.1), Near(0.03), Near(0.015), Near(0.5)]
};

/// Real and imaginary part of the front reflection, and the standard deviation of each in the error estimate (glass has
/// an amplitude of 0.2). The prior of the fit is narrower: many films have none, and unmodelled effects would be
/// attributed to it.
const FRONT: [usize; 2] = [4, 5];
const WIDE_FRONT: Prior = Prior::Near(0.15);

/// Largest absolute values: unmodelled effects must not be fitted by an extreme film, such as glass fibre behind a
/// mirror.
const LIMITS: [f64; PARAMETERS] = [10.0, f64::INFINITY, 1.65, f64::INFINITY, 0.6, 0.6, 0.1, 0.1, 1.0];

/// Index of the excess retardance of the display's retarder, whose prior is narrower if it is calibrated.
const SOURCE_ERROR: usize = 6;

/// Prior of a parameter.
fn prior_of(parameter: usize, source: &Source) -> Prior {
    match source.sigma {
        Some(sigma) if parameter == SOURCE_ERROR => Prior::Near(sigma.max(SMALLEST_SIGMA)),
        _ => PRIORS[parameter],
    }
}

/// Smallest standard deviation of a calibrated retardance in rad: narrower priors add nothing but rounding.
const SMALLEST_SIGMA: f64 = 1e-4;

/// Index of the film's retardance.
const RETARDANCE: usize = 2;

/// Whether the film has the largest retardance of the search, so that the true one may be larger.
pub(crate) fn at_limit(film: &Film) -> bool {
    film.retardance.abs() > 0.99 * LIMITS[RETARDANCE]
}

/// Indices of stray light, and of the parameter that only affects bare metal.
const STRAY: usize = 7;
const SHADE: usize = 8;

/// A set of fitted parameters, and the optical effects that it adds to the film.
type Set = (&'static [usize], &'static [&'static str]);
const SETS: [Set; 4] = [
    (&[0, 1, 2, 3], &[]),
    (&[0, 1, 2, 3, STRAY], &["stray"]),
    (&[0, 1, 2, 3, 4, 5, STRAY], &["stray", "front"]),
    (&[0, 1, 2, 3, 4, 5, 6, STRAY], &["stray", "front", "source"]),
];

/// Sets with metal without a grating in view, whose shade only affects stray light and the front reflection.
const MIRROR_SETS: [Set; 4] = [
    (&[0, 1, 2, 3], &["mirror"]),
    (&[0, 1, 2, 3, STRAY, SHADE], &["stray", "mirror"]),
    (&[0, 1, 2, 3, 4, 5, STRAY, SHADE], &["stray", "front", "mirror"]),
    (&[0, 1, 2, 3, 4, 5, 6, STRAY, SHADE], &["stray", "front", "source", "mirror"]),
];

/// A grating that reflects a single polarization, for which ζ is irrelevant. Its light is fully polarized except for
/// the film: the circle's radius is nearly 1.
pub(crate) const POLARIZER: Set = (&[2, 3], &["polarizer"]);
const POLARIZED: f64 = 0.9;

/// Near the polarizer limit ln r is hardly observable and the minimum is a valley: the search then holds ln r fixed at
/// several values.
const HELD: Set = (&[1, 2, 3], &[]);
const VALLEY: [f64; 4] = [1.0, 2.0, 3.5, 5.0];

/// Start of a search.
#[derive(Clone, Copy)]
pub(crate) enum Begin<'a> {
    /// Films of all kinds.
    Anywhere,
    /// Given films, from a search on nearly the same points.
    At(&'a [Film]),
}

/// Scatter variance about every curve, relative to the noise, from which bare metal is considered.
const MIRRORS_IN_VIEW: f64 = 1.2;

/// Scatter variance about a curve, relative to the noise, up to which points lie on it: two standard deviations for
/// [`SAMPLE`] points.
pub(crate) const ENOUGH: f64 = 1.05;

/// Fits the curve under the display's light with four to eight free parameters, and with bare metal where that fits
/// better.
pub(crate) fn curves(points: &[CloudPoint], circle: &Curve, begin: Begin<'_>, source: Source) -> Vec<Candidate> {
    let of = |count| thinned(points, count);
    let samples = Samples {
        first: of(FIRST_SAMPLE),
        second: of(SECOND_SAMPLE),
        last: of(SAMPLE),
        enough: ENOUGH,
        score: likelihood,
        source,
    };
    let begun = match begin {
        Begin::Anywhere => starts(&samples.first, circle, STARTS),
        Begin::At(films) => films.to_vec(),
    };
    let (mut sets, mut found) = (&SETS, samples.search_all(&SETS, begun.clone()));
    if found.widened > MIRRORS_IN_VIEW {
        let with_mirrors = samples.search_all(&MIRROR_SETS, begun.clone());
        if with_mirrors.score < found.score {
            (sets, found) = (&MIRROR_SETS, with_mirrors);
        }
    }
    // All films that explain the points have curves close to the best one, and sums about it distinguish them as all
    // points do.
    let Some(means) = found.best.and_then(|(set, film)| means_about(&set, &film, points)) else { return vec![] };
    let mut films = found.films();
    if let Begin::Anywhere = begin {
        films.extend(begun);
        films.extend(nearest(&means, STARTS));
    }
    let of_means = Samples {
        first: means.clone(),
        second: means.clone(),
        last: means.clone(),
        enough: 0.0,
        score: |_, f| f.cost,
        source,
    };
    let found = of_means.search_all(sets, films);
    // A minimum for fewer or more parameters is a good start for another set.
    let films = found.films();
    let polarized = 0.5 * (circle.at(0.0)[0] - circle.at(FRAC_PI_2)[0]).abs() > POLARIZED;
    let mut all = if polarized { finish(&POLARIZER, &films, &means, (points, source)) } else { vec![] };
    let polarizer = all.first().and_then(|c| c.film);
    all.extend(polarizer.into_iter().flat_map(|film| along_valley(&film, &means, points)));
    all.extend(sets.iter().flat_map(|set| finish(set, &films, &means, (points, source))));
    all
}

/// Candidates of the simplest set along the valley: the best ones for given ln r, starting from a polarizer behind a
/// film.
fn along_valley(polarizer: &Film, means: &[CloudPoint], points: &[CloudPoint]) -> Vec<Candidate> {
    let at = |ln_r: &f64| {
        let start = |k: u32| Film { zeta: FRAC_PI_4 * f64::from(k), ..*polarizer };
        let film = with_family_of(&HELD, polarizer.source, *ln_r, |family, film| {
            let fits = (0..8).filter_map(|k| family.fit(means, &free_parameters(HELD.0, &start(k)), 30));
            fits.min_by(|a, b| a.cost.total_cmp(&b.cost)).map(|fit| film(&fit.parameters))
        })?;
        let set = &SETS[0];
        with_family(set, polarizer.source, |family, _| {
            Some(candidate(set, family, &family.at(points, free_parameters(set.0, &film))?, film, points))
        })
    };
    VALLEY.par_iter().filter_map(at).collect()
}

/// Sums of all points about a film's curve, after it is fitted to them.
fn means_about(set: &Set, film: &Film, points: &[CloudPoint]) -> Option<Vec<CloudPoint>> {
    let fitted = with_family(set, film.source, |family, _| family.fit(points, &free_parameters(set.0, film), 10))?;
    Some(segment_means(points, &fitted.curve))
}

/// Result of a search.
struct Found {
    /// The most promising films per set of parameters.
    films: Vec<(Set, Vec<Film>)>,
    /// The best of all, its −2 ln likelihood, and the scatter variance of the points about it relative to their noise.
    best: Option<(Set, Film)>,
    score: f64,
    widened: f64,
}

impl Found {
    fn films(&self) -> Vec<Film> {
        self.films.iter().flat_map(|(_, films)| films).copied().collect()
    }
}

/// Nested samples of the points, and the score that ranks fits to them.
struct Samples {
    first: Vec<CloudPoint>,
    second: Vec<CloudPoint>,
    last: Vec<CloudPoint>,
    /// Scatter variance relative to the noise below which no more parameters are needed.
    enough: f64,
    score: fn(&[CloudPoint], &Fitted) -> f64,
    /// Light of the display.
    source: Source,
}

impl Samples {
    /// Searches with one set of parameters after the other. Each starts from the previous result and from many other
    /// films.
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
        with_family(set, self.source, |family, film| {
            let fits = begun.par_iter().filter_map(|start| family.fit(&self.first, &free_parameters(free, start), 8));
            let mut first = best_first(fits, |f| score(&self.first, f));
            first.truncate(SECOND_STARTS);
            let fits = first.par_iter().filter_map(|(_, f)| family.fit(&self.second, &f.parameters, 25));
            let first = distinct(best_first(fits, |f| score(&self.second, f)));
            let fits = first.par_iter().filter_map(|f| family.fit(&self.last, &f.parameters, 30));
            let best = best_first(fits, |f| score(&self.last, f));
            best.iter().map(|(score, f)| (*score, f.cost, film(&f.parameters))).collect()
        })
    }
}

/// Whether two curves give the same orientations.
pub(crate) fn alike(a: &Curve, b: &Curve) -> bool {
    same_orientations(a, b, SAME)
}

/// Candidates of a set from the most promising films: the best one, and others with an equal fit but other
/// orientations.
fn finish(
    set: &Set,
    films: &[Film],
    means: &[CloudPoint],
    (points, source): (&[CloudPoint], Source),
) -> Vec<Candidate> {
    let free = set.0;
    with_family(set, source, |family, film| {
        let fits = films.par_iter().filter_map(|start| family.fit(means, &free_parameters(free, start), 60));
        let near = distinct(best_first(fits, |f| f.cost));
        let fits = near.par_iter().take(2).filter_map(|f| family.fit(points, &f.parameters, 10));
        // A front reflection, retarder error or stray light at its limit indicates an unmodelled effect.
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
        curve: fit.curve.in_phase(),
        center: None,
        prior: fit.prior,
        information_gain: Some(family.information_gain(fit, widened)),
        widened,
        uncertain: family.spread(&with_wide_front_prior(set, fit), &thinned(points, SPREAD), widened),
        film: Some(film),
    }
}

/// A fit with the wider prior of the front reflection.
fn with_wide_front_prior(set: &Set, fit: &Fitted) -> Fitted {
    let mut fit = fit.clone();
    for (i, k) in set.0.iter().enumerate().filter(|(_, k)| FRONT.contains(k)) {
        fit.information[(i, i)] += WIDE_FRONT.information(0.0) - PRIORS[*k].information(0.0);
    }
    fit
}

/// The set of parameters of a candidate; `None` for a circle.
fn set_of(like: &Candidate) -> Option<&'static Set> {
    SETS.iter().chain(&MIRROR_SETS).chain([&POLARIZER]).find(|set| like.film.is_some() && set.1 == like.extended)
}

/// Refits a candidate's model to other points, starting from its parameters.
pub(crate) fn refitted(like: &Candidate, points: &[CloudPoint]) -> Option<Candidate> {
    let Some(film) = like.film else { return candidates(points).into_iter().find(|c| c.model == like.model) };
    let set = set_of(like)?;
    with_family(set, film.source, |family, of| {
        let fit = family.fit(points, &free_parameters(set.0, &film), 30)?;
        Some(candidate(set, family, &fit, of(&fit.parameters), points))
    })
}

/// The maximum-likelihood curve near a film, with the parameters of a candidate; `None` for a circle. The scatter keeps
/// the noise reference of the candidate, since the variances of these points may already be widened.
pub(crate) fn with_max_likelihood(like: &Candidate, start: Film, points: &[CloudPoint]) -> Option<Candidate> {
    let set = set_of(like)?;
    with_family(set, start.source, |family, film| {
        let fit = maximise_likelihood(family, &family.at(points, free_parameters(set.0, &start))?, points);
        let found = candidate(set, family, &fit, film(&fit.parameters), points);
        Some(Candidate { widened: like.widened, ..found })
    })
}

/// −2 ln likelihood of points and of the parameters of a fit to them.
fn likelihood(points: &[CloudPoint], fit: &Fitted) -> f64 {
    let of_points = if points.len() < NPMLE_MIN_POINTS {
        evidence::misfit(points, &fit.curve)
    } else {
        npmle::terms(points, &fit.curve).iter().sum()
    };
    of_points + fit.prior
}

/// The same film with front reflections of all phases, weaker over bare metal: from zero, a fit may converge to another
/// minimum.
fn with_fronts(film: &Film) -> Vec<Film> {
    let fronts = (0..8).map(|k| Complex::from_polar(0.1, FRAC_PI_4 * f64::from(k)));
    fronts.map(|front| Film { front: film.front + front, shade: 0.5, ..*film }).collect()
}

/// The free parameters of a film.
fn free_parameters(free: &[usize], film: &Film) -> Vec<f64> {
    let all = film.to_array();
    free.iter().map(|k| all[*k].clamp(-LIMITS[*k], LIMITS[*k])).collect()
}

/// Whether a set includes bare metal.
fn mirrors(set: &Set) -> bool {
    set.1.contains(&"mirror")
}

/// Calls `work` with the family of films whose other parameters are 0, and with the map from parameters to films.
fn with_family<T>(
    set: &Set,
    source: Source,
    work: impl FnOnce(&Family<'_>, &(dyn Fn(&[f64]) -> Film + Sync)) -> T,
) -> T {
    with_family_of(set, source, if set.1 == POLARIZER.1 { LIMITS[0] } else { 0.0 }, work)
}

/// As [`with_family`], with a fixed ln r where it is no parameter.
fn with_family_of<T>(
    set: &Set,
    source: Source,
    ln_r: f64,
    work: impl FnOnce(&Family<'_>, &(dyn Fn(&[f64]) -> Film + Sync)) -> T,
) -> T {
    let (free, mirrors) = (set.0, mirrors(set));
    let film = |p: &[f64]| {
        let mut all = [0.0; PARAMETERS];
        all[0] = ln_r;
        for (k, value) in free.iter().zip(p) {
            all[*k] = *value;
        }
        Film { source, ..Film::from_array(all) }
    };
    let priors: Vec<Prior> = free.iter().map(|k| prior_of(*k, &source)).collect();
    let limits: Vec<f64> = free.iter().map(|k| LIMITS[*k]).collect();
    let curve = |p: &[f64]| if mirrors { film(p).curve_and_mirror() } else { film(p).curve() };
    work(&Family { curve: &curve, priors: &priors, limits: &limits }, &film)
}

/// Fits with their scores, the smallest first.
fn best_first(fits: impl ParallelIterator<Item = Fitted>, score: impl Fn(&Fitted) -> f64 + Sync) -> Vec<(f64, Fitted)> {
    let mut scored: Vec<(f64, Fitted)> = fits.map(|fit| (score(&fit), fit)).collect();
    scored.sort_by(|a, b| a.0.total_cmp(&b.0));
    scored
}

/// The best fits with distinct orientations, up to a common offset: first those of other minima with a nearly equal
/// score, then others of the same minimum. With more parameters the next minimum may become the lower one.
fn distinct(fits: Vec<(f64, Fitted)>) -> Vec<Fitted> {
    let worst_cost = fits.first().map_or(0.0, |(_, best)| 2.0 * best.cost);
    let (mut minima, mut others): (Vec<Fitted>, Vec<Fitted>) = (vec![], vec![]);
    for (_, fit) in fits {
        let near = |other: &Fitted, limit| same_orientations(&fit.curve, &other.curve, limit);
        if minima.len() + others.len() == FINALISTS || minima.iter().chain(&others).any(|other| near(other, SAME)) {
            continue;
        }
        let known = minima.iter().any(|other| near(other, SAME_MINIMUM));
        if known || fit.cost > worst_cost { others.push(fit) } else { minima.push(fit) }
    }
    minima.append(&mut others);
    minima
}

/// Whether orientations under two curves differ by at most `limit` in rad, after removal of a common offset.
fn same_orientations(a: &Curve, b: &Curve, limit: f64) -> bool {
    const PLACES: usize = 24;
    let curve_samples = CurveSamples::new(*b);
    let turns: Vec<f64> = (0..PLACES)
        .map(|k| {
            let theta = PI * k as f64 / PLACES as f64;
            let point = CloudPoint { pixel: 0, at: a.at(theta), covariance: [1.0, 0.0, 1.0], snr: 0.0 };
            curve_samples.closest_point(&point).theta - theta
        })
        .collect();
    let (sin, cos) = turns.iter().fold((0.0, 0.0), |(s, c), t| (s + (2.0 * t).sin(), c + (2.0 * t).cos()));
    let offset = 0.5 * f64::atan2(sin, cos);
    turns.iter().all(|t| angle_difference(*t, offset).abs() < limit)
}

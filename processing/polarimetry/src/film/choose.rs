//! Selects the model, by evidence or by request, and estimates its systematic error.

use crate::angle_difference;
use crate::film::check::{WIDEST_GAP_DEG, gap, lie_together};
use crate::film::cloud::{CloudPoint, SAMPLE, thinned};
use crate::film::curve::Source;
use crate::film::models::{Candidate, Evidence, Model, NPMLE_MIN_POINTS, candidates, orientation};
use crate::film::projection::CurveSamples;
use crate::film::search::{Begin, ENOUGH, POLARIZER, alike, at_limit, curves, with_max_likelihood};
use nacre_base::statistics::quantile;
use nalgebra::{Matrix3, Vector3};
use std::borrow::Cow;

/// Penalised −2 ln likelihood within which a model behind the best remains plausible (10 corresponds to odds of 150 :
/// 1), and the same limit in standard deviations of the difference. Plausible alternatives cause a warning.
pub(crate) const PLAUSIBLE_DELTA: f64 = 10.0;
pub(crate) const PLAUSIBLE_SIGMAS: f64 = 2.0;

/// Parsimony limit: among all kinds of model, the simplest one within this −2 ln likelihood of the best is selected,
/// with its best parameters. The evidence is uncertain by this amount, and most films need no more parameters.
const PARSIMONY_DELTA: f64 = 8.0;

/// Scatter of points about every curve, relative to the curve's size, above which the points form no curve; it must
/// also exceed twice the noise.
const NO_CURVE: f64 = 0.15;
const NO_CURVE_WIDENED: f64 = 4.0;

/// Scatter variance relative to noise above which no model describes the data, so the model's error is unknown (a
/// factor of two in the scatter).
pub(crate) const UNEXPLAINED: f64 = 4.0;

/// Scatter variance relative to noise from which a model needs a minimum advantage per point over a simpler one.
const UNMODELLED_WIDENED: f64 = 1.2;
const UNMODELLED: f64 = 0.005;

/// Analyser-angle errors distort all points jointly, and a model with more parameters may fit this distortion. Its
/// advantage must exceed the distortion by this factor: the errors amount to about five degrees of freedom, whose χ² is
/// rarely three times its expected value.
const DISTORTION_FACTOR: f64 = 3.0;

/// Number of points below which films are only considered if points lie on their curve within the noise. Below
/// [`NPMLE_MIN_POINTS`] points, they must also be far off every circle. Below the second limit `auto` considers no
/// film.
const CURVE_POINTS: usize = 5000;
const FEW_CURVE_POINTS: usize = 1000;

/// Limit in −2 ln likelihood, on a sample, beyond which a candidate is excluded from the comparison on all points.
///
/// In 60 draws of `choose_tests`, 226 candidates were within 10 of the best on all points. On a sample they were up to
/// 32 behind, as fewer points determine the orientation distribution less well. A limit of 50 would exclude 13 more of
/// all 606.
const PRUNE_DELTA: f64 = 100.0;

/// Ratio of the error along a curve that is taken for a circle to the scatter across it. It is the median over the 146
/// films drawn in `choose_tests` that leave a circle by more than their noise (10 % quantile 1.8, 90 % quantile 11.7).
const ALONG_TO_ACROSS: f64 = 6.0;

/// Minimum number of points for a circle fit.
const MIN_POINTS: usize = 20;

/// Limits for accepting a centred circle without a comparison with other models: its scatter variance relative to the
/// noise, and the orientation change in degrees by a fitted centre.
const GOOD_WIDENED: f64 = 1.05;
const GOOD_CENTER_DEG: f64 = 0.02;

/// Share of a normal distribution within one standard deviation.
const ONE_SIGMA: f64 = 0.683;

/// The candidates and the selected one.
pub(crate) struct Choice {
    pub candidates: Vec<Candidate>,
    /// Penalised −2 ln likelihood of each candidate, minus that of the best.
    pub behind: Vec<f64>,
    /// Standard deviation of its difference from the candidate that is assumed to be true.
    pub difference_sigma: Vec<f64>,
    /// 68 % quantile of the orientation differences from the selected candidate, in rad.
    pub differences: Vec<f64>,
    pub chosen: usize,
    /// Index of the candidate assumed to be true: the selected one, or the most likely one if the model was given.
    pub assumed: usize,
    /// Penalised −2 ln likelihood of the chosen model.
    pub likelihood: f64,
    /// Scatter variance about the selected curve, relative to the noise.
    pub widened: f64,
    pub reason: String,
    /// Whether any model explains the points.
    pub explained: bool,
    /// Orientation error in rad that the model may cause; `None` if no model explains the points.
    pub error: Option<f64>,
    /// This error or, if it is unknown, the largest difference from other models: a lower bound for σ.
    pub systematic: f64,
}

/// Selects a model for points with modulation. `distorted` is the variance of the points' displacement by
/// analyser-angle errors, relative to their noise. `None` for fewer than 20 points.
pub(crate) fn choose(
    points: &[CloudPoint],
    wanted: Model,
    begin: Begin<'_>,
    distorted: f64,
    source: Source,
) -> Option<Choice> {
    if points.len() < MIN_POINTS {
        return None;
    }
    let (mut candidates, count) = (candidates(points), points.len());
    let together = wanted == Model::Auto && lie_together(points);
    if together {
        candidates.retain(|c| c.model == Model::Sinusoid);
    }
    let enough = wanted != Model::Curve && sinusoid_is_enough(&candidates, points);
    // If the model is given, the others only determine its error, for which a sample of the points suffices.
    let given = !matches!(wanted, Model::Auto | Model::Curve);
    let points = &*if given { Cow::Owned(thinned(points, SAMPLE)) } else { Cow::Borrowed(points) };
    let least = |all: &[Candidate]| all.iter().map(|c| c.widened).fold(f64::INFINITY, f64::min);
    let few = match wanted {
        Model::Curve => false,
        Model::Auto if least(&candidates) < UNEXPLAINED => count < NPMLE_MIN_POINTS,
        _ => count < FEW_CURVE_POINTS,
    };
    if !enough && !few && !together {
        let circle = candidates.last()?.curve;
        let all = wanted == Model::Curve || count >= CURVE_POINTS;
        // In a small map the edge pixels are kept, and would be mistaken for metal without a grating.
        let to_their_noise = |c: &Candidate| c.curve.mirror.is_none() && c.widened < UNMODELLED_WIDENED;
        let found = curves(points, &circle, begin, source);
        candidates.extend(found.into_iter().filter(|c| all || to_their_noise(c)));
    }
    let widened = least(&candidates);
    let each = compare(&mut candidates, points, widened);
    let evidence: Vec<f64> = each.iter().map(|e| e.total).collect();
    let most_likely = |of: &dyn Fn(&Candidate) -> bool| {
        let all = (0..candidates.len()).filter(|k| of(&candidates[*k]));
        all.min_by(|a, b| evidence[*a].total_cmp(&evidence[*b]))
    };
    let best = most_likely(&|_| true)?;
    // Points that scatter more than their noise deviate from every model, and additional parameters would fit that
    // excess.
    let unmodelled = if widened > UNMODELLED_WIDENED { UNMODELLED } else { 0.0 };
    let unmodelled = unmodelled.max(DISTORTION_FACTOR * distorted) * points.len() as f64;
    let explained = explains(&candidates[best], points);
    let chosen = match wanted {
        Model::Auto if !explained => most_likely(&|c| c.model == Model::Sinusoid)?,
        Model::Auto => {
            let as_good = |k: &usize| evidence[*k] <= evidence[best] + unmodelled.max(PARSIMONY_DELTA);
            let simplest = &candidates[(0..candidates.len()).find(as_good)?];
            let simple = most_likely(&|c| (c.model, c.extended) == (simplest.model, simplest.extended))?;
            let film = most_likely(&|c| c.film.is_some()).filter(|film| {
                let difference_sigma = each[*film].difference_sigma(&each[simple]);
                evidence[*film] - evidence[simple] < PLAUSIBLE_DELTA.max(PLAUSIBLE_SIGMAS * difference_sigma)
            });
            film.filter(|film| contradicts(&candidates[*film], &candidates[simple], points)).unwrap_or(simple)
        }
        model => most_likely(&|c| c.model == model)?,
    };
    // The error of a given model is its difference from the most likely one, if that one explains the points.
    let assumed = if given { best } else { chosen };
    let difference_sigma: Vec<f64> = each.iter().map(|e| e.difference_sigma(&each[assumed])).collect();
    let behind: Vec<f64> = evidence.iter().map(|e| e - evidence[best]).collect();
    let differences: Vec<f64> = candidates.iter().map(|c| difference(c, &candidates[chosen], points)).collect();
    let mut choice = Choice {
        widened: candidates[chosen].widened,
        reason: reason(wanted, &candidates, &behind, chosen, explained, enough),
        likelihood: evidence[chosen],
        candidates,
        difference_sigma,
        behind,
        differences,
        chosen,
        assumed,
        explained,
        error: None,
        systematic: 0.0,
    };
    choice.estimate_error(points, unmodelled);
    Some(choice)
}

impl Choice {
    /// Estimates the error of the selected model. Candidates without more parameters than the assumed one count as
    /// equally likely within `unmodelled`.
    fn estimate_error(&mut self, points: &[CloudPoint], unmodelled: f64) {
        let Self { candidates, difference_sigma, behind, differences, chosen, assumed, .. } = &*self;
        let all = 0..candidates.len();
        let widened = candidates.iter().map(|c| c.widened).fold(f64::INFINITY, f64::min);
        // A circle about another point than the origin is the first-order effect of films, and a polarizer behind a
        // film looks like any grating of ζ 90° behind another film. One of the films is therefore correct, regardless
        // of the penalty for its parameters.
        let made_by_films =
            candidates[*assumed].center.map_or(candidates[*assumed].extended == POLARIZER.1, |c| c != [0.0; 2]);
        let films = all.clone().filter(|k| made_by_films && k != assumed && candidates[*k].film.is_some());
        let most_likely_film = films.map(|k| behind[k]).reduce(f64::min).unwrap_or(f64::NEG_INFINITY);
        // An alternative contributes its difference, weighted by the root of its probability.
        let of_rival = |k: usize| {
            if k == *assumed {
                return differences[k];
            }
            let film = if candidates[k].film.is_some() { most_likely_film } else { f64::NEG_INFINITY };
            // Unmodelled scatter does not favour a candidate that is behind despite more parameters.
            let simple = candidates[k].parameters <= candidates[*assumed].parameters;
            let ahead = behind[k] - behind[*assumed].max(film) - if simple { unmodelled } else { 0.0 };
            let odds =
                0.5 * libm::erfc(ahead / difference_sigma[k].max(0.5 * PLAUSIBLE_DELTA) / std::f64::consts::SQRT_2);
            // Uncertainty of the alternative's parameters, from the points and the prior.
            odds.sqrt() * differences[k].hypot(candidates[k].uncertain)
        };
        let rivals = all.clone().map(of_rival).fold(0.0, f64::max);
        let assumed = &candidates[*assumed];
        // The parameters of bare metal (stray light, front reflection) are only valid if the points lie on the curve.
        let limit = if assumed.curve.mirror.is_some() { UNMODELLED_WIDENED } else { UNEXPLAINED };
        let known = self.explained && assumed.widened < limit && !assumed.film.is_some_and(|f| at_limit(&f));
        let error = known.then(|| candidates[*chosen].uncertain.hypot(rivals));
        // Otherwise the only estimate is the difference from models of slightly lower likelihood.
        let of_other = |k: usize| differences[k] * (widened / candidates[k].widened).sqrt();
        let guessed = || all.map(of_other).fold(rivals, f64::max);
        // For too few points for a curve, the error along the circle is estimated from the scatter across it.
        let along = if candidates.iter().all(|c| c.film.is_none()) && widened > scatter_limit(points.len()) {
            ALONG_TO_ACROSS * (widened - 1.0).sqrt() * typical_sigma(assumed, points)
        } else {
            0.0
        };
        self.systematic = error.unwrap_or_else(guessed).hypot(along);
        self.error = error;
    }
}

/// Whether a film gives orientations different from those of an off-centre circle. Such a circle is the first-order
/// approximation of two films with different orientations, which only a fit of both films can distinguish.
fn contradicts(film: &Candidate, simple: &Candidate, points: &[CloudPoint]) -> bool {
    simple.center.is_some_and(|c| c != [0.0; 2]) && difference(film, simple, points) > typical_sigma(simple, points)
}

/// Upper limit (two standard deviations) of the scatter variance of `points` points about their true curve, relative to
/// their noise.
fn scatter_limit(points: usize) -> f64 {
    ENOUGH.max(1.0 + 2.0 * (2.0 / points as f64).sqrt())
}

/// Evidence of each candidate, that of excluded ones from a sample of the points. The likelihood of the other curves is
/// maximised first.
fn compare(candidates: &mut Vec<Candidate>, points: &[CloudPoint], widened: f64) -> Vec<Evidence> {
    let few = thinned(points, SAMPLE);
    let least = |all: &[Evidence]| all.iter().map(|e| e.total).fold(f64::INFINITY, f64::min);
    let mut first: Vec<Evidence> = candidates.iter().map(|c| c.evidence(&few, widened)).collect();
    if points.len() >= NPMLE_MIN_POINTS {
        let noisier: Vec<CloudPoint> = points.iter().map(|p| p.with_noise(widened)).collect();
        let pruned_from = least(&first) + PRUNE_DELTA;
        let pairs: Vec<(Candidate, Evidence)> = candidates.drain(..).zip(first).collect();
        (*candidates, first) = with_maximum_likelihood(&pairs, pruned_from, &noisier, |c| c.evidence(&few, widened));
    }
    let least = least(&first);
    let scale = points.len() as f64 / few.len().max(1) as f64;
    let kept: Vec<Option<Evidence>> = candidates
        .iter()
        .zip(&first)
        .map(|(c, e)| {
            let of_all = || if few.len() < points.len() { c.evidence(points, widened) } else { e.clone() };
            (e.total <= least + PRUNE_DELTA).then(of_all)
        })
        .collect();
    let best = kept.iter().flatten().map(|e| e.total).fold(f64::INFINITY, f64::min);
    let or_scaled = |(all, few): (Option<Evidence>, Evidence)| all.unwrap_or_else(|| few.scaled(least, scale, best));
    kept.into_iter().zip(first).map(or_scaled).collect()
}

/// The candidates in the same order, with maximised likelihood unless they are excluded.
fn with_maximum_likelihood(
    pairs: &[(Candidate, Evidence)],
    pruned_from: f64,
    noisier: &[CloudPoint],
    evidence: impl Fn(&Candidate) -> Evidence,
) -> (Vec<Candidate>, Vec<Evidence>) {
    let mut done: Vec<(Candidate, Evidence)> = vec![];
    for of_set in pairs.chunk_by(|(a, _), (b, _)| (a.model, a.extended) == (b.model, b.extended)) {
        let first = done.len();
        for (candidate, before) in of_set {
            let kept = before.total <= pruned_from;
            let Some(now) =
                candidate.film.filter(|_| kept).and_then(|film| with_max_likelihood(candidate, film, noisier))
            else {
                done.push((candidate.clone(), before.clone()));
                continue;
            };
            // If the search did not move, the likelihood of the points is unchanged.
            let here = now.curve == candidate.curve;
            let of_now = if here { now.penalised(before.terms.clone()) } else { evidence(&now) };
            let now = (now, of_now);
            // Different starts with the same parameters may converge to nearly the same curve.
            match done[first..].iter_mut().find(|(c, _)| alike(&c.curve, &now.0.curve)) {
                Some(known) if known.1.likelihood <= now.1.likelihood => {}
                Some(known) => *known = now,
                None => done.push(now),
            }
        }
    }
    done.into_iter().unzip()
}

/// Whether points lie on a circle within their noise, without large gaps.
pub(crate) fn is_ring(points: &[CloudPoint]) -> bool {
    if points.len() < NPMLE_MIN_POINTS || lie_together(points) {
        return false;
    }
    let circles = candidates(&thinned(points, SAMPLE));
    let all_around = |center: [f64; 2]| gap(&points.iter().map(|p| p.at).collect::<Vec<_>>(), center) <= WIDEST_GAP_DEG;
    circles.last().is_some_and(|c| c.widened < UNMODELLED_WIDENED && c.center.is_some_and(all_around))
}

/// Median σ of the orientations from noise, in rad.
fn typical_sigma(candidate: &Candidate, points: &[CloudPoint]) -> f64 {
    let curve_samples = CurveSamples::new(candidate.curve);
    let mut all: Vec<f64> =
        thinned(points, SAMPLE).iter().map(|p| orientation(candidate, &curve_samples, p).1).collect();
    nacre_base::statistics::median(&mut all).unwrap_or(0.0)
}

/// Whether a circle about the origin explains the points.
fn sinusoid_is_enough(simple: &[Candidate], points: &[CloudPoint]) -> bool {
    let of = |model| simple.iter().find(|c| c.model == model);
    let (Some(sinusoid), Some(circle)) = (of(Model::Sinusoid), of(Model::Circle)) else { return false };
    let Some([x, y]) = circle.center else { return false };
    // The mean of |sin| over a turn, halved, since orientations change by half the phase.
    let cost_deg = (x.hypot(y) / circle.size() / std::f64::consts::PI).to_degrees();
    sinusoid.widened < GOOD_WIDENED && cost_deg < GOOD_CENTER_DEG && ellipse(sinusoid, points) < PLAUSIBLE_DELTA
}

/// Advantage in −2 ln likelihood of an ellipse over a circle about the origin. A film over a grating of ζ 90° produces
/// an ellipse, detectable long before individual points leave the circle by more than their noise.
fn ellipse(circle: &Candidate, points: &[CloudPoint]) -> f64 {
    let curve_samples = CurveSamples::new(circle.curve);
    let (mut normal, mut moment) = (Matrix3::zeros(), Vector3::zeros());
    for p in points {
        let closest = curve_samples.closest_point(p);
        // The gradient's length is 1/σ across the circle.
        let weight = closest.gradient[0].hypot(closest.gradient[1]);
        let (sin, cos) = (2.0 * p.at[1].atan2(p.at[0])).sin_cos();
        let row = Vector3::new(1.0, cos, sin) * weight;
        normal += row * row.transpose();
        moment += row * closest.distance;
    }
    normal.try_inverse().map_or(0.0, |inverse| moment.dot(&(inverse * moment)))
}

fn explains(candidate: &Candidate, points: &[CloudPoint]) -> bool {
    let curve_samples = CurveSamples::new(candidate.curve);
    let mut off: Vec<f64> = thinned(points, SAMPLE)
        .iter()
        .map(|p| {
            let closest = curve_samples.closest_point(p);
            closest.distance.abs() / closest.gradient[0].hypot(closest.gradient[1])
        })
        .collect();
    let at = off.len() * 4 / 5;
    let off = *off.select_nth_unstable_by(at, f64::total_cmp).1 / 1.2816;
    candidate.widened < NO_CURVE_WIDENED || off < NO_CURVE * candidate.size()
}

/// 68 % quantile of the absolute orientation differences between two models in rad, after the best common offset;
/// comparable with σ.
fn difference(a: &Candidate, b: &Candidate, points: &[CloudPoint]) -> f64 {
    difference_of((a, points), (b, points))
}

/// As [`difference`], with separate points for each model.
pub(crate) fn difference_of(a: (&Candidate, &[CloudPoint]), b: (&Candidate, &[CloudPoint])) -> f64 {
    let (of_a, of_b) = (CurveSamples::new(a.0.curve), CurveSamples::new(b.0.curve));
    let step = a.1.len().div_ceil(2000).max(1);
    let points = a.1.iter().zip(b.1).step_by(step);
    let pairs: Vec<f64> = points.map(|(p, q)| orientation(a.0, &of_a, p).0 - orientation(b.0, &of_b, q).0).collect();
    let (sin, cos) = pairs.iter().fold((0.0, 0.0), |(s, c), d| (s + (2.0 * d).sin(), c + (2.0 * d).cos()));
    let offset = 0.5 * f64::atan2(sin, cos);
    let mut off: Vec<f64> = pairs.iter().map(|d| angle_difference(*d, offset).abs()).collect();
    quantile(&mut off, ONE_SIGMA).unwrap_or(0.0)
}

fn reason(
    wanted: Model,
    candidates: &[Candidate],
    behind: &[f64],
    chosen: usize,
    explained: bool,
    enough: bool,
) -> String {
    if wanted != Model::Auto {
        return "asked for".into();
    }
    if enough && candidates[chosen].model == Model::Sinusoid {
        return "the points (S1/S0, S2/S0) lie on a circle about the origin to their noise".into();
    }
    if candidates.len() == 1 {
        return "the points (S1/S0, S2/S0) lie together away from the origin: they cannot tell a film from polarized light".into();
    }
    if !explained {
        return "no model explains the data, so it is the one that assumes least: see warnings".into();
    }
    let simpler = (0..candidates.len()).filter(|k| candidates[*k].parameters < candidates[chosen].parameters);
    match simpler.min_by(|a, b| behind[*a].total_cmp(&behind[*b])) {
        Some(next) => format!(
            "preferred over {}, penalised −2 ln likelihood lower by {:.0}",
            candidates[next].name(),
            behind[next] - behind[chosen]
        ),
        None => "no model with more parameters explains the points (S1/S0, S2/S0) better".into(),
    }
}

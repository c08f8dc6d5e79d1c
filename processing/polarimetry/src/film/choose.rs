//! Chooses the model: the one of most evidence, or the one that was asked for, and how far it may be wrong.

use crate::angle_difference;
use crate::film::check::{WIDEST_GAP_DEG, gap, lie_together};
use crate::film::cloud::{CloudPoint, SAMPLE, thinned};
use crate::film::foot::Path;
use crate::film::models::{Candidate, Evidence, MIXTURE, Model, candidates, orientation};
use crate::film::search::{Begin, ENOUGH, POLARIZER, alike, at_limit, curves, likelier};
use nacre_base::statistics::quantile;
use nalgebra::{Matrix3, Vector3};
use std::borrow::Cow;

/// A model that is behind the best by no more than this in -2 ln likelihood (10 is 150 : 1), or by no more than so many
/// standard deviations of chance, may be true as well, which is warned of.
pub(crate) const UNDECIDED: f64 = 10.0;
pub(crate) const UNDECIDED_SIGMA: f64 = 2.0;

/// The simplest kind of model that is behind the best by no more than this is taken, and the likeliest of that: as much is left to chance in the
/// evidence, and most films have no more to them.
const SIMPLER: f64 = 8.0;

/// Points that scatter farther from every curve than this share of the curve's size, and than twice their noise, form no
/// curve at all.
const NO_CURVE: f64 = 0.15;
const NO_CURVE_WIDENED: f64 = 4.0;

/// A scatter about the curve of more than twice the noise is something that no model holds, so that its error is unknown.
pub(crate) const UNEXPLAINED: f64 = 4.0;

/// Where the scatter is more than this times the noise (as a variance), a model must be likelier than a simpler one by
/// this much per point.
const UNMODELLED_WIDENED: f64 = 1.2;
const UNMODELLED: f64 = 0.005;

/// What wrong angles make of all points together a model of more parameters may explain: it must be likelier by so many times as much, as five or so
/// numbers, which the angles' errors come down to, are rarely three times as much as they should be.
const DISTORTED: f64 = 3.0;

/// Fewer points than this tell a film only where they lie on its curve to their noise, and fewer than the others only where they are
/// far off every circle, too.
const CURVE_POINTS: usize = 5000;
const FEW_CURVE_POINTS: usize = 1000;

/// How far behind (-2 ln likelihood of a sample) a candidate is left out when the others are compared on all points. In 60 draws
/// of `choose_tests` the 226 candidates that all points put within 10 of the best were up to 32 behind on a sample, as fewer points
/// tell less of the orientations in view; 50 would leave out 13 more of all 606.
const HOPELESS: f64 = 100.0;

/// How much farther along a curve that is taken for a circle points are off than across it: the median of the 146 films drawn in `choose_tests`
/// that leave a circle by more than their noise (a tenth of them less than 1.8, a tenth more than 11.7).
const BENT: f64 = 6.0;

/// With fewer points than this not even a circle is fitted.
const FEWEST_POINTS: usize = 20;

/// A centred circle that explains the points to this, with a centre that costs less than this in degrees, needs no
/// other model to compare with.
const GOOD_WIDENED: f64 = 1.05;
const GOOD_CENTER_DEG: f64 = 0.02;

/// Share of normal deviates within one standard deviation.
const ONE_SIGMA: f64 = 0.683;

/// The candidates, and which one it is.
pub(crate) struct Choice {
    pub candidates: Vec<Candidate>,
    /// Evidence of each, less that of the best: 0 is the likeliest.
    pub behind: Vec<f64>,
    /// Standard deviation that its difference from the one that is taken for right has by chance.
    pub chance: Vec<f64>,
    /// Difference of its orientations from those of the chosen one in rad, which 68 % of the points stay under.
    pub differences: Vec<f64>,
    pub chosen: usize,
    /// The one that is taken for right: the chosen one, or the likeliest where another one was asked for.
    pub right: usize,
    /// Penalised −2 ln likelihood of the chosen model.
    pub likelihood: f64,
    /// How much larger than the noise the scatter about the chosen curve is, as a variance.
    pub widened: f64,
    pub reason: String,
    /// Whether any model explains the points.
    pub explained: bool,
    /// Error of the orientations that the model may cause, in rad; None when no model explains the points.
    pub error: Option<f64>,
    /// The same, or where it is not known, what other models say of it: what σ must hold at least.
    pub systematic: f64,
}

/// Chooses among models by points that carry modulation, which wrong angles move by so much together, as a variance over that of their noise; None when
/// there are fewer than 20.
pub(crate) fn choose(points: &[CloudPoint], wanted: Model, begin: Begin<'_>, distorted: f64) -> Option<Choice> {
    if points.len() < FEWEST_POINTS {
        return None;
    }
    let (mut candidates, count) = (candidates(points), points.len());
    let together = wanted == Model::Auto && lie_together(points);
    if together {
        candidates.retain(|c| c.model == Model::Sinusoid);
    }
    let enough = wanted != Model::Curve && sinusoid_is_enough(&candidates, points);
    // Beside a model that was asked for, others only tell how wrong it is: a part of the points does.
    let asked = !matches!(wanted, Model::Auto | Model::Curve);
    let points = &*if asked { Cow::Owned(thinned(points, SAMPLE)) } else { Cow::Borrowed(points) };
    let least = |all: &[Candidate]| all.iter().map(|c| c.widened).fold(f64::INFINITY, f64::min);
    let few = match wanted {
        Model::Curve => false,
        Model::Auto if least(&candidates) < UNEXPLAINED => count < MIXTURE,
        _ => count < FEW_CURVE_POINTS,
    };
    if !enough && !few && !together {
        let circle = candidates.last()?.curve;
        let all = wanted == Model::Curve || count >= CURVE_POINTS;
        // In a small map the pixels at edges are left in, and would be taken for metal without a grating.
        let to_their_noise = |c: &Candidate| c.curve.mirror.is_none() && c.widened < UNMODELLED_WIDENED;
        let found = curves(points, &circle, begin);
        candidates.extend(found.into_iter().filter(|c| all || to_their_noise(c)));
    }
    let widened = least(&candidates);
    let each = compare(&mut candidates, points, widened);
    let evidence: Vec<f64> = each.iter().map(|e| e.total).collect();
    let likeliest = |of: &dyn Fn(&Candidate) -> bool| {
        let all = (0..candidates.len()).filter(|k| of(&candidates[*k]));
        all.min_by(|a, b| evidence[*a].total_cmp(&evidence[*b]))
    };
    let best = likeliest(&|_| true)?;
    // Points that scatter more than their noise are off every model alike, and more parameters find something in that.
    let unmodelled = if widened > UNMODELLED_WIDENED { UNMODELLED } else { 0.0 };
    let unmodelled = unmodelled.max(DISTORTED * distorted) * points.len() as f64;
    let explained = explains(&candidates[best], points);
    let chosen = match wanted {
        Model::Auto if !explained => likeliest(&|c| c.model == Model::Sinusoid)?,
        Model::Auto => {
            let as_good = |k: &usize| evidence[*k] <= evidence[best] + unmodelled.max(SIMPLER);
            let simplest = &candidates[(0..candidates.len()).find(as_good)?];
            let simple = likeliest(&|c| (c.model, c.extended) == (simplest.model, simplest.extended))?;
            let film = likeliest(&|c| c.film.is_some()).filter(|film| {
                let chance = each[*film].chance(&each[simple]);
                evidence[*film] - evidence[simple] < UNDECIDED.max(UNDECIDED_SIGMA * chance)
            });
            film.filter(|film| contradicts(&candidates[*film], &candidates[simple], points)).unwrap_or(simple)
        }
        model => likeliest(&|c| c.model == model)?,
    };
    // A model that was asked for is as wrong as it differs from the likeliest one, if that is right.
    let right = if asked { best } else { chosen };
    let chance: Vec<f64> = each.iter().map(|e| e.chance(&each[right])).collect();
    let behind: Vec<f64> = evidence.iter().map(|e| e - evidence[best]).collect();
    let differences: Vec<f64> = candidates.iter().map(|c| difference(c, &candidates[chosen], points)).collect();
    let mut choice = Choice {
        widened: candidates[chosen].widened,
        reason: reason(wanted, &candidates, &behind, chosen, explained, enough),
        likelihood: evidence[chosen],
        candidates,
        chance,
        behind,
        differences,
        chosen,
        right,
        explained,
        error: None,
        systematic: 0.0,
    };
    choice.doubt(points, unmodelled);
    Some(choice)
}

impl Choice {
    /// Finds how wrong the chosen model may be; no more complex others than the one that is right are as likely when they are behind by `unmodelled`.
    fn doubt(&mut self, points: &[CloudPoint], unmodelled: f64) {
        let Self { candidates, chance, behind, differences, chosen, right, .. } = &*self;
        let all = 0..candidates.len();
        let widened = candidates.iter().map(|c| c.widened).fold(f64::INFINITY, f64::min);
        // A circle about another place than the origin is what films make of it to first order, and a polarizer behind a film is what any grating of
        // ζ 90° looks like behind another one, so that one of these is right, however much more its parameters must be worth.
        let made_by_films =
            candidates[*right].center.map_or(candidates[*right].extended == POLARIZER.1, |c| c != [0.0; 2]);
        let films = all.clone().filter(|k| made_by_films && k != right && candidates[*k].film.is_some());
        let likeliest_film = films.map(|k| behind[k]).reduce(f64::min).unwrap_or(f64::NEG_INFINITY);
        // Whatever may be true as well costs its difference as often as it is true.
        let of_rival = |k: usize| {
            if k == *right {
                return differences[k];
            }
            let film = if candidates[k].film.is_some() { likeliest_film } else { f64::NEG_INFINITY };
            // What no model holds does not speak for one that is behind although it has more parameters.
            let simple = candidates[k].parameters <= candidates[*right].parameters;
            let ahead = behind[k] - behind[*right].max(film) - if simple { unmodelled } else { 0.0 };
            let odds = 0.5 * libm::erfc(ahead / chance[k].max(0.5 * UNDECIDED) / std::f64::consts::SQRT_2);
            // Its parameters may be off as far as the points and what was expected of them leave open.
            odds.sqrt() * differences[k].hypot(candidates[k].uncertain)
        };
        let rivals = all.clone().map(of_rival).fold(0.0, f64::max);
        let right = &candidates[*right];
        // What metal without a grating scatters, or reflects at its front, is only right where the points lie on the curve.
        let limit = if right.curve.mirror.is_some() { UNMODELLED_WIDENED } else { UNEXPLAINED };
        let known = self.explained && right.widened < limit && !right.film.is_some_and(|f| at_limit(&f));
        let error = known.then(|| candidates[*chosen].uncertain.hypot(rivals));
        // Otherwise, models that do little worse are the only measure.
        let of_other = |k: usize| differences[k] * (widened / candidates[k].widened).sqrt();
        let guessed = || all.map(of_other).fold(rivals, f64::max);
        // Of points too few for a curve, what lies across the circle tells of what lies along it.
        let bent = if candidates.iter().all(|c| c.film.is_none()) && widened > by_chance(points.len()) {
            BENT * (widened - 1.0).sqrt() * typical_sigma(right, points)
        } else {
            0.0
        };
        self.systematic = error.unwrap_or_else(guessed).hypot(bent);
        self.error = error;
    }
}

/// Whether a film gives other orientations than a circle about another place than the origin. Such a circle is the first order of two films with
/// different orientations, which only the films themselves decide between.
fn contradicts(film: &Candidate, simple: &Candidate, points: &[CloudPoint]) -> bool {
    simple.center.is_some_and(|c| c != [0.0; 2]) && difference(film, simple, points) > typical_sigma(simple, points)
}

/// What so many points may scatter by about the curve that they come from, as a variance over their noise: by two standard deviations.
fn by_chance(points: usize) -> f64 {
    ENOUGH.max(1.0 + 2.0 * (2.0 / points as f64).sqrt())
}

/// Evidence of each candidate, of the hopeless ones from a part of the points; the other curves are made as likely as
/// they can be first.
fn compare(candidates: &mut Vec<Candidate>, points: &[CloudPoint], widened: f64) -> Vec<Evidence> {
    let few = thinned(points, SAMPLE);
    let least = |all: &[Evidence]| all.iter().map(|e| e.total).fold(f64::INFINITY, f64::min);
    let mut first: Vec<Evidence> = candidates.iter().map(|c| c.evidence(&few, widened)).collect();
    if points.len() >= MIXTURE {
        let noisier: Vec<CloudPoint> = points.iter().map(|p| p.with_noise(widened)).collect();
        let hopeless = least(&first) + HOPELESS;
        let pairs: Vec<(Candidate, Evidence)> = candidates.drain(..).zip(first).collect();
        (*candidates, first) = made_likeliest(&pairs, hopeless, &noisier, |c| c.evidence(&few, widened));
    }
    let least = least(&first);
    let scale = points.len() as f64 / few.len().max(1) as f64;
    let hopeful: Vec<Option<Evidence>> = candidates
        .iter()
        .zip(&first)
        .map(|(c, e)| {
            let of_all = || if few.len() < points.len() { c.evidence(points, widened) } else { e.clone() };
            (e.total <= least + HOPELESS).then(of_all)
        })
        .collect();
    let best = hopeful.iter().flatten().map(|e| e.total).fold(f64::INFINITY, f64::min);
    let or_scaled = |(all, few): (Option<Evidence>, Evidence)| all.unwrap_or_else(|| few.scaled(least, scale, best));
    hopeful.into_iter().zip(first).map(or_scaled).collect()
}

/// The candidates, simplest first as before; the likelihood of those that are not hopeless is maximised.
fn made_likeliest(
    pairs: &[(Candidate, Evidence)],
    hopeless: f64,
    noisier: &[CloudPoint],
    evidence: impl Fn(&Candidate) -> Evidence,
) -> (Vec<Candidate>, Vec<Evidence>) {
    let mut done: Vec<(Candidate, Evidence)> = vec![];
    for of_set in pairs.chunk_by(|(a, _), (b, _)| (a.model, a.extended) == (b.model, b.extended)) {
        let first = done.len();
        for (candidate, before) in of_set {
            let hopeful = before.total <= hopeless;
            let Some(now) = candidate.film.filter(|_| hopeful).and_then(|film| likelier(candidate, film, noisier))
            else {
                done.push((candidate.clone(), before.clone()));
                continue;
            };
            // Where the search began, points are as likely as they were.
            let here = now.curve == candidate.curve;
            let of_now = if here { now.paid(before.terms.clone()) } else { evidence(&now) };
            let now = (now, of_now);
            // Others of the same parameters may end at nearly the same place.
            match done[first..].iter_mut().find(|(c, _)| alike(&c.curve, &now.0.curve)) {
                Some(known) if known.1.likelihood <= now.1.likelihood => {}
                Some(known) => *known = now,
                None => done.push(now),
            }
        }
    }
    done.into_iter().unzip()
}

/// Whether points lie on a circle to their noise, and all around it.
pub(crate) fn is_ring(points: &[CloudPoint]) -> bool {
    if points.len() < MIXTURE || lie_together(points) {
        return false;
    }
    let circles = candidates(&thinned(points, SAMPLE));
    let all_around = |center: [f64; 2]| gap(&points.iter().map(|p| p.at).collect::<Vec<_>>(), center) <= WIDEST_GAP_DEG;
    circles.last().is_some_and(|c| c.widened < UNMODELLED_WIDENED && c.center.is_some_and(all_around))
}

/// Median σ of the orientations from noise, in rad.
fn typical_sigma(candidate: &Candidate, points: &[CloudPoint]) -> f64 {
    let path = Path::new(candidate.curve);
    let mut all: Vec<f64> = thinned(points, SAMPLE).iter().map(|p| orientation(candidate, &path, p).1).collect();
    nacre_base::statistics::median(&mut all).unwrap_or(0.0)
}

/// A circle about the origin explains everything.
fn sinusoid_is_enough(simple: &[Candidate], points: &[CloudPoint]) -> bool {
    let of = |model| simple.iter().find(|c| c.model == model);
    let (Some(sinusoid), Some(circle)) = (of(Model::Sinusoid), of(Model::Circle)) else { return false };
    let Some([x, y]) = circle.center else { return false };
    // The mean of |sin| over the turn, halved: orientations turn by half as much as phases.
    let cost_deg = (x.hypot(y) / circle.size() / std::f64::consts::PI).to_degrees();
    sinusoid.widened < GOOD_WIDENED && cost_deg < GOOD_CENTER_DEG && ellipse(sinusoid, points) < UNDECIDED
}

/// How much likelier (-2 ln) an ellipse is than a circle about the origin: a film over a grating of ζ 90° makes one, long before single points are off
/// the circle by more than their noise.
fn ellipse(circle: &Candidate, points: &[CloudPoint]) -> f64 {
    let path = Path::new(circle.curve);
    let (mut normal, mut moment) = (Matrix3::zeros(), Vector3::zeros());
    for p in points {
        let foot = path.foot(p);
        // The gradient's length is 1/σ across the circle.
        let weight = foot.gradient[0].hypot(foot.gradient[1]);
        let (sin, cos) = (2.0 * p.at[1].atan2(p.at[0])).sin_cos();
        let row = Vector3::new(1.0, cos, sin) * weight;
        normal += row * row.transpose();
        moment += row * foot.distance;
    }
    normal.try_inverse().map_or(0.0, |inverse| moment.dot(&(inverse * moment)))
}

fn explains(candidate: &Candidate, points: &[CloudPoint]) -> bool {
    let path = Path::new(candidate.curve);
    let mut off: Vec<f64> = thinned(points, SAMPLE)
        .iter()
        .map(|p| {
            let foot = path.foot(p);
            foot.distance.abs() / foot.gradient[0].hypot(foot.gradient[1])
        })
        .collect();
    let at = off.len() * 4 / 5;
    let off = *off.select_nth_unstable_by(at, f64::total_cmp).1 / 1.2816;
    candidate.widened < NO_CURVE_WIDENED || off < NO_CURVE * candidate.size()
}

/// Difference of the orientations under two models after the best common offset in rad, which 68 % of the points stay under: it compares with σ.
fn difference(a: &Candidate, b: &Candidate, points: &[CloudPoint]) -> f64 {
    difference_of((a, points), (b, points))
}

/// The same where each model has points of its own.
pub(crate) fn difference_of(a: (&Candidate, &[CloudPoint]), b: (&Candidate, &[CloudPoint])) -> f64 {
    let (of_a, of_b) = (Path::new(a.0.curve), Path::new(b.0.curve));
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

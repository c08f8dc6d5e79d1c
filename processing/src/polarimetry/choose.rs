//! Chooses the model: the one of most evidence, or the one that was asked for, and how far it may be wrong.

use super::angle_difference;
use super::cloud::CloudPoint;
use super::foot::Path;
use super::models::{Candidate, Evidence, MIXTURE, Model, candidates, orientation};
use super::search::{Begin, at_limit, curves, likelier, thinned};
use serde::Serialize;
use std::borrow::Cow;

/// A model that is behind the best by no more than this in -2 ln likelihood (10 is 150 : 1), or by no more than so many
/// standard deviations of chance, may be true as well, which is warned of.
const UNDECIDED: f64 = 10.0;
const UNDECIDED_SIGMA: f64 = 2.0;

/// The simplest model that is behind the best by no more than this is taken: as much is left to chance in the evidence, and most films
/// have no more to them.
const SIMPLER: f64 = 8.0;

/// Points that scatter farther from every curve than this share of the curve's size, and than twice their noise, form no
/// curve at all.
const NO_CURVE: f64 = 0.15;
const NO_CURVE_WIDENED: f64 = 4.0;

/// A scatter about the curve of more than twice the noise is something that no model holds, so that its error is unknown.
const UNEXPLAINED: f64 = 4.0;

/// Where the scatter is more than this times the noise (as a variance), a model must be likelier than a simpler one by
/// this much per point.
const UNMODELLED_WIDENED: f64 = 1.2;
const UNMODELLED: f64 = 0.005;

/// Fewer points than this tell a film only where they lie on its curve to their noise, and fewer than the others only where they are
/// far off every circle, too.
const CURVE_POINTS: usize = 5000;
const FEW_CURVE_POINTS: usize = 1000;

/// Points on which all candidates are compared, and how far behind (-2 ln likelihood of these) one is left out when the others
/// are compared on all.
const LOOKED_AT: usize = 4000;
const HOPELESS: f64 = 100.0;

/// How much farther along a curve that is taken for a circle points are off than across it.
const BENT: f64 = 6.0;

/// With fewer points than this not even a circle is fitted.
const FEWEST_POINTS: usize = 20;

/// A centred circle that explains the points to this, with a centre that costs less than this in degrees, needs no
/// other model to compare with.
const GOOD_WIDENED: f64 = 1.05;
const GOOD_CENTER_DEG: f64 = 0.02;

/// The candidates, and which one it is.
pub(super) struct Choice {
    pub candidates: Vec<Candidate>,
    /// Evidence of each, less that of the best: 0 is the likeliest.
    pub behind: Vec<f64>,
    /// Standard deviation that its difference from the chosen one has by chance.
    pub chance: Vec<f64>,
    /// Mean difference of its orientations from those of the chosen one, in rad.
    pub differences: Vec<f64>,
    pub chosen: usize,
    /// -2 ln likelihood of the points under the chosen one, its parameters paid for.
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

/// Chooses among models by points that carry modulation; None when there are fewer than 20.
pub(super) fn choose(points: &[CloudPoint], wanted: Model, begin: Begin<'_>) -> Option<Choice> {
    if points.len() < FEWEST_POINTS {
        return None;
    }
    let mut candidates = candidates(points);
    let enough = wanted == Model::Auto && sinusoid_is_enough(&candidates);
    let least = |all: &[Candidate]| all.iter().map(|c| c.widened).fold(f64::INFINITY, f64::min);
    let fewest = if least(&candidates) < UNEXPLAINED { MIXTURE } else { FEW_CURVE_POINTS };
    let few = wanted == Model::Auto && points.len() < fewest;
    // Of a circle that was asked for, the curve tells how wrong it is.
    let asked = !matches!(wanted, Model::Auto | Model::Curve);
    let off = least(&candidates) > UNMODELLED_WIDENED && points.len() >= FEW_CURVE_POINTS;
    if !enough && !few && (!asked || off) {
        let circle = candidates.last()?.curve;
        let all = wanted == Model::Curve || points.len() >= CURVE_POINTS;
        // In a small map the pixels at edges are left in, and would be taken for metal without a grating.
        let to_their_noise = |c: &Candidate| c.curve.mirror.is_none() && c.widened < UNMODELLED_WIDENED;
        // Curves beside a circle that was asked for only tell how wrong it is: a part of the points finds them.
        let fitted_to = if asked { Cow::Owned(thinned(points, LOOKED_AT)) } else { Cow::Borrowed(points) };
        let found = curves(&fitted_to, &circle, begin);
        candidates.extend(found.into_iter().filter(|c| all || to_their_noise(c)));
    }
    let widened = least(&candidates);
    let each = compare(&mut candidates, points, widened);
    let evidence: Vec<f64> = each.iter().map(|e| e.total).collect();
    let likeliest = |model: Option<Model>| {
        (0..candidates.len())
            .filter(|k| model.is_none_or(|m| candidates[*k].model == m))
            .min_by(|a, b| evidence[*a].total_cmp(&evidence[*b]))
    };
    let best = likeliest(None)?;
    // Points that scatter more than their noise are off every model alike, and more parameters find something in that.
    let unmodelled = if widened > UNMODELLED_WIDENED { UNMODELLED * points.len() as f64 } else { 0.0 };
    let explained = explains(&candidates[best], points);
    let chosen = match wanted {
        Model::Auto if !explained => likeliest(Some(Model::Sinusoid))?,
        Model::Auto => (0..candidates.len()).find(|k| evidence[*k] <= evidence[best] + unmodelled.max(SIMPLER))?,
        model => likeliest(Some(model))?,
    };
    let chance: Vec<f64> = each.iter().map(|e| e.chance(&each[chosen])).collect();
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
        explained,
        error: None,
        systematic: 0.0,
    };
    // A model that was asked for is as wrong as it differs from the likeliest one, if that is right.
    choice.doubt(points, if asked { best } else { chosen }, unmodelled);
    Some(choice)
}

impl Choice {
    /// Finds how wrong the chosen model may be, if that of number `right` is right; no more complex others are as likely when they are
    /// behind by `unmodelled`.
    fn doubt(&mut self, points: &[CloudPoint], right: usize, unmodelled: f64) {
        let Self { candidates, chance, behind, differences, chosen, .. } = &*self;
        let all = 0..candidates.len();
        let widened = candidates.iter().map(|c| c.widened).fold(f64::INFINITY, f64::min);
        // A circle about another place than the origin is what films make of it to first order, so that one of these is right, however much more
        // its parameters must be worth.
        let off_origin = candidates[*chosen].center.is_some_and(|c| c != [0.0; 2]);
        let films = all.clone().filter(|k| off_origin && candidates[*k].film.is_some());
        let likeliest_film = films.map(|k| behind[k]).reduce(f64::min).unwrap_or(f64::NEG_INFINITY);
        // Whatever may be true as well costs its difference as often as it is true.
        let of_rival = |k: usize| {
            let film = if candidates[k].film.is_some() { likeliest_film } else { f64::NEG_INFINITY };
            // What no model holds does not speak for one that is behind although it has more parameters.
            let simple = candidates[k].parameters <= candidates[*chosen].parameters;
            let ahead = behind[k] - behind[*chosen].max(film) - if simple { unmodelled } else { 0.0 };
            let odds = 0.5 * libm::erfc(ahead / chance[k].max(0.5 * UNDECIDED) / std::f64::consts::SQRT_2);
            odds.sqrt() * differences[k]
        };
        let rivals = all.clone().map(of_rival).fold(0.0, f64::max);
        let right = &candidates[right];
        // What metal without a grating scatters, or reflects at its front, is only right where the points lie on the curve.
        let limit = if right.curve.mirror.is_some() { UNMODELLED_WIDENED } else { UNEXPLAINED };
        let known = self.explained && right.widened < limit && !right.film.is_some_and(|f| at_limit(&f));
        let error = known.then(|| candidates[*chosen].uncertain.hypot(rivals));
        // Otherwise, models that do little worse are the only measure.
        let of_other = |k: usize| differences[k] * (widened / candidates[k].widened).sqrt();
        let guessed = || all.map(of_other).fold(rivals, f64::max);
        // Of points too few for a curve, what lies across the circle tells of what lies along it.
        let bent = if candidates.iter().all(|c| c.film.is_none()) && widened > UNMODELLED_WIDENED {
            BENT * (widened - 1.0).sqrt() * typical_sigma(right, points)
        } else {
            0.0
        };
        self.systematic = error.unwrap_or_else(guessed).hypot(bent);
        self.error = error;
    }
}

/// Evidence of each candidate, of the hopeless ones from a part of the points; the other curves are made as likely as
/// they can be first.
fn compare(candidates: &mut [Candidate], points: &[CloudPoint], widened: f64) -> Vec<Evidence> {
    let few = thinned(points, LOOKED_AT);
    let of_few = |all: &[Candidate]| -> Vec<Evidence> { all.iter().map(|c| c.evidence(&few, widened)).collect() };
    let least = |all: &[Evidence]| all.iter().map(|e| e.total).fold(f64::INFINITY, f64::min);
    let mut first = of_few(candidates);
    let hopeless = least(&first) + HOPELESS;
    if points.len() >= MIXTURE {
        let noisier: Vec<CloudPoint> = points.iter().map(|p| p.with_noise(widened)).collect();
        for (candidate, _) in candidates.iter_mut().zip(&first).filter(|(_, e)| e.total <= hopeless) {
            if let Some(likelier) = likelier(candidate, &noisier) {
                // Its own would be relative to noise that is wider already.
                *candidate = Candidate { widened: candidate.widened, ..likelier };
            }
        }
        first = of_few(candidates);
    }
    let least = least(&first);
    let scale = points.len() as f64 / few.len().max(1) as f64;
    let hopeful: Vec<Option<Evidence>> = candidates
        .iter()
        .zip(&first)
        .map(|(c, e)| (e.total <= least + HOPELESS).then(|| c.evidence(points, widened)))
        .collect();
    let best = hopeful.iter().flatten().map(|e| e.total).fold(f64::INFINITY, f64::min);
    let or_scaled = |(all, few): (Option<Evidence>, Evidence)| all.unwrap_or_else(|| few.scaled(least, scale, best));
    hopeful.into_iter().zip(first).map(or_scaled).collect()
}

/// Median σ of the orientations from noise, in rad.
fn typical_sigma(candidate: &Candidate, points: &[CloudPoint]) -> f64 {
    let path = Path::new(candidate.curve);
    let mut all: Vec<f64> = thinned(points, LOOKED_AT).iter().map(|p| orientation(candidate, &path, p).1).collect();
    super::repeats::median(&mut all).unwrap_or(0.0)
}

/// A circle about the origin explains everything.
fn sinusoid_is_enough(simple: &[Candidate]) -> bool {
    let of = |model| simple.iter().find(|c| c.model == model);
    let (Some(sinusoid), Some(circle)) = (of(Model::Sinusoid), of(Model::Circle)) else { return false };
    let Some([x, y]) = circle.center else { return false };
    // The mean of |sin| over the turn, halved: orientations turn by half as much as phases.
    let cost_deg = (x.hypot(y) / circle.size() / std::f64::consts::PI).to_degrees();
    sinusoid.widened < GOOD_WIDENED && cost_deg < GOOD_CENTER_DEG
}

fn explains(candidate: &Candidate, points: &[CloudPoint]) -> bool {
    let path = Path::new(candidate.curve);
    let mut off: Vec<f64> = points
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

/// Mean difference of the orientations under two models after the best common offset, in rad.
fn difference(a: &Candidate, b: &Candidate, points: &[CloudPoint]) -> f64 {
    let (of_a, of_b) = (Path::new(a.curve), Path::new(b.curve));
    let step = points.len().div_ceil(2000);
    let pairs: Vec<f64> =
        points.iter().step_by(step).map(|p| orientation(a, &of_a, p).0 - orientation(b, &of_b, p).0).collect();
    let (sin, cos) = pairs.iter().fold((0.0, 0.0), |(s, c), d| (s + (2.0 * d).sin(), c + (2.0 * d).cos()));
    let offset = 0.5 * f64::atan2(sin, cos);
    pairs.iter().map(|d| angle_difference(*d, offset).abs()).sum::<f64>() / pairs.len().max(1) as f64
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
        return "(S1/S0, S2/S0) lie on a circle about the origin to their noise, so nothing more is needed".into();
    }
    if !explained {
        return "no model explains the data, so it is the one that assumes least: see warnings".into();
    }
    let simpler = (0..candidates.len()).filter(|k| candidates[*k].parameters < candidates[chosen].parameters);
    match simpler.min_by(|a, b| behind[*a].total_cmp(&behind[*b])) {
        Some(next) => format!(
            "it explains the points (S1/S0, S2/S0) better than {} by {:.0} in -2 ln likelihood, its {} parameters paid for",
            candidates[next].name(),
            behind[next] - behind[chosen],
            candidates[chosen].parameters
        ),
        None => "nothing more explains the points (S1/S0, S2/S0) better".into(),
    }
}

/// A candidate in the report.
#[derive(Clone, Debug, Serialize)]
pub struct ModelReport {
    /// Its name; the curve with what was fitted beyond the film.
    pub model: String,
    /// How many parameters it has.
    pub parameters: usize,
    /// -2 ln likelihood with the parameters paid for, less that of the best: 0 is the likeliest, 10 is 150 times less
    /// likely.
    pub behind: f64,
    /// Scatter of the points about it over their noise, as a ratio of standard deviations; 1 is a perfect model.
    pub scatter: f64,
    /// Mean difference of its orientations from those of the model used, in degrees.
    pub difference_deg: f64,
    /// Error that the uncertainty of its parameters causes, in degrees.
    pub uncertain_deg: f64,
    /// Centre of the circle.
    pub center: Option<[f64; 2]>,
    /// The film, for curves.
    pub film: Option<FilmReport>,
}

/// A fitted film. Gauges: one offset common to all orientations, and (r, ζ) against (1/r, -ζ) with all orientations turned
/// by 90°, cannot be told apart.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct FilmReport {
    /// |R|.
    pub r: f64,
    /// Phase of R in degrees.
    pub zeta_deg: f64,
    /// Retardance (Δn) in degrees.
    pub retardance_deg: f64,
    /// Azimuth of its axis in degrees.
    pub axis_deg: f64,
    /// Front reflection: amplitude.
    pub front: f64,
    /// Front reflection: phase in degrees.
    pub front_phase_deg: f64,
    /// What the retarder delays beyond a quarter wave, in degrees.
    pub source_error_deg: f64,
    /// Share of the light that has no polarization.
    pub stray: f64,
}

impl Choice {
    /// The films of the curves among the candidates.
    pub fn films(&self) -> Vec<super::curve::Film> {
        self.candidates.iter().filter_map(|c| c.film).collect()
    }

    /// Scatter of the points about the curve over their noise, as a ratio of standard deviations.
    pub fn scatter(&self) -> f64 {
        self.widened.sqrt()
    }

    /// What belongs in front of a user.
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = vec![];
        let scatter = self.scatter();
        if !self.explained {
            warnings.push(format!(
                "the points (S1/S0, S2/S0) lie {scatter:.0} times farther from the curve of this model than their noise: it does \
                 not explain the data, and orientations may be wrong by much more than σ says"
            ));
        } else if self.widened > UNEXPLAINED {
            warnings.push(format!(
                "the points (S1/S0, S2/S0) scatter {scatter:.1} times as far about the curve as their noise: a sample of several \
                 periods, a wrong analyser angle or photographs that do not match; how far orientations are wrong in all cannot be told"
            ));
        }
        if self.candidates[self.chosen].curve.mirror.is_some() {
            let unknown =
                if self.error.is_some() { "" } else { "; how far orientations are wrong in all cannot be told" };
            warnings.push(format!("metal without a grating is in view, and masked{unknown}"));
        }
        if self.candidates[self.chosen].film.is_some_and(|film| at_limit(&film)) {
            warnings.push(
                "the film delays by more than 90°, the most that is looked for: if it delays yet more, orientations are wrong by much \
                 more than σ says"
                    .into(),
            );
        }
        let undecided = |k: &usize| {
            let behind = self.behind[*k] - self.behind[self.chosen];
            behind < UNDECIDED.max(UNDECIDED_SIGMA * self.chance[*k])
        };
        let rivals = (0..self.behind.len()).filter(undecided).map(|k| self.differences[k]);
        let difference = rivals.fold(0.0, f64::max).to_degrees();
        if difference > 0.5 {
            warnings.push(format!(
                "another model explains the data as well, with orientations that differ by {difference:.1}° on average: see models"
            ));
        }
        let chosen = &self.candidates[self.chosen];
        let undecided = UNDECIDED.max(UNDECIDED_SIGMA * self.chance[self.best()]);
        if self.behind[self.chosen] > undecided && self.error.is_some() {
            warnings.push(format!(
                "{} is not the likeliest model: another one gives orientations that differ by {:.1}° on average",
                chosen.name(),
                self.differences[self.best()].to_degrees()
            ));
        }
        warnings
    }

    fn best(&self) -> usize {
        (0..self.behind.len()).min_by(|a, b| self.behind[*a].total_cmp(&self.behind[*b])).unwrap_or(self.chosen)
    }

    /// All candidates.
    pub fn report(&self) -> Vec<ModelReport> {
        let each = self.candidates.iter().zip(&self.behind).zip(&self.differences);
        each.map(|((c, behind), difference)| ModelReport {
            model: c.name(),
            parameters: c.parameters,
            behind: *behind,
            scatter: c.widened.sqrt(),
            difference_deg: difference.to_degrees(),
            uncertain_deg: c.uncertain.to_degrees(),
            center: c.center,
            film: c.film.map(FilmReport::of),
        })
        .collect()
    }
}

impl FilmReport {
    fn of(film: super::curve::Film) -> Self {
        let film = film.canonical();
        Self {
            r: film.ln_r.exp(),
            zeta_deg: film.zeta.to_degrees(),
            retardance_deg: film.retardance.to_degrees(),
            axis_deg: film.axis.to_degrees(),
            front: film.front.norm(),
            front_phase_deg: film.front.arg().to_degrees(),
            source_error_deg: film.source_error.to_degrees(),
            stray: film.stray,
        }
    }
}

impl Candidate {
    /// Its name, with what was fitted beyond the film.
    pub fn name(&self) -> String {
        self.extended.iter().fold(self.model.word().to_owned(), |name, more| name + "+" + more)
    }

    /// Root mean square distance of the curve from its middle.
    pub(super) fn size(&self) -> f64 {
        let at: Vec<[f64; 2]> = (0..64).map(|k| self.curve.at(std::f64::consts::PI * f64::from(k) / 64.0)).collect();
        let middle = [0, 1].map(|k| at.iter().map(|p| p[k]).sum::<f64>() / 64.0);
        (at.iter().map(|p| (p[0] - middle[0]).powi(2) + (p[1] - middle[1]).powi(2)).sum::<f64>() / 64.0).sqrt()
    }
}

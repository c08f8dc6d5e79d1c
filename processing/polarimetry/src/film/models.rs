//! Nested models from phase to orientation, compared by evidence.
//!
//! Curve of the points (S1/S0, S2/S0) over all orientations:
//!
//! - `sinusoid`: a circle about the origin. Valid without a birefringent film.
//! - `prenormalized`: a circle about the mean of the points. Valid for a weak film and evenly distributed orientations.
//! - `circle`: a circle about any centre. Valid for a weak film.
//! - `curve`: the closed curve of the 2018 paper's Eq. 4-6. Valid for any film. The axis and, where needed, the front
//!   reflection and the retarder's error are fitted as well.
//!
//! More parameters fit the points better, but add their uncertainty to the result. `auto` therefore compares the models
//! by their penalised −2 ln likelihood, and selects the simplest of those near the minimum:
//!
//! - The likelihood of each half of the points is that under the distribution of orientations of the other half
//!   (nonparametric maximum likelihood, Kiefer and Wolfowitz 1956).
//! - The penalty is Laplace's factor for curves, whose parameters have priors, and k ln n for circles (BIC, Schwarz
//!   1978).
//! - The significance of a difference follows from the test of Vuong (1989): its standard deviation over the points.
//!
//! docs/validation/models.md lists the thresholds of the decision, with scenes that require each of them.

use crate::film::cloud::{CloudPoint, SAMPLE, thinned};
use crate::film::curve::{Curve, Film};
use crate::film::curve_fit::{COST_OF_NOISE, Family, Fitted, Prior};
use crate::film::evidence;
use crate::film::npmle;
use crate::film::projection::CurveSamples;
use nacre_base::statistics::median;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI};

/// Number of points below which the distribution of orientations cannot be fitted.
pub(crate) const NPMLE_MIN_POINTS: usize = 2000;

/// Number of points for the orientation error caused by the parameters' uncertainty.
pub(crate) const SPREAD: usize = 500;

/// Conversion of the fitted phase to an orientation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "PolarizationModel")]
pub enum Model {
    /// The simplest grating model that explains the data; the report contains its name and the reason.
    #[default]
    Auto,
    /// No grating: Stokes parameters, angle and degree of linear polarization.
    Plain,
    /// The phase is the orientation, up to a common offset.
    Sinusoid,
    /// The phase about the mean of all points (2018 paper, section 5.3, for ratios instead of raw photographs).
    Prenormalized,
    /// The phase about the centre of the circle through all points.
    Circle,
    /// The nearest point on the fitted curve.
    Curve,
}

/// A model with its parameters.
#[derive(Clone)]
pub(crate) struct Candidate {
    /// Its model.
    pub model: Model,
    /// Parameters of the curve fitted beyond the four of the film (`front`, `source`), or the reduced set `polarizer`.
    pub extended: &'static [&'static str],
    /// Number of fitted parameters.
    pub parameters: usize,
    /// Curve of the points.
    pub curve: Curve,
    /// Centre of the circle, for models that use the phase about it.
    pub center: Option<[f64; 2]>,
    /// −2 ln prior of the parameters.
    pub prior: f64,
    /// Information gain of the points about the parameters relative to their prior, as ln of a ratio of variances;
    /// `None` without priors.
    pub information_gain: Option<f64>,
    /// Scatter variance of points about the curve, relative to their noise.
    pub widened: f64,
    /// Root mean square orientation error in rad caused by the parameters' uncertainty.
    pub uncertain: f64,
    /// Parameters of the film, for the curve.
    pub film: Option<Film>,
}

impl Model {
    /// All models, simplest first after `auto`.
    pub const ALL: [Self; 6] =
        [Self::Auto, Self::Plain, Self::Sinusoid, Self::Prenormalized, Self::Circle, Self::Curve];

    /// Name in options and files.
    pub fn word(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Plain => "plain",
            Self::Sinusoid => "sinusoid",
            Self::Prenormalized => "prenormalized",
            Self::Circle => "circle",
            Self::Curve => "curve",
        }
    }
}

/// Fits the circle models to points with modulation, simplest first. A sample selects the better of two starts, from
/// which all points are fitted.
pub(crate) fn candidates(points: &[CloudPoint]) -> Vec<Candidate> {
    let (mean, few) = (mean(points), thinned(points, SAMPLE));
    let about = |center: [f64; 2], model, count: usize| -> Option<Candidate> {
        let family = Family {
            curve: &|p: &[f64]| Curve::circle(center, p[0]),
            priors: &[Prior::Anything],
            limits: &[f64::INFINITY],
        };
        let begun = family.fit(&few, &[radius(&few, center)], 30)?;
        let fitted = family.fit(points, &begun.parameters, 30)?;
        Some(phase(model, center, count, &family, fitted, points))
    };
    let mut found: Vec<Candidate> =
        [about([0.0; 2], Model::Sinusoid, 1), about(mean, Model::Prenormalized, 3)].into_iter().flatten().collect();
    let family = Family {
        curve: &|p: &[f64]| Curve::circle([p[0], p[1]], p[2]),
        priors: &[Prior::Anything; 3],
        limits: &[f64::INFINITY; 3],
    };
    let starts = [mean, crate::film::check::circle_center(points).unwrap_or(mean)];
    let begun = starts.iter().filter_map(|c| family.fit(&few, &[c[0], c[1], radius(&few, *c)], 60));
    let begun = begun.min_by(|a, b| a.cost.total_cmp(&b.cost));
    if let Some(fitted) = begun.and_then(|begun| family.fit(points, &begun.parameters, 60)) {
        let center = [fitted.parameters[0], fitted.parameters[1]];
        found.push(phase(Model::Circle, center, 3, &family, fitted, points));
    }
    found
}

/// Penalised likelihood of a candidate.
#[derive(Clone)]
pub(crate) struct Evidence {
    /// Penalised −2 ln likelihood.
    pub total: f64,
    /// −2 ln likelihood of the points and the prior of the parameters, without the penalty.
    pub likelihood: f64,
    /// Contribution of each point.
    pub terms: Vec<f64>,
}

impl Evidence {
    /// Scales the evidence on a sample, given its difference from the sample's `least`, to all points, of which the
    /// best candidate has `best`.
    pub fn scaled(self, least: f64, scale: f64, best: f64) -> Self {
        Self { total: best + scale * (self.total - least), terms: vec![], ..self }
    }

    /// Standard deviation of the difference of two −2 ln likelihoods: √n times that of its contributions by single
    /// points (Vuong 1989).
    pub fn difference_sigma(&self, other: &Self) -> f64 {
        let n = self.terms.len().max(1) as f64;
        let differences = || self.terms.iter().zip(&other.terms).map(|(a, b)| a - b);
        let mean = differences().sum::<f64>() / n;
        differences().map(|d| (d - mean).powi(2)).sum::<f64>().sqrt()
    }
}

impl Candidate {
    /// Name, with the parameters fitted beyond the film.
    pub fn name(&self) -> String {
        self.extended.iter().fold(self.model.word().to_owned(), |name, more| name + "+" + more)
    }

    /// Root mean square distance of the curve from its centre.
    pub(crate) fn size(&self) -> f64 {
        let at: Vec<[f64; 2]> = (0..64).map(|k| self.curve.at(PI * f64::from(k) / 64.0)).collect();
        let middle = [0, 1].map(|k| at.iter().map(|p| p[k]).sum::<f64>() / 64.0);
        (at.iter().map(|p| (p[0] - middle[0]).powi(2) + (p[1] - middle[1]).powi(2)).sum::<f64>() / 64.0).sqrt()
    }

    /// Penalised −2 ln likelihood of points whose variances are `widened` times their noise.
    pub(crate) fn evidence(&self, points: &[CloudPoint], widened: f64) -> Evidence {
        let points: Vec<CloudPoint> = points.iter().map(|p| p.with_noise(widened)).collect();
        let terms = if points.len() < NPMLE_MIN_POINTS {
            evidence::terms(&points, &self.curve)
        } else {
            npmle::terms(&points, &self.curve)
        };
        self.penalised(terms)
    }

    /// Penalised −2 ln likelihood from the contributions of the points.
    pub(crate) fn penalised(&self, terms: Vec<f64>) -> Evidence {
        // Laplace's factor for parameters with priors, otherwise that of Schwarz.
        let penalised = self.information_gain.unwrap_or(self.parameters as f64 * (terms.len().max(2) as f64).ln());
        let likelihood = terms.iter().sum::<f64>() + self.prior;
        Evidence { total: likelihood + penalised, likelihood, terms }
    }
}

fn phase(
    model: Model,
    center: [f64; 2],
    parameters: usize,
    family: &Family<'_>,
    fitted: Fitted,
    points: &[CloudPoint],
) -> Candidate {
    let widened = widened(fitted.cost, points.len());
    let uncertain = family.spread(&fitted, &thinned(points, SPREAD), widened);
    Candidate {
        model,
        extended: &[],
        parameters,
        curve: fitted.curve,
        center: Some(center),
        prior: fitted.prior,
        information_gain: None,
        widened,
        uncertain,
        film: None,
    }
}

/// Scatter variance of points about a curve, relative to their noise.
pub(crate) fn widened(cost: f64, points: usize) -> f64 {
    (cost / points.max(1) as f64 / COST_OF_NOISE).max(1.0)
}

fn mean(points: &[CloudPoint]) -> [f64; 2] {
    let n = points.len().max(1) as f64;
    [0, 1].map(|k| points.iter().map(|p| p.at[k]).sum::<f64>() / n)
}

/// Median distance from a centre.
fn radius(points: &[CloudPoint], center: [f64; 2]) -> f64 {
    let mut distances: Vec<f64> = points.iter().map(|p| (p.at[0] - center[0]).hypot(p.at[1] - center[1])).collect();
    median(&mut distances).unwrap_or(1.0)
}

/// The orientation of a point under a candidate and its σ, both in rad.
pub(crate) fn orientation(candidate: &Candidate, curve_samples: &CurveSamples, point: &CloudPoint) -> (f64, f64) {
    let theta = match candidate.center {
        Some(c) => 0.5 * (point.at[1] - c[1]).atan2(point.at[0] - c[0]),
        None => curve_samples.closest_point(point).theta,
    };
    let (_, t) = candidate.curve.with_tangent(theta);
    let [a, b, c] = point.weights();
    let speed = a * t[0] * t[0] + 2.0 * b * t[0] * t[1] + c * t[1] * t[1];
    (theta.rem_euclid(PI), (1.0 / speed.sqrt()).min(FRAC_PI_2))
}

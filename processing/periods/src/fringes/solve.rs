//! Solution of one pixel: the grating from its response to fringes.
//!
//! Light from panel positions X_m with weights w_m has the response `Σ w_m e^{i k · X_m}` to fringes of angular
//! frequency k. The orders of a grating leave in directions whose sines are those of the mirror direction plus `m·q`,
//! with |q| = λ/period along the grating vector. The two components of q thus determine all positions; weights are
//! linear and non-negative.

use super::answer::{Answer, Demands, Grating, Solution, Verdict};
use super::carriers::Search;
use super::optics::{Landing, Optics, Place};
use nacre_base::least_squares::{Damping, Problem, Step, levenberg_marquardt};
use nalgebra::{SMatrix, SVector};

/// Highest order.
const ORDERS: i32 = 3;
/// Number of orders, including the mirrored light.
const TERMS: usize = 2 * ORDERS as usize + 1;
/// Unknowns: sines of the mirror direction, q, and weights.
const UNKNOWNS: usize = 4 + TERMS;
/// Maximum number of fringes.
pub const MAX_CARRIERS: usize = 31;
/// Iterations of refinement for each candidate, and for the best ones.
const QUICK_STEPS: usize = 2;
const STEPS: usize = 10;
/// Levenberg-Marquardt damping.
const DAMPING: Damping = Damping { first: 1e-3, down: 0.2, least: 1e-9, up: 20.0, most: f64::INFINITY };
/// Decrease of χ² below which refinement has converged: 1 % of one standard deviation.
const CONVERGED: f64 = 0.01;
/// Maximum change of the mirror offset and of q per iteration.
const LARGEST_STEPS: [f64; 2] = [0.01, 0.02];
/// Number of hypotheses refined initially and finally.
const REFINED: usize = 4;
const KEPT: usize = 2;
/// Number of panel positions tried.
const CANDIDATES: usize = 8;
/// Difference of q below which two candidates are identical.
const SAME: f64 = 0.006;

/// Solver for single pixels.
pub struct Solver<'a> {
    /// Geometry.
    pub optics: &'a Optics,
    /// Angular frequencies in rad/mm.
    pub carriers: &'a [[f64; 2]],
    /// Panel positions to search.
    pub search: &'a Search,
    /// Requirements on the result.
    pub demands: Demands,
}

/// Predicted response of a hypothesis.
struct Model {
    /// Panel position of each order; `None` if it misses the panel.
    landings: [Option<Landing>; TERMS],
    /// Response of an order with weight 1, for each fringe.
    waves: [[[f64; 2]; TERMS]; MAX_CARRIERS],
}

/// A hypothesis: mirror offset, q and weights.
#[derive(Clone, Copy)]
struct State {
    offset: [f64; 2],
    q: [f64; 2],
    weights: [f64; TERMS],
    chi2: f64,
}

/// Normal equations of a hypothesis.
struct Normal {
    matrix: SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    right: SVector<f64, UNKNOWNS>,
}

/// Refinement of one hypothesis of a pixel.
struct Refinement<'a> {
    solver: &'a Solver<'a>,
    place: &'a Place,
    answer: &'a Answer<'a>,
    sigma: f64,
}

/// A hypothesis that no grating can satisfy, or with singular normal equations.
struct Impossible;

impl Problem for Refinement<'_> {
    type State = (State, Model);
    type Error = Impossible;

    fn cost(&self, (state, _): &(State, Model)) -> f64 {
        state.chi2
    }

    fn step(&self, (state, model): &(State, Model), damping: f64) -> Result<Step<(State, Model)>, Impossible> {
        let Self { solver, place, answer, sigma } = *self;
        let Normal { mut matrix, right } = solver.normal(model, answer, sigma, state);
        for i in 0..UNKNOWNS {
            matrix[(i, i)] *= 1.0 + damping;
        }
        let step = matrix.cholesky().ok_or(Impossible)?.solve(&right);
        let mut next = *state;
        for i in 0..2 {
            next.offset[i] += step[i].clamp(-LARGEST_STEPS[0], LARGEST_STEPS[0]);
            next.q[i] += step[2 + i].clamp(-LARGEST_STEPS[1], LARGEST_STEPS[1]);
        }
        if !solver.is_possible(next.q) {
            return Err(Impossible);
        }
        let model = solver.model(place, &next);
        solver.weigh(&model, answer, sigma, &mut next).ok_or(Impossible)?;
        Ok(Step::Trial((next, model)))
    }

    fn accept(&self, (from, _): &(State, Model), (to, _): &mut (State, Model)) -> bool {
        from.chi2 - to.chi2 < CONVERGED
    }
}

impl Solver<'_> {
    /// Solves a pixel; a rejected grating is returned with its classification. `response` is the correlation of the
    /// pixel's response, without mirrored light, with the searched positions.
    pub fn solve(&self, place: &Place, answer: &Answer, response: &[f32]) -> Solution {
        let sigma = answer.sigma.hypot(self.demands.model_error * answer.mean * 2.0);
        let power: f64 = answer.components.iter().map(|v| f64::from(*v).powi(2)).sum();
        let count = answer.components.len() as f64;
        if power / count < (4.0 * sigma).powi(2) {
            return (Verdict::Dark, None, None);
        }
        let mut tried: Vec<State> = Vec::with_capacity(CANDIDATES);
        for at in self.search.peaks::<CANDIDATES>(response) {
            let towards = self.optics.towards(place.point, at);
            let q = upper([towards[0] - place.mirror[0], towards[1] - place.mirror[1]]);
            let mut state = State { offset: [0.0; 2], q, weights: [0.0; TERMS], chi2: f64::INFINITY };
            // Both first orders of a grating form one hypothesis.
            let is_new = tried.iter().all(|other| distance(other.q, q) > SAME);
            if is_new
                && self.is_possible(q)
                && self.weigh(&self.model(place, &state), answer, sigma, &mut state).is_some()
            {
                tried.push(state);
            }
        }
        tried.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
        let refined = |state: &State| self.refined(place, answer, sigma, *state, QUICK_STEPS);
        let mut found: Vec<State> = tried.iter().take(REFINED).filter_map(refined).collect();
        found.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
        self.judged(place, answer, sigma, &found)
    }

    /// Response without the mirrored light, fitted alone.
    pub fn without_mirror(&self, place: &Place, components: &[f32]) -> Vec<f32> {
        let Some(landing) = self.optics.land(place.point, place.mirror) else { return components.to_vec() };
        let wave: Vec<f32> = self
            .carriers
            .iter()
            .flat_map(|k| {
                let (sin, cos) = (k[0] * landing.at[0] + k[1] * landing.at[1]).sin_cos();
                let left = self.optics.modulation(*k, &landing, place, 0.0, [0.0; 2]);
                [(left * cos) as f32, (left * sin) as f32]
            })
            .collect();
        let product: f32 = wave.iter().zip(components).map(|(w, d)| w * d).sum();
        let power: f32 = wave.iter().map(|w| w * w).sum();
        let weight = (product / power.max(1e-12)).max(0.0);
        components.iter().zip(&wave).map(|(d, w)| d - weight * w).collect()
    }

    fn judged(&self, place: &Place, answer: &Answer, sigma: f64, found: &[State]) -> Solution {
        let demands = &self.demands;
        let freedom = |state: &State| {
            let terms = state.weights.iter().filter(|w| **w > 0.0).count() as f64;
            (answer.components.len() as f64 - 2.0 - terms).max(1.0)
        };
        // Only the best candidates are refined further.
        let mut best: Vec<(State, f64)> = Vec::new();
        for state in found {
            if best.len() == KEPT {
                break;
            }
            if best.iter().any(|(b, _)| distance(b.q, state.q) < SAME) {
                continue;
            }
            if let Some(state) = self.refined(place, answer, sigma, *state, STEPS)
                && !best.iter().any(|(b, _)| distance(b.q, state.q) < SAME)
            {
                best.push((state, state.chi2 / freedom(&state)));
            }
        }
        best.sort_by(|a, b| a.1.total_cmp(&b.1));
        let Some(least) = best.first().map(|b| b.1) else { return (Verdict::NoOrder, None, None) };
        // Hypotheses without first orders are rejected, such as half of the true q, which interprets first orders as
        // second ones.
        let rate = |(state, residual): &(State, f64)| {
            self.grating(place, answer, sigma, state, *residual).map(|g| (g, *residual))
        };
        let rated: Vec<(Grating, f64)> = best.iter().filter_map(rate).collect();
        match rated.as_slice() {
            [] if least > demands.most_residual => (Verdict::Unexplained, None, None),
            [] => (Verdict::NoOrder, None, None),
            [(first, left), ..] if *left > demands.most_residual => (Verdict::Unexplained, Some(*first), None),
            [(first, left), (rival, next), ..] if *next < demands.least_margin * left.max(1.0) => {
                (Verdict::Ambiguous, None, Some([*first, *rival]))
            }
            [(first, _), ..] => (Verdict::Resolved, Some(*first), None),
        }
    }

    /// Grating of a hypothesis, if its first orders are bright enough.
    fn grating(&self, place: &Place, answer: &Answer, sigma: f64, state: &State, residual: f64) -> Option<Grating> {
        let demands = &self.demands;
        let scaled = sigma * residual.max(1.0).sqrt();
        let (covariance, weight_sigma) = self.covariance(place, answer, scaled, state)?;
        let weight = |m: i32| state.weights[(m + ORDERS) as usize].max(0.0);
        let first = weight(1) + weight(-1);
        let higher = (2..=ORDERS).map(|m| weight(m) + weight(-m)).fold(0.0, f64::max);
        if first < demands.least_signal * weight_sigma || first < demands.least_first * higher {
            return None;
        }
        let [u, v] = state.q;
        let length = u.hypot(v);
        let wavelength = self.optics.wavelength_um;
        let turn = [-v / (length * length), u / (length * length)];
        let along = [u / length, v / length];
        let spread = |d: [f64; 2]| {
            let [uu, uv, vv] = covariance;
            (d[0] * d[0] * uu + 2.0 * d[0] * d[1] * uv + d[1] * d[1] * vv).max(0.0).sqrt()
        };
        let orientation = v.atan2(u).rem_euclid(std::f64::consts::PI);
        Some(Grating {
            orientation: if orientation >= std::f64::consts::PI { 0.0 } else { orientation },
            orientation_sigma: spread(turn),
            period_um: wavelength / length,
            period_sigma_um: wavelength / (length * length) * spread(along),
            mirror_offset: state.offset,
            residual,
            first: first / state.weights.iter().sum::<f64>().max(1e-12),
            weights: state.weights.map(|w| w as f32),
        })
    }

    fn is_possible(&self, q: [f64; 2]) -> bool {
        let period = self.optics.wavelength_um / q[0].hypot(q[1]).max(1e-9);
        (self.demands.periods_um[0]..=self.demands.periods_um[1]).contains(&period)
    }

    /// Refines a hypothesis (Levenberg-Marquardt) with non-negative weights.
    fn refined(&self, place: &Place, answer: &Answer, sigma: f64, start: State, steps: usize) -> Option<State> {
        let refinement = Refinement { solver: self, place, answer, sigma };
        let start = (start, self.model(place, &start));
        levenberg_marquardt(&refinement, start, DAMPING, steps).ok().map(|(state, _)| state)
    }

    /// Panel positions of a hypothesis's orders, and their response.
    fn model(&self, place: &Place, state: &State) -> Model {
        let landings: [Option<Landing>; TERMS] = std::array::from_fn(|i| {
            let m = i as f64 - f64::from(ORDERS);
            let sines = [0, 1].map(|a| place.mirror[a] + state.offset[a] + m * state.q[a]);
            self.optics.land(place.point, sines).filter(|l| self.optics.is_on(l.at, 0.0))
        });
        let mut waves = [[[0.0; 2]; TERMS]; MAX_CARRIERS];
        for (i, landing) in landings.iter().enumerate() {
            let Some(landing) = landing else { continue };
            let m = i as f64 - f64::from(ORDERS);
            for (row, k) in waves.iter_mut().zip(self.carriers) {
                let (sin, cos) = (k[0] * landing.at[0] + k[1] * landing.at[1]).sin_cos();
                let left = self.optics.modulation(*k, landing, place, m, state.q);
                row[i] = [left * cos, left * sin];
            }
        }
        Model { landings, waves }
    }

    /// Optimal non-negative weights of a hypothesis; updates its residual.
    fn weigh(&self, model: &Model, answer: &Answer, sigma: f64, state: &mut State) -> Option<()> {
        let Model { landings, waves } = model;
        let (mut gram, mut right) = ([[0.0; TERMS]; TERMS], [0.0; TERMS]);
        let mut power = 0.0;
        for (j, row) in waves.iter().take(self.carriers.len()).enumerate() {
            let d = [f64::from(answer.components[2 * j]), f64::from(answer.components[2 * j + 1])];
            power += d[0] * d[0] + d[1] * d[1];
            for a in 0..TERMS {
                right[a] += row[a][0] * d[0] + row[a][1] * d[1];
                for b in 0..=a {
                    gram[a][b] += row[a][0] * row[b][0] + row[a][1] * row[b][1];
                }
            }
        }
        let weights = positive(&gram, &right, landings.map(|l| l.is_some()))?;
        let mut left = power;
        for a in 0..TERMS {
            left -= 2.0 * weights[a] * right[a];
            for b in 0..TERMS {
                left += weights[a] * weights[b] * if a > b { gram[a][b] } else { gram[b][a] };
            }
        }
        let prior: f64 = state.offset.iter().map(|o| (o / self.demands.mirror_sigma).powi(2)).sum();
        (state.weights, state.chi2) = (weights, left.max(0.0) / (sigma * sigma) + prior);
        Some(())
    }

    /// Normal equations of all unknowns; zero weights are fixed.
    fn normal(&self, model: &Model, answer: &Answer, sigma: f64, state: &State) -> Normal {
        let Model { landings, waves } = model;
        let mut matrix = SMatrix::<f64, UNKNOWNS, UNKNOWNS>::zeros();
        let mut right = SVector::<f64, UNKNOWNS>::zeros();
        let inverse = 1.0 / (sigma * sigma);
        for (j, (row, k)) in waves.iter().zip(self.carriers).enumerate() {
            let mut sum = [0.0; 2];
            let mut slopes = [[0.0; UNKNOWNS]; 2];
            for (i, landing) in landings.iter().enumerate() {
                let (Some(landing), weight) = (landing, state.weights[i]) else { continue };
                if weight <= 0.0 {
                    continue;
                }
                let m = i as f64 - f64::from(ORDERS);
                let [re, im] = row[i];
                sum = [sum[0] + weight * re, sum[1] + weight * im];
                let [[a, b], [c, d]] = landing.slope;
                let phase = [k[0] * a + k[1] * c, k[0] * b + k[1] * d];
                for axis in 0..2 {
                    let change = [-weight * im * phase[axis], weight * re * phase[axis]];
                    for part in 0..2 {
                        slopes[part][axis] += change[part];
                        slopes[part][2 + axis] += m * change[part];
                    }
                }
                (slopes[0][4 + i], slopes[1][4 + i]) = (re, im);
            }
            for part in 0..2 {
                let off = f64::from(answer.components[2 * j + part]) - sum[part];
                for a in 0..UNKNOWNS {
                    let scaled = slopes[part][a] * inverse;
                    right[a] += scaled * off;
                    for b in 0..=a {
                        matrix[(a, b)] += scaled * slopes[part][b];
                    }
                }
            }
        }
        let prior = self.demands.mirror_sigma.powi(-2);
        for axis in 0..2 {
            right[axis] -= state.offset[axis] * prior;
            matrix[(axis, axis)] += prior;
        }
        for a in 0..UNKNOWNS {
            for b in 0..a {
                matrix[(b, a)] = matrix[(a, b)];
            }
            // Fixes unknowns without influence.
            if matrix[(a, a)] == 0.0 {
                matrix[(a, a)] = 1.0;
            }
        }
        Normal { matrix, right }
    }

    /// Covariance of q (uu, uv, vv), and σ of the first orders' weight.
    fn covariance(&self, place: &Place, answer: &Answer, sigma: f64, state: &State) -> Option<([f64; 3], f64)> {
        let inverse = self.normal(&self.model(place, state), answer, sigma, state).matrix.cholesky()?.inverse();
        let (plus, minus) = (4 + ORDERS as usize + 1, 4 + ORDERS as usize - 1);
        let both = |i: usize| if state.weights[i - 4] > 0.0 { 1.0 } else { 0.0 };
        let variance = both(plus) * inverse[(plus, plus)]
            + both(minus) * inverse[(minus, minus)]
            + 2.0 * both(plus) * both(minus) * inverse[(plus, minus)];
        Some(([inverse[(2, 2)], inverse[(2, 3)], inverse[(3, 3)]], variance.max(0.0).sqrt()))
    }
}

/// The one of q and -q that points up.
fn upper([u, v]: [f64; 2]) -> [f64; 2] {
    if v < 0.0 || (v == 0.0 && u < 0.0) { [-u, -v] } else { [u, v] }
}

/// Distance of two vectors q, irrespective of their signs.
fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    let apart = |sign: f64| (a[0] - sign * b[0]).hypot(a[1] - sign * b[1]);
    apart(1.0).min(apart(-1.0))
}

/// Non-negative least squares: the most negative weight is removed until none is negative.
fn positive(gram: &[[f64; TERMS]; TERMS], right: &[f64; TERMS], mut used: [bool; TERMS]) -> Option<[f64; TERMS]> {
    for _ in 0..TERMS {
        let mut matrix = SMatrix::<f64, TERMS, TERMS>::identity();
        let mut vector = SVector::<f64, TERMS>::zeros();
        for a in (0..TERMS).filter(|a| used[*a]) {
            vector[a] = right[a];
            for b in (0..TERMS).filter(|b| used[*b]) {
                matrix[(a, b)] = if a > b { gram[a][b] } else { gram[b][a] };
            }
            // Regularisation: coincident orders share their light.
            matrix[(a, a)] *= 1.0 + 1e-6;
        }
        let weights = matrix.cholesky()?.solve(&vector);
        let worst = (0..TERMS).filter(|a| used[*a]).min_by(|a, b| weights[*a].total_cmp(&weights[*b]))?;
        if weights[worst] >= 0.0 {
            return Some(std::array::from_fn(|a| if used[a] { weights[a] } else { 0.0 }));
        }
        used[worst] = false;
    }
    Some([0.0; TERMS])
}

//! Least squares for one grating: its vector, the light of its orders, and stray light.

use super::lobe::Shape;
use nacre_base::least_squares::{Damping, Problem, Step, levenberg_marquardt};
use nalgebra::{SMatrix, SVector};

/// Orders to each side that are fitted.
pub(super) const ORDERS: usize = 3;

/// Grating vector, stray light, light of the orders.
const UNKNOWNS: usize = 3 + ORDERS;

/// Lobes end where they are 1e-6 of their peak.
const FAR: f64 = 28.0;

/// Steps of the fit.
const STEPS: usize = 30;

/// Damping of the fit.
const DAMPING: Damping = Damping { first: 1e-3, down: 0.2, least: 0.0, up: 8.0, most: 1e8 };

/// The fit ends when χ² falls by less.
const CONVERGED: f64 = 1e-3;

/// Light that is said of an order or of stray light without evidence, over the brightest copy: standard deviation.
const VAGUE: f64 = 6.0;

type Matrix = SMatrix<f64, UNKNOWNS, UNKNOWNS>;
type Vector = SVector<f64, UNKNOWNS>;

/// One copy of a place of the tile under one light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Copy {
    /// Half vector.
    pub half: [f64; 2],
    /// Lobes there.
    pub shape: Shape,
    /// Light over what falls on the place, over the brightest copy's.
    pub light: f64,
    /// Inverse variance of it.
    pub weight: f64,
}

/// What is known of gratings beforehand.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prior {
    /// Least and largest length of the grating vector λ/a.
    pub range: [f64; 2],
    /// Length that all share, and its standard deviation.
    pub shared: Option<[f64; 2]>,
}

/// A grating that explains the copies.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solution {
    /// Grating vector λ/a (cos θ, sin θ).
    pub vector: [f64; 2],
    /// Its covariance, xx, xy, yy.
    pub covariance: [f64; 3],
    /// Energy of the orders 1, 2, …
    pub orders: [f64; ORDERS],
    /// Standard deviation of the first.
    pub first_sigma: f64,
    /// Stray light.
    pub stray: f64,
    /// Sum of squares, each over its variance.
    pub cost: f64,
}

/// Peaks of lobes at a copy, relative to the energy, and how they change with the order's place.
fn kernel(copy: &Copy, center: [f64; 2]) -> Option<(f64, [f64; 2])> {
    let d = [copy.half[0] - center[0], copy.half[1] - center[1]];
    let square = copy.shape.square(d);
    if square > FAR {
        return None;
    }
    let value = copy.shape.peak * (-0.5 * square).exp();
    let [a, b, c] = copy.shape.inverse;
    Some((value, [value * (a * d[0] + b * d[1]), value * (b * d[0] + c * d[1])]))
}

/// What a grating shows at a copy, and how that changes with the unknowns.
fn row(copy: &Copy, p: &Vector) -> (f64, Vector) {
    let mut row = Vector::zeros();
    row[2] = 1.0;
    let mut light = p[2];
    for n in 1..=ORDERS {
        for sign in [1.0, -1.0] {
            let k = sign * n as f64;
            if let Some((value, slope)) = kernel(copy, [k * p[0], k * p[1]]) {
                row[2 + n] += value;
                light += p[2 + n] * value;
                row[0] += p[2 + n] * k * slope[0];
                row[1] += p[2 + n] * k * slope[1];
            }
        }
    }
    (light, row)
}

/// Normal equations of what is left over, and its sum of squares.
fn normal(copies: &[Copy], p: &Vector, prior: &Prior) -> (Matrix, Vector, f64) {
    let (mut a, mut b, mut cost) = (Matrix::zeros(), Vector::zeros(), 0.0);
    for copy in copies {
        let (light, row) = row(copy, p);
        let left = copy.light - light;
        cost += copy.weight * left * left;
        // Most copies see stray light only.
        if row[3] == 0.0 && row[4] == 0.0 && row[5] == 0.0 {
            a[(2, 2)] += copy.weight;
            b[2] += copy.weight * left;
            continue;
        }
        for i in 0..UNKNOWNS {
            let weighted = copy.weight * row[i];
            b[i] += weighted * left;
            (0..=i).for_each(|j| a[(i, j)] += weighted * row[j]);
        }
    }
    for k in 2..UNKNOWNS {
        a[(k, k)] += 1.0 / (VAGUE * VAGUE);
        b[k] -= p[k] / (VAGUE * VAGUE);
        cost += p[k] * p[k] / (VAGUE * VAGUE);
    }
    if let Some([length, sigma]) = prior.shared {
        let (found, weight) = (p[0].hypot(p[1]), 1.0 / (sigma * sigma));
        let n = [p[0] / found, p[1] / found];
        let left = length - found;
        for i in 0..2 {
            b[i] += weight * left * n[i];
            (0..=i).for_each(|j| a[(i, j)] += weight * n[i] * n[j]);
        }
        cost += weight * left * left;
    }
    for i in 0..UNKNOWNS {
        (i + 1..UNKNOWNS).for_each(|j| a[(i, j)] = a[(j, i)]);
    }
    (a, b, cost)
}

/// Nothing is darker than dark, and gratings are in range.
fn clamped(mut p: Vector, prior: &Prior) -> Vector {
    (2..UNKNOWNS).for_each(|k| p[k] = p[k].max(0.0));
    let length = p[0].hypot(p[1]);
    let wanted = length.clamp(prior.range[0], prior.range[1]);
    if length > 0.0 && wanted != length {
        p[0] *= wanted / length;
        p[1] *= wanted / length;
    }
    p
}

/// Best light of the orders of a grating whose vector stays.
fn with_light(copies: &[Copy], vector: [f64; 2], prior: &Prior) -> Vector {
    let mut p = Vector::zeros();
    (p[0], p[1]) = (vector[0], vector[1]);
    let (a, b, _) = normal(copies, &p, prior);
    let n = UNKNOWNS - 2;
    let light = a.view((2, 2), (n, n)).into_owned().cholesky().map(|c| c.solve(&b.rows(2, n).into_owned()));
    if let Some(light) = light {
        (0..n).for_each(|k| p[k + 2] = light[k].max(0.0));
    }
    p
}

/// Sum of squares of a grating at a vector, with the best light of its orders.
pub(super) fn cost_at(copies: &[Copy], vector: [f64; 2], prior: &Prior) -> f64 {
    let p = with_light(copies, vector, prior);
    normal(copies, &p, prior).2
}

/// The copies of one grating and what is known of it beforehand.
struct Lobes<'a> {
    copies: &'a [Copy],
    prior: &'a Prior,
}

/// Unknowns with their normal equations.
struct Tried {
    unknowns: Vector,
    matrix: Matrix,
    right: Vector,
    cost: f64,
}

/// The damped normal matrix has no inverse.
struct Singular;

impl Lobes<'_> {
    fn at(&self, unknowns: Vector) -> Tried {
        let (matrix, right, cost) = normal(self.copies, &unknowns, self.prior);
        Tried { unknowns, matrix, right, cost }
    }
}

impl Problem for Lobes<'_> {
    type State = Tried;
    type Error = Singular;

    fn cost(&self, tried: &Tried) -> f64 {
        tried.cost
    }

    fn step(&self, from: &Tried, damping: f64) -> Result<Step<Tried>, Singular> {
        let damped = from.matrix + Matrix::from_diagonal(&from.matrix.diagonal().map(|d| damping * d.max(1e-12)));
        let step = damped.cholesky().ok_or(Singular)?.solve(&from.right);
        Ok(Step::Trial(self.at(clamped(from.unknowns + step, self.prior))))
    }

    fn accept(&self, from: &Tried, to: &mut Tried) -> bool {
        from.cost - to.cost < CONVERGED
    }
}

/// The nearest least squares to a vector.
pub(super) fn solve(copies: &[Copy], vector: [f64; 2], prior: &Prior) -> Option<Solution> {
    let lobes = Lobes { copies, prior };
    let start = lobes.at(clamped(with_light(copies, vector, prior), prior));
    let Tried { unknowns: p, matrix: a, cost, .. } = levenberg_marquardt(&lobes, start, DAMPING, STEPS).ok()?;
    // A little damping where nothing tells the vector: its variance is then huge, as it should be.
    let inverse = (a + Matrix::identity() * 1e-9).cholesky()?.inverse();
    Some(Solution {
        vector: [p[0], p[1]],
        covariance: [inverse[(0, 0)], inverse[(0, 1)], inverse[(1, 1)]],
        orders: std::array::from_fn(|n| p[3 + n]),
        first_sigma: inverse[(3, 3)].sqrt(),
        stray: p[2],
        cost,
    })
}

impl Solution {
    /// What it shows at a copy.
    pub fn light(&self, copy: &Copy) -> f64 {
        let p = self.unknowns();
        row(copy, &p).0
    }

    /// How much of a lobe of its own a copy sees, 0 to 1.
    pub fn inside(&self, copy: &Copy) -> f64 {
        let near = |k: f64| kernel(copy, [k * self.vector[0], k * self.vector[1]]).map_or(0.0, |(v, _)| v);
        let of = |n: usize| {
            let known = self.orders[n - 1] > 0.05 * self.orders[0];
            if known { near(n as f64).max(near(-(n as f64))) } else { 0.0 }
        };
        (1..=ORDERS).map(of).fold(0.0, f64::max) / copy.shape.peak
    }

    /// Light of an order that would lie at a part of the first one's place, and its standard deviation: zero or so where there is none.
    pub fn light_at(&self, copies: &[Copy], part: f64) -> [f64; 2] {
        let (mut top, mut bottom) = (0.0, 0.0);
        let p = self.unknowns();
        for copy in copies {
            let near = |k: f64| kernel(copy, [k * p[0], k * p[1]]).map_or(0.0, |(v, _)| v);
            let value = near(part) + near(-part);
            if value > 0.0 {
                top += copy.weight * value * (copy.light - row(copy, &p).0);
                bottom += copy.weight * value * value;
            }
        }
        let bottom = bottom.max(1e-12);
        [top / bottom, bottom.powf(-0.5)]
    }

    fn unknowns(&self) -> Vector {
        let mut p = Vector::zeros();
        (p[0], p[1], p[2]) = (self.vector[0], self.vector[1], self.stray);
        (0..ORDERS).for_each(|n| p[3 + n] = self.orders[n]);
        p
    }
}

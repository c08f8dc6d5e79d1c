//! Least-squares fit of one grating: its vector, the light of its orders, and stray light.

use super::lobe::Shape;
use nacre_base::least_squares::{Damping, Problem, Step, levenberg_marquardt};
use nalgebra::{SMatrix, SVector};

/// Number of fitted orders on each side.
pub(super) const ORDERS: usize = 3;

/// Grating vector, stray light, light of the orders.
const UNKNOWNS: usize = 3 + ORDERS;

/// Squared radius in standard deviations at which lobes are truncated (1e-6 of the peak).
const FAR: f64 = 28.0;

/// Maximum number of iterations.
const STEPS: usize = 30;

/// Levenberg-Marquardt damping.
const DAMPING: Damping = Damping { first: 1e-3, down: 0.2, least: 0.0, up: 8.0, most: 1e8 };

/// Decrease of χ² below which the fit has converged.
const CONVERGED: f64 = 1e-3;

/// Prior standard deviation of the light of an order and of stray light, relative to the brightest copy; applies
/// without evidence.
const VAGUE: f64 = 6.0;

type Matrix = SMatrix<f64, UNKNOWNS, UNKNOWNS>;
type Vector = SVector<f64, UNKNOWNS>;

/// One copy of a position of the tile under one light.
#[derive(Clone, Copy, Debug)]
pub(super) struct Copy {
    /// Half vector.
    pub half: [f64; 2],
    /// Shape of a lobe there.
    pub shape: Shape,
    /// Light divided by irradiance, relative to the brightest copy.
    pub light: f64,
    /// Inverse variance of `light`.
    pub weight: f64,
}

/// Prior knowledge about gratings.
#[derive(Clone, Copy, Debug)]
pub(super) struct Prior {
    /// Minimum and maximum length of the grating vector λ/a.
    pub range: [f64; 2],
    /// Common length and its standard deviation.
    pub shared: Option<[f64; 2]>,
}

/// A fitted grating.
#[derive(Clone, Copy, Debug)]
pub(super) struct Solution {
    /// Grating vector λ/a (cos θ, sin θ).
    pub vector: [f64; 2],
    /// Covariance of the vector: xx, xy, yy.
    pub covariance: [f64; 3],
    /// Energy of the orders 1, 2, …
    pub orders: [f64; ORDERS],
    /// Standard deviation of the first order's energy.
    pub first_sigma: f64,
    /// Stray light.
    pub stray: f64,
    /// χ².
    pub cost: f64,
}

/// Value of a lobe at a copy for unit energy, and its derivative with respect to the order's position; `None` far from
/// the lobe.
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

/// Predicted light of a copy, and its derivatives with respect to the unknowns.
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

/// Normal equations of the residuals, and χ².
fn normal(copies: &[Copy], p: &Vector, prior: &Prior) -> (Matrix, Vector, f64) {
    let (mut a, mut b, mut cost) = (Matrix::zeros(), Vector::zeros(), 0.0);
    for copy in copies {
        let (light, row) = row(copy, p);
        let left = copy.light - light;
        cost += copy.weight * left * left;
        // Most copies see only stray light.
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

/// Clamps light to non-negative values and the vector to its range.
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

/// Optimal light of the orders for a fixed grating vector.
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

/// χ² at a grating vector, with the optimal light of its orders.
pub(super) fn cost_at(copies: &[Copy], vector: [f64; 2], prior: &Prior) -> f64 {
    let p = with_light(copies, vector, prior);
    normal(copies, &p, prior).2
}

/// Copies and prior of one grating.
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

/// Least-squares solution that starts at a vector.
pub(super) fn solve(copies: &[Copy], vector: [f64; 2], prior: &Prior) -> Option<Solution> {
    let lobes = Lobes { copies, prior };
    let start = lobes.at(clamped(with_light(copies, vector, prior), prior));
    let Tried { unknowns: p, matrix: a, cost, .. } = levenberg_marquardt(&lobes, start, DAMPING, STEPS).ok()?;
    // Slight regularisation of undetermined vectors, whose variance is then large.
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
    /// Predicted light of a copy.
    pub fn light(&self, copy: &Copy) -> f64 {
        let p = self.unknowns();
        row(copy, &p).0
    }

    /// Largest relative lobe value of any order at a copy, 0 to 1.
    pub fn inside(&self, copy: &Copy) -> f64 {
        let near = |k: f64| kernel(copy, [k * self.vector[0], k * self.vector[1]]).map_or(0.0, |(v, _)| v);
        let of = |n: usize| {
            let known = self.orders[n - 1] > 0.05 * self.orders[0];
            if known { near(n as f64).max(near(-(n as f64))) } else { 0.0 }
        };
        (1..=ORDERS).map(of).fold(0.0, f64::max) / copy.shape.peak
    }

    /// Light of an order at `part` times the first order's position, and its standard deviation; near zero if no such
    /// order exists.
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

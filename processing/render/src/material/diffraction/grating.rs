//! Lossless gratings in a scene. Orders follow scalar theory (2018 paper, section 3.2, with Bessel functions in place
//! of its Taylor series). The width of their lobes follows from the coherence and the light.
//!
//! Scalar theory assigns an order the power `gain · |c_m(2πν(cos θi + cos θr))|²` (see [`nacre_brdf::Pair`]). The sum
//! over all orders of an incident direction is not 1: evanescent orders are missing, and w differs from order to order.
//! At one wavelength a grating couples finitely many directions, equally many incident and diffracted: `s + n λ/a` with
//! a length below 1 (s is tangential). The square matrix of their powers is scaled by row and column factors until all
//! rows and columns add up to 1 (Sinkhorn and Knopp 1967). The result is lossless, and reciprocal because the factors
//! belong to directions. Of all such matrices it is closest to scalar theory's in relative entropy. It is also closer
//! to rigorous solutions for a perfect conductor than scalar theory itself (`docs/validation/rendering.md`,
//! `render-orders`).

use nacre_base::{Error, Result};
use nacre_brdf::{Reflectance, Section, most_orders};
use std::f64::consts::{FRAC_PI_2, TAU};
use std::ops::RangeInclusive;

use crate::light::viewer::RANGE;

/// Spacing of a table's points over `q · depth`; linear interpolation has an error of 1e-5.
pub(crate) const STEP: f64 = 0.01;

/// Maximum number of balancing iterations, and tolerance of the sums.
pub(crate) const ROUNDS: usize = 200;
pub(crate) const BALANCED: f64 = 1e-4;

/// Powers that differ by less count as equal, since the difference is rounding.
const EVEN: f32 = 1e-6;

/// Number of coupled directions above which powers are scaled by row only: for such long periods nearly all orders
/// propagate.
const MAX_DIRECTIONS: usize = 48;

/// Distance over which slopes are averaged, an eighth of a wavelength: light does not resolve finer details.
const WALL_UM: f64 = 0.07;

/// A grating profile with parameters of its evaluation.
pub(crate) struct Grating {
    /// Powers of the orders `-most..=most` over `q · depth`.
    pub table: Vec<f32>,
    pub most: i32,
    pub depth_um: f64,
    /// Highest computed order.
    pub orders: i32,
    /// Largest share of light in the neglected orders.
    pub left_out: f64,
    /// Whether orders m and -m have the same power, so that the matrix of powers is symmetric.
    pub even: bool,
    /// Standard deviation of a lobe in 1/µm.
    pub sigma: f64,
    pub reflectance: Reflectance,
}

/// Grating vector at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Groove {
    /// Direction of the grating vector.
    pub across: [f64; 2],
    pub period_um: f64,
}

/// An order of a lossless grating, in scalar theory and after balancing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BalancedOrder {
    /// Order number: `sin θi + sin θr = m λ/Λ`, with the directions of light and view.
    pub order: i32,
    /// Efficiency in scalar theory, with its gain; the sum over all orders may differ from 1.
    pub scalar: f64,
    /// Balanced efficiency.
    pub balanced: f64,
}

/// A lossless grating with tabulated orders.
pub struct BalancedOrders {
    grating: Grating,
    period_um: f64,
}

impl BalancedOrders {
    /// Prepares a profile.
    ///
    /// # Errors
    /// `Input` for an invalid period or depth.
    pub fn new(section: &Section, period_um: f64) -> Result<Self> {
        check("period", period_um, 0.01..=200.0, "µm")?;
        check("depth", section.depth_um(), 0.0..=20.0, "µm")?;
        Ok(Self { grating: Grating::new(section, period_um, 1.0, Reflectance::Perfect, 0.0), period_um })
    }

    /// Orders that couple a direction of light and one of view perpendicular to the grooves, by increasing number; one
    /// of them is at `angle` (rad).
    ///
    /// # Errors
    /// `Input` for invalid numbers.
    pub fn at(&self, angle: f64, wavelength_nm: f64) -> Result<Vec<BalancedOrder>> {
        check("angle", angle, -FRAC_PI_2..=FRAC_PI_2, "rad")?;
        check("wavelength", wavelength_nm, 1e3 / RANGE[1]..=1e3 / RANGE[0], "nm")?;
        let groove = Groove { across: [1.0, 0.0], period_um: self.period_um };
        let view = [angle.sin(), 0.0, angle.cos()];
        let mut found = vec![];
        self.grating.orders(view, groove, 1e3 / wavelength_nm, &mut Scratch::default(), |o| {
            found.push(BalancedOrder { order: o.order, scalar: o.power / o.factor, balanced: o.power });
        });
        found.sort_by_key(|o| o.order);
        Ok(found)
    }

    /// Approximate share of light that balanced orders place in a wrong order for a perfect conductor:
    /// `0.3 ⟨h'²⟩ / cos θ`, fitted to rigorous solutions (`render-orders`). Slopes of walls are averaged over 70 nm.
    pub fn theory_error(section: &Section, period_um: f64, angle: f64) -> f64 {
        (0.3 * section.mean_square_slope(period_um, WALL_UM) / angle.cos().max(0.05)).min(1.0)
    }
}

fn check(name: &str, value: f64, range: RangeInclusive<f64>, unit: &str) -> Result<()> {
    if range.contains(&value) {
        return Ok(());
    }
    let wanted = format!("give {} to {} {unit}", range.start(), range.end());
    Err(Error::input(format!("grating, {name}"), format!("found {value}"), wanted))
}

/// Scratch memory of one thread.
#[derive(Default)]
pub(crate) struct Scratch {
    cos: Vec<f64>,
    matrix: Vec<f64>,
    columns: Vec<f64>,
    rows: Vec<f64>,
}

/// One of the orders visible from a direction of view.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Order {
    pub order: i32,
    /// Direction of its light: tangential components, and the component along the normal.
    pub from: [f64; 3],
    /// Reflected share of the radiance from that direction, relative to a perfect mirror.
    pub power: f64,
    /// Ratio of the balanced power to that of scalar theory.
    pub factor: f64,
}

impl Grating {
    /// A grating for periods up to `longest_um`; neglected orders have less than `error` of the light in total.
    pub(crate) fn new(section: &Section, longest_um: f64, sigma: f64, reflectance: Reflectance, error: f64) -> Self {
        let depth_um = section.depth_um();
        let steepest = 2.0 * TAU * RANGE[1];
        let deepest = steepest * depth_um;
        // The number of orders that can lie above the horizon at both ends.
        let seen = (2.0 * longest_um * RANGE[1]).ceil() as usize;
        let most = most_orders(steepest, depth_um).max(8).min(seen.max(1));
        let count = (deepest / STEP).ceil() as usize + 2;
        let width = 2 * most + 1;
        let mut table = vec![0.0_f32; count * width];
        for (k, row) in table.chunks_exact_mut(width).enumerate() {
            let q = if depth_um > 0.0 { STEP * k as f64 / depth_um } else { 0.0 };
            for (out, c) in row.iter_mut().zip(section.amplitudes(q, most)) {
                *out = c.norm_sqr() as f32;
            }
        }
        let mut grating = Self {
            table,
            most: most as i32,
            depth_um,
            orders: most as i32,
            left_out: 0.0,
            even: false,
            sigma,
            reflectance,
        };
        let left_out = |orders: i32| {
            let beyond = |row: &[f32]| -> f64 {
                let at = |m: i32| f64::from(row[(m + most as i32) as usize]);
                (orders + 1..=most as i32).map(|m| at(m) + at(-m)).sum()
            };
            grating.table.chunks_exact(width).map(beyond).fold(0.0, f64::max)
        };
        let enough = (1..=most as i32).find(|m| left_out(*m) <= error).unwrap_or(most as i32);
        (grating.left_out, grating.orders) = (left_out(enough), enough);
        let odd = |row: &[f32]| row.iter().zip(row.iter().rev()).any(|(a, b)| (a - b).abs() > EVEN);
        grating.even = !grating.table.chunks_exact(width).any(odd);
        grating
    }

    /// A grating of powers that depend only on the order, `0, ±1, ±2, …`, such as those of slits.
    pub(crate) fn of_powers(powers: &[f64], sigma: f64, reflectance: Reflectance) -> Self {
        let most = powers.len() as i32 - 1;
        let row: Vec<f32> = (-most..=most).map(|m| powers[m.unsigned_abs() as usize] as f32).collect();
        let table = [row.as_slice(), row.as_slice()].concat();
        Self { table, most, depth_um: 0.0, orders: most, left_out: 0.0, even: true, sigma, reflectance }
    }

    /// Power of an order in scalar theory for `q = 2πν(cos θi + cos θr)`.
    #[inline]
    pub(crate) fn power(&self, order: i32, q: f64) -> f64 {
        if order.abs() > self.orders {
            return 0.0;
        }
        let place = q * self.depth_um / STEP;
        let width = (2 * self.most + 1) as usize;
        let k = (place as usize).min(self.table.len() / width - 2);
        let share = (place - k as f64).min(1.0);
        let at = k * width + (order + self.most) as usize;
        f64::from(self.table[at]) * (1.0 - share) + f64::from(self.table[at + width]) * share
    }

    /// Orders visible from a direction of view (tangential components and the component along the normal) at a wave
    /// number: the directions of their light, and their powers.
    pub(crate) fn orders(
        &self,
        view: [f64; 3],
        groove: Groove,
        number: f64,
        scratch: &mut Scratch,
        mut each: impl FnMut(Order),
    ) {
        let g = groove.across.map(|a| a / (number * groove.period_um));
        let length = (g[0] * g[0] + g[1] * g[1]).sqrt();
        // s + n g: range of n within the unit circle.
        let along = (view[0] * g[0] + view[1] * g[1]) / (length * length);
        let square = view[0] * view[0] + view[1] * view[1];
        let reach = ((1.0 - square) / (length * length) + along * along).max(0.0).sqrt();
        let first = (-along - reach).ceil().min(0.0) as i32;
        let last = (-along + reach).floor().max(0.0) as i32;
        let count = (last - first + 1) as usize;
        let at = |n: i32| [view[0] + f64::from(n) * g[0], view[1] + f64::from(n) * g[1]];
        scratch.cos.clear();
        scratch.cos.extend((first..=last).map(|n| {
            let [x, y] = at(n);
            // Limited away from exact grazing, where scalar theory's gain diverges.
            if n == 0 { view[2].max(1e-3) } else { (1.0 - x * x - y * y).max(1e-6).sqrt() }
        }));
        let zero = (-first) as usize;
        if count > MAX_DIRECTIONS {
            self.row(zero, count, at, first, number, scratch, &mut each);
            return;
        }
        self.powers(count, first, number, &at, scratch);
        if self.even {
            balance_even(scratch, count);
        } else {
            balance(scratch, count);
        }
        let columns = if self.even { &scratch.rows } else { &scratch.columns };
        for (n, column) in columns.iter().enumerate() {
            let from = at(n as i32 + first).map(|v| -v);
            let factor = scratch.rows[zero] * column;
            let power = scratch.matrix[zero * count + n] * factor;
            if power > 0.0 {
                each(Order { order: -(n as i32 + first), from: [from[0], from[1], scratch.cos[n]], power, factor });
            }
        }
    }

    /// Matrix of scalar powers among the coupled directions.
    fn powers(&self, count: usize, first: i32, number: f64, at: &impl Fn(i32) -> [f64; 2], scratch: &mut Scratch) {
        let Scratch { matrix, cos, .. } = scratch;
        matrix.clear();
        matrix.resize(count * count, 0.0);
        for k in 0..count {
            let last = if self.even { k } else { count - 1 };
            for n in 0..=last {
                let power = self.coupling(k as i32 + first, n as i32 + first, number, at, cos, first);
                matrix[k * count + n] = power;
                if self.even {
                    matrix[n * count + k] = power;
                }
            }
        }
    }

    /// Scalar power from one coupled direction to another.
    fn coupling(
        &self,
        out: i32,
        into: i32,
        number: f64,
        at: &impl Fn(i32) -> [f64; 2],
        cos: &[f64],
        first: i32,
    ) -> f64 {
        let (c, d) = (cos[(out - first) as usize], cos[(into - first) as usize]);
        let power = self.power(out - into, TAU * number * (c + d));
        if power == 0.0 {
            return 0.0;
        }
        let ([x, y], [u, v]) = (at(out), at(into));
        // The light comes from -(u, v).
        let dot = c * d - x * u - y * v;
        power * (1.0 + dot).powi(2) / (c * d * (c + d) * (c + d))
    }

    #[expect(clippy::too_many_arguments, reason = "the pieces of one loop")]
    fn row(
        &self,
        zero: usize,
        count: usize,
        at: impl Fn(i32) -> [f64; 2],
        first: i32,
        number: f64,
        scratch: &mut Scratch,
        each: &mut impl FnMut(Order),
    ) {
        scratch.rows.clear();
        let all = (0..count).map(|n| self.coupling(0, n as i32 + first, number, &at, &scratch.cos, first));
        scratch.rows.extend(all);
        let factor = 1.0 / scratch.rows.iter().sum::<f64>().max(1e-300);
        debug_assert!(zero < count);
        for (n, power) in scratch.rows.iter().enumerate().filter(|(_, p)| **p > 0.0) {
            let from = at(n as i32 + first).map(|v| -v);
            let order = -(n as i32 + first);
            each(Order { order, from: [from[0], from[1], scratch.cos[n]], power: power * factor, factor });
        }
    }
}

/// Row and column factors that make a square matrix of powers doubly stochastic.
fn balance(scratch: &mut Scratch, count: usize) {
    let Scratch { matrix, rows, columns, .. } = scratch;
    rows.clear();
    rows.resize(count, 1.0);
    columns.clear();
    columns.resize(count, 1.0);
    for _ in 0..ROUNDS {
        for (n, column) in columns.iter_mut().enumerate() {
            let sum: f64 = (0..count).map(|k| matrix[k * count + n] * rows[k]).sum();
            *column = 1.0 / sum.max(1e-12);
        }
        let mut worst = 0.0_f64;
        for (row, values) in rows.iter_mut().zip(matrix.chunks_exact(count)) {
            let sum: f64 = values.iter().zip(columns.iter()).map(|(v, c)| v * c).sum();
            worst = worst.max((*row * sum - 1.0).abs());
            *row = 1.0 / sum.max(1e-12);
        }
        if worst < BALANCED {
            break;
        }
    }
}

/// Balances a symmetric matrix, whose row and column factors are equal. Near the solution, a step by the power p of the
/// sums multiplies the error by `1 - p (1 + λ)`, with the eigenvalues λ of the balanced matrix. They are close to 1
/// where the mirror direction has most of the light, and Sinkhorn's steps (p = 1) then converge slowly. Each pair of
/// them is therefore preceded by a square-root step.
fn balance_even(scratch: &mut Scratch, count: usize) {
    let Scratch { matrix, rows, columns: sums, .. } = scratch;
    rows.clear();
    rows.resize(count, 1.0);
    sums.clear();
    sums.resize(count, 0.0);
    for round in 0..2 * ROUNDS {
        for ((sum, values), row) in sums.iter_mut().zip(matrix.chunks_exact(count)).zip(rows.iter()) {
            *sum = row * values.iter().zip(rows.iter()).map(|(v, r)| v * r).sum::<f64>();
        }
        if sums.iter().all(|sum| (sum - 1.0).abs() < BALANCED) {
            break;
        }
        for (row, sum) in rows.iter_mut().zip(sums.iter()) {
            let step = if round % 3 == 0 { sum.sqrt() } else { *sum };
            // A direction without light keeps its factor: no finite one makes its sum 1.
            *row /= if step > 0.0 { step } else { 1.0 };
        }
    }
}

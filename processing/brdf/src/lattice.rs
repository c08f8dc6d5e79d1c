//! Surfaces of a single period, whose orders lie on one line at multiples of one frequency.

use super::bank::Relief;
use super::transform::Plan;
use nacre_base::{Error, Result};
use serde::Serialize;

/// Largest fraction of the height variance at other frequencies.
const ELSEWHERE: f64 = 1e-3;

/// Frequencies of a single grating.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(super) struct Lattice {
    /// First order, in cycles per patch.
    pub base: [isize; 2],
    /// First order, in 1/µm.
    pub frequency: [f64; 2],
}

impl Lattice {
    /// Finds the single period of a patch with a whole number of periods.
    ///
    /// # Errors
    /// `Input` for patches with several periods, or none.
    pub(super) fn find(relief: &Relief) -> Result<Self> {
        let plan = Plan::<f64>::new(relief.width, relief.height, [relief.width, relief.height], [f64::INFINITY; 2]);
        let plane = plan.real(&relief.scaled());
        let [mx, my] = plan.reach().map(|m| m as isize);
        let mut peaks: Vec<([isize; 2], f64)> = (-my..=my)
            .flat_map(|iy| (-mx..=mx).map(move |ix| [ix, iy]))
            .filter(|at| *at != [0, 0])
            .map(|at| (at, plane.at(at).norm_sqr()))
            .collect();
        let all: f64 = peaks.iter().map(|p| p.1).sum();
        let refuse = |problem: String| {
            Error::input("method nmm", problem, "crop the patch to whole periods, or use auto, chebyshev or fft")
        };
        if all <= 1e-18 {
            return Err(refuse("needs a surface with a period, and this one is flat".into()));
        }
        peaks.sort_by(|a, b| b.1.total_cmp(&a.1));
        // Greatest common divisor of all significant frequencies.
        let (mut base, mut kept) = ([0_isize; 2], 0.0);
        for (at, power) in &peaks {
            if kept >= (1.0 - ELSEWHERE) * all {
                break;
            }
            base = measure(base, *at).ok_or_else(|| refuse("finds orders in several directions".into()))?;
            kept += power;
        }
        let size = relief.size_um;
        let frequency = [base[0] as f64 / size[0], base[1] as f64 / size[1]];
        let first = peaks.first().map_or(0.0, |(at, _)| (at[0] as f64 / size[0]).hypot(at[1] as f64 / size[1]));
        let ratio = first / frequency[0].hypot(frequency[1]);
        // The strongest frequency of one grating is among its first few orders. For several periods the common divisor
        // is far below it.
        if ratio > 4.5 {
            let problem = format!(
                "needs a single period, but the patch mixes several: their common one, {:.2} µm, is {ratio:.0} times the strongest",
                ratio / first
            );
            return Err(refuse(problem));
        }
        Ok(Self { base, frequency })
    }

    /// Lattice of orders on one line that are more than twice `radius` (1/µm) apart; `None` otherwise, or for the zero
    /// order alone.
    pub(super) fn of(mut orders: impl Iterator<Item = [isize; 2]>, size_um: [f64; 2], radius: f64) -> Option<Self> {
        let base = orders.try_fold([0; 2], |base, at| if at == [0; 2] { Some(base) } else { measure(base, at) })?;
        let frequency = [base[0] as f64 / size_um[0], base[1] as f64 / size_um[1]];
        (frequency[0].hypot(frequency[1]) > 2.0 * radius).then_some(Self { base, frequency })
    }

    /// Whether a frequency in cycles per patch is one of its orders.
    pub(super) fn holds(&self, [ix, iy]: [isize; 2]) -> bool {
        let [bx, by] = self.base;
        let m = if bx != 0 { ix / bx } else { iy / by };
        [m * bx, m * by] == [ix, iy]
    }

    /// Ranges of wave numbers (1/µm) at which an order lies within `radius` of the direction with this tangent. Near
    /// the mirror direction, order 0 takes the whole spectrum.
    pub(super) fn ranges(&self, tangent: [f64; 2], numbers: [f64; 2], radius: f64) -> Vec<[f64; 2]> {
        let length = self.frequency[0].hypot(self.frequency[1]);
        let unit = self.frequency.map(|f| f / length);
        let along = tangent[0] * unit[0] + tangent[1] * unit[1];
        let across = tangent[1] * unit[0] - tangent[0] * unit[1];
        let most = if across.abs() > 0.0 { (radius / across.abs()).min(numbers[1]) } else { numbers[1] };
        if most < numbers[0] {
            return vec![];
        }
        let orders = [numbers[0] * along / length, most * along / length];
        let margin = radius / length;
        let first = (orders[0].min(orders[1]) - margin).ceil() as i64;
        let last = (orders[0].max(orders[1]) + margin).floor() as i64;
        let mut all: Vec<[f64; 2]> = (first..=last)
            .filter_map(|m| {
                let middle = m as f64 * length;
                let ends = [(middle - radius) / along, (middle + radius) / along];
                let [low, high] = [ends[0].min(ends[1]), ends[0].max(ends[1])];
                let [low, high] = if along == 0.0 { numbers } else { [low.max(numbers[0]), high.min(most)] };
                (low <= high).then_some([low, high])
            })
            .collect();
        // On the opposite side, wave numbers fall as orders rise.
        all.sort_by(|a, b| a[0].total_cmp(&b[0]));
        all
    }
}

/// Greatest common divisor of two collinear frequencies; `None` if they are not collinear.
fn measure(a: [isize; 2], b: [isize; 2]) -> Option<[isize; 2]> {
    if a[0] * b[1] != a[1] * b[0] {
        return None;
    }
    let gcd = |mut a: isize, mut b: isize| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a.abs()
    };
    if a == [0, 0] {
        return Some(upright(b));
    }
    // Along the line both are multiples of one step.
    let step = gcd(b[0], b[1]);
    let unit = [b[0] / step, b[1] / step];
    let of = |v: [isize; 2]| if unit[0] != 0 { v[0] / unit[0] } else { v[1] / unit[1] };
    let common = gcd(of(a), of(b));
    Some(upright([unit[0] * common, unit[1] * common]))
}

/// Of a frequency and its opposite, the one to the right, or else up.
fn upright([x, y]: [isize; 2]) -> [isize; 2] {
    if x < 0 || (x == 0 && y < 0) { [-x, -y] } else { [x, y] }
}

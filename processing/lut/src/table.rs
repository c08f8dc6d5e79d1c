//! Tables over half vectors.

use super::kernel::{Kernel, Weight};
use super::plane::Plane;
use super::rays::{Fineness, Octave};
use pulp::Arch;
use rayon::prelude::*;
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// Radius around the zero order, in pixels, within which entries are summed individually.
pub(super) const INNER_PX: f64 = 4.0;

/// Coefficients of t, t³, … of the arc tangent on 0 to 1: minimax polynomial with an error of 4·10⁻⁸.
const ARC_TANGENT: [f32; 8] = [
    0.999_999_34,
    -0.333_298_6,
    0.199_465_59,
    -0.139_085_96,
    0.096_421_14,
    -0.055_911_217,
    0.021_862_21,
    -0.004_054_365_7,
];

/// Grid of half vectors of a table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    /// Entries per row and column.
    pub size: usize,
    /// Largest component of the half vector ωi + ωo.
    pub extent: f64,
    /// Exponent of the warp, odd: entries lie at `extent · aⁿ` with `a` uniform between −1 and 1.
    pub warp: i32,
}

impl Grid {
    /// Half-vector component of the `k`-th entry.
    pub(super) fn at(&self, k: usize) -> f64 {
        let even = (2.0 * k as f64 + 1.0) / self.size as f64 - 1.0;
        self.extent * even.powi(self.warp)
    }

    /// Index of the entry nearest to a half-vector component, given as a fraction of the extent.
    pub(super) fn entry(&self, part: f64) -> usize {
        let even = part.abs().powf(1.0 / f64::from(self.warp)).copysign(part);
        let k = (0.5 * (even + 1.0) * self.size as f64 - 0.5).round();
        (k.max(0.0) as usize).min(self.size - 1)
    }
}

/// Summation method.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Method {
    /// All entries at once, by rays.
    Rays(Fineness),
    /// Entry by entry, with samples this many pixels of the photograph apart.
    Single { spacing_px: f64 },
    /// Entry by entry, with wavelengths this many nm apart, as in the paper.
    Fixed { step_nm: f64 },
}

/// A photograph, its zero order, and its pixel size in half vectors. Positions right of the zero order are lit and seen
/// from their left: their half vectors ωi + ωo point to the left.
pub(super) struct Source<'a> {
    pub plane: &'a Plane,
    pub center: [f64; 2],
    pub scale: f64,
}

impl Source<'_> {
    /// X, Y, Z and coverage of each entry, row by row from the top.
    pub(super) fn table(&self, kernel: &Kernel, grid: &Grid, method: Method) -> Vec<Weight> {
        let side: Vec<f32> = (0..grid.size).map(|k| (grid.at(k) / self.scale) as f32).collect();
        let mut table = vec![[0.0; 4]; grid.size * grid.size];
        let corner = f64::from(side.last().copied().unwrap_or(0.0)) * 2.0_f64.sqrt() * (1.0 + 1e-6);
        let mut outer = corner;
        let mut method = method;
        while let Method::Rays(fineness) = method {
            if outer <= INNER_PX {
                break;
            }
            if self.reaches(kernel, 0.5 * outer) {
                let octave = Octave::new(self.plane, self.center, kernel, outer, fineness);
                each(
                    &mut table,
                    &side,
                    [0.5 * outer, outer],
                    #[inline(always)]
                    |u, v, square| octave.at(0.5 * square.ln(), angle(u, v)),
                );
            }
            outer *= 0.5;
            method = Method::Rays(fineness.inward());
        }
        loop {
            let inner = if outer <= INNER_PX { 0.0 } else { 0.5 * outer };
            let taps = match method {
                Method::Rays(fineness) => kernel.steps(fineness.spacing_px / outer.max(INNER_PX)).taps(),
                Method::Single { spacing_px } => kernel.steps(spacing_px / outer.max(INNER_PX)).taps(),
                Method::Fixed { step_nm } => kernel.fixed(step_nm),
            };
            each(&mut table, &side, [inner, outer], |u, v, _| self.sum(&taps, u, v));
            if inner == 0.0 {
                return table;
            }
            outer = inner;
        }
    }

    /// True if an entry at this radius or beyond overlaps the photograph.
    fn reaches(&self, kernel: &Kernel, radius: f64) -> bool {
        let far = |c: f64, n: usize| c.max((n - 1) as f64 - c);
        let farthest = far(self.center[0], self.plane.width).hypot(far(self.center[1], self.plane.height));
        radius * (-kernel.range()[1]).exp() <= farthest
    }

    /// Sums one entry; (u, v) is its half vector in pixels, to the right and up.
    #[inline]
    pub(super) fn sum(&self, taps: &[(f32, Weight)], u: f32, v: f32) -> Weight {
        let center = self.center.map(|c| c as f32);
        Arch::new().dispatch(
            #[inline(always)]
            || {
                let mut sum = [0.0; 4];
                for (factor, weight) in taps {
                    let [light, known] = self.plane.at(center[0] - factor * u, center[1] + factor * v);
                    for c in 0..3 {
                        sum[c] += weight[c] * light;
                    }
                    sum[3] += weight[3] * known;
                }
                sum
            },
        )
    }
}

/// Computes the entries with radii in pixels above `inner` and up to `outer`.
fn each(table: &mut [Weight], side: &[f32], [inner, outer]: [f64; 2], entry: impl Fn(f32, f32, f32) -> Weight + Sync) {
    let (least, most) = ((inner * inner) as f32, (outer * outer) as f32);
    let begin = side.partition_point(|u| f64::from(*u) < -outer);
    let end = side.partition_point(|u| f64::from(*u) <= outer);
    let size = side.len();
    table.par_chunks_mut(size).enumerate().skip(begin).take(end - begin).for_each(|(y, row)| {
        // The first row is the top row.
        let v = side[size - 1 - y];
        let (side, row) = (&side[begin..end], &mut row[begin..end]);
        Arch::new().dispatch(
            #[inline(always)]
            || {
                for (u, out) in side.iter().zip(row) {
                    let square = u * u + v * v;
                    if (square > least || least == 0.0) && square <= most {
                        *out = entry(*u, v, square);
                    }
                }
            },
        );
    });
}

/// Angle of a direction, 0 to 2π, to one or two units in the last place of f32. Unlike the library's function it
/// vectorises.
#[inline(always)]
pub(super) fn angle(u: f32, v: f32) -> f32 {
    let (large, small) = (u.abs().max(v.abs()), u.abs().min(v.abs()));
    let t = small / large.max(f32::MIN_POSITIVE);
    let square = t * t;
    let eighth = ARC_TANGENT.iter().rev().fold(0.0, |sum: f32, c| sum * square + c) * t;
    let quarter = if v.abs() > u.abs() { FRAC_PI_2 - eighth } else { eighth };
    let half = if u < 0.0 { PI - quarter } else { quarter };
    if v < 0.0 { TAU - half } else { half }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_those_of_the_library() {
        for k in 0..10_000 {
            let (sin, cos) = (f64::from(k) * 6.283e-4 + 1e-7).sin_cos();
            let (u, v) = ((3.7 * cos) as f32, (3.7 * sin) as f32);
            let truth = f64::from(v).atan2(f64::from(u)).rem_euclid(std::f64::consts::TAU);
            assert!((f64::from(angle(u, v)) - truth).abs() < 6e-7, "{u} {v}");
        }
        assert_eq!([angle(0.0, 0.0), angle(1.0, 0.0), angle(-1.0, 0.0)], [0.0, 0.0, PI]);
    }
}

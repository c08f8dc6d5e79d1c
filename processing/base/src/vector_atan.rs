//! Vectorisable arc tangents.
//!
//! The compiler vectorises loops over these functions where they are inlined into code for one kind of processor
//! (`vectorised`). No multiplication is fused with an addition, so all processors give identical bits.

use std::f32::consts::{FRAC_PI_2, PI};

/// atan(t)/t in powers of t² for t from 0 to 1: minimax polynomial with a relative error of 1.5e-8 before rounding.
const ATAN: [f32; 9] = [
    1.0,
    -0.333_330_72,
    0.199_926_2,
    -0.142_036_5,
    0.106_409_51,
    -0.075_043_27,
    0.042_691_87,
    -0.016_068_83,
    0.002_849_937,
];

/// Taylor series of sine and cosine, for up to an eighth of a turn: the truncation error is below 3e-8.
const SIN: [f32; 4] = [-1.0 / 6.0, 1.0 / 120.0, -1.0 / 5040.0, 1.0 / 362_880.0];
const COS: [f32; 4] = [-0.5, 1.0 / 24.0, -1.0 / 720.0, 1.0 / 40_320.0];

/// `y.atan2(x)` to 3e-7 rad; NaN if an argument is NaN. Zeros count as positive; infinities are not supported.
#[inline(always)]
pub fn atan2(y: f32, x: f32) -> f32 {
    let (across, along) = (y.abs(), x.abs());
    let steep = across > along;
    let (small, large) = if steep { (along, across) } else { (across, along) };
    let t = if large == 0.0 { 0.0 } else { small / large };
    let square = t * t;
    let [a, b, c, d, e, f, g, h, i] = ATAN;
    let sum = a + square
        * (b + square * (c + square * (d + square * (e + square * (f + square * (g + square * (h + square * i)))))));
    let first = t * sum;
    let first = if steep { FRAC_PI_2 - first } else { first };
    let upper = if x < 0.0 { PI - first } else { first };
    if y < 0.0 { -upper } else { upper }
}

/// Sine and cosine to 2e-7, of angles up to a few turns.
#[inline(always)]
pub fn sin_cos(angle: f32) -> [f32; 2] {
    // Subtracts quarter turns, the last one in two parts to preserve precision.
    let quarters = (angle * (2.0 / PI)).round_ties_even();
    let left = angle - quarters * 1.570_312_5 - quarters * 4.838_268e-4;
    let square = left * left;
    let sin = left + left * square * (SIN[0] + square * (SIN[1] + square * (SIN[2] + square * SIN[3])));
    let cos = 1.0 + square * (COS[0] + square * (COS[1] + square * (COS[2] + square * COS[3])));
    let odd = quarters * 0.5 != (quarters * 0.5).floor();
    let half = (quarters * 0.25 - (quarters * 0.25).floor()) * 4.0;
    let (sine, cosine) = if odd { (cos, sin) } else { (sin, cos) };
    [if half >= 2.0 { -sine } else { sine }, if (half == 1.0) | (half == 2.0) { -cosine } else { cosine }]
}

/// Wraps an angle from the range -π to 2π into `[0, π)`.
#[inline(always)]
pub fn folded(angle: f32) -> f32 {
    let up = if angle < 0.0 { angle + PI } else { angle };
    let down = if up >= PI { up - PI } else { up };
    // A tiny negative angle rounds to π, which is equivalent to 0.
    if down >= PI { 0.0 } else { down }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Comparison with double precision: along both axes, in all quadrants, and for very small and large numbers.
    #[test]
    fn arc_tangents_are_those_of_double_precision() {
        let mut worst = 0.0_f64;
        for k in 0..200_000 {
            let turn = std::f64::consts::TAU * f64::from(k) / 200_000.0;
            for size in [1e-30, 1.0, 1e30] {
                let (y, x) = ((size * turn.sin()) as f32, (size * turn.cos()) as f32);
                worst = worst.max((f64::from(atan2(y, x)) - f64::from(y).atan2(f64::from(x))).abs());
            }
        }
        assert!(worst < 3e-7, "{worst:e}");
        for (y, x, wanted) in
            [(0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, PI), (1.0, 0.0, FRAC_PI_2), (-1.0, 0.0, -FRAC_PI_2)]
        {
            assert_eq!(atan2(y, x), wanted, "{y} {x}");
        }
        assert!(atan2(f32::NAN, 1.0).is_nan() && atan2(1.0, f32::NAN).is_nan() && atan2(f32::NAN, f32::NAN).is_nan());
    }

    #[test]
    fn sines_are_those_of_double_precision() {
        for k in -200_000..200_000 {
            let angle = 1e-4 * k as f32;
            let (sin, cos) = f64::from(angle).sin_cos();
            let [s, c] = sin_cos(angle).map(f64::from);
            assert!((s - sin).abs() < 5e-7 && (c - cos).abs() < 5e-7, "{angle}: {} {}", s - sin, c - cos);
        }
        assert!(sin_cos(f32::INFINITY)[0].is_nan() && sin_cos(f32::NAN)[1].is_nan());
    }

    #[test]
    fn angles_are_folded_as_by_the_remainder() {
        for k in -3000..6000 {
            let angle = PI * k as f32 / 3000.0;
            let wanted = f64::from(angle).rem_euclid(f64::from(PI));
            let apart = (f64::from(folded(angle)) - wanted).abs();
            assert!((0.0..PI).contains(&folded(angle)), "{angle}");
            assert!(apart < 3e-7 || (apart - f64::from(PI)).abs() < 3e-7, "{angle}: {apart}");
        }
        assert_eq!(folded(-1e-9), 0.0);
        assert!(folded(f32::NAN).is_nan());
    }
}

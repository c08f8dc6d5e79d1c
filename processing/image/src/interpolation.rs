//! Interpolation between samples.

/// Weights of four samples by cubic convolution (Catmull-Rom; Keys 1981), for a position between the second and the
/// third: `t` is 0 at the second and 1 at the third.
#[inline(always)]
pub fn catmull_rom(t: f32) -> [f32; 4] {
    let (square, cube) = (t * t, t * t * t);
    [
        0.5 * (2.0 * square - cube - t),
        0.5 * (3.0 * cube - 5.0 * square + 2.0),
        0.5 * (4.0 * square - 3.0 * cube + t),
        0.5 * (cube - square),
    ]
}

#[cfg(test)]
mod tests {
    use super::catmull_rom;

    #[test]
    fn parabolas_are_met_exactly() {
        for t in [0.0_f32, 0.21, 0.5, 0.9, 1.0] {
            let parabola = |x: f32| 0.3 + 2.0 * x - 1.7 * x * x;
            let found: f32 = catmull_rom(t).iter().zip([-1.0, 0.0, 1.0, 2.0]).map(|(w, x)| w * parabola(x)).sum();
            assert!((found - parabola(t)).abs() < 1e-5, "{t}");
        }
    }
}

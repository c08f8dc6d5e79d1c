//! The disc of direction cosines.

/// Solid angle of the cell with these sides about a place in the disc of direction cosines, dx dy / cos θ: towards the rim, where the
/// cosine vanishes, the sum over x in closed form, over y in so many slices, of the part that is inside.
pub(crate) fn solid_angle([x, y]: [f64; 2], sides: [f64; 2], slices: usize) -> f64 {
    let square = x * x + y * y;
    if square < 0.81 {
        return sides[0] * sides[1] / (1.0 - square).sqrt();
    }
    let step = sides[1] / slices as f64;
    let slice = |k: usize| {
        let y = y + (k as f64 + 0.5) * step - 0.5 * sides[1];
        let radius = (1.0 - y * y).max(0.0).sqrt();
        if radius == 0.0 {
            return 0.0;
        }
        let angle = |x: f64| (x / radius).clamp(-1.0, 1.0).asin();
        (angle(x + 0.5 * sides[0]) - angle(x - 0.5 * sides[0])) * step
    };
    (0..slices).map(slice).sum()
}

#[cfg(test)]
mod tests {
    use super::solid_angle;
    use std::f64::consts::PI;

    #[test]
    fn cells_of_the_disc_make_a_hemisphere() {
        // Measured: 1.5e-4 off with a slice, 1e-5 with sixteen.
        for (slices, bound) in [(1, 5e-4), (16, 5e-5)] {
            let n = 400;
            let side = 2.0 / f64::from(n);
            let at = |k: i32| (f64::from(k) + 0.5) * side - 1.0;
            let sum: f64 = (0..n * n).map(|i| solid_angle([at(i % n), at(i / n)], [side; 2], slices)).sum();
            assert!((sum / (2.0 * PI) - 1.0).abs() < bound, "{slices}: {sum}");
        }
    }
}

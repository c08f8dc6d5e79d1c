//! The disc of direction cosines.

/// A slice of the part of a cell inside the disc, along the axis that crosses the rim. It is sampled evenly in the
/// elevation angle, in which the solid angle `dx dy / cos θ` has no singularity: the slice's solid angle is
/// `angle · width`.
pub(crate) struct Slice {
    /// Range of elevation angles in rad; values above π/2 lie beyond the normal.
    pub angles: [f64; 2],
    pub width: f64,
    /// Position across the slice, half the chord of the disc there, and the axis and side along which the slice runs.
    across: f64,
    radius: f64,
    along_x: bool,
    sign: f64,
}

impl Slice {
    /// Direction at an elevation angle.
    #[inline]
    pub fn direction(&self, angle: f64) -> [f64; 3] {
        let (sin, cos) = angle.sin_cos();
        let along = self.radius * cos * self.sign;
        let [x, y] = if self.along_x { [along, self.across] } else { [self.across, along] };
        [x, y, self.radius * sin]
    }
}

/// Divides the cell with these sides about a position into `count` slices; none outside the disc.
pub(crate) fn slices([x, y]: [f64; 2], sides: [f64; 2], count: usize) -> impl Iterator<Item = Slice> {
    let along_x = x.abs() >= y.abs();
    let ([along, across], [length, height]) = if along_x { ([x, y], sides) } else { ([y, x], [sides[1], sides[0]]) };
    let width = height / count as f64;
    (0..count).filter_map(move |k| {
        let across = across + (k as f64 + 0.5) * width - 0.5 * height;
        let radius = (1.0 - across * across).max(0.0).sqrt();
        let angle = |v: f64| (v / radius).clamp(-1.0, 1.0).acos();
        let angles = [angle(along.abs() + 0.5 * length), angle(along.abs() - 0.5 * length)];
        let inside = radius > 0.0 && angles[1] > angles[0];
        inside.then_some(Slice { angles, width, across, radius, along_x, sign: 1.0_f64.copysign(along) })
    })
}

/// Solid angle dx dy / cos θ of the cell with these sides about a position in the disc of direction cosines. Near the
/// rim, where the cosine vanishes, it covers the part inside the disc, divided into `count` slices.
pub(crate) fn solid_angle([x, y]: [f64; 2], sides: [f64; 2], count: usize) -> f64 {
    let square = x * x + y * y;
    if square < 0.81 {
        return sides[0] * sides[1] / (1.0 - square).sqrt();
    }
    slices([x, y], sides, count).map(|s| (s.angles[1] - s.angles[0]) * s.width).sum()
}

#[cfg(test)]
mod tests {
    use super::{slices, solid_angle};
    use std::f64::consts::PI;

    #[test]
    fn cells_of_the_disc_make_a_hemisphere() {
        // Measured errors: 1.5e-4 with one slice, 1e-5 with sixteen.
        for (count, bound) in [(1, 5e-4), (16, 5e-5)] {
            let n = 400;
            let side = 2.0 / f64::from(n);
            let at = |k: i32| (f64::from(k) + 0.5) * side - 1.0;
            let sum: f64 = (0..n * n).map(|i| solid_angle([at(i % n), at(i / n)], [side; 2], count)).sum();
            assert!((sum / (2.0 * PI) - 1.0).abs() < bound, "{count}: {sum}");
        }
    }

    #[test]
    fn slices_stay_in_their_cell() {
        for center in [[0.7, 0.69], [-0.69, 0.7], [0.02, -0.99], [-0.99, 0.01], [0.01, 0.02]] {
            let sides = [0.06, 0.04];
            for slice in slices(center, sides, 3) {
                for part in [0.01, 0.5, 0.99] {
                    let angle = slice.angles[0] + part * (slice.angles[1] - slice.angles[0]);
                    let d = slice.direction(angle);
                    assert!((d.iter().map(|v| v * v).sum::<f64>() - 1.0).abs() < 1e-12);
                    assert!(d[2] >= 0.0 && (0..2).all(|k| (d[k] - center[k]).abs() <= 0.5 * sides[k] + 1e-12), "{d:?}");
                }
            }
        }
    }
}

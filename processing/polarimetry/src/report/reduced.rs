//! Maps of angles at the size of a picture.

use crate::OrientationMaps;
use crate::orientation::orient::fold;
use rayon::prelude::*;

/// A map in which each pixel represents a block of `step` × `step` pixels; `None` for a step of 1.
///
/// Angles are averaged as (cos 2θ, sin 2θ) with weights 1/σ², and σ is that of the weighted mean. A pixel is masked if
/// more than half of its block is.
pub(crate) fn reduced(map: &OrientationMaps, step: usize) -> Option<OrientationMaps> {
    if step <= 1 {
        return None;
    }
    let (width, height) = (map.width.div_ceil(step), map.height.div_ceil(step));
    let (mut orientation, mut sigma) = (vec![0.0; width * height], vec![0.0; width * height]);
    let rows = orientation.par_chunks_mut(width).zip(sigma.par_chunks_mut(width)).enumerate();
    rows.for_each(|(y, (thetas, sigmas))| {
        let lines = y * step..((y + 1) * step).min(map.height);
        for (x, (theta, sigma)) in thetas.iter_mut().zip(sigmas).enumerate() {
            let columns = x * step..((x + 1) * step).min(map.width);
            (*theta, *sigma) = mean(lines.clone().flat_map(|y| {
                columns.clone().map(move |x| (map.orientation[y * map.width + x], map.sigma[y * map.width + x]))
            }));
        }
    });
    Some(OrientationMaps { width, height, orientation, sigma })
}

/// Weighted mean of angles and its σ, in rad; NaN if more than half of them are.
fn mean(pixels: impl Iterator<Item = (f32, f32)>) -> (f32, f32) {
    let (mut all, mut known, mut cos, mut sin, mut weight) = (0, 0, 0.0, 0.0, 0.0);
    for (theta, sigma) in pixels {
        all += 1;
        if theta.is_finite() {
            // Squares of a smaller σ would be subnormal.
            let w = 1.0 / sigma.max(f32::MIN_POSITIVE.sqrt()).powi(2);
            let (s, c) = (2.0 * theta).sin_cos();
            (known, cos, sin, weight) = (known + 1, cos + w * c, sin + w * s, weight + w);
        }
    }
    let theta = if 2 * known >= all { fold(0.5 * sin.atan2(cos)) } else { f32::NAN };
    (theta, if weight > 0.0 { 1.0 / weight.sqrt() } else { std::f32::consts::FRAC_PI_2 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::PI;

    /// Angles on both sides of 0° = 180° have a mean between them, a precise angle has a larger weight, and half of a
    /// block suffices.
    #[test]
    fn blocks_become_their_weighted_means() {
        let deg = |v: f32| v.to_radians();
        let nan = f32::NAN;
        #[rustfmt::skip]
        let orientation = vec![
            deg(178.0), deg(2.0), deg(10.0), deg(10.0), nan,
            deg(178.0), deg(2.0), nan,       nan,       deg(90.0),
            deg(30.0),  deg(60.0), nan,      deg(20.0), nan,
        ];
        let mut sigma = vec![0.02; 15];
        sigma[11] = 2e-5;
        let map = OrientationMaps { width: 5, height: 3, orientation, sigma };
        assert!(reduced(&map, 1).is_none());
        let small = reduced(&map, 2).unwrap();
        assert_eq!((small.width, small.height), (3, 2));
        let off = |i: usize, wanted: f32| (small.orientation[i] - deg(wanted) + 0.5 * PI).rem_euclid(PI) - 0.5 * PI;
        for (i, wanted) in [(0, 0.0), (1, 10.0), (2, 90.0), (3, 60.0), (4, 20.0)] {
            assert!(off(i, wanted).abs() < 1e-3, "{i}: {}", small.orientation[i].to_degrees());
        }
        assert!(small.orientation[5].is_nan());
        assert!((small.sigma[0] - 0.01).abs() < 1e-6 && (small.sigma[2] - 0.02).abs() < 1e-6);
    }
}

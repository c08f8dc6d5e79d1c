//! Comparison of a map with the truth, or with another map.

use crate::angle_difference;
use serde::Serialize;

/// Differences between two orientation maps after their best common offset, in degrees.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Comparison {
    /// Pixels with an orientation in both maps.
    pub pixels: usize,
    /// Common offset of the first map relative to the second, which the method does not determine; subtracted from all
    /// other values.
    pub offset_deg: f64,
    /// Mean absolute difference.
    pub mean_deg: f64,
    /// Median absolute difference.
    pub median_deg: f64,
    /// 95th percentile of the absolute difference.
    pub p95_deg: f64,
    /// Share of pixels that differ by more than 3σ.
    pub beyond_3_sigma: f64,
}

/// Compares orientations (rad, NaN where unknown) over the pixels for which `counts` holds; `sigma` (rad) belongs to
/// `measured`. `None` if no pixel has both. The offset is the circular mean of the doubled differences.
pub fn compare(measured: &[f32], sigma: &[f32], truth: &[f32], counts: impl Fn(usize) -> bool) -> Option<Comparison> {
    let known = |i: &usize| measured[*i].is_finite() && truth[*i].is_finite() && counts(*i);
    let difference = |i: usize| f64::from(measured[i]) - f64::from(truth[i]);
    let (mut sin, mut cos) = (0.0, 0.0);
    for i in (0..measured.len()).filter(known) {
        let (s, c) = (2.0 * difference(i)).sin_cos();
        sin += s;
        cos += c;
    }
    let offset = 0.5 * sin.atan2(cos);
    let mut beyond = 0_usize;
    let mut errors: Vec<f64> = (0..measured.len())
        .filter(known)
        .map(|i| {
            let error = angle_difference(difference(i), offset).abs();
            beyond += usize::from(error > 3.0 * f64::from(sigma[i]));
            error.to_degrees()
        })
        .collect();
    if errors.is_empty() {
        return None;
    }
    errors.sort_by(f64::total_cmp);
    let n = errors.len();
    Some(Comparison {
        pixels: n,
        offset_deg: offset.to_degrees(),
        mean_deg: errors.iter().sum::<f64>() / n as f64,
        median_deg: errors[n / 2],
        p95_deg: errors[(n * 95 / 100).min(n - 1)],
        beyond_3_sigma: beyond as f64 / n as f64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_offset_is_removed_and_wraps_around() {
        let truth: Vec<f32> = (0..180).map(|d| (d as f32).to_radians()).collect();
        let measured: Vec<f32> = (0..180).map(|d| ((d + 170) as f32 % 180.0).to_radians()).collect();
        let c = compare(&measured, &vec![0.01; 180], &truth, |_| true).unwrap();
        assert!((c.offset_deg + 10.0).abs() < 1e-4 && c.mean_deg < 1e-4 && c.beyond_3_sigma == 0.0, "{c:?}");
    }

    #[test]
    fn errors_are_counted_against_sigma() {
        let (truth, mut measured) = (vec![1.0_f32; 100], vec![1.0_f32; 100]);
        measured[3] = 1.2;
        measured[4] = f32::NAN;
        let c = compare(&measured, &vec![0.05; 100], &truth, |i| i != 5).unwrap();
        assert_eq!((c.pixels, (c.beyond_3_sigma * 98.0).round()), (98, 1.0));
    }
}

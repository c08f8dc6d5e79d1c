//! Noise estimation from a single photograph.
//!
//! Fourth differences along both axes suppress a blurred image (3e-3 of the contrast of lines 9 pixels apart) and keep
//! white noise. Their median absolute value, in classes of equal brightness, gives the noise as a function of light.
//! Noise correlated between neighbours, as after demosaicing or JPEG compression, is underestimated.

use super::deconvolution::Noise;

/// Number of brightness classes.
const CLASSES: usize = 16;

/// Minimum number of differences per class.
const MIN_PER_CLASS: usize = 64;

/// Fourth difference; its squares sum to 70 along each axis.
const FOURTH_DIFFERENCE: [f64; 5] = [1.0, -4.0, 6.0, -4.0, 1.0];
const SQUARED_TAPS: f64 = 70.0;

/// Median absolute value of a standard normal deviate.
const MEDIAN: f64 = 0.674_49;

/// Maximum number of sampled positions.
const MAX_SAMPLES: usize = 1 << 17;

/// Estimates the noise; `None` with too few known pixels. `step` is the quantisation step: rounding causes noise even
/// where the median is zero.
pub(super) fn estimate_noise(light: &[f32], width: usize, height: usize, step: f64) -> Option<Noise> {
    let mut samples = differences(light, width, height);
    let classes = (samples.len() / MIN_PER_CLASS).min(CLASSES);
    if classes == 0 {
        return None;
    }
    samples.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let size = samples.len() / classes;
    let rounding = step * step / 12.0;
    let class = |k: usize| {
        let mut own: Vec<f64> = samples[k * size..(k + 1) * size].iter().map(|p| p[1].abs()).collect();
        own.sort_by(f64::total_cmp);
        let light = samples[k * size..(k + 1) * size].iter().map(|p| p[0]).sum::<f64>() / size as f64;
        [light, ((own[size / 2] / MEDIAN).powi(2) / (SQUARED_TAPS * SQUARED_TAPS)).max(rounding)]
    };
    let classes: Vec<[f64; 2]> = (0..classes).map(class).collect();
    Some(fit_line(&classes, rounding))
}

/// Mean light and fourth difference at evenly spaced positions.
fn differences(light: &[f32], width: usize, height: usize) -> Vec<[f64; 2]> {
    if width < 5 || height < 5 {
        return vec![];
    }
    let all = (width - 4) * (height - 4);
    let every = (all / MAX_SAMPLES).max(1);
    let one = |i: usize| {
        let (x, y) = (i % (width - 4), i / (width - 4));
        let (mut sum, mut difference) = (0.0, 0.0);
        for (dy, a) in FOURTH_DIFFERENCE.iter().enumerate() {
            let row = &light[(y + dy) * width + x..][..5];
            for (v, b) in row.iter().zip(FOURTH_DIFFERENCE) {
                sum += f64::from(*v);
                difference += a * b * f64::from(*v);
            }
        }
        [sum / 25.0, difference]
    };
    (0..all).step_by(every).map(one).filter(|p| p[0].is_finite()).collect()
}

/// Fits variance against light by a straight line with non-negative slope and values of at least `least`. Relative
/// errors of all classes have equal weight.
fn fit_line(classes: &[[f64; 2]], least: f64) -> Noise {
    let floor = least.max(1e-14);
    let [mut s, mut sx, mut sy, mut sxx, mut sxy] = [0.0; 5];
    for [x, y] in classes {
        let w = 1.0 / y.max(floor).powi(2);
        [s, sx, sy, sxx, sxy] = [s + w, sx + w * x, sy + w * y, sxx + w * x * x, sxy + w * x * y];
    }
    let spread = s * sxx - sx * sx;
    let slope = if spread > 1e-9 * s * sxx { ((s * sxy - sx * sy) / spread).max(0.0) } else { 0.0 };
    let rest = (sy - slope * sx) / s;
    if rest >= floor {
        return Noise { shot: slope, floor: rest };
    }
    // Constrained to the minimal variance at zero light.
    Noise { shot: ((sxy - floor * sx) / sxx.max(f64::MIN_POSITIVE)).max(0.0), floor }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn normal(i: usize) -> f64 {
        let mut z = (i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mut sum = -6.0;
        for _ in 0..12 {
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9).wrapping_add(0x94d0_49bb_1331_11eb);
            z ^= z >> 31;
            sum += (z >> 11) as f64 / (1u64 << 53) as f64;
        }
        sum
    }

    #[test]
    fn shot_and_read_noise_are_separated_under_lines() {
        for (shot, floor) in [(1.0 / 3000.0, 1e-5), (1.0 / 40_000.0, 1e-7), (0.0, 1e-4)] {
            let value = |i: usize| {
                let (x, y) = ((i % 400) as f64, (i / 400) as f64);
                let light = 0.5 + 0.35 * (0.45 * x + 0.2 * y).sin() * (0.01 * y).cos();
                (light + (shot * light + floor).sqrt() * normal(i)) as f32
            };
            let light: Vec<f32> = (0..400 * 300).map(value).collect();
            let found = estimate_noise(&light, 400, 300, 0.0).unwrap();
            for light in [0.2, 0.5, 0.8] {
                let ratio = (found.shot * light + found.floor) / (shot * light + floor);
                assert!((ratio - 1.0).abs() < 0.1, "{shot} {floor} {light}: {ratio} {found:?}");
            }
        }
        assert!(estimate_noise(&[f32::NAN; 100], 10, 10, 0.0).is_none() && estimate_noise(&[1.0], 1, 1, 0.0).is_none());
        let even = estimate_noise(&[0.5; 10_000], 100, 100, 0.01).unwrap();
        assert!((even.floor / (1e-4 / 12.0) - 1.0).abs() < 1e-9 && even.shot == 0.0);
    }
}

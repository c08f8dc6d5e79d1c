//! Detects photographs with the same stated analyser angle but different light: one of the angles is wrong, or
//! something moved.

use super::sample::{AREA, Sample};
use crate::angle_difference;
use crate::fit::views::View;
use nacre_base::statistics::median;
use nacre_frames::LoadedFrames;

/// Largest difference modulo 180° of angles that count as equal, in degrees.
const SAME_ANGLE_DEG: f64 = 0.05;

/// Smallest relative difference of block means, in a typical block, that exceeds noise; it would take 24 % of noise per
/// pixel.
const DIFFERENT: f64 = 0.03;

/// Warning that names the two photographs with the largest difference.
pub(crate) fn contradiction(
    frames: &LoadedFrames,
    brackets: &[Vec<usize>],
    views: &[View],
    sample: &Sample,
) -> Option<String> {
    let kept = &views[..sample.views().min(views.len())];
    let same = |a: &View, b: &View| {
        a.pixels == b.pixels && angle_difference(a.stated, b.stated).abs().to_degrees() < SAME_ANGLE_DEG
    };
    let pairs = (0..kept.len()).flat_map(|k| (0..k).map(move |i| [i, k])).filter(|[i, k]| same(&kept[*i], &kept[*k]));
    let differences = pairs.filter_map(|[i, k]| Some(([i, k], difference(sample.view(i), sample.view(k))?)));
    let ([i, k], most) = differences.max_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, most)| *most > DIFFERENT)?;
    let name = |view: usize| {
        let first = brackets.get(kept[view].bracket)?.first()?;
        Some(frames.set.frames.get(*first)?.file.display().to_string())
    };
    Some(format!(
        "{} and {} are said to be at one analyser angle, but differ by {:.0} % beside their brightness: check their angles, or whether something moved",
        name(i)?,
        name(k)?,
        200.0 * most
    ))
}

/// Median over blocks of |a - b| / (a + b) of their means, after normalisation of the total brightness.
fn difference(first: &[f32], second: &[f32]) -> Option<f64> {
    let mean = |block: &[f32]| block.iter().map(|v| f64::from(*v)).sum::<f64>() / AREA as f64;
    let blocks = first.chunks(AREA).zip(second.chunks(AREA)).map(|(a, b)| [mean(a), mean(b)]);
    let lit: Vec<[f64; 2]> = blocks.filter(|[a, b]| *a > 0.0 && *b > 0.0 && (a + b).is_finite()).collect();
    let gain = median(lit.iter().map(|[a, b]| a / b).collect::<Vec<_>>())?;
    median(lit.iter().map(|[a, b]| ((a - gain * b) / (a + gain * b)).abs()).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::difference;

    #[test]
    fn brightness_and_noise_are_no_difference_but_another_angle_is() {
        let view = |angle: f64, gain: f64, noise: f64| -> Vec<f32> {
            let pixel = |i: usize| {
                let aolp = (i / 64) as f64 * 0.05;
                let light = 1.0 + 0.3 * (2.0 * (angle.to_radians() - aolp)).cos();
                (gain * light * (1.0 + noise * ((i * 7919 % 101) as f64 / 50.0 - 1.0))) as f32
            };
            (0..64 * 100).map(pixel).collect()
        };
        let first = view(30.0, 1.0, 0.0);
        assert!(difference(&first, &view(30.0, 1.2, 0.2)).unwrap() < 0.01);
        assert!(difference(&first, &view(75.0, 1.0, 0.0)).unwrap() > 0.1);
        assert_eq!(difference(&first, &vec![0.0; first.len()]), None);
    }
}

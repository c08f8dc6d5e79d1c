//! Edges between orientations: what the lens mixes there is neither the one nor the other, and σ from noise does not know.

use super::{OrientationMaps, angle_difference};
use rayon::prelude::*;

/// A second difference of up to so many standard deviations is noise; one pixel in thousands has a larger one by chance.
const JUMP: f32 = 4.0;

/// Share of a second difference, here or in a neighbour, that a mixed pixel may be wrong by: half-way up an edge it is half of it.
const MIXED: f32 = 0.5;

/// Widens σ where orientations jump. Where they turn evenly, second differences are nothing, and σ stays.
pub(super) fn widen_at_edges(map: &mut OrientationMaps) {
    let OrientationMaps { width, height, orientation, sigma } = map;
    let (width, height) = (*width, *height);
    if width < 3 || height < 3 {
        return;
    }
    let turned = |a: f32, b: f32| angle_difference(f64::from(a), f64::from(b)) as f32;
    // A masked neighbour tells nothing.
    let bend = |before: usize, i: usize, after: usize| {
        let here = orientation[i];
        let bend = (turned(orientation[after], here) + turned(orientation[before], here)).abs();
        if bend.is_finite() { bend } else { 0.0 }
    };
    sigma.par_chunks_mut(width).enumerate().for_each(|(y, sigma)| {
        for (x, sigma) in sigma.iter_mut().enumerate() {
            let i = y * width + x;
            if !orientation[i].is_finite() {
                continue;
            }
            let mut most = 0.0_f32;
            for k in x.saturating_sub(1).max(1)..=(x + 1).min(width - 2) {
                let at = y * width + k;
                most = most.max(bend(at - 1, at, at + 1));
            }
            for k in y.saturating_sub(1).max(1)..=(y + 1).min(height - 2) {
                let at = k * width + x;
                most = most.max(bend(at - width, at, at + width));
            }
            // The variance of a second difference is six times that of a pixel. What noise may have of it is taken off, so that
            // what is noise after all widens σ by next to nothing.
            let beyond = most * most - JUMP * JUMP * 6.0 * *sigma * *sigma;
            if beyond > 0.0 {
                *sigma = sigma.hypot(MIXED * beyond.sqrt()).min(std::f32::consts::FRAC_PI_2);
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(width: usize, height: usize, of: impl Fn(usize, usize) -> f32) -> OrientationMaps {
        let orientation = (0..width * height).map(|i| of(i % width, i / width)).collect();
        OrientationMaps { width, height, orientation, sigma: vec![0.002; width * height] }
    }

    /// A pixel half-way up an edge, and those beside it, hold what they may be wrong by; those farther away, and masked ones, stay.
    #[test]
    fn mixed_pixels_are_told() {
        let mut edge = map(9, 5, |x, _| [0.3, 0.3, 0.3, 0.3, 0.5, 0.7, 0.7, 0.7, f32::NAN][x]);
        widen_at_edges(&mut edge);
        let row = &edge.sigma[18..27];
        assert!(row[3..6].iter().all(|s| *s > 0.09), "{row:?}");
        assert!([0, 1, 7, 8].iter().all(|x| row[*x] == 0.002), "{row:?}");
    }

    /// Orientations that turn evenly, past 180° too, are no edges, nor is noise.
    #[test]
    fn even_turns_and_noise_are_no_edges() {
        let noise = |x: usize, y: usize| 0.002 * crate::polarimetry::synthetic::normal(5, (x + 1000 * y) as u64) as f32;
        let mut turning =
            map(200, 200, |x, y| (0.02 * x as f32 + 0.01 * y as f32 + noise(x, y)).rem_euclid(std::f32::consts::PI));
        widen_at_edges(&mut turning);
        let widened = turning.sigma.iter().filter(|s| **s > 0.002).count();
        // 40,000 pixels, six second differences each, of which 6e-5 are beyond 4 standard deviations: about 15.
        assert!(widened < 40, "{widened}");
    }
}

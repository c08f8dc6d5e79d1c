//! Tests with analyser-angle errors and drifting light, separately and together, in series of 4 to 24 photographs of
//! varied and uniform scenes. Neither is mistaken for the other, and no error is found where there is none.

use super::angle_error::{AngleErrorEstimate, estimate};
use crate::synthetic::{Spread, Synthetic, even_angles, normal};
use crate::{Design, Fit, StokesMaps};
use std::f64::consts::PI;

/// Number of pixels, a multiple of the 64 of a block.
const PIXELS: usize = 8192;

/// Root mean square of the angle errors in rad, and of the light changes.
struct Wrong {
    angles: f64,
    light: f64,
}

/// Random numbers with mean 0 and this root mean square.
fn deviates(rms: f64, count: usize, seed: u64) -> Vec<f64> {
    let all: Vec<f64> = (0..count).map(|k| normal(seed, k as u64)).collect();
    let mean = all.iter().sum::<f64>() / count as f64;
    let size = (all.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count as f64).sqrt();
    all.iter().map(|v| rms * (v - mean) / size).collect()
}

fn found(count: usize, spread: Spread, wrong: &Wrong, seed: u64) -> Option<AngleErrorEstimate> {
    let scene = Synthetic {
        angles: even_angles(count),
        angle_errors: deviates(wrong.angles, count, seed),
        spread,
        reflectance: 0.3,
        exposure: 0.7,
        ..Synthetic::default()
    };
    let mut series = scene.render(PIXELS, seed).unwrap();
    let light = deviates(wrong.light, count, seed + 100);
    series.frames.iter_mut().zip(&light).for_each(|(frame, by)| frame.iter_mut().for_each(|v| *v *= (1.0 + by) as f32));
    let views: Vec<&[f32]> = series.frames.iter().map(Vec::as_slice).collect();
    let fit = |angles: &[f64], design: &Design| -> StokesMaps {
        let mut fit = Fit::new(PIXELS, 1);
        for (psi, frame) in angles.iter().zip(&views) {
            fit.add(*psi, |_, values, _| values.copy_from_slice(frame));
        }
        fit.solve(design)
    };
    estimate(&views, &series.angles, None, fit)
}

const ONE_DEGREE: f64 = PI / 180.0;
const SPREADS: [Spread; 4] = [Spread::Even, Spread::Bands(3), Spread::Bands(2), Spread::Range(0.02)];

#[test]
fn nothing_is_found_where_nothing_is_wrong() {
    for (count, spread) in [4, 5, 6, 8, 12, 24].into_iter().flat_map(|n| SPREADS.map(|s| (n, s))) {
        if let Some(found) = found(count, spread, &Wrong { angles: 0.0, light: 0.0 }, 5) {
            assert!(!found.is_worth_correcting() && found.drift().is_none(), "{count} {spread:?}: {found:?}");
        }
    }
}

#[test]
fn wrong_angles_are_not_taken_for_drifting_light() {
    for (count, spread) in [4, 5, 6, 8, 12, 24].into_iter().flat_map(|n| SPREADS.map(|s| (n, s))) {
        let Some(found) = found(count, spread, &Wrong { angles: ONE_DEGREE, light: 0.0 }, 5) else { continue };
        let drift = found.drift();
        println!("{count} {spread:?}: {:?} {:?}", found.is_worth_correcting(), drift);
        assert!(drift.is_none(), "{count} {spread:?}: {found:?}");
        // Orientations over the full range determine the angles from eight photographs on.
        assert!(found.is_worth_correcting() || spread != Spread::Even || count < 8, "{count}: {found:?}");
    }
}

#[test]
fn drifting_light_is_not_taken_for_wrong_angles() {
    for (count, spread) in [4, 5, 6, 8, 12, 24].into_iter().flat_map(|n| SPREADS.map(|s| (n, s))) {
        let Some(found) = found(count, spread, &Wrong { angles: 0.0, light: 0.01 }, 5) else { continue };
        println!("{count} {spread:?}: {:?} {:?}", found.is_worth_correcting(), found.drift());
        assert!(!found.is_worth_correcting(), "{count} {spread:?}: {found:?}");
        if spread == Spread::Even && count >= 8 {
            let drift = found.drift().unwrap();
            assert!((drift / 0.01 - 1.0).abs() < 0.1, "{count}: {found:?}");
        }
    }
}

/// Angle errors proportional to sin 2(ψ - φ) and light proportional to cos 2(ψ - φ) cannot be distinguished: the errors
/// of both match their standard deviations.
#[test]
fn wrong_angles_and_drifting_light_are_known_as_well_as_claimed() {
    for count in [8, 12, 24] {
        let found = found(count, Spread::Even, &Wrong { angles: ONE_DEGREE, light: 0.01 }, 5).unwrap();
        assert!(found.is_worth_correcting(), "{count}: {found:?}");
        let off = |found: &[f64], wanted: Vec<f64>| {
            (found.iter().zip(&wanted).map(|(a, b)| (a - b).powi(2)).sum::<f64>() / count as f64).sqrt()
        };
        let angles = off(&found.errors, deviates(ONE_DEGREE, count, 5));
        let lights = off(&found.light_changes, deviates(0.01, count, 105));
        println!("{count}: {angles} ± {}, {lights} ± {}", found.sigma, found.light_sigma);
        assert!(angles < 2.0 * found.sigma && angles < 0.3 * ONE_DEGREE, "{count}: {found:?}");
        assert!(lights < 2.0 * found.light_sigma && lights < 0.005, "{count}: {found:?}");
    }
}

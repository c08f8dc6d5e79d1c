//! Errors that are no noise, against series in which they are known.

use super::errors::{Shifts, answers, of_registration};
use super::repeats_tests::{SIZE, Series};
use super::sample::{AREA, Sample};
use super::synthetic::normal;
use super::{AngleSource, Design, FrameNoise, angle_difference};
use crate::image::read_exr;
use std::f64::consts::PI;

/// The requirement's: terms are right to this factor.
const FACTOR: f64 = 1.5;

fn series(missed: Vec<f64>) -> Series {
    let angles = (0..12).map(|k| 15.0 * f64::from(k)).collect();
    Series { angles, missed, louder: 0.0, step: 1.0 / 60_000.0, ..Series::default() }
}

/// Root mean square error in degrees of the map in a folder after the best common offset.
fn error_of(folder: &std::path::Path) -> f64 {
    let map = read_exr(&folder.join("out/orientation.exr")).unwrap();
    let off = |(i, theta): (usize, &f32)| {
        let (_, aolp) = Series::scene((i % SIZE) as f64, (i / SIZE) as f64);
        angle_difference(f64::from(*theta), aolp).to_degrees()
    };
    let errors: Vec<f64> = map.channels["orientation"].iter().enumerate().map(off).filter(|e| e.is_finite()).collect();
    let n = errors.len() as f64;
    assert!(n > 0.99 * (SIZE * SIZE) as f64);
    let mean = errors.iter().sum::<f64>() / n;
    (errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / n).sqrt()
}

/// Angles that are off by 0.5° are found to be so, and what they cost is what they cost on average. A single series' cost is that of
/// two of the eleven numbers that tell the scatter, so that only the average over series is known to better than a factor of two.
#[test]
fn wrong_angles_are_found_and_carried_through() {
    const SEEDS: u64 = 12;
    let (mut actual, mut said) = (0.0, 0.0);
    for seed in 0..SEEDS {
        let folder = tempfile::tempdir().unwrap();
        let missed: Vec<f64> = (0..12).map(|k| 0.5 * normal(seed + 77, k)).collect();
        let mean = missed.iter().sum::<f64>() / 12.0;
        let scatter = (missed.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / 11.0).sqrt();
        let error = series(missed).reconstructed(folder.path(), None).error;
        assert_eq!(error.angle_source, Some(AngleSource::Residuals));
        // Without noise all but the common turn is known; what is neglected is of second order.
        let found = error.angle_sigma_deg.unwrap();
        assert!((found / scatter - 1.0).abs() < 0.1, "{found} {scatter}");
        actual += error_of(folder.path()).powi(2);
        said += error.angle_deg.unwrap().powi(2);
    }
    let ratio = (said / actual).sqrt();
    assert!((1.0 / FACTOR..FACTOR).contains(&ratio), "said {said} actual {actual}");
}

/// For even angles and orientations all around, σ/√(2N); and noise alone is not taken for wrong angles.
#[test]
fn the_cost_of_angles_is_the_closed_form() {
    let told = Series { angle_sigma_deg: Some(0.5), ..series(vec![]) };
    let error = told.reconstructed(tempfile::tempdir().unwrap().path(), None).error;
    assert_eq!((error.angle_sigma_deg, error.angle_source), (Some(0.5), Some(AngleSource::Given)));
    let ratio = error.angle_deg.unwrap() / (0.5 / 24f64.sqrt());
    assert!((ratio - 1.0).abs() < 0.1, "{ratio}");
    let noisy = Series { louder: 1.0, ..series(vec![]) };
    let error = noisy.reconstructed(tempfile::tempdir().unwrap().path(), None).error;
    // 25,000 pixels of 1.5 % noise and 40 % modulation tell an angle to 0.01°.
    assert!(
        error.angle_sigma_deg.unwrap() < 0.03 && error.angle_deg.unwrap() < 0.1 * error.noise_deg.unwrap(),
        "{error:?}"
    );
    let three = Series { angles: vec![0.0, 60.0, 120.0], ..series(vec![]) };
    let error = three.reconstructed(tempfile::tempdir().unwrap().path(), None).error;
    assert_eq!((error.angle_deg, error.angle_sigma_deg, error.angle_source), (None, None, None));
}

/// Light and the angle of its polarization, of texture a few pixels wide.
fn texture(x: f64, y: f64) -> (f64, f64) {
    (1.0 + 0.4 * (0.5 * x).sin() * (0.4 * y).cos(), 0.7 + 0.6 * (0.3 * x + 0.35 * y).sin())
}

/// Orientations of the texture with photographs that lie so against each other.
fn shifted(shifts: &[[f64; 2]], angles: &[f64]) -> Sample {
    const SIDE: usize = 96;
    let mut sample = Sample::new(SIDE, SIDE);
    for ([dx, dy], psi) in shifts.iter().zip(angles) {
        sample.add(|row, values, _| {
            for (column, value) in values.iter_mut().enumerate() {
                let (light, aolp) = texture(column as f64 - dx, row as f64 - dy);
                *value = (light * (1.0 + 0.5 * (2.0 * (psi - aolp)).cos())) as f32;
            }
        });
    }
    sample
}

/// Photographs that lie 0.2 px against each other cost what the term says, where shifts are known and where only their σ is.
#[test]
fn misregistration_is_carried_through() {
    let angles: Vec<f64> = (0..6).map(|k| PI * f64::from(k) / 6.0).collect();
    let design = Design::new(&angles).unwrap();
    let noise = [FrameNoise { shot: 0.0, floor: 1e-8 }; 6];
    let kept: Vec<(usize, f64)> = angles.iter().copied().enumerate().collect();
    const DRAWS: u64 = 24;
    let mut squares: Vec<f64> = vec![];
    for draw in 0..DRAWS {
        let shifts: Vec<[f64; 2]> = (0..6).map(|k| [0, 1].map(|a| 0.2 * normal(draw + 5, 2 * k + a))).collect();
        let sample = shifted(&shifts, &angles);
        let blocks: Vec<usize> = (0..sample.view(0).len() / AREA).collect();
        let maps = sample.solve(&blocks, &kept, &design);
        let off = |i: usize| {
            let (_, aolp) = texture((sample.pixel(i) % 96) as f64, (sample.pixel(i) / 96) as f64);
            angle_difference(0.5 * f64::from(maps.s2[i]).atan2(f64::from(maps.s1[i])), aolp).to_degrees()
        };
        let errors: Vec<f64> = (0..maps.s0.len()).map(off).collect();
        squares.resize(errors.len(), 0.0);
        squares.iter_mut().zip(&errors).for_each(|(s, e)| *s += e * e / DRAWS as f64);
        let answers = answers(&maps, &design, &noise, None);
        let said = of_registration(&answers, &maps, &design, &Shifts { known: shifts, sigma: 0.0 }).unwrap();
        let actual = super::repeats::median(&mut errors.iter().map(|e| e.abs()).collect::<Vec<_>>()).unwrap();
        assert!((1.0 / FACTOR..FACTOR).contains(&(said / actual)), "{said} {actual}");
    }
    let still = shifted(&[[0.0; 2]; 6], &angles);
    let blocks: Vec<usize> = (0..still.view(0).len() / AREA).collect();
    let maps = still.solve(&blocks, &kept, &design);
    let answers = answers(&maps, &design, &noise, None);
    let said = of_registration(&answers, &maps, &design, &Shifts { known: vec![], sigma: 0.2 }).unwrap();
    let actual = super::repeats::median(&mut squares.iter().map(|s| s.sqrt()).collect::<Vec<_>>()).unwrap();
    assert!((1.0 / FACTOR..FACTOR).contains(&(said / actual)), "{said} {actual}");
}

//! Tests of systematic errors, against series with known errors.

use crate::angles::angle_error::{angle_errors as found, angle_sigma};
use crate::angles::sample::{AREA, Sample};
use crate::reconstruct;
use crate::report::errors::{Shifts, answers, of_angles, of_registration};
use crate::synthetic::normal;
use crate::tests::repeats::Series;
use crate::{AngleSource, AppliedCorrections, Design, Fit, FrameNoise, Model, Options, angle_difference, probe};
use nacre_base::progress::Silent;
use nacre_frames::load;
use nacre_image::read_exr;
use std::f64::consts::PI;

/// Required accuracy of the terms, as a factor.
const FACTOR: f64 = 1.5;

fn series(missed: Vec<f64>) -> Series {
    let angles = (0..12).map(|k| 15.0 * f64::from(k)).collect();
    Series { angles, missed, louder: 0.0, step: 1.0 / 60_000.0, ..Series::default() }
}

/// Random angle errors of 0.5°, in degrees, and their scatter about their mean.
fn angle_errors(views: u64, seed: u64) -> (Vec<f64>, f64) {
    let missed: Vec<f64> = (0..views).map(|k| 0.5 * normal(seed, k)).collect();
    let mean = missed.iter().sum::<f64>() / views as f64;
    let square: f64 = missed.iter().map(|m| (m - mean).powi(2)).sum();
    (missed, (square / (views - 1) as f64).sqrt())
}

/// Angle errors of 0.5° are detected, and their predicted effect matches the actual one on average. The effect in a
/// single series depends on two of the eleven numbers that determine the scatter. Only the average over series is
/// therefore known to better than a factor of two.
#[test]
fn wrong_angles_are_found_and_carried_through() {
    const SEEDS: u64 = 24;
    const SIDE: usize = 96;
    let angles: Vec<f64> = (0..12).map(|k| PI * f64::from(k) / 12.0).collect();
    let kept: Vec<(usize, f64)> = angles.iter().copied().enumerate().collect();
    let design = Design::new(&angles).unwrap();
    let noise = [FrameNoise { shot: 0.0, floor: 1e-10 }; 12];
    // All orientations, several times.
    let aolp = |x: usize, y: usize| 0.11 * x as f64 + 0.07 * y as f64;
    let (mut actual, mut predicted) = (0.0, 0.0);
    for seed in 0..SEEDS {
        let (missed, scatter) = angle_errors(12, seed + 77);
        let mut sample = Sample::new(SIDE, SIDE);
        for (psi, missed) in angles.iter().zip(&missed) {
            let phase = |x, y| 2.0 * (psi + missed.to_radians() - aolp(x, y));
            sample.add(|y, row, _| {
                row.iter_mut().enumerate().for_each(|(x, v)| *v = (1.0 + 0.4 * phase(x, y).cos()) as f32)
            });
        }
        let blocks: Vec<usize> = (0..sample.view(0).len() / AREA).collect();
        let maps = sample.solve(&blocks, &kept, &design);
        // Without noise all errors but the common rotation are determined; neglected terms are of second order, 1 %.
        let sigma = angle_sigma(&sample.all(), &design, &maps).unwrap();
        assert!((sigma.to_degrees() / scatter - 1.0).abs() < 0.02, "{} {scatter}", sigma.to_degrees());
        predicted += (sigma * of_angles(&answers(&maps, &design, &noise, None), &design).unwrap()).to_degrees().powi(2);
        let off = |i: usize| {
            let at = sample.pixel(i);
            let found = 0.5 * f64::from(maps.s2[i]).atan2(f64::from(maps.s1[i]));
            angle_difference(found, aolp(at % SIDE, at / SIDE)).to_degrees()
        };
        let errors: Vec<f64> = (0..maps.s0.len()).map(off).collect();
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        actual += errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / errors.len() as f64;
    }
    let ratio = (predicted / actual).sqrt();
    assert!((1.0 / FACTOR..FACTOR).contains(&ratio), "said {predicted} actual {actual}");
}

/// The same from files, with more photographs than are registered: every angle error is determined except for a common
/// rotation, and corrected. With rounded codes, and noise in the second series, the errors match their remaining
/// standard deviation. A stated accuracy of 0 is accepted without a correction.
#[test]
fn wrong_angles_are_found_in_photographs_and_put_right() {
    let (missed, _) = angle_errors(30, 3);
    let mean = missed.iter().sum::<f64>() / 30.0;
    let angles: Vec<f64> = (0..30).map(|k| 6.0 * f64::from(k)).collect();
    let series =
        |louder, angle_sigma_deg| Series { angles: angles.clone(), louder, angle_sigma_deg, ..series(missed.clone()) };
    // 25,000 pixels with 1.5 % noise and 40 % modulation determine an angle to 0.01°; half of all orientations are in
    // view. The 29 numbers determine their standard deviation to an eighth.
    for (louder, most) in [(0.0, 0.002), (1.0, 0.03)] {
        let report = series(louder, None).reconstructed(tempfile::tempdir().unwrap().path(), None);
        assert_eq!((report.error.angle_source, report.error.registration_deg), (Some(AngleSource::Corrected), None));
        let (errors, left) = (report.analyser_errors_deg.unwrap(), report.error.angle_sigma_deg.unwrap());
        let square = errors.iter().zip(&missed).map(|(e, m)| (e - (m - mean)).powi(2)).sum::<f64>();
        let off = (square / 30.0).sqrt();
        println!("off by {off:.4}°, {left:.4}° said to be left");
        assert!(left < most && (0.5..2.0).contains(&(off / left)), "{off} {left}");
    }
    let believed = series(0.0, Some(0.0)).reconstructed(tempfile::tempdir().unwrap().path(), None);
    assert_eq!((believed.analyser_errors_deg, believed.error.angle_source), (None, Some(AngleSource::Given)));
}

/// A probed pixel has the fit of the maps also after registration and angle correction; corrections of other
/// photographs are detected.
#[test]
fn a_probe_shows_photographs_as_they_were_put_right() {
    let folder = tempfile::tempdir().unwrap();
    let series = Series { shift: |k| (k % 3) as f64, louder: 1.0, ..series(angle_errors(12, 3).0) };
    series.reconstructed(folder.path(), None);
    let results = folder.path().join("moved");
    let options = Options { model: Some(Model::Sinusoid), ..Options::default() };
    let report = reconstruct(folder.path(), &results, &options, &Silent).unwrap();
    assert!(report.registration.unwrap().corrected && report.analyser_errors_deg.is_some());
    let (mut set, right) = (load(folder.path()).unwrap(), AppliedCorrections::read(&results).unwrap());
    let maps = read_exr(&results.join("stokes.exr")).unwrap();
    for (x, y) in [(41, 3), (97, 60), (21, 119)] {
        let probe = probe(&set, [x, y], &right).unwrap();
        for (name, found) in [("S0", probe.s0), ("S1", probe.s1), ("S2", probe.s2)] {
            let of_map = f64::from(maps.channels[name][y * maps.width + x]);
            // Maps are in single precision, as are the sums over a dozen photographs.
            assert!((found - of_map).abs() < 1e-5 * probe.s0, "{name} at {x}, {y}: {found} {of_map}");
        }
    }
    set.set.frames.pop();
    assert!(probe(&set, [41, 3], &right).unwrap_err().to_string().contains("reconstruct again"));
}

/// Views of all orientations, or of few, with analyser-angle errors `missed` (degrees) and light that drifts by these
/// factors.
fn views(angles: &[f64], missed: &[f64], light: impl Fn(usize) -> f64, spread: f64) -> Vec<Vec<f32>> {
    let view = |(k, (psi, missed)): (usize, (&f64, &f64))| {
        let phase = |i: usize| 2.0 * (psi + missed.to_radians() - spread * 0.618_034 * i as f64);
        (0..64 * AREA).map(|i| (light(k) * (1.0 + 0.4 * phase(i).cos())) as f32).collect()
    };
    angles.iter().zip(missed).enumerate().map(view).collect()
}

/// Angle errors are found to single precision in steady light, also errors of 5°, and to the predicted standard
/// deviation in drifting light. With one orientation in view, or four angles, light and angles cannot be distinguished,
/// and no correction is applied.
#[test]
fn angles_are_found_beside_light_that_drifts() {
    let of = |n: usize, factor: f64, drift: f64, spread: f64| {
        let angles: Vec<f64> = (0..n).map(|k| PI * k as f64 / n as f64).collect();
        let missed: Vec<f64> = angle_errors(n as u64, 5).0.iter().map(|m| factor * m).collect();
        let views = views(&angles, &missed, |k| 1.0 + drift * (1.3 * k as f64).sin(), spread);
        let views: Vec<&[f32]> = views.iter().map(Vec::as_slice).collect();
        let fit = |angles: &[f64], design: &Design| {
            let mut fit = Fit::new(views[0].len(), 1);
            for (psi, view) in angles.iter().zip(&views) {
                fit.add(*psi, |_, values, _| values.copy_from_slice(view));
            }
            fit.solve(design)
        };
        let mean = missed.iter().sum::<f64>() / n as f64;
        let found = found(&views, &angles, None, fit)?;
        let off = found.errors.iter().zip(&missed).map(|(e, m)| (e.to_degrees() - (m - mean)).powi(2));
        Some(((off.sum::<f64>() / n as f64).sqrt(), found.sigma.to_degrees()))
    };
    for (n, factor, drift) in [(12, 1.0, 0.0), (12, 10.0, 0.0), (12, 1.0, 0.02), (12, 10.0, 0.02), (6, 1.0, 0.02)] {
        let (off, left) = of(n, factor, drift, 1.0).unwrap();
        println!("{n} angles, {factor} times as wrong, light {drift}: {off:.5}° off, {left:.5}° left");
        // Single precision limits angles to 0.0001°; a drift has two random numbers. Either the remaining standard
        // deviation is at most half of 0.5°, or no correction is applied.
        let most = if drift == 0.0 { 0.001 } else { 2.5 * left };
        assert!(off < most && left < 0.25, "{n} {factor} {drift}: {off} {left}");
    }
    assert!(of(12, 1.0, 0.0, 0.0).is_none() && of(4, 1.0, 0.0, 1.0).is_none() && of(12, 0.0, 0.02, 1.0).is_none());
}

/// For equidistant angles and orientations over the full range, σ/√(2N); noise alone is not mistaken for angle errors.
#[test]
fn the_cost_of_angles_is_the_closed_form() {
    let stated = Series { angle_sigma_deg: Some(0.5), ..series(vec![]) };
    let error = stated.reconstructed(tempfile::tempdir().unwrap().path(), None).error;
    assert_eq!((error.angle_sigma_deg, error.angle_source), (Some(0.5), Some(AngleSource::Given)));
    let ratio = error.angle_deg.unwrap() / (0.5 / 24f64.sqrt());
    assert!((ratio - 1.0).abs() < 0.1, "{ratio}");
    let noisy = Series { louder: 1.0, ..series(vec![]) };
    let error = noisy.reconstructed(tempfile::tempdir().unwrap().path(), None).error;
    // 25,000 pixels with 1.5 % noise and 40 % modulation determine an angle to 0.01°.
    assert!(
        error.angle_sigma_deg.unwrap() < 0.03 && error.angle_deg.unwrap() < 0.1 * error.noise_deg.unwrap(),
        "{error:?}"
    );
    let three = Series { angles: vec![0.0, 60.0, 120.0], ..series(vec![]) };
    let error = three.reconstructed(tempfile::tempdir().unwrap().path(), None).error;
    assert_eq!((error.angle_deg, error.angle_sigma_deg, error.angle_source), (None, None, None));
}

/// Intensity and polarization angle of a texture with details of a few pixels.
fn texture(x: f64, y: f64) -> (f64, f64) {
    (1.0 + 0.4 * (0.5 * x).sin() * (0.4 * y).cos(), 0.7 + 0.6 * (0.3 * x + 0.35 * y).sin())
}

/// Orientations of the texture for photographs with these relative shifts.
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

/// The predicted error for relative shifts of 0.2 px matches the actual one, for known shifts and for a known σ of
/// them.
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
        let predicted = of_registration(&answers, &maps, &design, &Shifts { known: shifts, sigma: 0.0 }).unwrap();
        let actual = nacre_base::statistics::median(&mut errors.iter().map(|e| e.abs()).collect::<Vec<_>>()).unwrap();
        assert!((1.0 / FACTOR..FACTOR).contains(&(predicted / actual)), "{predicted} {actual}");
    }
    let still = shifted(&[[0.0; 2]; 6], &angles);
    let blocks: Vec<usize> = (0..still.view(0).len() / AREA).collect();
    let maps = still.solve(&blocks, &kept, &design);
    let answers = answers(&maps, &design, &noise, None);
    let predicted = of_registration(&answers, &maps, &design, &Shifts { known: vec![], sigma: 0.2 }).unwrap();
    let actual = nacre_base::statistics::median(&mut squares.iter().map(|s| s.sqrt()).collect::<Vec<_>>()).unwrap();
    assert!((1.0 / FACTOR..FACTOR).contains(&(predicted / actual)), "{predicted} {actual}");
}

//! Tests with photographs from outside a capture session: plain polarimetry at the stated angles.

use crate::reconstruct;
use crate::synthetic::normal;
use crate::tests::bracket::write_set;
use crate::tests::repeats::Series;
use crate::{Model, Oblique, Options, Report, Smoothing};
use nacre_base::progress::Silent;
use nacre_frames::{Calibration, FlatCalibration, Frame, FrameSet, Kind, NoiseModel};
use nacre_image::{Samples, encode_png16_gray, read, read_exr, write_exr};
use nalgebra::{Matrix3, Vector3};
use std::path::Path;

/// Code values of black and white of [`Series`].
const BLACK: f64 = 4000.0;
const WHITE: f64 = 64_000.0;

/// Largest difference of `stokes.exr` from least squares in f64, relative to S0.
fn off_least_squares(folder: &Path, angles: &[f64]) -> f64 {
    let maps = read_exr(&folder.join("out/stokes.exr")).unwrap();
    let photographs: Vec<Vec<f64>> = (0..angles.len())
        .map(|k| match read(&folder.join(format!("{k:02}.png"))).unwrap().samples {
            Samples::U16(codes) => codes.into_iter().map(|c| (f64::from(c) - BLACK) / (WHITE - BLACK)).collect(),
            _ => panic!("another depth"),
        })
        .collect();
    let turned = |deg: &f64| 2.0 * deg.to_radians();
    let rows: Vec<Vector3<f64>> =
        angles.iter().map(|a| 0.5 * Vector3::new(1.0, turned(a).cos(), turned(a).sin())).collect();
    let inverse = rows.iter().map(|x| x * x.transpose()).sum::<Matrix3<f64>>().try_inverse().unwrap();
    let off = |i: usize| {
        let moments: Vector3<f64> = rows.iter().zip(&photographs).map(|(x, p)| x * p[i]).sum();
        let wanted = inverse * moments;
        let found = ["S0", "S1", "S2"].map(|c| f64::from(maps.channels[c][i]));
        (wanted - Vector3::from(found)).amax() / wanted[0]
    };
    (0..maps.width * maps.height).map(off).fold(0.0, f64::max)
}

/// Analyser-angle errors of 0.5° or 8° (standard deviation) cause a warning with the size of the error. Stokes
/// parameters are those of least squares at the stated angles. If `angle_sigma_deg` states that angles may be wrong,
/// they are corrected.
#[test]
fn stated_angles_are_kept_and_doubt_is_a_warning() {
    let angles: Vec<f64> = (0..30).map(|k| 6.0 * f64::from(k)).collect();
    for (scale, largest) in [(0.0, None), (0.5, Some("errors of 0.")), (8.0, Some("errors of "))] {
        let missed: Vec<f64> = (0..30).map(|k| scale * normal(3, k)).collect();
        let foreign = |angle_sigma_deg| Series {
            angles: angles.clone(),
            missed: missed.clone(),
            angle_sigma_deg,
            foreign: true,
            ..Series::default()
        };
        let folder = tempfile::tempdir().unwrap();
        foreign(None).photograph(folder.path(), None);
        let report = reconstruct(folder.path(), &folder.path().join("out"), &Options::default(), &Silent).unwrap();
        assert_eq!((report.model.as_str(), &report.analyser_errors_deg), ("plain", &None));
        let warned: Vec<&String> = report.warnings.iter().filter(|w| w.contains("angle_sigma_deg")).collect();
        assert_eq!(warned.len(), usize::from(largest.is_some()), "{:?}", report.warnings);
        largest.iter().for_each(|words| assert!(warned[0].contains(words) && warned[0].contains(".png"), "{warned:?}"));
        let off = off_least_squares(folder.path(), &angles);
        assert!(off < 1e-6, "{off}");
        if scale == 0.5 {
            let report = foreign(Some(0.5)).reconstructed(tempfile::tempdir().unwrap().path(), None);
            assert!(report.analyser_errors_deg.is_some());
        }
    }
}

/// Writes noisy photographs of a uniform polarization angle with a degree of 60 to 65 %, and reconstructs them.
fn uniform(folder: &Path, options: &Options) -> Report {
    const SIZE: usize = 96;
    let frames = (0..8_u64).map(|k| {
        let deg = 45.0 * k as f64;
        let turned = (2.0 * (deg - 20.0_f64).to_radians()).cos();
        let level = |i: usize| 0.4 * (1.0 + (0.6 + 0.05 * (i % SIZE) as f64 / SIZE as f64) * turned);
        let codes: Vec<u16> =
            (0..SIZE * SIZE).map(|i| ((level(i) + 0.004 * normal(k, i as u64)) * 65_535.0) as u16).collect();
        let file = format!("{k:02}.png");
        std::fs::write(folder.join(&file), encode_png16_gray(SIZE, SIZE, &codes).unwrap()).unwrap();
        Frame { analyser_deg: Some(deg), ..Frame::new(file) }
    });
    write_set(folder, &FrameSet::new(Kind::Polarization, frames.collect()));
    reconstruct(folder, &folder.join("out"), options, &Silent).unwrap()
}

/// A uniform scene is neither masked nor mistaken for a film: its polarization angle is that of the light, also under
/// grating models.
#[test]
fn a_uniform_scene_of_strong_modulation_is_measured() {
    for (model, file, channel) in [(None, "aolp.exr", "aolp"), (Some(Model::Auto), "orientation.exr", "orientation")] {
        let folder = tempfile::tempdir().unwrap();
        let report = uniform(folder.path(), &Options { model, ..Options::default() });
        assert_eq!(report.pixels.valid, report.pixels.all, "{model:?}: {:?}", report.pixels);
        assert_eq!(report.model, if model.is_none() { "plain" } else { "sinusoid" });
        let map = read_exr(&folder.path().join("out").join(file)).unwrap();
        let mean = map.channels[channel].iter().map(|v| f64::from(*v)).sum::<f64>() / report.pixels.all as f64;
        // 9216 pixels of 0.3° noise determine the mean to 0.003°; codes are truncated, not rounded.
        assert!((mean.to_degrees() - 20.0).abs() < 0.05, "{model:?}: {}", mean.to_degrees());
    }
}

/// Plain polarimetry writes its own files and no orientations, and σ is that of the noise.
#[test]
fn plain_results_hold_light_alone() {
    let folder = tempfile::tempdir().unwrap();
    let report = uniform(folder.path(), &Options::default());
    let out = folder.path().join("out");
    for file in ["stokes.exr", "aolp.exr", "aolp.png", "dolp.png", "sigma.png", "report.json"] {
        assert!(out.join(file).is_file(), "no {file}");
    }
    for file in ["orientation.exr", "orientation.png", "smoothed.exr"] {
        assert!(!out.join(file).exists(), "{file}");
    }
    let map = read_exr(&out.join("aolp.exr")).unwrap();
    let (aolp, sigma) = (&map.channels["aolp"], &map.channels["sigma"]);
    let wanted = 20_f64.to_radians();
    let square = |v: &f32| (f64::from(*v) - wanted).powi(2);
    let scatter = (aolp.iter().map(square).sum::<f64>() / aolp.len() as f64).sqrt();
    let predicted = f64::from(sigma.iter().sum::<f32>()) / sigma.len() as f64;
    // 9216 pixels determine scatter and noise to 0.7 % each.
    assert!((predicted / scatter - 1.0).abs() < 0.03, "{predicted} {scatter}");
    assert!(map.channels["mask"].iter().all(|m| *m == 1.0));
    let (degrees, sigmas) = (&map.channels["dolp"], &map.channels["sigma_dolp"]);
    let wanted = |i: usize| 0.6 + 0.05 * (i % map.width) as f32 / map.width as f32;
    let squares = degrees.iter().enumerate().map(|(i, v)| (v - wanted(i)).powi(2));
    let scatter = (squares.sum::<f32>() / degrees.len() as f32).sqrt();
    let predicted = sigmas.iter().sum::<f32>() / sigmas.len() as f32;
    assert!((predicted / scatter - 1.0).abs() < 0.03, "{predicted} {scatter}");
    let noise = report.error.noise_deg.unwrap();
    assert!(report.error_estimate_deg.unwrap() >= noise && report.error.model_deg == Some(0.0));
}

/// Options for gratings are refused instead of ignored.
#[test]
fn options_of_gratings_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    uniform(folder.path(), &Options::default());
    let none = Options::default;
    for (options, named) in [
        (Options { offset_deg: Some(3.0), ..none() }, "--offset-deg"),
        (Options { oblique: Oblique::Auto, ..none() }, "--oblique"),
        (Options { smooth_maps: true, ..none() }, "--smooth-maps"),
        (Options { smoothed_exr: true, model: Some(Model::Plain), ..none() }, "--smoothed-exr"),
    ] {
        let refused = reconstruct(folder.path(), &folder.path().join("bad"), &options, &Silent).unwrap_err();
        assert!(refused.to_string().contains(named), "{refused}");
        assert!(!folder.path().join("bad").exists());
    }
    let auto = Options { offset_deg: Some(3.0), model: Some(Model::Auto), smooth: Smoothing::NONE, ..none() };
    reconstruct(folder.path(), &folder.path().join("good"), &auto, &Silent).unwrap();
}

/// Noise of photographs and flat field is that of S0; the degree of polarization does not depend on the flat field.
#[test]
fn sigma_of_intensities_is_their_scatter() {
    let (side, angles) = (96, [0.0, 45.0, 90.0, 135.0_f64]);
    let camera = NoiseModel { full_scale_e: 20_000.0, read_noise_e: 5.0 };
    for (flat_sigma, corner) in [(None, 1.0), (Some(0.0), 0.4), (Some(0.01), 0.4)] {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        // Light falls off to the right.
        let shading = |i: usize| 1.0 + (corner - 1.0) * (i % side) as f64 / (side - 1) as f64;
        for (k, angle) in angles.iter().enumerate() {
            let code = |i: usize| {
                let light = 0.4 * shading(i) * (1.0 + 0.3 * (2.0 * (angle - 20.0).to_radians()).cos());
                let electrons = light * camera.full_scale_e;
                let seen = electrons + (electrons + 25.0).sqrt() * normal(k as u64, i as u64);
                (BLACK + seen / camera.full_scale_e * (WHITE - BLACK)).round() as u16
            };
            let codes: Vec<u16> = (0..side * side).map(code).collect();
            std::fs::write(path(&format!("{k}.png")), encode_png16_gray(side, side, &codes).unwrap()).unwrap();
        }
        let frame = |(k, angle): (usize, &f64)| Frame { analyser_deg: Some(*angle), ..Frame::new(format!("{k}.png")) };
        let mut set = FrameSet {
            black: Some(BLACK),
            white: Some(WHITE),
            noise: Some(camera),
            ..FrameSet::new(Kind::Polarization, angles.iter().enumerate().map(frame).collect())
        };
        if let Some(sigma) = flat_sigma {
            let field = |_: usize, y: usize, row: &mut [f32]| {
                for (x, out) in row.iter_mut().enumerate() {
                    let i = y * side + x;
                    *out = (shading(i) * (1.0 + sigma * normal(9, i as u64))) as f32;
                }
            };
            write_exr(&path("flat.exr"), side, side, &["Y"], &[], &field).unwrap();
            let flat = FlatCalibration { source: None, file: "flat.exr".into(), sigma };
            set.calibration = Some(Calibration { flat: Some(flat), ..Calibration::default() });
            set.flat = Some("flat.exr".into());
        }
        write_set(folder.path(), &set);
        reconstruct(folder.path(), &path("out"), &Options::default(), &Silent).unwrap();
        let (stokes, aolp) = (read_exr(&path("out/stokes.exr")).unwrap(), read_exr(&path("out/aolp.exr")).unwrap());
        for (name, values, sigmas) in [
            ("S0", &stokes.channels["S0"], &stokes.channels["sigma_S0"]),
            ("DoLP", &aolp.channels["dolp"], &aolp.channels["sigma_dolp"]),
        ] {
            // Columns of much and of little light.
            for columns in [0..24, 72..96] {
                let of = |i: &usize| columns.contains(&(i % side));
                let all: Vec<usize> = (0..side * side).filter(of).collect();
                let mean = |of: &dyn Fn(usize) -> f64| all.iter().map(|i| of(*i)).sum::<f64>() / all.len() as f64;
                let center = mean(&|i| values[i].into());
                let scatter = mean(&|i| (f64::from(values[i]) - center).powi(2));
                let stated = mean(&|i| f64::from(sigmas[i]).powi(2));
                // 2,304 pixels tell a variance to 3 %.
                assert!((stated / scatter - 1.0).abs() < 0.1, "{flat_sigma:?} {name} {columns:?}: {stated} {scatter}");
            }
        }
    }
}

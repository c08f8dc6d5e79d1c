//! Studies of calibrations of the bench: gain in accuracy, and number of angles.

use super::capture::{Shot, shoot};
use super::session::{absolute, ideal};
use super::{bench, with_reference, written};
use nacre_base::operation::perform;
use nacre_base::progress::Silent;
use nacre_base::{Error, Result};
use nacre_calibrate::analyser;
use nacre_frames::{AnalyserCalibration, Calibration, CameraCalibration, NoiseModel, RetarderCalibration};
use nacre_optics::polarization::angle_difference;
use nacre_sim::BenchConfig;
use nacre_sim::surface::SampleKind;
use nacre_studies::{Axis, Effort, Outcome, Scene, Setting, Study};
use std::time::Instant;

/// Errors of the panel's film in degrees: retardance, and half as much in azimuth.
const FILM_DEG: [f64; 6] = [0.0, 2.0, 4.0, 8.0, 12.0, 20.0];

/// Error of a wrong calibration in degrees: a film of another panel.
const WRONG_DEG: f64 = 6.0;

/// Numbers of angles over the turn.
const ANGLES: [usize; 5] = [6, 8, 12, 24, 48];

/// Standard deviations of the stage's angles in degrees.
const SCATTER_DEG: [f64; 6] = [0.001, 0.005, 0.02, 0.05, 0.2, 1.0];

pub(crate) fn studies(effort: Effort) -> Vec<Study> {
    vec![gain(effort), angles()]
}

/// Random bench with a linear camera and an analyser without wedge.
fn plain(seed: u64) -> BenchConfig {
    let mut bench = bench(seed);
    (bench.camera.response_loss, bench.analyser.wedge_px) = (0.0, 0.0);
    bench
}

/// Exact calibration of such a bench.
fn exact(bench: &BenchConfig) -> Calibration {
    let (stage, panel, camera) = (&bench.stage, &bench.panel, &bench.camera);
    let (sin, cos) = stage.eccentricity_at_deg.to_radians().sin_cos();
    Calibration {
        camera: Some(CameraCalibration {
            source: None,
            noise: NoiseModel { full_scale_e: camera.well_e, read_noise_e: camera.read_noise_e },
            black: camera.black_level.into(),
            white: f64::from((1u32 << camera.bits) - 1),
            gain: 1.0,
            response: None,
        }),
        analyser: Some(AnalyserCalibration {
            source: None,
            zero_deg: stage.zero_deg,
            zero_sigma_deg: 0.003,
            sense: if stage.clockwise { -1 } else { 1 },
            eccentricity_deg: [-stage.eccentricity_deg * sin, stage.eccentricity_deg * cos],
            extinction_ratio: Some(stage.extinction_ratio),
        }),
        retarder: Some(RetarderCalibration {
            source: None,
            panel_deg: panel.polarization_deg,
            azimuth_deg: panel.retarder_deg,
            azimuth_sigma_deg: 0.005,
            retardance_deg: panel.retardance_deg,
            retardance_sigma_deg: 0.005,
        }),
        ..Calibration::default()
    }
}

/// Absolute orientations with, without and with a wrong calibration of the film.
fn gain(effort: Effort) -> Study {
    let films: Vec<f64> = FILM_DEG.iter().copied().step_by(effort.pick(1, 2)).collect();
    let values = films.clone();
    Study {
        name: "calibration-gain",
        group: "calibration",
        title: "Absolute orientations and the calibration of the panel's film".into(),
        question: format!(
            "A kinematic tile on a bench with a random analyser (zero, sense, eccentricity, extinction) and camera, whose panel film is off by this \
             much in retardance and by half of it in azimuth. The offset of orientations is calibrated on another tile. With calibration, the \
             measured film enters the model of the grating's light; without, the film counts as an ideal quarter-wave plate at 45°; the wrong \
             calibration is that of a film {WRONG_DEG}° away. The error is the median over the pixels, offset included. Wrong and confident: the \
             median exceeds five times the stated error of absolute orientations."
        ),
        knob: Axis::names("calibration"),
        stress: Axis::linear("error of the film", "°"),
        error: Axis::log("median error of absolute orientations", "°"),
        time: Axis::log("time of both sessions and reconstructions", "s"),
        predicted: "the stated error of absolute orientations",
        settings: vec![
            Setting::new("calibrated", "calibrated", 0.0).as_default(),
            Setting::new("none", "none", 1.0),
            Setting::new("wrong", "wrong", 2.0),
        ],
        scenes: films.iter().map(|deg| Scene::new(*deg)).collect(),
        reference: films.len() / 2,
        run: Box::new(move |setting, scene, seed| {
            let mut bench = plain(seed);
            let usual = ideal(&bench).panel;
            bench.panel = usual;
            bench.panel.retardance_deg += values[scene];
            bench.panel.retarder_deg += 0.5 * values[scene];
            let mut calibration = exact(&bench);
            match (setting, &mut calibration.retarder) {
                (2, Some(film)) => film.retardance_deg += WRONG_DEG,
                (1, film) => *film = None,
                _ => {}
            }
            let folder = tempfile::tempdir().map_err(|e| Error::output(&std::env::temp_dir(), e))?;
            let begun = Instant::now();
            let found = absolute(&bench, &calibration, folder.path())?;
            let expected = Some(found.expected_deg).filter(|deg| deg.is_finite());
            let wrong = expected.is_some_and(|deg| found.median_deg > 5.0 * deg);
            Ok(Outcome {
                error: Some(found.median_deg),
                seconds: begun.elapsed().as_secs_f64(),
                masked: 0.0,
                wrong: f64::from(u8::from(wrong)),
                predicted: expected,
            })
        }),
    }
}

/// Zero of the analyser against the number of angles and the scatter of the stage.
fn angles() -> Study {
    let setting = |n: &usize| {
        let setting = Setting::new("angles", n.to_string(), *n as f64);
        if *n == 24 { setting.as_default() } else { setting }
    };
    Study {
        name: "calibration-angles",
        group: "calibration",
        title: "Zero of the analyser, number of angles and scatter of the stage".into(),
        question: "A reference polarizer, turned over for a second series, on benches with random analysers; the angles are evenly spaced \
                   over the turn, and the stage's angles scatter by this standard deviation. The error is that of the zero. Fewer than ten \
                   angles leave out the eccentricity of the scale, here up to 0.3°, which then is an error of the zero. Wrong and confident: \
                   more than five of its σ off."
            .into(),
        knob: Axis::log("angles of each series", ""),
        stress: Axis::log("standard deviation of the stage's angles", "°"),
        error: Axis::log("error of the zero", "°"),
        time: Axis::log("time of the calibration", "s"),
        predicted: "σ of the zero",
        settings: ANGLES.iter().map(setting).collect(),
        scenes: SCATTER_DEG.iter().map(|deg| Scene::new(*deg)).collect(),
        reference: 1,
        run: Box::new(|setting, scene, seed| zero(ANGLES[setting], SCATTER_DEG[scene], seed)),
    }
}

fn zero(count: usize, scatter_deg: f64, seed: u64) -> Result<Outcome> {
    let mut bench = plain(seed);
    bench.stage.repeatability_deg = scatter_deg;
    (bench.camera.width, bench.camera.height) = (64, 64);
    let folder = tempfile::tempdir().map_err(|e| Error::output(&std::env::temp_dir(), e))?;
    for (name, axis) in [("front", 20.0), ("back", -20.0)] {
        let reference = with_reference(&bench, SampleKind::Polarizer, axis, if name == "back" { 3 } else { 2 });
        shoot(&reference, &Shot::Turn { count, crossed: false }, &Calibration::default(), &folder.path().join(name))?;
    }
    let options = analyser::Options {
        axis_deg: Some(20.0),
        flipped: Some(folder.path().join("back")),
        ..analyser::Options::default()
    };
    let out = folder.path().join("analyser");
    let begun = Instant::now();
    perform(&options, &folder.path().join("front"), &out, false, &Silent)?;
    let seconds = begun.elapsed().as_secs_f64();
    let Some(found) = written(&out)?.analyser else {
        return Ok(Outcome { error: None, seconds, masked: 1.0, wrong: 0.0, predicted: None });
    };
    let off = angle_difference(found.zero_deg.to_radians(), bench.stage.zero_deg.to_radians()).abs().to_degrees();
    let wrong = f64::from(u8::from(off > 5.0 * found.zero_sigma_deg));
    Ok(Outcome { error: Some(off), seconds, masked: 0.0, wrong, predicted: Some(found.zero_sigma_deg) })
}

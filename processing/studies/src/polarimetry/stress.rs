//! One study per source of error: every model against each.
//!
//! Two samples are used. Effects that the models describe (film, ratio, front reflection, few orientations) act on a
//! grating behind a film. Effects on the photographs (noise, angles, saturation) act on a bare grating, to isolate them
//! from the film.

use super::scene::{
    Method, PROMISED, judge, methods, nominal_angles, orientation_error, pixels, ratio, run, sinusoid, time_of_map,
};
use crate::{Axis, Effort, Outcome, Scene, Setting, Study};
use nacre_base::Result;
use nacre_polarimetry::NoiseModel;
use nacre_polarimetry::synthetic::{Photographs, Spread, Synthetic, even_angles, normal};
use num_complex::Complex;
use std::time::Instant;

/// A stress: name, values, and the sample at a value.
struct Stress {
    name: &'static str,
    title: &'static str,
    sample: &'static str,
    axis: Axis,
    values: Vec<f64>,
    /// Index of the value used for time against error.
    reference: usize,
    /// Builds the scene at a value; the seed is for random parameters of a run.
    scene: fn(f64, u64) -> Synthetic,
}

const BEHIND_FILM: &str = "a grating of r 1.2, ζ 150° behind a film of 5° with its axis at 20°";
const BARE: &str = "a grating of r 1.1, ζ 45° without a film";

/// The grating behind a film.
fn behind_film() -> Synthetic {
    Synthetic {
        ratio: ratio(1.2, 150.0),
        retardance: 5f64.to_radians(),
        axis: 20f64.to_radians(),
        reflectance: 0.2,
        ..Synthetic::default()
    }
}

/// The grating without a film.
fn bare() -> Synthetic {
    Synthetic { reflectance: 0.2, ..Synthetic::default() }
}

/// All stress studies. Misregistration and oblique incidence are excluded, since they need photographs with spatial
/// extent.
pub(super) fn studies(effort: Effort) -> Vec<Study> {
    let mut all: Vec<Study> = sample().into_iter().map(|s| study(s, methods(), effort)).collect();
    // The other models would add no information to these studies.
    let few: Vec<Method> = methods().into_iter().filter(|m| m.default || m.name == "sinusoid").collect();
    let of_angles = |name| ["stress-angle-random", "stress-backlash", "stress-angle-scale"].contains(&name);
    all.extend(photographs().into_iter().map(|s| {
        let with_nominal_angles = of_angles(s.name).then(nominal_angles);
        study(s, with_nominal_angles.into_iter().chain(few.clone()).collect(), effort)
    }));
    all.push(saturation(effort));
    all
}

/// Stresses of the sample.
fn sample() -> Vec<Stress> {
    vec![
        Stress {
            name: "stress-film",
            title: "Film retardance",
            sample: BEHIND_FILM,
            axis: Axis::linear("film retardance Δn", "°"),
            values: vec![0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 75.0, 90.0],
            reference: 5,
            scene: |v, _| Synthetic { retardance: v.to_radians(), ..behind_film() },
        },
        Stress {
            name: "stress-zeta",
            title: "Phase ζ between the polarizations",
            sample: "a grating of r 1.2 behind a film of 3° with its axis at 20°",
            axis: Axis::linear("phase ζ", "°"),
            values: vec![0.0, 5.0, 15.0, 30.0, 60.0, 90.0, 120.0, 150.0, 164.0, 172.0, 176.0, 178.0, 180.0],
            reference: 8,
            scene: |v, _| Synthetic { ratio: ratio(1.2, v), retardance: 3f64.to_radians(), ..behind_film() },
        },
        Stress {
            name: "stress-ratio",
            title: "Ratio r of the polarizations",
            sample: "a grating of ζ 150° behind a film of 5° with its axis at 20°",
            axis: Axis::log("ratio r", ""),
            values: vec![1e-4, 1e-3, 1e-2, 0.1, 0.3, 0.5, 0.8, 0.95, 1.05, 1.2, 2.0, 3.0, 10.0, 100.0, 1e3, 1e4],
            reference: 9,
            scene: |v, _| Synthetic { ratio: ratio(v, 150.0), ..behind_film() },
        },
        Stress {
            name: "stress-axis",
            title: "Azimuth of the film's axis",
            sample: "a grating of r 1.2, ζ 150° behind a film of 10°",
            axis: Axis::linear("film axis", "°"),
            values: (0..=12).map(|k| 15.0 * f64::from(k)).collect(),
            reference: 1,
            scene: |v, _| Synthetic { axis: v.to_radians(), retardance: 10f64.to_radians(), ..behind_film() },
        },
        Stress {
            name: "stress-front",
            title: "Reflection at the film's front",
            sample: BEHIND_FILM,
            axis: Axis::linear("front reflection |r_p| (phase 0°)", ""),
            values: vec![0.0, 0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5],
            reference: 3,
            scene: |v, _| Synthetic { front: Complex::from(v), ..behind_film() },
        },
        Stress {
            name: "stress-front-phase",
            title: "Phase of the front reflection",
            sample: BEHIND_FILM,
            axis: Axis::linear("phase of r_p at |r_p| = 0.2", "°"),
            values: (0..=12).map(|k| 30.0 * f64::from(k)).collect(),
            reference: 3,
            scene: |v, _| Synthetic { front: Complex::from_polar(0.2, v.to_radians()), ..behind_film() },
        },
        Stress {
            name: "stress-range",
            title: "Unevenness of the orientations in view",
            sample: BEHIND_FILM,
            axis: Axis::linear("orientations in view span", "°"),
            values: vec![5.0, 10.0, 20.0, 30.0, 45.0, 60.0, 90.0, 120.0, 150.0, 180.0],
            reference: 5,
            scene: |v, _| Synthetic { spread: Spread::Range(v.to_radians()), ..behind_film() },
        },
    ]
}

/// Stresses of the camera and the analyser.
fn photographs() -> Vec<Stress> {
    vec![
        Stress {
            name: "stress-noise",
            title: "Noise",
            sample: BARE,
            axis: Axis::log("electrons at white", "e⁻"),
            values: vec![30.0, 100.0, 300.0, 1000.0, 3000.0, 10_000.0, 40_000.0, 160_000.0, 1e6],
            reference: 6,
            scene: |v, _| Synthetic { noise: Some(NoiseModel { full_scale_e: v, read_noise_e: 8.0 }), ..bare() },
        },
        Stress {
            name: "stress-angle-random",
            title: "Random errors of the analyser's angles",
            sample: BARE,
            axis: Axis::linear("angle error, standard deviation", "°"),
            values: vec![0.0, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 3.0, 5.0],
            reference: 4,
            scene: |v, seed| {
                let error = |k| v.to_radians() * normal(seed ^ 0xa9, k);
                Synthetic { angle_errors: (0..12).map(error).collect(), ..bare() }
            },
        },
        Stress {
            name: "stress-backlash",
            title: "Backlash of the analyser",
            sample: "a grating of r 1.1, ζ 45° without a film; every second angle is approached from the other side",
            axis: Axis::linear("backlash", "°"),
            values: vec![0.0, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 3.0, 5.0],
            reference: 3,
            scene: |v, _| {
                let error = |k| v.to_radians() * if k % 2 == 0 { 0.5 } else { -0.5 };
                Synthetic { angle_errors: (0..12).map(error).collect(), ..bare() }
            },
        },
        Stress {
            name: "stress-angle-scale",
            title: "Wrong scale of the analyser's angles",
            sample: "a grating of r 1.1, ζ 45° without a film; the stage turns a little more than it says",
            axis: Axis::linear("error of a half turn", "°"),
            values: vec![0.0, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0],
            reference: 4,
            scene: |v, _| {
                let angle_errors = even_angles(12).iter().map(|a| a * v / 180.0).collect();
                Synthetic { angle_errors, ..bare() }
            },
        },
        Stress {
            name: "stress-frames",
            title: "Number of angles",
            sample: BEHIND_FILM,
            axis: Axis::linear("analyser angles", ""),
            values: vec![3.0, 4.0, 5.0, 6.0, 8.0, 12.0, 16.0, 20.0, 24.0],
            reference: 5,
            scene: |v, _| Synthetic { angles: even_angles(v as usize), ..behind_film() },
        },
    ]
}

fn study(mut stress: Stress, models: Vec<Method>, effort: Effort) -> Study {
    if effort == Effort::Quick {
        thin(&mut stress);
    }
    let (values, scene) = (stress.values.clone(), stress.scene);
    let question = format!(
        "Sample: {}; all orientations alike, reflectance varying by ± 20 %, twelve angles, 40,000 electrons, except for what is \
         stressed. The dashed line is the error that the map's own σ promises: an error far above it is one that nobody is told of.",
        stress.sample
    );
    Study {
        name: stress.name,
        group: "stress",
        title: stress.title.into(),
        question,
        knob: Axis::names("model"),
        stress: stress.axis,
        error: orientation_error(),
        time: time_of_map(pixels(effort)),
        predicted: PROMISED,
        settings: models.iter().map(setting).collect(),
        scenes: stress.values.into_iter().map(Scene::new).collect(),
        reference: stress.reference,
        run: Box::new(move |setting, at, seed| run(&scene(values[at], seed), &models[setting], pixels(effort), seed)),
    }
}

/// Keeps every third value, or every second of few; the reference moves to the nearest lower one.
fn thin(stress: &mut Stress) {
    let step = match stress.values.len() {
        ..9 => 1,
        9..13 => 2,
        _ => 3,
    };
    stress.values = stress.values.iter().copied().step_by(step).collect();
    stress.reference = (stress.reference / step).min(stress.values.len() - 1);
}

fn setting(model: &Method) -> Setting {
    let setting = Setting::new(model.name, model.name, 0.0);
    if model.default { setting.as_default() } else { setting }
}

const EXPOSURES: [f64; 10] = [0.7, 0.8, 0.9, 1.0, 1.05, 1.1, 1.2, 1.4, 1.7, 2.0];

/// Study of overexposure, with saturated pixels masked as in the program, and without a mask.
fn saturation(effort: Effort) -> Study {
    let method = sinusoid();
    Study {
        name: "stress-saturation",
        group: "stress",
        title: "Saturation".into(),
        question: format!(
            "Sample: {BARE}, reflectance varying by ± 40 %, twelve angles, 40,000 electrons. The exposure puts the brightest \
             point at so many times white; what is brighter becomes white. A pixel that is white in any photograph is masked, as \
             the program does, or used as if nothing had happened."
        ),
        knob: Axis::names("treatment"),
        stress: Axis::linear("brightest point / white", ""),
        error: orientation_error(),
        time: time_of_map(pixels(effort)),
        predicted: PROMISED,
        settings: vec![
            Setting::new("saturated pixels masked", "masked", 0.0).as_default(),
            Setting::new("saturation ignored", "ignored", 1.0),
        ],
        scenes: EXPOSURES.map(Scene::new).to_vec(),
        reference: 6,
        run: Box::new(move |setting, at, seed| {
            let scene = Synthetic { exposure: EXPOSURES[at], reflectance: 0.4, ..Synthetic::default() };
            let photographs = scene.render(pixels(effort), seed)?;
            let white = if setting == 0 { photographs.white } else { None };
            solve(&Photographs { white, ..photographs }, &method)
        }),
    }
}

fn solve(photographs: &Photographs, method: &Method) -> Result<Outcome> {
    let begun = Instant::now();
    let mut maps = super::scene::fitted(photographs);
    let map = (method.solve)(&mut maps, photographs)?;
    Ok(judge(&map.orientation, &map.sigma, &photographs.truth, begun.elapsed().as_secs_f64()))
}

//! Studies of polarization sensors: super-pixels against interpolated images.

use crate::{Axis, Effort, Outcome, Scene, Setting, Study};
use nacre_base::Result;
use nacre_polarimetry::synthetic::normal;
use nacre_polarimetry::{
    Demosaic, Design, Fit, FrameNoise, angle_difference, demosaiced, orient, widen_between_polarizers,
};
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::time::Instant;

const METHODS: [(Demosaic, &str); 3] = [
    (Demosaic::None, "2×2 super-pixels"),
    (Demosaic::Bilinear, "bilinear"),
    (Demosaic::EdgeAware, "edge-aware (Li et al. 2019)"),
];

/// Spatial frequencies in cycles per sensor pixel. Each polarizer covers every second pixel, so its Nyquist frequency
/// is 0.25.
const FREQUENCIES: [f64; 9] = [0.005, 0.01, 0.02, 0.04, 0.07, 0.12, 0.18, 0.25, 0.35];
const REFERENCE: usize = 3;

/// Degree of polarization of the scenes.
const DEGREE: f64 = 0.3;

/// A camera with 10,000 electrons at white and 3 electrons of read noise.
const CAMERA: FrameNoise = FrameNoise { shot: 1e-4, floor: 9e-8 };

/// Analyser angles of a 2 × 2 block in degrees, row by row.
const LAYOUT: [f64; 4] = [90.0, 45.0, 135.0, 0.0];

/// Variation of the light over a scene.
#[derive(Clone, Copy)]
enum Kind {
    Waves,
    Edges,
}

/// Methods against the spatial frequency of the scene, for waves and for edges.
pub(super) fn studies(effort: Effort) -> Vec<Study> {
    [
        (Kind::Waves, "demosaic", "smooth scenes", "waves of the intensity"),
        (
            Kind::Edges,
            "demosaic-edges",
            "scenes with edges",
            "stripes with sharp edges, one of 0.85 and one of 0.15 of the light,",
        ),
    ]
    .map(|(kind, name, title, light)| study(kind, name, title, light, effort))
    .into()
}

fn study(kind: Kind, name: &'static str, title: &str, light: &str, effort: Effort) -> Study {
    let setting = |(k, (method, label)): (usize, &(Demosaic, &str))| {
        let setting = Setting::new(label, *label, k as f64);
        if *method == Demosaic::None { setting.as_default() } else { setting }
    };
    Study {
        name,
        group: "polarimetry",
        title: format!("Maps of a polarization sensor: {title}"),
        question: format!(
            "Each pixel of a sensor has one of four polarizers. Maps have one pixel per block of 2 × 2, or images behind each polarizer are \
             interpolated. What does that gain, and cost? One frame of {light} at 20° to the rows, whose angle of polarization varies at a \
             quarter of their frequency; degree of polarization 0.3, 10,000 electrons at white. Errors are taken at every pixel of the \
             sensor, so that a map of super-pixels counts four times as it is."
        ),
        knob: Axis::names("interpolation"),
        stress: Axis::log("spatial frequency", "cycles per pixel"),
        error: Axis::log("mean error of the angle of polarization", "°"),
        time: Axis::log("time per megapixel of the sensor", "s"),
        predicted: "the map's own σ",
        settings: METHODS.iter().enumerate().map(setting).collect(),
        scenes: FREQUENCIES.map(Scene::new).to_vec(),
        reference: REFERENCE,
        run: {
            let side = effort.pick(512, 128);
            Box::new(move |setting, scene, seed| run(kind, METHODS[setting].0, FREQUENCIES[scene], side, seed))
        },
    }
}

/// Intensity and angle of polarization (rad) at a point of the sensor, in pixels.
fn light(kind: Kind, frequency: f64, seed: u64, [x, y]: [f64; 2]) -> [f64; 2] {
    let phase = |n: u64| TAU * normal(seed, n);
    let (sin, cos) = 20f64.to_radians().sin_cos();
    let [along, across] = [x * cos + y * sin, y * cos - x * sin].map(|d| TAU * frequency * d);
    let wave = (along + phase(0)).sin();
    let wave = if matches!(kind, Kind::Edges) { wave.signum() } else { wave };
    [0.5 + 0.35 * wave, 0.6 * (0.25 * across + phase(1)).sin()]
}

fn run(kind: Kind, method: Demosaic, frequency: f64, side: usize, seed: u64) -> Result<Outcome> {
    let at = |i: usize| [(i % side) as f64, (i / side) as f64];
    let point = |i: usize, [dx, dy]: [f64; 2]| light(kind, frequency, seed, [at(i)[0] + dx, at(i)[1] + dy]);
    let pixel = |i: usize| {
        let psi = LAYOUT[i % side % 2 + 2 * (i / side % 2)].to_radians();
        // A pixel integrates light over its area.
        let places = (0..16).map(|k| [(k % 4) as f64, (k / 4) as f64].map(|v| (v - 1.5) / 4.0));
        let behind = |[light, turn]: [f64; 2]| 0.5 * light * (1.0 + DEGREE * (2.0 * (psi - turn)).cos());
        let seen = places.map(|place| behind(point(i, place))).sum::<f64>() / 16.0;
        let sigma = (CAMERA.shot * seen + CAMERA.floor).sqrt();
        (seen + sigma * normal(seed ^ 0x5eed, i as u64)) as f32
    };
    let mosaic: Vec<f32> = (0..side * side).into_par_iter().map(pixel).collect();

    let begun = Instant::now();
    let images = demosaiced(&mosaic, [side, side], method);
    let step = if method == Demosaic::None { 2 } else { 1 };
    let angles = LAYOUT.map(f64::to_radians);
    let (design, width) = (Design::new(&angles)?, side / step);
    let mut fit = Fit::new(width, width);
    fit.add_several(&angles, |k, y, row, _| row.copy_from_slice(&images[k][y * width..][..width]));
    let mut maps = fit.solve(&design);
    let noise = vec![CAMERA.scaled(method.noise_factor()); 4];
    let mut found = orient(&mut maps, &design, &noise, 0.0);
    widen_between_polarizers(&mut found, &maps, &design, method);
    let seconds = begun.elapsed().as_secs_f64() / (side * side) as f64 * 1e6;

    let (mut sum, mut predicted, mut answered, mut wrong) = (0.0, 0.0, 0, 0);
    for i in 0..side * side {
        let k = i / side / step * width + i % side / step;
        let (angle, sigma) = (f64::from(found.orientation[k]), f64::from(found.sigma[k]));
        if angle.is_finite() {
            let error = angle_difference(angle, point(i, [0.0; 2])[1]).abs();
            // Mean |error| of a normal distribution.
            predicted += sigma * (2.0 / std::f64::consts::PI).sqrt();
            sum += error;
            answered += 1;
            wrong += usize::from(error > 5.0 * sigma);
        }
    }
    let (all, n) = ((side * side) as f64, f64::from(answered.max(1)));
    Ok(Outcome {
        error: (answered > 0).then(|| (sum / n).to_degrees()),
        seconds,
        masked: 1.0 - f64::from(answered) / all,
        wrong: wrong as f64 / all,
        predicted: Some((predicted / n).to_degrees()),
    })
}

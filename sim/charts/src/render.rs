//! Studies of rendered scenes: number of wavelengths, distance at which a light counts as far, and precomputed sums.

use super::environment::Last;
use nacre_base::progress::Silent;
use nacre_base::{Error, Result};
use nacre_image::{Attribute, write_exr};
use nacre_render::{Method, Picture, Scene, Settings, render};
use nacre_sim::random::{key, uniform};
use nacre_studies::{Axis, Effort, Outcome, Scene as Stress, Setting, Study};
use std::f64::consts::PI;
use tempfile::TempDir;

/// Ratio of the smallest target error to that of the reference picture.
const TRUTH: f64 = 3.0;

/// Side length of the pictures in pixels, and their target error.
fn size(effort: Effort) -> (usize, f64) {
    effort.pick((64, 0.02), (24, 0.1))
}

/// Numbers of wavelengths, the same for all lobes.
const WAVELENGTHS: [usize; 8] = [8, 16, 32, 64, 128, 256, 512, 1024];

/// Rendered scenes: name, shape, light and diffracting material.
const SCENES: [[&str; 4]; 6] = [
    ["foil, large light", PLANE, "type = \"point\"\nposition = [60, 100, 280]\nsigma_mm = 5", "coherence_um = 20"],
    ["foil", PLANE, "type = \"point\"\nposition = [60, 100, 280]\nsigma_mm = 2", "coherence_um = 40"],
    ["foil, small light", PLANE, "type = \"point\"\nposition = [60, 100, 280]\nsigma_mm = 0.5", "coherence_um = 65"],
    ["sphere", SPHERE, "type = \"point\"\nposition = [60, 100, 280]\nsigma_mm = 20", "coherence_um = 10"],
    [
        "sphere, spectral lines",
        SPHERE,
        "type = \"point\"\nposition = [60, 100, 280]\nsigma_mm = 20\nspectrum = \"FL11\"",
        "coherence_um = 10",
    ],
    ["foil under a sky", PLANE, "type = \"environment\"\nfile = \"sky.exr\"", "coherence_um = 20"],
];
const PLANE: &str = "type = \"plane\"\nsize = [110, 110]";
const SPHERE: &str = "type = \"sphere\"\ncenter = [0, 0, 0]\nradius = 50";

/// Distances of the light in mm.
const DISTANCES: [f64; 7] = [100.0, 200.0, 400.0, 1000.0, 3000.0, 10_000.0, 30_000.0];

pub(super) fn studies(effort: Effort) -> Vec<Study> {
    vec![wavelengths(effort), distance(effort), summed(effort)]
}

pub(super) fn broken(what: &str, why: impl std::fmt::Display) -> Error {
    Error::input(what, why, "report this")
}

/// A scene with its files, and its reference picture.
struct Sample {
    folder: TempDir,
    truth: Picture,
}

impl Sample {
    /// Prepares a scene, with an environment that contains a lamp of about 10°.
    fn new(scene: &Scene, asked: f64) -> Result<Self> {
        let folder = tempfile::tempdir().map_err(|e| broken("temporary folder", e))?;
        write_exr(&folder.path().join("sky.exr"), 256, 128, &["R", "G", "B"], &[], &|c, y, row| {
            for (x, out) in row.iter_mut().enumerate() {
                let (polar, azimuth) = (PI * (y as f64 + 0.5) / 128.0, 2.0 * PI * (0.5 - (x as f64 + 0.5) / 256.0));
                let lamp = (-0.5 * ((polar - 1.1).powi(2) + (azimuth - 0.9).powi(2)) / 0.03).exp();
                *out = (0.2 + 0.1 * c as f64 * polar.cos().max(0.0) + 8.0 * lamp) as f32;
            }
        })?;
        let size = 128;
        let light = [("extent", "1"), ("warp", "1"), ("illuminant", "E")].map(|(k, v)| (k, Attribute::Text(v.into())));
        write_exr(&folder.path().join("lut.exr"), size, size, &["X", "Y", "Z"], &light, &|c, y, row| {
            for (x, out) in row.iter_mut().enumerate() {
                let [u, v] = [x, y].map(|k| 2.0 * (k as f64 + 0.5) / size as f64 - 1.0);
                let spot = |at: [f64; 2]| (-0.5 * ((u - at[0]).powi(2) + (v - at[1]).powi(2)) / 0.0016).exp();
                let side = [0.56, 0.5, 0.42][c];
                *out = (spot([0.0, 0.0]) + 0.3 * (spot([side, 0.1]) + spot([-side, -0.1]))) as f32;
            }
        })?;
        let mut sample = Self { folder, truth: Picture::default() };
        let exact = Settings { max_error: asked / TRUTH, method: Method::Samples, ..Settings::default() };
        sample.truth = sample.picture(scene, exact)?.0;
        Ok(sample)
    }

    /// A picture, its computing times in s, and the error in its report.
    fn picture(&self, scene: &Scene, settings: Settings) -> Result<(Picture, [f64; 2], f64)> {
        let settings = Settings { samples: 1 << 16, ..settings };
        let (picture, report) = render(scene, self.folder.path(), &settings, &Silent)?;
        let error = report.noise.hypot(report.predicted_model_error);
        Ok((picture, [report.seconds_of_passes, report.seconds], error))
    }
}

/// A scene; the seed rotates the grating by up to 10°.
fn scene(side: usize, shape: &str, light: &str, coherence: &str, seed: u64) -> Result<Scene> {
    let orientation = 60.0 + 10.0 * uniform(key(&[seed, 7]));
    let text = format!(
        "[camera]\nposition = [0, 0, 500]\ntarget = [0, 0, 0]\nfov_deg = 12\nwidth = {side}\nheight = {side}\n[[shape]]\n{shape}\n\
         material = \"m\"\n[[light]]\n{light}\n[material.m.diffraction]\ntype = \"grating\"\nperiod_um = 1.5\n\
         orientation_deg = {orientation:?}\nrelief = {{ depth_um = 0.15 }}\n{coherence}\n"
    );
    toml::from_str(&text).map_err(|e| broken("scene", e))
}

/// Root mean square of the luminance differences, relative to the mean luminance.
fn off(found: &Picture, truth: &Picture) -> f64 {
    let square: f64 = found.pixels.iter().zip(&truth.pixels).map(|(a, b)| (a.luminance - b.luminance).powi(2)).sum();
    let (count, sum) = (truth.pixels.len() as f64, truth.pixels.iter().map(|p| p.luminance).sum::<f64>());
    (square / count).sqrt() / (sum / count).max(f64::MIN_POSITIVE)
}

pub(super) fn outcome(found: &Picture, truth: &Picture, seconds: f64) -> Outcome {
    Outcome { error: Some(off(found, truth)), seconds, masked: 0.0, wrong: 0.0, predicted: None }
}

fn wavelengths(effort: Effort) -> Study {
    let (side, asked) = size(effort);
    let auto = Setting::new("as many as each place needs", "default", 0.0).as_default();
    let fixed = WAVELENGTHS.map(|n| {
        let setting = Setting::new("so many everywhere", n.to_string(), n as f64);
        if [16, 64, 256].contains(&n) { setting } else { setting.without_sweep() }
    });
    let last = Last::new();
    Study {
        name: "render-wavelengths",
        group: "render",
        title: "Wavelengths of a picture".into(),
        question: format!(
            "Pictures of {side} × {side} pixels whose noise is to be {} %, of a sinusoid of 1.5 µm. By default, sums over wavelengths take a quarter of \
             that error at most; or there are so many wavelengths between 380 and 780 nm, evenly spaced in 1/λ. The error is the root mean \
             square of differences from a picture that is {TRUTH} times as exact, over its mean.",
            100.0 * asked
        ),
        knob: Axis::log("wavelengths", ""),
        stress: Axis::names("scene"),
        error: Axis::log("error of the picture", ""),
        time: Axis::log("time of the passes", "s"),
        predicted: "noise and sums, as the report has them",
        settings: [auto].into_iter().chain(fixed).collect(),
        scenes: SCENES.iter().enumerate().map(|(k, s)| Stress::named(k, s[0])).collect(),
        reference: 1,
        run: Box::new(move |setting, at, seed| {
            let [_, shape, light, coherence] = SCENES[at];
            let of = scene(side, shape, light, coherence, seed)?;
            let sample = last.get(at, seed, || Sample::new(&of, asked))?;
            let wavelengths = setting.checked_sub(1).map(|k| WAVELENGTHS[k]);
            let asked = Settings { max_error: asked, wavelengths, ..Settings::default() };
            let (found, [seconds, _], predicted) = sample.picture(&of, asked)?;
            Ok(Outcome { predicted: Some(predicted), ..outcome(&found, &sample.truth, seconds) })
        }),
    }
}

fn distance(effort: Effort) -> Study {
    let (side, asked) = size(effort);
    let distances: Vec<f64> = effort.pick(DISTANCES.to_vec(), DISTANCES.iter().copied().step_by(2).collect());
    let last = Last::new();
    let settings = ["where it is", "far away"].into_iter().enumerate();
    Study {
        name: "render-distance",
        group: "render",
        title: "A light that is near".into(),
        question: format!(
            "A foil of 110 mm (a sinusoid of 1.5 µm) under a light of 3° (σ 1.5°) whose distance varies, in pictures of {side} × {side} pixels. The light \
             is where it is; or it shines on all of the foil from one direction, as bright as in its middle. The error is the root mean square of differences from the first, four times as exact, over its mean."
        ),
        knob: Axis::names("the light"),
        stress: Axis::log("distance", "mm"),
        error: Axis::log("error of the picture", ""),
        time: Axis::log("time of the passes", "s"),
        predicted: "",
        settings: settings
            .map(|(k, name)| {
                let setting = Setting::new(name, name, k as f64);
                if k == 0 { setting.as_default() } else { setting }
            })
            .collect(),
        scenes: distances.iter().map(|d| Stress::new(*d)).collect(),
        reference: distances.len() / 2,
        run: Box::new(move |setting, at, seed| {
            let along = [0.194_f64, 0.324, 0.926];
            let sigma = 1.5_f64.to_radians() * distances[at];
            let near =
                format!("type = \"point\"\nposition = {:?}\nsigma_mm = {sigma:?}", along.map(|v| v * distances[at]));
            let far = format!("type = \"directional\"\ndirection = {along:?}\nsigma_deg = 1.5");
            let of = |light: &str| scene(side, PLANE, light, "coherence_um = 20", seed);
            let sample = last.get(at, seed, || Sample::new(&of(&near)?, asked))?;
            let asked = Settings { max_error: asked, ..Settings::default() };
            let (found, [seconds, _], _) = sample.picture(&of(if setting == 0 { &near } else { &far })?, asked)?;
            Ok(outcome(&found, &sample.truth, seconds))
        }),
    }
}

/// Target errors of pictures rendered from lookup tables.
const ASKED: [f64; 5] = [0.3, 0.1, 0.03, 0.01, 0.003];

/// A lookup table on a foil of increasing tilt, in a room.
fn summed(effort: Effort) -> Study {
    let side = effort.pick(128, 16);
    let asked: Vec<f64> = effort.pick(ASKED.to_vec(), ASKED[1..4].to_vec());
    let leaning = [0.0, 30.0, 55.0, 75.0];
    let settings = asked.iter().flat_map(|e| {
        let of = |name: &str| Setting::new(name, format!("{} %", 100.0 * e), *e);
        let (auto, chance) = (of("as it chooses"), of("by chance"));
        [if *e == 0.01 { auto.as_default() } else { auto }, chance]
    });
    let last = Last::new();
    Study {
        name: "render-flat",
        group: "render",
        title: "A flat sample in a room".into(),
        question: format!(
            "Pictures of {side} × {side} pixels of a table with three spots on a foil under a sky with a lamp of 10°, asked for several errors. Light is drawn by \
             chance for each pixel; or the program chooses whether what the foil reflects is summed up once for all directions. The error is the root mean \
             square of differences from a picture by chance that is {TRUTH} times as exact as the finest, over its mean; times are of everything."
        ),
        knob: Axis::log("error asked for", ""),
        stress: Axis::linear("leaning back", "°"),
        error: Axis::log("error of the picture", ""),
        time: Axis::log("time", "s"),
        predicted: "noise and sums, as the report has them",
        settings: settings.collect(),
        scenes: leaning.iter().map(|d| Stress::new(*d)).collect(),
        reference: 1,
        run: Box::new(move |setting, at, seed| {
            let (sin, cos) = f64::to_radians(leaning[at] + 5.0 * uniform(key(&[seed, 8]))).sin_cos();
            let text = format!(
                "[camera]\nposition = [0, 0, 500]\ntarget = [0, 0, 0]\nfov_deg = 12\nwidth = {side}\nheight = {side}\n[[shape]]\n{PLANE}\n\
                 normal = [0, {sin:?}, {cos:?}]\nup = [0, {cos:?}, {:?}]\nmaterial = \"m\"\n[[light]]\ntype = \"environment\"\nfile = \"sky.exr\"\n\
                 [material.m.diffraction]\ntype = \"table\"\nfile = \"lut.exr\"\n",
                -sin
            );
            let of = toml::from_str(&text).map_err(|e| broken("scene", e))?;
            let finest = asked.iter().copied().fold(1.0, f64::min);
            let sample = last.get(at, seed, || Sample::new(&of, finest))?;
            let wanted = Settings {
                max_error: asked[setting / 2],
                method: [Method::Auto, Method::Samples][setting % 2],
                ..Settings::default()
            };
            let (found, [_, seconds], predicted) = sample.picture(&of, wanted)?;
            Ok(Outcome { predicted: Some(predicted), ..outcome(&found, &sample.truth, seconds) })
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Too few wavelengths give wrong pictures, the default does not; a near light differs from a far one.
    #[test]
    fn studies_measure_their_quantity() {
        let [wavelengths, distance, flat]: [Study; 3] = studies(Effort::Quick).try_into().ok().unwrap();
        let error = |study: &Study, setting, scene| (study.run)(setting, scene, 3).unwrap().error.unwrap();
        let [auto, few] = [0, 1].map(|k| error(&wavelengths, k, 1));
        assert!(auto < 2.0 * size(Effort::Quick).1 && few > 5.0 * auto, "{auto} {few}");
        let last = distance.scenes.len() - 1;
        let [near, far] = [error(&distance, 1, 0), error(&distance, 1, last)];
        assert!(far < 0.1 && near > 0.5, "{near} {far}");
        let [summed, drawn] = [4, 5].map(|k| error(&flat, k, 1));
        assert!(summed < 0.02 && drawn < 0.02, "{summed} {drawn}");
    }
}

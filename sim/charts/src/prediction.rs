//! Study of the noise that a renderer predicts before its first pass, against the noise of the finished picture.

use nacre_base::Error;
use nacre_base::Result;
use nacre_base::progress::Silent;
use nacre_render::{Settings, render};
use nacre_sim::random::{key, uniform};
use nacre_studies::{Axis, Effort, Outcome, Scene, Setting, Study};

const SAMPLES: [usize; 5] = [16, 64, 256, 1024, 4096];
const SIGMA_MM: [f64; 6] = [30.0, 10.0, 5.0, 2.0, 1.0, 0.5];

/// A prediction counts as confidently wrong beyond this factor.
const FACTOR: f64 = 2.0;

pub(super) fn study(effort: Effort) -> Study {
    let side = effort.pick(48, 20);
    let samples: Vec<usize> = SAMPLES[..effort.pick(5, 3)].to_vec();
    let sigma: Vec<f64> = SIGMA_MM.iter().copied().step_by(effort.pick(1, 3)).collect();
    let settings = samples.iter().map(|n| {
        let setting = Setting::new("as predicted", format!("{n} samples"), *n as f64);
        match n {
            256 => setting.as_default(),
            16 | 4096 => setting,
            _ => setting.without_sweep(),
        }
    });
    let reference = sigma.len() / 2;
    Study {
        name: "render-prediction",
        group: "render",
        title: "Prediction of a picture's noise".into(),
        question: format!(
            "Before its first pass a rendering says what noise it will have after all of them, from a look at some pixels. A sphere of a sinusoid of 1.5 µm under a lamp, {side} × {side} pixels; the \
             smaller the lamp, the fewer pixels shine. The error is by how much the noise in the report differs from the prediction. Wrong and confident: off by more than {FACTOR} \
             times. Up to 256 samples by default, fewer where the error that is asked for is reached; here all are taken."
        ),
        knob: Axis::log("samples", ""),
        stress: Axis::log("size of the lamp (σ)", "mm"),
        error: Axis::log("relative error of the prediction", ""),
        time: Axis::log("time of the picture", "s"),
        predicted: "",
        settings: settings.collect(),
        scenes: sigma.iter().map(|s| Scene::new(*s)).collect(),
        reference,
        run: Box::new(move |setting, scene, seed| run(side, samples[setting], sigma[scene], seed)),
    }
}

fn run(side: usize, samples: usize, sigma_mm: f64, seed: u64) -> Result<Outcome> {
    // The seed rotates the grating.
    let orientation = 180.0 * uniform(key(&[seed, 7]));
    let text = format!(
        "[camera]\nposition = [0, 0, 500]\ntarget = [0, 0, 0]\nfov_deg = 12\nwidth = {side}\nheight = {side}\n\
         [[shape]]\ntype = \"sphere\"\ncenter = [0, 0, 0]\nradius = 50\nmaterial = \"m\"\n\
         [[light]]\ntype = \"point\"\nposition = [60, 100, 280]\nsigma_mm = {sigma_mm:?}\n\
         [material.m.diffraction]\ntype = \"grating\"\nperiod_um = 1.5\norientation_deg = {orientation:?}\n\
         relief = {{ depth_um = 0.15 }}\ncoherence_um = 20\n"
    );
    let scene = toml::from_str(&text).map_err(|e| Error::input("scene", e.to_string(), "report this"))?;
    // An unreachable target error, so that all samples are taken.
    let settings = Settings { samples, max_error: 1e-5, ..Settings::default() };
    let folder = std::env::temp_dir();
    let (_, report) = render(&scene, &folder, &settings, &Silent)?;
    let ratio = report.noise / report.predicted.noise;
    let wrong = f64::from(u8::from(!(1.0 / FACTOR..=FACTOR).contains(&ratio)));
    let error = Some((ratio - 1.0).abs().max(1e-4));
    Ok(Outcome { error, seconds: report.seconds, masked: 0.0, wrong, predicted: None })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_noise_is_about_as_predicted() {
        let found = run(24, 64, 10.0, 3).unwrap();
        assert!(found.error.unwrap() < 0.5 && found.wrong == 0.0, "{found:?}");
    }
}

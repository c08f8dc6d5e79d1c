//! Study of the number of pixels used for the noise estimate.

use super::scene::fitted;
use crate::{Axis, Effort, Outcome, Scene, Setting, Study};
use nacre_base::Error;
use nacre_base::Result;
use nacre_polarimetry::synthetic::{Photographs, Synthetic, even_angles};
use nacre_polarimetry::{NoiseModel, estimate_noise};
use std::time::Instant;

/// Subsampling factors of the pixels.
const ONE_IN: [usize; 7] = [1, 4, 16, 64, 256, 1024, 4096];
const ELECTRONS: [f64; 6] = [300.0, 1000.0, 3000.0, 10_000.0, 40_000.0, 160_000.0];
const REFERENCE: usize = 4;

/// Study of the noise estimate from residuals, on a subset of the pixels.
pub(super) fn study(effort: Effort) -> Study {
    let settings = ONE_IN.map(|n| {
        let label = if n == 1 { "all pixels".to_owned() } else { format!("1 in {n}") };
        let setting = Setting::new("residuals", label, 1.0 / n as f64);
        // The program uses at most 200,000 pixels, so all pixels of this scene.
        if n == 1 { setting.as_default() } else { setting }
    });
    let settings = settings.into_iter().enumerate().map(|(i, s)| if i % 2 == 1 { s.without_sweep() } else { s });
    Study {
        name: "noise-estimate",
        group: "polarimetry",
        title: "Pixels behind the noise estimate".into(),
        question: "σ needs the camera's noise. When nobody states it, it is estimated from what six photographs leave over after \
                   the fit: from how many pixels? Gratings without a film whose reflectance varies by ± 80 %, so that shot noise \
                   and read noise (8 electrons) can be told apart; error: mean deviation of the estimated σ from the true one over \
                   the intensities in view."
            .into(),
        knob: Axis::log("share of pixels", ""),
        stress: Axis::log("electrons at white", "e⁻"),
        error: Axis::log("deviation of σ", "%"),
        time: Axis::log("time of the estimate", "s"),
        predicted: "",
        settings: settings.collect(),
        scenes: ELECTRONS.map(Scene::new).to_vec(),
        reference: REFERENCE,
        run: {
            let pixels = effort.pick(192 * 1024, 64 * 1024);
            Box::new(move |setting, scene, seed| run(ONE_IN[setting], ELECTRONS[scene], pixels, seed))
        },
    }
}

fn run(one_in: usize, electrons: f64, pixels: usize, seed: u64) -> Result<Outcome> {
    let noise = NoiseModel { full_scale_e: electrons, read_noise_e: 8.0 };
    let scene = Synthetic { noise: Some(noise), reflectance: 0.8, angles: even_angles(6), ..Synthetic::default() };
    let photographs = scene.render(pixels, seed)?;
    let begun = Instant::now();
    let some = thinned(&photographs, one_in);
    let maps = fitted(&some);
    let found = estimate_noise(&maps, &some.design);
    let seconds = begun.elapsed().as_secs_f64();
    // The noise estimate needs at least 64 pixels; without it the whole map has no σ.
    let Some(found) = found else {
        return Ok(Outcome { error: None, seconds, masked: 1.0, wrong: 0.0, predicted: None });
    };
    let truth = photographs.noise.first().ok_or_else(|| Error::input("scene", "has no frames", "report this"))?;
    let deviation = |a: &f32| {
        let a = f64::from(*a).max(0.0);
        ((found.shot * a + found.floor) / (truth.shot * a + truth.floor)).sqrt() - 1.0
    };
    let first = &photographs.frames[0];
    let error = 100.0 * first.iter().map(|a| deviation(a).abs()).sum::<f64>() / first.len() as f64;
    Ok(Outcome { error: Some(error), seconds, masked: 0.0, wrong: 0.0, predicted: None })
}

/// Keeps every `one_in`-th pixel.
fn thinned(photographs: &Photographs, one_in: usize) -> Photographs {
    Photographs {
        frames: photographs.frames.iter().map(|f| f.iter().step_by(one_in).copied().collect()).collect(),
        angles: photographs.angles.clone(),
        design: photographs.design.clone(),
        noise: photographs.noise.clone(),
        truth: photographs.truth.iter().step_by(one_in).copied().collect(),
        white: photographs.white,
        light: photographs.light,
    }
}

//! Study of the number of analyser angles.

use super::scene::{Method, fitted, judge, mean_of_normal, orientation_error, sinusoid, time};
use crate::{Axis, Effort, Outcome, Scene, Setting, Study};
use nacre_base::Result;
use nacre_polarimetry::NoiseModel;
use nacre_polarimetry::synthetic::{Synthetic, even_angles};
use std::time::Instant;

const FRAMES: [usize; 9] = [3, 4, 5, 6, 8, 12, 16, 20, 24];
const ELECTRONS: [f64; 6] = [300.0, 1000.0, 3000.0, 10_000.0, 40_000.0, 160_000.0];
const REFERENCE: usize = 4;

/// Study of 3 to 24 angles, against the theoretical error σ(I) / (√(2N) B).
pub(super) fn study(effort: Effort) -> Study {
    let setting = |n: &usize| {
        let setting = Setting::new("sinusoid", format!("{n} frames"), *n as f64);
        match n {
            12 => setting.as_default(),
            3 | 4 | 6 | 24 => setting,
            _ => setting.without_sweep(),
        }
    };
    Study {
        name: "frames",
        group: "polarimetry",
        title: "Number of analyser angles".into(),
        question: "How many photographs does an orientation need? Gratings of all orientations without a film (r 1.1, ζ 45°), \
                   analyser angles spread evenly over 180°, a camera whose white is so many electrons (8 electrons read noise). \
                   The dashed line is theory: σ = σ(I) / (√(2N) B), with σ(I) the noise of a photograph at the pixel's mean and B \
                   the amplitude of its modulation."
            .into(),
        knob: Axis::linear("frames", ""),
        stress: Axis::log("electrons at white", "e⁻"),
        error: orientation_error(),
        time: time(),
        predicted: "theory: σ(I) / (√(2N) B)",
        settings: FRAMES.iter().map(setting).collect(),
        scenes: ELECTRONS.map(Scene::new).to_vec(),
        reference: REFERENCE,
        run: {
            let method = sinusoid();
            let pixels = effort.pick(256 * 1024, 2048);
            Box::new(move |setting, scene, seed| run(&method, FRAMES[setting], ELECTRONS[scene], pixels, seed))
        },
    }
}

fn run(method: &Method, frames: usize, electrons: f64, pixels: usize, seed: u64) -> Result<Outcome> {
    let noise = NoiseModel { full_scale_e: electrons, read_noise_e: 8.0 };
    let scene = Synthetic { noise: Some(noise), angles: even_angles(frames), ..Synthetic::default() };
    let photographs = scene.render(pixels, seed)?;
    let begun = Instant::now();
    let mut maps = fitted(&photographs);
    let map = (method.solve)(&mut maps, &photographs)?;
    let seconds = begun.elapsed().as_secs_f64() / pixels as f64 * 1e6;
    // Without a film all pixels share one mean and one amplitude, so the prediction uses the true values instead of the
    // fit.
    let (mean, amplitude) = photographs.light;
    let per_photograph = photographs.noise[0].shot * mean + photographs.noise[0].floor;
    let sigma = per_photograph.sqrt() / ((2.0 * frames as f64).sqrt() * amplitude);
    let predicted = Some(mean_of_normal(sigma).to_degrees());
    Ok(Outcome { predicted, ..judge(&map.orientation, &map.sigma, &photographs.truth, seconds) })
}

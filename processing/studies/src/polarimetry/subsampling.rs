//! Study of the number of pixels to which the film model is fitted.

use super::scene::{PROMISED, method, orientation_error, ratio, run, time_of_map};
use crate::{Axis, Effort, Scene, Setting, Study};
use nacre_plot::style::number;
use nacre_polarimetry::synthetic::Synthetic;
use nacre_polarimetry::{Model, NoiseModel, SAMPLE_PIXELS};

const PIXELS: [usize; 7] = [50, 150, 500, 1500, 5000, 15_000, SAMPLE_PIXELS];
const ELECTRONS: [f64; 5] = [1000.0, 4000.0, 12_000.0, 40_000.0, 160_000.0];
const REFERENCE: usize = 3;
/// Pixels of the map.
const ALL: usize = 64 * 1024;
const FEW: usize = 4096;

/// Study of the full curve, fitted to a subset of the pixels.
pub(super) fn study(effort: Effort) -> Study {
    let setting = |n: &usize| {
        let setting = Setting::new("curve", format!("{} pixels", number(*n as f64)), *n as f64);
        match *n {
            SAMPLE_PIXELS => setting.as_default(),
            150 | 1500 | 15_000 => setting.without_sweep(),
            _ => setting,
        }
    };
    Study {
        name: "subsampling",
        group: "polarimetry",
        title: "Pixels that the model is fitted to".into(),
        question: "The film's parameters are fitted to some of the pixels; every pixel then gets its orientation. From how many? The \
                   curve model on gratings of r 1.2, ζ 150° behind a film of 10° with its axis at 20°, reflectance varying by ± 20 %, \
                   twelve angles."
            .into(),
        knob: Axis::log("pixels", ""),
        stress: Axis::log("electrons at white", "e⁻"),
        error: orientation_error(),
        time: time_of_map(effort.pick(ALL, FEW)),
        predicted: PROMISED,
        settings: PIXELS.iter().map(setting).collect(),
        scenes: ELECTRONS.map(Scene::new).to_vec(),
        reference: REFERENCE,
        run: Box::new(move |setting, scene, seed| {
            let scene = Synthetic {
                ratio: ratio(1.2, 150.0),
                retardance: 10f64.to_radians(),
                axis: 20f64.to_radians(),
                reflectance: 0.2,
                noise: Some(NoiseModel { full_scale_e: ELECTRONS[scene], read_noise_e: 8.0 }),
                ..Synthetic::default()
            };
            run(&scene, &method(Model::Curve, PIXELS[setting]), effort.pick(ALL, FEW), seed)
        }),
    }
}

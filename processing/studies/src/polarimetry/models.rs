//! Study of the polarization model, on scenes where the models differ.

use super::scene::{PROMISED, methods, orientation_error, pixels, ratio, run, time_of_map};
use crate::{Axis, Effort, Scene, Setting, Study};
use nacre_polarimetry::synthetic::{Spread, Synthetic};

/// r, ζ and Δn in degrees, and the number of orientations in view (0 for all).
const SCENES: [(f64, f64, f64, usize); 8] = [
    (1.1, 45.0, 0.0, 0),
    (1.001, 172.0, 3.0, 0),
    (1.05, 175.0, 10.0, 0),
    (1.05, 175.0, 10.0, 5),
    (1.2, 150.0, 10.0, 5),
    (1.05, 5.0, 3.0, 0),
    (1.2, 20.0, 10.0, 0),
    (0.8, -30.0, 10.0, 0),
];
const REFERENCE: usize = 2;

/// Study of every model on every scene.
pub(super) fn study(effort: Effort) -> Study {
    let models = methods();
    let label = |(r, zeta, film, bands): &(f64, f64, f64, usize)| {
        let bands = if *bands > 0 { format!(", {bands} orientations") } else { String::new() };
        format!("r {r}, ζ {zeta}°, Δn {film}°{bands}").replace('-', "−")
    };
    let setting = |m: &super::scene::Method| {
        let setting = Setting::new(m.name, m.name, 0.0);
        if m.default { setting.as_default() } else { setting }
    };
    Study {
        name: "models",
        group: "polarimetry",
        title: "Models of the film".into(),
        question: "Which model for which sample? A film of retardance Δn, its axis at 20°, on gratings whose two polarizations \
                   differ by the factor r and the phase ζ; twelve angles, 40,000 electrons, reflectance varying by ± 20 %. Where a \
                   point lies far above its dashed line and is ringed, the model is wrong and says otherwise."
            .into(),
        knob: Axis::names("model"),
        stress: Axis::names("sample"),
        error: orientation_error(),
        time: time_of_map(pixels(effort)),
        predicted: PROMISED,
        settings: models.iter().map(setting).collect(),
        scenes: SCENES.iter().enumerate().map(|(i, s)| Scene::named(i, label(s))).collect(),
        reference: REFERENCE,
        run: Box::new(move |setting, scene, seed| {
            let (r, zeta, film, bands) = SCENES[scene];
            let scene = Synthetic {
                ratio: ratio(r, zeta),
                retardance: film.to_radians(),
                axis: 20f64.to_radians(),
                reflectance: 0.2,
                spread: if bands > 0 { Spread::Bands(bands) } else { Spread::Even },
                ..Synthetic::default()
            };
            run(&scene, &models[setting], pixels(effort), seed)
        }),
    }
}

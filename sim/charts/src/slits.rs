//! Study of slits under lamps of any size: closed-form average, and sums over points of the lamp.

use super::environment::Last;
use nacre_brdf::Slits;
use nacre_sim::random::{key, uniform};
use nacre_studies::{Axis, Effort, Outcome, Scene, Setting, Study};
use rayon::prelude::*;
use std::hint::black_box;
use std::time::Instant;

const POINTS: [usize; 6] = [1, 4, 16, 64, 256, 1024];
const LAMPS_DEG: [f64; 9] = [0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0];

/// Wavelength in µm, and number of sampling points across the orders.
const LAMBDA_UM: f64 = 0.55;
const PLACES: usize = 400;

/// Points of the reference for each oscillation of the sum over slits.
const POINTS_OF_A_LOBE: f64 = 40.0;

/// Truncation of the sum over the lamp, in standard deviations.
const REACH: f64 = 5.0;

pub(super) fn study(effort: Effort) -> Study {
    let last = Last::new();
    let repeated = effort.pick(20, 2);
    let closed = Setting::new("closed form", "closed form", 0.0).as_default();
    let sums = POINTS.map(|n| {
        let label = if n == 1 { "1 point".into() } else { format!("{n} points") };
        let setting = Setting::new("points of the lamp", label, n as f64);
        if [1, 16, 256].contains(&n) { setting } else { setting.without_sweep() }
    });
    Study {
        name: "render-slits",
        group: "render",
        title: "Slits under lamps of any size".into(),
        question: format!(
            "Light from the 2017 paper's disc ({} slits of {} µm, {} µm apart, Eq. 16) at {PLACES} places across its orders, {:.0} nm, under a Gaussian lamp seen under this \
             angle (standard deviation). A lamp of some size smears orders: its average has a closed form, a sum over pairs of slits whose light still interferes; or points \
             of the lamp are added up. Against thousands of points, root mean square over the light's own.",
            Slits::DISC.count,
            Slits::DISC.width_um,
            Slits::DISC.spacing_um,
            1e3 * LAMBDA_UM
        ),
        knob: Axis::log("points", ""),
        stress: Axis::log("standard deviation of the lamp", "°"),
        error: Axis::log("relative error (RMS)", ""),
        time: Axis::log("time of a place and wavelength", "µs"),
        predicted: "",
        settings: [closed].into_iter().chain(sums).collect(),
        scenes: LAMPS_DEG.map(Scene::new).to_vec(),
        reference: 5,
        run: Box::new(move |setting, scene, seed| {
            let sigma = LAMPS_DEG[scene].to_radians() / LAMBDA_UM;
            // Each run uses different sampling points.
            let start = uniform(key(&[seed, 3])) / PLACES as f64;
            let places: Vec<f64> = (0..PLACES).map(|k| 2.0 * (k as f64 / PLACES as f64 + start) - 1.0).collect();
            let truth = last.get(scene, seed, || {
                // The number of points is proportional to the number of lobes covered by the lamp.
                let points = ((POINTS_OF_A_LOBE * sigma * spread()) as usize).clamp(1000, 40_000);
                Ok(places.par_iter().map(|f| summed(*f, sigma, points)).collect::<Vec<f64>>())
            })?;
            let begun = Instant::now();
            let mut found = vec![];
            for _ in 0..repeated {
                found = places.iter().map(|f| light(setting, black_box(*f), sigma)).collect::<Vec<f64>>();
            }
            let seconds = 1e6 * begun.elapsed().as_secs_f64() / (repeated * PLACES) as f64;
            let square: f64 = found.iter().zip(truth.iter()).map(|(a, b)| (a - b).powi(2)).sum();
            let whole: f64 = truth.iter().map(|b| b * b).sum();
            let error = Some((square / whole).sqrt().max(1e-9));
            Ok(Outcome { error, seconds, masked: 0.0, wrong: 0.0, predicted: None })
        }),
    }
}

/// Oscillations per unit of σ: the distance of the outermost slits, over which the sum oscillates fastest, times the
/// truncation.
fn spread() -> f64 {
    2.0 * REACH * Slits::DISC.spacing_um * Slits::DISC.count as f64
}

fn light(setting: usize, frequency: f64, sigma: f64) -> f64 {
    match setting.checked_sub(1) {
        None => Slits::DISC.averaged(frequency, sigma),
        Some(k) => summed(frequency, sigma, POINTS[k]),
    }
}

/// Sum over equidistant points of a lamp.
fn summed(frequency: f64, sigma: f64, points: usize) -> f64 {
    let (mut sum, mut all) = (0.0, 0.0);
    for k in 0..points {
        let x = REACH * (2.0 * (k as f64 + 0.5) / points as f64 - 1.0);
        let weight = (-0.5 * x * x).exp();
        sum += weight * Slits::DISC.at(frequency + sigma * x, 1e3);
        all += weight;
    }
    sum / all
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The closed form is exact for every lamp, a single point is not, and many points suffice for small lamps only.
    #[test]
    fn the_closed_form_is_exact_under_any_lamp() {
        let study = study(Effort::Quick);
        let error = |setting, scene| (study.run)(setting, scene, 3).unwrap().error.unwrap();
        for scene in 0..LAMPS_DEG.len() {
            assert!(error(0, scene) < 1e-3, "{scene} {}", error(0, scene));
        }
        assert!(error(1, 6) > 0.3 && error(3, 3) < 0.01 && error(3, 7) > 0.01);
    }
}

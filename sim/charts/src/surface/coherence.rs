//! Study of the coherence length: widths and heights of lobes against closed forms.

use super::stress::{METHODS, NAMES, Stress, outcome_with_prediction, refused};
use libm::jn;
use nacre_base::Result;
use nacre_base::progress::Silent;
use nacre_brdf::height::{HeightField, Profile, Quality, Shape, Synthetic};
use nacre_brdf::{Direction, Pair, Settings, slice};
use nacre_studies::{Axis, Outcome};
use std::f64::consts::{PI, TAU};
use std::time::Instant;

const DEPTH_UM: f64 = 0.15;
const WAVELENGTHS_NM: [f64; 3] = [420.0, 550.0, 680.0];

/// Periods on the patch.
const PERIODS: f64 = 8.0;
const PIXELS: usize = 128;

/// Only lobes with at least this share of the light, and directions as bright as these, are compared.
const FAINTEST: f64 = 1e-3;

/// Grating period in µm, varied by the seed.
fn period(seed: u64) -> f64 {
    1.1 + 0.004 * (seed % 100) as f64
}

fn field(seed: u64) -> Result<HeightField> {
    let pixel_um = PERIODS * period(seed) / PIXELS as f64;
    let shape = Shape::Grating(Profile::Sinusoid);
    Synthetic { shape, pixels: PIXELS, pixel_um, period_um: period(seed), depth_um: DEPTH_UM, angle: 0.0 }.field()
}

/// BRDF of a sinusoid in 1/sr, and the threshold of the comparison. Its orders are Gaussian lobes of standard deviation
/// `1/(2√2π σs)` that hold `Jm²` of the light (Goodman 2005, section 4.4), times Stam's gain.
fn closed(seed: u64, coherence_um: f64, nm: f64, degrees: f64) -> [f64; 2] {
    let pair = Pair::new(Direction::new(0.0, 0.0), Direction::new(degrees.to_radians(), 0.0));
    let number = 1e3 / nm;
    let sigma = 1.0 / (8_f64.sqrt() * PI * 0.25 * coherence_um);
    let lobe = |f: f64| (-0.5 * (f / sigma).powi(2)).exp() / (TAU * sigma * sigma);
    let phase = 0.5 * TAU * number * pair.w * DEPTH_UM;
    let (x, y) = (pair.tangent[0] * number, pair.tangent[1] * number);
    let order = |m: i32| jn(m, phase).powi(2) * lobe((x - f64::from(m) / period(seed)).hypot(y));
    let scale = pair.gain * number * number;
    [scale * (-12..=12).map(order).sum::<f64>(), FAINTEST * scale * lobe(0.0)]
}

pub(super) fn study() -> Stress {
    Stress {
        name: "surface-coherence",
        title: "How long light is coherent",
        question: "Spectra of a sinusoid (1.1 to 1.5 µm by seed, 0.15 µm deep, eight periods on the patch) at normal incidence and three wavelengths, in 601 directions \
                   to 60°, against the closed form: Gaussian lobes, as wide as the coherence length σs says, about orders that hold Jm² of the light. The \
                   largest relative error, of lobes that hold a thousandth of the light. Short coherence has wide lobes, under which many \
                   frequencies of the patch are added up; long coherence needs the patch to be repeated. 1 % is asked for. Wrong where off by more than five times what it says.",
        axis: Axis::log("coherence 4σs", "µm"),
        values: &[4.0, 8.0, 16.0, 32.0, 65.0, 130.0, 260.0],
        reference: 4,
        error: "largest relative error",
        predicted: "the error that the slice says it has",
        // pq and its linear variant have windows of other shapes.
        settings: NAMES.split_at(5).0,
        run: |setting, coherence_um, seed| {
            let field = field(seed)?;
            let quality = Quality::of(&field, coherence_um);
            let theta: Vec<f64> = (0..=600).map(|k| f64::from(k) / 10.0).collect();
            let settings = Settings { coherence_um, method: METHODS[setting], ..Settings::default() };
            let begun = Instant::now();
            let Ok(found) = slice(&field, &quality, &settings, [&WAVELENGTHS_NM, &theta], Some(0.0), &Silent) else {
                return Ok(refused(begun));
            };
            let done = Instant::now();
            let mut error = 0.0_f64;
            for (k, nm) in WAVELENGTHS_NM.iter().enumerate() {
                for (j, degrees) in theta.iter().enumerate() {
                    let [truth, floor] = closed(seed, coherence_um, *nm, *degrees);
                    error = error.max((found.values[k * theta.len() + j] - truth).abs() / truth.max(floor));
                }
            }
            Ok(Outcome {
                seconds: (done - begun).as_secs_f64(),
                ..outcome_with_prediction(error, found.error_estimate, begun)
            })
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_have_lobes_as_wide_as_the_coherence_says() {
        let study = study();
        for coherence in [4.0, 16.0, 65.0, 260.0] {
            for setting in 0..study.settings.len() {
                let found = (study.run)(setting, coherence, 7).unwrap();
                assert!(found.error.unwrap() < 0.01 && found.wrong == 0.0, "{coherence}, {setting}: {found:?}");
            }
        }
    }
}

//! Study of BRDF methods for height fields, against the depth.

use nacre_base::Result;
use nacre_base::progress::Silent;
use nacre_brdf::height::{HeightField, Quality, Shape, Synthetic};
use nacre_brdf::{Direction, Method, Pair, Settings, Slice, Window, slice};
use nacre_studies::{Axis, Effort, Outcome, Scene, Setting, Study};
use std::time::Instant;

const DEPTHS_UM: [f64; 6] = [0.1, 0.25, 0.5, 1.0, 2.0, 4.0];
const REFERENCE: usize = 2;

const WAVELENGTHS_NM: [f64; 3] = [400.0, 520.0, 680.0];
const COHERENCE_UM: f64 = 12.0;
const LIGHT_DEG: [f64; 2] = [20.0, 30.0];
const AZIMUTH_DEG: f64 = 10.0;

const METHODS: [(&str, Method, f64); 13] = [
    ("auto", Method::Auto, 0.01),
    ("auto", Method::Auto, 0.1),
    ("auto", Method::Auto, 0.001),
    ("Taylor (FLSS)", Method::Taylor, 0.1),
    ("Taylor (FLSS)", Method::Taylor, 0.01),
    ("Taylor (FLSS)", Method::Taylor, 0.001),
    ("Chebyshev", Method::Chebyshev, 0.1),
    ("Chebyshev", Method::Chebyshev, 0.01),
    ("Chebyshev", Method::Chebyshev, 0.001),
    ("transforms of exp", Method::Fft, 0.1),
    ("transforms of exp", Method::Fft, 0.01),
    ("transforms of exp", Method::Fft, 0.001),
    ("direct sums", Method::Reference, 0.01),
];

/// Expansions against the depth.
pub(super) fn study(effort: Effort) -> Study {
    let [pixels, views] = effort.pick([256, 400], [96, 100]);
    let setting = |(k, (family, _, error)): (usize, &(&str, Method, f64))| {
        let label = if *family == "direct sums" { "direct sums".into() } else { format!("{} %", 100.0 * error) };
        let setting = Setting::new(family, label, *error);
        let setting = if k == 0 { setting.as_default() } else { setting };
        if *error == 0.01 { setting } else { setting.without_sweep() }
    };
    Study {
        name: "surface",
        group: "surface",
        title: "The BRDF of a height field".into(),
        question: format!(
            "How many terms, and of which expansion? Rows of fingers 1.2 µm apart on {pixels} × {pixels} pixels, and their BRDF in {views} \
             directions at three wavelengths, light at 20°. The error is the largest, relative to what direct sums say, of directions that \
             hold a thousandth of a mirror's peak or more. A slice counts as masked where the method refuses it, and as confidently \
             wrong when it is off by more than five times what it says."
        ),
        knob: Axis::log("error asked for", ""),
        stress: Axis::log("depth", "µm"),
        error: Axis::log("largest relative error", ""),
        time: Axis::log("time per slice", "s"),
        predicted: "the error that the slice says it has",
        settings: METHODS.iter().enumerate().map(setting).collect(),
        scenes: DEPTHS_UM.map(Scene::new).to_vec(),
        reference: REFERENCE,
        run: Box::new(move |setting, scene, seed| run(setting, DEPTHS_UM[scene], pixels, views, seed)),
    }
}

/// The height field; the seed rotates it slightly.
fn field(depth_um: f64, pixels: usize, seed: u64) -> Result<HeightField> {
    let angle = 0.3 + 0.01 * (seed % 100) as f64;
    Synthetic { shape: Shape::Fingers, pixels, pixel_um: 0.09, period_um: 1.2, depth_um, angle }.field()
}

fn run(setting: usize, depth_um: f64, pixels: usize, views: usize, seed: u64) -> Result<Outcome> {
    let field = field(depth_um, pixels, seed)?;
    let quality = Quality::of(&field, COHERENCE_UM);
    let theta: Vec<f64> = (0..views).map(|k| 100.0 * (k as f64 + 0.5) / views as f64 - 50.0).collect();
    let of = |method, max_error, theta: &[f64]| -> Result<Slice> {
        let settings =
            Settings { light_deg: LIGHT_DEG, method, max_error, coherence_um: COHERENCE_UM, ..Settings::default() };
        slice(&field, &quality, &settings, [&WAVELENGTHS_NM, theta], Some(AZIMUTH_DEG), &Silent)
    };
    let (_, method, max_error) = METHODS[setting];
    let begun = Instant::now();
    let found = of(method, max_error, &theta);
    let seconds = begun.elapsed().as_secs_f64();
    let Ok(found) = found else {
        return Ok(Outcome { error: None, seconds, masked: 1.0, wrong: 0.0, predicted: None });
    };
    // Direct sums are slow, so they are evaluated for a subset of the directions.
    let every = (views / 25).max(1);
    let some: Vec<f64> = theta.iter().copied().step_by(every).collect();
    let truth = of(Method::Reference, max_error, &some)?;
    let (light, window) = (Direction::light(LIGHT_DEG[0], LIGHT_DEG[1])?, Window::new(COHERENCE_UM)?);
    let mut error = 0.0_f64;
    for (k, nm) in WAVELENGTHS_NM.iter().enumerate() {
        for (j, degrees) in some.iter().enumerate() {
            let pair = Pair::new(light, Direction::new(degrees.to_radians(), AZIMUTH_DEG.to_radians()));
            let floor = 1e-3 * window.peak() * pair.gain * 1e6 / (nm * nm);
            let (a, b) = (found.values[k * views + j * every], truth.values[k * some.len() + j]);
            error = error.max((a - b).abs() / b.max(floor));
        }
    }
    let wrong = f64::from(u8::from(error.is_nan() || error > 5.0 * found.error_estimate));
    // The logarithmic axis needs a positive error even for identical numbers.
    let error = error.max(1e-16);
    Ok(Outcome { error: Some(error), seconds, masked: 0.0, wrong, predicted: Some(found.error_estimate) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn auto_meets_its_error_and_powers_are_refused_where_they_cancel() {
        for depth in DEPTHS_UM {
            let auto = run(0, depth, 64, 25, 3).unwrap();
            assert!(auto.error.unwrap() <= 0.01 && auto.wrong == 0.0, "{depth}: {auto:?}");
        }
        assert_eq!(run(4, 4.0, 64, 25, 3).unwrap().masked, 1.0);
    }
}

//! Study of the number of terms in sums over wavelengths and over frequencies.

use super::stress::{Stress, plain};
use nacre_base::Result;
use nacre_base::progress::Silent;
use nacre_brdf::height::{Profile, Quality, Shape, Synthetic};
use nacre_brdf::{Settings, Window, slice};
use nacre_optics::color::Observer;
use nacre_studies::{Axis, Outcome};
use std::time::Instant;

pub(super) fn steps() -> Stress {
    Stress {
        name: "surface-step",
        title: "Steps of wavelengths",
        question: "Y along a slice of a sinusoid (1.28 µm, 0.1 µm deep, normal incidence, 401 directions to 60°) from wavelengths at even steps, against steps of 0.1 nm: root \
                   mean square, relative. The longer the light is coherent, the narrower are lobes, and the finer must steps be. A map's own \
                   sums choose steps by the coherence and the direction; here the finest of those at 1 %.",
        axis: Axis::log("coherence", "µm"),
        values: &[8.0, 16.0, 32.0, 65.0, 130.0],
        reference: 3,
        error: "relative error of Y",
        predicted: "",
        settings: &["by coherence (1 %)", "1 nm", "5 nm", "10 nm", "20 nm", "50 nm"],
        run: |setting, coherence_um, _| {
            let shape = Shape::Grating(Profile::Sinusoid);
            let field =
                Synthetic { shape, pixels: 96, pixel_um: 0.08, period_um: 1.28, depth_um: 0.1, angle: 0.0 }.field()?;
            let quality = Quality::of(&field, coherence_um);
            let theta: Vec<f64> = (0..401).map(|k| 3.0 + 57.0 * f64::from(k) / 400.0).collect();
            let settings = Settings { coherence_um, ..Settings::default() };
            let luminance = |wavelengths: &[f64]| -> Result<Vec<f64>> {
                let found = slice(&field, &quality, &settings, [wavelengths, &theta], Some(0.0), &Silent)?;
                let weights: Vec<f64> = wavelengths.iter().map(|nm| Observer::default().at(*nm)[1]).collect();
                let white: f64 = weights.iter().sum();
                let at = |j: usize| -> f64 {
                    weights.iter().enumerate().map(|(k, w)| w * found.values[k * theta.len() + j]).sum()
                };
                Ok((0..theta.len()).map(|j| at(j) / white).collect())
            };
            let even =
                |step: f64| -> Vec<f64> { (0..=(400.0 / step) as usize).map(|k| 380.0 + step * k as f64).collect() };
            let truth = luminance(&even(0.1))?;
            let begun = Instant::now();
            let found = match setting {
                0 => {
                    // Wave numbers at the step that the lobe width allows: Gaussian lobes summed at equal steps.
                    let step = Window::new(coherence_um)?.step(60_f64.to_radians().sin(), 0.0025);
                    let count = ((1e3 / 380.0 - 1e3 / 780.0) / step).ceil() as usize;
                    let number = |k: usize| 1e3 / 780.0 + (1e3 / 380.0 - 1e3 / 780.0) * k as f64 / count as f64;
                    let numbers: Vec<f64> = (0..=count).map(|k| 1e3 / number(k)).collect();
                    // dλ = λ² dν.
                    let found = slice(&field, &quality, &settings, [&numbers, &theta], Some(0.0), &Silent)?;
                    let weights: Vec<f64> = numbers.iter().map(|nm| Observer::default().at(*nm)[1] * nm * nm).collect();
                    let white: f64 = weights.iter().sum();
                    let at = |j: usize| -> f64 {
                        weights.iter().enumerate().map(|(k, w)| w * found.values[k * theta.len() + j]).sum()
                    };
                    (0..theta.len()).map(|j| at(j) / white).collect()
                }
                k => luminance(&even([1.0, 5.0, 10.0, 20.0, 50.0][k - 1]))?,
            };
            let seconds = begun.elapsed().as_secs_f64();
            let square = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>();
            let error = square(&mut found.iter().zip(&truth).map(|(a, b)| a - b)) / square(&mut truth.iter().copied());
            Ok(Outcome { seconds, ..plain(error.sqrt(), begun) })
        },
    }
}

pub(super) fn neighbours() -> Stress {
    Stress {
        name: "surface-window",
        title: "Neighbours under the coherence window",
        question: "How much of the coherence window's light is kept when only the nearest frequencies of a patch are added up: the largest part that is missing, over all \
                   places between frequencies. The thesis takes 3 × 3; here as many as the error needs.",
        axis: Axis::log("patch over coherence", ""),
        values: &[0.25, 0.5, 1.0, 2.0, 4.0],
        reference: 2,
        error: "part of the light that is missing",
        predicted: "",
        settings: &["by error (1 %)", "3 × 3 (thesis)", "5 × 5", "9 × 9"],
        run: |setting, ratio, _| {
            let window = Window::new(65.0)?;
            let patch_um = 65.0 * ratio;
            let half = match setting {
                0 => (window.radius(0.0025) * patch_um).ceil() as i64,
                k => [1, 2, 4][k - 1],
            };
            let begun = Instant::now();
            let line = |off: f64, half: i64| -> f64 {
                let weight = |k: i64| (-0.5 * ((k as f64 - off) / (patch_um * window.sigma)).powi(2)).exp();
                (-half..=half).map(weight).sum()
            };
            let mut worst = 0.0_f64;
            for k in 0..=20 {
                for j in 0..=20 {
                    let [x, y] = [k, j].map(|v| f64::from(v) / 40.0);
                    let all = line(x, 400) * line(y, 400);
                    worst = worst.max(1.0 - line(x, half) * line(y, half) / all);
                }
            }
            Ok(plain(worst, begun))
        },
    }
}

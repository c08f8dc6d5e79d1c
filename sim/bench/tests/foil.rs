//! Foil from simulated photographs: its distribution against the formula, and photographs of the new foil against the
//! old one.

#![allow(clippy::unwrap_used)]

use nacre_image::scalar_picture;
use nacre_lut::foil::{
    Distribution, Dots, Light, Marginals, Settings, Shape, measure, picture, synthesize, total_variation,
};
use nacre_maps::{Kind, Maps};
use nacre_sim::photographs::{FoilPattern, FoilPhotograph};
use std::f64::consts::PI;

fn photograph(scene: &FoilPhotograph) -> Light {
    let values = scene.radiance().unwrap().iter().map(|v| *v as f32).collect();
    Light { width: scene.width, height: scene.height, values }
}

/// Integral of the formula over each bin.
fn truth(scene: &FoilPhotograph, like: &Distribution) -> Distribution {
    let (fine, mut share) = (6, vec![0.0; like.share.len()]);
    for (at, share) in share.iter_mut().enumerate() {
        let (column, row) = (at % like.orientations, at / like.orientations);
        for k in 0..fine * fine {
            let theta =
                PI * (column as f64 + (k % fine) as f64 / fine as f64 + 0.5 / fine as f64) / like.orientations as f64;
            let (a, b) = (like.edge(row), like.edge(row + 1));
            let lines = a + (b - a) * ((k / fine) as f64 + 0.5) / fine as f64;
            *share += scene.density(theta, 1.0 / lines) * (b - a) / (lines * lines);
        }
    }
    let sum: f64 = share.iter().sum();
    share.iter_mut().for_each(|s| *s /= sum);
    Distribution { share, ..like.clone() }
}

fn off(a: &Distribution, b: &Distribution) -> [f64; 2] {
    [total_variation(&a.of_orientations(), &b.of_orientations()), total_variation(&a.of_periods(), &b.of_periods())]
}

/// Density of the maps' dots over grating vectors, each dot with its opposite: a histogram on a square grid with cells
/// of `step` lines per µm, interpolated bilinearly.
fn density(maps: &Maps, step: f64) -> impl Fn([f64; 2]) -> f64 + Sync {
    let side = (2.0 * 1.8 / step) as usize;
    let mut cells = vec![0.0; side * side];
    let (theta, um) = (&maps.maps[&Kind::Orientation].value, &maps.maps[&Kind::Period].value);
    let count = theta.iter().filter(|v| v.is_finite()).count() as f64;
    for (t, a) in theta.iter().zip(um).filter(|(t, _)| t.is_finite()) {
        for sign in [-1.0, 1.0] {
            let k = [t.cos(), t.sin()].map(|v| f64::from(v) * sign / f64::from(*a));
            let cell = k.map(|v| ((v + 1.8) / step) as usize);
            cells[cell[1] * side + cell[0]] += 1.0 / (count * step * step);
        }
    }
    let at = move |x: i64, y: i64| {
        let inside = x >= 0 && y >= 0 && x < side as i64 && y < side as i64;
        if inside { cells[y as usize * side + x as usize] } else { 0.0 }
    };
    move |k: [f64; 2]| {
        let place = k.map(|v| (v + 1.8) / step - 0.5);
        let (x, y) = (place[0].floor() as i64, place[1].floor() as i64);
        let (fx, fy) = (place[0] - x as f64, place[1] - y as f64);
        let row = |y: i64| at(x, y) * (1.0 - fx) + at(x + 1, y) * fx;
        row(y) * (1.0 - fy) + row(y + 1) * fy
    }
}

/// Total variation of the angular and the radial marginal of two photographs about their zero order.
fn marginals(a: &[f32], b: &[f32], scene: &FoilPhotograph) -> [f64; 2] {
    let share = scene.camera_mm / (scene.camera_mm + scene.flash_mm);
    let px = 1000.0 * share / scene.pixel_um;
    let middle = [0.5 * (scene.width - 1) as f64, 0.5 * (scene.height - 1) as f64];
    let zero = [middle[0] + scene.baseline_mm[0] * px, middle[1] - scene.baseline_mm[1] * px];
    let of = |light: &[f32]| Marginals::of(light, scene.width, zero, [30.0, 215.0], [72, 60]);
    let (a, b) = (of(a), of(b));
    [total_variation(&a.angular, &b.angular), total_variation(&a.radial, &b.radial)]
}

#[test]
fn known_distributions_are_found_and_made_anew() {
    for (name, pattern) in [("spiral", FoilPattern::Spiral([1.0, 1.45])), ("circle", FoilPattern::Circle(1.2))] {
        let scene = FoilPhotograph { pattern, ..FoilPhotograph::default() };
        let light = photograph(&scene);
        let settings = Settings {
            period_um: Some([0.75, 1.75]),
            depth_um: Some(scene.depth_um),
            bins: Some([90, 48]),
            ..Settings::default()
        };
        let (found, report) = measure(&light, &scene.geometry(), &settings).unwrap();
        let truth = truth(&scene, &found);
        let [angles, periods] = off(&found, &truth);
        let joint = total_variation(&found.share, &truth.share);
        println!("{name}: marginals off by {angles:.4} {periods:.4}, joint {joint:.4}; {report:?}");
        assert!(angles < 0.02 && periods < 0.04, "{name} {angles} {periods}");
        assert!(joint < 0.08, "{name} {joint}");
        assert!(report.zero_order_off_px.unwrap() < 1.0, "{report:?}");
        let dots = Dots { size: [800, 800], pixel_um: 25.0, shape: Shape::Square(3), seed: 3 };
        let made = synthesize(&found, &dots).unwrap();
        assert!(made.report.total_variation.iter().all(|t| *t < 0.02), "{:?}", made.report);
        // Photographed under the same conditions as the old foil.
        let vectors = density(&made.maps, 0.015);
        let new: Vec<f32> = scene.radiance_of(&vectors).unwrap().iter().map(|v| *v as f32).collect();
        let [angular, radial] = marginals(&light.values, &new, &scene);
        println!("{name}: photographs differ by {angular:.4} in angle, {radial:.4} in radius");
        assert!(angular <= 0.05 && radial <= 0.05, "{name} {angular} {radial}");
        if let Some(folder) = std::env::var_os("NACRE_PICTURES").map(std::path::PathBuf::from) {
            picture(&found, false).save_png(&folder.join(format!("foil-{name}-histogram.png"))).unwrap();
            // The zero order consists of the brightest 1 % of the pixels.
            let mut sorted = light.values.clone();
            sorted.sort_by(f32::total_cmp);
            let top = sorted[sorted.len() * 99 / 100];
            for (word, values) in [("measured", &light.values), ("made", &new)] {
                let value = |x: usize, y: usize| Some(values[y * scene.width + x]);
                scalar_picture([scene.width, scene.height], &value, [0.0, top], "radiance", word, None)
                    .save_png(&folder.join(format!("foil-{name}-{word}.png")))
                    .unwrap();
            }
        }
    }
}

#[test]
fn what_would_mislead_is_said() {
    let scene = FoilPhotograph { width: 240, height: 240, pixel_um: 1120.0, ..FoilPhotograph::default() };
    let light = photograph(&scene);
    let geometry = scene.geometry();
    let says = |settings: &Settings, words: &str| {
        let (_, report) = measure(&light, &geometry, settings).unwrap();
        assert!(report.warnings.iter().any(|w| w.contains(words)), "{words}: {:?}", report.warnings);
    };
    says(&Settings { period_um: Some([0.5, 1.75]), ..Settings::default() }, "second orders");
    says(
        &Settings { period_um: Some([0.3, 1.75]), depth_um: Some(0.08), ..Settings::default() },
        "not in the photograph",
    );
    // A light at another position than stated.
    let mut wrong = geometry.clone();
    wrong.light_mm = Some([60.0, -10.0, 300.0]);
    let (_, report) = measure(&light, &wrong, &Settings::default()).unwrap();
    assert!(report.warnings.iter().any(|w| w.contains("zero order lies")), "{report:?}");
    // An unknown position is computed from the zero order and the height.
    let mut unknown = geometry.clone();
    unknown.light_mm = None;
    assert!(measure(&light, &unknown, &Settings::default()).unwrap_err().to_string().contains("light"));
    let known = Settings { light_height_mm: Some(300.0), period_um: Some([0.75, 1.75]), ..Settings::default() };
    let (found, _) = measure(&light, &unknown, &known).unwrap();
    let (direct, _) = measure(&light, &geometry, &Settings { light_height_mm: None, ..known }).unwrap();
    assert!((found.period_um()[0] / direct.period_um()[0] - 1.0).abs() < 5e-3);
    let mut dark = light.clone();
    dark.values.fill(0.0);
    assert!(measure(&dark, &geometry, &Settings::default()).is_err());
    let mut no_band = geometry;
    no_band.wavelength_nm = None;
    assert!(measure(&light, &no_band, &Settings::default()).unwrap_err().to_string().contains("wavelength"));
}

#[test]
fn scenes_that_make_no_sense_are_refused() {
    let good = FoilPhotograph::default();
    for scene in [
        FoilPhotograph { pattern: FoilPattern::Circle(f64::NAN), ..good.clone() },
        FoilPhotograph { spread_um: 0.0, ..good.clone() },
        FoilPhotograph { width: 1 << 20, ..good.clone() },
        FoilPhotograph { exposures: vec![], ..good },
    ] {
        assert!(scene.check().is_err(), "{scene:?}");
    }
}

//! Tables on flat samples, whose reflection of a sky is summed up once.

use super::super::diffraction::Diffraction;
use super::super::flat::Flat;
use super::*;
use std::f64::consts::PI;

/// A sky with a lamp of some 10° that is not alike to any side.
fn sky(folder: &Path) {
    write_exr(&folder.join("sky.exr"), 128, 64, &["R", "G", "B"], &[], &|c, y, row| {
        for (x, out) in row.iter_mut().enumerate() {
            let (polar, azimuth) = (PI * (y as f64 + 0.5) / 64.0, TAU * (0.5 - (x as f64 + 0.5) / 128.0));
            let lamp = (-0.5 * ((polar - 1.1).powi(2) + (azimuth - 0.9).powi(2)) / 0.03).exp();
            *out = (0.2 + 0.1 * c as f64 * polar.cos().max(0.0) + 8.0 * lamp) as f32;
        }
    })
    .unwrap();
}

const LUT: &str = "[material.a.diffraction]\ntype = \"table\"\nfile = \"lut.exr\"\n";

fn lit(position: [f64; 3], more: &str) -> String {
    format!(
        "[camera]\nposition = {position:?}\ntarget = [0, 0, 0]\nfov_deg = 11\nwidth = 48\nheight = 48\n[[shape]]\ntype = \"plane\"\n\
         size = [110, 110]\nmaterial = \"a\"\n{LUT}[[light]]\ntype = \"environment\"\nfile = \"sky.exr\"\nturn_deg = 25\n{more}"
    )
}

#[test]
fn what_is_summed_up_is_what_is_drawn_by_chance() {
    let dir = tempfile::tempdir().unwrap();
    table(dir.path());
    sky(dir.path());
    // From the side, at a grazing angle, and from behind.
    for position in [[-300.0, 100.0, 350.0], [490.0, 60.0, 80.0], [100.0, 50.0, -480.0]] {
        let scene = Scene::parse(&lit(position, "")).unwrap();
        let asked = Settings { samples: 1 << 16, max_error: 0.02, ..Settings::default() };
        let (summed, report) = render(&scene, dir.path(), &asked, &Silent).unwrap();
        assert!(report.materials["a"].method.contains("summed up once"), "{report:?}");
        assert!(report.predicted_model_error < 0.005, "{report:?}");
        let (drawn, other) = render(&scene, dir.path(), &Settings { by_chance: true, ..asked }, &Silent).unwrap();
        assert!(!other.materials["a"].method.contains("summed"), "{other:?}");
        let (mut square, mut light, mut sum, count) = (0.0, 0.0, 0.0, summed.pixels.len() as f64);
        for (a, b) in summed.pixels.iter().zip(&drawn.pixels) {
            square += (a.luminance - b.luminance).powi(2) / count;
            sum += (a.luminance - b.luminance) / count;
            light += b.luminance / count;
        }
        let (off, bias, noise) = (square.sqrt() / light, sum / light, report.noise.hypot(other.noise));
        println!(
            "{position:?}: off {off}, bias {bias}, noise {noise}, {} against {} samples",
            report.samples, other.samples
        );
        assert!(report.samples < other.samples / 20);
        assert!(
            off < 1.2 * noise && bias.abs() < report.predicted_model_error + 0.001,
            "{position:?}: {off} {bias} {noise}"
        );
    }
}

/// Where another shape may stand before the sky, and where few samples do, light is drawn by chance.
#[test]
fn sums_are_left_out_where_they_do_not_hold_or_do_not_pay() {
    let dir = tempfile::tempdir().unwrap();
    table(dir.path());
    sky(dir.path());
    let ball = "[[shape]]\ntype = \"sphere\"\ncenter = [0, 0, 30]\nradius = 20\nmaterial = \"a\"\n";
    for (more, samples, error) in [(ball, 1 << 16, 0.01), ("", 16, 0.01), ("", 1 << 16, 1.0)] {
        let scene = Scene::parse(&lit([0.0, 30.0, 500.0], more)).unwrap();
        let (_, report) = render(&scene, dir.path(), &settings(samples, error), &Silent).unwrap();
        assert!(!report.materials["a"].method.contains("summed"), "{:?}", report.materials);
    }
}

/// A white sky is seen as it is in a lossless table, up to the horizon.
#[test]
fn white_stays_white_when_it_is_summed_up() {
    let dir = tempfile::tempdir().unwrap();
    table(dir.path());
    let text = plane(0.0, 30.0, &format!("{LUT}lossless = true\n{SKY}"));
    let ready = Ready::new(&Scene::parse(&text).unwrap(), dir.path(), Accuracy::new(1e-3, None), &Silent).unwrap();
    let flat = Flat::new(&ready, 0, 128, &Silent).unwrap().unwrap();
    let Some(Diffraction::Table(table)) = &ready.materials[0].diffraction else { panic!("no table") };
    for angle in [0.0_f64, 40.0, 65.0, 80.0, 88.0, 89.5] {
        for azimuth in [10.0_f64, 75.0, 200.0] {
            let ((sin, cos), (s, c)) = (angle.to_radians().sin_cos(), azimuth.to_radians().sin_cos());
            let view = [sin * c, sin * s, cos];
            let (found, whole) = (flat.at(0, view), table.whole(view));
            for k in 0..3 {
                let white = found[k] * table.scale / whole[k];
                assert!((white - 1.0).abs() < 0.005, "{angle}° {azimuth}°: {white}");
            }
        }
    }
}

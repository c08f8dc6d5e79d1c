//! Tests of height fields under an environment, against sums over all directions.

use super::*;
use crate::light::viewer::RANGE;
use crate::material::diffraction::Diffraction;
use crate::material::diffraction::power_table::PowerTable;
use nacre_brdf::height::{Scale, read};
use nacre_brdf::{Densities, Workspace};
use std::f64::consts::PI;

/// Tabulated densities of a field 0.26 µm deep match the exact ones.
#[test]
fn tabled_densities_are_densities() {
    let dir = tempfile::tempdir().unwrap();
    heights(dir.path());
    let field = read(&dir.path().join("heights.exr"), &Scale::default()).unwrap();
    let densities = Densities::new(&field, 2.88, 1e-4, 1e7, &Silent).unwrap();
    let table = PowerTable::new(&densities, field.range_um(), 0.01, &Silent).unwrap().expect("a table");
    assert!(table.error < 0.005, "{}", table.error);
    assert!(PowerTable::new(&densities, field.range_um(), 1e-7, &Silent).unwrap().is_none());
    let (mut off, mut sum, mut w) = (0.0, 0.0, Workspace::default());
    for k in 0..4000 {
        let [a, b, c] = Stream::of(k).numbers();
        let place = [a, b].map(|v| 3.0 * v - 1.5);
        let q = c * 2.0 * TAU * RANGE[1];
        let truth = densities.at(place, q, &mut w);
        off += (table.at(place, q) - truth).abs();
        sum += truth;
    }
    // Measured: 0.2 %.
    assert!(off < 0.005 * sum, "{off} {sum}");
}

/// Light of a sky with a lamp reflected by a lossless field towards a view. The sum covers 90 × 180 directions at 40
/// wave numbers, directly from the densities and Stam's equation.
fn summed(prepared: &PreparedScene, densities: &Densities, view: [f64; 3]) -> f64 {
    let (n, numbers) = (90, 40);
    let sky = &prepared.skies[0];
    let [least, most] = sky.upsampling.range();
    let (mut sum, mut w) = (0.0, Workspace::default());
    for k in 0..numbers {
        let number = least + (most - least) * (f64::from(k) + 0.5) / f64::from(numbers);
        let colors = sky.upsampling.at(number);
        let (mut seen, mut all) = (0.0, 0.0);
        for i in 0..2 * n * n {
            let (z, azimuth) =
                ((f64::from(i / (2 * n)) + 0.5) / f64::from(n), PI * (f64::from(i % (2 * n)) + 0.5) / f64::from(n));
            let (flat, (sin, cos)) = ((1.0 - z * z).sqrt(), azimuth.sin_cos());
            let light = [flat * cos, flat * sin, z];
            let f = [0, 1].map(|k| (light[k] + view[k]) * number);
            let dot: f64 = (0..3).map(|k| light[k] * view[k]).sum();
            let gain = ((1.0 + dot) / (z + view[2])).powi(2);
            let part = densities.at(f, TAU * number * (z + view[2]), &mut w) * gain;
            let rgb = sky.radiance(light.into());
            all += part;
            seen += part * (0..3).map(|c| rgb[c] * colors[c][1]).sum::<f64>();
        }
        sum += seen / all * (most - least) / f64::from(numbers);
    }
    sum
}

#[test]
fn sampled_light_equals_the_sum_over_all_directions() {
    let dir = tempfile::tempdir().unwrap();
    heights(dir.path());
    flat::sky(dir.path());
    let field = read(&dir.path().join("heights.exr"), &Scale::default()).unwrap();
    // Under environments, with a coherence of half the patch.
    let densities = Densities::new(&field, 0.5 * 64.0 * 0.09, 1e-3, 1e7, &Silent).unwrap();
    for angle in [20.0_f64, 65.0] {
        let more = "[material.a.diffraction]\ntype = \"heightfield\"\nfile = \"heights.exr\"\nlossless = true\n\
                    [[light]]\ntype = \"environment\"\nfile = \"sky.exr\"\n";
        let scene = Scene::parse(&plane(angle, 30.0, more)).unwrap();
        let prepared = PreparedScene::new(&scene, dir.path(), Accuracy::new(1e-2, None), &Silent).unwrap();
        let ((sin, cos), (s, c)) = (angle.to_radians().sin_cos(), 30_f64.to_radians().sin_cos());
        let truth = summed(&prepared, &densities, [sin * c, sin * s, cos]);
        let (picture, report) = render(&scene, dir.path(), &settings(4096, 0.004), &Silent).unwrap();
        let found = picture.pixels.iter().map(|p| p.luminance).sum::<f64>() / 16.0;
        println!("{angle}°: {found} {truth}, noise {} of {} samples", report.noise, report.samples);
        // The mean of 16 pixels has a quarter of their noise, 0.1 %; the errors of the sum itself, the table and the
        // albedo are some tenths of a per cent.
        assert!((found / truth - 1.0).abs() < 0.015, "{angle}: {found} {truth}");
        assert!(matches!(prepared.materials[0].diffraction, Some(Diffraction::Relief(_))));
    }
}

/// If a finer preparation of the scene shared the coarse table, the reported error would be zero.
#[test]
fn the_error_of_the_density_table_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    heights(dir.path());
    flat::sky(dir.path());
    let more = "[material.a.diffraction]\ntype = \"heightfield\"\nfile = \"heights.exr\"\n\
                [[light]]\ntype = \"environment\"\nfile = \"sky.exr\"\n";
    let scene = Scene::parse(&plane(20.0, 30.0, more)).unwrap();
    let asked = Settings { check: true, ..settings(16, 0.05) };
    let (_, report) = render(&scene, dir.path(), &asked, &Silent).unwrap();
    let measured = report.measured_model_error.unwrap();
    // A quarter of the target error is available for truncation.
    assert!(measured > 1e-5 && measured < 0.0125 && report.predicted_model_error > 1e-5, "{report:?}");
}

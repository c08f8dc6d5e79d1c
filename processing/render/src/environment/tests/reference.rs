use super::{lattice, random, room};
use crate::environment::planar::cells as cells_of;
use crate::environment::reference::dot;
use crate::environment::{Environment, Frame, Lights, Reflection, Table, geometry, normalized_error, planar};
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// A smooth rotationally symmetric table, whose integral has another closed evaluation.
fn round(width: f64) -> Table {
    Table::from_fn(256, 0.7, |[x, y]| [(-(x * x + y * y) / (2.0 * width * width)).exp(), 1.0, 0.5]).unwrap()
}

/// The integral of the first channel over the hemisphere, in polar coordinates around the normal.
fn polar(width: f64) -> f64 {
    let n = 20_000;
    let ring = |k: i32| {
        let sin = 0.7 * (f64::from(k) + 0.5) / f64::from(n);
        let cos = (1.0 - sin * sin).sqrt();
        TAU * sin / cos * 0.7 / f64::from(n) * (1.0 + cos).powi(2) * (-(sin * sin) / (2.0 * width * width)).exp()
    };
    (0..n).map(ring).sum()
}

#[test]
fn a_white_furnace_gives_the_albedo() {
    let lights = Lights::new(&Environment::constant([1.0, 1.0, 1.0]), 200);
    let truth = polar(0.1);
    for direction in [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.36, -0.48, -0.8]] {
        let frame = Frame::facing(direction, 0.3);
        let found = lights.by_table(&round(0.1), &frame, direction);
        assert!((found[0] / truth - 1.0).abs() < 0.005, "{} {truth}", found[0]);
        assert!((found[1] / found[2] - 2.0).abs() < 1e-6);
    }
    // A Lambertian surface under constant light reflects the incident radiance.
    let view = [0.6, 0.0, 0.8];
    let white = lights.reflected(&Frame::FLAT, view, |light, _| [light[2] / PI; 3]);
    assert!((white[0] - 1.0).abs() < 1e-3, "{white:?}");
}

#[test]
fn frames_stand_at_right_angles() {
    for k in 0..50 {
        let (z, azimuth) = (2.0 * random(k) - 1.0, TAU * random(k + 99));
        let across = (1.0_f64 - z * z).sqrt();
        let frame = Frame::facing([across * azimuth.cos(), across * azimuth.sin(), z], TAU * random(k + 999));
        let Frame { tangent: t, bitangent: b, normal: n } = frame;
        for (value, wanted) in
            [(dot(t, b), 0.0), (dot(t, n), 0.0), (dot(b, n), 0.0), (dot(t, t), 1.0), (dot(b, b), 1.0)]
        {
            assert!((value - wanted).abs() < 1e-12);
        }
        let cross = [t[1] * b[2] - t[2] * b[1], t[2] * b[0] - t[0] * b[2], t[0] * b[1] - t[1] * b[0]];
        assert!((dot(cross, n) - 1.0).abs() < 1e-12);
    }
    let up = Frame::facing([1.0, 0.0, 0.0], FRAC_PI_2);
    assert!(dot(up.bitangent, [0.0, 0.0, 1.0]) > 0.999_999);
}

/// Compares the correlation with a direct sum over the same cells, with the square unexpanded.
#[test]
fn flat_samples_agree_with_direct_sums() {
    let (environment, table, n) = (room(128), lattice(64, 0.7, [0.2, 1.7], 0.15, 0.04), 48);
    let frame = Frame::facing([0.48, 0.6, 0.64], 0.7);
    let found = planar(&table, &environment, &frame, n).unwrap();
    let cells = cells_of(&environment, &frame, n);
    let mut direct = vec![[0.0_f32; 3]; n * n];
    for (i, out) in direct.iter_mut().enumerate() {
        let Some(view) = Reflection::direction(n, i) else { continue };
        let mut sum = [0.0_f64; 3];
        for (j, cell) in cells.iter().enumerate() {
            let Some((light, power)) = cell else { continue };
            let [a, b] = [j % n + i % n, j / n + n - 1 - i / n];
            let [x, y] = [a, b].map(|k| 2.0 * (k as f64 + 1.0) / n as f64 - 2.0);
            let s = table.at([x, y]);
            // A cell with its centre beyond the rim has no direction there.
            let inside = (x - view[0]).hypot(y - view[1]) < 1.0;
            let half = 0.5 * (x * x + y * y + (light[2] + view[2]).powi(2));
            let factor = if inside { 1.0 + dot(*light, view) } else { half }.powi(2) / view[2];
            (0..3).for_each(|c| sum[c] += f64::from(s[c]) * power[c] * factor);
        }
        *out = sum.map(|v| v as f32);
    }
    let error = normalized_error(&found.rgb, &direct);
    assert!(error < 1e-6, "{error}");
    let worst = found.rgb.as_flattened().iter().zip(direct.as_flattened()).filter(|(_, d)| **d > 1e-3);
    let worst = worst.fold(0.0_f32, |m, (f, d)| m.max((f / d - 1.0).abs()));
    assert!(worst < 1e-4, "{worst}");
}

#[test]
fn flat_samples_agree_with_the_sky_summed_up() {
    let (environment, table) = (room(256), round(0.1));
    let size = 320;
    let found = planar(&table, &environment, &Frame::FLAT, size).unwrap();
    let lights = Lights::new(&environment, 2);
    for i in [size * size / 2 + size / 2, size * 120 + 170, size * 160 + 100, size * 70 + 150] {
        let view = Reflection::direction(size, i).unwrap();
        let truth = lights.by_table(&table, &Frame::FLAT, view);
        for (own, truth) in found.rgb[i].iter().zip(truth) {
            assert!((f64::from(*own) / truth - 1.0).abs() < 0.01, "{i}: {own} {truth}");
        }
    }
    // White-furnace test, away from the rim.
    let white = planar(&table, &Environment::constant([1.0; 3]), &Frame::FLAT, size).unwrap();
    let middle = white.rgb[size * size / 2 + size / 2];
    assert!((f64::from(middle[0]) / polar(0.1) - 1.0).abs() < 0.005, "{middle:?} {}", polar(0.1));
    assert!(planar(&table, &environment, &Frame::FLAT, 100_000).is_err());
}

#[test]
fn turning_sample_light_and_view_together_changes_nothing() {
    let (environment, table) = (room(128), lattice(64, 0.7, [0.2, 1.7], 0.15, 0.04));
    let turn = TAU * 10.0 / 128.0;
    let (sin, cos) = turn.sin_cos();
    let about = |[x, y, z]: [f64; 3]| [x * cos - y * sin, x * sin + y * cos, z];
    let frame = Frame::facing([0.48, 0.6, 0.64], 0.7);
    let turned =
        Frame { tangent: about(frame.tangent), bitangent: about(frame.bitangent), normal: about(frame.normal) };
    let view = frame.world([0.28, -0.1, (1.0_f64 - 0.28 * 0.28 - 0.01).sqrt()]);
    let before = Lights::new(&environment, 1).by_table(&table, &frame, view);
    let after = Lights::new(&environment.turned(turn), 1).by_table(&table, &turned, about(view));
    assert!(before.iter().zip(after).all(|(a, b)| (a / b - 1.0).abs() < 1e-5), "{before:?} {after:?}");
    // Only the orientation of the sample matters.
    let other = Lights::new(&environment, 1).by_table(&table, &turned, view);
    assert!((other[0] / before[0] - 1.0).abs() > 1e-3);
}

#[test]
fn nothing_is_seen_from_below() {
    assert_eq!(geometry([0.0, 0.0, -1.0], [0.0, 0.0, 1.0]), 0.0);
    let lights = Lights::new(&room(32), 1);
    assert_eq!(lights.by_table(&round(0.1), &Frame::FLAT, [0.0, 0.6, -0.8]), [0.0; 3]);
}

#[test]
fn tables_that_are_none_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lut.exr");
    let write = |channels: &[&str], extent: &str, value: f32| {
        let attributes = [("extent", nacre_image::Attribute::Text(extent.into()))];
        nacre_image::write_exr(&path, 8, 8, channels, &attributes, &|_, _, row| row.fill(value)).unwrap();
        Table::read(&path).map(|t| t.extent).map_err(|e| e.to_string())
    };
    assert_eq!(write(&["X", "Y", "Z", "coverage"], "0.7", 1.0), Ok(0.7));
    for (channels, extent, value, word) in [
        (&["R", "G", "B"][..], "0.7", 1.0, "no channel X"),
        (&["X", "Y", "Z"], "much", 1.0, "extent"),
        (&["X", "Y", "Z"], "3", 1.0, "at most 2"),
        (&["X", "Y", "Z"], "0.7", f32::INFINITY, "infinite"),
        (&["X", "Y", "Z"], "0.7", f32::NAN, "no entry"),
    ] {
        let words = write(channels, extent, value).unwrap_err();
        assert!(words.contains("lut.exr") && words.contains(word), "{words}");
    }
}

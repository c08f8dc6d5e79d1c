//! Height fields from files and formulas.

use super::*;
use nacre_image::{Attribute, write_exr, write_png8};
use std::path::Path;

fn data(name: &str) -> Option<std::path::PathBuf> {
    let folder = std::env::var_os("NACRE_TEST_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"), std::path::PathBuf::from);
    let path = folder.join(name);
    if !path.exists() {
        println!("skipped: {} is not there", path.display());
    }
    path.exists().then_some(path)
}

fn scale(pixel_um: impl Into<Option<f64>>, range_um: impl Into<Option<f64>>) -> Scale {
    Scale { pixel_um: pixel_um.into(), range_um: range_um.into(), ..Scale::default() }
}

#[test]
fn images_grids_and_maps_hold_the_same_heights() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let grey: Vec<u8> = (0..12).map(|k| k * 20).collect();
    write_png8(&path("a.png"), 4, 3, 1, &grey).unwrap();
    let from_png = read(&path("a.png"), &scale(0.1, 2.55)).unwrap();
    assert_eq!((from_png.width, from_png.height), (4, 3));
    assert!((from_png.step_um.unwrap() - 0.01).abs() < 1e-12);
    let rgb: Vec<u8> = grey.iter().flat_map(|v| [*v; 3]).collect();
    write_png8(&path("rgb.png"), 4, 3, 3, &rgb).unwrap();
    assert!(
        read(&path("rgb.png"), &scale(0.1, 2.55))
            .unwrap()
            .um
            .iter()
            .zip(&from_png.um)
            .all(|(a, b)| (a - b).abs() < 1e-12)
    );
    let nm: String = grey
        .chunks(4)
        .map(|r| r.iter().map(|v| format!("{} ", u32::from(*v) * 10)).collect::<String>() + "\n")
        .collect();
    std::fs::write(path("a.txt"), format!("Real Width : 0.4 µm\nReal Height : 300 nm\nZ Unit : nm\n\n{nm}")).unwrap();
    let from_text = read(&path("a.txt"), &Scale::default()).unwrap();
    assert!((from_text.pixel_um - 0.1).abs() < 1e-12);
    let attributes = [("units", Attribute::Text("µm".into())), ("pixel_um", Attribute::Number(0.1))];
    write_exr(&path("a.exr"), 4, 3, &["height"], &attributes, &|_, y, row| {
        row.iter_mut().enumerate().for_each(|(x, v)| *v = from_png.um[y * 4 + x] as f32);
    })
    .unwrap();
    let from_map = read(&path("a.exr"), &Scale::default()).unwrap();
    for (k, truth) in from_png.um.iter().enumerate() {
        assert!((from_text.um[k] - truth).abs() < 1e-9 && (from_map.um[k] - truth).abs() < 1e-6, "{k}");
    }
}

#[test]
fn what_is_no_height_field_is_refused_in_words() {
    let dir = tempfile::tempdir().unwrap();
    let refused = |name: &str, bytes: &[u8], scale: &Scale, word: &str| {
        let path = dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let problem = read(&path, scale).unwrap_err().to_string();
        assert!(problem.contains(word), "{name}: {problem}");
    };
    let full = scale(0.1, 1.0);
    refused("nan.txt", b"1 2\n3 nan\n", &full, "column 1, row 1");
    refused("ragged.txt", b"1 2\n3 4 5\n", &full, "line 2");
    refused("words.txt", b"1 2\nhello\n", &full, "line 2");
    refused("empty.txt", b"", &full, "neither");
    refused("header.txt", b"Image Width : 5\n1 2\n3 4\n", &full, "5");
    refused("pitch.txt", b"1 2\n3 4\n", &scale(None, 1.0), "--pixel-um");
    refused("range.txt", b"1 2\n3 4\n", &scale(0.1, None), "--range-um");
    refused("oblong.txt", b"Real Width: 4 nm\nReal Height: 33 nm\nZ Unit: nm\n1 2\n3 4\n", &Scale::default(), "4 : 1");
    refused("huge.txt", b"1 2\n3 1e9\n", &scale(1.0, 5000.0), "1000 µm");
    refused("zero.txt", b"1 2\n3 4\n", &scale(0.0, 1.0), "--pixel-um");
    refused("cut.png", b"\x89PNG\r\n\x1a\n", &full, "damaged");
    let path = dir.path().join("colour.png");
    write_png8(&path, 2, 1, 3, &[9, 9, 9, 200, 0, 0]).unwrap();
    assert!(read(&path, &full).unwrap_err().to_string().contains("coloured"));
    assert!(read(&path, &Scale::default()).unwrap_err().to_string().contains("--pixel-um"));
    assert!(read(dir.path(), &full).is_err());
    assert!(read(&dir.path().join("missing"), &full).unwrap_err().to_string().contains("missing"));
}

#[test]
fn levelling_takes_a_plane_away_and_nothing_else() {
    let wave = |x: f64| 0.1 * (std::f64::consts::TAU * (x - 31.5) / 8.0).cos();
    let um = |tilt: [f64; 2]| -> Vec<f64> {
        (0..64 * 32)
            .map(|k| (k % 64, k / 64))
            .map(|(x, y)| wave(x as f64) + 0.5 * (tilt[0] * x as f64 - tilt[1] * y as f64))
            .collect()
    };
    let tilted = HeightField::new("test", 64, 32, 0.5, um([0.01, -0.02])).unwrap();
    let [right, up] = tilted.tilt();
    assert!((right - 0.01).abs() < 1e-4 && (up + 0.02).abs() < 1e-4, "{right} {up}");
    let (level, truth) = (tilted.levelled(), HeightField::new("test", 64, 32, 0.5, um([0.0; 2])).unwrap().levelled());
    assert!(level.um.iter().zip(&truth.um).all(|(a, b)| (a - b).abs() < 1e-12));
    assert!(level.tilt().iter().all(|t| t.abs() < 1e-12));
}

#[test]
fn periods_and_directions_are_found() {
    for (period, angle_deg) in [(2.5, 0.0_f64), (1.7, 30.0), (3.3, 117.0)] {
        let s = Synthetic {
            shape: Shape::Grating(Profile::Sinusoid),
            pixels: 256,
            pixel_um: 0.15,
            period_um: period,
            depth_um: 0.2,
            angle: angle_deg.to_radians(),
        };
        let quality = Quality::of(&s.field().unwrap(), 65.0);
        let first = quality.periods[0];
        let turned = (first.direction_deg - angle_deg).abs();
        assert!((first.period_um - period).abs() < 0.1 * first.resolution_um, "{first:?}");
        assert!(turned.min(180.0 - turned) < 0.3 && first.share > 0.9, "{first:?}");
    }
}

#[test]
fn patches_that_do_not_repeat_are_told_from_those_that_do() {
    let make = |shape, pixels| {
        Synthetic { shape, pixels, pixel_um: 0.1, period_um: 2.5, depth_um: 0.3, angle: 0.0 }.field().unwrap()
    };
    for profile in [Profile::Sinusoid, Profile::Blazed, Profile::Rectangular { duty: 0.4 }] {
        assert!(Quality::of(&make(Shape::Grating(profile), 200), 65.0).is_periodic(), "{profile:?}");
    }
    assert!(!Quality::of(&make(Shape::Grating(Profile::Sinusoid), 212), 65.0).is_periodic());
    let warned = |field: &HeightField, word: &str| {
        let quality = Quality::of(field, 65.0);
        assert!(quality.warnings.iter().any(|w| w.contains(word)), "{word}: {:?}", quality.warnings);
    };
    warned(&make(Shape::Fingers, 230), "repeated");
    warned(&make(Shape::TwoRegions, 400), "smaller than the coherence length");
    warned(&HeightField::new("t", 8, 8, 0.1, vec![1.0; 64]).unwrap(), "flat");
    let coarse = HeightField { pixel_um: 0.3, ..make(Shape::Cd, 128) };
    warned(&coarse, "too coarse for 380 nm");
}

#[test]
fn real_patches_are_read() {
    if let Some(path) = data("heightfields/silicon_grooves_afm_128x128.txt") {
        let field = read(&path, &Scale::default()).unwrap();
        assert!((field.pixel_um - 10.0 / 128.0).abs() < 1e-9 && (0.5..0.65).contains(&field.range_um()));
        let first = Quality::of(&field, 65.0).periods[0];
        // Nominal pitch of the sample: 2.88 µm.
        assert!((first.period_um - 2.88).abs() < first.resolution_um, "{first:?}");
    }
    for name in ["Elaph100x100.png", "Xeno100x100.png", "BlazingBump.bmp", "CosineBump.bmp", "100x100stamBump.bmp"] {
        if let Some(path) = data(&format!("heightfields/thesis/{name}")) {
            let field = read(&path, &scale(0.1, 0.4)).unwrap();
            assert_eq!((field.width, field.height), (100, 100), "{name}");
            assert!(field.range_um() > 0.1 && field.range_um() <= 0.4, "{name}");
        }
    }
}

#[test]
fn a_patch_that_cuts_a_grating_is_told_from_one_that_does_not() {
    let profiles = [Profile::Sinusoid, Profile::Blazed, Profile::Rectangular { duty: 0.4 }];
    for profile in profiles {
        for (periods, whole) in [
            (1.0, true),
            (2.0, true),
            (3.0, true),
            (5.0, true),
            (8.0, true),
            (12.0, true),
            (2.5, false),
            (3.3, false),
            (4.5, false),
            (7.85, false),
            (12.15, false),
        ] {
            let pixels = (periods * 40.0_f64).round() as usize;
            let shape = Shape::Grating(profile);
            let field = Synthetic { shape, pixels, pixel_um: 0.0625, period_um: 2.5, depth_um: 0.3, angle: 0.0 };
            let quality = Quality::of(&field.field().unwrap(), 65.0);
            assert_eq!(quality.is_periodic(), whole, "{profile:?} {periods}: {:?}", quality.periods);
            assert_eq!(quality.warnings.iter().any(|w| w.contains("repeated")), !whole);
        }
    }
}

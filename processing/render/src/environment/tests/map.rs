use crate::environment::Environment;
use std::f64::consts::{PI, TAU};
use std::path::Path;

/// A picture without symmetry: 18 × 9 pixels with a black half and a bright pixel.
fn uneven() -> Environment {
    let at = |i: usize| {
        let (x, y) = (i % 18, i / 18);
        if x < 6 { [0.0; 3] } else { [1.0 + x as f32, 2.0 * y as f32, if (x, y) == (9, 2) { 500.0 } else { 0.5 }] }
    };
    Environment::of(18, 9, (0..162).map(at).collect()).unwrap()
}

#[test]
fn axes_have_their_documented_directions() {
    let mut rgb = vec![[0.0; 3]; 64 * 32];
    rgb[32] = [3.0, 0.0, 0.0];
    let environment = Environment::of(64, 32, rgb).unwrap();
    assert_eq!(environment.place([0.0, 0.0, 1.0])[1], 0.0);
    assert_eq!(environment.place([1.0, 0.0, 0.0]), [32.0, 16.0]);
    assert_eq!(environment.place([0.0, 1.0, 0.0]), [16.0, 16.0], "azimuth grows to the left");
    for (x, y) in [(0.5, 0.5), (40.25, 17.0), (63.0, 31.5)] {
        let [u, v] = environment.place(environment.direction(x, y));
        assert!((u - x).abs() < 1e-9 && (v - y).abs() < 1e-9);
    }
    let direction = environment.direction(32.5, 0.5);
    assert!((environment.radiance(direction)[0] - 3.0).abs() < 1e-6);
}

#[test]
fn density_integrates_to_one_and_is_that_of_sampling() {
    for environment in [uneven(), Environment::constant([1.0, 0.5, 0.0]), Environment::constant([0.0; 3])] {
        let mut whole = 0.0;
        for y in 0..environment.height {
            for x in 0..environment.width {
                whole += environment.density(environment.direction(x as f64 + 0.5, y as f64 + 0.5))
                    * environment.solid_angle(y);
            }
        }
        assert!((whole - 1.0).abs() < 1e-12);
        // Irradiance of a horizontal plane by sampling and by summation: the mean of value over density is unbiased,
        // and its variance is small here.
        let (mut drawn, mut count) = (0.0, 0.0);
        // Roberts' sequence fills the square evenly.
        for k in 0..400_000 {
            let u = [0.754_877_666_246_69, 0.569_840_290_998_05].map(|step| (f64::from(k) * step).fract());
            let (direction, radiance, density) = environment.sample(u);
            assert!(density > 0.0 && (environment.density(direction) / density - 1.0).abs() < 1e-6);
            drawn += f64::from(radiance[0]) * direction[2].max(0.0) / density;
            count += 1.0;
        }
        let (mut truth, n) = (0.0, 400);
        for i in 0..n {
            for j in 0..2 * n {
                let (z, azimuth) = ((f64::from(i) + 0.5) / f64::from(n), (f64::from(j) + 0.5) / f64::from(2 * n) * TAU);
                let r = (1.0 - z * z).sqrt();
                truth += f64::from(environment.radiance([r * azimuth.cos(), r * azimuth.sin(), z])[0]) * z;
            }
        }
        truth *= TAU / f64::from(n) / f64::from(2 * n);
        assert!((drawn / count - truth).abs() <= 3e-3 * truth, "{} {truth}", drawn / count);
    }
}

#[test]
fn turning_moves_the_light_anticlockwise() {
    let environment = uneven();
    let quarter = environment.turned(TAU / 9.0);
    let direction = environment.direction(12.3, 4.2);
    let (sin, cos) = (TAU / 9.0).sin_cos();
    let turned = [direction[0] * cos - direction[1] * sin, direction[0] * sin + direction[1] * cos, direction[2]];
    let [before, after] = [environment.radiance(direction), quarter.radiance(turned)];
    assert!(before.iter().zip(after).all(|(a, b)| (a - b).abs() < 1e-4 * a.abs().max(1.0)), "{before:?} {after:?}");
    assert_eq!(environment.turned(TAU).rgb, environment.rgb);
}

#[test]
fn halving_keeps_the_light() {
    let flux = |e: &Environment| {
        e.rgb.iter().enumerate().map(|(i, p)| f64::from(p[2]) * e.solid_angle(i / e.width)).sum::<f64>()
    };
    for environment in [uneven(), uneven().halved(), Environment::constant([2.0; 3])] {
        let half = environment.halved();
        assert!((flux(&half) / flux(&environment) - 1.0).abs() < 1e-6);
    }
    assert!((flux(&Environment::constant([1.0; 3])) / (4.0 * PI) - 1.0).abs() < 1e-9);
}

/// A picture with one value in column 5, row 3.
fn sky_with(path: &Path, [width, height]: [usize; 2], bad: f32) {
    let value = |_: usize, y: usize, row: &mut [f32]| {
        row.fill(1.0);
        if y == 3 {
            row[5] = bad;
        }
    };
    nacre_image::write_exr(path, width, height, &["R", "G", "B"], &[], &value).unwrap();
}

#[test]
fn bad_radiance_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.exr");
    for (bad, word) in [(f32::NAN, "NaN"), (f32::INFINITY, "inf"), (-0.5, "-0.5")] {
        sky_with(&path, [8, 4], bad);
        let words = Environment::read(&path, None).unwrap_err().to_string();
        assert!(words.contains("sky.exr") && words.contains(word) && words.contains("column 5, row 3"), "{words}");
    }
    nacre_image::write_exr(&path, 16, 16, &["R", "G", "B"], &[], &|_, _, row| row.fill(1.0)).unwrap();
    assert!(Environment::read(&path, None).unwrap_err().to_string().contains("twice as wide"));
    nacre_image::write_exr(&path, 16, 8, &["R", "G", "B"], &[], &|_, _, row| row.fill(-1e-9)).unwrap();
    assert!(Environment::read(&path, None).is_err());
    assert!(Environment::of(2, 2, vec![[0.0; 3]; 3]).is_err());
    assert!(Environment::of(usize::MAX, 2, vec![]).is_err());
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        assert!(Environment::of(2, 1, vec![[1.0; 3], [bad; 3]]).is_err());
    }
}

/// Suns beyond the range of half floats, and single NaN pixels: one of 512.
#[test]
fn a_few_infinities_are_clamped_with_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.exr");
    for (bad, counts_as, words) in [
        (f32::INFINITY, 1.0, "infinite radiance, which counts as 1, the brightest finite one: 1"),
        (f32::NAN, 0.0, "no number, which count as black: 1"),
        (f32::NEG_INFINITY, 0.0, "no number, which count as black: 1"),
    ] {
        sky_with(&path, [32, 16], bad);
        let sky = Environment::read(&path, None).unwrap();
        assert_eq!((sky.rgb[3 * 32 + 5], sky.rgb[0]), ([counts_as; 3], [1.0; 3]));
        let warnings = sky.warnings().join("; ");
        assert!(warnings.contains("sky.exr") && warnings.contains(words), "{warnings}");
    }
    let value = |_: usize, y: usize, row: &mut [f32]| {
        row.fill(if y == 0 { 1e6 } else { 1.0 });
        row[7] = if y == 1 { f32::INFINITY } else { row[7] };
    };
    nacre_image::write_exr(&path, 32, 16, &["Y"], &[], &value).unwrap();
    assert_eq!(Environment::read(&path, None).unwrap().rgb[32 + 7], [1e6; 3]);
}

/// Properties of the file's pixels reach the environment and its warnings.
#[test]
fn exposure_and_layers_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.hdr");
    let mut bytes = b"#?RGBE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=0.25\n\n-Y 2 +X 4\n".to_vec();
    bytes.extend([128, 128, 128, 129].repeat(8));
    std::fs::write(&path, &bytes).unwrap();
    let sky = Environment::read(&path, None).unwrap();
    assert_eq!(sky.rgb, [[4.0; 3]; 8]);
    assert!(sky.warnings().join("").contains("exposure"), "{:?}", sky.warnings());
    let path = folder.path().join("sky.exr");
    let names = ["day.R", "day.G", "day.B", "night.R", "night.G", "night.B"];
    nacre_image::write_exr(&path, 4, 2, &names, &[], &|c, _, row| row.fill(if c < 3 { 5.0 } else { 0.5 })).unwrap();
    assert_eq!(Environment::read(&path, Some("day")).unwrap().rgb[0], [5.0; 3]);
    let words = Environment::read(&path, None).unwrap_err().to_string();
    assert!(words.contains("\"day\", \"night\"") && words.contains("layer = "), "{words}");
    let light = "[[light]]\ntype = \"environment\"\nfile = \"sky.exr\"\nlayer = \"night\"\n";
    assert!(toml::from_str::<toml::Table>(light).is_ok());
}

#[test]
fn radiance_files_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sky.hdr");
    let mut bytes = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n".to_vec();
    // Mantissas over 256 times a power of two: 128 with exponent 129 is one.
    for k in 0..8_u8 {
        bytes.extend([128, 64, if k == 5 { 255 } else { 0 }, 129]);
    }
    std::fs::write(&path, &bytes).unwrap();
    let environment = Environment::read(&path, None).unwrap();
    assert_eq!([environment.width, environment.height], [4, 2]);
    assert_eq!(environment.rgb[0][..2], [1.0, 0.5]);
    assert!((environment.rgb[5][2] - 255.0 / 128.0).abs() < 1e-6);
    std::fs::write(&path, &bytes[..50]).unwrap();
    assert!(Environment::read(&path, None).unwrap_err().to_string().contains("sky.hdr"));
}

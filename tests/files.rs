//! Photographs and files as written by other programs.

#![allow(clippy::unwrap_used)]

use image::{ImageBuffer, Luma, Rgb};
use nacre_tests::nacre;
use serde_json::Value;
use std::path::Path;

/// Light behind an analyser at `angle` degrees, 0 to 1: linear polarization whose orientation changes to the right and
/// whose degree increases downwards.
fn light(x: u32, y: u32, angle: f64) -> f64 {
    let (aolp, dolp) = (f64::from(x) * 0.05, 0.1 + 0.01 * f64::from(y));
    let bright = 0.5 + 0.2 * (f64::from(x) / 9.0).sin() * (f64::from(y) / 7.0).cos();
    bright * (1.0 + dolp * (2.0 * (angle.to_radians() - aolp)).cos()) / 1.6
}

/// Writes a series of 16-bit photographs with values up to `white`.
fn series(folder: &Path, angles: &[f64], white: f64, gain: f64) {
    for angle in angles {
        let value = |x, y| (gain * light(x, y, *angle) * white).min(white).round() as u16;
        let picture = ImageBuffer::from_fn(64, 48, |x, y| Luma([value(x, y)]));
        picture.save(folder.join(format!("{angle:03}.png"))).unwrap();
    }
}

/// Imports a folder into `series` and reconstructs it; returns both reports.
fn measured(folder: &Path, options: &[&str]) -> (Value, Value) {
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let [photographs, series, result] = ["photos", "series", "result"].map(path);
    let import = [&["--json", "import", &photographs, "--out", &series][..], options].concat();
    let imported = nacre(import).expect(0).json();
    nacre(["reconstruct", "polarization", &series, "--out", &result]).expect(0);
    let report = std::fs::read(folder.join("result/report.json")).unwrap();
    (imported, serde_json::from_slice(&report).unwrap())
}

fn photos(folder: &tempfile::TempDir) -> std::path::PathBuf {
    let photos = folder.path().join("photos");
    std::fs::create_dir(&photos).unwrap();
    photos
}

fn warned(report: &Value, words: &str) -> bool {
    report["warnings"].as_array().unwrap().iter().any(|w| w.as_str().unwrap().contains(words))
}

#[test]
fn clipping_below_white_is_found_and_a_given_white_masks_it() {
    let folder = tempfile::tempdir().unwrap();
    series(&photos(&folder), &[0.0, 45.0, 90.0, 135.0], 4095.0, 2.0);
    let (imported, report) = measured(folder.path(), &[]);
    assert!(warned(&imported, "--white 4095"), "{}", imported["warnings"]);
    assert!(warned(&report, "4095"), "{}", report["warnings"]);
    let other = tempfile::tempdir().unwrap();
    series(&photos(&other), &[0.0, 45.0, 90.0, 135.0], 4095.0, 2.0);
    let (imported, report) = measured(other.path(), &["--white", "4095"]);
    assert!(!warned(&imported, "4095") && !warned(&report, "4095"));
    assert!(report["pixels"]["saturated"].as_u64().unwrap() > 100, "{}", report["pixels"]);
    // Bright, but not clipped.
    let dim = tempfile::tempdir().unwrap();
    series(&photos(&dim), &[0.0, 45.0, 90.0, 135.0], 4095.0, 1.0);
    assert!(!warned(&measured(dim.path(), &[]).1, "saturated"));
}

/// Writes a frame of a polarization sensor with this layout, in one or three channels.
fn sensor(folder: &Path, layout: [f64; 4], colour: bool) {
    let value = |x: u32, y: u32| {
        let angle = layout[(x % 2 + 2 * (y % 2)) as usize];
        (light(x / 2, y / 2, angle) * 60_000.0).round() as u16
    };
    let file = folder.join("frame.png");
    if colour {
        ImageBuffer::from_fn(128, 96, |x, y| Rgb([value(x, y); 3])).save(file).unwrap();
    } else {
        ImageBuffer::from_fn(128, 96, |x, y| Luma([value(x, y)])).save(file).unwrap();
    }
}

#[test]
fn a_sensor_layout_is_checked_against_the_photograph() {
    let kind = ["--kind", "division-of-focal-plane"];
    for (real, other) in [
        ([90.0, 45.0, 135.0, 0.0], "0,45,90,135"),
        ([0.0, 45.0, 90.0, 135.0], "90,45,135,0"),
        ([45.0, 135.0, 0.0, 90.0], "90,45,135,0"),
    ] {
        let layout = real.map(|a| a.to_string()).join(",");
        let folder = tempfile::tempdir().unwrap();
        sensor(&photos(&folder), real, false);
        let (_, right) = measured(folder.path(), &[&kind[..], &["--layout", &layout]].concat());
        assert!(!warned(&right, "contradicts"), "{layout}: {}", right["warnings"]);
        let folder = tempfile::tempdir().unwrap();
        sensor(&photos(&folder), real, false);
        let (_, wrong) = measured(folder.path(), &[&kind[..], &["--layout", other]].concat());
        assert!(warned(&wrong, "contradicts the photographs"), "{layout}: {}", wrong["warnings"]);
    }
}

#[test]
fn colour_photographs_have_a_default_and_equal_channels_are_grey() {
    let folder = tempfile::tempdir().unwrap();
    sensor(&photos(&folder), [90.0, 45.0, 135.0, 0.0], true);
    let (imported, report) = measured(folder.path(), &["--kind", "division-of-focal-plane"]);
    assert!(warned(&imported, "taken as grey"), "{}", imported["warnings"]);
    assert_eq!(report["width"], 64);
    let folder = tempfile::tempdir().unwrap();
    let photos = photos(&folder);
    for angle in [0.0, 60.0, 120.0] {
        let value = |x, y| (light(x, y, angle) * 60_000.0) as u16;
        let picture = ImageBuffer::from_fn(16, 16, |x, y| Rgb([7, value(x, y), 9]));
        picture.save(photos.join(format!("{angle}.png"))).unwrap();
    }
    // Files that the import lists as ignored.
    std::fs::write(photos.join("000.mov"), "film").unwrap();
    std::fs::write(photos.join("notes.txt"), "f/8").unwrap();
    let (imported, _) = measured(folder.path(), &[]);
    assert_eq!(imported["channel"], "g");
    assert!(warned(&imported, "green"), "{}", imported["warnings"]);
    assert!(imported["skipped"].as_array().unwrap().iter().all(|s| s == "000.mov"), "{}", imported["skipped"]);
}

#[test]
fn import_decodes_and_names_the_photograph_that_cannot_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let photos = photos(&folder);
    series(&photos, &[0.0, 45.0, 90.0, 135.0], 65_535.0, 1.0);
    let whole = std::fs::read(photos.join("090.png")).unwrap();
    std::fs::write(photos.join("090.png"), &whole[..whole.len() / 2]).unwrap();
    let refused = nacre(["import", photos.to_str().unwrap()]).expect(2).stderr();
    assert!(refused.contains("090.png"), "{refused}");
    assert!(!photos.join("frames.json").exists());
}

#[test]
fn a_single_raw_frame_of_a_sensor_is_recognised() {
    let folder = tempfile::tempdir().unwrap();
    let photos = photos(&folder);
    sensor(&photos, [90.0, 45.0, 135.0, 0.0], false);
    // A number in the name that is not an angle.
    std::fs::rename(photos.join("frame.png"), photos.join("frame_250.png")).unwrap();
    let refused = nacre(["import", photos.to_str().unwrap()]).expect(2).stderr();
    assert!(refused.contains("--kind division-of-focal-plane") && refused.contains("--layout"), "{refused}");
    series(&photos, &[0.0], 65_535.0, 1.0);
    std::fs::remove_file(photos.join("frame_250.png")).unwrap();
    let refused = nacre(["import", photos.to_str().unwrap()]).expect(2).stderr();
    assert!(refused.contains("3 analyser angles"), "{refused}");
}

/// A raw frame of a colour sensor: recognised, imported by name, and reconstructed with one pixel per 4 × 4.
#[test]
fn a_colour_sensor_is_recognised_and_described_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let photos = photos(&folder);
    let layout = [90.0, 45.0, 135.0, 0.0];
    let value = |x: u32, y: u32| {
        let filter = [0.4, 1.0, 1.0, 0.6][(x / 2 % 2 + 2 * (y / 2 % 2)) as usize];
        (light(x / 4, y / 4, layout[(x % 2 + 2 * (y % 2)) as usize]) * filter * 60_000.0).round() as u16
    };
    ImageBuffer::from_fn(128, 96, |x, y| Luma([value(x, y)])).save(photos.join("frame.png")).unwrap();
    let refused = nacre(["import", photos.to_str().unwrap()]).expect(2).stderr();
    assert!(refused.contains("--layout: sony-colour"), "{refused}");
    let kind = ["--kind", "division-of-focal-plane"];
    let (imported, report) =
        measured(folder.path(), &[&kind[..], &["--layout", "lucid-colour", "--channel", "b"]].concat());
    assert_eq!((&imported["layout"], &imported["channel"]), (&"lucid-colour".into(), &"b".into()));
    assert_eq!((&report["width"], &report["sensor"]["map_pixel_px"]), (&32.into(), &4.into()));
    let wrong = nacre([&["import", photos.to_str().unwrap()][..], &kind, &["--layout", "nikon"]].concat());
    assert!(wrong.expect(2).stderr().contains("sony-colour"));
    let twice = ["--layout", "sony", "--colour", "rggb"];
    let refused = nacre([&["import", photos.to_str().unwrap()][..], &kind, &twice].concat()).expect(2).stderr();
    assert!(refused.contains("--colour"), "{refused}");
}

#[test]
fn photographs_of_one_angle_that_differ_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let photos = photos(&folder);
    series(&photos, &[0.0, 45.0, 90.0, 135.0], 65_535.0, 1.0);
    std::fs::copy(photos.join("045.png"), photos.join("180.png")).unwrap();
    let (_, report) = measured(folder.path(), &[]);
    assert!(warned(&report, "000.png and 180.png are said to be at one analyser angle"), "{}", report["warnings"]);
    std::fs::remove_dir_all(folder.path().join("series")).unwrap();
    std::fs::remove_dir_all(folder.path().join("result")).unwrap();
    std::fs::copy(photos.join("000.png"), photos.join("180.png")).unwrap();
    assert!(!warned(&measured(folder.path(), &[]).1, "one analyser angle"));
}

//! Bokeh photographs from a user's point of view: simulated ones compared with their truth, and invalid input.

#![allow(clippy::unwrap_used)]

use nacre_processing::image::{Attribute, read_exr, write_exr, write_png8, write_png16_gray};
use nacre_tests::http::{Service, begin, finished};
use nacre_tests::{Place, nacre};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Renders a scene into `dir/photo` and returns the folder.
fn rendered(dir: &Path, scene: &str) -> PathBuf {
    let (file, out) = (dir.join("scene.toml"), dir.join("photo"));
    std::fs::write(&file, scene).unwrap();
    nacre(["sim", "photograph", "bokeh", "--force", "--scene", file.to_str().unwrap(), "--out", out.to_str().unwrap()])
        .expect(0);
    out
}

/// Arguments to reconstruct a photograph.
fn args(image: &Path, out: &Path, more: &[&str]) -> Vec<String> {
    let all = ["--json", "reconstruct", "bokeh", image.to_str().unwrap(), "--out", out.to_str().unwrap()];
    all.iter().chain(more).map(|s| (*s).to_owned()).collect()
}

fn reconstructed(image: &Path, out: &Path, more: &[&str]) -> Value {
    nacre(args(image, out, more)).expect(0).json()
}

fn close(found: &Value, truth: f64, relative: f64) {
    let found = found.as_f64().unwrap();
    assert!((found / truth - 1.0).abs() < relative, "{found} {truth}");
}

fn rms(found: &[f32], truth: &[f32]) -> f64 {
    let square: f64 = found.iter().zip(truth).map(|(f, t)| f64::from(f - t).powi(2)).sum();
    (square / truth.len() as f64).sqrt()
}

#[test]
fn lines_slits_and_scale_are_those_of_the_scene() {
    let dir = tempfile::tempdir().unwrap();
    // 48 µm at 2.5 µm per pixel: lines 19.2 pixels apart, 35 % of them bright.
    let photo = rendered(dir.path(), "profile = \"rectangular\"\nduty = 0.35\nperiod_um = 48\nblur_px = 2.2");
    let out = dir.path().join("out");
    let lens = ["--psf-sigma", "2.2", "--lines-per-mm", "20.8333333", "--lens-focal-mm", "250", "--f-number", "5.6"];
    let all: Vec<&str> = lens.into_iter().chain(["--distance-m", "0.85"]).collect();
    let report = reconstructed(&photo.join("photograph.png"), &out, &all);
    close(&report["lines"]["period_px"][0], 19.2, 1e-3);
    close(&report["scale"]["pixel_um"], 2.5, 1e-3);
    close(&report["slits"]["spacing_px"][0], 19.2, 1e-3);
    close(&report["slits"]["width_px"][0], 0.35 * 19.2, 0.03);
    assert_eq!(report["slits"]["count"], 20);
    close(&report["cutoff"]["period_um"], 8.57, 1e-2);
    close(&report["deconvolution"]["noise"]["shot"], 1.0 / 20_000.0, 0.15);
    assert!(report["deconvolution"]["converged"].as_bool().unwrap());
    // Deconvolved light is closer to the truth than the photograph.
    let truth = &read_exr(&photo.join("truth.exr")).unwrap().channels["Y"];
    let found = read_exr(&out.join("deconvolved.exr")).unwrap();
    close(&Value::from(found.attributes["pixel_um"].parse::<f64>().unwrap()), 2.5, 1e-3);
    let raster = nacre_processing::image::read(&photo.join("photograph.png")).unwrap();
    let nacre_processing::image::Samples::U16(codes) = raster.samples else { panic!("16 bits") };
    let photograph: Vec<f32> = codes.iter().map(|c| f32::from(*c) / 65_535.0).collect();
    let (before, after) = (rms(&photograph, truth), rms(&found.channels["Y"], truth));
    assert!(after < 0.65 * before, "{before} {after}");
    for name in ["height.exr", "height.png", "deconvolved.png", "slice.csv", "report.json"] {
        assert!(out.join(name).is_file(), "{name}");
    }
    let table = std::fs::read_to_string(out.join("slice.csv")).unwrap();
    assert_eq!(table.lines().count(), 385);
    assert!(table.starts_with("position_px,position_um,light,light_sigma,height_"), "{table}");
    assert!(nacre(args(&photo.join("photograph.png"), &out, &all)).expect(2).stderr().contains("--force"));
    nacre(args(&photo.join("photograph.png"), &out, &[&all[..], &["--overwrite"]].concat())).expect(0);
}

#[test]
fn a_known_grating_calibrates_the_height_of_another_photograph() {
    let dir = tempfile::tempdir().unwrap();
    let (known, out) = (dir.path().join("known"), dir.path().join("out"));
    let photo = rendered(dir.path(), "profile = \"blazed\"\nperiod_um = 60\ndepth_um = 0.4\nblur_px = 1.5");
    let shape = ["--psf-sigma", "1.5", "--known-shape", "blazed", "--known-depth-um", "0.4", "--pixel-um", "2.5"];
    let report = reconstructed(&photo.join("photograph.png"), &known, &shape);
    let calibration = &report["heights"]["calibration"];
    // Light is 0.15 to 0.8 over 0.4 µm, with mean 0.475.
    close(&calibration["gain_um"], 0.4 / 0.65 * 0.475, 0.05);
    assert!(calibration["rmse_um"].as_f64().unwrap() < 0.1 * 0.4);
    // Another period, another depth under the same light, rotated, with half the exposure.
    let scene =
        "profile = \"sinusoid\"\nperiod_um = 45\ndepth_um = 0.4\nblur_px = 1.5\nlight = [0.075, 0.4]\nangle_deg = 90";
    let photo = rendered(dir.path(), scene);
    let file = known.join("calibration.json");
    let more = ["--psf-sigma", "1.5", "--calibration", file.to_str().unwrap(), "--rotate", "90", "--pixel-um", "2.5"];
    let report = reconstructed(&photo.join("photograph.png"), &out, &more);
    assert_eq!((report["width"].as_u64(), report["height"].as_u64()), (Some(320), Some(384)));
    close(&report["lines"]["period_um"], 45.0, 2e-3);
    let found = read_exr(&out.join("height.exr")).unwrap();
    let truth = read_exr(&photo.join("truth.exr")).unwrap();
    // Rotation by 90° anticlockwise: the right column becomes the top row.
    let turned: Vec<f32> = (0..320 * 384).map(|i| truth.channels["height"][(i % 320) * 384 + 383 - i / 320]).collect();
    let off = rms(&found.channels["height"], &turned);
    assert!(off < 0.06 * 0.4, "{off}");
    assert_eq!(found.attributes["units"], "µm");
}

#[test]
fn tilted_lines_and_crops_are_measured_across() {
    let dir = tempfile::tempdir().unwrap();
    let photo = rendered(dir.path(), "profile = \"sinusoid\"\nperiod_um = 40\nangle_deg = 25\nhighlight_px = 130");
    let image = photo.join("photograph.png");
    let crop = ["--crop", "110,80,160,160", "--psf-sigma", "2", "--slice-width", "3", "--pixel-um", "2.5"];
    let report = reconstructed(&image, &dir.path().join("a"), &crop);
    assert!((report["slice"]["tilt_deg"].as_f64().unwrap() - 25.0).abs() < 1.0, "{report}");
    close(&report["lines"]["period_um"], 40.0, 1e-2);
    assert!(report["warnings"].to_string().contains("turn the result by -2"), "{}", report["warnings"]);
    // Statements of the file that contradict the options are warnings. After the header: an sRGB chunk with its
    // checksum.
    let file = std::fs::read(&image).unwrap();
    let stated = dir.path().join("stated.png");
    std::fs::write(&stated, [&file[..33], b"\0\0\0\x01sRGB\0\xae\xce\x1c\xe9", &file[33..]].concat()).unwrap();
    let report = reconstructed(&stated, &dir.path().join("c"), &[&crop[..], &["--transfer", "linear"]].concat());
    assert!(report["warnings"][0].as_str().unwrap().contains("stated.png states transfer srgb"), "{report}");
    let straight = [&crop[..], &["--rotate", "-25", "--slice", "40,100,160,100"]].concat();
    let report = reconstructed(&image, &dir.path().join("b"), &straight);
    assert!(report["slice"]["tilt_deg"].as_f64().unwrap().abs() < 1.0);
    close(&report["lines"]["period_um"], 40.0, 1e-2);
}

#[test]
fn what_the_lens_cannot_show_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let photo = rendered(dir.path(), "profile = \"sinusoid\"\nperiod_um = 40");
    let out = dir.path().join("out");
    let lens = ["--psf-sigma", "2", "--lens-focal-mm", "250", "--f-number", "5.6", "--distance-m", "0.85"];
    let refused = |more: &[&str], said: &str| {
        let text = nacre(args(&photo.join("photograph.png"), &out, &[&lens[..], more].concat())).expect(2).stderr();
        assert!(text.contains(said), "{said}: {text}");
        assert!(!out.exists());
    };
    // The paper's grating, rejected before any file is read; and its scale, after lines are counted.
    refused(&["--lines-per-mm", "600"], "1.667 µm is below the optical cut-off of 8.57 µm");
    refused(&["--pixel-um", "0.083"], "below the optical cut-off");
    refused(&["--pixel-um", "2.5", "--f-number", "0"], "");
    let report = reconstructed(&photo.join("photograph.png"), &out, &["--psf-sigma", "2"]);
    let warnings = report["warnings"].to_string();
    assert!(warnings.contains("cut-off is unknown") && warnings.contains("heights are relative"), "{warnings}");
}

#[test]
fn a_point_spread_function_that_is_much_too_wide_is_warned_of() {
    let dir = tempfile::tempdir().unwrap();
    let photo = rendered(dir.path(), "profile = \"blazed\"\nblur_px = 2");
    let warnings = |sigma: &str, name: &str| {
        let report = reconstructed(&photo.join("photograph.png"), &dir.path().join(name), &["--psf-sigma", sigma]);
        report["warnings"].to_string()
    };
    assert!(!warnings("2", "right").contains("point spread function"));
    assert!(warnings("2.5", "wide").contains("wider than the lens"));
}

#[test]
fn input_that_makes_no_sense_is_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let out = path("out");
    let refused = |image: &str, more: &[&str], said: &str| {
        let text = nacre(args(&path(image), &out, more)).expect(2).stderr();
        assert!(text.contains(said) && !text.contains("panicked"), "{said}: {text}");
        assert!(!out.exists());
    };
    let sigma = ["--psf-sigma", "1"];
    std::fs::write(path("empty.png"), []).unwrap();
    write_png8(&path("one.png"), 1, 1, 1, &[100]).unwrap();
    write_png8(&path("black.png"), 32, 32, 1, &[0; 1024]).unwrap();
    write_png8(&path("white.png"), 32, 32, 3, &[255; 3072]).unwrap();
    let lines: Vec<u16> = (0..64 * 48).map(|i| 20_000 + 9000 * u16::from(i % 64 % 12 < 6) + i as u16 % 7).collect();
    write_png16_gray(&path("lines.png"), 64, 48, &lines).unwrap();
    let nan = [("units", Attribute::Text("none".into()))];
    write_exr(&path("nan.exr"), 32, 32, &["Y"], &nan, &|_, _, row| row.fill(f32::NAN)).unwrap();
    refused("missing.png", &sigma, "does not exist");
    refused("empty.png", &sigma, "is empty");
    refused("one.png", &["--psf-sigma", "1", "--iterations", "5"], "smaller than the point spread function");
    refused("one.png", &sigma, "--noise");
    refused("black.png", &sigma, "mean light");
    for image in ["white.png", "nan.exr"] {
        refused(image, &["--psf-sigma", "1", "--iterations", "5"], "no pixel that is known");
        refused(image, &sigma, "too little of it is known");
    }
    refused("lines.png", &["--psf-sigma", "0"], "expected above 0");
    refused("lines.png", &["--psf-sigma", "-3"], "expected above 0");
    refused("lines.png", &["--psf-sigma", "NaN"], "is no number");
    refused("lines.png", &["--psf-sigma", "20"], "smaller than the point spread function of 161 x 161");
    refused("lines.png", &[], "--psf-sigma");
    refused("lines.png", &["--psf", path("black.png").to_str().unwrap()], "no middle pixel");
    for n in ["-5", "0", "many", "1000000000"] {
        refused("lines.png", &["--psf-sigma", "1", "--iterations", n], "iterations");
    }
    for (option, value) in [
        ("--crop", "60,0,10,10"),
        ("--crop", "0,0,0,5"),
        ("--crop", "1,2,3"),
        ("--crop", "18446744073709551615,0,2,2"),
        ("--slice", "0,0,500,0"),
        ("--slice", "0,0,1,0"),
        ("--slice", "NaN,0,9,0"),
        ("--rotate", "inf"),
        ("--pixel-um", "-1"),
        ("--lines-per-mm", "0"),
        ("--noise", "0,1"),
        ("--transfer", "recover"),
        ("--transfer", "gamma=-1"),
        ("--calibration", "nowhere.json"),
        ("--slice-width", "0"),
    ] {
        refused("lines.png", &["--psf-sigma", "1", option, value], "");
    }
    refused("lines.png", &["--psf-sigma", "1", "--known-shape", "blazed", "--known-depth-um", "-1"], "depth");
    // A photograph with half of its pixels unknown is still reconstructed.
    let half = |_: usize, y: usize, row: &mut [f32]| {
        row.iter_mut().enumerate().for_each(|(x, v)| {
            let light = 0.5 + 0.3 * (0.6 * x as f32).sin() + 0.01 * ((x * 7 + y * 13) % 11) as f32;
            *v = if y < 20 { f32::NAN } else { light };
        });
    };
    write_exr(&path("half.exr"), 64, 48, &["Y"], &nan, &half).unwrap();
    let report = reconstructed(&path("half.exr"), &out, &sigma);
    assert_eq!(report["unknown_pixels"], 20 * 64);
    assert!(report["warnings"].to_string().contains("not known"));
}

#[test]
fn the_service_and_plans_deconvolve_too() {
    let place = Place::new("");
    let service = Service::start(&place, &[]);
    let dir = tempfile::tempdir().unwrap();
    let photo = rendered(dir.path(), "profile = \"rectangular\"\nperiod_um = 48\nblur_px = 2.2").join("photograph.png");
    let parts: [(&str, &str, &[u8]); 2] =
        [("kind", "", b"photographs"), ("file", "photograph.png", &std::fs::read(&photo).unwrap())];
    let upload = service.upload(&parts).expect(201).json();
    let options = json!({ "psf": { "sigma": 2.2 }, "scale": { "lines": { "per_mm": 20.8333333 } } });
    let ask = |options: &Value| {
        service
            .post("/api/v1/reconstructions", &json!({ "upload": upload["id"], "method": "bokeh", "options": options }))
    };
    let job = ask(&options).expect(202).json();
    let path = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
    let done = service.until(&path, |job| job["state"] != "queued" && job["state"] != "running");
    close(&done["report"]["lines"]["period_um"], 48.0, 1e-3);
    // The same result as from the command.
    let out = dir.path().join("command");
    reconstructed(&photo, &out, &["--psf-sigma", "2.2", "--lines-per-mm", "20.8333333"]);
    let served = service.get(&format!("{path}/files/deconvolved.exr")).expect(200);
    assert!(served.body == std::fs::read(out.join("deconvolved.exr")).unwrap());
    for (options, word) in [
        (json!({}), "psf"),
        (json!({ "psf": { "sigma": -1 } }), "sigma"),
        (json!({ "psf": { "image": "/etc/passwd" } }), "psf"),
        (json!({ "psf": { "sigma": 2 }, "wavelength_nm": "blue" }), "wavelength_nm"),
        (json!({ "psf": { "sigma": 2 }, "transfer": "recover" }), "transfer"),
        (json!({ "psf": { "sigma": 2 }, "more": 1 }), "more"),
    ] {
        let refused = ask(&options).expect(400).text();
        assert!(refused.to_lowercase().contains(word), "{options}: {refused}");
    }
    // A plan merges its exposures and deconvolves the result.
    let plan = |bokeh: Value| {
        let reconstruct = json!({ "method": "bokeh", "bokeh": bokeh });
        json!({ "plan": { "kind": "exposures", "exposures_ms": [5, 20], "reconstruct": reconstruct } })
    };
    for (bokeh, word) in [
        (Value::Null, "psf"),
        (json!({ "psf": { "sigma": 0 } }), "sigma"),
        (json!({ "psf": { "image": "a.png" } }), "psf.image: names the file"),
    ] {
        let refused = service.post("/api/v1/sessions", &plan(bokeh)).expect(400).text();
        assert!(refused.to_lowercase().contains(word), "{refused}");
    }
    let id = begin(&service, &plan(json!({ "psf": { "sigma": 1.5 } })));
    finished(&service, &id);
    let own = service.get(&format!("/api/v1/reconstructions/{id}")).expect(200).json();
    assert_eq!(
        (&own["method"], own["report"]["merged"]["frames"].as_array().unwrap().len()),
        (&json!("bokeh"), 2),
        "{own}"
    );
}

//! Lookup tables from a user's point of view: from simulated flash photographs, from existing photographs, and over
//! REST.

#![allow(clippy::unwrap_used)]

use nacre_processing::image::{Attribute, read_exr, write_exr, write_png8};
use nacre_tests::http::{Service, begin, finished};
use nacre_tests::{Place, nacre};
use serde_json::{Value, json};
use std::path::Path;

const SIZE: usize = 300;
const SCALE: f64 = 0.004;

/// Gaussian orders on a square lattice around a zero order.
fn light(u: f64, v: f64) -> f64 {
    let (pitch, sigma) = (0.15, 0.012);
    let (m, n) = ((u / pitch).round(), (v / pitch).round());
    let square = (u - m * pitch).powi(2) + (v - n * pitch).powi(2);
    (-0.5 * square / (sigma * sigma)).exp() / (1.0 + 2.0 * (m * m + n * n))
}

/// Writes a photograph of these orders; light above `cap` is saturated.
fn photograph(path: &Path, center: [f64; 2], cap: f64) {
    let at = |x: usize, y: usize| light((center[0] - x as f64) * SCALE, (y as f64 - center[1]) * SCALE);
    let attributes: [(&str, Attribute); 0] = [];
    write_exr(path, SIZE, SIZE, &["Y"], &attributes, &|_, y, row| {
        for (x, out) in row.iter_mut().enumerate() {
            let l = at(x, y);
            *out = if l > cap { f32::NAN } else { l as f32 };
        }
    })
    .unwrap();
}

fn run(photo: &Path, out: &Path, more: &[&str]) -> nacre_tests::Run {
    let all = ["--json", "reconstruct", "lut", photo.to_str().unwrap(), "--out", out.to_str().unwrap()];
    nacre(all.iter().chain(more).map(|s| (*s).to_owned()).collect::<Vec<_>>())
}

const USUAL: [&str; 6] = ["--wavelength", "680", "--scale", "0.004", "--size", "256"];

#[test]
fn a_table_puts_each_wavelength_where_its_orders_lie() {
    let dir = tempfile::tempdir().unwrap();
    let (photo, out) = (dir.path().join("photo.exr"), dir.path().join("table"));
    photograph(&photo, [150.4, 148.7], f64::INFINITY);
    // With a monochromatic lamp, the table is the photograph at another scale.
    let lamp = dir.path().join("line.csv");
    std::fs::write(&lamp, "544,0\n545,1\n546,0\n").unwrap();
    let more = ["--illuminant", lamp.to_str().unwrap(), "--extent", "0.4"];
    let report = run(&photo, &out, &[&USUAL[..], &more].concat()).expect(0).json();
    assert!(report["warnings"].as_array().unwrap().is_empty(), "{report}");
    let center: Vec<f64> = report["center"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    assert!((center[0] - 150.4).abs() < 0.02 && (center[1] - 148.7).abs() < 0.02, "{center:?}");
    let table = read_exr(&out.join("lut.exr")).unwrap();
    // Colour matching functions at 545 nm (CIE 1931: 0.3597, 0.9803, 0.0134).
    let white: Vec<f64> = table.attributes["white"].split(' ').map(|v| v.parse().unwrap()).collect();
    let off = white.iter().zip([0.367, 1.0, 0.0137]).map(|(found, truth)| (found - truth).abs());
    assert!(white.len() == 3 && off.fold(0.0, f64::max) < 0.002, "{white:?}");
    let (mut square, mut all) = (0.0, 0.0);
    for y in 0..256 {
        for x in 0..256 {
            let h = |k: usize| 0.4 * ((2 * k + 1) as f64 / 256.0 - 1.0);
            let factor: f64 = 680.0 / 545.0;
            let truth = factor.powi(4) * light(h(x) * factor, h(255 - y) * factor);
            square += (f64::from(table.channels["Y"][y * 256 + x]) - truth).powi(2);
            all += truth * truth;
            assert!(table.channels["coverage"][y * 256 + x] > 0.999, "{x} {y}");
        }
    }
    // The line is 1 nm wide (half maximum), and orders are known to three pixels.
    let error = f64::sqrt(square / all);
    assert!(error < 0.01, "{error}");
    for name in ["lut.png", "figure.svg", "figure.png", "coverage.png", "profile.csv", "report.json"] {
        assert!(out.join(name).is_file(), "{name}");
    }
    // Existing files are not overwritten without --force.
    run(&photo, &out, &USUAL).expect(2);
    run(&photo, &out, &[&USUAL[..], &["--force"]].concat()).expect(0);
}

#[test]
fn a_light_that_is_no_point_is_spread_over_the_table() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    photograph(&path("photo.exr"), [150.4, 148.7], f64::INFINITY);
    // Two lamps, 21 pixels (0.084 half vectors) apart; the right one is twice as bright.
    let lamps = |name: &str, right: f32| {
        let attributes: [(&str, Attribute); 0] = [];
        write_exr(&path(name), 64, 64, &["Y"], &attributes, &|_, y, row| {
            row.fill(0.01);
            if y == 32 {
                (row[22], row[43]) = (1.01, 0.01 + right);
            }
        })
        .unwrap();
        path(name).to_str().unwrap().to_owned()
    };
    let mirror = lamps("mirror.exr", 2.0);
    let [plain, spread] = ["plain", "spread"].map(path);
    // The spacing of entries equals the pixel size.
    let wide = [&USUAL[..4], &["--size", "200", "--extent", "0.4"]].concat();
    run(&path("photo.exr"), &plain, &wide).expect(0);
    let report = run(&path("photo.exr"), &spread, &[&wide[..], &["--light", &mirror]].concat()).json();
    assert_eq!(report["light"]["pixels"], 2, "{report}");
    // Root mean square distance from the centroid: 21 pixels · √(1/3 · 2/3).
    assert!((report["light"]["spread"].as_f64().unwrap() - 0.084 * f64::sqrt(2.0 / 9.0)).abs() < 1e-6, "{report}");
    let [plain, spread] = [plain, spread].map(|p| read_exr(&p.join("lut.exr")).unwrap().channels.remove("Y").unwrap());
    let brightest = plain.iter().copied().fold(0.0, f32::max);
    // The centroid of the light corresponds to the zero order. The brighter lamp is seven pixels to its right, which is
    // seven entries to the left in half vectors. The other lamp is fourteen pixels to the left.
    for i in (200..199 * 200).filter(|i| (20..180).contains(&(i % 200))) {
        let wanted = (2.0 * plain[i + 7] + plain[i - 14]) / 3.0;
        assert!((spread[i] - wanted).abs() < 1e-4 * brightest, "{i}: {} {wanted}", spread[i]);
    }
    let refused = |more: &[&str], word: &str| {
        let run = run(&path("photo.exr"), &path("none"), &[&USUAL[..], more].concat()).expect(2);
        assert!(run.stderr().contains(word), "{more:?}: {}", run.stderr());
    };
    refused(&["--light", &mirror, "--warp", "3"], "warp");
    refused(&["--light", &lamps("saturated.exr", f32::NAN)], "saturated.exr");
    refused(&["--light", &mirror, "--light-scale", "0.1", "--extent", "0.4"], "mirror.exr");
    refused(&["--light-scale", "0.1"], "--light");
}

#[test]
fn what_was_not_measured_is_not_made_up() {
    let dir = tempfile::tempdir().unwrap();
    let (photo, out) = (dir.path().join("photo.exr"), dir.path().join("table"));
    let warned = |report: &Value, word: &str| {
        let all = report["warnings"].as_array().unwrap();
        assert!(all.iter().any(|w| w.as_str().unwrap().contains(word)), "{word}: {all:?}");
    };
    // Saturated: its position follows from its flanks, and the centre of the table is unknown.
    photograph(&photo, [150.0, 149.0], 0.6);
    let report = run(&photo, &out, &[&USUAL[..], &["--force"]].concat()).expect(0).json();
    warned(&report, "saturated");
    assert!((report["center"][0].as_f64().unwrap() - 150.0).abs() < 0.05, "{report}");
    let table = read_exr(&out.join("lut.exr")).unwrap();
    assert!(table.channels["coverage"][128 * 256 + 128] < 0.01 && table.channels["Y"][128 * 256 + 128].is_nan());
    // Clipped: the requested extent exceeds the photograph.
    photograph(&photo, [150.0, 149.0], f64::INFINITY);
    let report = run(&photo, &out, &[&USUAL[..], &["--force", "--extent", "1.5"]].concat()).json();
    warned(&report, "in part only");
    let table = read_exr(&out.join("lut.exr")).unwrap();
    assert!(table.channels["Y"][0].is_nan() && table.channels["coverage"][0] == 0.0);
    // A wrong centre is detected by the lobe nearby.
    let wrong = [&USUAL[..], &["--force", "--center", "152,149"]].concat();
    let report = run(&photo, &out, &wrong).expect(1).json();
    warned(&report, "lobe there lies at 150");
    assert!(report["center_error"].as_f64().unwrap() > 0.1, "{report}");
    assert!(report["error_estimate"].as_f64().unwrap() > 0.1, "{report}");
    // The zero order lies outside of the picture, so the brightest order is taken for it.
    photograph(&photo, [-30.0, 149.0], f64::INFINITY);
    let report = run(&photo, &out, &[&USUAL[..], &["--force"]].concat()).json();
    warned(&report, "as bright");
}

#[test]
fn what_makes_no_sense_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let photo = dir.path().join("photo.exr");
    photograph(&photo, [150.0, 149.0], f64::INFINITY);
    let (eight, dark) = (dir.path().join("eight.png"), dir.path().join("dark.png"));
    write_png8(&eight, 8, 8, 1, &[9; 64]).unwrap();
    write_png8(&dark, 8, 8, 3, &[0; 192]).unwrap();
    let out = dir.path().join("table");
    let refused = |photo: &Path, more: &[&str], word: &str| {
        let run = run(photo, &out, more).expect(2);
        assert!(run.stderr().contains(word), "{more:?}: {}", run.stderr());
        assert!(!out.exists(), "{more:?}");
    };
    refused(&photo, &["--scale", "0.004"], "wavelength");
    refused(&photo, &["--wavelength", "680"], "scale");
    refused(&photo, &["--wavelength", "680,540", "--scale", "0.004"], "wavelength");
    refused(&photo, &["--wavelength", "610,540,460", "--scale", "0.004"], "channel R");
    for (option, value) in [
        ("--size", "8"),
        ("--size", "100000"),
        ("--extent", "3"),
        ("--extent", "nan"),
        ("--warp", "2"),
        ("--exponent", "inf"),
        ("--max-error", "0"),
        ("--method", "fixed=0"),
        ("--method", "magic"),
        ("--illuminant", "moonlight"),
        ("--observer", "1976"),
        ("--center", "900,2"),
        ("--center", "here"),
    ] {
        refused(&photo, &[&USUAL[..4], &[option, value]].concat(), option.trim_start_matches("--"));
    }
    refused(&eight, &USUAL, "8 bits");
    refused(&eight, &[&USUAL[..], &["--transfer", "srgb"]].concat(), "--center");
    refused(&dark, &[&USUAL[..], &["--transfer", "linear"]].concat(), "no light");
    refused(&dir.path().join("missing.exr"), &USUAL, "missing.exr");
    refused(dir.path(), &USUAL, "");
    let toml = dir.path().join("bench.toml");
    for (text, word) in [
        ("camera_mm = 1", "flash_mm is missing"),
        ("words", "bench.toml"),
        ("camera_mm = 1\nflash_mm = 1000\npixel_um = 0", "pixel_um"),
    ] {
        std::fs::write(&toml, text).unwrap();
        refused(&photo, &["--wavelength", "680", "--geometry", toml.to_str().unwrap()], word);
    }
}

#[test]
fn the_geometry_of_a_near_flash_is_undone() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    // The same lattice of gratings from a short and a long distance: half vectors do not depend on distance.
    let scene = |mm: f64, pixel_um: f64| {
        format!(
            "camera_mm = {mm}\nflash_mm = {}\nbaseline_mm = [{}, 0]\npixel_um = {pixel_um}\nwidth = 600\nheight = 600\n\
             flash_diameter_mm = 0\nblur_px = 0.8\nband_nm = 0\ncoherence_um = 20\nread_noise_e = 0\nfull_scale_e = 1e8",
            1.2 * mm,
            0.1 * mm
        )
    };
    let peaks = [("near", 120.0, 200.0), ("far", 4000.0, 6500.0)].map(|(name, mm, pixel_um)| {
        std::fs::write(path("scene.toml"), scene(mm, pixel_um)).unwrap();
        nacre(["sim", "photograph", "flash", "--scene", &path("scene.toml"), "--out", &path(name)]).expect(0);
        let bench = format!(
            "camera_mm = {mm}\nflash_mm = {}\nbaseline_mm = [{}, 0]\npixel_um = {pixel_um}",
            1.2 * mm,
            0.1 * mm
        );
        std::fs::write(path("bench.toml"), bench).unwrap();
        let line = path("line.csv");
        std::fs::write(&line, "679,0\n680,1\n681,0\n").unwrap();
        let (bench, out) = (path("bench.toml"), path(&format!("{name}-table")));
        let more =
            ["--geometry", &bench, "--illuminant", &line, "--size", "401", "--extent", "0.4", "--max-error", "0.05"];
        let report = run(Path::new(&path(name)), Path::new(&out), &more).json();
        assert!(report["coverage"]["full"].as_f64().unwrap() > 0.99, "{report}");
        let y = read_exr(&Path::new(&out).join("lut.exr")).unwrap().channels.remove("Y").unwrap();
        // The order (6, 0) lies at 6 · 0.68 / 20 = 0.204: centroid and light around it.
        let (mut sum, mut along) = (0.0, 0.0);
        for row in 195..=205 {
            for column in 295..=309 {
                let v = f64::from(y[row * 401 + column]);
                sum += v;
                along += v * (0.4 * (f64::from(2 * column as u32 + 1) / 401.0 - 1.0));
            }
        }
        [along / sum, sum / f64::from(y[200 * 401 + 200])]
    });
    // The same arrangement as a calibrated geometry yields the same table.
    let [pixels, middle] = [120.0 / 0.2, 299.5];
    let foot = [middle - 0.1 * 120.0 / 2.2 / 0.2, middle];
    let geometry = serde_json::json!({
        "camera": { "focal_px": [pixels, pixels], "center_px": foot, "distortion": [0.0, 0.0, 0.0, 0.0, 0.0] },
        "sample": { "rotation": [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]], "translation_mm": [0.0, 0.0, 120.0] },
        "light_mm": [12.0, 0.0, 144.0],
        "image_px": [600, 600],
    });
    std::fs::write(path("geometry.json"), geometry.to_string()).unwrap();
    let (line, json, out) = (path("line.csv"), path("geometry.json"), path("calibrated"));
    let more = ["--geometry", &json, "--illuminant", &line, "--size", "401", "--extent", "0.4", "--max-error", "0.05"];
    run(Path::new(&path("near")), Path::new(&out), &more);
    let [by_hand, calibrated] = ["near-table", "calibrated"]
        .map(|name| read_exr(&Path::new(&path(name)).join("lut.exr")).unwrap().channels.remove("Y").unwrap());
    let brightest = by_hand.iter().copied().fold(0.0, f32::max);
    let apart = by_hand.iter().zip(&calibrated).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(apart < 1e-3 * brightest, "{apart} of {brightest}");
    // The lattice's envelope shifts the centroid of an order equally at both distances.
    assert!(peaks.iter().all(|p| (p[0] - 0.204).abs() < 5e-4), "{peaks:?}");
    assert!((peaks[0][0] - peaks[1][0]).abs() < 1e-4, "{peaks:?}");
    // Equal strength at both distances: cosine, inverse square and G are corrected. Pixels of 200 µm and of 6.5 mm
    // cover slightly different parts of an order (1.4 %).
    assert!((peaks[0][1] / peaks[1][1] - 1.0).abs() < 0.02, "{peaks:?}");
}

#[test]
fn the_service_makes_tables_of_its_sessions() {
    let place = Place::new("");
    let service = Service::start(&place, &[]);
    let photo = place.path("photo.exr");
    photograph(&photo, [150.4, 148.7], f64::INFINITY);
    let parts: [(&str, &str, &[u8]); 2] =
        [("kind", "", b"photographs"), ("file", "photo.exr", &std::fs::read(&photo).unwrap())];
    let upload = service.upload(&parts).expect(201).json();
    let table = json!({ "wavelength_nm": 680, "scale": SCALE, "size": 64, "illuminant": "D65" });
    let asked = json!({ "upload": upload["id"], "method": "lut", "options": table });
    let job = service.post("/api/v1/reconstructions", &asked).expect(202).json();
    let path = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
    let done = service.until(&path, |job| job["state"] != "queued" && job["state"] != "running");
    assert_eq!(done["report"]["illuminant"], "D65", "{done}");
    let picture = service.get(&format!("{path}/files/lut.png")).expect(200);
    assert!(picture.body.starts_with(b"\x89PNG"));
    // The same result as from the command.
    let out = place.path("table");
    let more = ["--wavelength", "680", "--scale", "0.004", "--size", "64", "--illuminant", "D65"];
    run(&photo, &out, &more).expect(0);
    assert!(
        service.get(&format!("{path}/files/lut.exr")).expect(200).body == std::fs::read(out.join("lut.exr")).unwrap()
    );
    // With an extended light, whose photograph is a separate upload.
    let light = place.path("light.exr");
    let attributes: [(&str, Attribute); 0] = [];
    write_exr(&light, 40, 40, &["Y"], &attributes, &|_, y, row| {
        let disc = |x: usize| f32::from(u8::from((x as f64 - 20.0).hypot(y as f64 - 20.0) < 4.5));
        row.iter_mut().enumerate().for_each(|(x, out)| *out = disc(x));
    })
    .unwrap();
    let parts: [(&str, &str, &[u8]); 2] =
        [("kind", "", b"photographs"), ("file", "light.exr", &std::fs::read(&light).unwrap())];
    let lit_by = service.upload(&parts).expect(201).json();
    let asked = json!({ "upload": upload["id"], "method": "lut", "options": table,
        "light": { "upload": lit_by["id"], "scale": 0.004 } });
    let job = service.post("/api/v1/reconstructions", &asked).expect(202).json();
    assert_eq!([&job["light"]["upload"], &job["light"]["scale"]], [&lit_by["id"], &json!(0.004)]);
    let wide = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
    let done = service.until(&wide, |job| job["state"] != "queued" && job["state"] != "running");
    assert!(done["report"]["light"]["pixels"].as_u64().is_some_and(|n| n > 50), "{done}");
    let out = place.path("spread");
    // A light of so few pixels causes an error of 2 %, above the requested 1 %: the table is written, and the exit code
    // is 1.
    run(&photo, &out, &[&more[..], &["--light", light.to_str().unwrap(), "--light-scale", "0.004"]].concat()).expect(1);
    assert!(
        service.get(&format!("{wide}/files/lut.exr")).expect(200).body == std::fs::read(out.join("lut.exr")).unwrap()
    );
    // The upload is kept while a table uses it; its folder is removed with the last one.
    let kept = place.path("data/uploads").join(lit_by["id"].as_str().unwrap());
    assert!(kept.is_dir(), "{kept:?}");
    let token = service.get(&format!("{wide}/deletion")).expect(200).json()["token"].as_str().unwrap().to_owned();
    service.send("DELETE", &format!("{wide}?token={token}"), &[], b"").expect(204);
    assert!(!kept.exists());
    for (method, light, status) in [
        ("lut", json!({ "upload": lit_by["id"] }), 404),
        ("lut", json!({ "upload": "../x" }), 404),
        ("lut", json!({ "upload": upload["id"], "scale": 7 }), 400),
        ("lut", json!({ "upload": upload["id"], "path": "/etc/passwd" }), 400),
        ("hdr", json!({ "upload": upload["id"] }), 400),
    ] {
        let options = if method == "lut" { table.clone() } else { json!({}) };
        let asked = json!({ "upload": upload["id"], "method": method, "options": options, "light": light });
        service.post("/api/v1/reconstructions", &asked).expect(status);
    }
    let plan =
        json!({ "plan": { "kind": "exposures", "bracket": { "at_most": 2 }, "reconstruct": { "operation": "hdr" } } });
    let id = begin(&service, &plan);
    finished(&service, &id);
    // The panel has no orders, which the job reports.
    let asked = json!({ "session": id, "method": "lut", "options": table });
    let job = service.post("/api/v1/reconstructions", &asked).expect(202).json();
    let failing = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
    let failed = service.until(&failing, |job| job["state"] != "queued" && job["state"] != "running");
    assert!(failed["error"].to_string().contains("center"), "{failed}");
    for (options, word) in [
        (json!({ "wavelength_nm": 680, "scale": 0.002, "illuminant": "/etc/passwd" }), "illuminant"),
        (json!({ "wavelength_nm": 680, "scale": 0.002, "size": 1 }), "size"),
        (json!({ "wavelength_nm": 680, "scale": 0.002, "warps": 1 }), "warps"),
    ] {
        let asked = json!({ "session": id, "method": "lut", "options": options });
        assert!(service.post("/api/v1/reconstructions", &asked).expect(400).text().contains(word), "{options}");
    }
    // A plan can request a table.
    let plan = json!({ "plan": { "kind": "exposures", "exposures_ms": [5, 20], "reconstruct": { "method": "lut", "lut": { "size": 4 } } } });
    assert!(service.post("/api/v1/sessions", &plan).expect(400).text().contains("size"));
}

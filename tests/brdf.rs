//! BRDFs of surfaces from a user's point of view: maps, slices, orders, and the grating equation.

#![allow(clippy::unwrap_used)]

use nacre_processing::image::{read_exr, write_png8};
use nacre_tests::http::Service;
use nacre_tests::{Place, Run, nacre};
use serde_json::{Value, json};
use std::path::Path;

/// Runs `nacre --json brdf …` in a folder, with arguments split at spaces.
fn brdf(dir: &Path, args: &str) -> Run {
    let place = |arg: &str| {
        if arg.contains('.') && !arg.contains(['=', ':', ',']) && arg.parse::<f64>().is_err() {
            dir.join(arg).to_str().unwrap().to_owned()
        } else {
            arg.to_owned()
        }
    };
    nacre(["--json", "brdf"].into_iter().map(str::to_owned).chain(args.split(' ').map(place)).collect::<Vec<_>>())
}

fn rows(path: &Path) -> Vec<Vec<f64>> {
    let text = std::fs::read_to_string(path).unwrap();
    text.lines().skip(1).map(|l| l.split(',').map(|v| v.parse().unwrap()).collect()).collect()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap()
}

#[test]
fn a_blazed_grating_keeps_the_grating_equation_by_every_method() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    brdf(dir, "surface blazed --period-um 2.5 --depth-um 0.3 --out blazed.exr").expect(0);
    assert!(dir.join("blazed.png").is_file());
    for method in ["auto", "taylor", "chebyshev", "fft", "nmm", "pq", "pq-linear"] {
        let more = if method.starts_with("pq") { " --max-error 0.5" } else { "" };
        let run = brdf(dir, &format!("check blazed.exr --light 75 --period-um 2.5 --method {method}{more}"));
        // The patch repeats three times within the coherence length, which is too few for linear interpolation; the
        // error is reported.
        let report = run.expect(if method == "pq-linear" { 1 } else { 0 }).json();
        assert!((number(&report["mean_nm"]) - 2500.0).abs() < 1.0, "{method}: {report}");
        assert!(number(&report["variance_nm2"]) <= 0.4, "{method}: {report}");
        let peak = &report["quality"]["periods"][0];
        assert!((number(&peak["period_um"]) - 2.5).abs() < number(&peak["resolution_um"]));
    }
    // At this azimuth, no first order is visible.
    brdf(dir, "check blazed.exr --light 75 --period-um 900").expect(2);
}

#[test]
fn a_map_shows_violet_near_the_mirror_direction_and_red_far_from_it() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    brdf(dir, "surface sinusoid --period-um 1.6 --depth-um 0.1 --out a.exr").expect(0);
    let report = brdf(dir, "map a.exr --size 401 --out map.exr").expect(0).json();
    assert!(number(&report["error_estimate"]) <= 0.01, "{report}");
    assert!(!report["choice"]["why"].as_str().unwrap().is_empty());
    // A mirror would reflect everything; the gain of oblique orders is close to 1.
    assert!((number(&report["albedo"][1]) - 1.0).abs() < 0.02, "{report}");
    let map = read_exr(&dir.join("map.exr")).unwrap();
    let at = |c: &str, x: usize| map.channels[c][200 * 401 + x];
    assert!(map.channels["Y"][0].is_nan() && at("Y", 200) > 0.0);
    // First orders lie at the sine λ/1.6: 450 nm at 0.281, 550 nm at 0.344, 650 nm at 0.406.
    let pixel = |sine: f64| (200.0 + sine * 200.5).round() as usize;
    for side in [1.0, -1.0] {
        let [blue, green, red] = [0.281, 0.344, 0.406].map(|s| pixel(side * s));
        assert!(at("Z", blue) > 2.0 * at("Y", blue), "blue {side}");
        assert!(at("Y", green) > at("X", green) && at("Y", green) > at("Z", green), "green {side}");
        assert!(at("X", red) > 1.5 * at("Y", red) && at("X", red) > 10.0 * at("Z", red), "red {side}");
        // A sinusoid is symmetric.
        let mirrored = pixel(-side * 0.344);
        assert!((at("Y", green) / at("Y", mirrored) - 1.0).abs() < 0.01);
    }
    let json: Value = serde_json::from_slice(&std::fs::read(dir.join("map.json")).unwrap()).unwrap();
    assert_eq!(json["product"], "map");
    let figure = std::fs::read_to_string(dir.join("map.figure.svg")).unwrap();
    assert!(["15°", "75°", "mirror", "1/sr"].iter().all(|word| figure.contains(word)), "rings and a colour bar");
    assert_eq!(image::image_dimensions(dir.join("map.figure.png")).unwrap(), (2360, 1096));
    let picture = image::open(dir.join("map.png")).unwrap();
    assert_eq!((picture.width(), picture.height()), (401, 401));
    // Existing files are not overwritten without --force.
    assert!(brdf(dir, "map a.exr --size 401 --out map.exr").expect(2).stderr().contains("--force"));
    brdf(dir, "map a.exr --size 64 --method nmm --normalisation relative --material gold --force --out map.exr")
        .expect(0);
    // A blazed grating is asymmetric.
    brdf(dir, "surface blazed --period-um 1.6 --depth-um 0.25 --out b.exr").expect(0);
    brdf(dir, "map b.exr --size 401 --out blazed.exr --force").expect(0);
    let map = read_exr(&dir.join("blazed.exr")).unwrap();
    let y = |x: usize| map.channels["Y"][200 * 401 + x];
    assert!(y(pixel(-0.344)) > 20.0 * y(pixel(0.344)), "{} {}", y(pixel(-0.344)), y(pixel(0.344)));
}

#[test]
fn slices_and_orders_are_those_of_the_closed_form() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    brdf(dir, "orders --period-um 2 --depth-um 0.1 --wavelengths 550 --out orders.csv").expect(0);
    let orders = rows(&dir.join("orders.csv"));
    let sum: f64 = orders.iter().map(|r| r[2]).sum();
    assert!((sum - 1.0).abs() < 1e-6, "{sum}");
    // X = k w h/2 = 2π · 2 · 0.05 / 0.55 = 1.1424, J1(X) = 0.48295.
    let first = orders.iter().find(|r| r[1] == 1.0).unwrap();
    assert!((first[2] - 0.482_95_f64.powi(2)).abs() < 1e-4, "{first:?}");
    assert!((first[3] - 15.96).abs() < 0.01, "{first:?}");
    let paper =
        brdf(dir, "orders --period-um 2 --depth-um 0.1 --wavelengths 550 --method taylor2 --out t.csv").expect(0);
    assert!((number(&paper.json()["sums"][0]) - 2.86).abs() < 0.02);
    // The peaks of a slice agree with the orders: f = flux per lobe, density of the window at its peak.
    brdf(dir, "surface sinusoid --period-um 2 --depth-um 0.1 --out a.exr").expect(0);
    brdf(dir, "slice a.exr --wavelengths 550 --views=-60:60:0.01 --out slice.csv").expect(0);
    let slice = rows(&dir.join("slice.csv"));
    let peak = |degrees: f64| slice.iter().filter(|r| (r[1] - degrees).abs() < 0.5).map(|r| r[2]).fold(0.0, f64::max);
    let sigma = 4.0 / (8_f64.sqrt() * std::f64::consts::PI * 65.0);
    for m in -2..=2 {
        let order = orders.iter().find(|r| r[1] == f64::from(m)).unwrap();
        let truth = order[4] / (2.0 * std::f64::consts::PI * sigma * sigma * 0.55 * 0.55);
        assert!((peak(order[3]) / truth - 1.0).abs() < 5e-3, "{m}: {} {truth}", peak(order[3]));
    }
    assert_eq!(slice.len(), 12_001);
}

#[test]
fn what_cannot_be_done_is_refused_in_words() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write_png8(&dir.join("a.png"), 16, 16, 1, &(0..=255).collect::<Vec<u8>>()).unwrap();
    std::fs::write(dir.join("nan.txt"), "1 2\n3 nan\n").unwrap();
    for (args, word) in [
        ("map a.png --out x.exr", "--pixel-um"),
        ("map a.png --pixel-um 0.1 --out x.exr", "--range-um"),
        ("map a.png --pixel-um 0.5 --range-um 0.2 --out x.exr", "pixels of at most 0.1900"),
        ("map a.png --pixel-um 0.1 --range-um 0.2 --size 100000 --out x.exr", "size"),
        ("map a.png --pixel-um 0.1 --range-um 0.2 --max-error 0 --out x.exr", "max-error"),
        ("map a.png --pixel-um 0.1 --range-um 0.2 --light 95 --out x.exr", "light"),
        ("map a.png --pixel-um 0.1 --range-um 0.2 --coherence-um nan --out x.exr", "coherence"),
        ("map a.png --pixel-um 0.1 --range-um 0.2 --illuminant moonlight --out x.exr", "moonlight"),
        ("map a.png --pixel-um 0.1 --range-um 0.2 --material mithril --out x.exr", "mithril"),
        ("map a.png --pixel-um 0.1 --range-um 0.2 --method nmm --out x.exr", "nmm"),
        ("map a.png --pixel-um 0.1 --range-um 0.2 --method pq --out x.exr", "edges"),
        ("map a.png --pixel-um 0.1 --range-um 900 --out x.exr", "terms"),
        ("map nan.txt --pixel-um 0.1 --range-um 1 --out x.exr", "column 1, row 1"),
        ("map missing.png --pixel-um 0.1 --range-um 1 --out x.exr", "missing.png"),
        ("slice a.png --pixel-um 0.1 --range-um 0.2 --wavelengths 20 --out x.csv", "wavelengths"),
        ("slice a.png --pixel-um 0.1 --range-um 0.2 --views 100 --out x.csv", "views"),
        ("orders --period-um 0 --depth-um 0.1 --out x.csv", "period"),
        ("orders --period-um 2 --out x.csv", "--depth-um"),
        ("orders --period-um 2 --depth-um 0.1 --profile blazed --method taylor2 --out x.csv", "sinusoid"),
        ("map a.png --pixel-um 0.1 --range-um 0.2 --out nowhere/x.exr", "no folder"),
        ("map a.png --pixel-um 0.1 --range-um 0.2 --out x.png", "twice"),
        ("surface blazed --period-um -1 --depth-um 0.1 --out x.exr", "period"),
    ] {
        let run = brdf(dir, args).expect(2);
        assert!(run.stderr().contains(word), "{args}: {}", run.stderr());
        for name in ["x.exr", "x.png", "x.json", "x.csv"] {
            assert!(!dir.join(name).exists(), "{args}");
        }
    }
}

#[test]
fn the_thesis_own_patches_show_their_periods() {
    let data = std::env::var_os("NACRE_TEST_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), Into::into);
    let folder = data.join("heightfields/thesis");
    if !folder.exists() {
        println!("skipped: {} is not there", folder.display());
        return;
    }
    // Their scale is not recorded. With 0.08 µm per pixel and 0.43 µm from black to white, the spacing of the fingers
    // agrees approximately with the thesis.
    let check = |name: &str, more: &str| {
        let path = folder.join(name);
        let args = format!("check {} --pixel-um 0.08 --range-um 0.43 --light 75{more}", path.display());
        let args: Vec<String> =
            ["--json", "brdf"].into_iter().map(str::to_owned).chain(args.split(' ').map(str::to_owned)).collect();
        nacre(args).expect(0).json()
    };
    let elaphe = check("Elaph100x100.png", " --coherence-um 16");
    let peak = &elaphe["quality"]["periods"][0];
    let (mean, resolution) = (number(&elaphe["mean_nm"]), 1e3 * number(&peak["resolution_um"]));
    assert!((mean - 1e3 * number(&peak["period_um"])).abs() < resolution, "{mean} {peak}");
    assert!(number(&elaphe["variance_nm2"]) < 0.4 && (1100.0..1500.0).contains(&mean), "{elaphe}");
    // Areas with two directions and periods: two ridges alternate as the highest one.
    let xenopeltis = check("Xeno100x100.png", " --coherence-um 16 --azimuth 104 --period-um 0.77");
    assert!(xenopeltis["ridges"].as_array().unwrap().len() >= 2, "{}", xenopeltis["ridges"]);
}

#[test]
fn terms_are_stored_in_the_precision_that_the_error_needs() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    brdf(dir, "surface fingers --period-um 1.2 --depth-um 0.3 --pixels 96 --pixel-um 0.09 --out a.exr").expect(0);
    let exact = brdf(dir, "terms a.exr --coherence-um 12 --out exact.set").expect(0).json();
    let loose = brdf(dir, "terms a.exr --coherence-um 12 --max-error 0.2 --out loose.set").expect(0).json();
    assert_eq!([&exact["precision"], &loose["precision"]], ["float", "half"]);
    for report in [&exact, &loose] {
        assert!(number(&report["measured_error"]) <= number(&report["predicted_error"]), "{report}");
    }
    // One file per term; its size depends on the number format.
    let size = |set: &str| std::fs::metadata(dir.join(set).join("term_000.exr")).unwrap().len();
    assert!(size("loose.set") < size("exact.set"));
    for report in [&exact, &loose] {
        let files = std::fs::read_dir(report["out"].as_str().map(|o| dir.join(o)).unwrap()).unwrap().count();
        assert_eq!(files as u64, report["terms"].as_u64().unwrap() + 1);
    }
    // Any EXR reader reads them: the mean of the zeroth term, which is 1 everywhere, is 1.
    let map = read_exr(&dir.join("loose.set/term_000.exr")).unwrap();
    let middle = map.height / 2 * map.width + map.width / 2;
    assert_eq!([map.channels["re"][middle], map.channels["im"][middle]], [1.0, 0.0]);
    // The first order alone is insufficient here, which is reported; existing files are not replaced.
    brdf(dir, "terms a.exr --coherence-um 12 --method taylor --order 1 --out first.set").expect(1);
    assert!(brdf(dir, "terms a.exr --out exact.set").expect(2).stderr().contains("exact"));
    assert!(brdf(dir, "terms a.exr --order 1 --out b.set").expect(2).stderr().contains("taylor"));
}

#[test]
fn a_map_of_some_directions_is_a_part_of_that_of_all() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    brdf(dir, "surface sinusoid --period-um 1.6 --depth-um 0.1 --out a.exr").expect(0);
    brdf(dir, "map a.exr --size 300 --out all.exr").expect(0);
    brdf(dir, "map a.exr --size 100 --zoom 3 --center 0.3333333333333333,0 --out part.exr").expect(0);
    let [all, part] = ["all.exr", "part.exr"].map(|f| read_exr(&dir.join(f)).unwrap());
    // Columns 150 to 249 and rows 100 to 199.
    for (k, value) in part.channels["Y"].iter().enumerate() {
        let other = all.channels["Y"][(100 + k / 100) * 300 + 150 + k % 100];
        assert!((value - other).abs() <= 1e-3 * other.abs() + 1e-6, "{k}: {value} {other}");
    }
    assert_eq!(part.attributes["half_side"], (1.0_f64 / 3.0).to_string());
    for bad in ["--zoom 0", "--zoom nan", "--center 2,0", "--center x"] {
        brdf(dir, &format!("map a.exr {bad} --out b.exr")).expect(2);
    }
}

#[test]
fn the_service_renders_uploaded_height_fields() {
    let place = Place::new("");
    let service = Service::start(&place, &[]);
    let image = place.path("heights.png");
    let blaze: Vec<u8> = (0..64 * 64).map(|i| (i % 16 * 16) as u8).collect();
    write_png8(&image, 64, 64, 1, &blaze).unwrap();
    let parts: [(&str, &str, &[u8]); 2] =
        [("kind", "", b"photographs"), ("file", "heights.png", &std::fs::read(&image).unwrap())];
    let upload = service.upload(&parts).expect(201).json();
    let ask = |options: Value| {
        service
            .post("/api/v1/reconstructions", &json!({ "upload": upload["id"], "method": "brdf", "options": options }))
    };
    let settings = json!({ "light_deg": [20, 0], "illuminant": "D65", "reflectance": "gold" });
    let job = ask(json!({ "pixel_um": 0.1, "range_um": 0.3, "size": 64, "settings": settings })).expect(202).json();
    let path = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
    let done = service.until(&path, |job| job["state"] != "queued" && job["state"] != "running");
    assert_eq!(done["report"]["settings"]["reflectance"], "gold", "{done}");
    // The same result as from the command.
    let more = "--pixel-um 0.1 --range-um 0.3 --size 64 --light 20 --illuminant D65 --material gold --out map.exr";
    brdf(&place.path("."), &format!("map heights.png {more}")).expect(0);
    let served = service.get(&format!("{path}/files/brdf.exr")).expect(200);
    std::fs::write(place.path("served.exr"), &served.body).unwrap();
    let [a, b] = ["served.exr", "map.exr"].map(|name| read_exr(&place.path(name)).unwrap());
    for c in ["X", "Y", "Z"] {
        assert!(a.channels[c].iter().zip(&b.channels[c]).all(|(a, b)| a.to_bits() == b.to_bits()), "{c}");
    }
    // Missing or invalid options are reported at once if possible, otherwise by the job.
    for (options, word) in [
        (json!({ "size": 1 }), "size"),
        (json!({ "pixel_um": -1 }), "pixel"),
        (json!({ "settings": { "reflectance": "mithril" } }), "mithril"),
        (json!({ "settings": { "illuminant": "/etc/passwd" } }), "illuminant"),
        (json!({ "settings": { "light_deg": [95, 0] } }), "light"),
        (json!({ "depth": 1 }), "depth"),
    ] {
        let refused = ask(options.clone()).expect(400).text();
        assert!(refused.contains(word), "{options}: {refused}");
    }
    // A grid of numbers, as written by AFM software, recognised by name only where a height field is expected.
    let text = (0..64)
        .map(|y| (0..64).map(|x| format!("{}", (x + y) % 16)).collect::<Vec<_>>().join(" ") + "\n")
        .collect::<String>();
    let part = |kind: &'static [u8]| -> [(&str, &str, &[u8]); 2] {
        [("kind", "", kind), ("file", "afm.txt", text.as_bytes())]
    };
    assert!(service.upload(&part(b"photographs")).expect(400).text().contains("afm.txt"));
    let grid = service.upload(&part(b"surface")).expect(201).json();
    let body =
        json!({ "upload": grid["id"], "method": "brdf", "options": { "pixel_um": 0.1, "range_um": 0.2, "size": 32 } });
    let job = service.post("/api/v1/reconstructions", &body).expect(202).json();
    let path = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
    let done = service.until(&path, |job| job["state"] != "queued" && job["state"] != "running");
    assert_eq!(done["state"], "done", "{done}");
    let job = ask(json!({})).expect(202).json();
    let path = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
    let failed = service.until(&path, |job| job["state"] != "queued" && job["state"] != "running");
    let error = failed["error"].to_string();
    assert!(error.contains("with pixel_um") && !error.contains("--"), "{error}");
    // Results are deleted after confirmation; an upload is deleted with the last result that uses it.
    let first = served_path(&service, &upload["id"]);
    let uploaded = place.path("data/uploads").join(upload["id"].as_str().unwrap());
    for (k, path) in first.iter().enumerate() {
        let id = path.rsplit('/').next().unwrap();
        let deletion = service.get(&format!("{path}/deletion")).expect(200).json();
        let (token, last) = (deletion["token"].as_str().unwrap(), k + 1 == first.len());
        assert_eq!(
            deletion["files"].as_u64().unwrap() > 0,
            last || place.path("data/reconstructions").join(id).exists()
        );
        service.send("DELETE", &format!("{path}?token=wrong"), &[], b"").expect(409);
        assert!(uploaded.exists());
        service.send("DELETE", &format!("{path}?token={token}"), &[], b"").expect(204);
        service.get(path).expect(404);
        service.send("DELETE", &format!("{path}?token={token}"), &[], b"").expect(404);
        assert!(!place.path("data/reconstructions").join(id).exists() && uploaded.exists() != last, "{k}");
    }
    assert_eq!(service.get("/api/v1/reconstructions").expect(200).json()["items"].as_array().unwrap().len(), 1);
}

/// Reconstructions of an upload.
fn served_path(service: &Service, upload: &Value) -> Vec<String> {
    let all = service.get("/api/v1/reconstructions").expect(200).json();
    let own = all["items"].as_array().unwrap().iter().filter(|job| &job["upload"] == upload);
    own.map(|job| format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap())).collect()
}

#[test]
fn heights_show_what_is_read_from_a_file() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let row = |y: usize| {
        (0..20).map(|x| format!("{},{:02}", (x * x + 3 * y) % 90, (7 * x + y) % 100)).collect::<Vec<_>>().join(";")
    };
    let text = format!(
        "Breite: 3,0 \u{b5}m\nHöhe: 3,0 \u{b5}m\nWerteeinheit: nm\n{}\n",
        (0..20).map(row).collect::<Vec<_>>().join("\n")
    );
    std::fs::write(dir.join("a.csv"), text.encode_utf16().flat_map(u16::to_be_bytes).collect::<Vec<u8>>()).unwrap();
    let report = brdf(dir, "heights a.csv --out a.exr").expect(0).json();
    let quality = &report["quality"];
    assert!((number(&quality["pixel_um"]) - 0.15).abs() < 1e-9 && quality["width"] == 20, "{report}");
    assert!(quality["notes"].to_string().contains("UTF-16 BE"), "{report}");
    let map = read_exr(&dir.join("a.exr")).unwrap();
    assert!((map.channels["height"][1] - map.channels["height"][0] - 1.07e-3).abs() < 1e-6);
    assert!(dir.join("a.png").is_file());
    // The map holds the same heights.
    let again = brdf(dir, "heights a.exr --out b.exr").expect(0).json();
    assert!((number(&again["quality"]["rms_um"]) - number(&quality["rms_um"])).abs() < 1e-7);
    for (flags, word) in
        [("--pixel-um 0.2", "--pixel-um says 0.2"), ("--range-um 4", "--range-um says 4"), ("--channel 2", "--channel")]
    {
        let error = brdf(dir, &format!("heights a.csv {flags} --out c.exr")).expect(2).stderr();
        assert!(error.contains(word), "{error}");
    }
}

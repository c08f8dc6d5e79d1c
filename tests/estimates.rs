//! Predictions of time, memory and disk space. `tests/estimates` measures their accuracy.

#![allow(clippy::unwrap_used)]

use crate::limits::peak_memory;
use nacre_processing::image::{Attribute, write_exr};
use nacre_tests::http::{Service, begin, finished, plan};
use nacre_tests::{BENCH, Place, nacre};
use serde_json::json;
use std::fs;
use std::path::Path;

fn bytes_in(folder: &Path) -> u64 {
    fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().metadata().unwrap().len()).sum()
}

#[test]
fn an_estimate_writes_nothing_and_is_of_the_size_that_comes() {
    let place = Place::with_bench("", "camera = { width = 256, height = 256 }\n");
    let (session, out) = (place.text("session"), place.text("out"));
    nacre(["sim", "render", "--bench", &place.text("bench.toml"), "--angles-deg", "0,45,90,135", "--out", &session])
        .expect(0);
    for model in ["plain", "auto"] {
        let command = ["--json", "reconstruct", "polarization", &session, "--model", model, "--out", &out];
        let estimate = nacre(command.iter().chain(&["--estimate"])).expect(0).json();
        assert!(!place.path("out").exists(), "something was written");
        assert!(estimate["seconds"].as_f64().unwrap() > 0.0 && estimate["memory_bytes"].as_f64().unwrap() > 1e6);
        nacre(command).expect(0);
        let ratio = estimate["disk_bytes"].as_f64().unwrap() / bytes_in(&place.path("out")) as f64;
        assert!((0.67..1.5).contains(&ratio), "{model}: {ratio}");
        fs::remove_dir_all(place.path("out")).unwrap();
    }
    let bound =
        nacre(["--json", "reconstruct", "polarization", &session, "--out", &out, "--estimate"]).expect(0).json();
    let peak = 1024 * peak_memory(&place.path("session"), &place.path("out"));
    assert!(peak <= bound["memory_bytes"].as_u64().unwrap(), "{peak} bytes taken, {bound}");
    fs::remove_dir_all(place.path("out")).unwrap();
    let text = nacre(["reconstruct", "polarization", &session, "--out", &out, "--estimate"]).expect(0).stdout();
    assert!(["time", "memory", "disk"].iter().all(|word| text.contains(word)), "{text}");
    nacre(["reconstruct", "polarization", &place.text("nothing"), "--out", &out, "--estimate"]).expect(2);
    assert!(nacre(["doctor", "--data", &place.text("")]).stdout().contains("times the speed of the reference machine"));
}

#[test]
fn maps_height_fields_and_calibrations_are_estimated() {
    let place = Place::new("");
    let [height, maps, out] = ["h.exr", "maps", "out"].map(|name| place.text(name));
    nacre(["brdf", "surface", "blazed", "--period-um", "2.5", "--depth-um", "0.3", "--out", &height]).expect(0);
    let line = ["--json", "brdf", "map", &height, "--out", &place.text("map.exr"), "--estimate"];
    assert!(nacre(line).expect(0).json()["seconds"].as_f64().unwrap() > 0.0);
    assert!(!place.path("map.exr").exists(), "something was written");

    nacre(["sim", "render", "--sample", "cd", "--size", "32", "--angles-deg", "0,45,90", "--out", &place.text("in")])
        .expect(0);
    nacre(["reconstruct", "polarization", &place.text("in"), "--out", &maps]).expect(0);
    let disk = |size: &str| {
        let line = ["--json", "map", "edit", &maps, "--size", size, "--out", &out, "--estimate"];
        let disk = nacre(line).expect(0).json()["disk_bytes"].as_f64().unwrap();
        assert!(!place.path("out").exists(), "something was written");
        disk
    };
    // Proportional to the pixels of the result.
    assert!((3.9..4.1).contains(&(disk("512,512") / disk("256,256"))));

    fs::create_dir(place.path("boards")).unwrap();
    let seconds = |photographs: usize| {
        let board = place.text(&format!("boards/{photographs}.png"));
        nacre(["calibrate", "board", "--panel-px", "1920,1080", "--square-px", "120", "--out", &board]).expect(0);
        let boards = place.text("boards");
        let line =
            ["calibrate", "geometry", &boards, "--board", "9x6", "--square-mm", "25", "--out", &out, "--estimate"];
        let seconds = nacre(["--json"].iter().chain(&line)).expect(0).json()["seconds"].as_f64().unwrap();
        assert!(!place.path("out").exists(), "something was written");
        seconds
    };
    let one = seconds(1);
    assert!(seconds(2) > one);
}

#[test]
fn renderings_factors_and_the_demo_are_estimated() {
    let place = Place::new("");
    let [scene, picture, turning, out] = ["cd.toml", "cd.exr", "turning", "out"].map(|name| place.text(name));
    let text = "camera = { position = [0, 0, 500], target = [0, 0, 0], fov_deg = 16, width = 64, height = 64 }\n\
                [[shape]]\ntype = \"plane\"\nsize = [100, 100]\nmaterial = \"white\"\n\
                [[light]]\ntype = \"point\"\nposition = [0, 300, 400]\nsigma_mm = 2\n\
                [material.white.base]\nalbedo = [0.5, 0.5, 0.5]\n";
    fs::write(&scene, text).unwrap();
    let estimate = |line: &[&str], output: &str| {
        let estimate = nacre(["--json"].iter().chain(line).chain(&["--estimate"])).expect(0).json();
        assert!(!place.path(output).exists(), "{output} was written");
        estimate
    };
    let one = estimate(&["render", &scene, "--out", &picture], "cd.exr");
    let ten = ["render", &scene, "--out", &turning, "--frames", "10", "--turn", "light"];
    let ten = estimate(&ten, "turning");
    assert_eq!(10 * one["disk_bytes"].as_u64().unwrap(), ten["disk_bytes"].as_u64().unwrap());
    nacre(["render", "--gallery", &out, "--estimate"]).expect(2);

    let demo = |size: &str| estimate(&["demo", "--size", size, "--out", &out], "out")["seconds"].as_f64().unwrap();
    assert!(demo("512") > demo("128"));

    let table = place.text("table.exr");
    let extent = [("extent", Attribute::Text("0.5".into()))];
    write_exr(Path::new(&table), 64, 64, &["X", "Y", "Z"], &extent, &|_, _, row| row.fill(1.0)).unwrap();
    let line = ["factor", &table, "--out", &out];
    let whole = estimate(&line, "out")["seconds"].as_f64().unwrap();
    let curve = [line.as_slice(), &["--kind", "line"]].concat();
    assert!(estimate(&curve, "out")["seconds"].as_f64().unwrap() < whole);
}

#[test]
fn the_service_says_what_is_to_come() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let id = begin(&service, &plan(4, 5.0));
    finished(&service, &id);
    let wanted = json!({ "session": id });
    let needs = service.post("/api/v1/reconstructions/estimate", &wanted).expect(200).json();
    assert!(needs["seconds"].as_f64().unwrap() > 0.0 && needs["disk_bytes"].as_u64().unwrap() > 0, "{needs}");
    assert!(needs["memory_bytes"].as_u64().unwrap() > 0);
    assert!(service.get("/api/v1/reconstructions").expect(200).json()["items"].as_array().unwrap().is_empty());
    service.post("/api/v1/reconstructions/estimate", &json!({ "session": id, "options": { "modle": 1 } })).expect(400);
    service.post("/api/v1/reconstructions/estimate", &json!({})).expect(400);

    let metered = json!({ "plan": {
        "kind": "polarization", "analyser": { "angles_deg": [0, 60, 120] }, "reconstruct": { "operation": "polarization" }
    } });
    let metered = service.post("/api/v1/plans/estimate", &metered).expect(200).json();
    let of_metering = metered["metering_seconds"].as_f64().unwrap();
    assert!(of_metering > 0.0 && metered["seconds"].as_f64().unwrap() > of_metering, "{metered}");
    assert!(metered["results_seconds"].as_f64().unwrap() > 0.0 && metered["results_bytes"].as_u64().unwrap() > 0);
    let stated = json!({ "plan": {
        "kind": "polarization", "analyser": { "angles_deg": [0, 60, 120] }, "camera": { "exposure_ms": 5 }
    } });
    let stated = service.post("/api/v1/plans/estimate", &stated).expect(200).json();
    assert!(stated["metering_seconds"] == 0.0 && stated["results_seconds"].is_null(), "{stated}");
}

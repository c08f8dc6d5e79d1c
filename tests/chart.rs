//! `nacre chart` from end to end: quick charts, interrupted and resumed.

#![allow(clippy::unwrap_used)]

use nacre_tests::{command, listing, nacre};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

fn chart<'a>(names: &[&'a str], out: &'a Path) -> Vec<&'a str> {
    let fixed = ["--json", "chart", "--quick", "--seed", "5", "--out", out.to_str().unwrap()];
    fixed.into_iter().chain(names.iter().copied()).collect()
}

/// Measurements without their times, which vary between runs.
fn measurements(file: &Path) -> Vec<serde_json::Value> {
    let text = std::fs::read_to_string(file).unwrap();
    let parse = |line: &str| {
        let mut value: serde_json::Value = serde_json::from_str(line).unwrap();
        value.as_object_mut().unwrap().remove("seconds");
        value
    };
    text.lines().map(parse).collect()
}

#[test]
fn quick_charts_hold_what_they_promise() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("charts");
    let charted = nacre(chart(&["frames", "stress-backlash", "stress-noise", "maps"], &out)).expect(0).json();
    let charts = charted["charts"].as_array().unwrap();
    let names: Vec<&str> = charts.iter().map(|c| c["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["frames", "stress-noise", "stress-backlash", "stress-overview", "maps"]);
    for file in charts.iter().flat_map(|c| c["files"].as_array().unwrap()) {
        assert!(std::fs::metadata(out.join(file.as_str().unwrap())).unwrap().len() > 100, "{file}");
    }
    let page = std::fs::read_to_string(out.join("index.html")).unwrap();
    assert!(names.iter().all(|n| page.contains(&format!("{n}/{n}.svg"))));
    assert_theory(&out);
    assert_map_is_drawn(&out.join("maps/maps.png"));
    // No measurement is repeated, and measurements of another seed are kept apart.
    let before = std::fs::read(out.join("frames/raw.jsonl")).unwrap();
    nacre(chart(&["frames"], &out)).expect(0);
    assert_eq!(std::fs::read(out.join("frames/raw.jsonl")).unwrap(), before);
    let out = out.to_str().unwrap();
    let other = nacre(["chart", "--quick", "--seed", "6", "frames", "--out", out]).expect(2);
    assert!(other.stderr().contains("--seed 5"), "{}", other.stderr());
    assert!(!listing(Path::new(out)).iter().any(|n| n.starts_with(".tmp")));
}

/// The error decreases with the number of frames as σ_I / (√(2N) B), within 10 % for the few pixels of a quick run.
fn assert_theory(out: &Path) {
    let text = std::fs::read(out.join("frames/frames.json")).unwrap();
    let summary: serde_json::Value = serde_json::from_slice(&text).unwrap();
    let points = summary["points"].as_array().unwrap();
    assert_eq!(points.len(), 9 * 6);
    for p in points.iter().filter(|p| p["scene"] == 4) {
        let (error, theory) = (p["error"]["median"].as_f64().unwrap(), p["predicted"].as_f64().unwrap());
        assert!((error / theory - 1.0).abs() < 0.1, "{p}");
    }
}

/// The maps are embedded pictures: many colours at the position of the first one.
fn assert_map_is_drawn(png: &Path) {
    let image = image::open(png).unwrap().to_rgb8();
    let colors: std::collections::HashSet<_> = (0..200).map(|k| image.get_pixel(140 + k, 340).0).collect();
    assert!(colors.len() > 30, "{}", colors.len());
}

#[test]
fn an_interrupted_chart_goes_on_where_it_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, pieces) = (folder.path().join("whole"), folder.path().join("pieces"));
    nacre(chart(&["frames"], &whole)).expect(0);
    let raw = pieces.join("frames/raw.jsonl");
    let (mut begun, _) = command();
    let mut child = begun.args(chart(&["frames"], &pieces)).spawn().unwrap();
    let start = Instant::now();
    while std::fs::read_to_string(&raw).unwrap_or_default().lines().count() < 20 {
        assert!(start.elapsed() < Duration::from_secs(60), "nothing is measured");
        std::thread::sleep(Duration::from_millis(1));
    }
    assert!(Command::new("kill").args(["-KILL", &child.id().to_string()]).status().unwrap().success());
    child.wait().unwrap();
    assert!(!pieces.join("index.html").exists(), "the kill came too late to test anything");
    nacre(chart(&["frames"], &pieces)).expect(0);
    assert_eq!(measurements(&raw), measurements(&whole.join("frames/raw.jsonl")));
}

#[test]
fn names_are_checked_and_listed() {
    let list = nacre(["--json", "chart", "--list"]).expect(0).json();
    assert!(list.as_array().unwrap().iter().any(|l| l["name"] == "stress-zeta"));
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("x");
    let wrong = nacre(["chart", "stres-zeta", "--out", out.to_str().unwrap()]).expect(2);
    assert!(wrong.stderr().contains("did you mean stress-zeta") && !out.exists(), "{}", wrong.stderr());
    std::fs::write(folder.path().join("notes"), "").unwrap();
    nacre(["chart", "maps", "--out", folder.path().to_str().unwrap()]).expect(2);
    assert_eq!(listing(folder.path()), ["notes"]);
    nacre(["chart", "--quick", "--runs", "1", "maps", "--out", out.to_str().unwrap()]).expect(2);
}

#[test]
fn the_service_lists_charts_and_gives_their_files() {
    use nacre_tests::Place;
    use nacre_tests::http::Service;
    let place = Place::with_bench("", "camera = { width = 64, height = 48 }");
    let folder = place.path("data/charts/first");
    nacre(chart(&["maps"], &folder)).expect(0);
    std::fs::write(place.path("data/secret"), "x").unwrap();
    std::fs::create_dir(place.path("data/charts/damaged")).unwrap();
    std::fs::write(place.path("data/charts/damaged/charts.json"), "{").unwrap();
    let service = Service::start(&place, &[]);
    let items = service.get("/api/v1/charts").expect(200).json();
    assert_eq!(items["items"].as_array().unwrap().len(), 1, "{items}");
    assert_eq!(items["items"][0]["charts"][0]["name"], "maps");
    let png = service.get("/api/v1/charts/first/maps/maps.png").expect(200);
    assert_eq!(png.header("content-type").as_deref(), Some("image/png"));
    assert_eq!(png.body, std::fs::read(folder.join("maps/maps.png")).unwrap());
    for wrong in ["first/maps/none.png", "../../secret", "first/..%2f..%2f../secret", "%2e%2e/x/secret"] {
        service.get(&format!("/api/v1/charts/{wrong}")).expect(404);
    }

    // Deleted after confirmation, without affecting other files.
    std::os::unix::fs::symlink(&folder, place.path("data/charts/link")).unwrap();
    for wrong in ["none", "damaged", "link", "..", "%2e%2e", "..%2fcharts%2ffirst"] {
        service.get(&format!("/api/v1/charts/{wrong}/deletion")).expect(404);
        service.send("DELETE", &format!("/api/v1/charts/{wrong}?token=x"), &[], b"").expect(404);
    }
    let deletion = service.get("/api/v1/charts/first/deletion").expect(200).json();
    assert!(deletion["files"].as_u64().unwrap() >= 3 && deletion["bytes"].as_u64().unwrap() > 1000, "{deletion}");
    service.send("DELETE", "/api/v1/charts/first?token=x", &[], b"").expect(409);
    let token = deletion["token"].as_str().unwrap();
    service.send("DELETE", &format!("/api/v1/charts/first?token={token}"), &[], b"").expect(204);
    assert!(!folder.exists() && place.path("data/secret").exists() && place.path("data/charts/damaged").exists());
    assert!(service.get("/api/v1/charts").expect(200).json()["items"].as_array().unwrap().is_empty());
}

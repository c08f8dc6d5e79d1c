//! Merging of exposures from a user's point of view: existing photographs, a simulated session, and REST.

#![allow(clippy::unwrap_used)]

use nacre_processing::image::{read_exr, write_png8};
use nacre_tests::http::{Service, begin, finished};
use nacre_tests::{Place, nacre, test_data};
use serde_json::{Value, json};
use std::path::Path;

/// A compact disc.
const BENCH: &str = "camera = { width = 96, height = 64 }\nsample = { kind = \"cd\" }\nflash = { power = 300 }";

/// Under the flash, with exposures metered by the plan.
const PLAN: &str = r#"
kind = "flash"
bracket = { step_ev = 2, at_most = 4 }
extras = ["display_black"]
reconstruct = { operation = "hdr" }
"#;

fn bracket(folder: &Path) {
    std::fs::create_dir(folder).unwrap();
    let light = |i: usize| 0.2 * 1000_f64.powf((i % 256) as f64 / 255.0);
    let mut frames = vec![];
    for (k, time) in [0.005, 0.05, 0.5].into_iter().enumerate() {
        let code = |i: usize| ((light(i) * time).min(1.0).powf(1.0 / 2.2) * 255.0).round() as u8;
        let codes: Vec<u8> = (0..256 * 64).map(code).collect();
        write_png8(&folder.join(format!("{k}.png")), 256, 64, 1, &codes).unwrap();
        frames.push(json!({ "file": format!("{k}.png"), "exposure_s": time }));
    }
    let set = json!({ "kind": "exposures", "transfer": { "gamma": 2.2 }, "frames": frames });
    std::fs::write(folder.join("frames.json"), set.to_string()).unwrap();
}

#[test]
fn a_bracket_is_merged_and_nothing_is_overwritten_unasked() {
    let dir = tempfile::tempdir().unwrap();
    let (photos, out) = (dir.path().join("photos"), dir.path().join("out"));
    bracket(&photos);
    let args = |more: &[&str]| {
        let all = ["--json", "reconstruct", "hdr", photos.to_str().unwrap(), "--out", out.to_str().unwrap()];
        all.iter().chain(more).map(|s| (*s).to_owned()).collect::<Vec<_>>()
    };
    let report = nacre(args(&[])).expect(0).json();
    assert_eq!((report["method"].as_str(), report["channels"][0].as_str()), (Some("hdr"), Some("Y")));
    let merged = read_exr(&out.join("hdr.exr")).unwrap();
    // Brightest and darkest positions that are well exposed in at least one photograph.
    for x in [10, 100, 200, 250] {
        let truth = 0.2 * 1000_f64.powf(x as f64 / 255.0);
        let found = f64::from(merged.channels["Y"][256 * 20 + x]);
        // Half a code where the best exposure is at a tenth of white: 2.2 · 0.5 / 90 plus a margin.
        assert!((found / truth - 1.0).abs() < 0.014, "{x}: {found} {truth}");
    }
    for name in ["variance.exr", "flags.exr", "hdr.png", "report.json"] {
        assert!(out.join(name).is_file(), "{name}");
    }
    assert!(nacre(args(&[])).expect(2).stderr().contains("--force"));
    nacre(args(&["--force", "--max-error", "0.1"])).expect(0);
    assert!(nacre(args(&["--force", "--max-error", "1e-6"])).expect(1).stderr().contains("0.000001"));
    let recovered = nacre(args(&["--force", "--response", "recover"])).expect(0).json();
    assert_eq!(recovered["response"], "recovered");
    let again = out.join("response.json");
    let kept = dir.path().join("kept.json");
    std::fs::copy(again, &kept).unwrap();
    nacre(args(&["--force", "--response", kept.to_str().unwrap()])).expect(0);
}

#[test]
fn what_cannot_be_merged_is_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let refused = |input: &Path, more: &[&str], said: &str| {
        let all = ["reconstruct", "hdr", input.to_str().unwrap(), "--out", out.to_str().unwrap()];
        let text = nacre(all.iter().chain(more).copied()).expect(2).stderr();
        assert!(text.contains(said), "{said}: {text}");
        assert!(!out.exists());
    };
    // Photographs without Exif data, and an empty folder.
    let bare = dir.path().join("bare");
    std::fs::create_dir(&bare).unwrap();
    refused(&bare, &[], "photograph");
    write_png8(&bare.join("a.png"), 4, 4, 1, &[7; 16]).unwrap();
    refused(&bare, &[], "exposure time");
    let photos = dir.path().join("photos");
    bracket(&photos);
    let path = photos.join("frames.json");
    let text = std::fs::read_to_string(&path).unwrap();
    let changed = |change: &dyn Fn(&mut Value)| {
        let mut set: Value = serde_json::from_str(&text).unwrap();
        change(&mut set);
        std::fs::write(&path, set.to_string()).unwrap();
    };
    changed(&|set| set["frames"][1]["analyser_deg"] = json!(45));
    refused(&photos, &[], "several views");
    // A single exposure does not determine a response.
    changed(&|set| {
        set["frames"].as_array_mut().unwrap().truncate(1);
        set["transfer"] = json!("recover");
    });
    refused(&photos, &[], "response");
    changed(&|_| {});
    for (name, text) in [("words.json", "words"), ("flat.json", "{\"curves\":[[0,0,1]]}"), ("missing.json", "")] {
        let file = dir.path().join(name);
        if !text.is_empty() {
            std::fs::write(&file, text).unwrap();
        }
        refused(&photos, &["--response", file.to_str().unwrap()], name);
    }
}

#[test]
fn a_session_works_its_bracket_out_and_merges_it() {
    let place = Place::with_bench(PLAN, BENCH);
    let session = place.path("session");
    let taken = nacre(place.capture("session")).expect(0).json();
    assert_eq!(taken["report"]["method"], "hdr");
    let exposures: Vec<f64> = serde_json::from_slice::<Value>(&std::fs::read(session.join("session.json")).unwrap())
        .unwrap()["plan"]["exposures_ms"]
        .as_array()
        .unwrap()
        .iter()
        .map(|v| v.as_f64().unwrap())
        .collect();
    assert!(exposures.len() > 1, "{exposures:?}");
    assert!(exposures.windows(2).all(|w| (w[1] / w[0] - 4.0).abs() < 1e-6), "{exposures:?}");
    // The exposures agree within the bench's noise.
    let chi2 = taken["report"]["chi2"].as_f64().unwrap();
    assert!((0.8..1.25).contains(&chi2), "{chi2}");
    let share =
        taken["report"]["samples"]["saturated"].as_f64().unwrap() / taken["report"]["samples"]["all"].as_f64().unwrap();
    assert!(share < 0.01, "{share}");
    assert!(session.join("results/hdr.exr").is_file());
}

#[test]
fn the_service_captures_and_merges_brackets() {
    let place = Place::new("");
    let service = Service::start(&place, &[]);
    let plan =
        json!({ "plan": { "kind": "exposures", "bracket": { "at_most": 3 }, "reconstruct": { "operation": "hdr" } } });
    let id = begin(&service, &plan);
    finished(&service, &id);
    let own = service.get(&format!("/api/v1/reconstructions/{id}")).expect(200).json();
    assert_eq!((own["method"].as_str(), own["report"]["method"].as_str()), (Some("hdr"), Some("hdr")));
    let asked = json!({ "session": id, "method": "hdr", "options": { "align": "off" } });
    let job = service.post("/api/v1/reconstructions", &asked).expect(202).json();
    let path = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
    let done = service.until(&path, |job| job["state"] != "queued" && job["state"] != "running");
    assert_eq!(done["state"], "done", "{done}");
    let files = service.get(&format!("{path}/files")).expect(200).json();
    let names: Vec<&str> = files.as_array().unwrap().iter().filter_map(|f| f["name"].as_str()).collect();
    assert_eq!(names, ["flags.exr", "hdr.exr", "hdr.png", "report.json", "variance.exr"]);
    let picture = service.get(&format!("{path}/files/hdr.png")).expect(200);
    assert!(picture.body.starts_with(b"\x89PNG"));
    service.get(&format!("{path}/files/..%2f..%2fjobs.db")).expect(404);
    let unknown = json!({ "session": id, "method": "hdr", "options": { "respons": "linear" } });
    assert!(service.post("/api/v1/reconstructions", &unknown).expect(400).text().contains("respons"));
}

#[test]
fn a_real_bracket_is_merged() {
    let Some(data) = test_data() else {
        println!("skipped: no test data");
        return;
    };
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let input = data.join("hdr");
    let report = nacre(["--json", "reconstruct", "hdr", input.to_str().unwrap(), "--out", out.to_str().unwrap()]);
    let report = report.expect(0).json();
    assert_eq!(report["frames"].as_array().unwrap().len(), 7);
    // Times from 2 s to 1/4000 s, which is 13 powers of two.
    assert!(report["dynamic_range"].as_f64().unwrap() > 2_f64.powi(10), "{report}");
    assert!(report["response_sigma"].as_f64().unwrap() < 0.02);
}

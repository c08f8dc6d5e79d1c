//! Adaptive series that continue until a required accuracy, and merged exposures.

#![allow(clippy::unwrap_used)]

use nacre_tests::http::Service;
use nacre_tests::{BenchProcess, Place, command, data, nacre};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::process::Stdio;

/// A plan with a required σ; its reconstruction uses the model that determines it.
fn plan(analyser: &str, more: &str) -> String {
    format!(
        "kind = \"polarization\"\nanalyser = {{ {analyser} }}\nextras = [\"display_black\"]\n{more}
         reconstruct = {{ operation = \"polarization\", options = {{ model = \"sinusoid\" }} }}"
    )
}

const EXPOSED: &str = "camera = { exposure_ms = 20 }";

/// Additions and end of the series, from the journal.
fn series(session: &Path) -> (Vec<f64>, Value) {
    let journal = fs::read_to_string(session.join("journal")).unwrap();
    let entries: Vec<Value> =
        journal.lines().map(|l| serde_json::from_str::<Value>(l).unwrap()["entry"].take()).collect();
    let chosen = entries.iter().filter_map(|e| e["chosen"]["analyser_deg"].as_f64()).collect();
    (chosen, entries.iter().find(|e| e["ended"].is_object()).map_or(Value::Null, |e| e["ended"].clone()))
}

#[test]
fn a_series_ends_when_its_sigma_is_as_wanted() {
    let place = Place::new(&plan("start = 4, until_sigma_deg = 0.6", EXPOSED));
    let bench = place.text("bench.toml");
    let range = nacre(["--json", "plan", "estimate", &place.text("plan.toml"), "--bench", &bench]).expect(0).json();
    let run = nacre(place.capture("s")).expect(0).json();
    let (chosen, end) = series(&place.path("s"));
    let frames = run["frames"].as_u64().unwrap();
    assert!(!chosen.is_empty() && frames == 5 + chosen.len() as u64, "{run}");
    assert!(chosen.iter().all(|a| a.fract() == 0.0 && (0.0..180.0).contains(a)), "{chosen:?}");
    assert_eq!((&end["why"], &run["ended"]), (&json!("met"), &end));
    // The σ reported during the capture agrees with the reconstruction.
    let report: Value = serde_json::from_slice(&fs::read(place.path("s/results/report.json")).unwrap()).unwrap();
    let sigma = report["pixels"]["sigma_p90_deg"].as_f64().unwrap();
    assert!(sigma <= 0.6 && (sigma / end["sigma_deg"].as_f64().unwrap() - 1.0).abs() < 1e-3, "{sigma} {end}");
    let set: Value = serde_json::from_slice(&fs::read(place.path("s/frames.json")).unwrap()).unwrap();
    assert_eq!(set["frames"].as_array().unwrap().len(), 4 + chosen.len());
    assert_eq!(set["frames"][4]["analyser_deg"].as_f64(), Some(chosen[0]));
    // Frames and time lie within the estimate.
    let device_s = run["timing"]["device_s"].as_f64().unwrap();
    assert_eq!((&range["least"]["frames"], &range["frames"]), (&json!(5), &json!(25)));
    let (least, most) = (range["least"]["seconds"].as_f64().unwrap(), range["seconds"].as_f64().unwrap());
    assert!(0.9 * least < device_s && device_s < 1.1 * most, "{range} {device_s}");
    let check = nacre(["--json", "check", &place.text("s")]).expect(0).json();
    assert_eq!((&check["planned"], &check["ended"]["why"]), (&json!(frames), &json!("met")));
    // Reconstruction of the whole session yields the live maps.
    let whole = ["reconstruct", "polarization", &place.text("s"), "--model", "sinusoid", "--out", &place.text("whole")];
    nacre(whole).expect(0);
    let [live, whole] = ["s/results", "whole"].map(|f| fs::read(place.path(f).join("orientation.exr")).unwrap());
    assert!(live == whole);
}

#[test]
fn what_cannot_be_reached_is_said_and_what_was_taken_is_kept() {
    for (wanted, at_most, why, frames, words) in [
        (0.01, 8, "cannot", 4, "at least"),
        // Missed by less than a fifth, so that further angles are worth trying.
        (0.7, 5, "at_most", 5, "all angles"),
    ] {
        let place = Place::new(&plan(&format!("until_sigma_deg = {wanted}, at_most = {at_most}"), EXPOSED));
        let run = nacre(place.capture("s")).expect(0);
        assert!(run.stderr().contains("warning") && run.stderr().contains(words), "{}", run.stderr());
        let json = run.json();
        assert_eq!((&json["ended"]["why"], &json["frames"]), (&json!(why), &json!(frames + 1)), "{json}");
        nacre(["check", &place.text("s")]).expect(0);
        assert!(place.path("s/results/orientation.exr").exists());
    }
}

#[test]
fn a_dry_run_says_what_may_come() {
    let place = Place::new(&plan("until_sigma_deg = 0.3, at_most = 6", EXPOSED));
    let steps = nacre(place.capture("s").into_iter().chain(["--dry-run".into()])).expect(0).json();
    let steps = steps.as_array().unwrap();
    let open: Vec<bool> = steps.iter().map(|s| s["if_needed"] == true).collect();
    assert_eq!(open, [false, false, false, false, false, true, true]);
    assert!(!place.path("s").exists());
    let check = nacre(["plan", "check", &place.text("plan.toml"), "--bench", &place.text("bench.toml")]).expect(0);
    assert!(check.stdout().contains("5 to 7 frames"), "{}", check.stdout());
}

/// A series killed before any disk operation and resumed has the same angles and identical bytes.
#[test]
fn a_killed_series_goes_on_to_the_same_angles() {
    let more = "exposures_ms = [5, 20]\n";
    let place = Place::new(&plan("start = 3, until_sigma_deg = 0.7", more));
    nacre(place.capture("whole")).expect(0);
    let (whole, angles) = (data(&place.path("whole")), series(&place.path("whole")));
    assert!(angles.0.len() >= 2 && angles.1["why"] == "met", "{angles:?}");
    let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &[]);
    let mut killed = 0;
    loop {
        let (mut command, _) = command();
        command.args(Place::on(place.capture("s"), &bench)).env("NACRE_DIE_AT", killed.to_string());
        let status = command.stdout(Stdio::null()).stderr(Stdio::null()).status().unwrap();
        let again = if place.path("s/session.json").exists() { place.resume("s") } else { place.capture("s") };
        nacre(Place::on(again, &bench)).expect(0);
        assert!(data(&place.path("s")) == whole, "killed at {killed}: the data set differs");
        assert_eq!(series(&place.path("s")), angles, "killed at {killed}");
        nacre(["check", &place.text("s")]).expect(0);
        fs::remove_dir_all(place.path("s")).unwrap();
        if status.success() {
            break;
        }
        // All kinds of disk operation, at various positions in the series.
        killed += 3;
    }
    assert!(killed > 60, "{killed}");
}

/// Frames damaged afterwards are captured again at their angles; the series does not change.
#[test]
fn spoiled_frames_of_a_series_are_taken_again() {
    let place = Place::new(&plan("until_sigma_deg = 0.6", EXPOSED));
    nacre(place.capture("s")).expect(0);
    let (whole, before) = (data(&place.path("s")), series(&place.path("s")));
    for file in ["s/frames/0001.png", "s/frames/0004.png"] {
        fs::write(place.path(file), b"spoiled").unwrap();
    }
    assert_eq!(nacre(["--json", "check", &place.text("s")]).expect(1).json()["trouble"].as_array().unwrap().len(), 2);
    nacre(place.resume("s")).expect(0);
    assert!(data(&place.path("s")) == whole && series(&place.path("s")) == before);
}

/// Exposures at each angle: each frame has its own dark frame, and they are merged. σ is lower than for the best single
/// exposure, as predicted for fewer angles.
#[test]
fn exposures_at_each_angle_are_merged() {
    let angles = "angles_deg = [0, 30, 60, 90, 120, 150]";
    let sigma = |more: &str| {
        let place = Place::new(&plan(angles, more));
        nacre(place.capture("s")).expect(0);
        let whole = ["--json", "reconstruct", "polarization", &place.text("s"), "--model", "sinusoid", "--out"];
        let report = nacre(whole.into_iter().chain([place.text("whole").as_str()])).expect(0).json();
        let [live, whole] = ["s/results", "whole"].map(|f| fs::read(place.path(f).join("orientation.exr")).unwrap());
        assert!(live == whole, "{more}");
        (report["pixels"]["sigma_median_deg"].as_f64().unwrap(), report, place)
    };
    let (one, ..) = sigma("camera = { exposure_ms = 20 }");
    let (both, report, place) = sigma("exposures_ms = [5, 20]");
    assert_eq!((&report["brackets"], report["frames"].as_array().unwrap().len()), (&json!(6), 12));
    let set: Value = serde_json::from_slice(&fs::read(place.path("s/frames.json")).unwrap()).unwrap();
    assert_eq!((&set["frames"][1]["dark"], &set["dark"]), (&json!("frames/display_black_01.png"), &Value::Null));
    // 25 ms of light instead of 20 ms, with angles weighted by their accuracy, unlike in the plain fit.
    let gain = one / both;
    assert!((1.1..1.25).contains(&gain), "{one} {both}");
}

#[test]
fn the_service_tells_how_a_series_goes() {
    let place = Place::with_bench("", "camera = { width = 64, height = 48 }");
    let service = Service::start(&place, &[]);
    let plan = json!({ "plan": {
        "kind": "polarization", "camera": { "exposure_ms": 20 },
        "analyser": { "start": 4, "until_sigma_deg": 0.6, "at_most": 24 }
    } });
    let checked = service.post("/api/v1/plans/check", &plan).expect(200).json();
    assert_eq!((&checked["least_frames"], &checked["frames"]), (&json!(4), &json!(24)), "{checked}");
    let cost = service.post("/api/v1/plans/estimate", &plan).expect(200).json();
    assert!(cost["least_seconds"].as_f64().unwrap() < cost["seconds"].as_f64().unwrap(), "{cost}");
    let id = service.post("/api/v1/sessions", &plan).expect(202).json()["id"].as_str().unwrap().to_owned();
    let base = format!("/api/v1/sessions/{id}");
    let stream = service.send("GET", &format!("{base}/events"), &[], b"").expect(200).text();
    let session = service.until(&base, |s| s["state"] == "finished");
    let told = stream.matches("event: sigma").count() + stream.matches("event:sigma").count();
    let angles = session["sigma"]["angles"].as_u64().unwrap() as usize;
    assert_eq!((told, &session["ended"]), (angles - 3, &json!("met")), "{session}");
    assert_eq!((&session["frames_planned"], &session["frames_committed"]), (&json!(angles), &json!(angles)));
    assert_eq!(service.get(&format!("{base}/frames")).expect(200).json()["items"].as_array().unwrap().len(), angles);
    let wrong = json!({ "plan": { "kind": "polarization", "analyser": { "until_sigma_deg": -1 } } });
    assert!(service.post("/api/v1/plans/check", &wrong).expect(400).text().contains("until_sigma_deg"));
}

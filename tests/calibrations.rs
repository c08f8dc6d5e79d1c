//! Sessions of kind calibration; stored calibrations, their choice for sessions, and their requests.

#![allow(clippy::unwrap_used)]

use nacre_processing::image::{read_exr, write_exr};
use nacre_tests::http::{Service, begin, finished};
use nacre_tests::{BENCH, BenchProcess, Place, command, data, nacre};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::process::Stdio;

/// A camera out of focus, for even light.
const EVEN: &str = "camera = { width = 64, height = 48, blur_px = 8 }\n";

const CAMERA: &str =
    r#"{ "camera": { "noise": { "full_scale_e": 30000, "read_noise_e": 6 }, "black": 60, "white": 4000, "gain": 1 } }"#;
const ANALYSER: &str = r#"{ "analyser": { "zero_deg": 1.5, "zero_sigma_deg": 0.01, "sense": 1 } }"#;
const FLAT: &str = r#"{ "flat": { "file": "flat.exr", "sigma": 0.001 } }"#;

/// A session with results, on calibrations in the folder `kept`.
const ANGLES: &str =
    "kind = \"polarization\"\ncamera = { exposure_ms = 20 }\nanalyser = { angles_deg = [0, 45, 90, 135] }
    reconstruct = { operation = \"polarization\", options = { model = \"plain\" } }\n";

fn json_file(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// Writes results of a calibration; the flat field of this size is twice as bright on the right as on the left.
fn results_of(folder: &Path, values: &str, [width, height]: [usize; 2]) {
    fs::create_dir_all(folder).unwrap();
    fs::write(folder.join("calibration.json"), values).unwrap();
    fs::write(folder.join("report.json"), "{}").unwrap();
    let row = |_: usize, _: usize, row: &mut [f32]| {
        row.iter_mut().enumerate().for_each(|(x, v)| *v = if 2 * x < width { 0.5 } else { 1.0 });
    };
    write_exr(&folder.join("flat.exr"), width, height, &["flat"], &[], &row).unwrap();
}

fn results(folder: &Path, values: &str) {
    results_of(folder, values, [64, 48]);
}

/// Keeps a calibration of these devices; returns its identifier.
fn keep(place: &Place, values: &str, devices: &[&str]) -> String {
    results(&place.path("result"), values);
    let (result, kept) = (place.text("result"), place.text("kept"));
    let mut args = vec!["--json", "calibrate", "keep", &result, "--calibrations", &kept];
    devices.iter().for_each(|device| args.extend(["--device", device]));
    nacre(args).expect(0).json()["id"].as_str().unwrap().to_owned()
}

/// Arguments of a capture that uses the calibrations in `kept`.
fn capture(place: &Place, session: &str) -> Vec<String> {
    place.capture(session).into_iter().chain(["--calibrations".into(), place.text("kept")]).collect()
}

#[test]
fn frames_of_a_camera_name_their_dark_frames_and_reconstruct() {
    let plan = "kind = \"calibration\"\nname = \"gain 1\"\ncalibration = { of = \"camera\", levels = 6 }";
    let place = Place::with_bench(plan, EVEN);
    nacre(place.capture("s")).expect(0);
    let (session, set) = (json_file(&place.path("s/session.json")), json_file(&place.path("s/frames.json")));
    let frames = set["frames"].as_array().unwrap();
    let metered = session["exposure_s"].as_f64().unwrap();
    assert_eq!((frames.len(), &session["plan"]["reconstruct"]["operation"]), (12, &json!("camera")));
    for (k, pair) in frames.chunks(2).enumerate() {
        let share = pair[0]["exposure_s"].as_f64().unwrap() / metered;
        let wanted = if k == 5 { 2.0 } else { 0.02 + 0.98 * k as f64 / 4.0 };
        assert!((share - wanted).abs() < 1e-3, "{share}");
        let darks = [0, 1].map(|copy| json!(format!("frames/dark_{k:02}_{copy}.png")));
        assert_eq!(
            ([&pair[0]["dark"], &pair[1]["dark"]], &pair[0]["exposure_s"]),
            ([&darks[0], &darks[1]], &pair[1]["exposure_s"])
        );
        assert!(darks.iter().all(|dark| place.path("s").join(dark.as_str().unwrap()).exists()));
    }
    let noise = json_file(&place.path("s/results/report.json"))["noise"]["full_scale_e"].as_f64().unwrap();
    // Four standard deviations of the gain, from four exposures of some 3,000 pixels.
    assert!((noise / 40_000.0 - 1.0).abs() < 0.05, "{noise}");
    // Results that are computed again, here beside a calibration, are kept once.
    let result = place.path("s/results");
    fs::remove_file(result.join("report.json")).unwrap();
    fs::write(result.join("calibration.json"), CAMERA).unwrap();
    let resumed: Vec<String> =
        place.resume("s").into_iter().chain(["--calibrations".into(), place.text("kept")]).collect();
    let kept = nacre(["--json".to_owned()].into_iter().chain(resumed.clone())).expect(0).json();
    assert_eq!((&kept["kept"]["kind"], &kept["kept"]["name"]), (&json!("camera"), &json!("gain 1")), "{kept}");
    assert_eq!(kept["kept"]["devices"], json!(["simulated camera"]));
    fs::remove_file(result.join("report.json")).unwrap();
    nacre(resumed).expect(0);
    assert_eq!(fs::read_dir(place.path("kept")).unwrap().count(), 1);
}

/// Exposures follow a stated one, too.
#[test]
fn flats_and_turns_have_their_frames() {
    let place = Place::with_bench("kind = \"calibration\"\ncalibration = { of = \"flat\", frames = 3 }", EVEN);
    nacre(place.capture("s")).expect(0);
    let set = json_file(&place.path("s/frames.json"));
    assert_eq!((set["frames"].as_array().unwrap().len(), &set["dark"]), (3, &json!("frames/display_black.png")));
    let stated = "kind = \"calibration\"\ncamera = { exposure_ms = 50 }\ncalibration = { of = \"camera\", levels = 4 }";
    fs::write(place.path("plan.toml"), stated).unwrap();
    nacre(place.capture("c")).expect(0);
    let exposures = &json_file(&place.path("c/session.json"))["plan"]["exposures_ms"];
    assert_eq!(exposures, &json!([1.0, 25.5, 50.0, 100.0]));
    fs::write(place.path("plan.toml"), "kind = \"calibration\"\ncalibration = { of = \"retarder\" }").unwrap();
    nacre(place.capture("r")).expect(0);
    let set = json_file(&place.path("r/frames.json"));
    let angles: Vec<f64> =
        set["frames"].as_array().unwrap().iter().filter_map(|f| f["analyser_deg"].as_f64()).collect();
    assert_eq!((&set["kind"], angles), (&json!("polarization"), (0..24).map(|k| 15.0 * f64::from(k)).collect()));
}

/// The crossed direction has the least light. A session killed before any disk operation and resumed has the same
/// angles and identical bytes.
#[test]
fn a_killed_turn_goes_on_to_the_same_crossed_direction() {
    // One orientation of the sample, whose light is polarized.
    let region = "camera = { exposure_ms = 60, roi = [44, 18, 8, 8] }\n";
    let place = Place::new(&format!("kind = \"polarization\"\nanalyser = {{ angles_deg = [0] }}\n{region}"));
    nacre(place.capture("flat")).expect(0);
    results_of(&place.path("result"), FLAT, [8, 8]);
    let [result, kept, flat] = ["result", "kept", "flat"].map(|name| place.text(name));
    nacre(["calibrate", "keep", &result, "--calibrations", &kept, "--session", &flat]).expect(0);
    keep(&place, ANALYSER, &["simulated stage"]);
    let plan = "kind = \"calibration\"\ncalibration = { of = \"analyser\", crossed = 2 }
        analyser = { angles_deg = [0, 60, 120, 180] }\n";
    fs::write(place.path("plan.toml"), format!("{plan}{region}")).unwrap();
    let check = nacre(["plan", "check", &place.text("plan.toml"), "--bench", &place.text("bench.toml")]).expect(0);
    assert!(check.stdout().contains("7 frames"), "{}", check.stdout());
    nacre(capture(&place, "whole")).expect(0);
    let whole = data(&place.path("whole"));
    let set = json_file(&place.path("whole/frames.json"));
    let frames = set["frames"].as_array().unwrap();
    let angle = |k: usize| frames[k]["analyser_deg"].as_f64().unwrap();
    assert!(frames.len() == 6 && (angle(5) - angle(4) - 2.0).abs() < 2e-3, "{frames:?}");
    let mean = |k: usize| {
        let file = place.path("whole").join(frames[k]["file"].as_str().unwrap());
        let codes = image::open(file).unwrap().into_luma16().into_raw();
        codes.iter().map(|v| f64::from(*v)).sum::<f64>() / codes.len() as f64
    };
    let least = (0..4).map(mean).fold(f64::INFINITY, f64::min);
    let most = (0..4).map(mean).fold(0.0, f64::max);
    assert!(mean(4).max(mean(5)) < 1.01 * least && most > 1.3 * least, "{} {} {least} {most}", mean(4), mean(5));
    // A session that measures the analyser uses the flat field, and no analyser.
    assert!(set["calibration"]["analyser"].is_null() && set["flat"] == "flat.exr", "{set}");
    let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &[]);
    let mut killed = 0;
    loop {
        let (mut command, _) = command();
        command.args(Place::on(capture(&place, "s"), &bench)).env("NACRE_DIE_AT", killed.to_string());
        let status = command.stdout(Stdio::null()).stderr(Stdio::null()).status().unwrap();
        let begun = place.path("s/session.json").exists();
        nacre(Place::on(if begun { place.resume("s") } else { capture(&place, "s") }, &bench)).expect(0);
        assert!(data(&place.path("s")) == whole, "killed at {killed}: the data set differs");
        let flats = ["s", "whole"].map(|session| fs::read(place.path(session).join("flat.exr")).unwrap());
        assert!(flats[0] == flats[1], "killed at {killed}");
        nacre(["check", &place.text("s")]).expect(0);
        fs::remove_dir_all(place.path("s")).unwrap();
        if status.success() {
            break;
        }
        killed += 1;
    }
    assert!(killed > 30, "{killed}");
}

#[test]
fn a_session_uses_the_calibrations_of_its_devices() {
    let place = Place::new(ANGLES);
    nacre(capture(&place, "none")).expect(0);
    let ids = [
        keep(&place, CAMERA, &["simulated camera"]),
        keep(&place, ANALYSER, &["simulated stage"]),
        keep(&place, FLAT, &["simulated camera", "simulated panel"]),
    ];
    let run = nacre(capture(&place, "s")).expect(0);
    assert!(!run.stderr().contains("is not used"), "{}", run.stderr());
    let (session, set) = (json_file(&place.path("s/session.json")), json_file(&place.path("s/frames.json")));
    for (kind, id) in ["camera", "analyser", "flat"].into_iter().zip(&ids) {
        assert_eq!(set["calibration"][kind]["source"]["id"], json!(id), "{set}");
    }
    assert_eq!(session["calibration"], set["calibration"]);
    let noise = json!({ "full_scale_e": 30000.0, "read_noise_e": 6.0 });
    assert_eq!((&set["noise"], &set["black"], &set["white"]), (&noise, &json!(60.0), &json!(4000.0)));
    // The flat field doubles the light of the left half relative to the right one.
    let ratio = |session: &str| {
        let map = read_exr(&place.path(session).join("results/stokes.exr")).unwrap();
        let values = &map.channels["S0"];
        let half = |left: bool| {
            values.iter().enumerate().filter(|(k, _)| (k % 64 < 32) == left).map(|(_, v)| f64::from(*v)).sum::<f64>()
        };
        half(true) / half(false)
    };
    assert!((ratio("s") / ratio("none") - 2.0).abs() < 0.05, "{} {}", ratio("s"), ratio("none"));
    let mut edited = fs::read(place.path("s/flat.exr")).unwrap();
    *edited.last_mut().unwrap() ^= 1;
    fs::write(place.path("s/flat.exr"), edited).unwrap();
    assert!(nacre(["check", &place.text("s")]).expect(1).stdout().contains("flat.exr"));
    // Means of four exposures, in units of the stored files; levels at another gain are those of the driver.
    let other = ANGLES.replace("exposure_ms = 20", "exposure_ms = 20, average = 4, gain = 2");
    fs::write(place.path("plan.toml"), other).unwrap();
    nacre(capture(&place, "mean")).expect(0);
    let set = json_file(&place.path("mean/frames.json"));
    assert_eq!((&set["noise"]["full_scale_e"], &set["noise"]["read_noise_e"]), (&json!(120000.0), &json!(12.0)));
    assert_eq!(set["black"], json!(64.0 * 16.0));
}

/// Exposures of a nonlinear camera agree within their noise if its calibration is used.
#[test]
fn exposures_of_a_nonlinear_camera_agree_after_its_calibration() {
    const LOSS: &str = "width = 64, height = 48, response_loss = 0.08";
    let place = Place::with_bench(
        "kind = \"calibration\"\ncalibration = { of = \"camera\" }",
        &format!("camera = {{ {LOSS}, blur_px = 8 }}\n"),
    );
    nacre(capture(&place, "camera")).expect(0);
    let report = json_file(&place.path("camera/results/report.json"));
    // The straight line through the origin leaves 1 to 2 % for a loss of 8 % at full well.
    let deviation = report["response"]["deviation"].as_f64().unwrap();
    assert!((0.01..0.03).contains(&deviation), "{report}");
    let plan = "kind = \"exposures\"\nexposures_ms = [2, 8, 32, 100]\nreconstruct = { operation = \"hdr\" }";
    fs::write(place.path("plan.toml"), plan).unwrap();
    fs::write(place.path("bench.toml"), format!("camera = {{ {LOSS} }}\n")).unwrap();
    nacre(capture(&place, "with")).expect(0);
    nacre(place.capture("without")).expect(0);
    let chi2 = |session: &str| json_file(&place.path(session).join("results/report.json"))["chi2"].as_f64().unwrap();
    // Chi-square of 3,072 pixels is known to 3 %.
    assert!((chi2("with") - 1.0).abs() < 0.1 && chi2("without") > 1.5, "{} {}", chi2("with"), chi2("without"));
}

#[test]
fn calibrations_that_are_not_used_are_named() {
    let place = Place::new(ANGLES);
    let id = keep(&place, CAMERA, &["simulated camera"]);
    let other = keep(&place, ANALYSER, &["ELL14 11400517"]);
    let record = place.path(&format!("kept/{id}/record.json"));
    let mut old = json_file(&record);
    old["taken"] = json!(old["taken"].as_u64().unwrap() - 91 * 86_400);
    fs::write(&record, old.to_string()).unwrap();
    let run = nacre(capture(&place, "s")).expect(0);
    for words in [[id.as_str(), "91 days", "90 days"], [other.as_str(), "ELL14 11400517", "simulated stage"]] {
        assert!(words.iter().all(|word| run.stderr().contains(word)), "{words:?}: {}", run.stderr());
    }
    let warnings = json_file(&place.path("s/session.json"))["warnings"].clone();
    assert_eq!((warnings.as_array().unwrap().len(), &run.json()["warnings"]), (2, &warnings));
    assert!(json_file(&place.path("s/frames.json"))["calibration"].is_null());
    for (plan, code, words) in [
        (format!("calibrations = \"off\"\n{ANGLES}"), 0, ""),
        (format!("calibrations = [\"{other}\"]\n{ANGLES}"), 2, "ELL14 11400517"),
        (format!("calibrations = [\"{id}\"]\n{ANGLES}"), 0, ""),
    ] {
        fs::write(place.path("plan.toml"), plan).unwrap();
        let run = nacre(capture(&place, &format!("s{}", words.len()))).expect(code);
        assert!(run.stderr().contains(words) && !run.stderr().contains("is not used"), "{}", run.stderr());
        let _ = fs::remove_dir_all(place.path("s0"));
    }
    let run = nacre(place.capture("unknown")).expect(2);
    assert!(run.stderr().contains("--calibrations"), "{}", run.stderr());
    let list = nacre(["calibrations", "list", "--kind", "camera", "--calibrations", &place.text("kept")]).expect(0);
    assert!(list.stdout().contains(&id) && !list.stdout().contains(&other), "{}", list.stdout());
    nacre(["calibrations", "remove", &id, "--calibrations", &place.text("kept")]).expect(0);
    nacre(["calibrations", "show", &id, "--calibrations", &place.text("kept")]).expect(2);
}

/// The data folder, age and mounting of a configuration.
#[test]
fn a_configuration_names_calibrations_and_mounting() {
    let place = Place::new(ANGLES);
    let configured = |zero_deg: f64, days: u32| {
        let data = place.text("data");
        let bench = format!("[bench]\nsim = true\nfile = \"{}\"\n", place.text("bench.toml"));
        let stage =
            format!("[bench.stage]\ndriver = {{ kind = \"simulated\" }}\nmounting = {{ zero_deg = {zero_deg} }}\n");
        let text = format!("data = \"{data}\"\n[calibration]\nmax_age_days = {days}\n{bench}{stage}");
        fs::write(place.path("nacre.toml"), text).unwrap();
    };
    let run = |session: &str| {
        let [plan, config, out] = ["plan.toml", "nacre.toml", session].map(|name| place.text(name));
        let run = nacre(["capture", &plan, "--config", &config, "--out", &out]).expect(0);
        (run.stderr(), json_file(&place.path(session).join("session.json")))
    };
    configured(10.0, 5);
    let (_, session) = run("first");
    assert_eq!(session["mounting"]["zero_deg"], json!(10.0));
    results(&place.path("result"), ANALYSER);
    let [result, data, first] = ["result", "data", "first"].map(|name| place.text(name));
    nacre(["calibrate", "keep", &result, "--data", &data, "--session", &first]).expect(0);
    assert!(run("second").1["calibration"]["analyser"].is_object());
    configured(11.0, 5);
    let (said, session) = run("third");
    assert!(session["calibration"].is_null() && said.contains("another mounting"), "{said}");
    configured(10.0, 0);
    let [plan, config] = ["plan.toml", "nacre.toml"].map(|name| place.text(name));
    let refused = nacre(["capture", &plan, "--config", &config, "--out", &place.text("fourth")]).expect(2);
    assert!(refused.stderr().contains("calibration.max_age_days"), "{}", refused.stderr());
}

#[test]
fn the_service_keeps_lists_uses_and_deletes_calibrations() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let angles = json!({ "plan": { "kind": "polarization", "camera": { "exposure_ms": 5 },
        "analyser": { "angles_deg": [0, 60, 120] }, "reconstruct": { "operation": "polarization" } } });
    let session = begin(&service, &angles);
    finished(&service, &session);
    // Results of polarization are no calibration, and those of another session have none yet.
    service.post("/api/v1/calibrations", &json!({ "from": session })).expect(400);
    results(&place.path(&format!("data/sessions/{session}/results")), ANALYSER);
    let body = json!({ "from": session, "name": "new wave plate" });
    let key = ["Content-Type: application/json", "Idempotency-Key: one"];
    let asked = || service.send("POST", "/api/v1/calibrations", &key, body.to_string().as_bytes()).expect(201);
    let (kept, again) = (asked(), asked().json());
    let (location, kept) = (kept.header("location").unwrap(), kept.json());
    let id = kept["id"].as_str().unwrap();
    assert_eq!((&location, &again["id"]), (&format!("/api/v1/calibrations/{id}"), &kept["id"]));
    assert_eq!((&kept["kind"], &kept["name"], &kept["session"]), (&json!("analyser"), &body["name"], &json!(session)));
    assert_eq!((&kept["devices"], &kept["applies"]), (&json!(["simulated stage"]), &json!(true)), "{kept}");
    assert_eq!((&kept["values"]["analyser"]["zero_deg"], &kept["report"]), (&json!(1.5), &json!({})));
    let ids = |query: &str| {
        let list = service.get(&format!("/api/v1/calibrations{query}")).expect(200).json();
        list["items"].as_array().unwrap().iter().map(|c| c["id"].clone()).collect::<Vec<_>>()
    };
    assert_eq!(ids(""), [json!(id)]);
    assert_eq!(
        (ids("?kind=analyser&applies=true&max_age_days=1"), ids("?kind=camera"), ids("?applies=false")),
        (vec![json!(id)], vec![], vec![])
    );
    service.get("/api/v1/calibrations?kind=lens").expect(400);
    let files = service.get(&format!("{location}/files")).expect(200).json();
    assert_eq!(
        files.as_array().unwrap().iter().map(|f| f["name"].clone()).collect::<Vec<_>>(),
        ["calibration.json", "record.json", "report.json"]
    );
    service.get(&format!("{location}/files/calibration.json")).expect(200);
    service.get(&format!("{location}/files/..%2f..%2fkeys")).expect(404);
    // A plan says which ones it would use; its session records them.
    let checked = service.post("/api/v1/plans/check", &angles).expect(200).json();
    assert_eq!(checked["calibration"]["analyser"]["source"]["id"], json!(id), "{checked}");
    let second = begin(&service, &angles);
    let done = finished(&service, &second);
    assert_eq!((&done["calibration"]["analyser"]["source"]["id"], &done["warnings"]), (&json!(id), &json!([])));
    // One that is too old is a warning of plan and session.
    let record = place.path(&format!("data/calibrations/{id}/record.json"));
    let mut old = json_file(&record);
    old["taken"] = json!(old["taken"].as_u64().unwrap() - 400 * 86_400);
    fs::write(&record, old.to_string()).unwrap();
    let checked = service.post("/api/v1/plans/check", &angles).expect(200).json();
    assert!(checked["warnings"][0].as_str().unwrap().contains("400 days old") && checked["sound"] == true, "{checked}");
    assert_eq!((ids("?applies=false"), ids("?max_age_days=300")), (vec![json!(id)], vec![]));
    let third = begin(&service, &angles);
    assert!(finished(&service, &third)["warnings"][0].as_str().unwrap().contains("400 days old"));
    // A plan that lists one which does not exist is refused before the devices work.
    let mut listed = angles.clone();
    listed["plan"]["calibrations"] = json!(["01ARZ3NDEKTSV4RRFFQ69G5FAV"]);
    assert!(service.post("/api/v1/sessions", &listed).expect(400).text().contains("does not exist"));
    assert_eq!(service.post("/api/v1/plans/check", &listed).expect(200).json()["sound"], json!(false));
    // The trash gives a deleted one back.
    assert_eq!(service.get(&format!("{location}/deletion")).expect(200).json()["files"], json!(3));
    service.send("DELETE", &location, &[], b"").expect(204);
    assert!(service.get(&location).expect(404).text().contains("trash"));
    let item = service.get("/api/v1/trash").expect(200).json()["items"][0].clone();
    assert_eq!((&item["kind"], &item["name"]), (&json!("calibration"), &body["name"]));
    service.post(&format!("/api/v1/trash/{id}/restore"), &json!({})).expect(200);
    service.get(&location).expect(200);
    service.get("/api/v1/calibrations/..%2f..").expect(404);
}

/// Photographs without a session: their reconstruction is kept with the devices of the request. A session of kind
/// calibration keeps its results.
#[test]
fn reconstructions_and_sessions_become_calibrations() {
    let place = Place::with_bench("", EVEN);
    let service = Service::start(&place, &[]);
    let plan = json!({ "plan": { "kind": "calibration", "name": "gain 1", "camera": { "exposure_ms": 100 },
        "calibration": { "of": "camera", "levels": 5 } } });
    let session = begin(&service, &plan);
    let done = finished(&service, &session);
    assert_eq!((&done["plan"]["reconstruct"]["operation"], &done["kind"]), (&json!("camera"), &json!("calibration")));
    let order = json!({ "session": session });
    let job = service.post("/api/v1/operations/camera", &order).expect(202).json()["id"].as_str().unwrap().to_owned();
    service.until(&format!("/api/v1/reconstructions/{job}"), |j| j["state"] == "done");
    fs::write(place.path(&format!("data/reconstructions/{job}/calibration.json")), CAMERA).unwrap();
    let refused = service.post("/api/v1/calibrations", &json!({ "from": job, "devices": ["camera B"] })).expect(400);
    assert!(refused.text().contains("devices"), "{}", refused.text());
    let kept = service.post("/api/v1/calibrations", &json!({ "from": job })).expect(201).json();
    assert_eq!(
        (&kept["reconstruction"], &kept["session"], &kept["name"]),
        (&json!(job), &json!(session), &json!("gain 1"))
    );
    assert_eq!((&kept["devices"], &kept["conditions"]["average"]), (&json!(["simulated camera"]), &json!(1)));
    let unknown = service.post("/api/v1/calibrations", &json!({ "from": "01ARZ3NDEKTSV4RRFFQ69G5FAV" }));
    unknown.expect(404);
    let found = service.get("/api/v1/sessions?kind=calibration").expect(200).json();
    assert_eq!(found["items"].as_array().unwrap().len(), 1);
}

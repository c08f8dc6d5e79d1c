//! Resumed sessions: the original conditions hold or are rejected with their names, damage is detected, and events keep
//! their times.

#![allow(clippy::unwrap_used)]

use nacre_tests::chromium::Browser;
use nacre_tests::http::{Service, begin, events, finished, plan};
use nacre_tests::{BENCH, BenchProcess, Place, command, data, nacre};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

/// Plans without analyser angles.
const STILL: [&str; 3] = [
    "kind = \"exposures\"\nexposures_ms = [2, 4, 8, 16]\nextras = [\"dark\"]",
    "kind = \"flash\"\nexposures_ms = [2, 4, 8, 16]\nextras = [\"display_black\"]",
    "kind = \"spots\"\ncamera = { exposure_ms = 8 }\nspots = { centers_mm = [[0, 0], [60, 0], [0, 60]], diameter_mm = 20 }\nextras = [\"dark\"]",
];

const TURNED: &str = r#"
    kind = "polarization"
    sample = "tile"
    camera = { exposure_ms = 8 }
    analyser = { angles_deg = [0, 45, 90, 135] }
    extras = ["display_black"]
"#;

fn turn(bench: &BenchProcess, degrees: &str) {
    nacre(["stage", "move", degrees, "--sim", "--socket", &bench.socket.to_string_lossy()]).expect(0);
}

fn frames(session: &Path) -> usize {
    fs::read_dir(session.join("frames")).unwrap().count()
}

/// An analyser that the plan does not rotate, moved since the session was killed: rejected until it is back.
#[test]
fn a_moved_analyser_is_refused_until_it_is_turned_back() {
    for plan in STILL {
        let place = Place::new(plan);
        let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &[]);
        turn(&bench, "37");
        nacre(Place::on(place.capture("whole"), &bench)).expect(0);
        turn(&bench, "37");
        let (mut killed, _) = command();
        killed.args(Place::on(place.capture("s"), &bench)).env("NACRE_DIE_AT", "22");
        assert!(!killed.stdout(Stdio::null()).stderr(Stdio::null()).status().unwrap().success());
        let before = frames(&place.path("s"));
        assert!((1..frames(&place.path("whole"))).contains(&before), "{plan}: {before} frames before the kill");
        for elsewhere in ["127", "37.3"] {
            turn(&bench, elsewhere);
            let refused = nacre(Place::on(place.resume("s"), &bench));
            let said = refused.stderr();
            assert!(
                refused.code() != 0 && said.contains("analyser") && said.contains("back to 37.0"),
                "{plan}: {said}"
            );
            assert_eq!(frames(&place.path("s")), before, "{plan}: no frame behind an analyser at {elsewhere}°");
        }
        turn(&bench, "37");
        nacre(Place::on(place.resume("s"), &bench)).expect(0);
        assert!(data(&place.path("s")) == data(&place.path("whole")), "{plan}: the data set differs");
        nacre(["check", &place.text("s")]).expect(0);
    }
}

/// A complete session: reported without opening a bench.
#[test]
fn a_complete_session_is_left_alone() {
    let place = Place::new(TURNED);
    nacre(place.capture("s")).expect(0);
    let before = (fs::read(place.path("s/journal")).unwrap(), data(&place.path("s")));
    let said = nacre(["capture", "--sim", "--socket", &place.text("none"), "--resume", &place.text("s")]).expect(0);
    assert_eq!(said.stdout().trim(), "session is complete: 5 frames");
    assert_eq!(nacre(["--json"].map(String::from).into_iter().chain(place.resume("s"))).expect(0).json()["frames"], 5);
    assert!((fs::read(place.path("s/journal")).unwrap(), data(&place.path("s"))) == before);
}

/// Requested results belong to a session. If only they are missing, no frame is captured, and no share of zero time is
/// printed.
#[test]
fn missing_results_are_made() {
    let place = Place::new(&(TURNED.to_owned() + "reconstruct = { operation = \"polarization\" }"));
    nacre(place.capture("s")).expect(0);
    let whole = data(&place.path("s"));
    fs::remove_dir_all(place.path("s/results")).unwrap();
    let said = nacre(place.resume("s")).expect(0).stdout();
    assert!(place.path("s/results/orientation.exr").exists() && !said.contains("%)"), "{said}");
    assert!(data(&place.path("s")) == whole);
    assert!(nacre(place.resume("s")).expect(0).stdout().contains("complete: 5 frames"));
}

/// Any modified value in the descriptions of session and frames is reported by `check`, and rejected on resume.
#[test]
fn changed_descriptions_are_named_and_refused() {
    let place = Place::new(TURNED);
    nacre(place.capture("s")).expect(0);
    nacre(["check", &place.text("s")]).expect(0);
    for (file, pointer, value) in [
        ("session.json", "/exposure_s", json!(0.1)),
        ("session.json", "/plan/camera/exposure_ms", json!(9.0)),
        ("session.json", "/plan/camera/gain", json!(2.0)),
        ("session.json", "/plan/analyser/angles_deg/1", json!(54.0)),
        ("session.json", "/plan/sample", json!("file")),
        ("session.json", "/plan/analyser/angles_deg", json!([0.0])),
        ("session.json", "/plan/kind", json!("polarisation")),
        ("session.json", "/setup/wavelength_nm", json!(650.0)),
        ("session.json", "/created", json!(1)),
        ("frames.json", "/frames/1/analyser_deg", json!(54.0)),
        ("frames.json", "/frames/2/exposure_s", json!(0.08)),
        ("frames.json", "/frames/0/gain", json!(1.5)),
        ("frames.json", "/frames/3/file", json!("frames/0002.png")),
        ("frames.json", "/transfer", json!("srgb")),
        ("frames.json", "/white", json!(4000.0)),
        ("frames.json", "/black", json!(63.0)),
        ("frames.json", "/dark", Value::Null),
        ("frames.json", "/wavelength_nm", json!(650.0)),
    ] {
        let path = place.path("s").join(file);
        let whole = fs::read(&path).unwrap();
        let mut changed: Value = serde_json::from_slice(&whole).unwrap();
        *changed.pointer_mut(pointer).unwrap() = value;
        fs::write(&path, changed.to_string()).unwrap();
        let check = nacre(["--json", "check", &place.text("s")]).expect(1);
        assert!(check.json()["trouble"].to_string().contains(file), "{pointer}: {}", check.stdout());
        assert!(check.stderr().contains(file) && !check.stderr().contains("--resume"), "{pointer}: {}", check.stderr());
        let frame = place.path("s/frames/0003.png");
        let kept = fs::read(&frame).unwrap();
        let journal = fs::read(place.path("s/journal")).unwrap();
        for missing in [false, true] {
            if missing {
                fs::remove_file(&frame).unwrap();
            }
            let refused = nacre(place.resume("s")).expect(2);
            assert!(refused.stderr().contains(file), "{pointer}: {}", refused.stderr());
        }
        assert!(
            !frame.exists() && fs::read(place.path("s/journal")).unwrap() == journal,
            "{pointer}: nothing is touched"
        );
        fs::write(&frame, kept).unwrap();
        fs::write(&path, whole).unwrap();
    }
    nacre(["check", &place.text("s")]).expect(0);
    // As the message states: without frames.json, it is rewritten.
    let whole = data(&place.path("s"));
    fs::remove_file(place.path("s/frames.json")).unwrap();
    assert!(nacre(["check", &place.text("s")]).expect(1).stdout().contains("frames.json: is missing"));
    nacre(place.resume("s")).expect(0);
    assert!(data(&place.path("s")) == whole);
}

/// Files and times of the journal's commits, in order.
fn committed(session: &Path) -> Vec<(String, f64)> {
    let journal = fs::read_to_string(session.join("journal")).unwrap();
    let lines = journal.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let commits = lines.filter(|line| line["entry"]["committed"].is_object());
    commits
        .map(|line| {
            let file = line["entry"]["committed"]["file"].as_str().unwrap().to_owned();
            (file, line["time_ms"].as_u64().unwrap() as f64 / 1000.0)
        })
        .collect()
}

/// Files and times of the frames in an event stream.
fn told(service: &Service, id: &str) -> Vec<(String, f64)> {
    let stream = service.send("GET", &format!("/api/v1/sessions/{id}/events"), &[], b"").expect(200);
    let frames = events(&stream.body).into_iter().filter(|e| e.1 == "frame");
    frames.map(|e| (e.2["file"].as_str().unwrap().to_owned(), e.2["time"].as_f64().unwrap())).collect()
}

/// While a session runs, after it was resumed, and after a restart of the service.
#[test]
fn events_carry_the_times_of_the_journal() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let id = begin(&service, &plan(6, 20.0));
    let (base, folder) = (format!("/api/v1/sessions/{id}"), place.path(&format!("data/sessions/{id}")));
    service.until(&base, |s| s["frames_committed"].as_u64() > Some(1));
    service.post(&format!("{base}/stop"), &json!({})).expect(202);
    service.until(&base, |s| s["stage"] == Value::Null);
    assert_eq!(told(&service, &id), committed(&folder));
    service.post(&format!("{base}/resume"), &json!({})).expect(202);
    finished(&service, &id);
    let commits = committed(&folder);
    assert_eq!((commits.len(), told(&service, &id)), (6, commits.clone()));
    service.kill();

    let service = Service::start(&place, &[]);
    assert_eq!(told(&service, &id), commits);
    let stream = service.send("GET", &format!("{base}/events"), &[], b"").expect(200);
    let notes = events(&stream.body).into_iter().filter(|e| e.1 == "note");
    let notes: Vec<_> = notes.map(|e| (e.2["text"].clone(), e.2["time"].is_f64())).collect();
    for text in ["begun", "resumed", "finished"] {
        assert!(notes.contains(&(json!(text), true)), "no {text} in {notes:?}");
    }
    // The journal is complete.
    let journal = fs::read(folder.join("journal")).unwrap();
    assert_eq!(service.post(&format!("{base}/resume"), &json!({})).expect(202).json()["state"], "finished");
    assert_eq!(fs::read(folder.join("journal")).unwrap(), journal);
}

/// The page lists events with these times, not with the time at which the page was loaded.
#[test]
fn the_page_lists_events_with_the_times_of_the_journal() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", BENCH);
    let mut service = Service::start(&place, &[]);
    let id = begin(&service, &plan(4, 10.0));
    finished(&service, &id);
    let commits = committed(&place.path(&format!("data/sessions/{id}")));
    // A different second from the one in which the page is opened and reloaded.
    std::thread::sleep(Duration::from_millis(1100));
    for restarted in [false, true] {
        if restarted {
            service.kill();
            service = Service::start(&place, &[]);
        }
        browser.open("about:blank");
        browser.open(&format!("http://{}/#/session/{id}", service.address));
        for (file, time) in &commits {
            let name = file.trim_start_matches("frames/");
            browser.until(&format!(
                "[...document.querySelectorAll('.log li')].some((l) => l.innerText.includes('{name}'))"
            ));
            let row = format!("[...document.querySelectorAll('.log li')].find((l) => l.innerText.includes('{name}'))");
            let [shown, wanted] = [format!("{row}.querySelector('time').textContent"), clock(*time)]
                .map(|script| browser.run(&format!("return {script}")).as_str().unwrap().to_owned());
            // Past midnight, the date is shown, too.
            assert!(shown.ends_with(&wanted), "{name}: {shown}, not {wanted}, restarted: {restarted}");
        }
    }
}

/// A script for the time of day in the browser's time zone.
fn clock(time: f64) -> String {
    format!("new Date(1000 * {time}).toTimeString().slice(0, 8)")
}

//! Capture sessions on the simulated bench: what they promise when they are stopped, killed or spoiled.

#![allow(clippy::unwrap_used)]

use nacre_tests::{binary, nacre};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// A folder with a small bench and a plan.
struct Place {
    folder: tempfile::TempDir,
}

impl Place {
    fn new(plan: &str) -> Self {
        let place = Self { folder: tempfile::tempdir().unwrap() };
        fs::write(place.path("bench.toml"), "camera = { width = 64, height = 48 }").unwrap();
        fs::write(place.path("plan.toml"), plan).unwrap();
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn text(&self, name: &str) -> String {
        self.path(name).to_string_lossy().into_owned()
    }

    /// Arguments of a new capture into `session`.
    fn capture(&self, session: &str) -> Vec<String> {
        let fixed =
            ["--json", "capture", &self.text("plan.toml"), "--sim", "--bench", &self.text("bench.toml"), "--out"];
        fixed.iter().map(|s| (*s).to_owned()).chain([self.text(session)]).collect()
    }

    fn resume(&self, session: &str) -> Vec<String> {
        ["capture", "--sim", "--resume"].iter().map(|s| (*s).to_owned()).chain([self.text(session)]).collect()
    }
}

const PLAN: &str = r#"
    kind = "polarization"
    camera = { average = 2, roi = [8, 4, 40, 32] }
    display = { diameter_mm = 180 }
    analyser = { angles_deg = [0, 45, 90, 135, 20, 20] }
    extras = ["display_black"]
"#;

/// All files of a session but journal and description, by name.
fn data(session: &Path) -> Vec<(String, Vec<u8>)> {
    let mut files: Vec<_> = fs::read_dir(session.join("frames")).unwrap().flatten().map(|e| e.path()).collect();
    files.push(session.join("frames.json"));
    files.sort();
    files.iter().map(|p| (p.file_name().unwrap().to_string_lossy().into_owned(), fs::read(p).unwrap())).collect()
}

#[test]
fn a_session_is_complete_checked_and_reconstructs() {
    let place = Place::new(PLAN);
    let json = nacre(place.capture("s")).expect(0).json();
    assert_eq!(json["frames"], 7);
    assert_eq!(data(&place.path("s")).len(), 8);
    nacre(["check", &place.text("s")]).expect(0);
    let report =
        nacre(["--json", "reconstruct", "polarization", &place.text("s"), "--out", &place.text("r")]).expect(0).json();
    assert_eq!((report["width"].as_u64(), report["height"].as_u64()), (Some(40), Some(32)));
    assert!(report["pixels"]["valid"].as_u64().unwrap() > 40 * 32 * 9 / 10, "{report}");
    let again = nacre(place.capture("s")).expect(2);
    assert!(again.stderr().contains("--resume"), "{}", again.stderr());
}

/// Killed at 40 instants spread over the run and beyond it; each time the resumed session equals the uninterrupted one.
#[test]
fn a_killed_session_resumes_to_the_same_bytes() {
    let place = Place::new(PLAN);
    nacre(place.capture("whole")).expect(0);
    let whole = data(&place.path("whole"));
    let (mut resumed, mut partial) = (0, 0);
    for k in 0..40_u64 {
        let name = format!("killed{k}");
        let mut child = Command::new(binary())
            .args(place.capture(&name))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // Wait for the session to begin, so that the instants fall into it.
        let journal = place.path(&name).join("journal");
        while !journal.exists() && child.try_wait().unwrap().is_none() {
            std::thread::sleep(Duration::from_micros(200));
        }
        std::thread::sleep(Duration::from_micros(k * k * 60));
        child.kill().unwrap();
        child.wait().unwrap();
        if !fs::read_to_string(&journal).unwrap_or_default().contains("finished") {
            partial += 1;
            let check = nacre(["check", &place.text(&name)]).expect(1);
            assert!(!check.stdout().contains("differs"), "{}", check.stdout());
        }
        nacre(place.resume(&name)).expect(0);
        resumed += 1;
        assert!(data(&place.path(&name)) == whole, "kill {k}: the data set differs");
        nacre(["check", &place.text(&name)]).expect(0);
    }
    println!("{resumed} kills, {partial} of them in the middle");
    assert!(partial >= 5, "only {partial} kills hit a session in progress");
}

/// SIGTERM ends in order: exit 130, the reason in the journal, the rest taken by a resume.
#[test]
fn an_interrupted_session_ends_in_order() {
    let angles: Vec<String> = (0..400).map(|k| (k % 180).to_string()).collect();
    let place = Place::new(&format!("kind = \"polarization\"\nanalyser = {{ angles_deg = [{}] }}", angles.join(",")));
    let mut child =
        Command::new(binary()).args(place.capture("s")).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    while !place.path("s/frames/0003.png").exists() && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(1));
    }
    let second = nacre(place.resume("s")).expect(2);
    assert!(second.stderr().contains("another process"), "{}", second.stderr());
    Command::new("kill").arg(child.id().to_string()).status().unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    let journal = fs::read_to_string(place.path("s/journal")).unwrap();
    assert!(journal.contains("interrupted"), "{journal}");
    nacre(place.resume("s")).expect(0);
    nacre(["check", &place.text("s")]).expect(0);
}

#[test]
fn a_planned_reconstruction_follows_the_capture() {
    let plan = PLAN.to_owned() + "reconstruct = { method = \"polarization\" }";
    let place = Place::new(&plan);
    nacre(place.capture("s")).expect(0);
    assert!(place.path("s/results/orientation.png").exists());
}

#[test]
fn damaged_and_missing_frames_are_named_and_taken_again() {
    let place = Place::new(PLAN);
    nacre(place.capture("s")).expect(0);
    let whole = data(&place.path("s"));
    let frame = place.path("s").join("frames/0001.png");
    let mut bytes = fs::read(&frame).unwrap();
    bytes[100] ^= 4;
    fs::write(&frame, bytes).unwrap();
    fs::remove_file(place.path("s").join("frames/0003.png")).unwrap();
    let check = nacre(["--json", "check", &place.text("s")]).expect(1).json();
    assert_eq!((&check["intact"], check["trouble"].as_array().unwrap().len()), (&serde_json::json!(5), 2));
    nacre(place.resume("s")).expect(0);
    assert!(data(&place.path("s")) == whole);
}

#[test]
fn a_damaged_journal_is_refused_and_nothing_is_touched() {
    let place = Place::new(PLAN);
    nacre(place.capture("s")).expect(0);
    let journal = place.path("s").join("journal");
    let mut bytes = fs::read(&journal).unwrap();
    bytes[60] ^= 1;
    fs::write(&journal, &bytes).unwrap();
    for args in [place.resume("s"), vec!["check".into(), place.text("s")]] {
        let run = nacre(args).expect(2);
        assert!(run.stderr().contains("line"), "{}", run.stderr());
    }
    assert_eq!(fs::read(&journal).unwrap(), bytes);
}

#[test]
fn an_edited_session_file_is_refused_by_key() {
    let place = Place::new(PLAN);
    nacre(place.capture("s")).expect(0);
    let (path, journal) = (place.path("s/session.json"), fs::read(place.path("s/journal")).unwrap());
    let good: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    for (pointer, value, word) in [
        ("/plan/camera/average", serde_json::json!(0), "camera.average"),
        ("/plan/camera/roi", serde_json::json!([60, 40, 100, 100]), "camera.roi"),
        ("/exposure_s", serde_json::json!(-1.0), "exposure_s"),
        ("/plan/analyser/angles_deg", serde_json::json!([]), "angles_deg"),
        ("/bench/camera/width", serde_json::json!(1_000_000_000), "camera.width"),
        ("/devices", serde_json::json!(3), "session.json"),
    ] {
        let mut edited = good.clone();
        *edited.pointer_mut(pointer).unwrap() = value;
        fs::write(&path, edited.to_string()).unwrap();
        let run = nacre(place.resume("s")).expect(2);
        assert!(run.stderr().contains(word) && !run.stderr().contains("panicked"), "{word}: {}", run.stderr());
    }
    assert_eq!(fs::read(place.path("s/journal")).unwrap(), journal, "a refused resume changes nothing");
}

#[test]
fn estimates_hold_within_ten_percent() {
    for plan in [
        "analyser = { angles_deg = [0, 15, 30, 45, 60, 75, 90, 105, 120, 135, 150, 165] }\ncamera = { exposure_ms = 40 }",
        "analyser = { angles_deg = [0, 60, 120] }\ncamera = { exposure_ms = 500 }",
        "analyser = { angles_deg = [150, 120, 90, 60, 30, 0] }\ncamera = { exposure_ms = 10 }",
        "analyser = { angles_deg = [0, 45, 90, 135] }\ncamera = { exposure_ms = 30, average = 16 }",
        "analyser = { angles_deg = [0, 90, 45, 135, 20, 110, 65, 155] }\ncamera = { exposure_ms = 80, average = 3 }",
        "analyser = { angles_deg = [10, 10, 10, 100, 100, 55] }\ncamera = { exposure_ms = 5 }\nextras = [\"display_black\"]",
    ] {
        let place = Place::new(&format!("kind = \"polarization\"\n{plan}"));
        let estimate = ["--json", "plan", "estimate", &place.text("plan.toml"), "--bench", &place.text("bench.toml")];
        let estimate = nacre(estimate).expect(0).json();
        let run = nacre(place.capture("s")).expect(0).json();
        let (said, took) = (estimate["seconds"].as_f64().unwrap(), run["device_seconds"].as_f64().unwrap());
        println!("estimated {said:.2} s, took {took:.2} s");
        assert!((said / took - 1.0).abs() < 0.1, "{plan}: estimated {said}, took {took}");
        let disk: u64 = data(&place.path("s")).iter().map(|f| f.1.len() as u64).sum();
        assert!(disk < estimate["bytes"].as_u64().unwrap() + 10_000);
    }
}

#[test]
fn wrong_plans_are_refused_before_anything_moves() {
    for (plan, words) in [
        ("kind = \"polarization\"", &["plan.toml", "analyser"][..]),
        ("kind = \"polarisation\"\nanalyser = { angles_deg = [0] }", &["plan.toml", "polarisation"]),
        ("kind = \"polarization\"\nanalyser = { angles_deg = [] }", &["analyser.angles_deg", "0 angles"]),
        ("kind = \"polarization\"\nanalyser = { angles_deg = [nan] }", &["analyser.angles_deg"]),
        ("kind = \"polarization\"\nanalyser = { angle_deg = [0] }", &["angle_deg"]),
        (
            "kind = \"polarization\"\nanalyser = { angles_deg = [0] }\ncamera = { exposure_ms = 1e9 }",
            &["camera.exposure_ms", "60000"],
        ),
        (
            "kind = \"polarization\"\nanalyser = { angles_deg = [0] }\ncamera = { roi = [60, 0, 9, 9] }",
            &["camera.roi", "64"],
        ),
        (
            "kind = \"polarization\"\nanalyser = { angles_deg = [0] }\ndisplay = { diameter_mm = 9000 }",
            &["display.diameter_mm"],
        ),
    ] {
        let place = Place::new(plan);
        for args in [
            place.capture("s"),
            vec!["plan".into(), "check".into(), place.text("plan.toml"), "--bench".into(), place.text("bench.toml")],
        ] {
            let run = nacre(args).expect(2);
            words.iter().for_each(|w| assert!(run.stderr().contains(w), "no {w} in: {}", run.stderr()));
        }
        assert!(!place.path("s").exists());
    }
}

#[test]
fn a_dry_run_lists_the_steps_and_takes_nothing() {
    let place = Place::new(PLAN);
    let steps = nacre(place.capture("s").into_iter().chain(["--dry-run".into()])).expect(0).json();
    assert_eq!(steps.as_array().unwrap().len(), 7);
    assert!(!place.path("s").exists());
}

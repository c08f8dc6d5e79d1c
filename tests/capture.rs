//! Capture sessions on the simulated bench: guarantees after stops, kills and damage.

#![allow(clippy::unwrap_used)]

use nacre_tests::{Place, data, nacre};
use std::fs;
use std::path::Path;

const PLAN: &str = r#"
    kind = "polarization"
    camera = { average = 2, roi = [8, 4, 40, 32] }
    display = { diameter_mm = 180 }
    analyser = { angles_deg = [0, 45, 90, 135, 20, 20] }
    extras = ["display_black"]
"#;

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

#[test]
fn a_planned_reconstruction_follows_the_capture() {
    let plan = PLAN.to_owned() + "reconstruct = { operation = \"polarization\" }";
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

/// Plans of different kinds, some of them metered, on two benches.
#[test]
fn estimates_hold_within_ten_percent() {
    let slow = "camera = { width = 64, height = 48, lag_frames = 4, readout_ms = 25 }\nstage = { speed_deg_s = 30, settle_ms = 400 }\nflash = { settle_ms = 50 }";
    for plan in [
        "kind = \"polarization\"\nanalyser = { angles_deg = [0, 15, 30, 45, 60, 75, 90, 105, 120, 135, 150, 165] }\nextras = [\"dark\", \"display_black\"]",
        "kind = \"polarization\"\nanalyser = { angles_deg = [0, 90, 45, 135, 135, 135, 20] }\ncamera = { exposure_ms = 80, average = 3 }",
        "kind = \"exposures\"\nexposures_ms = [1, 4, 16, 64, 256]\nextras = [\"dark\"]",
        "kind = \"flash\"\nanalyser = { angles_deg = [0, 45, 90, 135] }\ncamera = { exposure_ms = 20 }\nextras = [\"display_black\"]",
        "kind = \"spots\"\nspots = { centers_mm = [[0, 0], [60, 0], [0, 60], [-60, 0], [0, -60]], diameter_mm = 20 }\ncamera = { exposure_ms = 50, average = 4 }",
        "kind = \"calibration\"\ncalibration = { of = \"camera\", levels = 5 }",
        "kind = \"calibration\"\ncalibration = { of = \"analyser\" }\nanalyser = { angles_deg = [0, 45, 90, 135] }",
        "kind = \"free\"\nsteps = [{ flash = true, exposure_ms = 5 }, { analyser_deg = 90, exposure_ms = 200 }, { display = { diameter_mm = 30 }, exposure_ms = 200 }, { flash = true, exposure_ms = 5 }]",
    ] {
        for bench in ["camera = { width = 64, height = 48 }", slow] {
            let place = Place::with_bench(plan, bench);
            let args = ["--json", "plan", "estimate", &place.text("plan.toml"), "--bench", &place.text("bench.toml")];
            let estimate = nacre(args).expect(0).json();
            let run = nacre(place.capture("s")).expect(0).json();
            let (said, took) = (estimate["seconds"].as_f64().unwrap(), run["timing"]["device_s"].as_f64().unwrap());
            println!("estimated {said:.2} s, took {took:.2} s: {plan}");
            assert!((said / took - 1.0).abs() < 0.1, "{plan}: estimated {said}, took {took}");
            let disk: u64 = data(&place.path("s")).iter().map(|f| f.1.len() as u64).sum();
            assert!(disk < estimate["bytes"].as_u64().unwrap() + 10_000);
            nacre(["check", &place.text("s")]).expect(0);
        }
    }
}

/// Frames of realistic size and duration. The engine's share of the time is printed; 5 % of the devices' time is
/// typical.
#[test]
fn a_session_keeps_the_time_of_devices_and_engine() {
    let plan =
        "kind = \"polarization\"\ncamera = { exposure_ms = 40 }\nanalyser = { angles_deg = [0, 30, 60, 90, 120, 150] }
        extras = [\"dark\", \"display_black\"]\nreconstruct = { operation = \"polarization\" }";
    let place = Place::with_bench(plan, "camera = { width = 1024, height = 1024 }");
    let run = nacre(place.capture("s")).expect(0).json();
    let [device, engine] = ["device_s", "engine_s"].map(|key| run["timing"][key].as_f64().unwrap());
    println!("devices {device:.2} s, engine {engine:.3} s; results {} s after the last frame", run["results_after_s"]);
    assert!(device > 8.0 * 0.04 && engine > 0.0, "{run}");
    let journal = fs::read_to_string(Path::new(run["session"].as_str().unwrap()).join("journal")).unwrap();
    let last: serde_json::Value = serde_json::from_str(journal.lines().last().unwrap()).unwrap();
    assert_eq!(last["entry"]["finished"]["device_s"], run["timing"]["device_s"], "the journal keeps both");
}

/// The live map is identical to that of the finished session.
#[test]
fn the_reconstruction_that_follows_equals_that_of_the_whole_session() {
    let plan = PLAN.to_owned() + "reconstruct = { operation = \"polarization\" }";
    let place = Place::new(&plan);
    nacre(place.capture("s")).expect(0);
    nacre(["reconstruct", "polarization", &place.text("s"), "--out", &place.text("whole")]).expect(0);
    for file in ["stokes.exr", "aolp.exr", "orientation.exr", "orientation.png", "sigma.png", "dolp.png"] {
        let [live, whole] = ["s/results", "whole"].map(|f| fs::read(place.path(f).join(file)).unwrap());
        assert!(live == whole, "{file}");
    }
}

/// `frames.json` states the illumination of each kind of plan.
#[test]
fn frames_are_described_with_what_shone() {
    let frames = |plan: &str| {
        let place = Place::new(plan);
        nacre(place.capture("s")).expect(0);
        serde_json::from_slice::<serde_json::Value>(&fs::read(place.path("s/frames.json")).unwrap()).unwrap()
    };
    let set = frames("kind = \"exposures\"\nexposures_ms = [2, 8]\nextras = [\"dark\", \"display_black\"]");
    assert_eq!((&set["kind"], &set["frames"][1]["exposure_s"]), (&"exposures".into(), &0.008.into()));
    assert_eq!(set["frames"][1]["dark"], "frames/display_black_01.png");
    assert!(set["wavelength_nm"].is_number() && set["geometry"]["pixel_um"].is_number(), "{set}");
    let set = frames("kind = \"flash\"\ncamera = { exposure_ms = 5 }");
    assert_eq!((&set["kind"], set["frames"].as_array().unwrap().len()), (&"flash".into(), 1));
    let set =
        frames("kind = \"spots\"\ncamera = { exposure_ms = 5 }\nspots = { centers_mm = [[1, 2]], diameter_mm = 3 }");
    assert_eq!(set["frames"][0]["spot"], serde_json::json!({ "center_mm": [1.0, 2.0], "diameter_mm": 3.0 }));
    let set = frames("kind = \"free\"\nsteps = [{ flash = true, exposure_ms = 5, display = { pattern = \"black\" } }]");
    assert_eq!((&set["frames"][0]["flash"], &set["frames"][0]["spot"]), (&true.into(), &serde_json::Value::Null));
}

/// Repeated frames are separate exposures, and the flash adds the expected light.
#[test]
fn repeats_differ_and_the_flash_lights() {
    let plan = "kind = \"free\"\nsteps = [{ exposure_ms = 5, display = { pattern = \"black\" } }, { exposure_ms = 5, display = { pattern = \"black\" } }, { exposure_ms = 5, display = { pattern = \"black\" }, flash = true }]";
    let place = Place::with_bench(
        plan,
        "camera = { width = 64, height = 48 }\nflash = { x_mm = 100, y_mm = 0, diameter_mm = 150 }",
    );
    nacre(place.capture("s")).expect(0);
    let pixels = |i: u32| image::open(place.path(&format!("s/frames/000{i}.png"))).unwrap().into_luma16().into_raw();
    let mean = |i| pixels(i).iter().map(|v| f64::from(*v)).sum::<f64>() / (64.0 * 48.0) - 64.0;
    assert!(pixels(0) != pixels(1));
    assert!((mean(0) - mean(1)).abs() < 0.2 && mean(2) > 5.0 * mean(0), "{} {} {}", mean(0), mean(1), mean(2));
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

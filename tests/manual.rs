//! Manual control of devices, and an analyser rotated by a person.

#![allow(clippy::unwrap_used)]

use nacre_tests::{BENCH, BenchProcess, NEVER, Place, assert_gone, command, data, light, nacre};
use std::fs;
use std::io::Write;
use std::process::Stdio;
use std::time::{Duration, Instant};

/// Arguments on a bench process.
fn on<'a>(bench: &'a BenchProcess, args: &[&'a str]) -> Vec<&'a str> {
    [args, &["--sim", "--socket", bench.socket.to_str().unwrap()]].concat()
}

#[test]
fn each_device_does_what_it_is_told() {
    let place = Place::with_bench("", BENCH);
    let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &[]);
    let angle = |args: &[&str]| {
        let json = nacre([&["--json"], &on(&bench, args)[..]].concat()).expect(0).json();
        json["analyser_deg"].as_f64().unwrap()
    };
    assert!((angle(&["stage", "move", "45"]) - 45.0).abs() < 0.1);
    assert!((angle(&["stage", "where"]) - 45.0).abs() < 0.1, "the bench remembers");
    assert!((angle(&["stage", "move", "-20"]) + 20.0).abs() < 0.1);
    assert!(angle(&["stage", "home"]).abs() < 0.2);
    assert!(nacre(on(&bench, &["stage", "move", "1000"])).expect(1).stderr().contains("720"));

    nacre(on(&bench, &["flash", "test"])).expect(0);
    nacre(on(&bench, &["flash", "off"])).expect(0);
    nacre(on(&bench, &["flash", "on", "--seconds", "0.05"])).expect(0);
    assert!(nacre(on(&bench, &["flash", "on", "--seconds", "100"])).expect(2).stderr().contains("30"));
    nacre(on(&bench, &["show", "disc:50@20,-10", "--seconds", "0.05"])).expect(0);
    assert!(nacre(on(&bench, &["show", "disc:5000"])).expect(2).stderr().contains("597"));
    assert!(nacre(on(&bench, &["show", "square"])).expect(2).stderr().contains("disc:DIAMETER"));
    assert_eq!(light(&bench), [false, false]);

    let snap = |name: &str, more: &[&str]| {
        let path = place.text(name);
        let args = [&["snap", "--out", &path, "--exposure-ms", "5"], more].concat();
        nacre([&["--json"], &on(&bench, &args)[..]].concat()).expect(0).json()
    };
    let (dark, bright) = (snap("dark.png", &["--show", "black"]), snap("bright.png", &["--show", "disc:300"]));
    assert!(bright["highest"].as_u64() > dark["highest"].as_u64(), "{bright} {dark}");
    assert!(nacre(on(&bench, &["snap", "--out", &place.text("dark.png")])).expect(2).stderr().contains("--force"));

    let devices = nacre(on(&bench, &["devices"])).expect(0).stdout();
    for kind in ["stage", "camera", "display", "flash"] {
        assert!(devices.contains(kind), "{devices}");
    }
    assert!(nacre(["devices", "--sim", "--socket", "/nowhere"]).expect(1).stderr().contains("sim bench"));
    assert!(nacre(["stage", "home"]).expect(2).stderr().contains("--sim"));
}

/// Manually switched light goes off with the command, however the command ends.
#[test]
fn light_by_hand_goes_off_with_the_command() {
    let place = Place::with_bench("", BENCH);
    let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &["--real-time"]);
    for (args, lit) in [(&["flash", "on"][..], [false, true]), (&["show", "disc:50"], [true, false])] {
        for kill in [false, true] {
            let (mut command, mark) = command();
            let mut child = command.args(on(&bench, args)).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
            let begun = Instant::now();
            while light(&bench) != lit {
                assert!(begun.elapsed() < NEVER, "{args:?}: no light");
                std::thread::sleep(Duration::from_millis(2));
            }
            let pid = child.id().to_string();
            std::process::Command::new("kill").args([if kill { "-KILL" } else { "-INT" }, &pid]).status().unwrap();
            let begun = Instant::now();
            while light(&bench) != [false, false] {
                assert!(begun.elapsed() < NEVER, "{args:?}: light is still on");
                std::thread::sleep(Duration::from_millis(2));
            }
            assert_eq!(child.wait().unwrap().success(), !kill);
            assert_gone(&mark);
        }
    }
}

/// A hung program counts as ended, and the maximum on-time of the flash always applies.
#[test]
fn the_flash_goes_off_when_its_owner_hangs_or_its_time_is_up() {
    let bench = |most_s: f64| {
        let place = Place::with_bench("", &format!("{BENCH}\nflash = {{ max_on_s = {most_s} }}"));
        let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &["--real-time"]);
        (place, bench)
    };
    // A bench with a maximum on-time of an hour: only the end of the owner switches the flash off.
    let (_place, patient) = bench(3600.0);
    let until = |bench: &BenchProcess, lit: bool| {
        let begun = Instant::now();
        while light(bench)[1] != lit {
            assert!(begun.elapsed() < NEVER, "the flash is still {}", if lit { "off" } else { "on" });
            std::thread::sleep(Duration::from_millis(2));
        }
        begun.elapsed().as_secs_f64()
    };
    let (mut owner, mark) = command();
    let mut owner =
        owner.args(on(&patient, &["flash", "on"])).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap();
    until(&patient, true);
    let signal = |signal: &str| std::process::Command::new("kill").args([signal, &owner.id().to_string()]).status();
    signal("-STOP").unwrap();
    println!("off {:.2} s after its owner stood still", until(&patient, false));
    signal("-KILL").unwrap();
    owner.wait().unwrap();
    assert_gone(&mark);

    // Heartbeats do not extend the on-time beyond its maximum.
    let (_place, bench) = bench(1.5);
    let (mut guardian, mark) = command();
    let mut guardian = guardian
        .args(["guardian", &format!("{{\"bench\":{:?}}}", bench.socket)])
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let mut pipe = guardian.stdin.take().unwrap();
    pipe.write_all(b"{\"switch\":true}\n").unwrap();
    until(&bench, true);
    let begun = Instant::now();
    while light(&bench)[1] {
        pipe.write_all(b"\"beat\"\n").unwrap();
        std::thread::sleep(Duration::from_millis(20));
        assert!(begun.elapsed() < NEVER, "the flash is still on");
    }
    let lasted = begun.elapsed().as_secs_f64();
    assert!(lasted > 1.0, "{lasted}");
    drop(pipe);
    assert!(guardian.wait().unwrap().success());
    assert_gone(&mark);
}

#[test]
fn a_person_turns_the_analyser() {
    let plan = "kind = \"polarization\"\ncamera = { exposure_ms = 5 }\nanalyser = { angles_deg = [0, 45, 90] }";
    let place = Place::new(plan);
    let run = |name: &str, input: &str| {
        let (mut command, mark) = command();
        command
            .args(place.capture(name))
            .arg("--hand")
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
        let output = child.wait_with_output().unwrap();
        assert_gone(&mark);
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (code, stderr) = run("s", "\n\n\n");
    assert_eq!(code, Some(0), "{stderr}");
    for angle in [0, 45, 90] {
        assert!(stderr.contains(&format!("turn the analyser to {angle}° and press Enter")), "{stderr}");
    }
    assert_eq!(data(&place.path("s")).len(), 4);
    // If the person leaves, the session can be resumed with another person, but not with a motor.
    let (code, stderr) = run("left", "\n");
    assert_eq!(code, Some(1), "{stderr}");
    assert!(stderr.contains("hand-turned analyser") && stderr.contains("turn to 45°"), "{stderr}");
    assert!(nacre(place.resume("left")).expect(2).stderr().contains("hand-turned analyser"));
    assert!(fs::read_to_string(place.path("left/journal")).unwrap().contains("committed"));
}

/// The measured gamma of a panel, and its latency after acknowledgement, equal those of the bench.
#[test]
fn a_panels_tone_and_lag_are_measured() {
    for (gamma, lag_ms) in [(2.2, 0), (1.4, 130)] {
        let place = Place::with_bench("", &format!("{BENCH}[panel]\ngamma = {gamma}\nlag_ms = {lag_ms}\n"));
        let args = ["--json", "calibrate", "panel", "--sim", "--bench"].map(str::to_owned);
        let out = ["--out".to_owned(), place.text("panel.json")];
        let run = || nacre(args.iter().chain([&place.text("bench.toml")]).chain(&out));
        let found = run().expect(0).json();
        let law = &found["law"];
        let [measured, sigma] = [&law["gamma"], &law["gamma_sigma"]].map(|v| v.as_f64().unwrap());
        assert!((measured - gamma).abs() < 3.0 * sigma + 0.005 && sigma < 0.02, "{found}");
        assert!(law["deviation"].as_f64().unwrap() < 0.005, "{found}");
        let (frames, late) = (found["late_frames"].as_u64().unwrap(), found["late_ms"].as_f64().unwrap());
        // Within one exposure and readout.
        let frame_ms = found["exposure_ms"].as_f64().unwrap() + 30.0;
        let fits =
            if lag_ms == 0 { frames == 0 } else { late > f64::from(lag_ms) && late < f64::from(lag_ms) + frame_ms };
        assert!(fits, "{lag_ms} ms: {found}");
        assert!(found["advice"].to_string().contains("response_ms") == (lag_ms > 0), "{found}");
        // Existing files are kept.
        assert!(run().expect(2).stderr().contains("--force"));
    }
    let dark = Place::with_bench("", &format!("{BENCH}[panel]\nsize_mm = [1.0, 1.0]\n"));
    let args = ["calibrate", "panel", "--sim", "--bench", &dark.text("bench.toml"), "--out", &dark.text("p.json")];
    assert!(nacre(args).expect(1).stderr().contains("simulated camera"));
    assert!(!dark.path("p.json").exists());
}

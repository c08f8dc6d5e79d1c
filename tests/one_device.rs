//! Commands on a single device require only its configuration, and leave other devices alone.

#![allow(clippy::unwrap_used)]

use nacre_tests::{BENCH, BenchProcess, NEVER, Place, Run, assert_gone, command, light, nacre};
use std::fs;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// All commands on single devices, and the required sections of the configuration.
const COMMANDS: [(&str, &[&str]); 12] = [
    ("stage move 10", &["stage"]),
    ("stage home", &["stage"]),
    ("stage where", &["stage"]),
    ("stage search-frequency", &["stage"]),
    ("stage clean", &["stage"]),
    ("snap --out OUT", &["camera"]),
    ("snap --out OUT --show disc:50 --analyser-deg 5 --flash", &["stage", "camera", "display", "flash"]),
    ("flash test", &["flash"]),
    ("flash on --seconds 0.05", &["flash"]),
    ("flash off", &["flash"]),
    ("show disc:50 --seconds 0.05", &["display"]),
    ("calibrate panel --out OUT", &["camera", "display"]),
];

/// A section for each device, none of which is connected.
const NOT_PLUGGED_IN: [(&str, &str); 4] = [
    ("stage", "driver = { kind = \"elliptec\", port = \"/dev/no-such-port\" }"),
    ("camera", "driver = { kind = \"v4l2\", device = \"/dev/no-such-camera\" }"),
    ("display", "driver = { kind = \"page\", size_mm = [500, 300] }"),
    ("flash", "driver = { kind = \"relay\", path = \"unix:/no/such/lamp\" }"),
];

/// Writes a configuration of these sections and runs a command with it.
fn run(place: &Place, args: &str, sections: &[(&str, &str)]) -> Run {
    let text: Vec<String> = sections.iter().map(|(name, driver)| format!("[bench.{name}]\n{driver}\n")).collect();
    fs::write(place.path("nacre.toml"), text.concat()).unwrap();
    let out = place.text("out");
    let words = args.split_whitespace().map(|word| if word == "OUT" { out.clone() } else { word.to_owned() });
    nacre(words.chain(["--config".into(), place.text("nacre.toml")]))
}

#[test]
fn a_command_asks_for_the_sections_that_it_needs_and_no_others() {
    let place = Place::new("");
    for (args, needs) in COMMANDS {
        let [needed, others] = [true, false].map(|wanted| {
            let sections = NOT_PLUGGED_IN.into_iter().filter(|(name, _)| needs.contains(name) == wanted);
            sections.collect::<Vec<_>>()
        });
        // The error is about the missing device, not about its section.
        let missed = run(&place, args, &needed).expect(1).stderr();
        assert!(!missed.contains("[bench."), "{args}: {missed}");
        if others.is_empty() {
            continue;
        }
        // A picture can be taken without a panel, but a configured panel is used.
        let told = run(&place, args, &others).expect(2).stderr();
        for name in needs {
            let wanted = [format!("no {name}"), format!("[bench.{name}]"), "nacre.toml".into()];
            assert!(wanted.iter().all(|w| told.contains(w)), "{args}: {told}");
        }
        assert!(others.iter().all(|(name, _)| !told.contains(&format!("[bench.{name}]"))), "{args}: {told}");
    }
    let plan = place.text("plan.toml");
    fs::write(&plan, "kind = \"free\"\nsteps = [{ exposure_ms = 3 }]\n").unwrap();
    let told = run(&place, &format!("capture {plan} --out OUT"), &NOT_PLUGGED_IN[..1]).expect(2).stderr();
    assert!(told.contains("[bench.camera] and [bench.display]") && !told.contains("[bench.stage]"), "{told}");
    assert!(!place.path("out").exists());
}

/// A bench with an emulated stage and lamp, and the sections of a configuration for them.
fn emulated(place: &Place) -> (BenchProcess, [String; 2]) {
    let [stage, lamp] = ["stage", "lamp"].map(|name| place.text(name));
    let devices = [format!("elliptec={stage}"), format!("relay={lamp}")];
    let more = ["--device", &devices[0], "--device", &devices[1]];
    let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &more);
    let stage = format!("driver = {{ kind = \"elliptec\", port = {stage:?}, answer_ms = 60000, move_ms = 60000 }}");
    (bench, [stage, format!("driver = {{ kind = \"relay\", path = \"unix:{lamp}\" }}")])
}

#[test]
fn a_device_is_driven_by_a_configuration_of_it_alone() {
    let place = Place::with_bench("", BENCH);
    let (bench, [stage, flash]) = emulated(&place);
    let (stage, flash) = ([("stage", stage.as_str())], [("flash", flash.as_str())]);
    for (args, needs) in COMMANDS {
        match needs {
            ["stage"] => drop(run(&place, args, &stage).expect(0)),
            ["flash"] => drop(run(&place, args, &flash).expect(0)),
            _ => {}
        }
    }
    assert_eq!(light(&bench), [false, false]);
    for (section, name) in [(stage, "stage"), (flash, "flash")] {
        let listed = run(&place, "--json devices", &section).expect(0).json();
        let listed = listed.as_array().unwrap();
        assert_eq!(listed.len(), 4, "{listed:?}");
        for device in listed {
            assert_eq!(
                (&device["configured"] == true, device["id"].is_string()),
                (device["kind"] == name, device["kind"] == name)
            );
        }
        let text = run(&place, "devices", &section).expect(0).stdout();
        assert!(text.contains("not configured: there is no [bench.camera]"), "{text}");
    }
    // A missing device does not prevent the listing of others.
    let run = run(&place, "--json devices", &[NOT_PLUGGED_IN[0], flash[0]]).expect(1);
    let listed = run.json();
    assert!(run.stderr().contains("no-such-port"), "{}", run.stderr());
    assert!(listed[0]["error"].as_str().unwrap().contains("no-such-port"), "{listed}");
    assert!(listed[3]["id"].as_str().unwrap().contains("relay"), "{listed}");
}

/// Starts a command that holds its device until it is stopped.
fn holding(args: &[&str]) -> (Child, String) {
    let (mut command, mark) = command();
    (command.args(args).stderr(Stdio::null()).stdout(Stdio::null()).spawn().unwrap(), mark)
}

fn until(bench: &BenchProcess, lit: [bool; 2]) {
    let begun = Instant::now();
    while light(bench) != lit {
        assert!(begun.elapsed() < NEVER, "the light is {:?}", light(bench));
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn signal(child: &Child, signal: &str) {
    std::process::Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
}

/// Devices that a command does not use remain available to others, and their light is unchanged.
#[test]
fn other_devices_stay_free() {
    let place = Place::with_bench("", BENCH);
    let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &["--real-time"]);
    let on = ["--sim", "--socket", bench.socket.to_str().unwrap()];
    let (mut flash, mark) = holding(&[&["flash", "on"], &on[..]].concat());
    until(&bench, [false, true]);
    nacre([&["stage", "move", "5"], &on[..]].concat()).expect(0);
    nacre([&["show", "disc:50", "--seconds", "0.05"], &on[..]].concat()).expect(0);
    let picture = place.text("look.png");
    nacre([&["snap", "--out", &picture], &on[..]].concat()).expect(0);
    let refused = nacre([&["flash", "test"], &on[..]].concat()).expect(1).stderr();
    assert!(refused.contains("in use by process"), "{refused}");
    assert_eq!(light(&bench), [false, true], "the flash is its owner's");
    signal(&flash, "-INT");
    assert!(flash.wait().unwrap().success());
    assert_gone(&mark);
    assert_eq!(light(&bench), [false, false]);
}

/// The guardian also holds the flash of a configuration without other devices.
#[test]
fn a_lamp_alone_goes_off_with_its_command() {
    let place = Place::with_bench("", BENCH);
    let (bench, [_, lamp]) = emulated(&place);
    fs::write(place.path("nacre.toml"), format!("[bench.flash]\n{lamp}\n")).unwrap();
    let config = place.text("nacre.toml");
    for kill in ["-INT", "-TERM", "-KILL"] {
        let (mut flash, mark) = holding(&["flash", "on", "--config", &config]);
        until(&bench, [false, true]);
        signal(&flash, kill);
        until(&bench, [false, false]);
        assert_eq!(flash.wait().unwrap().success(), kill != "-KILL", "{kill}");
        assert_gone(&mark);
    }
}

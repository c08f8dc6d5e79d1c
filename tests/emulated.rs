//! Sessions through the real drivers, down to the wire protocol. Emulated devices rotate the simulated bench's analyser
//! and switch its flash; the captured data equal those of simulated devices.

#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout)]

use nacre_tests::fault_table::{document, section};
use nacre_tests::{BENCH, BenchProcess, PLAN, Place, Run, data, light, nacre};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Upper limit in ms of any response of a device without a fault.
const LONG_MS: u64 = 60_000;

/// A bench with emulated devices, and a configuration for them.
struct Emulated {
    bench: BenchProcess,
    folder: PathBuf,
}

impl Emulated {
    /// `stage` is elliptec or grbl, `flash` is relay, blink1 or bulk; `more` is passed to the bench. With faults of an
    /// interlock, there is one.
    fn start(place: &Place, [stage, flash]: [&str; 2], more: &[&str]) -> Self {
        let folder = place.path("");
        let [port, lamp] = ["stage", "lamp"].map(|name| folder.join(name));
        // A faulty stage makes its driver wait for this limit. Without a fault, a response arrives in time on any busy
        // machine.
        let faulty = more.iter().any(|word| word.starts_with(&format!("{stage}:")));
        let [answer_ms, start_ms, move_ms] = if faulty { [300, 1500, 3000] } else { [LONG_MS; 3] };
        let patience = match stage {
            "grbl" => format!("start_ms = {start_ms}, home_ms = {move_ms}, "),
            _ => String::new(),
        };
        let mut config = format!(
            "[bench]\nsim = true\nsocket = {:?}\n[bench.stage]\n\
             driver = {{ kind = \"{stage}\", port = {port:?}, {patience}answer_ms = {answer_ms}, move_ms = {move_ms}, settling_ms = 0 }}\n\
             [bench.flash]\ndriver = {{ kind = \"{flash}\", path = \"unix:{}\" }}\nsettling_ms = 0.001\nmax_on_s = 120\n",
            folder.join("socket"),
            lamp.display(),
        );
        let door = folder.join("door").to_string_lossy().into_owned();
        let mut devices = vec![format!("{stage}={}", port.display()), format!("{flash}={}", lamp.display())];
        if more.iter().any(|word| word.starts_with("interlock:")) {
            devices.push(format!("interlock={door}"));
            let driver = format!("{{ kind = \"hid\", path = \"unix:{door}\" }}");
            let _ = writeln!(config, "[[bench.interlocks]]\nname = \"door\"\ndriver = {driver}");
        }
        fs::write(folder.join("nacre.toml"), config).unwrap();
        let mut args: Vec<&str> = devices.iter().flat_map(|device| ["--device", device]).collect();
        args.extend(more);
        let bench = BenchProcess::start(&folder.join("socket"), &folder.join("bench.toml"), &args);
        Self { bench, folder }
    }

    fn nacre(&self, args: &[&str]) -> Run {
        let config = self.folder.join("nacre.toml").to_string_lossy().into_owned();
        nacre([args, &["--config", &config]].concat())
    }

    fn capture(&self, session: &str) -> Run {
        let [plan, out] = ["plan.toml", session].map(|n| self.folder.join(n).to_string_lossy().into_owned());
        self.nacre(&["capture", &plan, "--out", &out])
    }
}

#[test]
fn a_session_through_the_drivers_equals_that_of_the_simulated_devices() {
    // Angles that are whole pulses only if the stage's number of pulses is read from it.
    let odd = PLAN.replace("22.5", "20").replace("67.5", "61");
    for (devices, plan, more) in [
        (["elliptec", "relay"], PLAN, None),
        (["elliptec", "blink1"], &odd, Some("360000")),
        (["grbl", "bulk"], PLAN, None),
    ] {
        let place = Place::with_bench(plan, BENCH);
        nacre(place.capture("simulated")).expect(0);
        let pulses = more.map_or(vec![], |n| vec!["--pulses-per-turn", n]);
        let emulated = Emulated::start(&place, devices, &pulses);
        let run = emulated.capture("driven").expect(0);
        assert_eq!(light(&emulated.bench), [false, false], "{}", run.stderr());
        let (whole, driven) = (data(&place.path("simulated")), data(&place.path("driven")));
        for ((name, a), (_, b)) in whole.iter().zip(&driven) {
            assert!(a == b, "{devices:?}: {name} differs");
        }
        let session: serde_json::Value =
            serde_json::from_slice(&fs::read(place.path("driven/session.json")).unwrap()).unwrap();
        let ids = session["devices"].to_string();
        assert!(ids.contains("Elliptec ELL14 s/n 11400517 address 0") || ids.contains("GRBL"), "{ids}");
        nacre(["check", &place.text("driven")]).expect(0);
    }
}

/// Zero and sense of rotation from the configuration are applied in both directions.
#[test]
fn zero_and_sense_of_the_mounting_hold() {
    let place = Place::with_bench(PLAN, BENCH);
    let emulated = Emulated::start(&place, ["elliptec", "relay"], &[]);
    let path = emulated.folder.join("nacre.toml");
    let config = fs::read_to_string(&path).unwrap();
    let mounting = "[bench.stage.mounting]\nzero_deg = 90\nsense = \"clockwise\"\n[bench.flash]";
    fs::write(&path, config.replace("[bench.flash]", mounting)).unwrap();
    emulated.nacre(&["stage", "home"]).expect(0);
    emulated.nacre(&["stage", "move", "22.5"]).expect(0);
    let said = emulated.nacre(&["--json", "stage", "where"]).expect(0).json();
    // Within the repeatability of the simulated axis.
    assert!((said["analyser_deg"].as_f64().unwrap() - 22.5).abs() < 0.1, "{said}");
    let socket = place.text("socket");
    let axis = nacre(["--json", "stage", "where", "--sim", "--socket", &socket]).expect(0).json();
    assert!((axis["analyser_deg"].as_f64().unwrap() - 67.5).abs() < 0.1, "{axis}");
    // Beyond the limits of the axis, rejected before any movement.
    let run = emulated.nacre(&["stage", "move", "120"]).expect(1);
    assert!(run.stderr().contains("-270") && run.stderr().contains("90"), "{}", run.stderr());
}

/// One manual command per device.
#[test]
fn devices_are_driven_by_hand_through_their_drivers() {
    let place = Place::with_bench(PLAN, BENCH);
    let emulated = Emulated::start(&place, ["elliptec", "relay"], &[]);
    let listed = emulated.nacre(&["--json", "devices"]).expect(0).json();
    let ids = listed.to_string();
    assert!(ids.contains("ELL14") && ids.contains("NACRE") && ids.contains("simulated camera"), "{ids}");
    emulated.nacre(&["flash", "test"]).expect(0);
    emulated.nacre(&["stage", "search-frequency"]).expect(0);
    emulated.nacre(&["stage", "clean"]).expect(0);
    let picture = place.text("look.png");
    emulated.nacre(&["snap", "--out", &picture, "--analyser-deg", "30", "--flash"]).expect(0);
    assert_eq!(light(&emulated.bench), [false, false]);
}

/// Text above the table in `docs/validation/faults.md`.
const HEADER: &str = "\
# Faults of devices in a session

Written by `tests/emulated.rs` (`NACRE_EVERY_STEP=all` tests every command). Each row is a device and a fault, which
occurs once or permanently, from a given command on. Stages, flashes and the interlock are emulated to the byte;
camera and display are simulated. A session of five frames was captured with each fault.

An interlock is read every 10 ms; each failed reading counts as an opening.

- *over*: the session tolerated the fault and succeeded.
- *stopped*: the session ended with an error that names the device. The last column shows one.

The data always equalled those of a session without faults to the byte, at once or after resuming on the repaired bench.
The light was off, except for a flash that no longer responds. The message then asks a person to switch it off.

";

const WIRE: [&str; 9] =
    ["no_answer", "half_answer", "dropped", "garbage", "resend", "reset", "slow", "wrong_status", "stuck_busy"];

/// Faults of an interlock: it has no state to lose or to get stuck.
const CONTACT: [&str; 7] = ["no_answer", "half_answer", "dropped", "garbage", "resend", "slow", "wrong_status"];

/// A session with a fault.
#[derive(Clone, Copy, PartialEq)]
struct Case {
    device: &'static str,
    fault: &'static str,
    /// Number of successful commands before the fault.
    after: u64,
    once: bool,
}

/// Devices, their faults, and the number of preceding commands: a few from the first to the last. Devices named by
/// `NACRE_EVERY_STEP` (`all`, `relay,bulk`, or `relay:garbage`) are tested at every command.
fn cases(whole: &[(String, Vec<u8>)]) -> Vec<Case> {
    let every = std::env::var("NACRE_EVERY_STEP").unwrap_or_default();
    let every = |device: &str, fault: &str| {
        every.split(',').any(|named| ["all", device, &format!("{device}:{fault}")].contains(&named))
    };
    let mut cases = vec![];
    for (device, faults, some) in [
        ("elliptec", &WIRE[..], &[0, 7, 30][..]),
        ("grbl", &WIRE, &[0, 7, 30]),
        ("relay", &WIRE, &[0, 7]),
        ("blink1", &WIRE, &[0, 7]),
        ("bulk", &WIRE, &[0, 7]),
        ("interlock", &CONTACT, &[0, 4]),
        ("camera", &["silent", "lost", "wrong_size", "damaged"], &[0, 9, 20]),
        ("display", &["silent", "lost", "other_pattern"], &[0, 2, 4]),
    ] {
        // The time determines how often an interlock is read.
        let every = |fault: &str| device != "interlock" && every(device, fault);
        let all = faults.iter().any(|f| every(f)).then(|| commands(device, faults[0], whole));
        for (fault, once) in faults.iter().flat_map(|fault| [(fault, true), (fault, false)]) {
            let steps = all.filter(|_| every(fault)).map_or(some.to_vec(), |all| (0..all).collect());
            cases.extend(steps.iter().map(|after| Case { device, fault, after: *after, once }));
        }
    }
    cases
}

/// Number of commands that a device receives in a session; later faults do not occur.
fn commands(device: &'static str, fault: &'static str, whole: &[(String, Vec<u8>)]) -> u64 {
    let met = |after: u64| session_with(Case { device, fault, after, once: false }, whole).is_some();
    let (mut low, mut high) = (0, 256);
    assert!(met(low) && !met(high), "{device}");
    while high - low > 1 {
        let middle = (low + high) / 2;
        if met(middle) { low = middle } else { high = middle }
    }
    high
}

/// Faults that lose no answer.
const HARMLESS: [&str; 2] = ["resend", "slow"];

/// Every device and every fault, at steps from the first command to the last. The session either succeeds with correct
/// data, or fails with an error that names the device. No light remains on, and the repaired bench completes the
/// session to identical bytes.
#[test]
fn every_fault_at_every_step_is_passed_over_or_named_and_the_session_completed() {
    let place = Place::with_bench(PLAN, BENCH);
    nacre(place.capture("whole")).expect(0);
    let whole = data(&place.path("whole"));
    let cases = cases(&whole);
    let (next, outcomes) = (AtomicUsize::new(0), Mutex::new(vec![None; cases.len()]));
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                loop {
                    let at = next.fetch_add(1, Ordering::Relaxed);
                    let Some(case) = cases.get(at) else { break };
                    let mut told = session_with(*case, &whole);
                    // On a busy machine a harmless fault can exceed a time limit.
                    for _ in 0..2 {
                        if told.is_some() && HARMLESS.contains(&case.fault) {
                            told = session_with(*case, &whole);
                        }
                    }
                    outcomes.lock().unwrap()[at] = Some(told);
                }
            });
        }
    });
    let outcomes: Vec<Option<String>> =
        outcomes.into_inner().unwrap().into_iter().map(|o| o.expect("a case has failed, see above")).collect();
    let text = HEADER.to_owned() + &table(&cases, &outcomes);
    let top = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    fs::write(top.join("target/faults.md"), &text).unwrap();
    if std::env::var_os("NACRE_UPDATE_DOCS").is_some() {
        let old = fs::read_to_string(document()).unwrap();
        fs::write(document(), text + "\n" + section(&old)).unwrap();
    }
    let named = outcomes.iter().flatten().count();
    println!("{named} of {} sessions with faults ended with an error", outcomes.len());
    for (case, outcome) in cases.iter().zip(&outcomes) {
        // Faults must be noticed, except harmless ones, which are tolerated.
        let harmless = HARMLESS.contains(&case.fault);
        assert!(outcome.is_some() || case.once || harmless, "{} {} is not noticed", case.device, case.fault);
        // Every answer of a slow stage exceeds its time limit.
        let late = ["elliptec", "grbl"].contains(&case.device) && case.fault == "slow" && !case.once;
        assert!(outcome.is_none() || late || !harmless, "{} {}: {outcome:?}", case.device, case.fault);
    }
}

/// Captures a session; returns its error message, if it failed.
fn session_with(case: Case, whole: &[(String, Vec<u8>)]) -> Option<String> {
    let Case { device, fault, after, once } = case;
    let name = format!("{device} {fault} after {after}{}", if once { " once" } else { "" });
    let place = Place::with_bench(PLAN, BENCH);
    let devices = match device {
        "grbl" => ["grbl", "relay"],
        "blink1" | "bulk" => ["elliptec", device],
        _ => ["elliptec", "relay"],
    };
    let wire = devices.contains(&device) || device == "interlock";
    let mut spec = vec!["--fault".to_owned(), format!("{device}:{fault}:{after}{}", if once { ":1" } else { "" })];
    if !wire {
        spec.clear();
        let times = if once { ", times = 1" } else { "" };
        let faults = format!("faults = [{{ device = \"{device}\", kind = \"{fault}\", after = {after}{times} }}]\n");
        fs::write(place.path("bench.toml"), BENCH.to_owned() + &faults).unwrap();
    }
    let run = {
        let spec: Vec<&str> = spec.iter().map(String::as_str).collect();
        let emulated = Emulated::start(&place, devices, &spec);
        let run = emulated.capture("s");
        let [panel, lit] = light(&emulated.bench);
        // A relay that no longer responds can only be switched off by a person, who is informed.
        let told = ["by hand", "power off"].iter().any(|words| run.stderr().contains(words));
        assert!(!lit || (wire && run.code() != 0 && told), "{name}: light is on\n{}", run.stderr());
        assert!(!panel || device == "display", "{name}: the panel is on\n{}", run.stderr());
        run
    };
    let (code, stderr) = (run.code(), run.stderr());
    let told = match code {
        0 => None,
        1 => {
            let says = match device {
                "elliptec" => "Elliptec",
                "grbl" => "GRBL",
                "blink1" => "blink(1)",
                "bulk" => "flash",
                "camera" => "simulated camera",
                "display" => "simulated panel",
                "interlock" => "door (bit 0 of unix:",
                other => other,
            };
            assert!(stderr.contains(says), "{name}: {stderr}");
            Some(stderr.trim().trim_start_matches("nacre: ").to_owned())
        }
        code => panic!("{name}: exit code {code}: {stderr}"),
    };
    if told.is_some() {
        fs::write(place.path("bench.toml"), BENCH).unwrap();
        let emulated = Emulated::start(&place, devices, &[]);
        if place.path("s/session.json").exists() {
            emulated.nacre(&["capture", "--resume", &place.text("s")]).expect(0);
        } else {
            emulated.capture("s").expect(0);
        }
    }
    assert!(data(&place.path("s")) == whole, "{name}: the data differ ({stderr})");
    told
}

/// Table of device, fault, and outcome at each step.
fn table(cases: &[Case], outcomes: &[Option<String>]) -> String {
    let mut text =
        "| device | fault | once, after commands | permanent, after commands | message |\n|---|---|---|---|---|\n"
            .to_owned();
    let mut rows: Vec<(&str, &str)> = cases.iter().map(|c| (c.device, c.fault)).collect();
    rows.dedup();
    for (device, fault) in rows {
        let of = |once: bool, stopped: bool| {
            let matches = |(c, told): &(&Case, &Option<String>)| {
                (c.device, c.fault, c.once, told.is_some()) == (device, fault, once, stopped)
            };
            runs(cases.iter().zip(outcomes).filter(matches).map(|(c, _)| c.after))
        };
        let cell = |once| match (of(once, false), of(once, true)) {
            (over, stopped) if stopped.is_empty() => format!("over: {over}"),
            (over, stopped) if over.is_empty() => format!("stopped: {stopped}"),
            (over, stopped) => format!("over: {over}; stopped: {stopped}"),
        };
        let last =
            cases.iter().zip(outcomes).rfind(|(c, told)| (c.device, c.fault) == (device, fault) && told.is_some());
        let told = plain(last.and_then(|l| l.1.as_deref()).unwrap_or_default());
        let (once, good) = (cell(true), cell(false));
        let _ = writeln!(text, "| {device} | {} | {once} | {good} | {told} |", fault.replace('_', " "));
    }
    text
}

/// Numbers, with consecutive ones as "first to last".
fn runs(numbers: impl Iterator<Item = u64>) -> String {
    let mut rows: Vec<[u64; 2]> = vec![];
    for n in numbers {
        match rows.last_mut() {
            Some([_, last]) if *last + 1 == n => *last = n,
            _ => rows.push([n; 2]),
        }
    }
    let rows: Vec<String> =
        rows.iter().map(|[a, b]| if a == b { a.to_string() } else { format!("{a} to {b}") }).collect();
    rows.join(", ")
}

/// A message without the step, which varies, and without the test's folder.
fn plain(told: &str) -> String {
    let told = told.split_once(": ").filter(|t| t.0.starts_with("frames/") || t.0 == "metering").map_or(told, |t| t.1);
    let mut parts = told.split("/tmp/.tmp");
    let mut text = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        text += &format!("/tmp{}", part.find('/').map_or("", |at| &part[at..]));
    }
    text.replace('\n', "; then ").replace('|', "\\|")
}

//! Sessions through the real drivers, down to the bytes: emulated devices turn the simulated bench's analyser and switch its
//! flash, and what is captured equals what the simulated devices give.

#![allow(clippy::unwrap_used)]

use nacre_tests::{BenchProcess, Place, Run, data, light, nacre};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

const BENCH: &str = "camera = { width = 64, height = 48 }\n";

/// All devices take part; the angles are whole pulses of an ELL14, forwards and backwards.
const PLAN: &str = r#"
    kind = "free"
    steps = [
        { analyser_deg = 22.5, exposure_ms = 8 },
        { analyser_deg = 67.5, exposure_ms = 8 },
        { analyser_deg = 67.5, exposure_ms = 8, flash = true },
        { analyser_deg = 45, exposure_ms = 4 },
        { exposure_ms = 4, flash = true, display = { pattern = "black" } },
    ]
"#;

/// A bench with emulated devices, and a configuration that drives them.
struct Emulated {
    bench: BenchProcess,
    folder: PathBuf,
}

impl Emulated {
    /// `flash` is relay, blink1 or bulk; `more` goes to the bench.
    fn start(place: &Place, flash: &str, more: &[&str]) -> Self {
        let folder = place.path("");
        let [stage, lamp] = ["stage", "lamp"].map(|name| folder.join(name));
        let config = format!(
            "[bench]\nsim = true\nsocket = {:?}\n[bench.stage]\n\
             driver = {{ kind = \"elliptec\", port = {stage:?}, answer_ms = 150, move_ms = 3000, settling_ms = 0 }}\n\
             [bench.flash]\ndriver = {{ kind = \"{flash}\", path = \"unix:{}\" }}\nsettling_ms = 0.001\n",
            folder.join("socket"),
            lamp.display(),
        );
        fs::write(folder.join("nacre.toml"), config).unwrap();
        let devices = [format!("elliptec={}", stage.display()), format!("{flash}={}", lamp.display())];
        let mut args = vec!["--device", &devices[0], "--device", &devices[1]];
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
    // Degrees that are whole pulses only of a stage whose number of pulses is read from it.
    let odd = PLAN.replace("22.5", "20").replace("67.5", "61");
    for (flash, plan, more) in [("relay", PLAN, None), ("blink1", &odd, Some("360000")), ("bulk", PLAN, None)] {
        let place = Place::with_bench(plan, BENCH);
        nacre(place.capture("simulated")).expect(0);
        let pulses = more.map_or(vec![], |n| vec!["--pulses-per-turn", n]);
        let emulated = Emulated::start(&place, flash, &pulses);
        let run = emulated.capture("driven").expect(0);
        assert_eq!(light(&emulated.bench), [false, false], "{}", run.stderr());
        let (whole, driven) = (data(&place.path("simulated")), data(&place.path("driven")));
        for ((name, a), (_, b)) in whole.iter().zip(&driven) {
            assert!(a == b, "{flash}: {name} differs");
        }
        let session: serde_json::Value =
            serde_json::from_slice(&fs::read(place.path("driven/session.json")).unwrap()).unwrap();
        let ids = session["devices"].to_string();
        assert!(ids.contains("Elliptec ELL14 s/n 11400517 address 0"), "{ids}");
        nacre(["check", &place.text("driven")]).expect(0);
    }
}

/// The analyser stands where the configuration says that the axis is, and its angle comes back.
#[test]
fn zero_and_sense_of_the_mounting_hold() {
    let place = Place::with_bench(PLAN, BENCH);
    let emulated = Emulated::start(&place, "relay", &[]);
    let path = emulated.folder.join("nacre.toml");
    let config = fs::read_to_string(&path).unwrap();
    let mounting = "[bench.stage.mounting]\nzero_deg = 90\nsense = \"clockwise\"\n[bench.flash]";
    fs::write(&path, config.replace("[bench.flash]", mounting)).unwrap();
    emulated.nacre(&["stage", "home"]).expect(0);
    emulated.nacre(&["stage", "move", "22.5"]).expect(0);
    let said = emulated.nacre(&["--json", "stage", "where"]).expect(0).json();
    assert_eq!(said["analyser_deg"], 22.5);
    let socket = place.text("socket");
    let axis = nacre(["--json", "stage", "where", "--sim", "--socket", &socket]).expect(0).json();
    assert!((axis["analyser_deg"].as_f64().unwrap() - 67.5).abs() < 0.2, "{axis}");
    // Beyond the axis' own limits, before anything moves.
    let run = emulated.nacre(&["stage", "move", "120"]).expect(1);
    assert!(run.stderr().contains("-270") && run.stderr().contains("90"), "{}", run.stderr());
}

/// One command a device, by hand.
#[test]
fn devices_are_driven_by_hand_through_their_drivers() {
    let place = Place::with_bench(PLAN, BENCH);
    let emulated = Emulated::start(&place, "relay", &[]);
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

/// What stands above the table in `docs/faults.md`.
const HEADER: &str = "\
# What a session makes of faults

Written by the tests (`tests/emulated.rs`): each row is a device, emulated down to its bytes, and what goes wrong with it from some
command on, for good. A session of five frames was taken with each; the numbers are the commands that went well before. *Passed
over*: the session ended well. *Stopped*: it ended with the error on the right. In every case the data were the same to the byte as
those of a session without faults, at once or after it was resumed on the repaired bench, and the light was off, but for a flash that
does not obey any more, where a person is told to switch it off.

";

const FAULTS: [&str; 9] =
    ["no_answer", "half_answer", "dropped", "garbage", "resend", "reset", "slow", "wrong_status", "stuck_busy"];

/// What became of a session with a fault.
struct Outcome {
    device: &'static str,
    fault: &'static str,
    after: u64,
    /// What the user was told; none when the fault was passed over.
    told: Option<String>,
}

/// Every device, every fault, at steps from the first command to the last: the session ends well and with the right data, or
/// with an error that names the device; no light is on; and the repaired bench completes it to the same bytes.
#[test]
fn every_fault_at_every_step_is_passed_over_or_named_and_the_session_completed() {
    let place = Place::with_bench(PLAN, BENCH);
    nacre(place.capture("whole")).expect(0);
    let whole = data(&place.path("whole"));
    let mut cases = vec![];
    for (device, steps) in [
        ("elliptec", &[0, 2, 7, 12, 20, 30][..]),
        ("relay", &[0, 2, 4, 7]),
        ("blink1", &[0, 2, 4, 7]),
        ("bulk", &[0, 2, 4, 7]),
    ] {
        for fault in FAULTS {
            cases.extend(steps.iter().map(|after| (device, fault, *after)));
        }
    }
    let (next, outcomes) = (AtomicUsize::new(0), Mutex::new(vec![]));
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| {
                while let Some((device, fault, after)) = cases.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let outcome = session_with(device, fault, *after, &whole);
                    outcomes.lock().unwrap().push(outcome);
                }
            });
        }
    });
    let mut outcomes = outcomes.into_inner().unwrap();
    assert_eq!(outcomes.len(), cases.len(), "a case has failed, see above");
    outcomes.sort_by_key(|o| (cases.iter().position(|c| *c == (o.device, o.fault, o.after))));
    let text = HEADER.to_owned() + &table(&outcomes);
    let top = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    fs::write(top.join("target/faults.md"), &text).unwrap();
    if std::env::var_os("NACRE_UPDATE_DOCS").is_some() {
        fs::write(top.join("docs/faults.md"), &text).unwrap();
    }
    // A fault that nobody notices would be no fault.
    let named = outcomes.iter().filter(|o| o.told.is_some()).count();
    println!("{named} of {} sessions with faults ended with an error", outcomes.len());
    assert!(named * 3 > outcomes.len());
}

fn session_with(device: &'static str, fault: &'static str, after: u64, whole: &[(String, Vec<u8>)]) -> Outcome {
    let case = format!("{device} {fault} after {after}");
    let place = Place::with_bench(PLAN, BENCH);
    let flash = if device == "elliptec" { "relay" } else { device };
    let spec = format!("{device}:{fault}:{after}");
    let run = {
        let emulated = Emulated::start(&place, flash, &["--fault", &spec]);
        let run = emulated.capture("s");
        // A relay that does not obey any more cannot be switched off by anybody but a person, who is told.
        let lit = light(&emulated.bench)[1];
        let told = run.stderr().contains("by hand") || run.stderr().contains("guardian");
        assert!(!lit || (device != "elliptec" && run.code() != 0 && told), "{case}: light is on\n{}", run.stderr());
        assert!(!light(&emulated.bench)[0], "{case}: the panel is on");
        run
    };
    let stderr = run.stderr();
    let name = match device {
        "elliptec" => "Elliptec",
        "blink1" => "blink(1)",
        "bulk" => "flash",
        other => other,
    };
    let told = match run.code() {
        0 => None,
        1 => {
            assert!(stderr.contains(name), "{case}: {stderr}");
            Some(stderr.trim().trim_start_matches("nacre: ").to_owned())
        }
        code => panic!("{case}: exit code {code}: {stderr}"),
    };
    if told.is_some() {
        let emulated = Emulated::start(&place, flash, &[]);
        if place.path("s/session.json").exists() {
            emulated.nacre(&["capture", "--resume", &place.text("s")]).expect(0);
        } else {
            emulated.capture("s").expect(0);
        }
    }
    assert!(data(&place.path("s")) == whole, "{case}: the data differ ({stderr})");
    Outcome { device, fault, after, told }
}

/// Device, fault, and what happens at each step, as a table.
fn table(outcomes: &[Outcome]) -> String {
    let mut text =
        "| device | fault | passed over | stopped | what the user is told |\n|---|---|---|---|---|\n".to_owned();
    let mut rows: BTreeMap<(usize, &str, &str), Vec<&Outcome>> = BTreeMap::new();
    for (k, o) in outcomes.iter().enumerate() {
        let first = outcomes.iter().position(|p| (p.device, p.fault) == (o.device, o.fault)).unwrap_or(k);
        rows.entry((first, o.device, o.fault)).or_default().push(o);
    }
    for ((_, device, fault), of) in rows {
        let steps = |stopped: bool| {
            let steps: Vec<String> =
                of.iter().filter(|o| o.told.is_some() == stopped).map(|o| o.after.to_string()).collect();
            if steps.is_empty() { "–".to_owned() } else { steps.join(", ") }
        };
        let told = of.iter().rev().find_map(|o| o.told.as_deref()).unwrap_or("");
        // Where it happened is one of many places.
        let told = told.split_once(": ").filter(|t| t.0.starts_with("frames/")).map_or(told, |t| t.1);
        let _ = writeln!(
            text,
            "| {device} | {} | {} | {} | {} |",
            fault.replace('_', " "),
            steps(false),
            steps(true),
            told.replace('|', "\\|")
        );
    }
    text
}

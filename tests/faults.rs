//! Faults of devices, disk and clock: an error that names the cause, no light, and a session that can be completed
//! after repair.

#![allow(clippy::unwrap_used)]

use nacre_tests::{BENCH, BenchProcess, NEVER, PLAN, Place, Run, assert_gone, binary, command, data, light, nacre};
use std::fs;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Runs the plan on a bench process with these faults; no light may be on afterwards.
fn capture_with(place: &Place, session: &str, faults: &str) -> Run {
    fs::write(place.path("faulty.toml"), format!("{BENCH}faults = [{faults}]")).unwrap();
    let bench = BenchProcess::start(&place.path("socket"), &place.path("faulty.toml"), &[]);
    let run = nacre(Place::on(place.capture(session), &bench));
    assert_eq!(light(&bench), [false, false], "{faults}: light is on\n{}", run.stderr());
    run
}

/// Completes the session on the repaired bench.
fn repair(place: &Place, session: &str, whole: &[(String, Vec<u8>)]) {
    let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &[]);
    nacre(Place::on(place.resume(session), &bench)).expect(0);
    assert!(data(&place.path(session)) == whole, "{session}: the data set differs");
    nacre(["check", &place.text(session)]).expect(0);
}

#[test]
fn a_lasting_fault_is_named_with_its_step_and_the_session_completed_after_repair() {
    let place = Place::with_bench(PLAN, BENCH);
    nacre(place.capture("whole")).expect(0);
    let whole = data(&place.path("whole"));
    for (k, (device, kind, after, words)) in [
        ("stage", "stops_short", 3, &["simulated stage", "move to 67.5°", "got", "turns freely"][..]),
        ("stage", "nonsense", 3, &["simulated stage", "move to 67.5°", "nonsense"]),
        ("stage", "silent", 3, &["simulated stage", "move to 67.5°", "none within"]),
        ("stage", "lost", 3, &["simulated stage", "lost link"]),
        ("camera", "silent", 20, &["simulated camera", "take a frame", "none within"]),
        ("camera", "lost", 20, &["simulated camera", "lost link"]),
        ("camera", "wrong_size", 20, &["simulated camera", "64 × 48", "63 × 48", "format"]),
        ("camera", "damaged", 20, &["simulated camera", "error flag", "cable"]),
        ("display", "silent", 3, &["simulated panel", "none within"]),
        ("display", "other_pattern", 3, &["simulated panel", "show a pattern", "diameter_mm: 180"]),
        ("flash", "wrong_state", 3, &["simulated flash", "switch o", "by hand"]),
        ("clock", "set_back", 40, &["clock", "set back"]),
        ("interlock", "opens", 6, &["simulated door switch", "open", "close it"]),
    ]
    .into_iter()
    .enumerate()
    {
        let name = format!("s{k}");
        let run =
            capture_with(&place, &name, &format!("{{ device = \"{device}\", kind = \"{kind}\", after = {after} }}"));
        let (code, stderr) = (run.code(), run.stderr());
        println!("{device} {kind}: {}", stderr.trim());
        assert_eq!(code, 1, "{device} {kind}: {stderr}");
        assert!(stderr.contains("frames/000") && stderr.contains("resume the session"), "{device} {kind}: {stderr}");
        words.iter().for_each(|w| assert!(stderr.contains(w), "{device} {kind}: no {w} in: {stderr}"));
        let journal = fs::read_to_string(place.path(&name).join("journal")).unwrap();
        assert!(journal.contains("committed") && journal.contains("stopped"), "{device} {kind}: {journal}");
        repair(&place, &name, &whole);
    }
}

#[test]
fn a_passing_fault_is_passed_over() {
    let place = Place::with_bench(PLAN, BENCH);
    nacre(place.capture("whole")).expect(0);
    let whole = data(&place.path("whole"));
    for (k, fault) in [
        "device = \"stage\", kind = \"nonsense\", after = 3, times = 1",
        "device = \"stage\", kind = \"lost\", after = 3, times = 1",
        "device = \"camera\", kind = \"lost\", after = 20, times = 1",
        "device = \"camera\", kind = \"damaged\", after = 20, times = 2",
        "device = \"display\", kind = \"other_pattern\", after = 3, times = 1",
        "device = \"flash\", kind = \"lost\", after = 3, times = 1",
    ]
    .into_iter()
    .enumerate()
    {
        let name = format!("s{k}");
        capture_with(&place, &name, &format!("{{ {fault} }}")).expect(0);
        assert!(data(&place.path(&name)) == whole, "{fault}");
        assert!(fs::read_to_string(place.path(&name).join("journal")).unwrap().contains("retried"), "{fault}");
    }
}

#[test]
fn an_interlock_that_is_open_at_the_start_or_opens_for_a_moment_stops_everything() {
    let place = Place::with_bench(PLAN, BENCH);
    let open = "{ device = \"interlock\", kind = \"opens\" }";
    let run = capture_with(&place, "never", open).expect(1);
    assert!(run.stderr().contains("open interlock"), "{}", run.stderr());
    assert!(!fs::read_to_string(place.path("never/journal")).unwrap().contains("intent"), "nothing was taken");
    let moment = "{ device = \"interlock\", kind = \"opens\", after = 6, times = 1 }";
    let run = capture_with(&place, "moment", moment).expect(1);
    assert!(run.stderr().contains("interlock"), "{}", run.stderr());
    // Manual commands are refused, too.
    fs::write(place.path("open.toml"), format!("{BENCH}faults = [{open}]")).unwrap();
    let bench = BenchProcess::start(&place.path("socket"), &place.path("open.toml"), &[]);
    let socket = place.text("socket");
    for args in [&["stage", "move", "30"][..], &["flash", "test"], &["show", "disc:50"], &["snap", "--out", "x.png"]] {
        let run = nacre([args, &["--sim", "--socket", &socket]].concat()).expect(1);
        assert!(run.stderr().contains("open interlock"), "{}", run.stderr());
    }
    assert_eq!(light(&bench), [false, false]);
}

#[test]
fn a_full_disk_is_named_and_the_session_completed_when_there_is_space() {
    let plan = "kind = \"polarization\"\ncamera = { exposure_ms = 20 }\nanalyser = { angles_deg = [0, 20, 40, 60, 80, 100, 120, 140] }";
    let place = Place::with_bench(plan, "camera = { width = 512, height = 512 }");
    nacre(place.capture("whole")).expect(0);
    fs::create_dir(place.path("disk")).unwrap();
    let script = r#"mount -t tmpfs -o size=1600k tmpfs disk || exit 77
        "$NACRE" capture plan.toml --sim --bench bench.toml --out disk/s; echo "code $?" >&2
        mount -o remount,size=64m disk || exit 77
        "$NACRE" capture --sim --resume disk/s && cp -r disk/s/frames disk/s/frames.json copy"#;
    fs::create_dir(place.path("copy")).unwrap();
    let (mut command, mark) = command();
    let environment: Vec<_> =
        command.get_envs().map(|(k, v)| (k.to_owned(), v.unwrap_or_default().to_owned())).collect();
    command = Command::new("unshare");
    command.args(["-m", "sh", "-c", script]).envs(environment).env("NACRE", binary()).current_dir(place.path(""));
    let run = Run(command.output().unwrap());
    if run.code() == 77 || run.stderr().contains("unshare failed") {
        println!("skipped: no private mount here ({})", run.stderr());
        return;
    }
    assert_gone(&mark);
    let run = run.expect(0);
    assert!(run.stderr().contains("code 1") && run.stderr().contains("disk/s/frames"), "{}", run.stderr());
    assert!(run.stderr().contains("free some space"), "{}", run.stderr());
    assert!(data(&place.path("copy")) == data(&place.path("whole")));
}

/// A capture on a bench at real pace.
struct Running {
    place: Place,
    bench: BenchProcess,
    child: Child,
    mark: String,
}

impl Running {
    fn start(plan: &str) -> Self {
        let place = Place::with_bench(plan, BENCH);
        let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &["--real-time"]);
        let (mut command, mark) = command();
        command.args(Place::on(place.capture("s"), &bench)).stdout(Stdio::null()).stderr(Stdio::piped());
        let child = command.spawn().unwrap();
        let running = Self { place, bench, child, mark };
        running.until("committed");
        running
    }

    fn journal(&self) -> String {
        fs::read_to_string(self.place.path("s/journal")).unwrap_or_default()
    }

    fn until(&self, word: &str) {
        let begun = Instant::now();
        while !self.journal().contains(word) {
            assert!(begun.elapsed() < NEVER, "no {word} in {}", self.journal());
            std::thread::sleep(Duration::from_millis(2));
        }
    }

    fn signal(&self, name: &str) {
        assert!(Command::new("kill").args([name, &self.child.id().to_string()]).status().unwrap().success());
    }

    /// Exit code and standard error; no light may remain on.
    fn end(self) -> (Place, BenchProcess, i32, String) {
        let output = self.child.wait_with_output().unwrap();
        assert_eq!(light(&self.bench), [false, false]);
        assert_gone(&self.mark);
        let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
        (self.place, self.bench, output.status.code().unwrap_or(-1), stderr)
    }
}

const SLOW: &str = "kind = \"polarization\"\ncamera = { exposure_ms = 60 }\nanalyser = { angles_deg = [0, 20, 40, 60, 80, 100, 120, 140] }";

#[test]
fn a_session_pauses_in_the_dark_and_goes_on() {
    let running = Running::start(SLOW);
    running.signal("-USR1");
    running.until("paused");
    assert_eq!(light(&running.bench), [false, false]);
    let before = running.journal();
    std::thread::sleep(Duration::from_millis(300));
    assert_eq!(running.journal(), before, "nothing happens in a pause");
    running.signal("-USR2");
    let (place, bench, code, stderr) = running.end();
    assert_eq!(code, 0, "{stderr}");
    drop(bench);
    nacre(["check", &place.text("s")]).expect(0);
}

#[test]
fn signals_end_a_session_in_order_and_it_can_be_resumed() {
    for signals in [&["-TERM"][..], &["-INT"], &["-INT", "-INT"], &["-USR1", "-TERM"]] {
        let running = Running::start(SLOW);
        let begun = Instant::now();
        for signal in signals {
            running.signal(signal);
            std::thread::sleep(Duration::from_millis(60));
        }
        let (place, bench, code, stderr) = running.end();
        assert_eq!(code, 130, "{signals:?}: {stderr}");
        println!("{signals:?}: ended after {:.2} s", begun.elapsed().as_secs_f64());
        let journal = fs::read_to_string(place.path("s/journal")).unwrap();
        assert!(journal.lines().last().unwrap().contains("stopped"), "{signals:?}: {journal}");
        nacre(["check", &place.text("s")]).expect(1);
        nacre(Place::on(place.resume("s"), &bench)).expect(0);
        nacre(["check", &place.text("s")]).expect(0);
    }
}

/// Commands started during a session report the process that uses the devices, and do not disturb it.
#[test]
fn devices_in_use_are_locked_with_the_holders_name() {
    let running = Running::start(SLOW);
    let holder = format!("process {}", running.child.id());
    let socket = running.place.text("socket");
    for args in [&["stage", "home"][..], &["flash", "test"], &["show", "disc:50"], &["snap", "--out", "x.png"]] {
        let run = nacre([args, &["--sim", "--socket", &socket]].concat()).expect(1);
        assert!(run.stderr().contains(&holder), "{}", run.stderr());
    }
    let listed = nacre(["--json", "devices", "--sim", "--socket", &socket]).expect(0).json();
    assert!(listed.as_array().unwrap().iter().all(|d| d["used_by"] == holder.as_str()), "{listed}");
    let second = nacre(["capture", "--sim", "--socket", &socket, "--resume", &running.place.text("s")]).expect(1);
    assert!(second.stderr().contains(&holder), "{}", second.stderr());
    let (_place, bench, code, stderr) = running.end();
    drop(bench);
    assert_eq!(code, 0, "{stderr}");
}

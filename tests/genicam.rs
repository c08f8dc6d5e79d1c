//! Sessions with the camera simulator of aravis (GigE Vision on a private network), an emulated Elliptec stage, and a
//! simulated browser page as panel. Skipped without the simulator, and where private networks cannot be made.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

use crate::panel::Page;
use nacre_tests::fault_table::record;
use nacre_tests::http::{self, Service, begin, finished};
use nacre_tests::{BENCH, BenchProcess, NEVER, Place, analyser_deg, listing, nacre};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fs;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const SIMULATOR: &str = "arv-fake-gv-camera-0.8";
/// Marks the process within the private network.
const INSIDE: &str = "NACRE_TEST_NETWORK";
const ANGLES: [f64; 4] = [0.0, 45.0, 90.0, 135.0];

/// Runs a test in a private network; returns whether this process is within it.
fn alone(test: &str) -> bool {
    if std::env::var_os(INSIDE).is_some() {
        return true;
    }
    let network = |run: &[&str]| {
        let mut command = Command::new("unshare");
        command.args(["--net", "--map-root-user", "sh", "-c", "ip link set lo up && exec \"$0\" \"$@\""]).args(run);
        command
    };
    let simulator = format!("command -v {SIMULATOR}");
    let can = network(&["sh", "-c", &simulator]).stdout(Stdio::null()).stderr(Stdio::null()).status();
    if !can.is_ok_and(|status| status.success()) {
        println!("skipped: no {SIMULATOR} (Debian: aravis-tools), or no right to make a private network");
        return false;
    }
    let this = std::env::current_exe().unwrap();
    let test = format!("genicam::{test}");
    let run = network(&[this.to_str().unwrap(), "--exact", &test, "--nocapture"]).env(INSIDE, "1").status();
    assert!(run.unwrap().success(), "see above");
    false
}

/// Serial number of this process's camera. Locks of devices are common to all networks of a machine.
fn serial() -> String {
    format!("N{}", std::process::id())
}

/// A simulated camera.
struct Simulator(Child);

impl Simulator {
    fn start() -> Self {
        let mut command = Command::new(SIMULATOR);
        command.args(["-i", "127.0.0.1", "-s", &serial()]).stdout(Stdio::null()).stderr(Stdio::null());
        Self(command.spawn().unwrap())
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A service with an emulated stage, the simulated camera and the page as panel.
struct Bench {
    place: Place,
    stage: BenchProcess,
    service: Service,
}

impl Bench {
    fn start() -> Self {
        let place = Place::with_bench("", BENCH);
        let stage = place.text("stage");
        let config = format!(
            "[bench.stage]\ndriver = {{ kind = \"elliptec\", port = {stage:?}, answer_ms = 60000, move_ms = 60000, \
             settling_ms = 0 }}\n\
             [bench.camera]\ndriver = {{ kind = \"genicam\", device = \"Aravis-Fake-{}\", region = [0, 0, 64, 48], \
             fps = 40.0, control_lag_frames = 1 }}\n\
             [bench.display]\ndriver = {{ kind = \"page\", size_mm = [500, 300] }}\n",
            serial()
        );
        fs::write(place.path("nacre.toml"), config).unwrap();
        let device = format!("elliptec={stage}");
        let more = ["--real-time", "--device", &device];
        let stage = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &more);
        let service = Service::serve(&place, &["--config", &place.text("nacre.toml")]);
        Self { place, stage, service }
    }

    fn page(&self) -> Page {
        Page::open(&self.service)
    }
}

fn plan() -> Value {
    let mut plan = http::plan(ANGLES.len(), 10.0);
    plan["plan"]["extras"] = json!(["display_black"]);
    plan
}

/// Paths of all keys of a JSON value, with the elements of an array as one.
fn keys(value: &Value, path: &str, found: &mut BTreeSet<String>) {
    match value {
        Value::Object(object) => object.iter().for_each(|(key, value)| keys(value, &format!("{path}.{key}"), found)),
        Value::Array(array) => array.iter().for_each(|value| keys(value, &format!("{path}[]"), found)),
        _ => drop(found.insert(path.to_owned())),
    }
}

fn keys_of(session: &std::path::Path) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    let text = fs::read(session.join("frames.json")).unwrap();
    keys(&serde_json::from_slice(&text).unwrap(), "", &mut found);
    found
}

/// The session has the files and the description of one on the simulated bench, whose optics are known in addition.
#[test]
fn a_polarization_session_equals_a_simulated_one_in_kind() {
    if !alone("a_polarization_session_equals_a_simulated_one_in_kind") {
        return;
    }
    let _simulator = Simulator::start();
    let bench = Bench::start();
    let page = bench.page();
    let devices = bench.service.get("/api/v1/devices").expect(200).json();
    println!("{devices}");
    let id = begin(&bench.service, &plan());
    let done = finished(&bench.service, &id);
    assert_eq!(done["frames_committed"], ANGLES.len() + 1, "{done}");
    assert!((analyser_deg(&bench.stage) - 135.0).abs() < 0.1);
    let patterns: Vec<Value> = page.shown.lock().unwrap().clone();
    assert!(patterns.iter().any(|p| p["kind"] == "disc") && patterns.last().unwrap()["kind"] == "black");
    let described = fs::read_to_string(bench.place.only_session().join("session.json")).unwrap();
    for device in [&format!("genicam Aravis Fake s/n {}", serial()), "Elliptec ELL14", "pattern page"] {
        assert!(described.contains(device), "{described}");
    }

    let simulated = Place::with_bench("", BENCH);
    let service = Service::start(&simulated, &[]);
    let id = begin(&service, &plan());
    finished(&service, &id);
    let [real, simulated] = [&bench.place, &simulated].map(Place::only_session);
    let files = |folder: &std::path::Path| -> Vec<String> {
        listing(folder).into_iter().filter(|f| f.starts_with("frames")).collect()
    };
    assert_eq!(files(&real), files(&simulated));
    let [real, simulated] = [&real, &simulated].map(|s| keys_of(s));
    println!("only simulated: {:?}", simulated.difference(&real).collect::<Vec<_>>());
    assert_eq!(real.difference(&simulated).collect::<Vec<_>>(), Vec::<&String>::new());
}

/// Number of committed frames after which the camera is unplugged; `NACRE_EVERY_STEP` names more.
fn steps() -> Vec<usize> {
    let every = std::env::var("NACRE_EVERY_STEP").unwrap_or_default();
    if ["all", "genicam"].contains(&every.as_str()) { (0..ANGLES.len()).collect() } else { vec![0, 2] }
}

#[test]
fn a_camera_that_is_unplugged_and_returns_completes_the_session() {
    if !alone("a_camera_that_is_unplugged_and_returns_completes_the_session") {
        return;
    }
    let (mut left, mut tries, mut message) = (steps(), 0, String::new());
    while let Some(step) = left.pop() {
        let mut simulator = Some(Simulator::start());
        let bench = Bench::start();
        let page = bench.page();
        let id = begin(&bench.service, &plan());
        let base = format!("/api/v1/sessions/{id}");
        bench.service.until(&base, |s| s["frames_committed"].as_u64() >= Some(step as u64));
        simulator.take();
        let begun = Instant::now();
        let over = |s: &Value| (s["error"].is_string() && s["stage"].is_null()) || s["state"] == "finished";
        let stopped = bench.service.until(&base, over);
        println!("step {step}: {} after {:?}", stopped["error"], begun.elapsed());
        if !stopped["error"].is_string() {
            // On a busy machine, the session may end before the camera is gone.
            tries += 1;
            assert!(tries < 20, "sessions always end first");
            left.push(step);
            continue;
        }
        let told = stopped["error"].as_str().unwrap();
        assert!(told.contains("Aravis") && told.contains(&serial()), "{told}");
        message = told.replace(&serial(), "N12345");
        assert!(begun.elapsed() < NEVER);
        // The panel is black while the session waits.
        let dark = Instant::now();
        while page.shown.lock().unwrap().last().is_none_or(|p| p["kind"] != "black") {
            assert!(dark.elapsed() < NEVER);
            std::thread::sleep(Duration::from_millis(20));
        }
        simulator = Some(Simulator::start());
        // Meanwhile the page was closed and opened again.
        drop(page);
        let page = bench.page();
        std::thread::sleep(Duration::from_millis(500));
        bench.service.post(&format!("{base}/resume"), &json!({})).expect(202);
        let done = finished(&bench.service, &id);
        assert_eq!(done["frames_committed"], ANGLES.len() + 1, "{done}");
        nacre(["check", bench.place.only_session().to_str().unwrap()]).expect(0);
        drop((page, bench));
        drop(simulator);
    }
    record("genicam", "camera killed", &steps(), &message);
}

/// `nacre devices` and `nacre doctor` name the camera, its network and the program that controls it.
#[test]
fn the_camera_is_found_and_its_network_examined() {
    if !alone("the_camera_is_found_and_its_network_examined") {
        return;
    }
    let none = nacre(["devices"]).expect(0).stdout();
    assert!(!none.contains("GigE"), "{none}");
    let _simulator = Simulator::start();
    std::thread::sleep(Duration::from_millis(500));
    let found = nacre(["devices"]).expect(0).stdout();
    let line = found.lines().find(|line| line.contains("GigE Vision camera Aravis Fake at 127.0.0.1"));
    assert!(line.is_some_and(|line| line.starts_with("camera")), "{found}");
    let id = format!("Aravis-Fake-{}", serial());
    let driver = format!("driver = {{ kind = \"genicam\", device = \"{id}\"");
    assert!(found.contains(&format!("{driver} }}")), "{found}");
    let place = Place::new("");
    let checks = nacre(["--json", "doctor", "--data", &place.text("")]).stdout();
    let checks: Value = serde_json::from_str(&checks).unwrap();
    let check = |name: &str| checks.as_array().unwrap().iter().find(|c| c["name"] == name).cloned();
    assert_eq!(check("camera network lo").unwrap()["ok"], "ok", "{checks}");
    assert_eq!(check(&format!("access to {id}")).unwrap()["ok"], "ok", "{checks}");
    assert!(check("receive buffer").is_some(), "{checks}");

    let picture = place.text("look.png");
    let camera = place.text("camera.toml");
    let section = format!("[bench.camera]\n{driver}, region = [0, 0, 64, 48] }}\n");
    fs::write(&camera, section).unwrap();
    nacre(["snap", "--config", &camera, "--exposure-ms", "10", "--out", &picture]).expect(0);
    assert!(fs::metadata(&picture).unwrap().len() > 500);
    fs::write(&camera, fs::read_to_string(&camera).unwrap().replace("Fake-N", "Fake-M")).unwrap();
    let missed = nacre(["snap", "--config", &camera, "--out", &place.text("none.png")]).expect(1).stderr();
    assert!(missed.contains(&format!("but from {id} (127.0.0.1)")), "{missed}");
}

//! Sessions with the virtual camera of libgphoto2, an emulated Elliptec stage, and a simulated browser page as panel.
//! Skipped without the virtual camera (`tests/gphoto2/build`).

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

use crate::panel::Page;
use crate::still::{Tags, camera_time, completed, jpeg};
use nacre_tests::fault_table::{committed, record};
use nacre_tests::http::{Service, begin};
use nacre_tests::{BENCH, BenchProcess, NEVER, Place, analyser_deg, nacre};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Marks the process that uses the virtual camera.
const INSIDE: &str = "NACRE_TEST_GPHOTO2";
const ANGLES: [f64; 4] = [0.0, 45.0, 90.0, 135.0];
const SIZE: [u32; 2] = [64, 48];

/// Runs a test with the virtual camera, which takes this photograph; returns whether this process has it.
fn alone(test: &str, photograph: &[u8], variables: &[(&str, &str)]) -> bool {
    if std::env::var_os(INSIDE).is_some() {
        return true;
    }
    let target = Path::new(env!("CARGO_MANIFEST_DIR")).join("../target");
    let lib = std::env::var_os("CARGO_TARGET_DIR").map_or(target, PathBuf::from).join("gphoto2/lib");
    if !lib.join("libgphoto2.so.6").exists() {
        println!("skipped: no virtual camera (tests/gphoto2/build)");
        return false;
    }
    let camera = tempfile::tempdir().unwrap();
    let folder = camera.path().join("DCIM/100GPHOT");
    fs::create_dir_all(&folder).unwrap();
    fs::write(folder.join("A.JPG"), photograph).unwrap();
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", &format!("gphoto2::{test}"), "--nocapture"]).env(INSIDE, "1");
    command.env("LD_LIBRARY_PATH", &lib).env("CAMLIBS", lib.join("camlibs")).env("IOLIBS", lib.join("iolibs"));
    command.env("VCAMERA_DIR", camera.path()).envs(variables.iter().copied());
    // Locks of devices are common to all processes of a machine.
    static ONE: Mutex<()> = Mutex::new(());
    let _one = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    assert!(command.status().unwrap().success(), "see above");
    false
}

const CAMERA: &str =
    "[bench.camera]\ndriver = { kind = \"gphoto2\", device = \"Nikon DSC D750\", format = \"jpeg\" }\n";

/// A service with an emulated stage, the virtual camera and the page as panel.
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
             settling_ms = 0 }}\n{CAMERA}[bench.display]\ndriver = {{ kind = \"page\", size_mm = [500, 300] }}\n"
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

fn plan(exposure_ms: f64, average: u32) -> Value {
    json!({ "plan": {
        "kind": "polarization", "name": "a tile",
        "camera": { "exposure_ms": exposure_ms, "average": average },
        "analyser": { "angles_deg": ANGLES }, "extras": ["display_black"],
    } })
}

#[test]
fn a_polarization_session_takes_and_fetches_its_photographs() {
    let photograph = jpeg(SIZE[0], SIZE[1], None);
    if !alone("a_polarization_session_takes_and_fetches_its_photographs", &photograph, &[]) {
        return;
    }
    let bench = Bench::start();
    let page = bench.page();
    let devices = bench.service.get("/api/v1/devices").expect(200).json();
    println!("{devices}");
    // Exposures that the camera lacks are refused with the nearest ones.
    let refused = bench.service.post("/api/v1/sessions", &plan(30.0, 1));
    assert!(refused.status == 422 || refused.status == 400, "{}", refused.text());
    assert!(refused.text().contains("20 ms or 50 ms"), "{}", refused.text());
    let id = begin(&bench.service, &plan(10.0, 1));
    let done = completed(&bench.service, &id);
    assert_eq!(done["frames_committed"], ANGLES.len() + 1, "{done}");
    assert!((analyser_deg(&bench.stage) - 135.0).abs() < 0.1);
    let patterns: Vec<Value> = page.shown.lock().unwrap().clone();
    assert!(patterns.iter().any(|p| p["kind"] == "disc") && patterns.last().unwrap()["kind"] == "black");
    let session = bench.place.only_session();
    let described = fs::read_to_string(session.join("session.json")).unwrap();
    assert!(described.contains("gphoto2 Nikon DSC D750 s/n 0.1"), "{described}");
    let frames: Value = serde_json::from_slice(&fs::read(session.join("frames.json")).unwrap()).unwrap();
    println!("{frames}");
    // Each frame is the photograph's green channel.
    let expected = image::load_from_memory(&jpeg(SIZE[0], SIZE[1], None)).unwrap().to_rgb8();
    let files: Vec<PathBuf> = fs::read_dir(session.join("frames")).unwrap().flatten().map(|e| e.path()).collect();
    assert_eq!(files.len(), ANGLES.len() + 1, "{files:?}");
    for file in files {
        let frame = image::open(&file).unwrap().to_luma16();
        assert_eq!(frame.dimensions(), (SIZE[0], SIZE[1]));
        let off = frame.enumerate_pixels().map(|(x, y, v)| v.0[0].abs_diff(u16::from(expected[(x, y)].0[1]))).max();
        assert!(off <= Some(2), "{off:?} in {}", file.display());
    }
    nacre(["check", session.to_str().unwrap()]).expect(0);
}

/// The virtual camera's memory is full after 26 photographs.
#[test]
fn a_full_memory_card_stops_a_session_in_the_dark() {
    let photograph = jpeg(SIZE[0], SIZE[1], None);
    if !alone("a_full_memory_card_stops_a_session_in_the_dark", &photograph, &[]) {
        return;
    }
    let bench = Bench::start();
    let page = bench.page();
    let id = begin(&bench.service, &plan(10.0, 16));
    let stopped = bench.service.until(&format!("/api/v1/sessions/{id}"), |s| s["error"].is_string());
    println!("{}", stopped["error"]);
    let told = stopped["error"].as_str().unwrap();
    assert!(told.contains("ran full") && told.contains("empty it"), "{told}");
    record("gphoto2", "memory full (not resumed)", &[committed(&stopped)], told);
    let dark = Instant::now();
    while page.shown.lock().unwrap().last().is_none_or(|p| p["kind"] != "black") {
        assert!(dark.elapsed() < NEVER);
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
}

/// `nacre devices` and `nacre doctor` name camera and library, `nacre snap` takes a photograph.
#[test]
fn the_camera_is_found_and_takes_a_photograph() {
    let tags = Tags { exposure: [1, 100], iso: 100, taken: camera_time(0), serial: "1" };
    if !alone("the_camera_is_found_and_takes_a_photograph", &jpeg(SIZE[0], SIZE[1], Some(&tags)), &[]) {
        return;
    }
    let found = nacre(["devices"]).expect(0).stdout();
    assert!(found.contains("digital camera Nikon DSC D750 at usb:001,001"), "{found}");
    assert!(found.contains("driver = { kind = \"gphoto2\", device = \"Nikon DSC D750\" }"), "{found}");
    let place = Place::new("");
    let checks = nacre(["--json", "doctor", "--data", &place.text("")]).stdout();
    let checks: Value = serde_json::from_str(&checks).unwrap();
    let cameras = checks.as_array().unwrap().iter().find(|c| c["name"] == "cameras").cloned().unwrap();
    assert!(cameras["found"].as_str().unwrap().split(" can be used").next().unwrap().contains("gphoto2"), "{cameras}");
    let config = place.text("camera.toml");
    fs::write(&config, CAMERA).unwrap();
    let listed = nacre(["devices", "--config", &config]).stdout();
    assert!(listed.contains("gphoto2 Nikon DSC D750 s/n 0.1"), "{listed}");
    let snap =
        |ms: &str, out: &str| nacre(["snap", "--config", &config, "--exposure-ms", ms, "--out", &place.text(out)]);
    snap("10", "a.png").expect(0);
    assert_eq!(image::open(place.path("a.png")).unwrap().to_luma16().dimensions(), (SIZE[0], SIZE[1]));
    let lacking = snap("30", "b.png");
    assert!(
        lacking.code() != 0 && lacking.stderr().contains("1/50 s (20 ms) and 1/20 s (50 ms)"),
        "{}",
        lacking.stderr()
    );
    // The virtual camera always states 1/100 s, as a camera in an automatic mode does.
    let other = snap("100", "c.png").expect(1).stderr();
    assert!(other.contains("1/100 s (10 ms)") && other.contains("dial to M"), "{other}");
}

#[test]
fn an_empty_battery_is_an_error_that_names_it() {
    let photograph = jpeg(SIZE[0], SIZE[1], None);
    if !alone("an_empty_battery_is_an_error_that_names_it", &photograph, &[("VCAMERA_BATTERY", "2")]) {
        return;
    }
    let place = Place::new("");
    fs::write(place.path("camera.toml"), CAMERA).unwrap();
    let told =
        nacre(["snap", "--config", &place.text("camera.toml"), "--out", &place.text("a.png")]).expect(1).stderr();
    assert!(told.contains("2%") && told.contains("charge the battery"), "{told}");
}

//! Stage drivers on serial ports, down to the wire, on the simulated bench. Whatever the fault, a stage that reports
//! its arrival stands at the reported angle.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests")]

use nacre_base::progress::Silent;
use nacre_drivers::stage::{StageConfig, StageDriver, elliptec, grbl};
use nacre_drivers::wire::wait;
use nacre_drivers::{Arrived, Class, Clock, DeviceResult, Stage, SystemClock};
use nacre_sim::emulators::{self, ByteFault, ByteFaultKind, Emulator, Pty};
use nacre_sim::{Bench, BenchConfig, SharedBench};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tempfile::TempDir;

/// Tolerance of a stage's angle in degrees.
const TOLERANCE_DEG: f64 = 0.2;

/// Distance of two angles in degrees. Axes with more than a turn take the shorter way to an angle that is equal modulo
/// 360°.
fn apart_deg(a: f64, b: f64) -> f64 {
    let turned = (a - b).rem_euclid(360.0);
    turned.min(360.0 - turned)
}

/// A small bench.
fn bench(stage_speed_deg_s: f64) -> SharedBench {
    let mut config = BenchConfig::default();
    (config.camera.width, config.camera.height) = (16, 16);
    (config.stage.speed_deg_s, config.stage.settle_ms) = (stage_speed_deg_s, 10.0);
    SharedBench::real_time(Bench::new(&config, &Silent).unwrap())
}

/// A device on a separate port, and the bench behind it.
struct Rig {
    bench: SharedBench,
    port: PathBuf,
    _device: Pty,
    _folder: TempDir,
}

impl Rig {
    /// A device with a fast stage.
    fn new<E: Emulator + 'static>(device: impl FnOnce(SharedBench) -> E) -> Self {
        Self::with_speed(900.0, device)
    }

    fn with_speed<E: Emulator + 'static>(speed_deg_s: f64, device: impl FnOnce(SharedBench) -> E) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (bench, port) = (bench(speed_deg_s), folder.path().join("port"));
        let device = Pty::start(&port, device(bench.clone())).unwrap();
        Self { bench, port, _device: device, _folder: folder }
    }

    fn true_deg(&self) -> f64 {
        // Requests advance the time of the bench.
        self.bench.now();
        self.bench.look(Bench::analyser_deg)
    }

    /// Checks that a stage which reports its arrival has arrived.
    fn check(&self, arrived: &DeviceResult<Arrived>, fault: &str) {
        if let Ok(arrived) = arrived {
            let truth = self.true_deg();
            assert!(apart_deg(arrived.angle_deg, truth) < TOLERANCE_DEG, "{fault}: {arrived:?}, really {truth}°");
        }
    }
}

fn open(driver: StageDriver) -> DeviceResult<Box<dyn Stage>> {
    let config = StageConfig { driver, mounting: Default::default() };
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    config.open(&clock).unwrap()
}

fn ell(options: emulators::elliptec::Options) -> Rig {
    Rig::new(|bench| emulators::elliptec::Elliptec::new(Box::new(bench), options))
}

fn ell_driver(port: &Path) -> StageDriver {
    StageDriver::Elliptec(elliptec::Settings { port: port.to_path_buf(), settling_ms: 10, ..Default::default() })
}

/// Same driver with short time limits.
fn hasty_ell(port: &Path) -> StageDriver {
    let (port, answer_ms, move_ms) = (port.to_path_buf(), 150, 3000);
    StageDriver::Elliptec(elliptec::Settings { port, answer_ms, move_ms, settling_ms: 10, ..Default::default() })
}

#[test]
fn an_elliptec_stage_turns_the_analyser() {
    let rig = ell(Default::default());
    // The stage was at another angle at power-up.
    let mut stage = open(ell_driver(&rig.port)).unwrap();
    assert_eq!(stage.describe().id, "Elliptec ELL14 s/n 11400517 address 0");
    rig.check(&Ok(wait(stage.home()).unwrap()), "home");
    for angle in [45.0, 90.0, 22.5, 359.0, 0.0] {
        let arrived = wait(stage.move_to(angle)).unwrap();
        assert!((arrived.angle_deg - angle).abs() < TOLERANCE_DEG);
        rig.check(&Ok(arrived), "move");
        assert!(apart_deg(wait(stage.position()).unwrap(), rig.true_deg()) < TOLERANCE_DEG);
    }
}

#[test]
fn an_elliptec_stage_that_was_left_anywhere_homes_first() {
    let rig = ell(Default::default());
    rig.bench.answer(&nacre_sim::Request::MoveTo { angle_deg: 77.0 }).unwrap();
    let mut stage = open(ell_driver(&rig.port)).unwrap();
    let arrived = wait(stage.move_to(30.0)).unwrap();
    assert!((arrived.angle_deg - 30.0).abs() < TOLERANCE_DEG);
    rig.check(&Ok(arrived), "first move");
}

/// Opens, homes, moves up and back to 0, as a session does, and checks every arrival. Returns the first error; a
/// second error ends it.
fn session(rig: &Rig, driver: StageDriver, name: &str) -> DeviceResult<()> {
    let mut stage = open(driver)?;
    let mut errors = vec![];
    for angle in [None, Some(60.0), Some(0.0), Some(15.0), Some(15.0)] {
        let arrived = match angle {
            Some(angle) => wait(stage.move_to(angle)),
            None => wait(stage.home()),
        };
        rig.check(&arrived, name);
        errors.extend(arrived.err());
        if errors.len() == 2 {
            break;
        }
    }
    errors.into_iter().next().map_or(Ok(()), Err)
}

/// Number of simultaneous sessions. More would wait for each other and cause late answers.
const AT_A_TIME: usize = 6;

/// Tests every fault, early and late, once and permanently, each with a separate device.
fn all_faults(device: fn(Vec<ByteFault>) -> Rig, driver: fn(&Path) -> StageDriver) {
    let when = [(0, None), (6, Some(1)), (9, None), (14, Some(1))];
    let faults =
        ByteFaultKind::ALL.into_iter().flat_map(|kind| when.map(|(after, times)| ByteFault { kind, after, times }));
    let queue = std::sync::Mutex::new(faults.collect::<Vec<_>>());
    let next = || queue.lock().unwrap().pop();
    std::thread::scope(|scope| {
        for _ in 0..AT_A_TIME {
            scope.spawn(|| {
                while let Some(fault) = next() {
                    let (rig, name) = (device(vec![fault.clone()]), format!("{fault:?}"));
                    let result = session(&rig, driver(&rig.port), &name);
                    expect_words(fault.kind, fault.times, result, &name);
                }
            });
        }
    });
}

#[test]
fn no_fault_makes_an_elliptec_stage_arrive_wrongly() {
    all_faults(|faults| ell(emulators::elliptec::Options { faults, ..Default::default() }), hasty_ell);
}

fn controller(options: emulators::grbl::Options) -> Rig {
    Rig::new(|bench| emulators::grbl::Grbl::new(Box::new(bench), options))
}

fn grbl_driver(port: &Path) -> StageDriver {
    StageDriver::Grbl(grbl_settings(port))
}

fn grbl_settings(port: &Path) -> grbl::Settings {
    grbl::Settings { port: port.to_path_buf(), settling_ms: 10, ..Default::default() }
}

/// Driver with short time limits.
fn hasty_grbl(port: &Path) -> StageDriver {
    let short = grbl_settings(port);
    StageDriver::Grbl(grbl::Settings { answer_ms: 150, start_ms: 500, move_ms: 3000, home_ms: 3000, ..short })
}

#[test]
fn a_grbl_axis_turns_the_analyser() {
    let in_work = emulators::grbl::Options { work: true, ..Default::default() };
    let geared = emulators::grbl::Options { axis: 'X', degrees_per_unit: -3.0, homes: false, ..Default::default() };
    for options in [Default::default(), in_work, geared] {
        let rig = controller(options.clone());
        let settings = grbl::Settings {
            axis: if options.axis == 'X' { grbl::protocol::Axis::X } else { grbl::protocol::Axis::A },
            degrees_per_unit: options.degrees_per_unit,
            homes: options.homes,
            ..grbl_settings(&rig.port)
        };
        let mut stage = open(StageDriver::Grbl(settings)).unwrap();
        assert!(stage.describe().id.starts_with("GRBL 1.1h.20190825 on "));
        rig.check(&Ok(wait(stage.home()).unwrap()), "home");
        for angle in [45.0, 90.0, -22.5, 359.0, 0.0] {
            let arrived = wait(stage.move_to(angle)).unwrap();
            assert!((arrived.angle_deg - angle).abs() < TOLERANCE_DEG);
            rig.check(&Ok(arrived), "move");
            assert!(apart_deg(wait(stage.position()).unwrap(), rig.true_deg()) < TOLERANCE_DEG);
        }
    }
}

#[test]
fn no_fault_makes_a_grbl_axis_arrive_wrongly() {
    all_faults(|faults| controller(emulators::grbl::Options { faults, ..Default::default() }), hasty_grbl);
}

/// Drops a move after a moment, as a cancelled capture does, then stops it in order.
fn cut_short(rig: &Rig, driver: StageDriver, target_deg: f64) -> f64 {
    let mut stage = open(driver).unwrap();
    wait(stage.home()).unwrap();
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
    runtime.block_on(async {
        let cut = tokio::time::timeout(std::time::Duration::from_millis(150), stage.move_to(target_deg)).await;
        assert!(cut.is_err(), "it was to be cut short");
        stage.halt().await.unwrap();
    });
    let [stopped, reported] = [rig.true_deg(), wait(stage.position()).unwrap()];
    std::thread::sleep(std::time::Duration::from_millis(50));
    assert!((stopped - rig.true_deg()).abs() < 1e-6, "it still moves");
    assert!(apart_deg(stopped, reported) < TOLERANCE_DEG);
    let arrived = wait(stage.move_to(20.0)).unwrap();
    assert!((arrived.angle_deg - 20.0).abs() < TOLERANCE_DEG);
    rig.check(&Ok(arrived), "after the stop");
    stopped
}

#[test]
fn a_movement_is_cut_short_where_that_is_possible() {
    let rig = Rig::with_speed(60.0, |bench| emulators::grbl::Grbl::new(Box::new(bench), Default::default()));
    let stopped = cut_short(&rig, grbl_driver(&rig.port), 170.0);
    assert!(stopped > 1.0 && stopped < 165.0, "{stopped}");
    let rig = ell(Default::default());
    assert!(cut_short(&rig, ell_driver(&rig.port), 355.0) > 354.0, "nothing ends it sooner");
}

#[test]
fn a_port_comes_back_after_its_link_was_dropped_and_goes_with_its_device() {
    let faults = vec![ByteFault { kind: ByteFaultKind::Dropped, after: 6, times: Some(1) }];
    let rig = ell(emulators::elliptec::Options { faults, ..Default::default() });
    let error = session(&rig, ell_driver(&rig.port), "dropped").unwrap_err();
    assert_eq!(error.class, Class::Lost);
    std::thread::sleep(std::time::Duration::from_millis(600));
    session(&rig, ell_driver(&rig.port), "again").unwrap();
    let Rig { port, _device, _folder, .. } = rig;
    drop(_device);
    assert!(port.symlink_metadata().is_err(), "the link is removed");
}

/// A stage with a custom protocol: it answers at the start of a move.
struct Teller {
    bench: SharedBench,
    heard: String,
}

impl Teller {
    fn answer(&self, line: &str) -> String {
        use nacre_sim::{Reply, Request};
        let request = match line.split_once(' ') {
            Some(("MOVE", "111.000")) => return "ERR cable\r\n".into(),
            Some(("MOVE", angle)) => Request::MoveTo { angle_deg: angle.parse().unwrap() },
            _ if line == "HOME" => Request::Home,
            _ if line == "STOP" => Request::Halt,
            _ => Request::Position,
        };
        match self.bench.answer(&request) {
            Ok(Reply::Angle(angle)) => format!("POS {angle:.2}\r\n"),
            Ok(_) => "OK\r\n".into(),
            Err(e) => format!("ERR {e}\r\n"),
        }
    }
}

impl Emulator for Teller {
    fn receive(&mut self, bytes: &[u8]) -> Vec<emulators::Action> {
        self.heard.push_str(std::str::from_utf8(bytes).unwrap());
        let mut actions = vec![];
        while let Some((line, rest)) = self.heard.split_once("\r\n") {
            actions.push(emulators::Action::Send(self.answer(line).into_bytes()));
            self.heard = rest.to_owned();
        }
        actions
    }

    fn tick(&mut self) -> Vec<emulators::Action> {
        vec![]
    }
}

/// Reads a configuration in the user's format.
fn read(text: &str) -> Result<StageConfig, String> {
    toml::from_str(text).map_err(|e| e.to_string())
}

#[test]
fn a_stage_that_the_configuration_describes_turns_the_analyser() {
    let rig = Rig::with_speed(120.0, |bench| Teller { bench, heard: String::new() });
    let config = r#"
        [driver]
        kind = "line"
        port = "PORT"
        home = { send = "HOME", reply = "OK" }
        move = { send = "MOVE {angle:.3}", reply = "OK" }
        position = { send = "POS?", reply = "POS {angle}" }
        halt = { send = "STOP", reply = "OK" }
        errors = ["ERR{any}"]
        motion = { answer_ms = 600, move_ms = 5000, settling_ms = 20, tolerance_deg = 0.2, limits_deg = [-400, 800] }
    "#;
    let config = read(&config.replace("PORT", &rig.port.display().to_string())).unwrap();
    let mut stage = open(config.driver.clone()).unwrap();
    rig.check(&Ok(wait(stage.home()).unwrap()), "home");
    for angle in [45.0, 300.0, 0.0] {
        let arrived = wait(stage.move_to(angle)).unwrap();
        assert!((arrived.angle_deg - angle).abs() < TOLERANCE_DEG);
        rig.check(&Ok(arrived), "move");
    }
    // Refusals of the stage are reported in its own wording.
    let error = wait(stage.move_to(111.0)).unwrap_err();
    assert!(error.got.contains("ERR cable"), "{error}");
    drop(stage);
    assert!(cut_short(&rig, config.driver, 170.0) < 165.0);
}

#[test]
fn configurations_are_read_and_unknown_keys_refused() {
    let config = read(
        "[driver]\nkind = \"elliptec\"\nport = \"/dev/ttyUSB0\"\naddress = \"b\"\n[mounting]\nzero_deg = 12.5\nsense = \"clockwise\"",
    );
    let StageDriver::Elliptec(settings) = config.unwrap().driver else { panic!("another driver") };
    assert_eq!(char::from(settings.address), 'B');
    let config = read("driver = { kind = \"grbl\", port = \"/dev/ttyACM0\", axis = \"X\", homes = false }");
    let StageDriver::Grbl(settings) = config.unwrap().driver else { panic!("another driver") };
    assert!(!settings.homes && settings.baud == 115_200);
    for (wrong, word) in [
        ("driver = { kind = \"elliptec\", prot = \"x\" }", "prot"),
        ("driver = { kind = \"elliptec\", address = \"G\" }", "no address"),
        ("driver = { kind = \"grbl\", axis = \"W\" }", "W"),
        ("driver = { kind = \"line\", port = \"x\" }", "move"),
    ] {
        let error = read(wrong).unwrap_err();
        assert!(error.contains(word), "{error}");
    }
}

/// Checks that the error message matches the fault.
fn expect_words(kind: ByteFaultKind, times: Option<u64>, result: DeviceResult<()>, name: &str) {
    use ByteFaultKind::*;
    let words: &[&str] = match kind {
        Dropped => &["lost link"],
        Reset => &["initialising", "reset"],
        WrongStatus => &["mechanical timeout", "alarm", "error 9"],
        StuckBusy => &["busy", "Run", "nothing"],
        _ => &["“", "without its"],
    };
    match result {
        // Temporary faults may be overcome.
        Ok(()) if times.is_some() || kind == Resend => {}
        Ok(()) => panic!("{name}: nothing noticed"),
        Err(error) => {
            // On a busy machine any answer may be late.
            let late = ["nothing", "none", "an end without"].iter().any(|words| error.got.starts_with(words));
            let fits = late || words.iter().any(|word| error.got.contains(word));
            assert!(fits, "{name}: {error}");
            assert!(late || (error.class == Class::Lost) == (kind == Dropped), "{name}: {error}");
            assert!(!error.remedy.is_empty());
        }
    }
}

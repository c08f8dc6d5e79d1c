//! Sessions with stage, camera and flash of an independent Alpaca server (tests/alpaca, on the crate ascom-alpaca), and
//! of INDI's simulators (Debian: indi-bin), with a simulated browser page as panel. Skipped without the servers, and
//! where private networks cannot be made.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

use crate::panel::Page;
use nacre_processing::image::read_exr;
use nacre_tests::fault_table::record;
use nacre_tests::http::{self, Service, begin, exchange, finished};
use nacre_tests::{Place, nacre};
use serde_json::{Value, json};
use std::fs;
use std::net::SocketAddr;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Marks the process within the private network.
const INSIDE: &str = "NACRE_TEST_NETWORK";
/// Sets up a private network and runs a command in it. A server that was killed can use its port again at once.
const NETWORK: &str =
    "ip link set lo up && { echo 0 >/proc/sys/net/ipv4/tcp_max_tw_buckets; } 2>/dev/null; exec \"$0\" \"$@\"";
const ANGLES: [f64; 4] = [0.0, 45.0, 90.0, 135.0];
/// Far more than any step takes on a busy machine.
const NEVER: Duration = Duration::from_secs(60);

/// Kind of a server.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Alpaca,
    Indi,
}

impl Kind {
    fn program(self) -> String {
        let built = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../target/alpaca-tools/debug/alpaca-server");
        match self {
            Self::Alpaca => std::env::var("NACRE_ALPACA_SERVER").unwrap_or_else(|_| built().display().to_string()),
            Self::Indi => "indiserver".into(),
        }
    }

    /// Runs a test in a private network; returns whether this process is within it.
    fn alone(self, test: &str) -> bool {
        if std::env::var_os(INSIDE).is_some() {
            return true;
        }
        let network = |run: &[&str]| {
            let mut command = Command::new("unshare");
            command.args(["--net", "--map-root-user", "sh", "-c", NETWORK]).args(run);
            command
        };
        let program = self.program();
        let there = format!("command -v '{program}'");
        let can = network(&["sh", "-c", &there]).stdout(Stdio::null()).stderr(Stdio::null()).status();
        if !can.is_ok_and(|status| status.success()) {
            println!("skipped: no {program}, or no right to make a private network");
            return false;
        }
        let this = std::env::current_exe().unwrap();
        let test = format!("device_servers::{test}");
        let run = network(&[this.to_str().unwrap(), "--exact", &test, "--nocapture"]).env(INSIDE, "1").status();
        assert!(run.unwrap().success(), "see above");
        false
    }

    fn address(self) -> String {
        match self {
            Self::Alpaca => format!("{}:11111", host()),
            Self::Indi => format!("{}:7624", host()),
        }
    }

    fn config(self) -> String {
        let address = self.address();
        let [stage, camera, flash] = match self {
            Self::Alpaca => ["", "", "id = 1"],
            Self::Indi => {
                ["device = \"Rotator Simulator\"", "device = \"CCD Simulator\"", "device = \"Light Panel Simulator\""]
            }
        };
        let kind = if self == Self::Alpaca { "alpaca" } else { "indi" };
        let driver = |more: &[&str]| {
            let more: String = more.iter().filter(|m| !m.is_empty()).map(|m| format!(", {m}")).collect();
            format!("driver = {{ kind = \"{kind}\", address = \"{address}\"{more} }}\n")
        };
        format!(
            "[bench.stage]\n{}[bench.camera]\n{}[bench.flash]\n{}settling_ms = 1\n[bench.display]\n\
             driver = {{ kind = \"page\", size_mm = [500, 300] }}\n",
            driver(&[stage, "motion = { settling_ms = 0, speed_deg_s = 90.0 }"]),
            driver(&[camera, "region = [0, 0, 64, 48]"]),
            driver(&[flash]),
        )
    }

    /// Whether the lamp is on, asked without Nacre.
    fn lamp(self) -> bool {
        match self {
            Self::Alpaca => {
                let address: SocketAddr = self.address().parse().unwrap();
                let request = format!(
                    "GET /api/v1/switch/0/getswitch?Id=1 HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n"
                );
                exchange(address, request.as_bytes(), NEVER).json()["Value"] == true
            }
            Self::Indi => {
                indi("indi_getprop", &["-1"], "Light Panel Simulator.FLAT_LIGHT_CONTROL.FLAT_LIGHT_ON") == "On"
            }
        }
    }
}

/// An address of this process. Locks of devices are common to all networks of a machine.
fn host() -> String {
    let id = std::process::id();
    format!("127.{}.{}.{}", 1 + (id >> 16) % 250, (id >> 8) % 256, 1 + id % 250)
}

/// Answer of INDI's own client.
fn indi(program: &str, options: &[&str], property: &str) -> String {
    let done = Command::new(program).args(["-h", &host()]).args(options).arg(property).output().unwrap();
    String::from_utf8_lossy(&done.stdout).trim().to_owned()
}

/// A server of devices.
struct Server {
    child: Child,
    _home: tempfile::TempDir,
}

impl Server {
    fn start(kind: Kind) -> Self {
        let home = tempfile::tempdir().unwrap();
        let mut command = Command::new(kind.program());
        match kind {
            Kind::Alpaca => command.args([&kind.address(), "t"]),
            Kind::Indi => command.args([
                "indi_simulator_ccd",
                "indi_simulator_rotator",
                "indi_simulator_lightpanel",
                "indi_simulator_telescope",
            ]),
        };
        command.env("HOME", home.path()).process_group(0).stdout(Stdio::null()).stderr(Stdio::null());
        let server = Self { child: command.spawn().unwrap(), _home: home };
        let begun = Instant::now();
        while std::net::TcpStream::connect(kind.address()).is_err() {
            assert!(begun.elapsed() < NEVER, "the server does not answer");
            std::thread::sleep(Duration::from_millis(20));
        }
        server
    }
}

impl Drop for Server {
    /// Ends the server with its drivers.
    fn drop(&mut self) {
        let _ = Command::new("kill").args(["-KILL", "--", &format!("-{}", self.child.id())]).status();
        let _ = self.child.wait();
    }
}

fn bench(kind: Kind) -> (Place, Service) {
    let place = Place::new("");
    fs::write(place.path("nacre.toml"), kind.config()).unwrap();
    let service = Service::serve(&place, &["--config", &place.text("nacre.toml")]);
    (place, service)
}

fn plan(extras: &[&str]) -> Value {
    let mut plan = http::plan(ANGLES.len(), 10.0);
    plan["plan"]["extras"] = json!(extras);
    plan
}

/// Path of a file below a folder.
fn find(folder: &Path, name: &str) -> PathBuf {
    let mut found = vec![folder.to_owned()];
    while let Some(path) = found.pop() {
        if path.file_name().is_some_and(|n| n == name) {
            return path;
        }
        if path.is_dir() {
            found.extend(fs::read_dir(path).unwrap().flatten().map(|e| e.path()));
        }
    }
    panic!("no {name} in {}", folder.display());
}

/// The camera sees light polarized at 30° with a degree of 0.5 through the analyser.
#[test]
fn a_session_with_alpaca_devices_measures_their_world() {
    if !Kind::Alpaca.alone("a_session_with_alpaca_devices_measures_their_world") {
        return;
    }
    let _server = Server::start(Kind::Alpaca);
    let (place, service) = bench(Kind::Alpaca);
    let _page = Page::open(&service);
    println!("{}", service.get("/api/v1/devices").expect(200).json());
    let id = begin(&service, &plan(&["dark"]));
    let done = finished(&service, &id);
    assert_eq!(done["frames_committed"], ANGLES.len() + 1, "{done}");
    let folder = place.only_session();
    let described = fs::read_to_string(folder.join("session.json")).unwrap();
    for device in ["alpaca Test rotator id Turner-t", "alpaca Test camera id Eye-t", "alpaca Test switches id Board-t"]
    {
        assert!(described.contains(device), "{described}");
    }
    nacre(["check", folder.to_str().unwrap()]).expect(0);
    let maps = place.text("maps");
    nacre(["reconstruct", "polarization", folder.to_str().unwrap(), "--out", &maps]).expect(0);
    let map = read_exr(&find(&place.path("maps"), "stokes.exr")).unwrap();
    let [s0, s1, s2] = ["S0", "S1", "S2"].map(|name| &map.channels[name]);
    // The gradient grows to the right and, faster, downwards: the last pixel is the brightest.
    let signal = |at: usize| f64::from(s0[at]) / f64::from(s0[64 * 48 - 1]);
    for [x, y] in [[63, 0], [0, 47], [30, 20]] {
        let expected = (20 * x + 300 * y) as f64 / f64::from(20 * 63 + 300 * 47);
        assert!((signal(64 * y + x) - expected).abs() < 1e-3, "{x}, {y}: {}", signal(64 * y + x));
    }
    let last = 64 * 48 - 1;
    let [q, u] = [s1[last] / s0[last], s2[last] / s0[last]].map(f64::from);
    assert!((q.hypot(u) - 0.5).abs() < 1e-3 && (0.5 * u.atan2(q).to_degrees() - 30.0).abs() < 0.05, "{q}, {u}");
}

#[test]
fn a_session_with_indi_devices_completes() {
    if !Kind::Indi.alone("a_session_with_indi_devices_completes") {
        return;
    }
    let _server = Server::start(Kind::Indi);
    let (place, service) = bench(Kind::Indi);
    let _page = Page::open(&service);
    println!("{}", service.get("/api/v1/devices").expect(200).json());
    let id = begin(&service, &plan(&[]));
    let done = finished(&service, &id);
    assert_eq!(done["frames_committed"], ANGLES.len(), "{done}");
    let told = indi("indi_getprop", &["-1"], "Rotator Simulator.ABS_ROTATOR_ANGLE.ANGLE");
    assert_eq!(told, "135");
    let folder = place.only_session();
    let described = fs::read_to_string(folder.join("session.json")).unwrap();
    for device in ["indi Rotator Simulator (indi_simulator_rotator)", "indi CCD Simulator (indi_simulator_ccd)"] {
        assert!(described.contains(device), "{described}");
    }
    nacre(["check", folder.to_str().unwrap()]).expect(0);
}

/// Number of committed frames after which the server is killed; `NACRE_EVERY_STEP` names more.
fn steps() -> Vec<usize> {
    let every = std::env::var("NACRE_EVERY_STEP").unwrap_or_default();
    if ["all", "servers"].contains(&every.as_str()) { (0..ANGLES.len()).collect() } else { vec![0, 2] }
}

/// A server that is killed in a session, and returns, completes the session.
fn lost_and_found(kind: Kind) {
    let (mut left, mut tries, mut message) = (steps(), 0, String::new());
    while let Some(step) = left.pop() {
        let mut server = Some(Server::start(kind));
        let (place, service) = bench(kind);
        let page = Page::open(&service);
        let id = begin(&service, &plan(&[]));
        let base = format!("/api/v1/sessions/{id}");
        service.until(&base, |s| s["frames_committed"].as_u64() >= Some(step as u64));
        server.take();
        let begun = Instant::now();
        // Without a stage of work it has released the devices.
        let over = |s: &Value| (s["error"].is_string() && s["stage"].is_null()) || s["state"] == "finished";
        let stopped = service.until(&base, over);
        println!("step {step}: {} after {:?}", stopped["error"], begun.elapsed());
        if !stopped["error"].is_string() {
            // On a busy machine, the session may end before the server is gone.
            tries += 1;
            assert!(tries < 20, "sessions always end first");
            left.push(step);
            continue;
        }
        let told = stopped["error"].as_str().unwrap();
        assert!(told.contains(&host()) || told.contains(" id "), "{told}");
        message = told.replace(&host(), "127.0.0.1");
        let dark = Instant::now();
        while page.shown.lock().unwrap().last().is_none_or(|p| p["kind"] != "black") {
            assert!(dark.elapsed() < NEVER);
            std::thread::sleep(Duration::from_millis(20));
        }
        server = Some(Server::start(kind));
        service.post(&format!("{base}/resume"), &json!({})).expect(202);
        let done = finished(&service, &id);
        assert_eq!(done["frames_committed"], ANGLES.len(), "{done}");
        nacre(["check", place.only_session().to_str().unwrap()]).expect(0);
        drop((page, service, server));
    }
    record(if kind == Kind::Alpaca { "alpaca" } else { "indi" }, "server killed", &steps(), &message);
}

#[test]
fn an_alpaca_server_that_is_killed_and_returns_completes_the_session() {
    if Kind::Alpaca.alone("an_alpaca_server_that_is_killed_and_returns_completes_the_session") {
        lost_and_found(Kind::Alpaca);
    }
}

#[test]
fn an_indi_server_that_is_killed_and_returns_completes_the_session() {
    if Kind::Indi.alone("an_indi_server_that_is_killed_and_returns_completes_the_session") {
        lost_and_found(Kind::Indi);
    }
}

/// The guardian switches a lamp behind a server off when Nacre is killed.
fn off_after_a_kill(kind: Kind) {
    let _server = Server::start(kind);
    let (_place, service) = bench(kind);
    let switch = |on: bool| {
        let devices = service.post("/api/v1/devices/flash/switch", &json!({ "on": on })).expect(200).json();
        assert!(devices["flash"]["on"] == on && kind.lamp() == on, "{devices}");
    };
    switch(true);
    switch(false);
    switch(true);
    let begun = Instant::now();
    service.kill();
    while kind.lamp() {
        assert!(begun.elapsed() < NEVER, "the lamp stays on");
    }
    println!("off after {:?}", begun.elapsed());
}

#[test]
fn an_alpaca_lamp_is_off_after_a_kill() {
    if Kind::Alpaca.alone("an_alpaca_lamp_is_off_after_a_kill") {
        off_after_a_kill(Kind::Alpaca);
    }
}

#[test]
fn an_indi_lamp_is_off_after_a_kill() {
    if Kind::Indi.alone("an_indi_lamp_is_off_after_a_kill") {
        off_after_a_kill(Kind::Indi);
    }
}

/// `nacre devices` lists the devices of both servers, each with a driver that works as printed.
#[test]
fn devices_of_servers_are_listed() {
    if !Kind::Alpaca.alone("devices_of_servers_are_listed") || std::env::var_os(INSIDE).is_none() {
        return;
    }
    let mut command = Command::new(Kind::Alpaca.program());
    command.args(["127.0.0.1:11111", &host()]).process_group(0).stdout(Stdio::null()).stderr(Stdio::null());
    let _server = Server { child: command.spawn().unwrap(), _home: tempfile::tempdir().unwrap() };
    let begun = Instant::now();
    let found = loop {
        let found = nacre(["devices"]).expect(0).stdout();
        if found.contains("Test camera") {
            break found;
        }
        assert!(begun.elapsed() < NEVER, "{found}");
    };
    println!("{found}");
    let driver = |kind: &str| format!("driver = {{ kind = \"alpaca\", address = \"127.0.0.1:11111\", {kind} = 0 }}");
    assert!(["rotator", "camera", "switch"].iter().all(|kind| found.contains(&driver(kind))), "{found}");
    assert!(found.contains("flash    Alpaca switch Test switches at 127.0.0.1:11111 (perhaps)"), "{found}");
    let place = Place::new("");
    fs::write(place.path("c.toml"), format!("[bench.camera]\n{}\n", driver("camera"))).unwrap();
    let picture = place.text("look.png");
    nacre(["snap", "--config", &place.text("c.toml"), "--exposure-ms", "10", "--out", &picture]).expect(0);
    assert!(fs::metadata(&picture).unwrap().len() > 500);
}

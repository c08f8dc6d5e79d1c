//! The GenICam driver with the camera simulator of aravis (Debian: aravis-tools), over GigE Vision packets.
//!
//! Each test runs in a private network, so that it neither finds nor is found by other cameras. The tests are skipped
//! without the simulator, or where private networks cannot be made.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests")]

use nacre_drivers::camera::genicam::aravis::list;
use nacre_drivers::camera::genicam::{self, Settings, Trigger};
use nacre_drivers::discovery::gvcp::{self, Control};
use nacre_drivers::{Camera, Class, Clock, DeviceResult, Frame, Freshness, SystemClock};
use std::net::Ipv4Addr;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

const SIMULATOR: &str = "arv-fake-gv-camera-0.8";
const ADDRESS: &str = "127.0.0.1";
/// Marks the process within the private network.
const INSIDE: &str = "NACRE_TEST_NETWORK";
const MS: Duration = Duration::from_millis(1);
const ANY: Freshness = Freshness { steady_since: Duration::ZERO, first_sequence: 0, duration: Duration::ZERO };

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
    let run = network(&[this.to_str().unwrap(), "--exact", test, "--nocapture"]).env(INSIDE, "1").status();
    assert!(run.unwrap().success(), "see above");
    false
}

/// A simulated camera, which ends with the test.
struct Simulator(Child);

impl Simulator {
    fn start(more: &[&str]) -> Self {
        let mut command = Command::new(SIMULATOR);
        command.args(["-i", ADDRESS, "-s", "N1"]).args(more);
        let started = Self(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap());
        let begun = SystemClock.now();
        while list::cameras().is_empty() {
            assert!(SystemClock.now() - begun < MS * 20_000, "the simulator does not answer");
        }
        started
    }
}

impl Drop for Simulator {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn settings() -> Settings {
    Settings { region: Some([100, 50, 64, 48]), fps: Some(20.0), ..Settings::new(ADDRESS) }
}

fn open(settings: &Settings) -> DeviceResult<Box<dyn Camera>> {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    genicam::open(settings, &clock)
}

fn run<T>(future: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().build().unwrap().block_on(future)
}

fn next(camera: &mut dyn Camera) -> DeviceResult<Frame> {
    run(camera.next_frame(ANY))
}

/// The simulator draws diagonal ramps: neighbours to the right and below are equal.
fn is_diagonal(frame: &Frame) -> bool {
    let at = |x: usize, y: usize| frame.codes[y * frame.width + x];
    let equal = |y: usize| (1..frame.width).all(|x| at(x - 1, y) == at(x, y - 1));
    (1..frame.height).all(equal) && frame.codes.iter().max() > frame.codes.iter().min()
}

#[test]
fn frames_arrive_in_order_as_configured() {
    if !alone("frames_arrive_in_order_as_configured") {
        return;
    }
    let _simulator = Simulator::start(&[]);
    let mut camera = open(&settings()).unwrap();
    let info = camera.describe();
    println!("{info:?}");
    assert_eq!(info.id, "genicam Aravis Fake s/n N1");
    assert_eq!((info.width, info.height, info.white, info.gain), (64, 48, 65535, [1.0, 1.0]));
    assert!(info.exposure_s[1] <= 0.05 + 1e-9, "the frame rate limits the exposure");
    let controls = run(camera.configure(MS * 20, 1.0)).unwrap();
    assert_eq!((controls.exposure, controls.gain), (MS * 20, 1.0));
    let frames: Vec<Frame> = (0..10).map(|_| next(camera.as_mut()).unwrap()).collect();
    for pair in frames.windows(2) {
        let [first, second] = [&pair[0], &pair[1]];
        assert_eq!((second.width, second.height, second.codes.len()), (64, 48, 64 * 48));
        assert!(is_diagonal(second) && first.codes != second.codes);
        assert!(second.stamp.sequence > first.stamp.sequence && second.stamp.timestamp > first.stamp.timestamp);
    }
    // A wrong conversion of the camera's clock would be off by far more than a busy machine delays frames.
    let age = SystemClock.now() - frames[9].stamp.timestamp;
    assert!(age < MS * 60_000, "{age:?}");
    // Queued frames are seen through.
    std::thread::sleep(MS * 300);
    let fresh = Freshness { steady_since: SystemClock.now(), first_sequence: 0, duration: MS * 20 };
    let stale = (0..20).take_while(|_| !fresh.accepts(run(camera.next_frame(fresh)).unwrap().stamp)).count();
    println!("{stale} old frames");
    assert!((1..15).contains(&stale));
    drop(camera);

    for (format, white) in [("Mono8", 255), ("BayerRG8", 255), ("Mono16", 65535)] {
        let named = Settings { format: Some(format.into()), region: None, fps: None, ..settings() };
        let mut camera = open(&named).unwrap();
        let info = camera.describe();
        // By default the whole sensor.
        assert_eq!((info.width, info.height, info.white), (2048, 2048, white), "{format}");
        let frame = next(camera.as_mut()).unwrap();
        assert_eq!(frame.codes.len(), 2048 * 2048);
        assert!(format == "BayerRG8" || is_diagonal(&frame), "{format}");
    }
}

#[test]
fn a_software_trigger_starts_each_exposure() {
    if !alone("a_software_trigger_starts_each_exposure") {
        return;
    }
    let _simulator = Simulator::start(&[]);
    let mut camera = open(&Settings { trigger: Trigger::Software, ..settings() }).unwrap();
    run(camera.configure(MS * 5, 1.0)).unwrap();
    for _ in 0..5 {
        let steady_since = SystemClock.now();
        let fresh = Freshness { steady_since, first_sequence: 0, duration: MS * 5 };
        let frame = run(camera.next_frame(fresh)).unwrap();
        assert!(fresh.accepts(frame.stamp) && is_diagonal(&frame), "{:?}", frame.stamp);
        std::thread::sleep(MS * 200);
    }
}

#[test]
fn lost_packets_are_named() {
    if !alone("lost_packets_are_named") {
        return;
    }
    let _simulator = Simulator::start(&["-r", "60"]);
    let mut camera = open(&settings()).unwrap();
    let errors: Vec<_> = (0..40).filter_map(|_| next(camera.as_mut()).err()).collect();
    println!("{} of 40 frames: {}", errors.len(), errors[0]);
    assert!((1..40).contains(&errors.len()));
    let named = |e: &nacre_drivers::DeviceError| e.class == Class::Retry && e.got.contains("incomplete frame");
    assert!(errors.iter().all(named), "{errors:?}");
    assert!(errors.iter().any(|e| e.got.contains("packets are missing")), "{errors:?}");
    assert!(errors.last().unwrap().remedy.contains("MTU"), "{errors:?}");
}

#[test]
fn an_unplugged_camera_is_lost_and_comes_back() {
    if !alone("an_unplugged_camera_is_lost_and_comes_back") {
        return;
    }
    let simulator = Simulator::start(&[]);
    let mut camera = open(&settings()).unwrap();
    let last = next(camera.as_mut()).unwrap().stamp;
    drop(simulator);
    let begun = SystemClock.now();
    let error = (0..20).find_map(|_| next(camera.as_mut()).err()).unwrap();
    println!("after {:?}: {error}", SystemClock.now() - begun);
    assert!(error.class == Class::Lost && error.got.contains("does not answer"), "{error}");
    let error = run(camera.configure(MS, 1.0)).unwrap_err();
    println!("{error}");
    assert_eq!(error.class, Class::Lost);
    drop(camera);
    let error = open(&settings()).err().unwrap();
    println!("{error}");
    assert!(error.class == Class::Setup && error.got.contains("nor from any other camera"), "{error}");
    println!("noticed, closed and looked for in {:?}", SystemClock.now() - begun);
    let _simulator = Simulator::start(&[]);
    let other = Settings { device: "Aravis-Fake-N2".into(), ..settings() };
    let error = open(&other).err().unwrap();
    assert!(error.got.contains("but from Aravis-Fake-N1 (127.0.0.1)"), "{error}");
    let again = next(open(&settings()).unwrap().as_mut()).unwrap().stamp;
    assert!(again.sequence > last.sequence && again.timestamp > last.timestamp);
}

#[test]
fn a_camera_in_use_says_so() {
    if !alone("a_camera_in_use_says_so") {
        return;
    }
    let _simulator = Simulator::start(&[]);
    assert_eq!(gvcp::control(Ipv4Addr::LOCALHOST), Control::Free);
    let mut first = open(&settings()).unwrap();
    next(first.as_mut()).unwrap();
    assert_eq!(gvcp::control(Ipv4Addr::LOCALHOST), Control::Taken);
    let error = open(&settings()).err().unwrap();
    println!("{error}");
    assert!(error.class == Class::Setup && error.got.contains("another program controls"), "{error}");
    next(first.as_mut()).unwrap();
    drop(first);
    next(open(&settings()).unwrap().as_mut()).unwrap();
}

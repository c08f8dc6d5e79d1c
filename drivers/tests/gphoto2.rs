//! The gphoto2 driver with the virtual camera of libgphoto2 (`tests/gphoto2/build`): the library's own driver for Nikon
//! cameras, and PTP commands.
//!
//! Each test runs in its own process, since the virtual camera keeps its state there. The tests are skipped without it.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests")]

use nacre_drivers::camera::gphoto2::{self, Format, Settings, library};
use nacre_drivers::camera::photograph::{Channel, Photograph, PhotographReader, Photography, Shot};
use nacre_drivers::discovery::{Root, discover};
use nacre_drivers::{Camera, Class, Clock, DeviceError, DeviceResult, Freshness, Prompt, SystemClock};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

/// Marks the process that uses the virtual camera.
const INSIDE: &str = "NACRE_TEST_GPHOTO2";
const ANY: Freshness = Freshness { steady_since: Duration::ZERO, first_sequence: 0, duration: Duration::ZERO };

/// Content of the photograph in the camera.
fn content() -> Vec<u8> {
    (0..100_000u32).map(|k| (k.wrapping_mul(k) % 251) as u8).collect()
}

/// Runs a test with the virtual camera; returns whether this process has it.
fn alone(test: &str, variables: &[(&str, &str)]) -> bool {
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
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("A.JPG"), content()).unwrap();
    let mut command = Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", test, "--nocapture"]).env(INSIDE, "1").current_dir(camera.path());
    command.env("LD_LIBRARY_PATH", &lib).env("CAMLIBS", lib.join("camlibs")).env("IOLIBS", lib.join("iolibs"));
    command.env("VCAMERA_DIR", camera.path()).envs(variables.iter().copied());
    assert!(command.status().unwrap().success(), "see above");
    false
}

/// Takes every byte for a pixel of one row.
struct Bytes;

impl PhotographReader for Bytes {
    fn kind(&self, _: &str) -> Option<bool> {
        Some(false)
    }

    fn shot(&self, _: &Path) -> Result<Shot, String> {
        Ok(Shot::default())
    }

    fn read(&self, _: &Path, _: Channel) -> Result<Photograph, String> {
        Err("no files".into())
    }

    fn read_bytes(&self, name: &str, bytes: &[u8], _: Channel) -> Result<Photograph, String> {
        assert!(name.starts_with("GPH_") && name.ends_with(".JPG"), "{name}");
        let codes: Vec<u16> = bytes.iter().map(|b| u16::from(*b)).collect();
        Ok(Photograph { shot: Shot::default(), width: codes.len(), height: 1, codes, black: 0, white: 255 })
    }
}

struct Nobody;

impl Prompt for Nobody {
    fn ask(&mut self, request: &str) -> std::io::Result<()> {
        Err(std::io::Error::other(request.to_owned()))
    }
}

fn open(settings: &Settings) -> DeviceResult<Box<dyn Camera>> {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    let program = Photography { reader: Arc::new(Bytes), prompt: Arc::new(|| Box::new(Nobody) as Box<dyn Prompt>) };
    gphoto2::open(settings, &clock, &program)
}

fn refused(settings: &Settings) -> DeviceError {
    open(settings).err().unwrap()
}

fn jpeg() -> Settings {
    Settings { format: Format::Jpeg, ..Settings::default() }
}

fn run<T>(future: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().build().unwrap().block_on(future)
}

#[test]
fn settings_are_set_and_read_back_and_photographs_are_fetched() {
    if !alone("settings_are_set_and_read_back_and_photographs_are_fetched", &[]) {
        return;
    }
    let device = Some("Nikon DSC D750".to_owned());
    let settings = Settings { device, aperture: Some(8.0), serial: Some("0.1".into()), ..jpeg() };
    let mut camera = open(&settings).unwrap();
    let info = camera.describe();
    assert_eq!(info.id, "gphoto2 Nikon DSC D750 s/n 0.1");
    assert_eq!((info.width, info.height, info.gain), (content().len(), 1, [1.0, 1.0]));
    let mut choices = info.exposure_choices_s.clone();
    choices.sort_by(f64::total_cmp);
    assert_eq!(choices, [0.0001, 0.0012, 0.0025, 0.005, 0.01, 0.02, 0.05, 0.1, 1.0]);
    for seconds in choices {
        let controls = run(camera.configure(Duration::from_secs_f64(seconds), 1.0)).unwrap();
        assert!((controls.exposure.as_secs_f64() - seconds).abs() < 1e-9);
    }
    let refused = run(camera.configure(Duration::from_millis(30), 1.0)).unwrap_err();
    assert!(refused.class == Class::Setup && refused.got.contains("1/50 s (20 ms) and 1/20 s (50 ms)"), "{refused}");
    let mut last = None;
    for ms in [10, 20, 5] {
        let controls = run(camera.configure(Duration::from_millis(ms), 1.0)).unwrap();
        let stale = run(camera.next_frame(Freshness::NEVER)).unwrap().stamp;
        let first_sequence = Freshness::first_with_controls(stale, controls.set_at, 0).unwrap();
        let fresh = Freshness { steady_since: controls.set_at, first_sequence, duration: controls.exposure };
        let frame = run(camera.next_frame(fresh)).unwrap();
        assert!(fresh.accepts(frame.stamp) && last < Some(frame.stamp.sequence));
        last = Some(frame.stamp.sequence);
        assert!(frame.codes.iter().zip(content()).all(|(code, byte)| *code == u16::from(byte)));
    }
}

#[test]
fn cameras_that_do_not_fit_are_refused_with_those_that_exist() {
    if !alone("cameras_that_do_not_fit_are_refused_with_those_that_exist", &[]) {
        return;
    }
    let there = "Nikon DSC D750 (usb:001,001)";
    let error = refused(&Settings { device: Some("Canon EOS 5D".into()), ..jpeg() });
    assert!(error.got.contains("no Canon EOS 5D") && error.got.contains(there), "{error}");
    let error = refused(&Settings { serial: Some("4711".into()), ..jpeg() });
    assert!(error.got.contains("4711") && error.got.contains(there), "{error}");
    let error = refused(&Settings { aperture: Some(2.0), ..jpeg() });
    assert!(error.got.contains("f/2.8") && error.got.contains("f/22"), "{error}");
    // This camera does not state its format.
    let error = refused(&Settings::default());
    assert!(&*error.expected == "raw files" && &*error.got == "JPEG files", "{error}");
    assert!(open(&Settings { device: Some("usb:001,001".into()), ..jpeg() }).is_ok());
    let found = discover(&Root::default());
    let camera = found.iter().find(|f| f.what.contains("digital camera Nikon DSC D750")).unwrap();
    assert_eq!(camera.setting.as_deref(), Some("{ kind = \"gphoto2\", device = \"Nikon DSC D750\" }"));
    assert_eq!(library::cameras().len(), 1);
}

#[test]
fn a_full_card_is_named() {
    if !alone("a_full_card_is_named", &[]) {
        return;
    }
    let mut camera = open(&jpeg()).unwrap();
    run(camera.configure(Duration::from_micros(100), 1.0)).unwrap();
    let error = (0..60).find_map(|_| run(camera.next_frame(ANY)).err()).unwrap();
    println!("{error}");
    assert!(error.class == Class::Stop && error.got.contains("ran full"), "{error}");
    assert!(error.remedy.contains("memory card is full"), "{error}");
}

#[test]
fn an_empty_battery_is_named_before_a_session() {
    if !alone("an_empty_battery_is_named_before_a_session", &[("VCAMERA_BATTERY", "3")]) {
        return;
    }
    let error = refused(&jpeg());
    assert!(error.got.contains("3%") && error.remedy.contains("charge the battery"), "{error}");
}

#[test]
fn a_low_battery_is_a_warning() {
    if !alone("a_low_battery_is_a_warning", &[("VCAMERA_BATTERY", "20")]) {
        return;
    }
    let warnings = open(&jpeg()).unwrap().describe().warnings;
    assert!(warnings.iter().any(|w| w.contains("battery is at 20%")), "{warnings:?}");
}

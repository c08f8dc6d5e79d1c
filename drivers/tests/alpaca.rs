//! The Alpaca drivers with an independent server (tests/alpaca, on the crate ascom-alpaca), in a private network.
//! Skipped without the server, which tests/run builds, and where private networks cannot be made.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests")]

#[path = "servers/mod.rs"]
mod servers;

use nacre_drivers::alpaca::{self, discovery};
use nacre_drivers::camera::commanded::GainUnit;
use nacre_drivers::discovery::{Kind, Root, discover_servers};
use nacre_drivers::flash::{FlashConfig, FlashDriver};
use nacre_drivers::stage::{Mounting, StageConfig, StageDriver};
use nacre_drivers::{Camera, Class, Clock, DeviceResult, Flash, Frame, Freshness, Stage, SystemClock};
use servers::{Server, alone, run};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

const ADDRESS: &str = "127.0.0.1:11111";
const MS: Duration = Duration::from_millis(1);
/// Far more than any step takes on a busy machine.
const NEVER: Duration = Duration::from_secs(60);

fn server() -> PathBuf {
    let built = || PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../target/alpaca-tools/debug/alpaca-server");
    std::env::var_os("NACRE_ALPACA_SERVER").map_or_else(built, PathBuf::from)
}

fn start() -> Server {
    Server::start(&[server().to_str().unwrap(), ADDRESS, "t"], || !discovery::found_at(ADDRESS).is_empty())
}

fn clock() -> Arc<dyn Clock> {
    Arc::new(SystemClock)
}

fn stage() -> DeviceResult<Box<dyn Stage>> {
    let driver = StageDriver::Alpaca(toml(&format!("address = \"{ADDRESS}\"\nmotion = {{ settling_ms = 0 }}")));
    StageConfig { driver, mounting: Mounting::default() }.open(&clock()).unwrap()
}

fn toml<T: serde::de::DeserializeOwned>(text: &str) -> T {
    servers::settings(text)
}

fn camera(more: &str) -> DeviceResult<Box<dyn Camera>> {
    alpaca::camera::open(&toml(&format!("address = \"{ADDRESS}\"\n{more}")), &clock())
}

fn flash(more: &str) -> DeviceResult<Box<dyn Flash>> {
    let driver = FlashDriver::Alpaca(toml(&format!("address = \"{ADDRESS}\"\n{more}")));
    FlashConfig { driver, settling_ms: 1.0, max_on_s: 10.0 }.open(&clock()).unwrap()
}

fn fresh() -> Freshness {
    Freshness { steady_since: SystemClock.now(), first_sequence: 0, duration: MS * 10 }
}

fn next(camera: &mut dyn Camera) -> DeviceResult<Frame> {
    let fresh = fresh();
    let frame = run(camera.next_frame(fresh))?;
    assert!(fresh.accepts(frame.stamp), "{:?} for {fresh:?}", frame.stamp);
    Ok(frame)
}

/// Code of the server's camera; see tests/alpaca/src/main.rs.
fn code(x: usize, y: usize, angle_deg: f64, lamp: bool) -> f64 {
    let malus = (1.0 + 0.5 * (2.0 * (angle_deg - 30.0)).to_radians().cos()) / 1.5;
    200.0 + (20 * x + 300 * y) as f64 * malus * if lamp { 2.0 } else { 1.0 }
}

#[test]
fn a_rotator_turns_to_mechanical_angles() {
    if !alone("a_rotator_turns_to_mechanical_angles", server()) {
        return;
    }
    let _server = start();
    let mut stage = stage().unwrap();
    let info = stage.describe();
    println!("{info:?}");
    assert_eq!(info.id, "alpaca Test rotator id Turner-t");
    assert!(info.halts && info.limits_deg == [0.0, 360.0]);
    run(stage.home()).unwrap();
    for angle in [45.0, 0.0, 359.5, 360.0, 12.345] {
        let begun = Instant::now();
        let arrived = run(stage.move_to(angle)).unwrap();
        assert!((arrived.angle_deg - angle).abs() < 1e-3, "{arrived:?}");
        assert!((run(stage.position()).unwrap() - angle).abs() < 1e-3);
        println!("{angle}° after {:?}", begun.elapsed());
    }
    for beyond in [-1.0, 361.0] {
        assert_eq!(run(stage.move_to(beyond)).unwrap_err().class, Class::Setup);
    }
    // A movement that is dropped half-way stops.
    run(stage.move_to(0.0)).unwrap();
    let dropped = run(async { tokio::time::timeout(MS * 200, stage.move_to(300.0)).await });
    assert!(dropped.is_err());
    run(stage.halt()).unwrap();
    let at = run(stage.position()).unwrap();
    println!("stopped at {at}°");
    assert!(at > 0.0 && at < 299.0);
    run(stage.move_to(at + 1.0)).unwrap();
}

#[test]
fn pictures_have_the_announced_axes_and_time() {
    if !alone("pictures_have_the_announced_axes_and_time", server()) {
        return;
    }
    let _server = start();
    let mut camera = camera("region = [10, 20, 40, 30]").unwrap();
    let info = camera.describe();
    println!("{info:?}");
    assert_eq!(info.id, "alpaca Test camera id Eye-t");
    assert_eq!((info.width, info.height, info.white, info.gain), (40, 30, 65_535, [1.0, 1.0]));
    assert_eq!((info.exposure_s, info.shutter, info.control_lag_frames), ([0.001, 60.0], true, 0));
    assert!(info.warnings[0].contains("cooler") && info.warnings[0].contains("21.5"), "{:?}", info.warnings);
    let controls = run(camera.configure(MS * 10, 1.0)).unwrap();
    assert_eq!((controls.exposure, controls.gain), (MS * 10, 1.0));
    let mut sequence = 0;
    for _ in 0..3 {
        let frame = next(camera.as_mut()).unwrap();
        assert!(frame.stamp.sequence > sequence && !frame.damaged);
        sequence = frame.stamp.sequence;
        for y in 0..30 {
            for x in 0..40 {
                let expected = code(10 + x, 20 + y, 0.0, false);
                assert!((f64::from(frame.codes[40 * y + x]) - expected).abs() < 0.6, "{x}, {y}");
            }
        }
    }
    let since = run(camera.cover(true)).unwrap();
    assert!(since <= SystemClock.now());
    assert!(next(camera.as_mut()).unwrap().codes.iter().all(|code| *code == 200));
    run(camera.cover(false)).unwrap();
    assert!(next(camera.as_mut()).unwrap().codes[0] > 200);
    // No picture is taken for a frame that cannot be fresh, so that a change of the exposure costs none.
    run(camera.configure(MS * 40_000, 1.0)).unwrap();
    let begun = Instant::now();
    let frame = run(camera.next_frame(Freshness::NEVER)).unwrap();
    assert!(frame.codes.is_empty() && begun.elapsed() < MS * 30_000);
}

#[test]
fn gain_and_region_are_checked() {
    if !alone("gain_and_region_are_checked", server()) {
        return;
    }
    let _server = start();
    let mut tenths = camera("gain = \"tenth_decibel\"").unwrap();
    assert_eq!((tenths.describe().width, tenths.describe().height), (320, 200));
    let [low, high] = tenths.describe().gain;
    assert!(low == 1.0 && (high - GainUnit::TenthDecibel.linear(400.0, 0.0)).abs() < 1e-9, "{high}");
    let gain = run(tenths.configure(MS, 10.0)).unwrap().gain;
    assert!((gain - 10.0).abs() < 1e-9, "{gain}");
    drop(tenths);
    let error = camera("region = [300, 0, 40, 30]").err().unwrap();
    assert!(error.class == Class::Setup && error.expected.contains("320 × 200"), "{error}");
    let error = camera("readout_mode = \"Fast\"").err().unwrap();
    assert!(error.class == Class::Setup && error.got.contains("Standard"), "{error}");
    // The mode exists, but the server cannot set it.
    let error = camera("readout_mode = \"Standard\"").err().unwrap();
    assert!(error.class == Class::Setup && error.command.contains("readout mode"), "{error}");
    let error = camera("camera = 4").err().unwrap();
    println!("{error}");
    assert!(error.class == Class::Setup && error.remedy.contains("camera 4"), "{error}");
    let error = camera("offset = 12").err().unwrap();
    println!("{error}");
    assert!(error.class == Class::Setup && error.command.contains("offset"), "{error}");
}

#[test]
fn a_switch_is_read_back_and_off_at_the_end() {
    if !alone("a_switch_is_read_back_and_off_at_the_end", server()) {
        return;
    }
    let _server = start();
    let mut camera = camera("region = [0, 0, 8, 8]").unwrap();
    run(camera.configure(MS * 10, 1.0)).unwrap();
    let mut corner = || f64::from(next(camera.as_mut()).unwrap().codes[63]);
    let [dark, lit] = [false, true].map(|lamp| code(7, 7, 0.0, lamp));
    let mut lamp = flash("id = 1\nvalue = 60.0").unwrap();
    assert_eq!(lamp.describe().id, "alpaca Test switches id Board-t switch 1");
    assert!((corner() - dark).abs() < 0.6);
    assert!(run(lamp.switch(true)).unwrap().on && run(lamp.is_on()).unwrap());
    assert!((corner() - lit).abs() < 0.6);
    assert!(!run(lamp.switch(false)).unwrap().on && !run(lamp.is_on()).unwrap());
    assert!((corner() - dark).abs() < 0.6);
    run(lamp.switch(true)).unwrap();
    drop(lamp);
    assert!((corner() - dark).abs() < 0.6, "it stays on");
    for (settings, word) in [("id = 2", "read-only"), ("id = 3", "switches 0 to 2"), ("id = 1\nvalue = 101.0", "101")] {
        let error = flash(settings).err().unwrap();
        assert!(error.class == Class::Setup && error.got.contains(word), "{error}");
    }
}

#[test]
fn a_lost_server_is_named_and_comes_back() {
    if !alone("a_lost_server_is_named_and_comes_back", server()) {
        return;
    }
    let server = start();
    let (mut rotator, mut eye, mut lamp) = (stage().unwrap(), camera("").unwrap(), flash("").unwrap());
    run(rotator.move_to(20.0)).unwrap();
    let last = next(eye.as_mut()).unwrap().stamp;
    run(lamp.switch(true)).unwrap();
    drop(server);
    let begun = Instant::now();
    let errors = [
        run(rotator.move_to(30.0)).unwrap_err(),
        next(eye.as_mut()).unwrap_err(),
        run(lamp.switch(false)).unwrap_err(),
        run(rotator.position()).unwrap_err(),
    ];
    for error in errors {
        println!("{error}");
        assert!(error.class == Class::Lost && error.got.contains(ADDRESS), "{error}");
    }
    drop((rotator, eye, lamp));
    let error = stage().err().unwrap();
    println!("{error}\nafter {:?}", begun.elapsed());
    assert!(error.class == Class::Setup && error.got.contains(ADDRESS) && begun.elapsed() < NEVER, "{error}");
    let _server = start();
    run(stage().unwrap().move_to(30.0)).unwrap();
    let again = next(camera("").unwrap().as_mut()).unwrap().stamp;
    assert!(again.sequence > last.sequence && again.timestamp > last.timestamp);
    assert!(!run(flash("").unwrap().is_on()).unwrap());
}

#[test]
fn servers_are_found_on_the_network() {
    if !alone("servers_are_found_on_the_network", server()) {
        return;
    }
    assert!(discover_servers(&Root::default()).is_empty());
    let _server = start();
    let begun = Instant::now();
    let found = discover_servers(&Root::default());
    println!("{:?}: {found:#?}", begun.elapsed());
    let setting = |kind: Kind| found.iter().find(|f| f.kind == kind).unwrap().setting.clone().unwrap();
    assert_eq!(setting(Kind::Stage), format!("{{ kind = \"alpaca\", address = \"{ADDRESS}\", rotator = 0 }}"));
    assert_eq!(setting(Kind::Camera), format!("{{ kind = \"alpaca\", address = \"{ADDRESS}\", camera = 0 }}"));
    assert!(found.iter().all(|f| f.sure == (f.kind != Kind::Flash)));
    assert_eq!(alpaca::PORT, 11_111);
}

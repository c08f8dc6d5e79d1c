//! The INDI drivers with INDI's own server and simulators (Debian: indi-bin), in a private network. Skipped without
//! them, and where private networks cannot be made.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests")]

#[path = "servers/mod.rs"]
mod servers;

use nacre_drivers::discovery::{Kind, Root, discover_servers};
use nacre_drivers::flash::{FlashConfig, FlashDriver};
use nacre_drivers::indi::{self, discovery};
use nacre_drivers::stage::{Mounting, StageConfig, StageDriver};
use nacre_drivers::{Camera, Class, Clock, DeviceResult, Flash, Frame, Freshness, Stage, SystemClock};
use servers::{Server, alone, run, settings};
use std::sync::Arc;
use std::time::{Duration, Instant};

const SERVER: &str = "indiserver";
const ADDRESS: &str = "localhost:7624";
const MS: Duration = Duration::from_millis(1);
/// Far more than any step takes on a busy machine.
const NEVER: Duration = Duration::from_secs(60);

fn start() -> Server {
    let simulators =
        ["indi_simulator_ccd", "indi_simulator_rotator", "indi_simulator_lightpanel", "indi_simulator_telescope"];
    let command: Vec<&str> = [SERVER].into_iter().chain(simulators).collect();
    Server::start(&command, || discovery::found_at(ADDRESS).len() == 3)
}

fn clock() -> Arc<dyn Clock> {
    Arc::new(SystemClock)
}

fn stage(more: &str) -> DeviceResult<Box<dyn Stage>> {
    let text = format!("device = \"Rotator Simulator\"\nmotion = {{ settling_ms = 0 }}\n{more}");
    let config = StageConfig { driver: StageDriver::Indi(settings(&text)), mounting: Mounting::default() };
    config.open(&clock()).unwrap()
}

fn camera(more: &str) -> DeviceResult<Box<dyn Camera>> {
    let text = format!("device = \"CCD Simulator\"\n{more}");
    indi::camera::open(&settings(&text), &clock())
}

fn flash(more: &str) -> DeviceResult<Box<dyn Flash>> {
    let text = format!("device = \"Light Panel Simulator\"\n{more}");
    FlashConfig { driver: FlashDriver::Indi(settings(&text)), settling_ms: 1.0, max_on_s: 10.0 }.open(&clock()).unwrap()
}

fn next(camera: &mut dyn Camera, exposure: Duration) -> DeviceResult<Frame> {
    let fresh = Freshness { steady_since: SystemClock.now(), first_sequence: 0, duration: exposure };
    let frame = run(camera.next_frame(fresh))?;
    assert!(fresh.accepts(frame.stamp), "{:?} for {fresh:?}", frame.stamp);
    Ok(frame)
}

/// A property as INDI's own client reads it.
fn property(name: &str) -> String {
    let read = std::process::Command::new("indi_getprop").args(["-1", name]).output().unwrap();
    String::from_utf8(read.stdout).unwrap().trim().to_owned()
}

/// Sets a property with INDI's own client, which does not wait for the device: this does.
fn set_until(name: &str, value: &str, taken: impl Fn(&str) -> bool) {
    let new = format!("{name}={value}");
    assert!(std::process::Command::new("indi_setprop").arg(new).status().unwrap().success());
    let begun = Instant::now();
    while !taken(&property(name)) {
        assert!(begun.elapsed() < NEVER, "{name} stays {}", property(name));
    }
}

/// Switches an element on.
fn switch_on(name: &str) {
    set_until(name, "On", |now| now == "On");
}

#[test]
fn a_rotator_turns_and_stops() {
    if !alone("a_rotator_turns_and_stops", SERVER) {
        return;
    }
    let _server = start();
    // The sense is that of the configuration.
    drop(stage("").unwrap());
    switch_on("Rotator Simulator.ROTATOR_REVERSE.INDI_ENABLED");
    let mut stage = stage("").unwrap();
    assert_eq!(property("Rotator Simulator.ROTATOR_REVERSE.INDI_ENABLED"), "Off");
    let info = stage.describe();
    println!("{info:?}");
    assert_eq!(info.id, "indi Rotator Simulator (indi_simulator_rotator) at localhost");
    assert!(info.halts);
    for angle in [20.0, 7.5, 0.0] {
        let begun = Instant::now();
        let arrived = run(stage.move_to(angle)).unwrap();
        assert!((arrived.angle_deg - angle).abs() < 0.1, "{arrived:?}");
        let told: f64 = property("Rotator Simulator.ABS_ROTATOR_ANGLE.ANGLE").parse().unwrap();
        println!("{angle}° after {:?}: {told}", begun.elapsed());
        assert!((told - angle).abs() < 0.1);
    }
    let dropped = run(async { tokio::time::timeout(MS * 1500, stage.move_to(120.0)).await });
    assert!(dropped.is_err());
    run(stage.halt()).unwrap();
    let at = run(stage.position()).unwrap();
    println!("stopped at {at}°");
    assert!(at > 0.0 && at < 119.0);
    // Another program turns it.
    let moved = |now: &str| now.parse::<f64>().is_ok_and(|angle| (angle - at).abs() > 0.5);
    set_until("Rotator Simulator.ABS_ROTATOR_ANGLE.ANGLE", &format!("{}", at + 20.0), moved);
    let begun = Instant::now();
    let error = loop {
        match run(stage.position()) {
            Err(error) => break error,
            Ok(_) => assert!(begun.elapsed() < NEVER, "the move is not noticed"),
        }
    };
    println!("{error}");
    assert!(error.class == Class::Stop && error.got.contains("another program"), "{error}");
}

#[test]
fn pictures_are_raw_and_fresh() {
    if !alone("pictures_are_raw_and_fresh", SERVER) {
        return;
    }
    let _server = start();
    let mut whole = camera("").unwrap();
    let info = whole.describe();
    println!("{info:?}");
    assert_eq!(info.id, "indi CCD Simulator (indi_simulator_ccd) at localhost");
    assert_eq!((info.width, info.height, info.white, info.gain), (1280, 1024, 65_535, [1.0, 1.0]));
    assert!(!info.shutter && (info.exposure_s[0] - 0.01).abs() < 1e-9 && info.exposure_s[1] == 3600.0);
    let exposure = MS * 50;
    let controls = run(whole.configure(exposure, 1.0)).unwrap();
    assert_eq!((controls.exposure, controls.gain), (exposure, 1.0));
    let frame = next(whole.as_mut(), exposure).unwrap();
    assert_eq!((frame.width, frame.height, frame.codes.len()), (1280, 1024, 1280 * 1024));
    drop(whole);
    let mut part = camera("region = [100, 200, 64, 48]\nshutter = true\ngain = \"tenth_decibel\"").unwrap();
    assert_eq!(property("CCD Simulator.CCD_FRAME.X"), "100");
    let mean = |frame: &Frame| frame.codes.iter().map(|c| f64::from(*c)).sum::<f64>() / frame.codes.len() as f64;
    let mut sequence = frame.stamp.sequence;
    run(part.configure(exposure, 1.0)).unwrap();
    for _ in 0..3 {
        let frame = next(part.as_mut(), exposure).unwrap();
        assert_eq!((frame.width, frame.height), (64, 48));
        assert!(frame.stamp.sequence > sequence);
        sequence = frame.stamp.sequence;
        // The simulator adds noise to its bias.
        println!("mean {:.1}, {:?}", mean(&frame), &frame.codes[..6]);
        assert!(frame.codes.iter().max() > frame.codes.iter().min());
    }
    run(part.cover(true)).unwrap();
    next(part.as_mut(), exposure).unwrap();
    assert_eq!(property("CCD Simulator.CCD_FRAME_TYPE.FRAME_DARK"), "On");
    run(part.cover(false)).unwrap();
    next(part.as_mut(), exposure).unwrap();
    assert_eq!(property("CCD Simulator.CCD_FRAME_TYPE.FRAME_LIGHT"), "On");
    let error = camera("region = [1270, 0, 64, 48]").err().unwrap();
    assert!(error.class == Class::Setup && error.expected.contains("1280 × 1024"), "{error}");
}

#[test]
fn an_exposure_of_another_program_does_not_pass() {
    if !alone("an_exposure_of_another_program_does_not_pass", SERVER) {
        return;
    }
    let _server = start();
    let mut camera = camera("region = [0, 0, 64, 48]").unwrap();
    let exposure = MS * 300;
    run(camera.configure(exposure, 1.0)).unwrap();
    let runs = |now: &str| now.parse::<f64>().is_ok_and(|left| left > 2.0);
    set_until("CCD Simulator.CCD_EXPOSURE.CCD_EXPOSURE_VALUE", "20", runs);
    let begun = Instant::now();
    // The first frame ends the exposure that is running.
    next(camera.as_mut(), exposure).unwrap();
    println!("after {:?}", begun.elapsed());
    assert!(begun.elapsed() >= exposure * 9 / 10);
}

#[test]
fn pictures_may_be_compressed_by_the_server() {
    if !alone("pictures_may_be_compressed_by_the_server", SERVER) {
        return;
    }
    let _server = start();
    let mut camera = camera("region = [0, 0, 64, 48]").unwrap();
    run(camera.configure(MS * 20, 1.0)).unwrap();
    // Another program switches compression on after this one switched it off.
    switch_on("CCD Simulator.CCD_COMPRESSION.INDI_ENABLED");
    match next(camera.as_mut(), MS * 20) {
        Ok(frame) => assert_eq!(frame.codes.len(), 64 * 48),
        // Newer servers use fpack.
        Err(error) => {
            assert!(error.got.contains(".fits.fz") && error.remedy.contains("without compression"), "{error}")
        }
    }
}

#[test]
fn a_light_box_is_read_back_and_off_at_the_end() {
    if !alone("a_light_box_is_read_back_and_off_at_the_end", SERVER) {
        return;
    }
    let _server = start();
    let lit = || property("Light Panel Simulator.FLAT_LIGHT_CONTROL.FLAT_LIGHT_ON");
    let mut lamp = flash("brightness = 200.0").unwrap();
    println!("{:?}", lamp.describe());
    assert_eq!(lit(), "Off");
    assert!(run(lamp.switch(true)).unwrap().on && run(lamp.is_on()).unwrap());
    assert_eq!(lit(), "On");
    assert_eq!(property("Light Panel Simulator.FLAT_LIGHT_INTENSITY.FLAT_LIGHT_INTENSITY_VALUE"), "200");
    assert!(!run(lamp.switch(false)).unwrap().on && !run(lamp.is_on()).unwrap());
    assert_eq!(lit(), "Off");
    // Another program switches it.
    switch_on("Light Panel Simulator.FLAT_LIGHT_CONTROL.FLAT_LIGHT_ON");
    let error = run(lamp.is_on()).unwrap_err();
    assert!(error.class == Class::Stop && error.got.contains("on"), "{error}");
    drop(lamp);
    assert_eq!(lit(), "Off");
    for (settings, word) in [
        ("on = \"FLAT\"", "FLAT_LIGHT_OFF, FLAT_LIGHT_ON"),
        ("brightness = 1000.0", "1000"),
        ("property = \"RELAY\"", "none"),
    ] {
        let error = flash(settings).err().unwrap();
        println!("{error}");
        assert!(error.class == Class::Setup && error.got.contains(word), "{error}");
    }
}

#[test]
fn a_lost_server_is_named_and_comes_back() {
    if !alone("a_lost_server_is_named_and_comes_back", SERVER) {
        return;
    }
    let server = start();
    let (mut rotator, mut eye, mut lamp) =
        (stage("").unwrap(), camera("region = [0, 0, 64, 48]").unwrap(), flash("").unwrap());
    let exposure = MS * 100;
    run(eye.configure(exposure, 1.0)).unwrap();
    let last = next(eye.as_mut(), exposure).unwrap().stamp;
    run(lamp.switch(true)).unwrap();
    drop(server);
    let begun = Instant::now();
    let errors = [
        run(rotator.move_to(30.0)).unwrap_err(),
        next(eye.as_mut(), exposure).unwrap_err(),
        run(lamp.switch(false)).unwrap_err(),
        run(rotator.position()).unwrap_err(),
    ];
    for error in errors {
        println!("{error}");
        assert!(error.class == Class::Lost && error.remedy.contains("localhost"), "{error}");
    }
    drop((rotator, eye, lamp));
    let error = stage("").err().unwrap();
    println!("{error}\nafter {:?}", begun.elapsed());
    assert!(error.class == Class::Setup && error.got.contains("localhost") && begun.elapsed() < NEVER, "{error}");
    let _server = start();
    run(stage("").unwrap().move_to(10.0)).unwrap();
    let mut eye = camera("region = [0, 0, 64, 48]").unwrap();
    run(eye.configure(exposure, 1.0)).unwrap();
    let again = next(eye.as_mut(), exposure).unwrap().stamp;
    assert!(again.sequence > last.sequence && again.timestamp > last.timestamp);
    assert!(!run(flash("").unwrap().is_on()).unwrap());
}

#[test]
fn devices_are_found_and_missing_ones_named() {
    if !alone("devices_are_found_and_missing_ones_named", SERVER) {
        return;
    }
    let _server = start();
    let begun = Instant::now();
    let found = discover_servers(&Root::default());
    println!("{:?}: {found:#?}", begun.elapsed());
    let kinds: Vec<Kind> = found.iter().map(|f| f.kind).collect();
    assert_eq!(kinds, [Kind::Camera, Kind::Flash, Kind::Stage]);
    let line = "{ kind = \"indi\", address = \"localhost:7624\", device = \"Rotator Simulator\" }";
    assert_eq!(found[2].setting.as_deref(), Some(line));
    let text = "device = \"Rotator\"\nanswer_ms = 500";
    let error = indi::camera::open(&settings(text), &clock()).err().unwrap();
    println!("{error}");
    assert!(error.class == Class::Setup && error.got.contains("Light Panel Simulator, Rotator Simulator"), "{error}");
    // A device of another kind lacks the properties.
    let text = "device = \"Light Panel Simulator\"";
    let error = indi::camera::open(&settings(text), &clock()).err().unwrap();
    assert!(error.class == Class::Setup && error.expected.contains("CCD_EXPOSURE"), "{error}");
}

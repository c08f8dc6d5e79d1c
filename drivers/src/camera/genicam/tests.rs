//! Tests of the driver on a fake camera with common defects.

use super::fake::{FakeNode, Fault};
use super::node::Status;
use super::{GainUnit, GenicamCamera, Settings, Trigger};
use crate::camera::v4l2::tests::run;
use crate::{Camera, Class, Clock, DeviceResult, Frame, Freshness};
use std::sync::Arc;
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);
const ANY: Freshness = Freshness { steady_since: Duration::ZERO, first_sequence: 0, duration: Duration::ZERO };

fn open_with(node: &FakeNode, settings: Settings) -> DeviceResult<GenicamCamera> {
    GenicamCamera::open(Box::new(node.clone()), settings, Arc::new(node.clock.clone()))
}

fn settings() -> Settings {
    Settings::new("fake")
}

fn open(node: &FakeNode) -> GenicamCamera {
    open_with(node, settings()).unwrap()
}

fn next(camera: &mut GenicamCamera) -> DeviceResult<Frame> {
    run(camera.next_frame(ANY))
}

#[test]
fn the_best_format_is_chosen_and_values_are_read_back() {
    let node = FakeNode::new();
    let mut camera = open(&node);
    let info = camera.describe();
    assert_eq!(info.id, "genicam Acme Fake s/n 7");
    assert_eq!((info.width, info.height, info.black, info.white), (8, 4, 0, 4095));
    assert_eq!((info.exposure_s, info.readout_s), ([1e-5, 10.0], 0.05));
    let controls = run(camera.configure(Duration::from_micros(12_345), 10.0)).unwrap();
    assert_eq!(controls.exposure, Duration::from_micros(12_340), "in steps of 10 µs");
    assert!((controls.gain - 10.0).abs() < 1e-9 && node.state().gain == 20.0);
    let frame = next(&mut camera).unwrap();
    assert_eq!(frame.codes, vec![0x123; 32]);
    assert!(!frame.damaged);
    let stale = run(camera.next_frame(Freshness::NEVER)).unwrap();
    assert!(stale.codes.is_empty() && stale.stamp.sequence == frame.stamp.sequence + 1);
}

#[test]
fn a_gain_of_unknown_unit_stays_at_its_lowest() {
    let node = FakeNode::new();
    node.state().decibel = false;
    let mut camera = open(&node);
    assert_eq!(camera.describe().gain, [1.0, 1.0]);
    assert_eq!(run(camera.configure(MS, 5.0)).unwrap().gain, 1.0);
    let mut camera = open_with(&node, Settings { gain: GainUnit::Factor, ..settings() }).unwrap();
    assert_eq!(run(camera.configure(MS, 5.0)).unwrap().gain, 5.0);
}

#[test]
fn lost_frames_leave_gaps_and_incomplete_ones_are_named() {
    let node = FakeNode::new();
    let mut camera = open(&node);
    let first = next(&mut camera).unwrap().stamp;
    node.state().faults.extend([Fault::Drop, Fault::Incomplete(Status::MissingPackets)]);
    assert_eq!(next(&mut camera).unwrap().stamp.sequence, first.sequence + 2);
    let error = next(&mut camera).unwrap_err();
    assert!(error.class == Class::Retry && error.got.contains("packets are missing (1 of 31"), "{error}");
    // A stale frame may be incomplete.
    node.state().faults.push_back(Fault::Incomplete(Status::Timeout));
    let stale = run(camera.next_frame(Freshness::NEVER)).unwrap();
    assert_eq!(stale.stamp.sequence, first.sequence + 5);
    node.state().faults.push_back(Fault::Short);
    let error = next(&mut camera).unwrap_err();
    assert!(error.class == Class::Retry && error.got.contains("24 of 48 bytes"), "{error}");
    node.state().faults.push_back(Fault::OtherFormat);
    assert_eq!(next(&mut camera).unwrap_err().class, Class::Stop);
    // The camera's 16-bit numbers have begun again with 1.
    assert_eq!(next(&mut camera).unwrap().stamp.sequence, first.sequence + 8);
}

#[test]
fn a_frame_that_waited_on_the_network_is_not_fresh() {
    let node = FakeNode::new();
    let mut camera = open(&node);
    let first = next(&mut camera).unwrap().stamp;
    assert_eq!(first.timestamp, node.clock.now());
    node.state().faults.push_back(Fault::Late(MS * 400));
    let late = next(&mut camera).unwrap().stamp;
    assert_eq!(late.timestamp, first.timestamp + MS * 50, "its time is not that of its arrival");
    assert_eq!(node.clock.now(), first.timestamp + MS * 450);
}

#[test]
fn a_software_trigger_starts_each_exposure() {
    let node = FakeNode::new();
    let mut camera = open_with(&node, Settings { trigger: Trigger::Software, ..settings() }).unwrap();
    run(camera.configure(MS * 30, 1.0)).unwrap();
    for n in 1..4 {
        let before = node.clock.now();
        let stamp = next(&mut camera).unwrap().stamp;
        assert_eq!(stamp.timestamp, before + MS * 30);
        let fresh = Freshness { steady_since: before, first_sequence: 0, duration: MS * 30 };
        assert!(fresh.accepts(stamp) && node.state().triggers == n);
    }
    // The camera still exposes as before: its frame is not accepted, and another one is triggered.
    node.state().exposure = MS * 10;
    node.state().faults.extend([Fault::Late(Duration::ZERO), Fault::Late(MS * 20)]);
    next(&mut camera).unwrap();
    assert_eq!(node.state().triggers, 5);
}

#[test]
fn a_camera_that_is_unplugged_is_lost_and_its_numbers_go_on() {
    let node = FakeNode::new();
    let mut camera = open(&node);
    let last = next(&mut camera).unwrap().stamp;
    node.state().gone = true;
    let before = node.clock.now();
    let error = next(&mut camera).unwrap_err();
    assert!(error.class == Class::Lost && error.got.contains("does not answer"), "{error}");
    assert!(node.clock.now() - before < MS * 2000, "within three frames and a second");
    assert_eq!(run(camera.configure(MS, 1.0)).unwrap_err().class, Class::Lost);
    assert_eq!(open_with(&node, settings()).err().unwrap().class, Class::Setup);
    drop(camera);
    node.state().gone = false;
    let again = next(&mut open(&node)).unwrap().stamp;
    assert!(again.sequence > last.sequence && again.timestamp > last.timestamp);
}

#[test]
fn a_camera_that_hangs_is_started_again() {
    let node = FakeNode::new();
    let mut camera = open(&node);
    node.state().faults.push_back(Fault::Silence(MS * 60_000));
    let error = next(&mut camera).unwrap_err();
    assert!(error.class == Class::Retry && error.got.contains("no packet"), "{error}");
    node.state().faults.clear();
    next(&mut camera).unwrap();
    assert_eq!(node.state().starts, 2);
}

#[test]
fn cameras_that_cannot_be_used_say_why() {
    let refusal = |change: &dyn Fn(&FakeNode), settings: Settings| {
        let node = FakeNode::new();
        change(&node);
        let error = open_with(&node, settings).err().unwrap();
        assert_eq!(error.class, Class::Setup, "{error}");
        error.to_string()
    };
    let same = |_: &FakeNode| {};
    assert!(refusal(&|n| n.state().formats = vec!["RGB8"], settings()).contains("only RGB8"));
    let other = Settings { format: Some("Mono16".into()), ..settings() };
    assert!(refusal(&same, other).contains("Mono16"));
    assert!(refusal(&|n| n.state().exposures = None, settings()).contains("manual exposure"));
    let region = Settings { region: Some([1, 1, 2, 2]), ..settings() };
    assert!(refusal(&|n| n.state().fixed_region = true, region).contains("[1, 1, 2, 2]"));
    assert!(refusal(&same, Settings { buffers: 0, ..settings() }).contains("buffers"));
    // A name without a standard value, whose bits per pixel disagree.
    assert!(refusal(&|n| n.state().formats = vec!["Polarized8"], settings()).contains("bits per pixel"));
    let black = Settings { black_level: Some(200.0), ..settings() };
    assert!(open_with(&FakeNode::new(), black).unwrap().describe().warnings[0].contains("black level is 100"));
}

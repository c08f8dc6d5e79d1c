//! Tests of the driver on a fake camera with common defects.

use super::controls::{EXPOSURE, GAIN, UNITLESS_EXPOSURE};
use super::fake::{BLACK, ENODEV, FakeNode, Fault, LIGHT, row_codes};
use super::formats::PixelFormat;
use super::{GainScale, Settings, Timestamps, V4l2Camera};
use crate::{Camera, Class, Clock, DeviceResult, Frame, Freshness};
use std::sync::Arc;
use std::time::Duration;

const MS: Duration = Duration::from_millis(1);
const ANY: Freshness = Freshness { steady_since: Duration::ZERO, first_sequence: 0, duration: Duration::ZERO };

fn open_with(node: &FakeNode, settings: Settings) -> DeviceResult<V4l2Camera> {
    let state = node.state.clone();
    let reset = Box::new(move || {
        state.lock().unwrap().resets += 1;
        Ok(())
    });
    V4l2Camera::open(Box::new(node.clone()), "v4l2 fake", settings, Arc::new(node.clock.clone()), reset)
}

fn settings() -> Settings {
    Settings::new("/dev/video0")
}

fn open(node: &FakeNode) -> V4l2Camera {
    open_with(node, settings()).unwrap()
}

pub fn run<T>(future: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().build().unwrap().block_on(future)
}

fn next(camera: &mut V4l2Camera) -> DeviceResult<Frame> {
    run(camera.next_frame(ANY))
}

#[test]
fn automatic_controls_go_first_and_manual_values_are_read_back() {
    let node = FakeNode::new();
    let mut camera = open(&node);
    let info = camera.describe();
    assert_eq!((info.width, info.height, info.black, info.white), (8, 4, 0, 255));
    // The control reaches 204.7 ms, but a frame lasts 100 ms.
    assert_eq!(info.exposure_s, [3e-4, 0.1]);
    assert_eq!(node.state().set, [(0x009a_0901, 1), (0x0098_0912, 0), (0x0098_0910, 100)]);
    let controls = run(camera.configure(Duration::from_micros(12_345), 1.0)).unwrap();
    assert_eq!((controls.exposure, controls.gain), (Duration::from_micros(12_300), 1.0), "in steps of 100 µs");
    assert_eq!((node.value(EXPOSURE), node.value(GAIN)), (123, 0));
    assert!(camera.describe().warnings.is_empty(), "{:?}", camera.describe().warnings);
}

#[test]
fn clamped_settings_are_reported() {
    let node = FakeNode::new();
    node.state().clamps.extend([(EXPOSURE, 50), (0x0098_0910, 90)]);
    let mut camera = open(&node);
    assert!(camera.describe().warnings[0].contains("gamma is 90"), "{:?}", camera.describe().warnings);
    assert_eq!(run(camera.configure(20 * MS, 1.0)).unwrap().exposure, 5 * MS);
}

#[test]
fn gain_is_linear_where_its_unit_is_known() {
    let node = FakeNode::new();
    let unity = Settings { gain: GainScale::Unity(16.0), ..settings() };
    let db = Settings { gain: GainScale::DbPerStep(0.1), ..settings() };
    let mut camera = open_with(&node, unity).unwrap();
    assert_eq!(camera.describe().gain, [1.0 / 16.0, 255.0 / 16.0]);
    assert_eq!(run(camera.configure(MS, 2.03)).unwrap().gain, 2.0);
    let mut camera = open_with(&node, db).unwrap();
    assert!((run(camera.configure(MS, 10.0)).unwrap().gain - 10.0).abs() < 1e-9);
    assert_eq!(node.value(GAIN), 200);
    let lowest = open(&node);
    assert_eq!(lowest.describe().gain, [1.0, 1.0]);
}

#[test]
fn frames_come_with_their_codes_only_when_they_are_fresh() {
    let node = FakeNode::new();
    let mut camera = open(&node);
    let frame = next(&mut camera).unwrap();
    let level = (BLACK + LIGHT) as u16;
    assert_eq!(frame.codes, vec![level; 32], "bytes between rows are left out");
    assert!(!frame.damaged && frame.stamp.timestamp == node.clock.now());
    let stale = run(camera.next_frame(Freshness::NEVER)).unwrap();
    assert!(stale.codes.is_empty() && (stale.width, stale.height) == (8, 4));
    assert_eq!(stale.stamp.sequence, frame.stamp.sequence + 1);
}

#[test]
fn lost_frames_are_counted_and_damaged_and_cut_ones_are_marked() {
    let node = FakeNode::new();
    let mut camera = open(&node);
    let first = next(&mut camera).unwrap().stamp;
    node.state().faults.extend([Fault::Drop, Fault::Damage, Fault::Truncate]);
    assert_eq!(next(&mut camera).unwrap().stamp.sequence, first.sequence + 2);
    for _ in 0..2 {
        let frame = next(&mut camera).unwrap();
        assert!(frame.damaged && frame.codes.len() == 32);
    }
    assert!(!next(&mut camera).unwrap().damaged);
}

#[test]
fn a_frame_that_comes_twice_is_passed_over() {
    let node = FakeNode::new();
    let mut camera = open(&node);
    let first = next(&mut camera).unwrap().stamp;
    node.state().faults.extend([Fault::Again, Fault::Again]);
    let second = next(&mut camera).unwrap().stamp;
    assert!(second.sequence > first.sequence && second.timestamp > first.timestamp);
}

#[test]
fn timestamps_are_the_end_of_readout() {
    let node = FakeNode::new();
    let exposure = Settings { readout_ms: Some(0.0), ..settings() };
    node.state().start_of_exposure = true;
    let mut camera = open_with(&node, exposure).unwrap();
    run(camera.configure(10 * MS, 1.0)).unwrap();
    assert_eq!(next(&mut camera).unwrap().stamp.timestamp, node.clock.now());
    // Interpreted as the end of readout, the stamp is 10 ms early, which is safe.
    let mut camera = open_with(&node, Settings { timestamps: Timestamps::EndOfReadout, ..settings() }).unwrap();
    assert_eq!(next(&mut camera).unwrap().stamp.timestamp, node.clock.now() - 10 * MS);
    // The end of readout is never in the future.
    let mut camera = open_with(&node, Settings { readout_ms: Some(500.0), ..settings() }).unwrap();
    assert_eq!(next(&mut camera).unwrap().stamp.timestamp, node.clock.now());
}

#[test]
fn a_camera_that_is_pulled_out_is_lost_and_its_numbers_go_on() {
    let node = FakeNode::new();
    let mut camera = open(&node);
    let last = next(&mut camera).unwrap().stamp;
    for code in [ENODEV, 5, 71] {
        node.state().faults.push_back(Fault::Fail(code));
        assert_eq!(next(&mut camera).unwrap_err().class, Class::Lost, "{code}");
    }
    let again = next(&mut open(&node)).unwrap().stamp;
    assert!(again.sequence > last.sequence && again.timestamp > last.timestamp);
}

#[test]
fn a_camera_that_hangs_is_reset() {
    let node = FakeNode::new();
    let mut camera = open(&node);
    next(&mut camera).unwrap();
    node.state().faults.push_back(Fault::Silence(MS * 1200));
    next(&mut camera).unwrap();
    assert_eq!(node.state().resets, 0, "late is not lost");
    node.state().faults.push_back(Fault::Silence(MS * 60_000));
    let before = node.clock.now();
    let error = next(&mut camera).unwrap_err();
    assert!(error.class == Class::Lost && error.got.contains("reset"), "{error}");
    assert!(node.clock.now() - before < MS * 2500);
    assert_eq!(node.state().resets, 1);
}

#[test]
fn a_camera_that_hangs_and_cannot_be_reset_is_started_again() {
    let node = FakeNode::new();
    let reset = Box::new(|| Err("it is not a USB device".to_owned()));
    let clock = Arc::new(node.clock.clone());
    let mut camera = V4l2Camera::open(Box::new(node.clone()), "v4l2 fake", settings(), clock, reset).unwrap();
    node.state().faults.push_back(Fault::Silence(MS * 60_000));
    assert_eq!(next(&mut camera).unwrap_err().class, Class::Retry);
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
    assert!(refusal(&|n| n.state().formats.clear(), settings()).contains("video-index0"));
    assert!(refusal(&|n| n.state().formats = vec![*b"H264"], settings()).contains("only H264"));
    assert!(refusal(&|n| n.state().controls.retain(|id, _| *id != EXPOSURE), settings()).contains("exposure_ms"));
    assert!(refusal(&same, Settings { format: Some("Y16".into()), ..settings() }).contains("only MJPG, GREY, YUYV"));
    assert!(refusal(&same, Settings { size: Some([4, 4]), ..settings() }).contains("8 × 4"));
    assert!(refusal(&same, Settings { fps: Some(f64::NAN), ..settings() }).contains("fps is NaN"));
    assert!(refusal(&same, Settings::new("video0")).contains("give a path"));
}

#[test]
fn frames_with_unusable_timestamps_are_timed_by_their_arrival() {
    for fault in [Fault::WallClock, Fault::NoTime, Fault::Ahead, Fault::Back] {
        let node = FakeNode::new();
        let mut camera = open(&node);
        let mut last = next(&mut camera).unwrap().stamp;
        node.state().faults.extend([fault; 4]);
        for i in 0..4 {
            let stamp = next(&mut camera).unwrap().stamp;
            assert!(stamp.sequence == last.sequence + 1 && stamp.timestamp > last.timestamp, "{fault:?} {i}");
            // The first one is only known to have arrived after its predecessor.
            let early = node.clock.now() - stamp.timestamp;
            assert!(early > Duration::ZERO && (early <= 4 * MS || i == 0), "{fault:?} {i}: {early:?}");
            last = stamp;
        }
        assert_eq!(next(&mut camera).unwrap().stamp.timestamp, node.clock.now(), "{fault:?}");
    }
}

#[test]
fn queued_frames_without_timestamps_are_not_taken_for_fresh() {
    let node = FakeNode::new();
    let mut camera = open_with(&node, Settings { timestamps: Timestamps::Arrival, ..settings() }).unwrap();
    next(&mut camera).unwrap();
    // The queue fills meanwhile.
    node.clock.wait(350 * MS);
    let fresh = Freshness { steady_since: node.clock.now(), ..ANY };
    let accepted: Vec<bool> = (0..5).map(|_| fresh.accepts(run(camera.next_frame(fresh)).unwrap().stamp)).collect();
    assert_eq!(accepted, [false, false, false, true, true]);
}

#[test]
fn packed_codes_are_read_with_any_padding_of_rows() {
    for (name, padded) in ["Y10P", "Y12P", "Y14P", "pBAA", "pBCC", "pBEE", "Y10B", "Y10", "NV12", "NM12"]
        .into_iter()
        .flat_map(|name| [(name, 0), (name, 3), (name, 40)])
    {
        let format = PixelFormat::named(name).unwrap();
        let node = FakeNode::new();
        node.state().formats = vec![format.fourcc];
        node.state().format.stride = if padded == 0 { 0 } else { format.row_bytes(8) as u32 + padded };
        let frame = next(&mut open(&node)).unwrap();
        let expected = row_codes(format, (BLACK + LIGHT) as u16, 8).repeat(4);
        assert_eq!((frame.codes, frame.damaged), (expected, false), "{name} with {padded} more bytes");
    }
}

#[test]
fn a_plane_with_a_header_is_read_after_it() {
    let node = FakeNode::new();
    node.state().header = 64;
    let mut camera = open(&node);
    let frame = next(&mut camera).unwrap();
    assert_eq!((frame.codes, frame.damaged), (vec![(BLACK + LIGHT) as u16; 32], false));
    node.state().faults.push_back(Fault::Truncate);
    assert!(next(&mut camera).unwrap().damaged);
}

#[test]
fn jpeg_files_without_huffman_tables_are_read() {
    let node = FakeNode::new();
    let mut camera = open_with(&node, Settings { format: Some("MJPG".into()), ..settings() }).unwrap();
    let whole = next(&mut camera).unwrap();
    node.state().faults.extend([Fault::Without(0xc4), Fault::Without(0xdb)]);
    let [huffman, quantization] = [0; 2].map(|_| next(&mut camera).unwrap());
    assert_eq!((whole.damaged, huffman.damaged, quantization.damaged), (false, false, true));
    assert_eq!(huffman.codes, whole.codes);
}

#[test]
fn a_format_that_another_program_changed_is_noticed() {
    let node = FakeNode::new();
    let mut camera = open(&node);
    node.state().format.stride = 14;
    assert_eq!(next(&mut camera).unwrap().codes, vec![(BLACK + LIGHT) as u16; 32], "padding is adopted");
    let mut camera = open(&node);
    node.state().format.size = [4, 4];
    let error = next(&mut camera).unwrap_err();
    assert!(error.class == Class::Lost && error.got.contains("4 × 4"), "{error}");
    next(&mut open(&node)).unwrap();
}

#[test]
fn the_unit_of_the_exposure_is_set_for_cameras_of_another_one() {
    let node = FakeNode::new();
    node.state().unit_us = 12.5;
    let unit = Settings { exposure_unit_us: Some(12.5), ..settings() };
    let mut camera = open_with(&node, unit.clone()).unwrap();
    assert_eq!(camera.describe().exposure_s, [3.75e-5, 0.025_587_5]);
    assert_eq!(run(camera.configure(10 * MS, 1.0)).unwrap().exposure, 10 * MS);
    assert_eq!(node.value(EXPOSURE), 800);
    // A sensor's control counts lines; without their duration it is no exposure.
    let lines = node.state().controls.remove(&EXPOSURE).unwrap();
    node.state().controls.insert(UNITLESS_EXPOSURE, lines);
    let error = open_with(&node, settings()).err().unwrap();
    assert!(error.class == Class::Setup && error.to_string().contains("exposure_unit_us"), "{error}");
    let mut camera = open_with(&node, unit).unwrap();
    assert_eq!(run(camera.configure(5 * MS, 1.0)).unwrap().exposure, 5 * MS);
}

#[test]
fn a_camera_whose_exposure_is_set_elsewhere_keeps_it() {
    let node = FakeNode::new();
    node.state().controls.remove(&EXPOSURE);
    let mut camera = open_with(&node, Settings { exposure_ms: Some(7.0), ..settings() }).unwrap();
    assert_eq!(camera.describe().exposure_s, [0.007, 0.007]);
    assert_eq!(run(camera.configure(20 * MS, 1.0)).unwrap().exposure, 7 * MS);
}

#[test]
fn frame_rate_and_format_are_as_wished() {
    let node = FakeNode::new();
    let camera = open_with(&node, Settings { fps: Some(6.0), format: Some("YUYV".into()), ..settings() }).err();
    // 8 pixels of YUYV do not fit the fake's rows of 10 bytes.
    assert!(camera.unwrap().to_string().contains("rows of 8 pixels in 10 bytes"));
    let camera = open_with(&node, Settings { fps: Some(6.0), ..settings() }).unwrap();
    assert_eq!(camera.describe().exposure_s[1], 0.2);
    assert_eq!(camera.describe().readout_s, 0.2);
}

#[test]
fn settings_are_read_and_defects_are_named() {
    let text = r#"{"driver": {"kind": "v4l2", "device": "/dev/video0", "gain": {"unity": 16.0}, "fps": 5.0}}"#;
    let config: crate::camera::CameraConfig = serde_json::from_str(text).unwrap();
    let crate::camera::CameraDriver::V4l2(settings) = config.driver else { panic!() };
    assert_eq!((settings.gain, settings.control_lag_frames), (GainScale::Unity(16.0), 2));
    assert!(serde_json::from_str::<crate::camera::CameraConfig>(&text.replace("fps", "fbs")).is_err());
}

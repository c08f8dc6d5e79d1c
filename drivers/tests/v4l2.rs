//! The V4L2 driver on a real kernel: its virtual camera (`modprobe vivid`), and a USB camera, simulated or real.
//!
//! The tests are skipped without these cameras. Tests of a USB camera reset it, so they also need
//! NACRE_TEST_USB_CAMERA. `tests/lab/run` boots a kernel that has both.
#![cfg(all(target_os = "linux", target_pointer_width = "64"))]
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "helpers of tests")]

use nacre_drivers::camera::measure;
use nacre_drivers::camera::v4l2::{GainScale, Settings, V4l2Camera, kernel};
use nacre_drivers::{Camera, Class, Clock, DeviceResult, Frame, Freshness, SystemClock, usb_reset};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;
use v4l::video::Capture;

static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());

const SIZE: [u32; 2] = [640, 360];

/// A device of this kernel driver, with exclusive use.
fn device(driver: &str) -> Option<(String, MutexGuard<'static, ()>)> {
    let one = ONE_AT_A_TIME.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    // A user's camera is only touched on request.
    let may = driver == "vivid" || std::env::var_os("NACRE_TEST_USB_CAMERA").is_some();
    let found = node(driver).filter(|_| may);
    if found.is_none() {
        println!("skipped: no camera of the kernel driver {driver} that may be used");
    }
    Some((found?, one))
}

fn node(driver: &str) -> Option<String> {
    let folder = std::fs::read_dir("/sys/class/video4linux").into_iter().flatten().flatten();
    let mut nodes: Vec<PathBuf> = folder.map(|entry| entry.path()).collect();
    nodes.sort();
    let of_driver = |node: &PathBuf| {
        let is = node.join("device/driver").canonicalize().is_ok_and(|d| d.ends_with(driver));
        is && node.to_string_lossy().contains("video4linux/video")
    };
    let found = nodes.into_iter().find(of_driver)?;
    Some(format!("/dev/{}", found.file_name()?.to_string_lossy()))
}

/// Sets a control by its `v4l2-ctl` name.
fn control(device: &str, name: &str, value: i64) {
    let plain = |name: &str| name.to_lowercase().replace(|c: char| !c.is_alphanumeric(), "_");
    let node = v4l::Device::with_path(device).unwrap();
    let id = node.query_controls().unwrap().into_iter().find(|c| plain(&c.name) == name).unwrap().id;
    node.set_control(v4l::Control { id, value: v4l::control::Value::Integer(value) }).unwrap();
}

/// Whether pictures of the device come in planes.
fn multi_planar(device: &str) -> bool {
    let able = v4l::Device::with_path(device).unwrap().query_caps().unwrap().capabilities;
    able.contains(v4l::capability::Flags::VIDEO_CAPTURE_MPLANE)
}

fn settings(device: &str, format: &str) -> Settings {
    Settings {
        format: Some(format.into()),
        size: Some(SIZE),
        exposure_ms: Some(5.0),
        readout_ms: Some(5.0),
        ..Settings::new(device)
    }
}

fn open(settings: &Settings) -> DeviceResult<V4l2Camera> {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    kernel::open(settings, &clock)
}

fn run<T>(future: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().build().unwrap().block_on(future)
}

fn next(camera: &mut V4l2Camera) -> DeviceResult<Frame> {
    run(camera.next_frame(Freshness::default()))
}

fn mean(frame: &Frame) -> f64 {
    frame.codes.iter().map(|c| f64::from(*c)).sum::<f64>() / frame.codes.len() as f64
}

#[test]
fn all_formats_show_the_same_picture_in_order() {
    let Some((device, _one)) = device("vivid") else { return };
    control(&device, "osd_text_mode", 2);
    let mut means = Vec::new();
    let grey = ["GREY", "Y10", "Y12", "Y16"];
    let bayer = ["BA81", "GBRG", "BG10", "RG12", "BYR2"];
    let luma = ["YUYV", "UYVY", "NV12", "NV21", "NV16", "NV61", "YU12", "YV12"];
    let in_planes: &[&str] =
        if multi_planar(&device) { &["NM12", "NM21", "NM16", "NM61", "YM12", "YM21"] } else { &[] };
    for name in [&grey[..], &luma, in_planes, &bayer].concat() {
        let mut camera = open(&settings(&device, name)).unwrap();
        let info = camera.describe();
        let frames: Vec<Frame> = (0..5).map(|_| next(&mut camera).unwrap()).collect();
        for pair in frames.windows(2) {
            assert!(pair[1].stamp.sequence > pair[0].stamp.sequence, "{name}");
            assert!(pair[1].stamp.timestamp > pair[0].stamp.timestamp, "{name}");
        }
        let last = frames.last().unwrap();
        let age = SystemClock.now() - last.stamp.timestamp;
        assert!(age < Duration::from_secs(2), "{name}: {age:?}");
        assert_eq!((last.width, last.height, last.codes.len()), (640, 360, 640 * 360));
        let full = f64::from(u32::from(info.white.max(255)) + 1).log2().ceil();
        let level = mean(last) / 2f64.powf(full) * 256.0;
        println!("{name}: white {}, mean {:.2} of 256, {} frames after {age:?}", info.white, level, frames.len());
        assert!(last.codes.iter().max() > last.codes.iter().min(), "{name}: a picture");
        means.push((name, level));
    }
    let (grey, luma) = means[..means.len() - bayer.len()].split_at(grey.len());
    for (name, level) in &grey[1..] {
        assert!((level - grey[0].1).abs() < 1.0, "{name}: {level} against {:?}", grey[0]);
    }
    for (name, level) in &luma[1..] {
        assert!((level - luma[0].1).abs() < 1.0, "{name}: {level} against {:?}", luma[0]);
    }
}

#[test]
fn padding_of_rows_is_left_out_and_a_changed_format_is_noticed() {
    let Some((device, _one)) = device("vivid") else { return };
    if multi_planar(&device) {
        return println!("skipped: the crate v4l cannot set formats of multi-planar devices");
    }
    control(&device, "osd_text_mode", 2);
    let grey = settings(&device, "GREY");
    let codes = next(&mut open(&grey).unwrap()).unwrap().codes;
    let other = v4l::Device::with_path(&device).unwrap();
    let mut camera = open(&grey).unwrap();
    let padded = v4l::Format { stride: SIZE[0] + 64, ..other.format().unwrap() };
    assert_eq!(other.set_format(&padded).unwrap().stride, SIZE[0] + 64);
    assert!(next(&mut camera).unwrap().codes == codes);
    drop(camera);
    let mut camera = open(&grey).unwrap();
    other.set_format(&v4l::Format { fourcc: v4l::FourCC::new(b"Y16 "), ..padded }).unwrap();
    let error = next(&mut camera).unwrap_err();
    println!("changed format: {error}");
    assert_eq!(error.class, Class::Lost);
    drop(camera);
    assert!(next(&mut open(&grey).unwrap()).unwrap().codes == codes);
}

#[test]
fn frames_with_timestamps_of_another_clock_are_timed_by_their_arrival() {
    let Some((device, _one)) = device("vivid") else { return };
    // Timestamps near 2³¹ s.
    control(&device, "wrap_timestamp", 2);
    let mut camera = open(&settings(&device, "GREY")).unwrap();
    let stamps: Vec<_> = (0..10).map(|_| next(&mut camera).unwrap().stamp).collect();
    let age = SystemClock.now() - stamps[9].timestamp;
    std::thread::sleep(Duration::from_secs(1));
    let now = SystemClock.now();
    let fresh = Freshness { steady_since: now, first_sequence: 0, duration: Duration::from_millis(10) };
    let stale = (0..20).take_while(|_| !fresh.accepts(run(camera.next_frame(fresh)).unwrap().stamp)).count();
    control(&device, "wrap_timestamp", 0);
    println!("age {age:?}, {stale} old frames");
    assert!(stamps.is_sorted_by(|a, b| a.sequence < b.sequence && a.timestamp < b.timestamp), "{stamps:?}");
    assert!(age < Duration::from_secs(1) && (1..10).contains(&stale));
}

#[test]
fn numbers_go_on_where_the_counter_of_the_kernel_overflows() {
    let Some((device, _one)) = device("vivid") else { return };
    // The counter starts 128 frames before its overflow.
    control(&device, "wrap_sequence_number", 1);
    let mut camera = open(&settings(&device, "GREY")).unwrap();
    let numbers: Vec<u64> =
        (0..140).map(|_| run(camera.next_frame(Freshness::NEVER)).unwrap().stamp.sequence).collect();
    control(&device, "wrap_sequence_number", 0);
    println!("{} numbers for 140 frames", numbers[139] - numbers[0] + 1);
    assert!(numbers.is_sorted_by(|a, b| a < b) && numbers[139] - numbers[0] < 1000);
}

#[test]
fn stream_faults_are_reported_and_overcome() {
    let Some((device, _one)) = device("vivid") else { return };
    let grey = settings(&device, "GREY");
    let mut camera = open(&grey).unwrap();
    next(&mut camera).unwrap();

    control(&device, "inject_v4l2_buf_flag_error", 1);
    let damaged = (0..20).filter(|_| next(&mut camera).unwrap().damaged).count();
    println!("error flag: {damaged} of 20 frames");
    assert!((1..20).contains(&damaged));

    control(&device, "percentage_of_dropped_buffers", 40);
    let numbers: Vec<u64> = (0..20).map(|_| next(&mut camera).unwrap().stamp.sequence).collect();
    control(&device, "percentage_of_dropped_buffers", 0);
    println!("dropped: {} numbers for 20 frames", numbers[19] - numbers[0] + 1);
    assert!(numbers[19] - numbers[0] > 19);

    control(&device, "inject_fatal_streaming_error", 1);
    let error = (0..20).find_map(|_| next(&mut camera).err()).unwrap();
    println!("fatal error: {error}");
    assert_eq!(error.class, Class::Lost);
    drop(camera);

    for fault in ["inject_vidioc_reqbufs_error", "inject_vidioc_qbuf_error", "inject_vidioc_streamon_error"] {
        let mut camera = open(&grey).unwrap();
        control(&device, fault, 1);
        let error = next(&mut camera).unwrap_err();
        println!("{fault}: {error}");
        next(&mut camera).unwrap();
    }
}

#[test]
fn a_queue_of_old_frames_is_seen_through() {
    let Some((device, _one)) = device("vivid") else { return };
    let mut camera = open(&settings(&device, "GREY")).unwrap();
    next(&mut camera).unwrap();
    std::thread::sleep(Duration::from_secs(1));
    let now = SystemClock.now();
    let fresh = Freshness { steady_since: now, first_sequence: 0, duration: Duration::from_millis(10) };
    let mut stale = 0;
    while !fresh.accepts(run(camera.next_frame(fresh)).unwrap().stamp) {
        stale += 1;
    }
    println!("{stale} old frames");
    assert!((1..10).contains(&stale));
}

#[test]
fn a_camera_that_is_pulled_out_is_lost_and_comes_back() {
    let Some((device, _one)) = device("vivid") else { return };
    let grey = settings(&device, "GREY");
    let mut camera = open(&grey).unwrap();
    let last = next(&mut camera).unwrap().stamp;
    control(&device, "disconnect", 1);
    let error = (0..10).find_map(|_| next(&mut camera).err()).unwrap();
    println!("disconnected: {error}");
    assert_eq!(error.class, Class::Lost);
    // The virtual camera reappears once it is closed.
    drop(camera);
    let again = next(&mut open(&grey).unwrap()).unwrap().stamp;
    assert!(again.sequence > last.sequence && again.timestamp > last.timestamp);
}

#[test]
fn a_usb_camera_obeys_exposure_and_gain() {
    let Some((device, _one)) = device("uvcvideo") else { return };
    let mut camera = open(&Settings {
        fps: Some(15.0),
        gain: GainScale::Unity(16.0),
        size: Some([640, 480]),
        ..Settings::new(&device)
    })
    .unwrap();
    println!("{:?}", camera.describe());
    let ms = Duration::from_millis;
    for exposure in [5, 10, 20] {
        let controls = run(camera.configure(ms(exposure), 1.0)).unwrap();
        assert_eq!(controls.exposure, ms(exposure));
    }
    let lag = run(measure::control_lag(&mut camera, [ms(5), ms(20)], 1.0)).unwrap();
    let exposures: Vec<Duration> = [4, 8, 12, 16, 20].map(ms).into();
    let ramp = run(measure::exposure_ramp(&mut camera, &exposures, 1.0)).unwrap();
    println!("control lag {lag} frames, {ramp:?}");
    let frame = next(&mut camera).unwrap();
    println!("frame {:?}, now {:?}", frame.stamp, SystemClock.now());
}

#[test]
fn a_usb_camera_may_send_jpeg_files_without_tables() {
    let Some((device, _one)) = device("uvcvideo") else { return };
    let name = std::fs::read_to_string(format!("/sys/class/video4linux/{}/name", &device["/dev/".len()..])).unwrap();
    if !name.contains("Simulated camera") {
        return println!("skipped: the camera is not the simulated one");
    }
    let jpeg = Settings { format: Some("MJPG".into()), size: Some([16, 8]), ..Settings::new(&device) };
    let mut camera = open(&jpeg).unwrap();
    for _ in 0..5 {
        let frame = next(&mut camera).unwrap();
        assert!(!frame.damaged && frame.codes.iter().all(|code| (118..=138).contains(code)), "{frame:?}");
    }
}

#[test]
fn a_usb_camera_that_is_reset_is_lost_and_comes_back() {
    let Some((device, _one)) = device("uvcvideo") else { return };
    let settings = Settings { size: Some([640, 480]), ..Settings::new(&device) };
    let mut camera = open(&settings).unwrap();
    let last = next(&mut camera).unwrap().stamp;
    let place = usb_reset::sysfs_device("video4linux", device.as_ref()).unwrap();
    let address = usb_reset::usb_address(&place).unwrap();
    let reset = usb_reset::reset(address);
    println!("reset {address:?}: {reset:?}");
    reset.unwrap();
    let after = (0..10).find_map(|_| next(&mut camera).err());
    println!("after the reset: {after:?}");
    assert!(after.is_none_or(|e| e.class == Class::Lost));
    let id = camera.describe().id;
    drop(camera);
    // Its number may have changed; its name in /dev/v4l/by-id would follow.
    let mut camera = (0..50).find_map(|_| {
        std::thread::sleep(Duration::from_millis(400));
        let device = node("uvcvideo")?;
        open(&Settings { device, ..settings.clone() }).inspect_err(|e| println!("not yet: {e}")).ok()
    });
    let camera = camera.as_mut().unwrap();
    assert_eq!(camera.describe().id, id);
    assert!(next(camera).unwrap().stamp.sequence > last.sequence);
}

#[test]
fn a_usb_camera_whose_cable_is_pulled_is_lost() {
    if std::env::var_os("NACRE_TEST_PULLED").is_none() {
        return println!("skipped: nobody pulls the cable (NACRE_TEST_PULLED)");
    }
    let Some((device, _one)) = device("uvcvideo") else { return };
    let settings = Settings::new(&device);
    let mut camera = open(&settings).unwrap();
    let begun = SystemClock.now();
    let mut frames = 0;
    let error = loop {
        match next(&mut camera) {
            Ok(_) => frames += 1,
            Err(error) => break error,
        }
        assert!(SystemClock.now() - begun < Duration::from_secs(120));
    };
    println!("after {frames} frames: {error}");
    assert!(frames > 0 && error.class == Class::Lost);
    drop(camera);
    println!("opened again: {}", open(&settings).err().unwrap());
}

//! The driver on a fake camera.

use super::fake::{Bytes, Fake};
use super::node::{Cause, Failure, Storage};
use super::{Format, Gphoto2Camera, Settings};
use crate::{Camera, Class, Clock, DeviceError, DeviceResult, Freshness, SystemClock};
use std::sync::Arc;
use std::time::Duration;

const ANY: Freshness = Freshness { steady_since: Duration::ZERO, first_sequence: 0, duration: Duration::ZERO };

fn open_as(fake: &Fake, settings: Settings, raw: bool) -> DeviceResult<Gphoto2Camera> {
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    Gphoto2Camera::open(Box::new(fake.clone()), settings, clock, Arc::new(Bytes { raw }))
}

fn open(fake: &Fake) -> DeviceResult<Gphoto2Camera> {
    open_as(fake, Settings::default(), true)
}

fn error(fake: &Fake) -> DeviceError {
    open(fake).err().unwrap()
}

fn run<T>(future: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().build().unwrap().block_on(future)
}

#[test]
fn a_camera_is_set_up_and_described_by_one_photograph() {
    let fake = Fake::new();
    let camera = open_as(&fake, Settings { aperture: Some(8.0), ..Settings::default() }, true).unwrap();
    let info = camera.describe();
    assert_eq!(info.id, "gphoto2 Acme Reflex s/n 4711");
    assert_eq!((info.width, info.height, info.white), (4, 1, 255));
    assert_eq!(info.exposure_choices_s.len(), 5, "bulb is none");
    assert_eq!((info.exposure_s, info.gain), ([1.0 / 4000.0, 30.0], [1.0, 4.0]));
    for (name, value) in [
        ("imageformat", "RAW"),
        ("capturetarget", "Internal RAM"),
        ("aperture", "8"),
        ("iso", "100"),
        ("shutterspeed", "1/100"),
    ] {
        assert_eq!(fake.value(name), value, "{name}");
    }
    let state = fake.0.lock().unwrap();
    assert_eq!((state.captured, state.deleted), (1, 1));
}

#[test]
fn exposure_and_gain_are_set_and_checked_before_each_photograph() {
    let fake = Fake::new();
    let mut camera = open(&fake).unwrap();
    let controls = run(camera.configure(Duration::from_micros(16_670), 4.0)).unwrap();
    assert_eq!((fake.value("shutterspeed").as_str(), fake.value("iso").as_str()), ("1/60", "400"));
    assert!((controls.exposure.as_secs_f64() - 1.0 / 60.0).abs() < 1e-9 && controls.gain == 4.0);
    let stale = run(camera.next_frame(Freshness::NEVER)).unwrap();
    assert!(stale.codes.is_empty() && fake.0.lock().unwrap().captured == 1, "no photograph");
    let frame = run(camera.next_frame(ANY)).unwrap();
    assert_eq!(frame.codes, [7; 4]);
    assert!(frame.stamp.timestamp >= controls.set_at + controls.exposure);
    let refused = run(camera.configure(Duration::from_millis(13), 1.0)).unwrap_err();
    assert!(refused.class == Class::Setup && refused.got.contains("1/100 s (10 ms) and 1/60 s"), "{refused}");
    fake.change("shutterspeed", "1");
    let turned = run(camera.next_frame(ANY)).unwrap_err();
    assert!(turned.expected.contains("1/60") && &*turned.got == "1", "{turned}");
    fake.0.lock().unwrap().stuck = Some("shutterspeed");
    let stuck = run(camera.configure(Duration::from_millis(10), 1.0)).unwrap_err();
    assert!(stuck.expected.contains("1/100") && stuck.class == Class::Setup, "{stuck}");
}

#[test]
fn cameras_that_are_not_ready_are_refused_by_name() {
    type Change<'a> = &'a dyn Fn(&Fake);
    let cases: [(Change<'_>, &str); 10] = [
        (&|f| f.change("autoexposuremode", "P"), "dial to M"),
        (&|f| f.change("batterylevel", "3%"), "charge the battery"),
        (&|f| f.remove("shutterspeed"), "dial to M"),
        (&|f| f.control("shutterspeed", |c| c.choices = vec!["bulb".into()]), "dial to M"),
        (&|f| f.control("imageformat", |c| c.choices = vec!["Large Fine JPEG".into()]), "`format`"),
        (&|f| f.control("iso", |c| (c.read_only, c.value) = (true, "Auto".into())), "dial to M"),
        (&|f| f.remove("capturetarget"), "put a memory card in"),
        (
            &|f| {
                f.remove("capturetarget");
                f.0.lock().unwrap().storages = vec![Storage { writable: false, free_kib: None }];
            },
            "unlock its switch",
        ),
        (
            &|f| {
                f.remove("capturetarget");
                f.0.lock().unwrap().storages = vec![Storage { writable: true, free_kib: Some(9) }];
            },
            "card is full",
        ),
        (&|f| f.0.lock().unwrap().failure = Some(Failure::new(Cause::Focus, "Out of Focus")), "focus by hand"),
    ];
    for (change, remedy) in cases {
        let fake = Fake::new();
        change(&fake);
        let error = error(&fake);
        assert!(error.remedy.contains(remedy), "{error}");
    }
    let fake = Fake::new();
    let no_aperture = open_as(&fake, Settings { aperture: Some(6.3), ..Settings::default() }, true).err().unwrap();
    assert!(no_aperture.got.contains("4, 5.6, 8"), "{no_aperture}");
    let no_iso = open_as(&fake, Settings { iso: vec![50.0], ..Settings::default() }, true).err().unwrap();
    assert!(no_iso.got.contains("Auto, 400, 100, 200"), "{no_iso}");
}

#[test]
fn failures_of_a_photograph_have_classes_and_remedies() {
    let fake = Fake::new();
    let mut camera = open(&fake).unwrap();
    run(camera.configure(Duration::from_millis(10), 1.0)).unwrap();
    for (cause, class, remedy) in [
        (Cause::Gone, Class::Lost, "cable"),
        (Cause::Busy, Class::Retry, "idle"),
        (Cause::CardFull, Class::Stop, "empty it"),
        (Cause::Lens, Class::Stop, "lens cap"),
        (Cause::Mirror, Class::Stop, "mirror"),
        (Cause::Battery, Class::Stop, "battery"),
        (Cause::Held, Class::Setup, super::GVFS),
    ] {
        fake.0.lock().unwrap().failure = Some(Failure::new(cause, "x"));
        let error = run(camera.next_frame(ANY)).unwrap_err();
        assert!(error.class == class && error.remedy.contains(remedy), "{error}");
    }
    // A changed image size is noticed.
    fake.0.lock().unwrap().size = 9;
    assert!(run(camera.next_frame(ANY)).unwrap_err().got.contains("9 × 1"));
}

#[test]
fn the_format_of_photographs_must_be_the_configured_one() {
    let fake = Fake::new();
    fake.remove("imageformat");
    let error = open_as(&fake, Settings::default(), false).err().unwrap();
    assert!(error.expected.contains("raw") && error.got.contains("JPEG"), "{error}");
    let camera = open_as(&fake, Settings { format: Format::Jpeg, ..Settings::default() }, false).unwrap();
    assert!(camera.describe().warnings.iter().any(|w| w.contains("not linear")));
}

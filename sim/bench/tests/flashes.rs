//! Flash drivers down to the wire, each with its emulated device, which switches the bench's flash. Whatever the
//! fault, no driver reports the light off while it is on.

#![allow(clippy::unwrap_used, clippy::panic, reason = "helpers of tests")]

use nacre_base::progress::Silent;
use nacre_drivers::flash::{FlashConfig, FlashDriver, blink1, bulk, relay};
use nacre_drivers::{Class, Clock, DeviceResult, Flash, FlashHandle, Patience, SystemClock};
use nacre_sim::emulators::{Blink1Emulator, BulkEmulator, ByteFault, ByteFaultKind, Peripheral, RelayEmulator, Served};
use nacre_sim::{Bench, BenchConfig, Reply, Request, SharedBench};
use std::sync::Arc;
use std::time::{Duration, Instant};

#[derive(Clone, Copy, Debug)]
enum Kind {
    Relay,
    Blink1,
    Bulk,
}

const ALL: [Kind; 3] = [Kind::Relay, Kind::Blink1, Kind::Bulk];

/// A bench with an emulated flash device.
struct Rig {
    kind: Kind,
    bench: SharedBench,
    served: Served,
    _folder: tempfile::TempDir,
}

fn bench() -> SharedBench {
    let mut config = BenchConfig::default();
    (config.camera.width, config.camera.height) = (24, 16);
    SharedBench::new(Bench::new(&config, &Silent).unwrap())
}

impl Rig {
    fn new(kind: Kind, faults: Vec<ByteFault>) -> Self {
        let bench = bench();
        let port = Box::new(bench.clone());
        let device: Box<dyn Peripheral> = match kind {
            Kind::Relay => Box::new(RelayEmulator::new(port, *b"BITFT", 2, 2)),
            Kind::Blink1 => Box::new(Blink1Emulator::new(port)),
            Kind::Bulk => Box::new(BulkEmulator::new(port)),
        };
        let folder = tempfile::tempdir().unwrap();
        let served = Served::start(&folder.path().join("device"), device, faults).unwrap();
        Self { kind, bench, served, _folder: folder }
    }

    fn open(&self, max_on_s: f64) -> DeviceResult<Box<dyn Flash>> {
        let path = Some(self.served.path());
        let driver = match self.kind {
            Kind::Relay => {
                FlashDriver::Relay(relay::Settings { serial: Some("BITFT".into()), path, channel: 2, board: None })
            }
            Kind::Blink1 => FlashDriver::Blink1(blink1::Settings { serial: None, path, rgb: [255, 200, 100] }),
            Kind::Bulk => FlashDriver::Bulk(bulk::Settings { serial: None, path }),
        };
        let clock: Arc<dyn Clock> = Arc::new(SystemClock);
        FlashConfig { driver, settling_ms: 1.0, max_on_s }.open(&clock).unwrap()
    }

    fn lit(&self) -> bool {
        match self.bench.answer(&Request::Light).unwrap() {
            Reply::Light { flash, .. } => flash,
            other => panic!("{other:?}"),
        }
    }
}

fn run<T>(future: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap().block_on(future)
}

#[test]
fn the_light_follows_and_is_read_back() {
    for kind in ALL {
        let rig = Rig::new(kind, vec![]);
        let mut flash = rig.open(10.0).unwrap();
        for on in [true, false, true, true, false] {
            let before = SystemClock.now();
            let switched = run(flash.switch(on)).unwrap();
            assert_eq!((switched.on, rig.lit()), (on, on), "{kind:?}");
            assert!(switched.since >= before + Duration::from_millis(1), "{kind:?}: settled");
            assert_eq!(run(flash.is_on()), Ok(on), "{kind:?}");
        }
        let info = flash.describe();
        assert_eq!((info.settling_s, info.max_on_s), (0.001, 10.0));
    }
}

#[test]
fn off_when_opened_and_when_dropped() {
    for kind in ALL {
        let rig = Rig::new(kind, vec![]);
        let mut first = rig.open(10.0).unwrap();
        run(first.switch(true)).unwrap();
        // A guardian that has lost the link does the same.
        let mut second = rig.open(10.0).unwrap();
        assert!(!rig.lit(), "{kind:?}: off when opened");
        assert!(run(first.is_on()).is_err(), "{kind:?}: somebody else switched it");
        drop(first);
        run(second.switch(true)).unwrap();
        assert!(rig.lit());
        drop(second);
        assert!(!rig.lit(), "{kind:?}: off when dropped");
    }
}

#[test]
fn identities_stay() {
    let ids: Vec<String> = ALL.map(|kind| Rig::new(kind, vec![]).open(1.0).unwrap().describe().id).into();
    assert_eq!(ids[0], "relay BITFT channel 2");
    assert!(ids[1].starts_with("blink(1)") && ids[2].starts_with("flash"));
}

/// Each fault in each state of the light, for one transfer and for all further ones.
#[test]
fn no_fault_makes_a_driver_say_off_while_the_light_is_on() {
    let rigs = ALL.into_iter().flat_map(|kind| ByteFaultKind::ALL.map(|fault| (kind, fault)));
    let tests: Vec<_> = rigs.map(|(kind, fault)| std::thread::spawn(move || try_fault(kind, fault))).collect();
    tests.into_iter().for_each(|test| test.join().unwrap());
}

fn try_fault(kind: Kind, fault: ByteFaultKind) {
    // Number of transfers of opening; those of the first command follow.
    let opening = match kind {
        Kind::Relay => 3,
        Kind::Blink1 => 2 + 1 + 16 + 4,
        Kind::Bulk => 4,
    };
    for after in opening..opening + 5 {
        // Permanent faults take long to test, since drivers wait for missing answers.
        let lasting = (after - opening) % 2 == 0;
        for times in [Some(1), None].into_iter().take(if lasting { 2 } else { 1 }) {
            let rig = Rig::new(kind, vec![ByteFault { kind: fault, after, times }]);
            let mut flash = rig.open(10.0).unwrap_or_else(|e| panic!("{kind:?} {fault:?} {after}: {e}"));
            let what = format!("{kind:?} {fault:?} after {after}, {times:?}");
            for on in [true, false] {
                if let Ok(switched) = run(flash.switch(on)) {
                    assert!(switched.on || !rig.lit(), "{what}: says off after switching {on}");
                    // A command is confirmed only if it was executed.
                    assert!(switched.on != on || switched.on == rig.lit(), "{what}: says {}", switched.on);
                }
                if let Ok(is_on) = run(flash.is_on()) {
                    assert!(is_on || !rig.lit(), "{what}: reports off");
                }
            }
            drop(flash);
            if times.is_some() {
                assert!(!rig.lit(), "{what}: a passing fault leaves the light on");
            }
        }
    }
}

#[test]
fn a_relay_of_another_number_or_without_the_channel_is_refused() {
    let rig = Rig::new(Kind::Relay, vec![]);
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    let open = |serial: &str, channel| {
        let settings =
            relay::Settings { serial: Some(serial.into()), path: Some(rig.served.path()), channel, board: None };
        let config = FlashConfig { driver: FlashDriver::Relay(settings), settling_ms: 1.0, max_on_s: 1.0 };
        config.open(&clock).unwrap().err().unwrap()
    };
    assert!(open("OTHER", 2).got.contains("BITFT"));
    assert!(open("BITFT", 9).remedy.contains("`channel`"));
    assert!(open("BITFT", 0).remedy.contains("`channel`"));
}

#[test]
fn other_channels_are_left_alone() {
    let rig = Rig::new(Kind::Relay, vec![]);
    // The flash is on channel 2; another load uses channel 1.
    let settings = relay::Settings { serial: None, path: Some(rig.served.path()), channel: 1, board: None };
    let clock: Arc<dyn Clock> = Arc::new(SystemClock);
    let config = FlashConfig { driver: FlashDriver::Relay(settings), settling_ms: 1.0, max_on_s: 1.0 };
    let mut flash = rig.open(10.0).unwrap();
    run(flash.switch(true)).unwrap();
    let mut other = config.open(&clock).unwrap().unwrap();
    for on in [true, false] {
        run(other.switch(on)).unwrap();
        assert!(rig.lit(), "the first channel is not ours");
        assert_eq!(run(flash.is_on()), Ok(true));
    }
}

/// The driver ends without a command, as when the computer crashes: the light goes off by itself.
#[test]
fn lamps_with_a_watch_go_off_by_themselves() {
    for kind in [Kind::Blink1, Kind::Bulk] {
        let rig = Rig::new(kind, vec![]);
        let mut flash = rig.open(0.2).unwrap();
        run(flash.switch(true)).unwrap();
        std::mem::forget(flash);
        let begun = Instant::now();
        while rig.lit() && begun.elapsed() < Duration::from_secs(5) {
            std::thread::sleep(Duration::from_millis(5));
        }
        let after = begun.elapsed();
        assert!((0.2..3.0).contains(&after.as_secs_f64()), "{kind:?}: {after:?}");
        std::thread::sleep(Duration::from_millis(50));
        assert!(!rig.lit(), "{kind:?}: and stays off");
    }
}

/// On its own thread, as in the engine: after a lost link the light is off, and no command is repeated.
#[test]
fn a_lost_link_comes_back_dark() {
    for (kind, opening) in ALL.into_iter().zip([3, 23, 4]) {
        // The command succeeds; its read-back fails.
        let rig = Arc::new(Rig::new(
            kind,
            vec![ByteFault { kind: ByteFaultKind::Dropped, after: opening + 2, times: Some(1) }],
        ));
        let (clock, opened): (Arc<dyn Clock>, _) = (Arc::new(SystemClock), rig.clone());
        let patience = Patience { total: Duration::from_secs(5), clock };
        run(async {
            let mut flash = FlashHandle::start(Box::new(move || opened.open(10.0)), patience).await.unwrap();
            let lost = loop {
                match flash.switch(true).await {
                    Ok(switched) => assert!(switched.on),
                    Err(error) => break error,
                }
            };
            assert_eq!(lost.class, Class::Lost, "{kind:?} {lost}");
            assert!(!rig.lit(), "{kind:?}");
            assert_eq!(flash.is_on().await, Ok(false), "{kind:?}");
            assert!(flash.switch(true).await.unwrap().on && rig.lit(), "{kind:?}");
        });
        assert!(!rig.lit(), "{kind:?}: off at the end");
    }
}

#[test]
fn settings_are_read_as_written() {
    let read = |text: &str| toml_of(text).driver;
    let relay = read("driver = { kind = \"relay\", serial = \"BITFT\", channel = 2 }");
    assert_eq!(
        relay,
        FlashDriver::Relay(relay::Settings { serial: Some("BITFT".into()), path: None, channel: 2, board: None })
    );
    assert!(matches!(read("driver = { kind = \"blink1\" }"), FlashDriver::Blink1(s) if s.rgb == [255; 3]));
    assert!(matches!(read("driver = { kind = \"bulk\" }"), FlashDriver::Bulk(_)));
    let line = read("driver = { kind = \"serial_line\", port = \"/dev/ttyUSB0\", line = \"dtr\" }");
    assert!(matches!(line, FlashDriver::SerialLine(_)));
    let odd = "driver = { kind = \"relay\", chanel = 2 }";
    assert!(toml::from_str::<FlashConfig>(odd).is_err(), "misspelt keys are refused");
}

fn toml_of(text: &str) -> FlashConfig {
    toml::from_str(text).unwrap()
}

//! The bench behind one door: every request to a simulated device, in this process or over a socket, comes through
//! [`SharedBench::answer`], where faults strike.

use crate::bench::{Bench, Shining};
use crate::config::{BenchConfig, FaultKind, FaultyDevice};
use nacre_drivers::{
    Arrived, CameraInfo, Class, Clock, Controls, DeviceError, DeviceResult, DisplayInfo, FlashInfo, Freshness,
    InterlockInfo, Level, Pattern, Shown, StageInfo, Stamp, Switched,
};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// A request to one of the bench's devices.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "named as the calls of the device traits")]
pub enum Request {
    Describe,
    Home,
    MoveTo {
        angle_deg: f64,
    },
    /// Waits for a movement, a moment at a time where the bench takes as long as a real one.
    Arrive,
    /// Ends a movement where it is.
    Halt,
    Position,
    /// What time it is; no device is asked.
    Now,
    Configure {
        exposure: Duration,
        gain: f64,
    },
    Cover {
        closed: bool,
    },
    NextFrame {
        fresh: Freshness,
    },
    Show {
        pattern: Pattern,
    },
    Switch {
        on: bool,
    },
    IsOn,
    Level,
    /// What shines, for a bystander; no device is asked.
    Light,
}

/// Its answer.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[allow(missing_docs, reason = "named as the results of the device traits")]
pub enum Reply {
    Described(Box<Devices>),
    Arrived(Arrived),
    /// A movement goes on.
    Turning,
    Angle(f64),
    Controls(Controls),
    At(Duration),
    /// The codes follow the text on a socket, unless the frame is not fresh.
    Frame {
        stamp: Stamp,
        width: usize,
        height: usize,
        damaged: bool,
        #[serde(skip)]
        codes: Vec<u16>,
    },
    Shown(Shown),
    Switched(Switched),
    On(bool),
    Level(Level),
    Light {
        panel: bool,
        flash: bool,
    },
}

/// What the devices of a bench are and can do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Devices {
    /// The rotation stage.
    pub stage: StageInfo,
    /// The camera.
    pub camera: CameraInfo,
    /// The panel.
    pub display: DisplayInfo,
    /// The flash.
    pub flash: FlashInfo,
    /// The door switch.
    pub interlock: InterlockInfo,
    /// Optics and distances, which frames are described with.
    pub bench: BenchConfig,
    /// Size of a pixel on the sample in µm.
    pub pixel_um: f64,
}

/// A driver gives up after this long without an answer.
const SILENCE: Duration = Duration::from_secs(5);

/// A bench that takes as long as a real one answers this often while the analyser turns.
const MOMENT: Duration = Duration::from_millis(20);

/// The clock starts here, so that it can be set back.
const EPOCH: Duration = Duration::from_secs(100_000);

/// How far a fault sets it back.
const SET_BACK: Duration = Duration::from_secs(3600);

/// A bench that several devices share, on virtual time or at the pace of the clock on the wall.
#[derive(Clone)]
pub struct SharedBench {
    state: Arc<Mutex<State>>,
    /// When time 0 was, if the bench runs at real pace.
    begun: Option<Instant>,
}

struct State {
    bench: Bench,
    /// Commands so far, for faults.
    commands: BTreeMap<FaultyDevice, u64>,
    set_back: bool,
    door_open: bool,
    door_changes: u64,
    /// When the movement that was begun is over, and the angle that is reported then.
    turning: Option<(Duration, f64)>,
}

impl SharedBench {
    /// Shares a bench whose time is virtual: only its devices' calls advance it.
    pub fn new(bench: Bench) -> Self {
        let state = State {
            bench,
            commands: BTreeMap::new(),
            set_back: false,
            door_open: false,
            door_changes: 0,
            turning: None,
        };
        Self { state: Arc::new(Mutex::new(state)), begun: None }
    }

    /// Shares a bench that takes as long as a real one.
    pub fn real_time(bench: Bench) -> Self {
        Self { begun: Some(Instant::now()), ..Self::new(bench) }
    }

    /// Looks at the bench itself.
    pub fn look<T>(&self, at: impl FnOnce(&Bench) -> T) -> T {
        at(&self.lock().bench)
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(begun) = self.begun {
            state.bench.advance_to(begun.elapsed());
        }
        state
    }

    /// Waits without holding the bench, so that other devices go on.
    fn wait_until(&self, time: Duration) {
        if let Some(begun) = self.begun {
            std::thread::sleep(time.saturating_sub(begun.elapsed()));
        }
        self.lock().bench.advance_to(time);
    }

    /// The panel's link is gone: whatever is wrong with it, it goes black by itself.
    pub(crate) fn close_panel(&self) {
        let mut state = self.lock();
        let shining = state.bench.shining();
        state.bench.shine(Shining { pattern: Pattern::Black, ..shining }, Duration::ZERO);
    }

    /// Carries a request out.
    ///
    /// # Errors
    /// What the bench cannot do, and faults.
    pub fn answer(&self, request: &Request) -> DeviceResult<Reply> {
        let fault = device(request).and_then(|device| self.lock().strike(device));
        match fault {
            Some(FaultKind::Silent) => {
                let until = self.lock().bench.now() + SILENCE;
                self.wait_until(until);
                let got = format!("none within {} s", SILENCE.as_secs());
                return Err(error(request, "an answer", &got).remedy("check cable and power, then resume the session"));
            }
            Some(FaultKind::Lost) => {
                return Err(error(request, "an answer", "a lost link")
                    .remedy("check the cable, then resume the session")
                    .class(Class::Lost));
            }
            _ => {}
        }
        match request {
            Request::Home => self.turn(0.0, fault),
            Request::MoveTo { angle_deg } => self.turn(*angle_deg, fault),
            Request::Arrive => Ok(self.arrive()),
            Request::NextFrame { fresh } => Ok(self.frame(*fresh, fault)),
            Request::Switch { on } => {
                let since = self.lock().switch(*on);
                self.wait_until(since);
                let on = *on != (fault == Some(FaultKind::WrongState));
                let since = self.lock().reported(since);
                Ok(Reply::Switched(Switched { since, on }))
            }
            _ => self.lock().at_once(request, fault),
        }
    }

    fn turn(&self, angle_deg: f64, fault: Option<FaultKind>) -> DeviceResult<Reply> {
        let mut state = self.lock();
        let from = state.bench.analyser_deg();
        let [low, high] = state.bench.config().stage.limits_deg;
        if !(low..=high).contains(&angle_deg) {
            let expected = format!("an angle from {low}° to {high}°");
            return Err(error(&Request::MoveTo { angle_deg }, &expected, &format!("{angle_deg}°"))
                .remedy("correct the plan")
                .class(Class::Setup));
        }
        let target = if fault == Some(FaultKind::StopsShort) { 0.5 * (from + angle_deg) } else { angle_deg };
        let since = state.bench.turn_analyser(target);
        state.turning = Some((since, if fault == Some(FaultKind::Nonsense) { f64::NAN } else { target }));
        Ok(Reply::Turning)
    }

    fn arrive(&self) -> Reply {
        let (turning, now) = {
            let state = self.lock();
            (state.turning, state.bench.now())
        };
        let Some((since, angle_deg)) = turning else {
            let mut state = self.lock();
            let (since, angle_deg) = (state.reported(now), state.bench.analyser_deg());
            return Reply::Arrived(Arrived { since, angle_deg });
        };
        let patience = if self.begun.is_some() { now + MOMENT } else { Duration::MAX };
        self.wait_until(since.min(patience));
        let mut state = self.lock();
        if state.bench.now() < since {
            return Reply::Turning;
        }
        state.turning = None;
        let since = state.reported(since);
        Reply::Arrived(Arrived { since, angle_deg })
    }

    fn frame(&self, fresh: Freshness, fault: Option<FaultKind>) -> Reply {
        let (mut state, exposed) = loop {
            let mut state = self.lock();
            if let Some(exposed) = state.bench.take_frame() {
                break (state, exposed);
            }
            let at = state.bench.next_frame_at();
            drop(state);
            self.wait_until(at);
        };
        let camera = &state.bench.config().camera;
        let (mut width, height) = (camera.width as usize, camera.height as usize);
        let Stamp { sequence, timestamp } = exposed.stamp();
        let stamp = Stamp { sequence, timestamp: state.reported(timestamp) };
        let mut codes = if fresh.accepts(stamp) { state.bench.codes(&exposed) } else { vec![] };
        if fault == Some(FaultKind::WrongSize) {
            codes = codes.chunks(width).flat_map(|row| row[1..].to_vec()).collect();
            width -= 1;
        }
        Reply::Frame { stamp, width, height, damaged: fault == Some(FaultKind::Damaged), codes }
    }
}

impl State {
    /// The fault that strikes a device's next command, which is counted.
    fn strike(&mut self, device: FaultyDevice) -> Option<FaultKind> {
        let mut due = |device| {
            let count = self.commands.entry(device).or_insert(0);
            *count += 1;
            let count = *count;
            let strikes = move |f: &&crate::config::FaultConfig| {
                f.device == device && count > f.after && f.times.is_none_or(|n| count <= f.after.saturating_add(n))
            };
            self.bench.config().faults.iter().find(strikes).map(|f| f.kind)
        };
        let (clock, fault) = (due(FaultyDevice::Clock), due(device));
        self.set_back = clock.is_some();
        if device == FaultyDevice::Interlock && (fault == Some(FaultKind::Opens)) != self.door_open {
            self.door_open = !self.door_open;
            self.door_changes += 1;
        }
        fault
    }

    /// A time as the devices' clock shows it.
    fn reported(&mut self, time: Duration) -> Duration {
        let now = EPOCH + time;
        if self.set_back { now - SET_BACK } else { now }
    }

    /// Switches the flash; returns when its light is steady.
    fn switch(&mut self, on: bool) -> Duration {
        let settling = Duration::from_secs_f64(self.bench.config().flash.settle_ms / 1000.0);
        self.bench.shine(Shining { flash: on, ..self.bench.shining() }, settling);
        self.bench.now() + settling
    }

    /// Requests that need no waiting.
    fn at_once(&mut self, request: &Request, fault: Option<FaultKind>) -> DeviceResult<Reply> {
        let now = self.bench.now();
        let shining = self.bench.shining();
        Ok(match *request {
            Request::Describe => Reply::Described(Box::new(describe(self.bench.config()))),
            Request::Halt => {
                self.bench.halt_analyser();
                self.turning = None;
                Reply::At(self.reported(now))
            }
            Request::Now => Reply::At(EPOCH + now),
            Request::Position if fault == Some(FaultKind::Nonsense) => Reply::Angle(f64::NAN),
            Request::Position => Reply::Angle(self.bench.analyser_deg()),
            Request::Configure { exposure, gain } => {
                self.bench.set_camera(exposure.as_secs_f64(), gain);
                Reply::Controls(Controls { exposure, gain, set_at: self.reported(now) })
            }
            Request::Cover { closed } => {
                self.bench.shine(Shining { covered: closed, ..shining }, Duration::ZERO);
                Reply::At(self.reported(now))
            }
            Request::Show { pattern } => {
                self.bench.shine(Shining { pattern, ..shining }, Duration::ZERO);
                let wrong = Pattern::Disc { center_mm: [0.0, 0.0], diameter_mm: 1.0 };
                let acknowledged = if fault == Some(FaultKind::OtherPattern) { wrong } else { pattern };
                Reply::Shown(Shown { since: self.reported(now), pattern: acknowledged })
            }
            Request::IsOn => Reply::On(shining.flash != (fault == Some(FaultKind::WrongState))),
            Request::Level => Reply::Level(Level { holds: !self.door_open, changes: self.door_changes }),
            Request::Light => Reply::Light { panel: shining.pattern != Pattern::Black, flash: shining.flash },
            // Answered before.
            Request::Home
            | Request::MoveTo { .. }
            | Request::Arrive
            | Request::NextFrame { .. }
            | Request::Switch { .. } => {
                return Err(error(request, "a known request", "another"));
            }
        })
    }
}

impl Clock for SharedBench {
    fn now(&self) -> Duration {
        EPOCH + self.lock().bench.now()
    }

    fn wait(&self, duration: Duration) {
        let until = self.lock().bench.now() + duration;
        self.wait_until(until);
    }
}

fn device(request: &Request) -> Option<FaultyDevice> {
    match request {
        Request::Home | Request::MoveTo { .. } | Request::Position | Request::Halt => Some(FaultyDevice::Stage),
        Request::Configure { .. } | Request::Cover { .. } | Request::NextFrame { .. } => Some(FaultyDevice::Camera),
        Request::Show { .. } => Some(FaultyDevice::Display),
        Request::Switch { .. } | Request::IsOn => Some(FaultyDevice::Flash),
        Request::Level => Some(FaultyDevice::Interlock),
        Request::Describe | Request::Light | Request::Arrive | Request::Now => None,
    }
}

/// Names of the simulated devices, which are their identities.
fn name(device: Option<FaultyDevice>) -> &'static str {
    match device {
        Some(FaultyDevice::Stage) => "simulated stage",
        Some(FaultyDevice::Camera) => "simulated camera",
        Some(FaultyDevice::Display) => "simulated panel",
        Some(FaultyDevice::Flash) => "simulated flash",
        Some(FaultyDevice::Interlock) => "simulated door switch",
        Some(FaultyDevice::Clock) | None => "simulated bench",
    }
}

/// A retry may help, until it is said otherwise.
pub(crate) fn error(request: &Request, expected: &str, got: &str) -> DeviceError {
    let command = match request {
        Request::Describe | Request::Light => "describe itself".to_owned(),
        Request::Now => "tell the time".into(),
        Request::Home => "home".into(),
        Request::Arrive => "arrive".into(),
        Request::Halt => "halt".into(),
        Request::MoveTo { angle_deg } => format!("move to {angle_deg}°"),
        Request::Position => "report its position".into(),
        Request::Configure { exposure, gain } => {
            format!("set an exposure of {} s and a gain of {gain}", exposure.as_secs_f64())
        }
        Request::Cover { closed: true } => "close the shutter".into(),
        Request::Cover { closed: false } => "open the shutter".into(),
        Request::NextFrame { .. } => "take a frame".into(),
        Request::Show { .. } => "show a pattern".into(),
        Request::Switch { on } => format!("switch {}", if *on { "on" } else { "off" }),
        Request::IsOn => "report its state".into(),
        Request::Level => "report its level".into(),
    };
    DeviceError::new(name(device(request)), command, expected, got).class(Class::Retry)
}

/// What the devices of a bench are and can do, without building it.
pub fn describe(bench: &BenchConfig) -> Devices {
    let (stage, camera) = (&bench.stage, &bench.camera);
    let id = |device| name(Some(device)).to_owned();
    Devices {
        stage: StageInfo {
            id: id(FaultyDevice::Stage),
            speed_deg_s: stage.speed_deg_s,
            settling_s: stage.settle_ms / 1000.0,
            limits_deg: stage.limits_deg,
            tolerance_deg: 0.5,
            approach_deg: 5.0,
            longest_s: (stage.limits_deg[1] - stage.limits_deg[0]) / stage.speed_deg_s + stage.settle_ms / 1000.0,
            halts: true,
            by_hand: false,
        },
        camera: CameraInfo {
            id: id(FaultyDevice::Camera),
            width: camera.width as usize,
            height: camera.height as usize,
            exposure_s: [1e-5, 60.0],
            exposure_now_s: camera.power_on_exposure_s(),
            gain: [1.0, 100.0],
            black: camera.black_level as u16,
            white: ((1u32 << camera.bits) - 1) as u16,
            readout_s: camera.readout_ms / 1000.0,
            control_lag_frames: camera.lag_frames,
            shutter: true,
            full_scale_e: Some(camera.well_e),
            read_noise_e: Some(camera.read_noise_e),
            steady_exposures_s: vec![],
            warnings: vec![],
        },
        display: DisplayInfo { id: id(FaultyDevice::Display), size_mm: bench.panel.size_mm },
        flash: FlashInfo {
            id: id(FaultyDevice::Flash),
            settling_s: bench.flash.settle_ms / 1000.0,
            max_on_s: bench.flash.max_on_s,
        },
        interlock: InterlockInfo { id: id(FaultyDevice::Interlock) },
        pixel_um: 1000.0 * bench.sample.field_mm() / f64::from(camera.width.min(camera.height)),
        bench: bench.clone(),
    }
}

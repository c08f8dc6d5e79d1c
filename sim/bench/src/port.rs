//! Entry point of the bench: every request to a simulated device passes through [`SharedBench::answer`], which applies
//! faults.

use crate::bench::{Bench, Shining};
use crate::config::{FaultKind, FaultyDevice};
use crate::messages::{EXPOSURE_S, GAIN, Reply, Request, describe, device, error};
use nacre_drivers::{Arrived, Class, Clock, Controls, DeviceResult, Freshness, Level, Pattern, Shown, Stamp, Switched};
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Time after which a driver gives up without an answer.
const SILENCE: Duration = Duration::from_secs(5);

/// Interval of answers about a movement on a bench in real time.
const MOMENT: Duration = Duration::from_millis(20);

/// Start of the clock, so that a fault can set it back.
const EPOCH: Duration = Duration::from_secs(100_000);

/// Time by which a fault sets the clock back.
const SET_BACK: Duration = Duration::from_secs(3600);

/// A bench shared by several devices, in virtual or real time.
#[derive(Clone)]
pub struct SharedBench {
    state: Arc<Mutex<State>>,
    /// Start of the bench's time, if it runs in real time.
    begun: Option<Instant>,
}

struct State {
    bench: Bench,
    /// Number of commands so far, which selects faults.
    commands: BTreeMap<FaultyDevice, u64>,
    set_back: bool,
    door_open: bool,
    door_changes: u64,
    /// End of the movement under way, and the angle reported then.
    turning: Option<(Duration, f64)>,
}

impl SharedBench {
    /// Shares a bench in virtual time: only calls of its devices advance it.
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

    /// Shares a bench in real time.
    pub fn real_time(bench: Bench) -> Self {
        Self { begun: Some(Instant::now()), ..Self::new(bench) }
    }

    /// Gives read access to the bench.
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

    /// Waits without locking the bench, so that other devices continue.
    fn wait_until(&self, time: Duration) {
        if let Some(begun) = self.begun {
            std::thread::sleep(time.saturating_sub(begun.elapsed()));
        }
        self.lock().bench.advance_to(time);
    }

    /// Closes the panel's connection: the panel goes black, whatever its faults.
    pub(crate) fn close_panel(&self) {
        let mut state = self.lock();
        let shining = state.bench.shining();
        state.bench.shine(Shining { pattern: Pattern::Black, ..shining }, Duration::ZERO);
    }

    /// Executes a request.
    ///
    /// # Errors
    /// Requests beyond the bench's limits, and faults.
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
    /// Counts a device's next command and returns its fault.
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

    /// A time on the devices' clock, faults included.
    fn reported(&mut self, time: Duration) -> Duration {
        let now = EPOCH + time;
        if self.set_back { now - SET_BACK } else { now }
    }

    /// Switches the flash; returns the time at which its light is steady.
    fn switch(&mut self, on: bool) -> Duration {
        let settling = Duration::from_secs_f64(self.bench.config().flash.settle_ms / 1000.0);
        self.bench.shine(Shining { flash: on, ..self.bench.shining() }, settling);
        self.bench.now() + settling
    }

    /// Executes requests without waiting.
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
                let within = |[low, high]: [f64; 2], value: f64| (low..=high).contains(&value);
                if !within(EXPOSURE_S, exposure.as_secs_f64()) || !within(GAIN, gain) {
                    let ([short, long], [least, most]) = (EXPOSURE_S, GAIN);
                    let expected = format!("an exposure of {short} to {long} s and a gain of {least} to {most}");
                    let got = format!("{} s and {gain}", exposure.as_secs_f64());
                    return Err(error(request, &expected, &got).remedy("correct the plan").class(Class::Setup));
                }
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
            // Handled by [`SharedBench::answer`].
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

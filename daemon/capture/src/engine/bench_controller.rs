//! Device commands of the engine: one command to one device at a time, with each response checked against the request.

use super::{Activity, Observer};
use crate::plan::{Limits, approach};
use nacre_drivers::{
    Camera, Class, Controls, DeviceError, DeviceResult, Display, Flash, Frame, Freshness, Pattern, Shown, Stage, Stamp,
};
use std::time::{Duration, Instant};

/// Number of stale frames above which a camera counts as broken, not counting frames during settling times of light and
/// stage.
const MAX_STALE: u32 = 200;

/// Lower bound of a frame's duration in s; no camera is faster.
const SHORTEST_FRAME_S: f64 = 1e-3;

/// Relative tolerance between requested and actual exposure or gain.
const CONTROL_TOLERANCE: f64 = 0.05;

/// Tolerance for non-monotonic times reported by devices.
const CLOCK_TOLERANCE: Duration = Duration::from_secs(1);

/// Devices of a bench.
pub struct Devices {
    /// Stage that rotates the analyser.
    pub stage: Box<dyn Stage>,
    /// Camera.
    pub camera: Box<dyn Camera>,
    /// Panel that lights the sample.
    pub display: Box<dyn Display>,
    /// Flash, if any.
    pub flash: Option<Box<dyn Flash>>,
}

/// Checked device commands, with the resulting state.
pub struct BenchController<'a> {
    devices: &'a mut Devices,
    limits: Limits,
    /// Known state of the devices.
    pub memory: Memory,
    /// Time spent on device commands.
    pub stopwatch: Stopwatch,
    /// Analyser angle in degrees, once known, of a session whose plan does not rotate the analyser.
    pub fixed_analyser_deg: Option<f64>,
    observer: Option<&'a dyn Observer>,
}

/// State of the devices, kept between tasks.
#[derive(Clone, Copy, Debug, Default)]
pub struct Memory {
    angle: f64,
    requested: Option<(Duration, f64)>,
    controls: Option<Controls>,
    freshness: Freshness,
    flash_since: Option<Duration>,
    last_frame: Option<Stamp>,
    /// Time since which each device last reported to be steady.
    reported: [Duration; 4],
}

/// Source of a time; each device has a different settling time.
#[derive(Clone, Copy)]
enum TimeSource {
    Stage,
    Camera,
    Display,
    Flash,
}

/// Working time, on the devices' clock and on the wall clock.
#[derive(Default)]
pub struct Stopwatch {
    /// First and last time reported by devices since the last pause.
    span: Option<(Duration, Duration)>,
    before: Duration,
    /// Time on the wall clock spent waiting for devices.
    pub waited: Duration,
}

impl Stopwatch {
    /// Time on the devices' clock.
    pub fn device_time(&self) -> Duration {
        self.before + self.span.map_or(Duration::ZERO, |(first, last)| last - first)
    }

    /// Excludes the time until the next report.
    pub fn pause(&mut self) {
        (self.before, self.span) = (self.device_time(), None);
    }
}

impl Devices {
    /// Limits of the devices.
    pub fn limits(&self) -> Limits {
        Limits {
            stage: self.stage.describe(),
            camera: self.camera.describe(),
            display: self.display.describe(),
            flash: self.flash.as_ref().map(|f| f.describe()),
        }
    }
}

impl<'a> BenchController<'a> {
    /// Takes control of devices in unknown state.
    pub fn new(devices: &'a mut Devices) -> Self {
        Self::with(devices, Memory::default())
    }

    /// Takes control of devices in a known state.
    pub fn with(devices: &'a mut Devices, memory: Memory) -> Self {
        let limits = devices.limits();
        Self { devices, limits, memory, stopwatch: Stopwatch::default(), fixed_analyser_deg: None, observer: None }
    }

    /// Tells an observer each activity.
    pub fn observed(self, observer: &'a dyn Observer) -> Self {
        Self { observer: Some(observer), ..self }
    }

    /// Tells the observer, if any, that an activity begins.
    pub(super) fn tell(&self, activity: Activity) {
        if let Some(observer) = self.observer {
            observer.doing(activity);
        }
    }

    /// Limits of the devices.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Brings the devices into a known state: light off, and stage homed if `turn` is set. Earlier settings are not
    /// relied upon.
    ///
    /// # Errors
    /// Those of the devices.
    pub async fn prepare(&mut self, turn: bool) -> DeviceResult<()> {
        // The on-time of a lit flash must still be limited.
        self.memory = Memory { flash_since: self.memory.flash_since, ..Memory::default() };
        self.dark().await?;
        if turn { self.home().await } else { Ok(()) }
    }

    /// Homes the stage.
    ///
    /// # Errors
    /// Those of the stage.
    pub async fn home(&mut self) -> DeviceResult<()> {
        self.tell(Activity::Homing);
        let arrived = timed(&mut self.stopwatch, self.devices.stage.home()).await?;
        self.memory.angle = 0.0;
        self.record_steady(TimeSource::Stage, arrived.since, "home")
    }

    /// Switches all light off. Every lamp is tried, even after failures of others.
    ///
    /// # Errors
    /// That of the first lamp that does not confirm.
    pub async fn dark(&mut self) -> DeviceResult<()> {
        let flash = match self.devices.flash {
            Some(_) => self.switch(false).await,
            None => Ok(()),
        };
        let shown = timed(&mut self.stopwatch, self.devices.display.dark()).await;
        let panel = shown.and_then(|shown| self.check_shown(shown, Pattern::Black));
        flash.and(panel)
    }

    /// Checks that the light is still as requested, at the end of an exposure.
    ///
    /// # Errors
    /// `Stop` if the flash went off by itself; those of the panel.
    pub(crate) async fn still_lit(&mut self, flash: bool) -> DeviceResult<()> {
        timed(&mut self.stopwatch, self.devices.display.still_shows()).await?;
        if flash { self.flash_still_on().await } else { Ok(()) }
    }

    /// Checks that the flash is still on, at the end of its on-time.
    ///
    /// # Errors
    /// `Stop` if the flash went off by itself.
    pub async fn flash_still_on(&mut self) -> DeviceResult<()> {
        if !self.is_lit().await? {
            let device = self.limits.flash.as_ref().map_or("flash", |f| f.id.as_str());
            return Err(DeviceError::new(device, "switch on and stay on during the exposure", "on", "off").remedy(
                "check lamp, supply and whether anything else switches it (by hand?), then resume the session",
            ));
        }
        Ok(())
    }

    /// Sets exposure and gain, and waits until frames are certain to use them.
    ///
    /// # Errors
    /// Those of the camera; `Setup` if it sets another value.
    pub async fn expose(&mut self, exposure: Duration, gain: f64) -> DeviceResult<()> {
        if self.memory.requested == Some((exposure, gain)) {
            return Ok(());
        }
        let controls = timed(&mut self.stopwatch, self.devices.camera.configure(exposure, gain)).await?;
        let within_tolerance = |is: f64, requested: f64| (is / requested - 1.0).abs() <= CONTROL_TOLERANCE;
        if !(within_tolerance(controls.exposure.as_secs_f64(), exposure.as_secs_f64())
            && within_tolerance(controls.gain, gain))
        {
            let expected = format!("an exposure of {} s and a gain of {gain}", exposure.as_secs_f64());
            let got = format!("{} s and {}", controls.exposure.as_secs_f64(), controls.gain);
            return Err(DeviceError::new(&self.limits.camera.id, "set exposure and gain", expected, got)
                .remedy("choose an exposure that the camera can do")
                .class(Class::Setup));
        }
        self.record_steady(TimeSource::Camera, controls.set_at, "set exposure and gain")?;
        let lag = self.limits.camera.control_lag_frames;
        let mut first = None;
        let most = self.most_stale();
        for _ in 0..most {
            let stamp = self.next_frame(Freshness::NEVER).await?.stamp;
            first = first.or_else(|| Freshness::first_with_controls(stamp, controls.set_at, lag));
            // Frames from this one on postdate the change of controls, so later changes of the bench come after it.
            if let Some(first) = first.filter(|f| stamp.sequence + 1 >= *f) {
                self.memory.freshness.first_sequence = first;
                self.memory.freshness.duration =
                    controls.exposure + Duration::from_secs_f64(self.limits.camera.readout_s);
                (self.memory.requested, self.memory.controls) = (Some((exposure, gain)), Some(controls));
                return Ok(());
            }
        }
        Err(self.stale_error(most))
    }

    /// Exposure and gain in use.
    pub fn controls(&self) -> Option<Controls> {
        self.memory.controls
    }

    /// Closes or opens the shutter, if any.
    ///
    /// # Errors
    /// Those of the camera.
    pub async fn cover(&mut self, closed: bool) -> DeviceResult<()> {
        if !self.limits.camera.shutter {
            return Ok(());
        }
        let since = timed(&mut self.stopwatch, self.devices.camera.cover(closed)).await?;
        self.record_steady(TimeSource::Camera, since, "close or open the shutter")
    }

    /// Shows a pattern.
    ///
    /// # Errors
    /// Those of the panel; `Retry` if it acknowledges another pattern.
    pub async fn show(&mut self, pattern: Pattern) -> DeviceResult<()> {
        self.tell(Activity::Lighting);
        let shown = timed(&mut self.stopwatch, self.devices.display.show(pattern)).await?;
        self.check_shown(shown, pattern)
    }

    /// Checks that the panel acknowledges the requested pattern.
    fn check_shown(&mut self, shown: Shown, pattern: Pattern) -> DeviceResult<()> {
        if shown.pattern != pattern {
            let (expected, got) = (format!("{pattern:?}"), format!("{:?}", shown.pattern));
            return Err(DeviceError::new(&self.limits.display.id, "show a pattern", expected, got)
                .remedy("check that nothing else draws on the panel, then resume the session")
                .class(Class::Retry));
        }
        self.record_steady(TimeSource::Display, shown.since, "show a pattern")
    }

    /// Rotates the analyser, approaching the angle from below.
    ///
    /// # Errors
    /// Those of the stage; `Stop` if it reports another angle.
    pub async fn turn(&mut self, to: f64) -> DeviceResult<()> {
        self.tell(Activity::Turning { analyser_deg: to });
        for stop in approach(self.memory.angle, to, &self.limits.stage) {
            let arrived = timed(&mut self.stopwatch, self.devices.stage.move_to(stop)).await?;
            // The comparison is false for NaN.
            let there = (arrived.angle_deg - stop).abs() <= self.limits.stage.tolerance_deg;
            if !there {
                let (command, got) = (format!("move to {stop}°"), format!("{}°", arrived.angle_deg));
                let expected = format!("{stop}° within {}°", self.limits.stage.tolerance_deg);
                let remedy = "check that it turns freely and is plugged in firmly, then resume the session";
                return Err(DeviceError::new(&self.limits.stage.id, command, expected, got).remedy(remedy));
            }
            self.memory.angle = stop;
            self.record_steady(TimeSource::Stage, arrived.since, "move")?;
        }
        Ok(())
    }

    /// Determines the analyser angle without homing.
    ///
    /// # Errors
    /// As [`Self::position`].
    pub async fn find(&mut self) -> DeviceResult<()> {
        self.memory.angle = self.position().await?;
        Ok(())
    }

    /// Angle reported by the stage.
    ///
    /// # Errors
    /// Those of the stage; `Retry` for a value that is not a number.
    pub async fn position(&mut self) -> DeviceResult<f64> {
        let angle = timed(&mut self.stopwatch, self.devices.stage.position()).await?;
        if !angle.is_finite() {
            return Err(DeviceError::new(&self.limits.stage.id, "report its position", "an angle", format!("{angle}"))
                .class(Class::Retry));
        }
        Ok(angle)
    }

    /// Switches the flash.
    ///
    /// # Errors
    /// Those of the flash; `Stop` if it reads back another state, or was on for too long.
    pub async fn switch(&mut self, on: bool) -> DeviceResult<()> {
        let (Some(flash), Some(info)) = (&mut self.devices.flash, &self.limits.flash) else {
            return Err(DeviceError::new("flash", "switch", "a flash", "none").class(Class::Setup));
        };
        let command = if on { "switch on" } else { "switch off" };
        let word = |on| if on { "on" } else { "off" };
        let switched = timed(&mut self.stopwatch, flash.switch(on)).await.map_err(may_be_lit)?;
        if switched.on != on {
            let remedy = "switch it off by hand and check its wiring, then resume the session";
            return Err(DeviceError::new(&info.id, command, word(on), word(switched.on)).remedy(remedy));
        }
        let lit = self.memory.flash_since.take().map(|since| switched.since.saturating_sub(since).as_secs_f64());
        if let Some(seconds) = lit.filter(|s| *s > info.max_on_s) {
            let (expected, got) = (format!("at most {} s of light", info.max_on_s), format!("{seconds:.1} s"));
            let remedy = "expose shorter or average less";
            return Err(DeviceError::new(&info.id, command, expected, got).remedy(remedy));
        }
        self.memory.flash_since = on.then_some(switched.since);
        self.record_steady(TimeSource::Flash, switched.since, command)
    }

    /// True if the flash reports to be on.
    ///
    /// # Errors
    /// Those of the flash.
    pub async fn is_lit(&mut self) -> DeviceResult<bool> {
        match &mut self.devices.flash {
            Some(flash) => timed(&mut self.stopwatch, flash.is_on()).await.map_err(may_be_lit),
            None => Ok(false),
        }
    }

    /// Drops frames until one shows the present state of the bench; returns it with the number of dropped frames.
    ///
    /// # Errors
    /// Those of the camera; `Stop` if it delivers only stale frames.
    pub async fn fresh(&mut self) -> DeviceResult<(Frame, u32)> {
        self.tell(Activity::exposing(self.memory.controls.map_or(Duration::ZERO, |c| c.exposure)));
        let most = self.most_stale();
        for dropped in 0..most {
            let frame = self.next_frame(self.memory.freshness).await?;
            if self.memory.freshness.accepts(frame.stamp) {
                return Ok((frame, dropped));
            }
        }
        Err(self.stale_error(most))
    }

    /// Criterion for fresh frames in the present state.
    pub(crate) fn freshness(&self) -> Freshness {
        self.memory.freshness
    }

    /// Next frame, complete and of the announced size; without its codes if it is stale.
    ///
    /// # Errors
    /// Those of the camera; `Stop` for another size, and for a clock that runs backwards; `Retry` for a damaged frame.
    pub async fn next_frame(&mut self, fresh: Freshness) -> DeviceResult<Frame> {
        let taken = timed(&mut self.stopwatch, self.devices.camera.next_frame(fresh)).await;
        if taken.as_ref().is_err_and(|e| e.class == Class::Lost) {
            // A reconnected camera starts with default settings.
            self.memory.requested = None;
        }
        let frame = taken?;
        let info = &self.limits.camera;
        let error = |expected: String, got: String| DeviceError::new(&info.id, "take a frame", expected, got);
        let pixels = if fresh.accepts(frame.stamp) { info.width * info.height } else { frame.codes.len() };
        if (frame.width, frame.height, frame.codes.len()) != (info.width, info.height, pixels) {
            let got = format!("{} × {} with {} values", frame.width, frame.height, frame.codes.len());
            let remedy = "set the camera's format back, then resume the session";
            return Err(error(format!("{} × {} pixels", info.width, info.height), got).remedy(remedy));
        }
        let Stamp { sequence, timestamp } = frame.stamp;
        let late = |last: &Stamp| sequence <= last.sequence || timestamp <= last.timestamp;
        if let Some(last) = self.memory.last_frame.filter(late) {
            let expected = format!("a frame after number {} at {:.3} s", last.sequence, last.timestamp.as_secs_f64());
            let got = format!("number {sequence} at {:.3} s", timestamp.as_secs_f64());
            let remedy = "the clock was set back: let it run evenly, then resume the session";
            return Err(error(expected, got).remedy(remedy));
        }
        if frame.damaged {
            let remedy = "check cable and USB hub, then resume the session";
            return Err(error("a whole frame".into(), "one with its error flag set".into())
                .remedy(remedy)
                .class(Class::Retry));
        }
        self.memory.last_frame = Some(frame.stamp);
        let (_, last) = self.stopwatch.span.get_or_insert((timestamp, timestamp));
        *last = timestamp.max(*last);
        Ok(frame)
    }

    /// Records a change, steady since this time.
    fn record_steady(&mut self, source: TimeSource, since: Duration, command: &str) -> DeviceResult<()> {
        // The camera reports a time only when its exposure is set. There may be no earlier one, so it is also compared
        // with the times of other devices, which may be ahead by their settling time.
        let others = match source {
            TimeSource::Camera => self.memory.reported.iter().max().copied().unwrap_or_default(),
            _ => Duration::ZERO,
        };
        let settling = self.limits.flash.as_ref().map_or(0.0, |f| f.settling_s).max(self.limits.stage.settling_s);
        let others = others.saturating_sub(Duration::from_secs_f64(settling));
        let before = std::mem::replace(&mut self.memory.reported[source as usize], since).max(others);
        if since + CLOCK_TOLERANCE < before {
            let expected = format!("a time after {:.3} s", before.as_secs_f64());
            let got = format!("{:.3} s", since.as_secs_f64());
            let remedy = "the clock was set back: let it run evenly, then resume the session";
            return Err(DeviceError::new("the devices' clock", command, expected, got).remedy(remedy));
        }
        let freshness = &mut self.memory.freshness;
        freshness.steady_since = freshness.steady_since.max(since);
        let (_, last) = self.stopwatch.span.get_or_insert((since, since));
        *last = since.max(*last);
        Ok(())
    }

    /// Maximum number of stale frames before a fresh one.
    fn most_stale(&self) -> u32 {
        let flash = self.limits.flash.as_ref().map_or(0.0, |f| f.settling_s);
        let interval = self.memory.freshness.duration.as_secs_f64().max(SHORTEST_FRAME_S);
        MAX_STALE + (self.limits.stage.settling_s.max(flash) / interval).ceil() as u32
    }

    fn stale_error(&self, most: u32) -> DeviceError {
        let expected = format!("one among {most}");
        DeviceError::new(
            &self.limits.camera.id,
            "take a fresh frame",
            expected,
            "only frames from before the last change",
        )
        .remedy("check the camera's clock and control lag, then resume the session")
    }
}

/// A flash that does not answer may be on, which only a person can verify.
fn may_be_lit(error: DeviceError) -> DeviceError {
    let remedy = format!("the light may be on: see that it is off, by hand if need be; {}", error.remedy);
    if error.class == Class::Setup { error } else { error.remedy(remedy) }
}

/// Measures the time until a device has answered.
async fn timed<T>(stopwatch: &mut Stopwatch, call: impl Future<Output = T>) -> T {
    let begun = Instant::now();
    let answer = call.await;
    stopwatch.waited += begun.elapsed();
    answer
}

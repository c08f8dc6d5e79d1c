//! The engine's hands: one command to one device at a time, and what came back is compared with what was asked.

use crate::plan::{Limits, approach};
use nacre_drivers::{
    Camera, Class, Controls, DeviceError, DeviceResult, Display, Flash, Frame, Freshness, Pattern, Shown, Stage, Stamp,
};
use std::time::{Duration, Instant};

/// A camera this many frames behind is broken, apart from those that come while light and stage settle.
const MAX_STALE: u32 = 200;

/// No camera is faster.
const SHORTEST_FRAME_S: f64 = 1e-3;

/// An exposure or gain that the camera sets this far from what was asked (relative) is not what was asked.
const CONTROL_TOLERANCE: f64 = 0.05;

/// Devices report times in order, but for this.
const CLOCK_TOLERANCE: Duration = Duration::from_secs(1);

/// The devices of a bench.
pub struct Devices {
    /// Turns the analyser.
    pub stage: Box<dyn Stage>,
    /// Takes the frames.
    pub camera: Box<dyn Camera>,
    /// Lights the sample.
    pub display: Box<dyn Display>,
    /// Lights it too, if there is one.
    pub flash: Option<Box<dyn Flash>>,
}

/// Commands with their checks, and what they led to.
pub struct Hands<'a> {
    devices: &'a mut Devices,
    limits: Limits,
    /// What is known of the devices.
    pub memory: Memory,
    /// Time that the devices took.
    pub stopwatch: Stopwatch,
    /// Analyser angle of a session whose plan does not turn the analyser, once it is known.
    pub stood: Option<f64>,
}

/// What is known of the devices, from one piece of work to the next.
#[derive(Clone, Copy, Debug, Default)]
pub struct Memory {
    angle: f64,
    asked: Option<(Duration, f64)>,
    controls: Option<Controls>,
    freshness: Freshness,
    flash_since: Option<Duration>,
    last_frame: Option<Stamp>,
    /// What each device last said that it is steady since.
    reported: [Duration; 4],
}

/// Whose time it is. Each device settles for another time.
#[derive(Clone, Copy)]
enum Whose {
    Stage,
    Camera,
    Display,
    Flash,
}

/// Time at work: on the devices' own clock, and on the clock on the wall while waiting for them.
#[derive(Default)]
pub struct Stopwatch {
    /// First and last time that devices reported since the last pause.
    span: Option<(Duration, Duration)>,
    before: Duration,
    /// On the wall, waiting for devices.
    pub waited: Duration,
}

impl Stopwatch {
    /// Time on the devices' clock.
    pub fn device_time(&self) -> Duration {
        self.before + self.span.map_or(Duration::ZERO, |(first, last)| last - first)
    }

    /// What follows is not counted until the next report.
    pub fn pause(&mut self) {
        (self.before, self.span) = (self.device_time(), None);
    }
}

impl Devices {
    /// What they can do.
    pub fn limits(&self) -> Limits {
        Limits {
            stage: self.stage.describe(),
            camera: self.camera.describe(),
            display: self.display.describe(),
            flash: self.flash.as_ref().map(|f| f.describe()),
        }
    }
}

impl<'a> Hands<'a> {
    /// Takes the devices in hand; nothing is known of them.
    pub fn new(devices: &'a mut Devices) -> Self {
        Self::with(devices, Memory::default())
    }

    /// Takes the devices in hand again.
    pub fn with(devices: &'a mut Devices, memory: Memory) -> Self {
        let limits = devices.limits();
        Self { devices, limits, memory, stopwatch: Stopwatch::default(), stood: None }
    }

    /// What the devices can do.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// Brings the devices into a known state: light off and, if the analyser is to turn, the stage homed. Nothing that
    /// was set before is relied upon.
    ///
    /// # Errors
    /// As the devices answer.
    pub async fn prepare(&mut self, turn: bool) -> DeviceResult<()> {
        // A flash that was on is still to be timed.
        self.memory = Memory { flash_since: self.memory.flash_since, ..Memory::default() };
        self.dark().await?;
        if turn { self.home().await } else { Ok(()) }
    }

    /// Homes the stage.
    ///
    /// # Errors
    /// As the stage answers.
    pub async fn home(&mut self) -> DeviceResult<()> {
        let arrived = timed(&mut self.stopwatch, self.devices.stage.home()).await?;
        self.memory.angle = 0.0;
        self.steady(Whose::Stage, arrived.since, "home")
    }

    /// Switches all light off. Every lamp is tried, whatever the others say.
    ///
    /// # Errors
    /// The first lamp's that does not confirm.
    pub async fn dark(&mut self) -> DeviceResult<()> {
        let flash = match self.devices.flash {
            Some(_) => self.switch(false).await,
            None => Ok(()),
        };
        let shown = timed(&mut self.stopwatch, self.devices.display.dark()).await;
        let panel = shown.and_then(|shown| self.believe(shown, Pattern::Black));
        flash.and(panel)
    }

    /// That the light is still as it was asked for, at the end of what it was asked for.
    ///
    /// # Errors
    /// `Stop` when the flash went off by itself; as the panel answers.
    pub(crate) async fn still_lit(&mut self, flash: bool) -> DeviceResult<()> {
        timed(&mut self.stopwatch, self.devices.display.still_shows()).await?;
        if flash { self.flash_still_on().await } else { Ok(()) }
    }

    /// Checks that the flash is on, at the end of the time for which it was switched on.
    ///
    /// # Errors
    /// `Stop` when the flash went off by itself.
    pub async fn flash_still_on(&mut self) -> DeviceResult<()> {
        if !self.is_lit().await? {
            let device = self.limits.flash.as_ref().map_or("flash", |f| f.id.as_str());
            return Err(DeviceError::new(device, "switch on and stay on during the exposure", "on", "off").remedy(
                "check lamp, supply and whether anything else switches it (by hand?), then resume the session",
            ));
        }
        Ok(())
    }

    /// Sets exposure and gain, and waits until frames are sure to have them.
    ///
    /// # Errors
    /// As the camera answers; `Setup` when it sets something else.
    pub async fn expose(&mut self, exposure: Duration, gain: f64) -> DeviceResult<()> {
        if self.memory.asked == Some((exposure, gain)) {
            return Ok(());
        }
        let controls = timed(&mut self.stopwatch, self.devices.camera.configure(exposure, gain)).await?;
        let as_asked = |is: f64, asked: f64| (is / asked - 1.0).abs() <= CONTROL_TOLERANCE;
        if !(as_asked(controls.exposure.as_secs_f64(), exposure.as_secs_f64()) && as_asked(controls.gain, gain)) {
            let expected = format!("an exposure of {} s and a gain of {gain}", exposure.as_secs_f64());
            let got = format!("{} s and {}", controls.exposure.as_secs_f64(), controls.gain);
            return Err(DeviceError::new(&self.limits.camera.id, "set exposure and gain", expected, got)
                .remedy("choose an exposure that the camera can do")
                .class(Class::Setup));
        }
        self.steady(Whose::Camera, controls.set_at, "set exposure and gain")?;
        let lag = self.limits.camera.control_lag_frames;
        let mut first = None;
        let most = self.most_stale();
        for _ in 0..most {
            let stamp = self.next_frame(Freshness::NEVER).await?.stamp;
            first = first.or_else(|| Freshness::first_with_controls(stamp, controls.set_at, lag));
            // From here on changes of the bench come after this one.
            if let Some(first) = first.filter(|f| stamp.sequence + 1 >= *f) {
                self.memory.freshness.first_sequence = first;
                self.memory.freshness.duration =
                    controls.exposure + Duration::from_secs_f64(self.limits.camera.readout_s);
                (self.memory.asked, self.memory.controls) = (Some((exposure, gain)), Some(controls));
                return Ok(());
            }
        }
        Err(self.only_stale(most))
    }

    /// Exposure and gain in force.
    pub fn controls(&self) -> Option<Controls> {
        self.memory.controls
    }

    /// Closes or opens the shutter, where there is one.
    ///
    /// # Errors
    /// As the camera answers.
    pub async fn cover(&mut self, closed: bool) -> DeviceResult<()> {
        if !self.limits.camera.shutter {
            return Ok(());
        }
        let since = timed(&mut self.stopwatch, self.devices.camera.cover(closed)).await?;
        self.steady(Whose::Camera, since, "close or open the shutter")
    }

    /// Shows a pattern.
    ///
    /// # Errors
    /// As the panel answers; `Retry` when it acknowledges another pattern.
    pub async fn show(&mut self, pattern: Pattern) -> DeviceResult<()> {
        let shown = timed(&mut self.stopwatch, self.devices.display.show(pattern)).await?;
        self.believe(shown, pattern)
    }

    /// That the panel acknowledges what it was asked for.
    fn believe(&mut self, shown: Shown, pattern: Pattern) -> DeviceResult<()> {
        if shown.pattern != pattern {
            let (expected, got) = (format!("{pattern:?}"), format!("{:?}", shown.pattern));
            return Err(DeviceError::new(&self.limits.display.id, "show a pattern", expected, got)
                .remedy("check that nothing else draws on the panel, then resume the session")
                .class(Class::Retry));
        }
        self.steady(Whose::Display, shown.since, "show a pattern")
    }

    /// Turns the analyser, from below.
    ///
    /// # Errors
    /// As the stage answers; `Stop` when it reports to stand elsewhere.
    pub async fn turn(&mut self, to: f64) -> DeviceResult<()> {
        for stop in approach(self.memory.angle, to, &self.limits.stage) {
            let arrived = timed(&mut self.stopwatch, self.devices.stage.move_to(stop)).await?;
            // Not so for an angle that is no number, either.
            let there = (arrived.angle_deg - stop).abs() <= self.limits.stage.tolerance_deg;
            if !there {
                let (command, got) = (format!("move to {stop}°"), format!("{}°", arrived.angle_deg));
                let expected = format!("{stop}° within {}°", self.limits.stage.tolerance_deg);
                let remedy = "check that it turns freely and is plugged in firmly, then resume the session";
                return Err(DeviceError::new(&self.limits.stage.id, command, expected, got).remedy(remedy));
            }
            self.memory.angle = stop;
            self.steady(Whose::Stage, arrived.since, "move")?;
        }
        Ok(())
    }

    /// Learns where the analyser stands, without homing.
    ///
    /// # Errors
    /// As [`Self::position`].
    pub async fn find(&mut self) -> DeviceResult<()> {
        self.memory.angle = self.position().await?;
        Ok(())
    }

    /// Angle that the stage reports.
    ///
    /// # Errors
    /// As the stage answers; `Retry` for no number.
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
    /// As the flash answers; `Stop` when it reads back another state, or was on for too long.
    pub async fn switch(&mut self, on: bool) -> DeviceResult<()> {
        let (Some(flash), Some(info)) = (&mut self.devices.flash, &self.limits.flash) else {
            return Err(DeviceError::new("flash", "switch", "a flash", "none").class(Class::Setup));
        };
        let command = if on { "switch on" } else { "switch off" };
        let word = |on| if on { "on" } else { "off" };
        let switched = timed(&mut self.stopwatch, flash.switch(on)).await.map_err(perhaps_lit)?;
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
        self.steady(Whose::Flash, switched.since, command)
    }

    /// Whether the flash reports to be on.
    ///
    /// # Errors
    /// As the flash answers.
    pub async fn is_lit(&mut self) -> DeviceResult<bool> {
        match &mut self.devices.flash {
            Some(flash) => timed(&mut self.stopwatch, flash.is_on()).await.map_err(perhaps_lit),
            None => Ok(false),
        }
    }

    /// Drops frames until one shows the bench as it is now; returns it with how many were dropped.
    ///
    /// # Errors
    /// As the camera answers; `Stop` when it delivers only stale frames.
    pub async fn fresh(&mut self) -> DeviceResult<(Frame, u32)> {
        let most = self.most_stale();
        for dropped in 0..most {
            let frame = self.next_frame(self.memory.freshness).await?;
            if self.memory.freshness.accepts(frame.stamp) {
                return Ok((frame, dropped));
            }
        }
        Err(self.only_stale(most))
    }

    /// The rule that frames are accepted by now.
    pub(crate) fn freshness(&self) -> Freshness {
        self.memory.freshness
    }

    /// The next frame, whole and of the size that the camera promised; without its codes if it is not fresh.
    ///
    /// # Errors
    /// As the camera answers; `Stop` for another size and for a clock that runs backwards, `Retry` for a damaged frame.
    pub async fn next_frame(&mut self, fresh: Freshness) -> DeviceResult<Frame> {
        let taken = timed(&mut self.stopwatch, self.devices.camera.next_frame(fresh)).await;
        if taken.as_ref().is_err_and(|e| e.class == Class::Lost) {
            // It comes back with settings of its own.
            self.memory.asked = None;
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

    /// Something changed and is steady since then.
    fn steady(&mut self, whose: Whose, since: Duration, command: &str) -> DeviceResult<()> {
        // The camera reports a time only when its exposure is set. There may be no earlier one, so it is also compared with the times of other
        // devices, which may be ahead by their settling time.
        let others = match whose {
            Whose::Camera => self.memory.reported.iter().max().copied().unwrap_or_default(),
            _ => Duration::ZERO,
        };
        let settling = self.limits.flash.as_ref().map_or(0.0, |f| f.settling_s).max(self.limits.stage.settling_s);
        let others = others.saturating_sub(Duration::from_secs_f64(settling));
        let before = std::mem::replace(&mut self.memory.reported[whose as usize], since).max(others);
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

    /// So many frames may come until one is fresh.
    fn most_stale(&self) -> u32 {
        let flash = self.limits.flash.as_ref().map_or(0.0, |f| f.settling_s);
        let interval = self.memory.freshness.duration.as_secs_f64().max(SHORTEST_FRAME_S);
        MAX_STALE + (self.limits.stage.settling_s.max(flash) / interval).ceil() as u32
    }

    fn only_stale(&self, most: u32) -> DeviceError {
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

/// A flash that does not answer may be on, and only a person can tell.
fn perhaps_lit(error: DeviceError) -> DeviceError {
    let remedy = format!("the light may be on: see that it is off, by hand if need be; {}", error.remedy);
    if error.class == Class::Setup { error } else { error.remedy(remedy) }
}

/// Counts the time until a device has answered.
async fn timed<T>(stopwatch: &mut Stopwatch, call: impl Future<Output = T>) -> T {
    let begun = Instant::now();
    let answer = call.await;
    stopwatch.waited += begun.elapsed();
    answer
}

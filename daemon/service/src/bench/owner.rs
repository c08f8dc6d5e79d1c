//! The thread that owns the devices: manual operations, and supervision of the light between them.

use super::{Common, Job, locked};
use nacre_base::progress::{Progress, Silent};
use nacre_capture::Failure;
use nacre_capture::engine::{
    BenchController, Control, Input, Memory, PanelFound, Watch, drawn_by, guarded, measure_panel, meter_preview,
};
use nacre_capture::rig::{Place, Rig, Uses, runtime};
use nacre_drivers::display::DisplayConfig;
use nacre_drivers::{DeviceResult, Freshness, Pattern};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;

/// Interval of interlock checks while light is on.
const INTERLOCKS: Duration = Duration::from_millis(50);

/// Age at which a preview frame is replaced by a new one.
const PREVIEW_AGE: Duration = Duration::from_millis(200);

/// A frame that took longer than this to arrive was not in the camera's queue.
const QUEUED: Duration = Duration::from_millis(3);

/// Most queued frames that are discarded before a preview.
const QUEUE: u32 = 8;

/// The devices and their state, on their own thread.
pub struct Owner {
    /// Executor of the device calls.
    pub runtime: Runtime,
    /// The devices.
    pub rig: Rig,
    /// Pattern on the panel.
    pub pattern: Pattern,
    /// Exposure and gain of the preview.
    pub settings: (Duration, f64),
    /// Last known analyser angle in degrees.
    pub analyser_deg: Option<f64>,
    /// Time at which the flash is switched off.
    flash_until: Option<Instant>,
    /// Number of STOP requests when the current job was submitted.
    pub(super) asked: u64,
    memory: Memory,
    newest: Option<Arc<Picture>>,
    pub(super) shared: Arc<Common>,
}

/// A frame of the preview.
pub struct Picture {
    /// Number of the frame.
    pub sequence: u64,
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Sensor codes, row 0 on top.
    pub codes: Vec<u16>,
    /// Codes of black and white.
    pub range: [u16; 2],
    /// End of its exposure.
    pub(crate) taken: Instant,
}

impl Owner {
    pub(super) fn open(place: &Place, shared: Arc<Common>) -> Result<Self, Failure> {
        let runtime = runtime()?;
        let rig = Rig::open(&runtime, place, Uses::SESSION, &Silent, &shared.end)?;
        let camera = rig.devices.camera.describe();
        let exposure = Duration::from_secs_f64(camera.exposure_now_s.clamp(camera.exposure_s[0], camera.exposure_s[1]));
        let mut owner = Self {
            runtime,
            rig,
            pattern: Pattern::Black,
            settings: (exposure, camera.gain[0].max(1.0)),
            analyser_deg: None,
            flash_until: None,
            asked: 0,
            memory: Memory::default(),
            newest: None,
            shared,
        };
        owner.dark()?;
        owner.analyser_deg = owner.runtime.block_on(owner.rig.devices.stage.position()).ok();
        Ok(owner)
    }

    /// Runs jobs until the queue is closed.
    pub(super) fn serve(&mut self, queue: &mpsc::Receiver<Job>) {
        let mut looked = Instant::now();
        loop {
            match queue.recv_timeout(self.patience()) {
                Ok(job) => job(self),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            // Light is supervised between jobs, however many wait.
            if self.is_lit() && looked.elapsed() >= INTERLOCKS {
                self.look_after_light();
                looked = Instant::now();
            }
        }
        let _ = self.dark();
    }

    fn is_lit(&self) -> bool {
        self.pattern != Pattern::Black || self.flash_until.is_some()
    }

    /// Time until the next interlock check or the end of the flash.
    fn patience(&self) -> Duration {
        if self.is_lit() { INTERLOCKS } else { Duration::from_secs(3600) }
    }

    /// Switches manual light off at its time and when an interlock opens. A flash that went off by itself counts as
    /// off.
    fn look_after_light(&mut self) {
        if self.runtime.block_on(self.rig.watch.check()).is_err() {
            // A lamp that stays on reports its error to the next request for it.
            let _ = self.dark();
        } else if self.flash_until.is_some_and(|until| Instant::now() >= until || !self.flash_reports_on()) {
            let _ = self.flash(None);
        }
    }

    fn flash_reports_on(&mut self) -> bool {
        let mut hands = BenchController::with(&mut self.rig.devices, self.memory);
        self.runtime.block_on(hands.is_lit()) == Ok(true)
    }

    /// Runs an operation that STOP and these interlocks abort.
    fn steered<T>(
        &mut self,
        watched: bool,
        work: impl AsyncFnOnce(&mut BenchController<'_>) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let control = Arc::new(Control::default());
        let _ = control.send(Input::Start);
        *locked(&self.shared.manual) = Some(control.clone());
        // An earlier STOP is detected here; a later one reaches the control.
        if self.shared.stops.load(Ordering::SeqCst) != self.asked {
            let _ = control.send(Input::Abort);
        }
        let mut hands = BenchController::with(&mut self.rig.devices, self.memory);
        let unwatched = Watch::default();
        let watch = if watched { &self.rig.watch } else { &unwatched };
        let result = self.runtime.block_on(async {
            watch.begin_again().await;
            guarded(watch, &control, work(&mut hands)).await
        });
        self.memory = hands.memory;
        *locked(&self.shared.manual) = None;
        result
    }

    /// Runs a manual operation; a failure switches the light off.
    fn manual<T>(
        &mut self,
        work: impl AsyncFnOnce(&mut BenchController<'_>) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let result = self.steered(true, work);
        self.newest = None;
        if result.is_err() {
            let _ = self.dark();
        }
        result
    }

    /// Switches a device off, whatever interlocks and STOP say.
    fn off(&mut self, work: impl AsyncFnOnce(&mut BenchController<'_>) -> DeviceResult<()>) -> Result<(), Failure> {
        let mut hands = BenchController::with(&mut self.rig.devices, self.memory);
        let result = self.runtime.block_on(work(&mut hands));
        (self.memory, self.newest) = (hands.memory, None);
        Ok(result?)
    }

    /// Turns the analyser to an angle in degrees; `None` homes it.
    ///
    /// # Errors
    /// Those of devices and interlocks; `Cancelled` after STOP.
    pub fn turn(&mut self, to: Option<f64>) -> Result<(), Failure> {
        let moved = self.manual(async |hands| {
            match to {
                Some(to) => {
                    hands.find().await?;
                    hands.turn(to).await?;
                }
                None => hands.home().await?,
            }
            Ok(())
        });
        // An interrupted movement also has an end position.
        self.analyser_deg = self.runtime.block_on(self.rig.devices.stage.position()).ok();
        moved
    }

    /// Shows a pattern until another one is shown or the light is switched off.
    ///
    /// # Errors
    /// Those of devices and interlocks; `Cancelled` after STOP.
    pub fn show(&mut self, pattern: Pattern) -> Result<(), Failure> {
        match pattern {
            Pattern::Black => self.off(async |hands| hands.show(pattern).await)?,
            _ => self.manual(async |hands| Ok(hands.show(pattern).await?))?,
        }
        self.pattern = pattern;
        Ok(())
    }

    /// Switches the flash on for a time in seconds, or off (`None`).
    ///
    /// # Errors
    /// Those of devices and interlocks; `Cancelled` after STOP.
    pub fn flash(&mut self, on: Option<f64>) -> Result<(), Failure> {
        self.flash_until = None;
        match on {
            None => self.off(async |hands| hands.switch(false).await),
            Some(seconds) => {
                self.manual(async |hands| Ok(hands.switch(true).await?))?;
                self.flash_until = Some(Instant::now() + Duration::from_secs_f64(seconds));
                Ok(())
            }
        }
    }

    /// Sets the preview's exposure by metering the present light, at most `longest`.
    ///
    /// # Errors
    /// Those of devices and interlocks; no light; `Cancelled` after STOP.
    pub fn meter(&mut self, longest: Duration) -> Result<(), Failure> {
        let (pattern, (guess, gain)) = (self.pattern, self.settings);
        let exposure = self.manual(async |hands| meter_preview(hands, gain, pattern, guess).await)?;
        self.settings.0 = exposure.min(longest);
        Ok(())
    }

    /// Whether the flash is on.
    pub fn flash_is_on(&self) -> bool {
        self.flash_until.is_some()
    }

    /// Switches all light off.
    ///
    /// # Errors
    /// Those of the lamps.
    pub fn dark(&mut self) -> Result<(), Failure> {
        (self.flash_until, self.pattern) = (None, Pattern::Black);
        self.off(async |hands| hands.dark().await)
    }

    /// Measures the panel while the interlocks are closed; all light is off afterwards.
    ///
    /// # Errors
    /// Those of devices and interlocks; an error where the camera sees too little of the panel; `Cancelled` after
    /// STOP.
    pub fn measure(
        &mut self,
        levels: usize,
        display: Option<&DisplayConfig>,
        control: &Control,
        progress: &dyn Progress,
    ) -> Result<PanelFound, Failure> {
        let mut hands = BenchController::new(&mut self.rig.devices);
        let watch = &self.rig.watch;
        let found = self.runtime.block_on(async {
            watch.begin_again().await;
            guarded(watch, control, measure_panel(&mut hands, levels, display.and_then(drawn_by), progress)).await
        });
        let dark = self.dark();
        if dark.is_ok() {
            control.set_dark();
        }
        let found = found?;
        dark.map(|()| found)
    }

    /// Resets the known state after a session: the light is off, and the analyser angle is read from the stage.
    pub(super) fn forget(&mut self) {
        (self.memory, self.newest, self.flash_until, self.pattern) = (Memory::default(), None, None, Pattern::Black);
        self.analyser_deg = self.runtime.block_on(self.rig.devices.stage.position()).ok();
    }

    /// The newest frame. Only the camera is used, so interlocks are not checked.
    ///
    /// # Errors
    /// Those of the camera; `Cancelled` after STOP.
    pub fn preview(&mut self) -> Result<Arc<Picture>, Failure> {
        if let Some(picture) = self.newest.as_ref().filter(|p| p.taken.elapsed() < PREVIEW_AGE) {
            return Ok(picture.clone());
        }
        let camera = self.rig.devices.camera.describe();
        let (exposure, gain) = self.settings;
        let frame = self.steered(false, async |hands| {
            hands.expose(exposure, gain).await?;
            // Queued frames are old.
            for _ in 0..QUEUE {
                let asked = Instant::now();
                hands.next_frame(Freshness::NEVER).await?;
                if asked.elapsed() > QUEUED {
                    break;
                }
            }
            Ok(hands.fresh().await?.0)
        })?;
        let picture = Arc::new(Picture {
            sequence: frame.stamp.sequence,
            width: frame.width,
            height: frame.height,
            codes: frame.codes,
            range: [camera.black, camera.white],
            taken: Instant::now(),
        });
        self.newest = Some(picture.clone());
        Ok(picture)
    }
}

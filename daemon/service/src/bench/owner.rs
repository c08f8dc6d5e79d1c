//! The devices on their thread: what is done by hand, and the light that is looked after meanwhile.

use super::{Common, Job, locked};
use nacre_base::progress::{Progress, Silent};
use nacre_capture::Failure;
use nacre_capture::engine::{
    BenchController, Control, Input, Memory, PanelFound, Watch, drawn_by, guarded, measure_panel,
};
use nacre_capture::rig::{Place, Rig, Uses, runtime};
use nacre_drivers::display::DisplayConfig;
use nacre_drivers::{DeviceResult, Freshness, Pattern};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;

/// While light is on, interlocks are read this often.
const INTERLOCKS: Duration = Duration::from_millis(50);

/// A picture of the preview is taken again after this.
const PREVIEW_AGE: Duration = Duration::from_millis(200);

/// A frame that was waited for longer than this was not in the camera's queue.
const QUEUED: Duration = Duration::from_millis(3);

/// Longest queue that is emptied for a preview.
const QUEUE: u32 = 8;

/// The devices, on their thread.
pub struct Owner {
    /// Runs the device calls.
    pub runtime: Runtime,
    /// The devices.
    pub rig: Rig,
    /// What the panel shows.
    pub pattern: Pattern,
    /// Exposure and gain of the preview.
    pub settings: (Duration, f64),
    /// Where the analyser was last seen.
    pub analyser_deg: Option<f64>,
    /// When the flash is to go off.
    flash_until: Option<Instant>,
    /// How often somebody had said STOP when the work at hand was asked for.
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
    /// Codes.
    pub codes: Vec<u16>,
    /// Codes of no and of full light.
    pub range: [u16; 2],
    taken: Instant,
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

    /// Does what comes, until nothing more can come.
    pub(super) fn serve(&mut self, queue: &mpsc::Receiver<Job>) {
        let mut looked = Instant::now();
        loop {
            match queue.recv_timeout(self.patience()) {
                Ok(job) => job(self),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            // However many jobs there are, light is looked after.
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

    /// How long nothing needs to be looked after.
    fn patience(&self) -> Duration {
        if self.is_lit() { INTERLOCKS } else { Duration::from_secs(3600) }
    }

    /// Light that was switched on by hand goes off in time, and when an interlock opens. A flash that went off by itself counts
    /// as switched off.
    fn look_after_light(&mut self) {
        if self.runtime.block_on(self.rig.watch.check()).is_err() {
            // Lamps that do not go off say so to whoever asks for them next.
            let _ = self.dark();
        } else if self.flash_until.is_some_and(|until| Instant::now() >= until || !self.flash_reports_on()) {
            let _ = self.flash(None);
        }
    }

    fn flash_reports_on(&mut self) -> bool {
        let mut hands = BenchController::with(&mut self.rig.devices, self.memory);
        self.runtime.block_on(hands.is_lit()) == Ok(true)
    }

    /// Does something that STOP can abort, and while these interlocks hold.
    fn steered<T>(
        &mut self,
        watched: bool,
        work: impl AsyncFnOnce(&mut BenchController<'_>) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let control = Arc::new(Control::default());
        let _ = control.send(Input::Start);
        *locked(&self.shared.manual) = Some(control.clone());
        // A STOP from before is seen here, a later one reaches the control.
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

    /// Moves or switches something on by hand; the light goes off when it fails.
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

    /// Switches something off, which neither interlock nor STOP may prevent.
    fn off(&mut self, work: impl AsyncFnOnce(&mut BenchController<'_>) -> DeviceResult<()>) -> Result<(), Failure> {
        let mut hands = BenchController::with(&mut self.rig.devices, self.memory);
        let result = self.runtime.block_on(work(&mut hands));
        (self.memory, self.newest) = (hands.memory, None);
        Ok(result?)
    }

    /// Turns the analyser.
    ///
    /// # Errors
    /// As devices and interlocks answer; `Cancelled` when somebody stops it.
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
        // Also a movement that was cut short ended somewhere.
        self.analyser_deg = self.runtime.block_on(self.rig.devices.stage.position()).ok();
        moved
    }

    /// Shows a pattern until told otherwise.
    ///
    /// # Errors
    /// As devices and interlocks answer; `Cancelled` when somebody stops it.
    pub fn show(&mut self, pattern: Pattern) -> Result<(), Failure> {
        match pattern {
            Pattern::Black => self.off(async |hands| hands.show(pattern).await)?,
            _ => self.manual(async |hands| Ok(hands.show(pattern).await?))?,
        }
        self.pattern = pattern;
        Ok(())
    }

    /// Switches the flash on for so many seconds, or off.
    ///
    /// # Errors
    /// As devices and interlocks answer; `Cancelled` when somebody stops it.
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

    /// Whether the flash is on.
    pub fn flash_is_on(&self) -> bool {
        self.flash_until.is_some()
    }

    /// Switches all light off.
    ///
    /// # Errors
    /// As the lamps answer.
    pub fn dark(&mut self) -> Result<(), Failure> {
        (self.flash_until, self.pattern) = (None, Pattern::Black);
        self.off(async |hands| hands.dark().await)
    }

    /// Measures the panel while the interlocks hold and nobody aborts it; all light is off afterwards.
    ///
    /// # Errors
    /// As devices and interlocks answer, and where the camera sees too little of the panel; `Cancelled` when somebody stops it.
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

    /// After a session nothing is known any more, but that the light is off.
    pub(super) fn forget(&mut self) {
        (self.memory, self.newest, self.flash_until, self.pattern) = (Memory::default(), None, None, Pattern::Black);
        self.analyser_deg = self.runtime.block_on(self.rig.devices.stage.position()).ok();
    }

    /// The newest frame; the camera only, so that no interlock is asked.
    ///
    /// # Errors
    /// As the camera answers; `Cancelled` when somebody stops it.
    pub fn preview(&mut self) -> Result<Arc<Picture>, Failure> {
        if let Some(picture) = self.newest.as_ref().filter(|p| p.taken.elapsed() < PREVIEW_AGE) {
            return Ok(picture.clone());
        }
        let camera = self.rig.devices.camera.describe();
        let (exposure, gain) = self.settings;
        let frame = self.steered(false, async |hands| {
            hands.expose(exposure, gain).await?;
            // What waits in the queue is old.
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

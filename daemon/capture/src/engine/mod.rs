//! Capture engine: captures the frames of a plan one at a time. Each frame is verified to be fresh and counts once it
//! is durably stored.
//!
//! A session can be resumed after any interruption with the same result. Settings are sent again, the stage is homed,
//! every angle is approached from below, and committed frames are not repeated. The light is always switched off at the
//! end.
//!
//! Three activities run in parallel: bench control (`sequencer`), storage of frames (`frame_writer`), and
//! reconstruction (`live`).

mod activity;
mod bench_controller;
#[cfg(test)]
mod bench_controller_tests;
mod crossed;
mod frame_writer;
mod live;
mod meter;
mod panel;
mod panel_advice;
mod sequencer;
mod series;
mod state;
mod watch;

pub use activity::Activity;
pub use bench_controller::{BenchController, Devices, Memory};
pub use meter::{Metered, meter_preview};
pub(crate) use meter::{TURN_DEG, lights, tried};
pub use panel::{LEVELS, PanelFound, measure as measure_panel};
pub use panel_advice::drawn_by;

pub use sequencer::guarded;
pub use state::{Control, Input, State, TABLE};
pub use watch::Watch;

use crate::failure::Failure;
use crate::plan::{Added, Plan, Role, Step, groups};
use crate::session::{Commit, Disk, Entry, Session, SessionFile, SoFar, Timing};
use frame_writer::{FrameWriter, Message};
use live::{Deciding, Live};
use nacre_base::Error;
use nacre_base::progress::Progress;
use nacre_polarimetry::Running;
use sequencer::{Decisions, Sequencer};
use std::time::{Duration, Instant};
use tokio::runtime::Runtime;
use tokio::sync::mpsc;

/// Maximum number of frames waiting for the disk; more would only occupy memory.
const QUEUE: usize = 2;

/// Observer of a run, called from other threads.
pub trait Observer: Progress {
    /// A step's frame was durably stored at this Unix time in seconds.
    fn stored(&self, _step: &Step, _evidence: &Commit, _time: Option<f64>) {}
    /// Another entry was written to the journal at this Unix time in seconds.
    fn noted(&self, _entry: &Entry, _time: Option<f64>) {}
    /// The bench begins another activity.
    fn doing(&self, _activity: Activity) {}
    /// True if intermediate maps are displayed.
    fn wants_map(&self) -> bool {
        false
    }
    /// Receives an intermediate map.
    fn map(&self, _running: &Running) {}
    /// Receives the intermediate state of an adaptive series.
    fn so_far(&self, _so_far: &SoFar) {}
}

/// Resources of a run besides the session.
pub struct Engine<'a> {
    /// Runtime of the device calls.
    pub runtime: &'a Runtime,
    /// Devices of the bench.
    pub devices: &'a mut Devices,
    /// Interlocks.
    pub watch: &'a Watch,
    /// State and control of the run.
    pub control: &'a Control,
    /// Observer of all events.
    pub observer: &'a dyn Observer,
}

/// Result of a run.
pub struct Outcome {
    /// Times of the run.
    pub timing: Timing,
    /// The live reconstruction with all frames added, not yet solved.
    pub running: Option<Running>,
}

impl Engine<'_> {
    /// Meters the exposure for steps without a stated one, and the bracket. The light is switched off afterwards in any
    /// case.
    ///
    /// # Errors
    /// Those of devices and interlocks; `Cancelled`.
    pub fn meter(&mut self, plan: &Plan) -> Result<(Metered, Timing), Failure> {
        let begun = Instant::now();
        let mut controller = BenchController::new(self.devices).observed(self.observer);
        let _ = self.control.send(Input::Start);
        let (watch, control, observer) = (self.watch, self.control, self.observer);
        self.runtime.block_on(async {
            let result = guarded(watch, control, meter::metered(&mut controller, plan, observer)).await;
            let dark = controller.dark().await;
            let metered = match result {
                Ok(metered) => dark.map(|()| metered)?,
                Err(failure) => {
                    let cancelled = matches!(failure, Failure::Processing(Error::Cancelled));
                    let _ = control.send(if cancelled { Input::Settled } else { Input::Fault });
                    return Err(failure.at("metering"));
                }
            };
            Ok((metered, timing(&controller, begun.elapsed())))
        })
    }

    /// Captures all missing frames of the session; `before` is the duration of metering.
    ///
    /// # Errors
    /// Those of devices and interlocks, a full disk, `Cancelled`. The session can be resumed in each case.
    pub fn run<D: Disk + Send>(
        &mut self,
        session: Session<D>,
        description: &SessionFile,
        before: Timing,
    ) -> Result<Outcome, Failure> {
        let _ = self.control.send(Input::Start);
        let plan = &description.plan;
        let (chosen, ended) = (session.journal().chosen(), session.journal().ended());
        let steps = plan.steps_with(&chosen);
        // A group is captured as a whole, so either all or none of its frames are missing.
        let lacks = |group: &[Step]| vec![group.iter().any(|s| !session.has(&s.file)); group.len()];
        let missing: Vec<bool> = groups(&steps).flat_map(lacks).collect();
        self.observer.stage("capturing", session.journal().planned(plan)[1] as u64);
        let folder = session.folder().to_path_buf();
        let camera = self.devices.camera.describe();
        let observer = self.observer;
        let (decisions, mut decided) = mpsc::unbounded_channel();
        // Settings that the first decision would reject are rejected before the first fringes.
        if plan.until_decided().is_some()
            && ended.is_none()
            && let Err(error) = live::begin_survey(&folder, description, &camera)
        {
            let _ = self.control.send(Input::Fault);
            return Err(error.into());
        }
        let open = plan.is_open() && ended.is_none() || plan.awaits_crossed(&chosen);
        let deciding = open.then(|| Deciding {
            known: steps.iter().filter(|s| s.role == Role::Series).count(),
            limits_deg: self.devices.stage.describe().limits_deg,
            decisions,
        });
        let further = deciding.is_some();
        let live = Live { folder: &folder, description, camera: camera.clone(), observer, deciding };
        let (out, queue) = mpsc::channel(QUEUE);
        let (arrivals, arrived) = std::sync::mpsc::channel();
        let (known, before_chosen) = (steps.clone(), chosen.clone());
        let mut controller = BenchController::new(self.devices).observed(observer);
        controller.fixed_analyser_deg = session.journal().fixed_analyser_deg().filter(|_| !plan.turns());
        let writer =
            FrameWriter { session, description, steps: known, chosen: before_chosen, camera, observer, arrivals };
        let sequencer = Sequencer {
            controller,
            watch: self.watch,
            control: self.control,
            plan,
            exposure: Duration::from_secs_f64(description.exposure_s),
            out,
            paused: Duration::ZERO,
            prepared: false,
        };
        let (runtime, control) = (self.runtime, self.control);
        std::thread::scope(|scope| {
            let following = scope.spawn(move || live.follow(arrived));
            writer.announce_stored(&missing);
            let storing = scope.spawn(|| writer.run(queue));
            let further = further.then_some((chosen, &mut decided));
            let taken = runtime.block_on(capture_and_finish(sequencer, (&steps, &missing), further, before));
            let stored = storing.join().unwrap_or_else(|_| Err(died("storing")));
            let running = following.join().unwrap_or(None);
            // An error of the disk is the cause of a cancelled capture.
            let result = stored.and(taken);
            let _ = control.send(match &result {
                Ok(_) => Input::Done,
                Err(Failure::Processing(Error::Cancelled)) => Input::Settled,
                Err(_) => Input::Fault,
            });
            result.map(|timing| Outcome { timing, running })
        })
    }
}

/// Captures the frames, waits until they are stored, and closes the session or records why it ended.
async fn capture_and_finish(
    mut sequencer: Sequencer<'_>,
    (steps, missing): (&[Step], &[bool]),
    further: Option<(Vec<Added>, &mut Decisions)>,
    before: Timing,
) -> Result<Timing, Failure> {
    let begun = Instant::now();
    let result = sequencer.capture_all(steps, missing, further).await;
    sequencer.controller.tell(Activity::Saving);
    sequencer.flush().await;
    let now = timing(&sequencer.controller, begun.elapsed() - sequencer.paused);
    let timing = Timing {
        device_s: before.device_s + now.device_s,
        engine_s: before.engine_s + now.engine_s,
        wall_s: before.wall_s + now.wall_s,
    };
    let last = match &result {
        Ok(()) => Message::Finish(timing),
        Err(failure) => Message::Note(Entry::stopped(failure)),
    };
    let _ = sequencer.out.send(last).await;
    result.map(|()| timing)
}

fn timing(controller: &BenchController, wall: Duration) -> Timing {
    let stopwatch = &controller.stopwatch;
    Timing {
        device_s: stopwatch.device_time().as_secs_f64(),
        engine_s: wall.saturating_sub(stopwatch.waited).as_secs_f64(),
        wall_s: wall.as_secs_f64(),
    }
}

fn died(what: &str) -> Failure {
    Error::input(what, "ended unexpectedly", "report this, with what was printed before").into()
}

//! A capture session from plan to results: common code of command line and demo.

use crate::calibrations::{Choice, Chosen, Present, Record};
use crate::engine::{Control, Engine, Input, Observer, State};
use crate::failure::Failure;
use crate::plan::{CalibrationsPlan, Plan, PlannedOperation};
use crate::rig::{Rig, Stop};
use crate::session::{self, Disk, Journal, MAX_FLAT, RESULTS, SeriesEnd, Session, SessionFile, Timing, is_vacant};
use nacre_base::Version;
use nacre_base::operation::Done;
use nacre_base::progress::Progress;
use nacre_base::{Error, OutputFolder, input};
use nacre_polarimetry::Running;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};
use tokio::runtime::Runtime;

/// Result of a run.
#[derive(Serialize)]
pub struct Taken {
    /// Session folder.
    pub session: PathBuf,
    /// Number of frames.
    pub frames: usize,
    /// Exposure in s of frames without a stated one.
    pub exposure_s: f64,
    /// Total number of stale frames dropped.
    pub stale_frames_dropped: u64,
    /// Times of this run.
    pub timing: Timing,
    /// Times of metering.
    pub metering: Option<Timing>,
    /// Folder of the results, if the plan requests any.
    pub results: Option<PathBuf>,
    /// Seconds from the last frame to the finished results.
    pub results_after_s: Option<f64>,
    /// Report of the results, unless another process computed them.
    pub report: Option<Done>,
    /// End of an adaptive series.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ended: Option<SeriesEnd>,
    /// Calibration that was kept from the results of a session of kind calibration.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kept: Option<Record>,
    /// Warnings about calibrations.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

/// A bench with its control.
pub struct Capture<'a> {
    /// Runtime of the device calls.
    pub runtime: &'a Runtime,
    /// The bench.
    pub rig: &'a mut Rig,
    /// State of the run.
    pub control: Arc<Control>,
    /// Observer of all events.
    pub observer: &'a dyn Observer,
    /// Computes the results in another process, from the stored frames; `None` for this process.
    pub elsewhere: Option<&'a Elsewhere>,
    /// Stored calibrations, from which new sessions take theirs and which keep new ones.
    pub calibrations: Option<Choice>,
}

/// Computes the results of a session into its folder [`RESULTS`].
pub type Elsewhere = dyn Fn(&Path, &dyn Progress) -> Result<(), Failure> + Sync;

impl Capture<'_> {
    /// Meters if necessary, creates the session folder `out`, and captures all frames.
    ///
    /// # Errors
    /// As [`Engine::run`]; `Input` if the plan exceeds limits or `out` already exists.
    pub fn begin<D: Disk + Send>(&mut self, plan: Plan, out: &Path, disk: D) -> Result<Taken, Failure> {
        self.begin_watch();
        let plan = plan.with_fringes(&self.rig.setup, &self.rig.devices.limits());
        check_limits(&plan, out, &self.rig.devices.limits())?;
        if !is_vacant(out) {
            return Err(Error::file(out, "is already there", "choose another --out, or --resume it").into());
        }
        // Before the devices work, because the plan may list calibrations that do not apply.
        let chosen = self.choose(&plan)?;
        let (metered, metering) =
            if plan.is_metered() { Some(self.engine().meter(&plan)?).unzip() } else { (None, None) };
        let exposure = match (&metered, plan.camera.exposure_ms) {
            (Some(metered), _) => metered.exposure,
            (None, ms) => Duration::from_secs_f64(ms.or(plan.exposures_ms.first().copied()).unwrap_or(10.0) / 1000.0),
        };
        let limits = self.rig.devices.limits();
        let exposures_ms = match metered {
            Some(metered) if plan.bracket.is_some() => metered.bracket_ms,
            _ if plan.exposures_ms.is_empty() => plan.level_exposures_ms(exposure, &limits.camera),
            _ => vec![],
        };
        let plan = plan.with_bracket(exposures_ms);
        check_limits(&plan, out, &limits)?;
        let created = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_secs());
        let flat = chosen.flat.map(|file| {
            let unreadable = |e| Error::file(&file, e, "remove this calibration, and repeat it");
            input::read(&file, MAX_FLAT).map_err(unreadable)
        });
        let flat = flat.transpose()?;
        let description = SessionFile {
            version: Version,
            software: concat!("nacre ", env!("CARGO_PKG_VERSION")).into(),
            created,
            plan,
            devices: self.rig.ids.clone(),
            exposure_s: exposure.as_secs_f64(),
            setup: self.rig.setup,
            bench: self.rig.config.clone(),
            section: self.rig.section.clone(),
            mounting: self.rig.mounting,
            calibration: chosen.calibration,
            warnings: chosen.warnings,
        };
        let session = Session::create(disk, out, &description, flat.as_deref()).map_err(|e| Error::output(out, e))?;
        self.take(session, &description, metering)
    }

    /// Beginning or resuming a session acknowledges the interlocks: one that opened earlier and is closed does not
    /// count.
    fn begin_watch(&self) {
        self.runtime.block_on(self.rig.watch.begin_again());
    }

    /// Captures the missing frames of a session.
    ///
    /// # Errors
    /// As [`Engine::run`]; `Input` if the folder is no session or belongs to other devices.
    pub fn resume<D: Disk + Send>(&mut self, folder: &Path, disk: D) -> Result<Taken, Failure> {
        self.begin_watch();
        let bad = |e: std::io::Error| cannot_resume(folder, &e);
        let description = SessionFile::read(folder).map_err(bad)?;
        check_limits(&description.plan, folder, &self.rig.devices.limits())?;
        if description.devices != self.rig.ids {
            let problem =
                format!("was begun with {}, but here are {}", description.devices.join(", "), self.rig.ids.join(", "));
            return Err(Error::file(folder, problem, "resume it with its own devices, or begin a new session").into());
        }
        let faultless = |bench: &Option<nacre_sim::BenchConfig>| {
            bench.clone().map(|bench| nacre_sim::BenchConfig { faults: vec![], ..bench })
        };
        if faultless(&description.bench) != faultless(&self.rig.config) {
            let problem = "was begun on another simulated bench";
            return Err(Error::file(folder, problem, "give its own bench; only the faults may differ").into());
        }
        let [here, begun] = [&self.rig.section, &description.section].map(|s| s.clone().unwrap_or_default());
        if let Some(difference) = here.differs(&begun) {
            let problem = format!("was begun with another configuration of the bench: {difference}");
            return Err(Error::file(folder, problem, "give it back its [bench], or begin a new session").into());
        }
        let session = Session::open(disk, folder).map_err(bad)?;
        self.take(session, &description, None)
    }

    /// Chooses calibrations for a new session.
    fn choose(&self, plan: &Plan) -> Result<Chosen, Error> {
        let Some(choice) = &self.calibrations else {
            return match &plan.calibrations {
                CalibrationsPlan::Listed(ids) if !ids.is_empty() => {
                    let problem = "are listed by the plan, but no folder of calibrations is known";
                    Err(Error::input("calibrations", problem, "give --calibrations"))
                }
                _ => Ok(Chosen::default()),
            };
        };
        let rig = &self.rig;
        let present = Present::new(&rig.devices.limits(), rig.mounting, &rig.setup, plan.camera.roi);
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_secs());
        choice.choose(plan, &present, now)
    }

    /// Keeps the results of a session of kind calibration.
    fn keep(&self, plan: &Plan, folder: &Path) -> Option<Result<Record, Error>> {
        let choice = self.calibrations.as_ref().filter(|_| plan.measures().is_some())?;
        Some(choice.calibrations.keep_session(folder))
    }

    fn engine(&mut self) -> Engine<'_> {
        Engine {
            runtime: self.runtime,
            devices: &mut self.rig.devices,
            watch: &self.rig.watch,
            control: &self.control,
            observer: self.observer,
        }
    }

    fn take<D: Disk + Send>(
        &mut self,
        session: Session<D>,
        description: &SessionFile,
        metering: Option<Timing>,
    ) -> Result<Taken, Failure> {
        let folder = session.folder().to_path_buf();
        let outcome = self.engine().run(session, description, metering.unwrap_or_default())?;
        let (journal, _) = Journal::read(&folder.join(Journal::NAME)).map_err(|e| Error::output(&folder, e))?;
        let begun = Instant::now();
        let (results, report) = match (&description.plan.reconstruct, self.elsewhere) {
            (None, _) => (None, None),
            (Some(planned), None) => {
                let (results, report) = results(planned, outcome.running, &folder, self.observer)?;
                (Some(results), Some(report))
            }
            (Some(_), Some(elsewhere)) => {
                // Frees memory for the other process.
                drop(outcome.running);
                elsewhere(&folder, self.observer)?;
                (Some(folder.join(RESULTS)), None)
            }
        };
        let mut warnings = description.warnings.clone();
        let kept = results.as_ref().and_then(|_| self.keep(&description.plan, &folder));
        let kept =
            kept.and_then(|kept| kept.map_err(|e| warnings.push(format!("the calibration is not kept: {e}"))).ok());
        Ok(Taken {
            session: folder,
            frames: journal.planned(&description.plan)[0],
            exposure_s: description.exposure_s,
            stale_frames_dropped: journal.commits().map(|c| u64::from(c.dropped)).sum(),
            timing: outcome.timing,
            metering,
            results_after_s: results.is_some().then(|| begun.elapsed().as_secs_f64()),
            results,
            report,
            ended: journal.ended(),
            kept,
            warnings,
        })
    }
}

/// Reason why a folder cannot be resumed.
pub fn cannot_resume(folder: &Path, error: &std::io::Error) -> Failure {
    if error.kind() == std::io::ErrorKind::WouldBlock {
        return Error::file(folder, "is being captured by another process", "wait for it or stop it").into();
    }
    let remedy = match error.kind() {
        _ if session::is_damaged(error) => session::SALVAGE,
        std::io::ErrorKind::InvalidData => {
            "put an undamaged copy of the file back (without frames.json, it is written anew), or begin a new session"
        }
        _ => "give a folder that `nacre capture` made",
    };
    Error::file(folder, format!("cannot be resumed: {error}"), remedy).into()
}

/// Number of frames of a complete session with all requested results; `None` if anything remains to be done.
pub fn complete(folder: &Path) -> Option<usize> {
    // Resuming an incomplete session reports its error.
    session::check(folder).ok().filter(|c| c.is_complete()).map(|c| c.planned)
}

/// Rejects a plan that exceeds the devices' limits. `place` is the origin of the plan.
pub fn check_limits(plan: &Plan, place: &Path, limits: &crate::plan::Limits) -> Result<(), Failure> {
    let problems = plan.check_limits(limits);
    if problems.is_empty() {
        return Ok(());
    }
    Err(Error::file(place, problems.join("; "), "change the plan or the bench").into())
}

/// Computes the results requested by a session's plan from its stored frames, replacing earlier ones.
///
/// # Errors
/// `Input` if the folder is no session, or its plan requests no results; otherwise those of the reconstruction.
pub fn reconstruct_session(folder: &Path, progress: &dyn Progress) -> Result<(), Error> {
    let bad = |problem: String| Error::file(folder, problem, "give a session whose plan has the key reconstruct");
    let description = SessionFile::read(folder).map_err(|e| bad(format!("cannot be read: {e}")))?;
    let planned = description.plan.reconstruct.ok_or_else(|| bad("has no results to make".into()))?;
    results(&planned, None, folder, progress).map(drop)
}

/// Completes the live reconstruction, or reconstructs the whole session; earlier results of the same session are
/// replaced.
fn results(
    order: &PlannedOperation,
    running: Option<Running>,
    folder: &Path,
    progress: &dyn Progress,
) -> Result<(PathBuf, Done), Error> {
    let results = folder.join(RESULTS);
    if let Some((running, options)) = running.zip(order.options_of::<nacre_polarimetry::Options>()) {
        let options = options?;
        let out = OutputFolder::begin(&results, true)?;
        let report = running.finish(&out, &options, progress)?;
        out.write_report(&report)?;
        progress.check()?;
        out.commit()?;
        return Ok((results, Done::new(&options, report)));
    }
    let done = order.ready()?.perform(folder, &results, true, progress)?;
    Ok((results, done))
}

/// Connects signals to the control of a run. The first SIGINT or SIGTERM (counted by `interrupted`) stops it after the
/// frames in progress, the second aborts it. SIGUSR1 pauses, SIGUSR2 resumes. If a person rotates the analyser, the
/// first signal aborts.
///
/// # Errors
/// The system refuses signal handlers.
pub fn steer(runtime: &Runtime, control: &Arc<Control>, interrupted: Stop, by_hand: bool) -> std::io::Result<()> {
    use tokio::signal::unix::{SignalKind, signal};
    let _inside = runtime.enter();
    for (kind, input) in [(SignalKind::user_defined1(), Input::Pause), (SignalKind::user_defined2(), Input::Resume)] {
        let (mut signals, control) = (signal(kind)?, control.clone());
        runtime.spawn(async move {
            while signals.recv().await.is_some() {
                // A request that does not fit the state is ignored.
                let _ = control.send(input);
            }
        });
    }
    let control = control.clone();
    runtime.spawn(async move {
        let mut seen = 0;
        loop {
            tokio::time::sleep(Duration::from_millis(20)).await;
            let count = interrupted.load(std::sync::atomic::Ordering::Relaxed);
            if count > seen {
                let stopping = by_hand || count > 1 || control.state() == State::Stopping;
                let _ = control.send(if stopping { Input::Abort } else { Input::Stop });
                seen = count;
            }
        }
    });
    Ok(())
}

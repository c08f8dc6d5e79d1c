//! A capture session from plan to results: what the command line and the demo have in common.

use crate::engine::{Control, Engine, Input, Observer, State};
use crate::failure::Failure;
use crate::plan::{Plan, PlannedOperation};
use crate::rig::{Rig, Stop};
use crate::session::{self, Disk, Journal, SeriesEnd, Session, SessionFile, Timing, is_vacant};
use nacre_base::Version;
use nacre_base::operation::Done;
use nacre_base::progress::Progress;
use nacre_base::{Error, OutputFolder};
use nacre_polarimetry::Running;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};
use tokio::runtime::Runtime;

/// What a run of a session led to.
#[derive(Serialize)]
pub struct Taken {
    /// The session's folder.
    pub session: PathBuf,
    /// Frames in it.
    pub frames: usize,
    /// Exposure of frames that the plan gives none.
    pub exposure_s: f64,
    /// Stale frames dropped in all.
    pub stale_frames_dropped: u64,
    /// Where the time of this run went.
    pub timing: Timing,
    /// Of which metering.
    pub metering: Option<Timing>,
    /// Folder of the results, if the plan asks for any.
    pub results: Option<PathBuf>,
    /// From the last frame to the finished results.
    pub results_after_s: Option<f64>,
    /// Report of the results, unless another process made them.
    pub report: Option<Done>,
    /// How a series that ends by its σ has ended.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ended: Option<SeriesEnd>,
}

/// A bench with somebody who steers.
pub struct Capture<'a> {
    /// Runs the device calls.
    pub runtime: &'a Runtime,
    /// The bench.
    pub rig: &'a mut Rig,
    /// State of the run.
    pub control: Arc<Control>,
    /// Told of everything that happens.
    pub observer: &'a dyn Observer,
    /// Makes the results in another process, from the stored frames; in this one where it is none.
    pub elsewhere: Option<&'a Elsewhere>,
}

/// Makes the results of a session in its folder [`RESULTS`].
pub type Elsewhere = dyn Fn(&Path, &dyn Progress) -> Result<(), Failure> + Sync;

/// Folder of the results within a session's.
pub const RESULTS: &str = "results";

impl Capture<'_> {
    /// Meters if need be, makes the session folder `out`, and takes all frames.
    ///
    /// # Errors
    /// As [`Engine::run`]; `Input` when the plan asks too much or `out` is there already.
    pub fn begin<D: Disk + Send>(&mut self, plan: Plan, out: &Path, disk: D) -> Result<Taken, Failure> {
        self.begin_watch();
        let plan = plan.with_fringes(&self.rig.setup, &self.rig.devices.limits());
        check_limits(&plan, out, &self.rig.devices.limits())?;
        if !is_vacant(out) {
            return Err(Error::file(out, "is already there", "choose another --out, or --resume it").into());
        }
        let (metered, metering) =
            if plan.is_metered() { Some(self.engine().meter(&plan)?).unzip() } else { (None, None) };
        let exposure = match (&metered, plan.camera.exposure_ms) {
            (Some(metered), _) => metered.exposure,
            (None, ms) => Duration::from_secs_f64(ms.or(plan.exposures_ms.first().copied()).unwrap_or(10.0) / 1000.0),
        };
        let plan = plan.with_bracket(metered.map_or_else(Vec::new, |m| m.bracket_ms));
        check_limits(&plan, out, &self.rig.devices.limits())?;
        let description = SessionFile {
            version: Version,
            software: concat!("nacre ", env!("CARGO_PKG_VERSION")).into(),
            created: SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_secs()),
            plan,
            devices: self.rig.ids.clone(),
            exposure_s: exposure.as_secs_f64(),
            setup: self.rig.setup,
            bench: self.rig.config.clone(),
            section: self.rig.section.clone(),
        };
        let session = Session::create(disk, out, &description).map_err(|e| Error::output(out, e))?;
        self.take(session, &description, metering)
    }

    /// Whoever begins or resumes a session says that all is well: an interlock that opened before, and is closed, does not count.
    fn begin_watch(&self) {
        self.runtime.block_on(self.rig.watch.begin_again());
    }

    /// Takes what a session lacks.
    ///
    /// # Errors
    /// As [`Engine::run`]; `Input` when the folder is no session or belongs to other devices.
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
                // The memory is for the other process.
                drop(outcome.running);
                elsewhere(&folder, self.observer)?;
                (Some(folder.join(RESULTS)), None)
            }
        };
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
        })
    }
}

/// Why a folder cannot be resumed.
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

/// Frames of a session that has them all and the results that its plan asks for, so that there is nothing to resume.
pub fn complete(folder: &Path) -> Option<usize> {
    // A resume names the fault of an incomplete one.
    session::check(folder).ok().filter(|c| c.is_complete()).map(|c| c.planned)
}

/// Refuses a plan that asks more than the devices can do. `place` is where the plan came from.
pub fn check_limits(plan: &Plan, place: &Path, limits: &crate::plan::Limits) -> Result<(), Failure> {
    let problems = plan.check_limits(limits);
    if problems.is_empty() {
        return Ok(());
    }
    Err(Error::file(place, problems.join("; "), "change the plan or the bench").into())
}

/// Makes the results that a session's plan asks for from its stored frames. Earlier ones are replaced.
///
/// # Errors
/// `Input` if the folder is no session, or its plan asks for no results; otherwise as the reconstruction answers.
pub fn reconstruct_session(folder: &Path, progress: &dyn Progress) -> Result<(), Error> {
    let bad = |problem: String| Error::file(folder, problem, "give a session whose plan has the key reconstruct");
    let description = SessionFile::read(folder).map_err(|e| bad(format!("cannot be read: {e}")))?;
    let planned = description.plan.reconstruct.ok_or_else(|| bad("has no results to make".into()))?;
    results(&planned, None, folder, progress).map(drop)
}

/// Finishes the reconstruction that followed the frames, or makes it from the whole session; earlier results of the same
/// session are replaced.
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

/// Lets signals steer a run: SIGINT and SIGTERM, which `interrupted` counts, stop it after the frames in progress and abort it
/// the second time, SIGUSR1 pauses, SIGUSR2 goes on. Where a person turns the analyser, the first one aborts.
///
/// # Errors
/// The system refuses handlers.
pub fn steer(runtime: &Runtime, control: &Arc<Control>, interrupted: Stop, by_hand: bool) -> std::io::Result<()> {
    use tokio::signal::unix::{SignalKind, signal};
    let _inside = runtime.enter();
    for (kind, input) in [(SignalKind::user_defined1(), Input::Pause), (SignalKind::user_defined2(), Input::Resume)] {
        let (mut signals, control) = (signal(kind)?, control.clone());
        runtime.spawn(async move {
            while signals.recv().await.is_some() {
                // A wish that does not fit the state is no wish.
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

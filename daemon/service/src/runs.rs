//! Runs of sessions in the service: their events while they run, and those that the journal holds afterwards.

use super::events::EventLog;
use super::paths::without_folders;
use super::problem::Problem;
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_capture::engine::{Control, Observer, State};
use nacre_capture::plan::{Added, Plan, Step};
use nacre_capture::session::{Commit, Entry, Journal, SessionFile, SoFar};
use nacre_drivers::DeviceError;
use nacre_polarimetry::{Preview, Running};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Instant, SystemTime};

/// Width of the map that is looked at while frames arrive.
const MAP_WIDTH: usize = 512;

/// Stage of a run that has given the devices back.
const OVER: &str = "over";

/// One run of a session.
pub struct Run {
    /// The session.
    pub id: String,
    /// Its folder.
    pub folder: PathBuf,
    /// What it is to take.
    pub plan: Plan,
    /// When it was asked for, in Unix seconds.
    pub created: u64,
    /// State, and who steers.
    pub control: Arc<Control>,
    /// What happened.
    pub events: Arc<EventLog>,
    inner: Mutex<Inner>,
}

struct Inner {
    stage: String,
    steps: u64,
    done: u64,
    begun: Instant,
    error: Option<String>,
    fault: Option<DeviceError>,
    map: Option<Arc<Preview>>,
    sigma: Option<SoFar>,
}

impl Run {
    /// A run that has not begun.
    pub fn new(id: String, folder: PathBuf, plan: Plan) -> Self {
        let inner = Inner {
            stage: "waiting".into(),
            steps: 0,
            done: 0,
            begun: Instant::now(),
            error: None,
            fault: None,
            map: None,
            sigma: None,
        };
        let created = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_secs());
        Self { id, folder, plan, created, control: Arc::default(), events: Arc::default(), inner: Mutex::new(inner) }
    }

    /// A run of a session of which this happened already.
    pub fn resumed(self, events: EventLog) -> Self {
        Self { events: Arc::new(events), ..self }
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What it does, how many steps that has and how many are done.
    pub fn stage(&self) -> (String, u64, u64) {
        let inner = self.inner();
        (inner.stage.clone(), inner.steps, inner.done)
    }

    /// Frames stored by now; none before frames are taken.
    pub fn committed(&self) -> Option<u64> {
        let inner = self.inner();
        (inner.stage == "capturing").then_some(inner.done)
    }

    /// Seconds until the stage is done, at the pace so far.
    pub fn eta_s(&self) -> Option<f64> {
        let inner = self.inner();
        let going = matches!(self.control.state(), State::Running | State::Stopping) && inner.done > 0;
        let left = inner.steps.saturating_sub(inner.done) as f64;
        going.then(|| inner.begun.elapsed().as_secs_f64() * left / inner.done as f64)
    }

    /// Why it failed.
    pub fn error(&self) -> Option<String> {
        self.inner().error.clone()
    }

    /// The device that is at fault, if it failed by one.
    pub fn fault(&self) -> Option<DeviceError> {
        self.inner().fault.clone()
    }

    /// Says why it failed.
    pub fn fail(&self, failure: Failure) {
        let mut inner = self.inner();
        inner.fault = failure.fault().cloned();
        inner.error = Some(Problem::from(failure).to_string());
    }

    /// How well a series that ends by its σ knows its orientations so far.
    pub fn sigma_so_far(&self) -> Option<SoFar> {
        self.inner().sigma
    }

    /// The map so far.
    pub fn preview(&self) -> Option<Arc<Preview>> {
        self.inner().map.clone()
    }

    /// Whether it has given the devices back.
    pub fn is_over(&self) -> bool {
        self.inner().stage == OVER
    }

    /// Drops what takes memory; the session's folder has all that lasts.
    pub fn forget(&self) {
        self.inner().map = None;
        self.events.clear();
    }

    /// It has given the devices back.
    pub fn end(&self) {
        self.inner().stage = OVER.into();
    }
}

impl Progress for Run {
    fn stage(&self, name: &str, steps: u64) {
        let mut inner = self.inner();
        (inner.stage, inner.steps, inner.done, inner.begun) = (name.to_owned(), steps, 0, Instant::now());
        drop(inner);
        self.events.push_at("stage", now(), &json!({ "stage": name, "steps": steps }));
    }

    fn step(&self) {
        self.inner().done += 1;
    }

    /// The results of a run that was aborted in time are not made; a run itself is steered by its control.
    fn cancelled(&self) -> bool {
        self.control.state() == State::Aborting
    }
}

impl Observer for Run {
    fn stored(&self, step: &Step, evidence: &Commit, time: Option<f64>) {
        let index = self.inner().done;
        self.events.push_at("frame", time, &frame(step, evidence, index));
    }

    fn noted(&self, entry: &Entry, time: Option<f64>) {
        if let Some(text) = note(entry) {
            self.events.push_at("note", time, &json!({ "text": text }));
        }
    }

    fn wants_map(&self) -> bool {
        true
    }

    fn so_far(&self, so_far: &SoFar) {
        self.inner().sigma = Some(*so_far);
        self.events.push_at("sigma", now(), so_far);
    }

    fn map(&self, running: &Running) {
        if let Some(preview) = running.preview(MAP_WIDTH) {
            let frames = preview.frames;
            self.inner().map = Some(Arc::new(preview));
            self.events.push_at("map", now(), &json!({ "frames": frames }));
        }
    }
}

/// Unix seconds now.
pub fn now() -> Option<f64> {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).ok().map(|d| d.as_millis() as f64 / 1000.0)
}

/// Rebuilds a session's events from its journal, with their times; empty without a journal.
pub fn history(folder: &Path) -> EventLog {
    let log = EventLog::default();
    let read = SessionFile::read(folder).and_then(|file| Ok((file, Journal::read(&folder.join(Journal::NAME))?.0)));
    let Ok((file, journal)) = read else { return log };
    let steps = file.plan.steps_with(&journal.chosen());
    let steps: HashMap<&str, &Step> = steps.iter().map(|s| (s.file.as_str(), s)).collect();
    let mut index = 0;
    for (time, entry) in journal.timed() {
        match entry {
            Entry::Committed(commit) => {
                if let Some(step) = steps.get(commit.file.as_str()) {
                    log.push_at("frame", time, &frame(step, commit, index));
                    index += 1;
                }
            }
            other => {
                if let Some(text) = note(other) {
                    log.push_at("note", time, &json!({ "text": text }));
                }
            }
        }
    }
    log
}

/// Data of the event that a frame is stored.
fn frame(step: &Step, evidence: &Commit, index: u64) -> Value {
    let (exposure_s, gain) = evidence.controls();
    json!({
        "file": step.file, "analyser_deg": step.state.analyser_deg, "exposure_s": exposure_s, "gain": gain,
        "dropped": evidence.dropped, "sequence": evidence.sequence, "index": index,
    })
}

/// Text of a journal entry for the list of events; None for entries that are not listed.
fn note(entry: &Entry) -> Option<String> {
    let text = match entry {
        Entry::Begun => "begun".into(),
        Entry::Resumed => "resumed".into(),
        Entry::Finished(_) => "finished".into(),
        Entry::Salvaged(salvaged) => {
            format!("the journal was damaged: {} entries kept, at least {} lost", salvaged.kept, salvaged.lost)
        }
        Entry::Retried { reason } => format!("again after: {reason}"),
        Entry::Paused => "paused, with the light off".into(),
        Entry::Stopped { reason, .. } => format!("stopped: {reason}"),
        Entry::Chosen { added: Added::Angle { analyser_deg }, .. } => format!("next angle: {analyser_deg}°"),
        Entry::Chosen { added: Added::Fringes { fringes }, .. } => format!("more fringes: {fringes}"),
        Entry::Ended(end) => end.text(),
        Entry::Sealed { .. } | Entry::Intent { .. } | Entry::Committed(_) => return None,
    };
    Some(without_folders(&text))
}

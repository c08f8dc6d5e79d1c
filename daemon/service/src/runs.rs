//! Runs of sessions in the service, and their events: live during the run, from the journal afterwards.

use super::events::EventLog;
use super::pace::{Expected, Pace};
use super::paths::without_folders;
use super::problem::Problem;
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_capture::engine::{Activity, Control, Observer, State};
use nacre_capture::plan::{Added, Plan, Step};
use nacre_capture::session::{Commit, Entry, Journal, SessionFile, SoFar};
use nacre_drivers::DeviceError;
use nacre_polarimetry::{Preview, Running};
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Instant, SystemTime};

/// Width in pixels of the map that is shown while frames arrive.
const MAP_WIDTH: usize = 512;

/// Stage of a run that has released the devices.
const OVER: &str = "over";

/// Data of an `activity` event.
#[derive(Serialize)]
struct Doing {
    #[serde(flatten)]
    activity: Activity,
    eta_s: Option<f64>,
}

/// One run of a session.
pub struct Run {
    /// Id of the session.
    pub id: String,
    /// Folder of the session.
    pub folder: PathBuf,
    /// Plan of the session.
    pub plan: Plan,
    /// Time of the request in Unix seconds.
    pub created: u64,
    /// State of the run, and its control.
    pub control: Arc<Control>,
    /// Events of the run.
    pub events: Arc<EventLog>,
    inner: Mutex<Inner>,
}

struct Inner {
    stage: String,
    steps: u64,
    done: u64,
    pace: Pace,
    activity: Option<Activity>,
    error: Option<String>,
    fault: Option<DeviceError>,
    map: Option<Arc<Preview>>,
    sigma: Option<SoFar>,
}

impl Run {
    /// A run that has not begun.
    pub fn new(id: String, folder: PathBuf, plan: Plan, expected: Expected) -> Self {
        let inner = Inner {
            stage: "waiting".into(),
            steps: 0,
            done: 0,
            pace: Pace::new(expected, Instant::now()),
            activity: None,
            error: None,
            fault: None,
            map: None,
            sigma: None,
        };
        let created = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_secs());
        Self { id, folder, plan, created, control: Arc::default(), events: Arc::default(), inner: Mutex::new(inner) }
    }

    /// Run of a session that already has these events.
    pub fn resumed(self, events: EventLog) -> Self {
        Self { events: Arc::new(events), ..self }
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Current stage, its number of steps, and the number of steps done.
    pub fn stage(&self) -> (String, u64, u64) {
        let inner = self.inner();
        (inner.stage.clone(), inner.steps, inner.done)
    }

    /// Number of frames stored so far; `None` before the first stage with frames.
    pub fn committed(&self) -> Option<u64> {
        let inner = self.inner();
        (inner.stage == "capturing").then_some(inner.done)
    }

    /// Remaining time in seconds, results included, while the session is not paused.
    pub fn eta_s(&self) -> Option<f64> {
        let inner = self.inner();
        let halted = matches!(self.control.state(), State::Paused | State::Failed);
        (!halted && inner.stage != OVER).then(|| inner.pace.remaining_s(inner.done, Instant::now()))
    }

    /// Present activity of the devices.
    pub fn activity(&self) -> Option<Activity> {
        self.inner().activity
    }

    /// Error message of a failed run.
    pub fn error(&self) -> Option<String> {
        self.inner().error.clone()
    }

    /// Device error that made the run fail, if one did.
    pub fn fault(&self) -> Option<DeviceError> {
        self.inner().fault.clone()
    }

    /// Records the failure.
    pub fn fail(&self, failure: Failure) {
        let mut inner = self.inner();
        inner.fault = failure.fault().cloned();
        inner.error = Some(Problem::from(failure).to_string());
    }

    /// Achieved σ of a series that stops at a σ.
    pub fn sigma_so_far(&self) -> Option<SoFar> {
        self.inner().sigma
    }

    /// The map computed from the frames so far.
    pub fn preview(&self) -> Option<Arc<Preview>> {
        self.inner().map.clone()
    }

    /// Whether the run has released the devices.
    pub fn is_over(&self) -> bool {
        self.inner().stage == OVER
    }

    /// Frees the memory of events and map; the session's folder has all lasting data.
    pub fn forget(&self) {
        self.inner().map = None;
        self.events.clear();
    }

    /// Marks the run as ended: it has released the devices.
    pub fn end(&self) {
        self.inner().stage = OVER.into();
    }
}

impl Progress for Run {
    fn stage(&self, name: &str, steps: u64) {
        let mut inner = self.inner();
        (inner.stage, inner.steps, inner.done) = (name.to_owned(), steps, 0);
        inner.pace.stage(name, steps, Instant::now());
        drop(inner);
        self.events.push_at("stage", now(), &json!({ "stage": name, "steps": steps, "eta_s": self.eta_s() }));
    }

    fn step(&self) {
        self.inner().done += 1;
    }

    /// Results of a run that was aborted before them are not computed. The control steers the run itself.
    fn cancelled(&self) -> bool {
        self.control.state() == State::Aborting
    }
}

impl Observer for Run {
    fn stored(&self, step: &Step, evidence: &Commit, time: Option<f64>) {
        let mut inner = self.inner();
        let index = inner.done;
        inner.pace.frame(Instant::now());
        drop(inner);
        self.events.push_at("frame", time, &frame(step, evidence, index));
    }

    fn noted(&self, entry: &Entry, time: Option<f64>) {
        if matches!(entry, Entry::Paused) {
            self.inner().pace.pause();
        }
        if let Some(text) = note(entry) {
            self.events.push_at("note", time, &json!({ "text": text }));
        }
    }

    fn doing(&self, activity: Activity) {
        self.inner().activity = Some(activity);
        self.events.tell("activity", &Doing { activity, eta_s: self.eta_s() });
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

/// Current time in Unix seconds.
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

/// Data of a `frame` event.
fn frame(step: &Step, evidence: &Commit, index: u64) -> Value {
    let (exposure_s, gain) = evidence.controls();
    json!({
        "file": step.file, "analyser_deg": step.state.analyser_deg, "exposure_s": exposure_s, "gain": gain,
        "dropped": evidence.dropped, "sequence": evidence.sequence, "index": index,
    })
}

/// Text of a journal entry in the list of events; `None` for entries that are not listed.
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
        Entry::Chosen { added: Added::Crossed { crossed_deg }, .. } => format!("crossed direction: {crossed_deg}°"),
        Entry::Ended(end) => end.text(),
        Entry::Sealed { .. } | Entry::Intent { .. } | Entry::Committed(_) => return None,
    };
    Some(without_folders(&text))
}

//! A session as `/api/v1/sessions` describes it.

use super::App;
use super::paths::without_folders;
use super::problem::{Answer, Problem};
use super::runs::Run;
use nacre_capture::engine::{Activity, State as RunState};
use nacre_capture::naming;
use nacre_capture::plan::Plan;
use nacre_capture::session::{Ending, Journal, SESSION_FILE, SessionFile, SoFar, Timing, unreadable_journal};
use nacre_drivers::DeviceError;
use nacre_frames::Calibration;
use nacre_store::catalogue::SessionRow;
use serde::Serialize;
use utoipa::ToSchema;

/// Error of a session whose journal ends without a reason.
const CUT_OFF: &str = "its process was killed, or power failed; resume the session";

/// A session.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct SessionDoc {
    id: String,
    /// As given, or else the name in the plan, the sample or the kind of plan.
    name: String,
    sample: String,
    operator: String,
    notes: String,
    kind: String,
    /// Start of the session in Unix seconds.
    created: i64,
    /// Size of all files in bytes.
    bytes: u64,
    /// `idle`, `running`, `pausing`, `paused`, `resuming`, `stopping`, `aborting`, `finished` or `failed`.
    #[schema(value_type = String)]
    pub state: RunState,
    /// Number of frames in the plan; the maximum for a series that stops at a σ.
    frames_planned: usize,
    frames_committed: usize,
    /// Progress of a series that stops early.
    ///
    /// With an analyser: `{angles, sigma_deg, until_sigma_deg, at_most, least_deg}`, where `least_deg` is the lowest σ
    /// that the longest series can reach. For fringes: `{fringes, undecided, until_undecided, at_most}`.
    #[schema(value_type = Option<Object>)]
    sigma: Option<SoFar>,
    /// Why such a series ended: `met`, `at_most` or `cannot`.
    #[schema(value_type = Option<String>)]
    ended: Option<Ending>,
    /// Current stage; null once the devices are released.
    stage: Option<String>,
    /// Remaining time in seconds until the results, or the last frame of a plan without results. It is the estimate,
    /// corrected by the measured pace. Null while paused.
    eta_s: Option<f64>,
    /// Present activity of the devices: `{activity}` is `homing`, `lighting`, `turning` (to `analyser_deg`),
    /// `exposing` (for `exposure_s`) or `saving`.
    #[schema(value_type = Option<Object>)]
    activity: Option<Activity>,
    /// Why it failed or was stopped.
    error: Option<String>,
    /// Device error that made the session fail: `{device, command, expected, got, remedy, class}`, where `class` is
    /// `retry`, `lost`, `stop` or `setup`.
    #[schema(value_type = Option<Object>)]
    fault: Option<DeviceError>,
    /// Warnings at its start, such as calibrations that are too old.
    warnings: Vec<String>,
    /// Stored calibrations that apply to its frames, with their origins; omitted in lists and events.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    calibration: Option<Calibration>,
    /// Whether the session contains results of a reconstruction.
    has_results: bool,
    /// Time spent in each activity.
    #[schema(value_type = Option<Object>)]
    timing: Option<Timing>,
    /// The plan; omitted in lists and events.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    plan: Option<Plan>,
}

impl SessionDoc {
    /// Description of a run, or of a folder that no process works on.
    pub fn read(app: &App, id: &str, with_plan: bool) -> Answer<Self> {
        let folder = app.session_folder(id)?;
        let run = app.run(id);
        if !folder.join(SESSION_FILE).exists() {
            let run = run.ok_or_else(|| app.missing("session", id))?;
            return Ok(Self::without_folder(&run, with_plan));
        }
        let row = SessionRow::read(&folder)?;
        let (journal, _) = Journal::read(&folder.join(Journal::NAME)).map_err(|e| unreadable_journal(&folder, &e))?;
        let SessionFile { plan, warnings, calibration, .. } =
            SessionFile::read(&folder).map_err(|e| Problem::bad(e.to_string()))?;
        let mut doc = Self {
            id: id.to_owned(),
            name: row.name,
            sample: row.sample,
            operator: row.operator,
            notes: row.notes,
            kind: row.kind,
            created: row.created,
            bytes: row.bytes,
            state: if journal.finished() { RunState::Finished } else { RunState::Idle },
            frames_planned: row.frames_planned as usize,
            frames_committed: row.frames_committed as usize,
            sigma: journal.ended().map(|end| end.so_far),
            ended: journal.ended().map(|end| end.why),
            stage: None,
            eta_s: None,
            activity: None,
            error: journal.why_stopped().map(|why| without_folders(&why)),
            fault: journal.fault().cloned(),
            warnings: warnings.iter().map(|warning| without_folders(warning)).collect(),
            calibration: calibration.filter(|_| with_plan),
            has_results: folder.join("results/report.json").exists(),
            timing: journal.timing(),
            plan: with_plan.then_some(plan),
        };
        match run.filter(|r| !r.is_over() || r.error().is_some()) {
            Some(run) => doc.live(&run),
            None if doc.state == RunState::Idle => _ = doc.error.get_or_insert_with(|| CUT_OFF.into()),
            None => {}
        }
        Ok(doc)
    }

    fn live(&mut self, run: &Run) {
        self.state = run.control.state();
        // Clients take results as a sign that the devices are free.
        self.has_results &= run.is_over();
        self.stage = Some(run.stage().0).filter(|_| !run.is_over());
        self.activity = run.activity().filter(|_| !run.is_over());
        (self.eta_s, self.error) = (run.eta_s(), run.error().or(self.error.take()));
        self.fault = run.fault().or(self.fault.take());
        self.sigma = self.sigma.or(run.sigma_so_far());
        self.frames_committed = run.committed().map_or(self.frames_committed, |n| n as usize);
    }

    /// Description of a run that still meters and has no folder.
    fn without_folder(run: &Run, with_plan: bool) -> Self {
        let plan = &run.plan;
        let mut doc = Self {
            id: run.id.clone(),
            name: naming::of_plan(plan),
            sample: plan.sample.clone(),
            operator: plan.operator.clone(),
            notes: plan.notes.clone(),
            kind: nacre_capture::plan::word(plan.kind),
            created: run.created as i64,
            bytes: 0,
            state: RunState::Idle,
            frames_planned: plan.most_steps().len(),
            frames_committed: 0,
            sigma: None,
            ended: None,
            stage: None,
            eta_s: None,
            activity: None,
            error: None,
            fault: None,
            warnings: vec![],
            calibration: None,
            has_results: false,
            timing: None,
            plan: with_plan.then(|| plan.clone()),
        };
        doc.live(run);
        doc
    }
}

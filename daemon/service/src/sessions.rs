//! `/api/v1/sessions`.

use super::keys::Keyed;
use super::paths::without_folders;
use super::plans::PlanBody;
use super::problem::{Answer, Kind, Problem};
use super::runs::{Run, history, now};
use super::{App, At, Params, blocking, events, work};
use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use nacre_capture::Failure;
use nacre_capture::engine::{Input, State as RunState};
use nacre_capture::plan::{Plan, PlanKind};
use nacre_capture::run::{Capture, complete};
use nacre_capture::session::{Ending, Journal, MortalDisk, SESSION_FILE, SessionFile, SoFar, Timing};
use nacre_drivers::DeviceError;
use nacre_store::catalogue::{Cursor, Query, SessionRow};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;
use std::sync::Arc;
use utoipa::{IntoParams, ToSchema};

/// Longest text that is searched for, in characters.
const LONGEST_SEARCH: usize = 1000;

/// Why a session ended whose journal does not say so.
const CUT_OFF: &str = "its process was killed, or power failed; resume the session";

/// A session.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct SessionDoc {
    id: String,
    name: String,
    sample: String,
    operator: String,
    notes: String,
    kind: String,
    /// When it was begun, in Unix seconds.
    created: i64,
    /// Size of all its files.
    bytes: u64,
    /// `idle`, `running`, `pausing`, `paused`, `resuming`, `stopping`, `aborting`, `finished` or `failed`.
    #[schema(value_type = String)]
    state: RunState,
    /// For a series that goes on until its σ is as wanted: the most.
    frames_planned: usize,
    frames_committed: usize,
    /// For a series that goes on until enough is known, what is known so far: `{angles, sigma_deg, until_sigma_deg, at_most,
    /// least_deg}` behind an analyser, where `least_deg` is what σ will be at least after the most angles;
    /// `{fringes, undecided, until_undecided, at_most}` of a spot scan.
    #[schema(value_type = Option<Object>)]
    sigma: Option<SoFar>,
    /// Why such a series has ended: `met`, `at_most` or `cannot`.
    #[schema(value_type = Option<String>)]
    ended: Option<Ending>,
    /// What it does now; none once it has given the devices back.
    stage: Option<String>,
    /// Seconds until that is done.
    eta_s: Option<f64>,
    /// Why it failed or was stopped.
    error: Option<String>,
    /// The device that did not do what it was asked to, if one is why: `{device, command, expected, got, remedy, class}`, where `class` is
    /// `retry`, `lost`, `stop` or `setup`.
    #[schema(value_type = Option<Object>)]
    fault: Option<DeviceError>,
    /// There are results of a reconstruction in the session.
    has_results: bool,
    /// Where the time went.
    #[schema(value_type = Option<Object>)]
    timing: Option<Timing>,
    /// The plan; left out in lists and events.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schema(value_type = Option<Object>)]
    plan: Option<Plan>,
}

/// One page of sessions.
#[derive(Debug, Serialize, ToSchema)]
pub struct SessionPage {
    items: Vec<SessionDoc>,
    /// Where the next page begins.
    next: Option<String>,
}

/// What to look for.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct Search {
    /// Words that all occur in name, sample, operator, notes or folder.
    #[param(max_length = 1000)]
    text: Option<String>,
    /// Only this kind of plan.
    #[param(value_type = Option<String>, pattern = "^(polarization|exposures|flash|spots|free)$")]
    kind: Option<PlanKind>,
    /// Only this state: `finished`, `stopped` or `unfinished`.
    #[param(value_type = Option<String>, pattern = "^(finished|stopped|unfinished)$")]
    state: Option<nacre_store::catalogue::State>,
    /// Most sessions in the page.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// The `next` of the page before.
    #[param(pattern = "^[0-9]+\\.[0-9a-f]+$")]
    cursor: Option<String>,
}

impl SessionDoc {
    /// Of a run, or of a folder that nobody works on.
    pub fn read(app: &App, id: &str, with_plan: bool) -> Answer<Self> {
        let folder = app.session_folder(id)?;
        let run = app.run(id);
        if !folder.join(SESSION_FILE).exists() {
            let run = run.ok_or_else(|| Problem::not_found(format!("session {id}")))?;
            return Ok(Self::without_folder(&run, with_plan));
        }
        let row = SessionRow::read(&folder)?;
        let (journal, _) = Journal::read(&folder.join(Journal::NAME)).map_err(|e| Problem::bad(e.to_string()))?;
        let plan = SessionFile::read(&folder).map_err(|e| Problem::bad(e.to_string()))?.plan;
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
            error: journal.why_stopped().map(|why| without_folders(&why)),
            fault: journal.fault().cloned(),
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
        // Whoever sees them can have the devices.
        self.has_results &= run.is_over();
        self.stage = Some(run.stage().0).filter(|_| !run.is_over());
        (self.eta_s, self.error) = (run.eta_s(), run.error().or(self.error.take()));
        self.fault = run.fault().or(self.fault.take());
        self.sigma = self.sigma.or(run.sigma_so_far());
        self.frames_committed = run.committed().map_or(self.frames_committed, |n| n as usize);
    }

    /// Of a run that meters, and has no folder yet.
    fn without_folder(run: &Run, with_plan: bool) -> Self {
        let plan = &run.plan;
        let mut doc = Self {
            id: run.id.clone(),
            name: plan.name.clone(),
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
            error: None,
            fault: None,
            has_results: false,
            timing: None,
            plan: with_plan.then(|| plan.clone()),
        };
        doc.live(run);
        doc
    }
}

/// Begins a session.
#[utoipa::path(post, path = "/api/v1/sessions", tag = "sessions", operation_id = "begin_session",
    request_body = PlanBody, params(("Idempotency-Key" = Option<String>, Header, description = "Begin it once only", min_length = 1, max_length = 200)),
    responses((status = 202, body = SessionDoc, headers(("Location" = String, description = "The session"))),
        (status = 400, body = Problem), (status = 409, body = Problem), (status = 422, body = Problem)))]
pub async fn begin(State(app): State<Arc<App>>, Keyed { body, key }: Keyed<PlanBody>) -> Answer<Response> {
    let plan = body.plan()?;
    let problems = plan.check_limits(&app.limits);
    if !problems.is_empty() {
        return Err(Problem::bad(problems.join("; ")).remedy("change the plan"));
    }
    let mut turn = app.keys.turn(key).await;
    // One that was deleted since is begun anew.
    if let Some(id) = turn.made().filter(|id| SessionDoc::read(&app, id, false).is_ok()) {
        turn.same()?;
        return accepted(&app, &id);
    }
    if app.stores.is_full() {
        return Err(Problem::full());
    }
    let id = turn.begin();
    let run = Arc::new(Run::new(id.clone(), app.session_folder(&id)?, plan));
    start(&app, &run, true)?;
    accepted(&app, &id)
}

fn accepted(app: &App, id: &str) -> Answer<Response> {
    let doc = SessionDoc::read(app, id, true)?;
    Ok((StatusCode::ACCEPTED, [(header::LOCATION, format!("/api/v1/sessions/{id}"))], Json(doc)).into_response())
}

/// Gives the devices to a run.
fn start(app: &Arc<App>, run: &Arc<Run>, new: bool) -> Answer<()> {
    let (worker, follower) = ((app.clone(), run.clone()), (app.clone(), run.clone()));
    // Known before it begins, so that its state can be asked for at once.
    let before = app.runs.insert(run.clone());
    let begun = app.bench.begin(&run.id, run.control.clone(), move |owner| {
        let (app, run) = worker;
        let mut capture = Capture {
            runtime: &owner.runtime,
            rig: &mut owner.rig,
            control: run.control.clone(),
            observer: &*run,
            elsewhere: Some(&work::session),
        };
        let taken = if new {
            capture.begin(run.plan.clone(), &run.folder, MortalDisk::default())
        } else {
            capture.resume(&run.folder, MortalDisk::default())
        };
        match taken {
            Ok(taken) if taken.results.is_some() => run.events.push_at("results", now(), &json!({})),
            Ok(_) | Err(Failure::Processing(nacre_base::Error::Cancelled)) => {}
            Err(failure) => {
                // Also what failed before the engine began, so that nobody waits for it.
                let _ = run.control.send(Input::Start);
                let _ = run.control.send(Input::Fault);
                run.fail(failure);
            }
        }
        move || {
            run.end();
            app.metrics.session_ended(run.control.state());
        }
    });
    if let Err(problem) = begun {
        app.runs.restore(&run.id, before);
        return Err(problem);
    }
    tokio::spawn(async move {
        let (app, run) = follower;
        tell_states(&app, &run).await;
    });
    Ok(())
}

/// Tells every change of a run's state until it is over.
async fn tell_states(app: &Arc<App>, run: &Arc<Run>) {
    let mut states = run.control.subscribe();
    let mut last = None;
    loop {
        let state = *states.borrow_and_update();
        let over = run.is_over();
        if last != Some((state, over)) {
            let (reader, id) = (app.clone(), run.id.clone());
            if let Ok(doc) = blocking(move || SessionDoc::read(&reader, &id, false)).await {
                run.events.push_at("state", now(), &doc);
            }
            app.note(&run.folder).await;
            last = Some((state, over));
        }
        if over {
            break;
        }
        // What is over without a change of state is seen a moment later.
        let _ = tokio::time::timeout(std::time::Duration::from_millis(100), states.changed()).await;
    }
    run.events.close();
}

/// Sessions, newest first.
#[utoipa::path(get, path = "/api/v1/sessions", tag = "sessions", operation_id = "sessions", params(Search),
    responses((status = 200, body = SessionPage), (status = 400, body = Problem)))]
pub async fn list(State(app): State<Arc<App>>, Params(search): Params<Search>) -> Answer<Json<SessionPage>> {
    let after: Option<Cursor> = match search.cursor.as_deref().map(str::parse) {
        Some(Ok(cursor)) => Some(cursor),
        Some(Err(_)) => return Err(Problem::bad("cursor is no cursor").remedy("give the next of the page before")),
        None => None,
    };
    if search.text.as_ref().is_some_and(|text| text.chars().count() > LONGEST_SEARCH) {
        return Err(Problem::bad(format!("text is longer than {LONGEST_SEARCH} characters")));
    }
    let limit = search.limit.unwrap_or(50);
    if !(1..=1000).contains(&limit) {
        return Err(Problem::bad(format!("limit is {limit}; give 1 to 1000")));
    }
    let query = Query { text: search.text.unwrap_or_default(), kind: search.kind, state: search.state, limit, after };
    let page = app.stores.catalogue().search(&query).await?;
    let next = page.next.map(|c| c.to_string());
    let items = blocking(move || {
        let id = |row: &SessionRow| Some(Path::new(&row.folder).file_name()?.to_string_lossy().into_owned());
        // One that was deleted meanwhile is left out.
        Answer::Ok(
            page.sessions.iter().filter_map(id).filter_map(|id| SessionDoc::read(&app, &id, false).ok()).collect(),
        )
    });
    Ok(Json(SessionPage { items: items.await?, next }))
}

/// A session.
#[utoipa::path(get, path = "/api/v1/sessions/{id}", tag = "sessions", operation_id = "session", params(("id" = String, Path)),
    responses((status = 200, body = SessionDoc), (status = 404, body = Problem)))]
pub async fn get(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Json<SessionDoc>> {
    Ok(Json(blocking(move || SessionDoc::read(&app, &id, true)).await?))
}

/// Waits after the frames in progress, with the light off.
#[utoipa::path(post, path = "/api/v1/sessions/{id}/pause", tag = "sessions", operation_id = "pause_session",
    params(("id" = String, Path)),
    responses((status = 202, body = SessionDoc), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn pause(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Response> {
    steer(&app, &id, Input::Pause)
}

/// Goes on after a pause, or takes what a session lacks; one that lacks nothing stays as it is.
#[utoipa::path(post, path = "/api/v1/sessions/{id}/resume", tag = "sessions", operation_id = "resume_session",
    params(("id" = String, Path)),
    responses((status = 202, body = SessionDoc), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn resume(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Response> {
    if app.run(&id).is_some_and(|r| !r.is_over()) {
        return steer(&app, &id, Input::Resume);
    }
    let folder = app.session_folder(&id)?;
    let (place, before) = (folder.clone(), app.run(&id).filter(|r| !r.events.is_empty()));
    let (file, log, complete) = blocking(move || {
        let file = SessionFile::read(&place);
        let log = before.map_or_else(|| history(&place), |run| run.events.continued());
        Answer::Ok((file, log, complete(&place).is_some()))
    })
    .await?;
    let file = file.map_err(|_| Problem::not_found(format!("session {id}")))?;
    if !complete {
        let run = Run::new(id.clone(), folder, file.plan).resumed(log);
        start(&app, &Arc::new(run), false)?;
    }
    accepted(&app, &id)
}

/// Ends after the frames in progress; what is missing can be taken later.
#[utoipa::path(post, path = "/api/v1/sessions/{id}/stop", tag = "sessions", operation_id = "stop_session",
    params(("id" = String, Path)),
    responses((status = 202, body = SessionDoc), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn stop(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Response> {
    steer(&app, &id, Input::Stop)
}

/// Ends at once.
#[utoipa::path(post, path = "/api/v1/sessions/{id}/abort", tag = "sessions", operation_id = "abort_session",
    params(("id" = String, Path)),
    responses((status = 202, body = SessionDoc), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn abort(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Response> {
    steer(&app, &id, Input::Abort)
}

fn steer(app: &Arc<App>, id: &str, input: Input) -> Answer<Response> {
    let doc = SessionDoc::read(app, id, false)?;
    let state = match app.run(id) {
        Some(run) => run.control.send(input).err(),
        None => Some(doc.state),
    };
    match state {
        None => accepted(app, id),
        Some(state) => {
            let state = nacre_capture::plan::word(state);
            Err(Problem::new(Kind::Conflict, format!("the session is {state}, where this is not possible")))
        }
    }
}

/// What happens in a session, as server-sent events: `state`, `stage`, `frame`, `map`, `sigma` (of a
/// series that ends by it), `note`, `results`. `time` is when it happened, in Unix seconds; `frame` and `note` come
/// from the journal with its times, also after the session has ended.
#[utoipa::path(get, path = "/api/v1/sessions/{id}/events", tag = "sessions", operation_id = "session_events",
    params(("id" = String, Path), ("Last-Event-ID" = Option<String>, Header, description = "Go on after this event")),
    responses((status = 200, content_type = "text/event-stream", body = String), (status = 404, body = Problem),
        (status = 429, body = Problem)))]
pub async fn session_events(State(app): State<Arc<App>>, At(id): At<String>, headers: HeaderMap) -> Answer<Response> {
    let log = match app.run(&id) {
        Some(run) if !run.is_over() || !run.events.is_empty() => run.events.clone(),
        _ => {
            let (reader, id) = (app.clone(), id.clone());
            let told =
                move || Answer::Ok((SessionDoc::read(&reader, &id, false)?, history(&reader.session_folder(&id)?)));
            let (doc, log) = blocking(told).await?;
            log.push("state", &doc);
            log.close();
            Arc::new(log)
        }
    };
    Ok(events::stream(&app, &headers, log)?.into_response())
}

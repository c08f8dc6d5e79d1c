//! `/api/v1/sessions`: list, start and control of sessions.

use super::keys::Keyed;
use super::pace::Expected;
use super::paths::without_folders;
use super::plans::PlanBody;
use super::problem::{Answer, Kind, Problem};
use super::runs::{Run, history, now};
use super::session_doc::SessionDoc;
use super::{App, At, Params, blocking, events, plans, samples, work};
use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use nacre_capture::Failure;
use nacre_capture::calibrations::Choice;
use nacre_capture::engine::Input;
use nacre_capture::plan::{Plan, PlanKind};
use nacre_capture::rig::Rig;
use nacre_capture::run::{Capture, complete};
use nacre_capture::session::{MortalDisk, SessionFile};
use nacre_store::catalogue::{Cursor, Query, SessionRow};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::Path;
use std::sync::Arc;
use tokio::runtime::Runtime;
use utoipa::{IntoParams, ToSchema};

/// Longest search text in characters.
const LONGEST_SEARCH: usize = 1000;

/// One page of sessions.
#[derive(Debug, Serialize, ToSchema)]
pub struct SessionPage {
    items: Vec<SessionDoc>,
    /// Start of the next page; null on the last one.
    next: Option<String>,
}

/// Search and paging of sessions.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct Search {
    /// Words that all occur in name, sample, operator, notes or folder.
    #[param(max_length = 1000)]
    text: Option<String>,
    /// Filter by kind of plan.
    #[param(value_type = Option<String>, pattern = "^(polarization|exposures|flash|spots|free|calibration)$")]
    kind: Option<PlanKind>,
    /// Filter by state: `finished`, `stopped` or `unfinished`.
    #[param(value_type = Option<String>, pattern = "^(finished|stopped|unfinished)$")]
    state: Option<nacre_store::catalogue::State>,
    /// Most sessions in the page.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// Value of `next` in the previous page.
    #[param(pattern = "^[0-9]+\\.[0-9a-f]+$")]
    cursor: Option<String>,
}

/// Starts a session.
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
    let (chooser, asked) = (app.clone(), plan.clone());
    blocking(move || chooser.chosen_calibrations(&asked)).await?;
    let expected = expected(&app, &plan).await;
    let mut turn = app.keys.turn(key).await;
    // If the session was deleted since, a new one is started.
    if let Some(id) = turn.made().filter(|id| SessionDoc::read(&app, id, false).is_ok()) {
        turn.same()?;
        return accepted(&app, &id);
    }
    if app.stores.is_full() {
        return Err(Problem::full());
    }
    let id = turn.begin();
    let run = Arc::new(Run::new(id.clone(), app.session_folder(&id)?, plan, expected));
    start(&app, &run, true)?;
    accepted(&app, &id)
}

/// Predicted times of a plan on the bench.
async fn expected(app: &Arc<App>, plan: &Plan) -> Expected {
    let exposure = plans::assumed_exposure(app, plan).await;
    let (app, plan) = (app.clone(), plan.clone());
    // Without a prediction, the remaining time counts from the measured pace.
    blocking(move || Ok(Expected::of(&plan, exposure, &app.limits))).await.unwrap_or_default()
}

/// Answer to the start of a session.
///
/// # Errors
/// The session's files cannot be read.
pub fn accepted(app: &App, id: &str) -> Answer<Response> {
    let doc = SessionDoc::read(app, id, true)?;
    Ok((StatusCode::ACCEPTED, [(header::LOCATION, format!("/api/v1/sessions/{id}"))], Json(doc)).into_response())
}

/// Gives the devices to a run.
fn start(app: &Arc<App>, run: &Arc<Run>, new: bool) -> Answer<()> {
    let (worker, follower) = ((app.clone(), run.clone()), (app.clone(), run.clone()));
    // Registered before it starts, so that its state can be requested at once.
    let before = app.runs.insert(run.clone());
    let begun = app.bench.begin(&run.id, run.control.clone(), move |owner| {
        let (app, run) = worker;
        let choice = app.calibration_choice();
        capture(&run, &owner.runtime, &mut owner.rig, new, Some(choice));
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

/// Takes the frames of a run with these devices, all or the missing ones, and computes the results. New sessions use
/// stored calibrations, if any.
pub fn capture(run: &Run, runtime: &Runtime, rig: &mut Rig, new: bool, calibrations: Option<Choice>) {
    let control = run.control.clone();
    let mut capture = Capture { runtime, rig, control, observer: run, elsewhere: Some(&work::session), calibrations };
    let taken = if new {
        capture.begin(run.plan.clone(), &run.folder, MortalDisk::default())
    } else {
        capture.resume(&run.folder, MortalDisk::default())
    };
    match taken {
        Ok(taken) => {
            let kept = taken.kept.map(|record| format!("kept as calibration {}", record.id));
            for text in kept.into_iter().chain(taken.warnings) {
                run.events.push_at("note", now(), &json!({ "text": without_folders(&text) }));
            }
            if taken.results.is_some() {
                run.events.push_at("results", now(), &json!({}));
            }
        }
        Err(Failure::Processing(nacre_base::Error::Cancelled)) => {}
        Err(failure) => failed(run, failure),
    }
}

/// Ends a run for subscribers, also if it failed before the engine started.
pub fn failed(run: &Run, failure: Failure) {
    let _ = run.control.send(Input::Start);
    let _ = run.control.send(Input::Fault);
    run.fail(failure);
}

/// Publishes every change of a run's state until the run is over.
pub async fn tell_states(app: &Arc<App>, run: &Arc<Run>) {
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
        // A run can end without a change of state, which is detected after this time.
        let _ = tokio::time::timeout(std::time::Duration::from_millis(100), states.changed()).await;
    }
    run.events.close();
}

/// Lists sessions, newest first.
#[utoipa::path(get, path = "/api/v1/sessions", tag = "sessions", operation_id = "sessions", params(Search),
    responses((status = 200, body = SessionPage), (status = 400, body = Problem)))]
pub async fn list(State(app): State<Arc<App>>, Params(search): Params<Search>) -> Answer<Json<SessionPage>> {
    let after: Option<Cursor> = match search.cursor.as_deref().map(str::parse) {
        Some(Ok(cursor)) => Some(cursor),
        Some(Err(_)) => return Err(Problem::bad("cursor is invalid").remedy("give next of the previous page")),
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
        // A session that was deleted meanwhile is omitted.
        Answer::Ok(
            page.sessions.iter().filter_map(id).filter_map(|id| SessionDoc::read(&app, &id, false).ok()).collect(),
        )
    });
    Ok(Json(SessionPage { items: items.await?, next }))
}

/// Reads a session.
#[utoipa::path(get, path = "/api/v1/sessions/{id}", tag = "sessions", operation_id = "session", params(("id" = String, Path)),
    responses((status = 200, body = SessionDoc), (status = 404, body = Problem)))]
pub async fn get(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Json<SessionDoc>> {
    Ok(Json(blocking(move || SessionDoc::read(&app, &id, true)).await?))
}

/// Pauses after the frames in progress, with the light off.
#[utoipa::path(post, path = "/api/v1/sessions/{id}/pause", tag = "sessions", operation_id = "pause_session",
    params(("id" = String, Path)),
    responses((status = 202, body = SessionDoc), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn pause(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Response> {
    steer(&app, &id, Input::Pause)
}

/// Continues a paused session, or takes the missing frames of an ended one. A complete session stays unchanged.
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
        let sample = file.bench.as_ref().and_then(samples::kind_of).filter(|_| file.section.is_none());
        let expected = expected(&app, &file.plan).await;
        let run = Arc::new(Run::new(id.clone(), folder, file.plan, expected).resumed(log));
        match sample {
            Some(kind) => samples::start(&app, &run, kind, false)?,
            None => start(&app, &run, false)?,
        }
    }
    accepted(&app, &id)
}

/// Stops after the frames in progress; missing frames can be taken later.
#[utoipa::path(post, path = "/api/v1/sessions/{id}/stop", tag = "sessions", operation_id = "stop_session",
    params(("id" = String, Path)),
    responses((status = 202, body = SessionDoc), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn stop(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Response> {
    steer(&app, &id, Input::Stop)
}

/// Aborts at once.
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
            Err(Problem::new(Kind::Conflict, format!("not possible while the session is {state}")))
        }
    }
}

/// Streams the events of a session as server-sent events.
///
/// Events are `state`, `stage`, `activity`, `frame`, `map`, `sigma` (of a series that stops at a σ), `note` and
/// `results`. `time` is the time of the event in Unix seconds. `frame` and `note` come from the journal with its times,
/// also after the end of the session. `activity` has no number, and only the newest is sent.
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

//! `/api/v1/reconstructions`: jobs and their results.

use super::keys::{Key, Keyed};
use super::naming::result_of;
use super::paths::without_folders;
use super::problem::{Answer, Kind, Problem};
use super::reconstruction_request::Request;
use super::work::result_folder;
use super::{App, At, Body, Params, events, files, methods};
use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use nacre_base::estimate::{Estimate, Machine, Work};
use nacre_base::operation::Input;
use nacre_capture::fields::fields;
use nacre_capture::naming::of_session;
use nacre_capture::plan::Method;
use nacre_capture::session::SESSION_FILE;
use nacre_render::SoFar;
use nacre_store::jobs::{Job, JobState, LightUpload, Spec, UsedResult};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;
use utoipa::{IntoParams, ToSchema};

/// Time, memory and disk space of a reconstruction.
#[derive(Debug, Serialize, ToSchema)]
pub struct Needs {
    /// Time in seconds from its start.
    seconds: f64,
    /// Upper bound of its memory in bytes, the program included. For calibrations, height fields and renderings it is
    /// an estimate.
    memory_bytes: u64,
    /// Size of its results in bytes.
    disk_bytes: u64,
}

/// A reconstruction.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Reconstruction {
    id: String,
    /// As given, or else its result and the name of its input.
    name: String,
    session: Option<String>,
    upload: Option<String>,
    /// Photographs of its light, if any.
    light: Option<LightUpload>,
    /// Results that it reads.
    results: Vec<UsedResult>,
    /// Results that its options name.
    named: Vec<UsedResult>,
    #[schema(value_type = String)]
    method: Method,
    /// Its options; keys left out have their defaults.
    #[schema(value_type = Object)]
    options: serde_json::Map<String, serde_json::Value>,
    /// `queued`, `running`, `done`, `failed`, `cancelled` or `set_aside`.
    #[schema(value_type = String)]
    state: JobState,
    attempts: u32,
    /// Fraction done of the current stage, 0 to 1.
    progress: f64,
    stage: String,
    /// Remaining time in seconds while it runs.
    remaining_s: Option<f64>,
    /// Rendering under way: `{"passes": 12, "of": 40, "noise": 0.02, "seconds_left": 31.5}`. `noise` is null after one
    /// pass.
    #[schema(value_type = Option<Object>)]
    so_far: Option<SoFar>,
    error: Option<String>,
    /// Time of the request in Unix seconds.
    created: u64,
    /// Contents of report.json.
    #[schema(value_type = Option<Object>)]
    report: Option<serde_json::Value>,
}

/// One page of reconstructions, newest first.
#[derive(Debug, Serialize, ToSchema)]
pub struct ReconstructionPage {
    items: Vec<Reconstruction>,
    next: Option<String>,
}

/// Page of a list.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct PageQuery {
    /// Most items in the page.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// Value of `next` in the previous page.
    #[param(pattern = "^[0-9A-Z]{26}$")]
    cursor: Option<String>,
}

/// Folders of a reconstruction.
pub struct Place {
    /// Folder of the maps.
    pub results: PathBuf,
    /// Folder of the photographs.
    pub input: PathBuf,
}

impl App {
    /// A job by its id.
    ///
    /// # Errors
    /// `not-found` when there is none.
    pub async fn job(&self, id: &str) -> Answer<Job> {
        super::check_id(id)?;
        self.jobs()?.get(id).await?.ok_or_else(|| self.missing("reconstruction", id))
    }

    /// Folders of a job, or of a session with its own results.
    ///
    /// # Errors
    /// `not-found` when there is none.
    pub async fn place(&self, id: &str) -> Answer<Place> {
        super::check_id(id)?;
        let session = self.session_folder(id)?;
        if session.join(SESSION_FILE).exists() {
            return Ok(Place { results: session.join("results"), input: session });
        }
        let job = self.job(id).await?;
        Ok(Place { results: self.result_folder(id), input: self.input_of(&job.spec)? })
    }

    /// Folder of the results of a job.
    pub fn result_folder(&self, id: &str) -> PathBuf {
        result_folder(&self.config().data, id)
    }

    /// Folder of the photographs of a job.
    ///
    /// # Errors
    /// `not-found` when the job names none.
    pub fn input_of(&self, spec: &Spec) -> Answer<PathBuf> {
        match (&spec.session, &spec.upload) {
            (Some(id), _) => self.session_folder(id),
            (None, Some(id)) => Ok(self.upload_folder(id)?),
            // Neither a calibration without photographs nor an operation on results has photographs.
            _ if spec.operation.operation().input() == Input::FilesOrNothing || !spec.results.is_empty() => {
                Ok(self.result_folder(&spec.id))
            }
            _ => Err(Problem::not_found("input")),
        }
    }

    /// Description of a job for clients.
    pub fn describe(&self, job: Job, with_report: bool) -> Reconstruction {
        let folder = self.result_folder(&job.id);
        let so_far = if job.state == JobState::Running { self.renders.of(&job.id).map(|g| g.so_far) } else { None };
        let report = if with_report && job.state == JobState::Done { files::report(&folder).ok() } else { None };
        Reconstruction {
            name: self.name_of(&job.spec),
            id: job.id,
            session: job.session,
            upload: job.upload,
            light: job.spec.light,
            results: job.spec.results,
            named: job.spec.named,
            method: job.spec.operation,
            options: job.spec.options,
            state: job.state,
            attempts: job.attempts,
            progress: job.progress,
            stage: job.stage,
            remaining_s: job.remaining_s,
            so_far,
            error: job.error.as_deref().map(|error| without_folders(&fields(error))),
            created: job.created,
            report: report.as_deref().and_then(told),
        }
    }

    /// Checks a job, and estimates its time, memory and disk.
    async fn work_of(&self, spec: &Spec) -> Answer<Work> {
        self.input_of(spec)?;
        let (asked, data) = (spec.clone(), self.config().data.clone());
        self.heavy.work(move || methods::check(&asked, &data)).await
    }

    /// A session's own results as a reconstruction; `None` if it has none.
    fn own_results(&self, id: &str) -> Answer<Option<Reconstruction>> {
        let folder = self.session_folder(id)?;
        let Ok(bytes) = files::report(&folder.join("results")) else { return Ok(None) };
        let session = nacre_capture::session::SessionFile::read(&folder).ok();
        let order = session.as_ref().and_then(|f| f.plan.reconstruct.clone()).unwrap_or_default();
        let input = session.as_ref().map_or_else(String::new, |session| of_session(&folder, &session.plan));
        Ok(Some(Reconstruction {
            id: id.to_owned(),
            name: result_of(order.operation, &input),
            session: Some(id.to_owned()),
            upload: None,
            light: None,
            results: vec![],
            named: vec![],
            method: order.operation,
            options: order.options,
            state: JobState::Done,
            attempts: 1,
            progress: 1.0,
            stage: "done".into(),
            remaining_s: None,
            so_far: None,
            error: None,
            created: session.map_or(0, |f| f.created),
            report: told(&bytes),
        }))
    }
}

/// A report for clients: files without their folders.
fn told(report: &[u8]) -> Option<serde_json::Value> {
    serde_json::from_str(&without_folders(std::str::from_utf8(report).ok()?)).ok()
}

/// Queues a reconstruction.
#[utoipa::path(post, path = "/api/v1/reconstructions", tag = "reconstructions", operation_id = "reconstruct",
    request_body = Request, params(("Idempotency-Key" = Option<String>, Header, description = "Ask once only", min_length = 1, max_length = 200)),
    responses((status = 202, body = Reconstruction, headers(("Location" = String, description = "The reconstruction"))),
        (status = 400, body = Problem), (status = 404, body = Problem), (status = 422, body = Problem)))]
pub async fn begin(State(app): State<Arc<App>>, Keyed { body, key }: Keyed<Request>) -> Answer<Response> {
    submit(&app, body.spec()?, key).await
}

/// Puts a job into the queue, once per idempotency key.
///
/// # Errors
/// Those of the operation's check.
pub async fn submit(app: &Arc<App>, mut spec: Spec, key: Option<Key>) -> Answer<Response> {
    let mut turn = app.keys.turn(key).await;
    if let Some(id) = turn.made()
        && let Some(job) = app.jobs()?.get(&id).await?
    {
        turn.same()?;
        return Ok(accepted(app.describe(job, false)));
    }
    // Checked here as well as in the job, so that the client learns it at once.
    app.work_of(&spec).await?;
    spec.id = turn.begin();
    spec.name = app.name_of(&spec);
    let job = app.jobs()?.submit(spec).await?;
    Ok(accepted(app.describe(job, false)))
}

/// Estimates time, memory and disk space of a reconstruction.
#[utoipa::path(post, path = "/api/v1/reconstructions/estimate", tag = "reconstructions", operation_id = "estimate_reconstruction",
    request_body = Request, responses((status = 200, body = Needs), (status = 400, body = Problem), (status = 404, body = Problem),
        (status = 422, body = Problem)))]
pub async fn estimate(State(app): State<Arc<App>>, Body(body): Body<Request>) -> Answer<Json<Needs>> {
    let work = app.work_of(&body.spec()?).await?;
    let Estimate { seconds, memory_bytes, disk_bytes } =
        super::blocking(move || Ok(Machine::here().estimate(&work))).await?;
    Ok(Json(Needs { seconds, memory_bytes, disk_bytes }))
}

fn accepted(doc: Reconstruction) -> Response {
    let location = format!("/api/v1/reconstructions/{}", doc.id);
    (StatusCode::ACCEPTED, [(header::LOCATION, location)], Json(doc)).into_response()
}

/// Lists reconstructions, newest first.
#[utoipa::path(get, path = "/api/v1/reconstructions", tag = "reconstructions", operation_id = "reconstructions",
    params(PageQuery), responses((status = 200, body = ReconstructionPage), (status = 400, body = Problem)))]
pub async fn list(State(app): State<Arc<App>>, Params(query): Params<PageQuery>) -> Answer<Json<ReconstructionPage>> {
    let limit = query.limit.unwrap_or(50);
    if !(1..=1000).contains(&limit) {
        return Err(Problem::bad(format!("limit is {limit}; give 1 to 1000")));
    }
    if let Some(cursor) = &query.cursor {
        super::check_id(cursor).map_err(|_| Problem::bad("cursor is invalid"))?;
    }
    let (jobs, next) = app.jobs()?.list(limit, query.cursor.as_deref()).await?;
    Ok(Json(ReconstructionPage { items: jobs.into_iter().map(|j| app.describe(j, false)).collect(), next }))
}

/// Reads a reconstruction, or a session's own results by the session's id.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}", tag = "reconstructions", operation_id = "reconstruction",
    params(("id" = String, Path)), responses((status = 200, body = Reconstruction), (status = 404, body = Problem)))]
pub async fn get(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Json<Reconstruction>> {
    super::check_id(&id)?;
    if let Some(own) = app.own_results(&id)? {
        return Ok(Json(own));
    }
    let job = app.job(&id).await?;
    Ok(Json(app.describe(job, true)))
}

/// Cancels a reconstruction that has not ended.
#[utoipa::path(post, path = "/api/v1/reconstructions/{id}/cancel", tag = "reconstructions",
    operation_id = "cancel_reconstruction", params(("id" = String, Path)),
    responses((status = 202, body = Reconstruction), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn cancel(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Response> {
    let job = app.job(&id).await?;
    if !matches!(job.state, JobState::Queued | JobState::Running) {
        return Err(Problem::new(Kind::Conflict, "the reconstruction has ended already"));
    }
    app.jobs()?.cancel(&id).await?;
    Ok(accepted(app.describe(app.job(&id).await?, false)))
}

/// Ends the passes of a rendering under way, and keeps its picture so far as the result.
#[utoipa::path(post, path = "/api/v1/reconstructions/{id}/finish", tag = "reconstructions",
    operation_id = "finish_reconstruction", params(("id" = String, Path)),
    responses((status = 202, body = Reconstruction), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn finish(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Response> {
    let job = app.job(&id).await?;
    if !job.spec.operation.is("render") {
        return Err(Problem::new(Kind::Conflict, "only a rendering has a result before its end").remedy("cancel it"));
    }
    if !app.jobs()?.finish(&id) {
        return Err(Problem::new(Kind::Conflict, "the rendering is not running"));
    }
    Ok(accepted(app.describe(app.job(&id).await?, false)))
}

/// Repeats a reconstruction that did not succeed.
#[utoipa::path(post, path = "/api/v1/reconstructions/{id}/retry", tag = "reconstructions",
    operation_id = "retry_reconstruction", params(("id" = String, Path)),
    responses((status = 202, body = Reconstruction), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn retry(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Response> {
    let job = app.job(&id).await?;
    if !matches!(job.state, JobState::Failed | JobState::Cancelled | JobState::SetAside) {
        return Err(Problem::new(Kind::Conflict, "the reconstruction has not failed"));
    }
    app.jobs()?.retry(&id).await?;
    Ok(accepted(app.describe(app.job(&id).await?, false)))
}

/// Reads the log of a reconstruction, one event per line.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/log", tag = "reconstructions",
    operation_id = "reconstruction_log", params(("id" = String, Path)),
    responses((status = 200, content_type = "text/plain", body = String), (status = 404, body = Problem)))]
pub async fn log(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<String> {
    app.job(&id).await?;
    Ok(app.jobs()?.log(&id).await?.as_deref().map(|log| without_folders(&fields(log))).unwrap_or_default())
}

/// Streams the states of a reconstruction as server-sent events `state`.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/events", tag = "reconstructions",
    operation_id = "reconstruction_events", params(("id" = String, Path)),
    responses((status = 200, content_type = "text/event-stream", body = String), (status = 404, body = Problem),
        (status = 429, body = Problem)))]
pub async fn job_events(State(app): State<Arc<App>>, At(id): At<String>, headers: HeaderMap) -> Answer<Response> {
    super::check_id(&id)?;
    let log = Arc::new(events::EventLog::default());
    if let Some(own) = app.own_results(&id)? {
        log.push("state", &Reconstruction { report: None, ..own });
        log.close();
        return Ok(events::stream(&app, &headers, log)?.into_response());
    }
    let mut job = app.job(&id).await?;
    let mut changes = app.jobs()?.changes();
    let stream = events::stream(&app, &headers, log.clone())?;
    let weak = Arc::downgrade(&log);
    drop(log);
    tokio::spawn(async move {
        // Ends with the job, or when the last subscriber has gone.
        while let Some(log) = weak.upgrade() {
            let over = !matches!(job.state, JobState::Queued | JobState::Running);
            log.push("state", &app.describe(job.clone(), false));
            if over {
                log.close();
                break;
            }
            drop(log);
            let changed = async { while changes.recv().await.is_ok_and(|changed| changed != id) {} };
            let _ = tokio::time::timeout(std::time::Duration::from_secs(2), changed).await;
            match app.job(&id).await {
                Ok(now) => job = now,
                Err(_) => break,
            }
        }
    });
    Ok(stream.into_response())
}

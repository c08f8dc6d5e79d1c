//! `/api/v1/reconstructions`: jobs, and what they found.

use super::problem::{Answer, Kind, Problem};
use super::{App, At, Body, Params, blocking, events, files, maps, png};
use crate::jobs::{Job, JobState, Spec};
use crate::session::SESSION_FILE;
use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use nacre_processing::frames::{FILE_NAME, load};
use nacre_processing::image::encode_png8;
use nacre_processing::polarimetry::{Point, probe};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;
use utoipa::{IntoParams, ToSchema};

/// What to reconstruct.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// A session.
    session: Option<String>,
    /// Or uploaded photographs.
    upload: Option<String>,
    /// `polarization`.
    method: Option<String>,
    /// `auto` or `sinusoid`.
    model: Option<String>,
    /// Added to every orientation.
    offset_deg: Option<f64>,
}

/// A reconstruction.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct Reconstruction {
    id: String,
    session: Option<String>,
    upload: Option<String>,
    /// `queued`, `running`, `done`, `failed`, `cancelled` or `set_aside`.
    #[schema(value_type = String)]
    state: JobState,
    attempts: u32,
    /// 0 to 1.
    progress: f64,
    stage: String,
    error: Option<String>,
    /// When it was asked for, in Unix seconds.
    created: u64,
    /// What was found: the contents of report.json.
    #[schema(value_type = Option<Object>)]
    report: Option<serde_json::Value>,
}

/// One page of reconstructions, newest first.
#[derive(Debug, Serialize, ToSchema)]
pub struct ReconstructionPage {
    items: Vec<Reconstruction>,
    next: Option<String>,
}

/// Which page.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct PageQuery {
    /// Most items in the page.
    #[param(minimum = 1, maximum = 1000)]
    limit: Option<u32>,
    /// The `next` of the page before.
    #[param(pattern = "^[0-9A-Z]{26}$")]
    cursor: Option<String>,
}

/// Which part of a map is drawn, in pixels of the map.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct Region {
    /// Pixels per row of the picture, at most.
    #[param(minimum = 1, maximum = 16384)]
    width: Option<usize>,
    #[param(maximum = 65535)]
    x: Option<u16>,
    #[param(maximum = 65535)]
    y: Option<u16>,
    #[param(maximum = 65535)]
    w: Option<u16>,
    #[param(maximum = 65535)]
    h: Option<u16>,
}

/// A pixel of the maps.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct PixelQuery {
    #[param(maximum = 100000, example = 3)]
    x: usize,
    #[param(maximum = 100000, example = 4)]
    y: usize,
}

/// One pixel with all that was measured, and the sinusoid through it.
#[derive(Debug, Serialize, ToSchema)]
pub struct Pixel {
    x: usize,
    y: usize,
    /// `{analyser_deg, value, file}` for each photograph.
    #[schema(value_type = Vec<Object>)]
    points: Vec<Point>,
    s0: f64,
    s1: f64,
    s2: f64,
    /// The fitted curve.
    fit: Vec<FitPoint>,
    residual_rms: f64,
    /// None where masked.
    orientation_deg: Option<f64>,
    sigma_deg: Option<f64>,
    dolp: Option<f64>,
    masked: bool,
    saturated: bool,
}

/// A point of the fitted curve.
#[derive(Debug, Serialize, ToSchema)]
pub struct FitPoint {
    analyser_deg: f64,
    value: f64,
}

/// Where a reconstruction's results and photographs are.
struct Place {
    results: PathBuf,
    input: PathBuf,
}

impl App {
    async fn job(&self, id: &str) -> Answer<Job> {
        super::check_id(id)?;
        self.jobs.get(id).await?.ok_or_else(|| Problem::not_found(format!("reconstruction {id}")))
    }

    /// Of a job, or of a session with its own results.
    async fn place(&self, id: &str) -> Answer<Place> {
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
        self.config.data.join("reconstructions").join(id)
    }

    /// Folder of the photographs of a job.
    ///
    /// # Errors
    /// `not-found` when the job names none.
    pub fn input_of(&self, spec: &Spec) -> Answer<PathBuf> {
        match (&spec.session, &spec.upload) {
            (Some(id), _) => self.session_folder(id),
            (None, Some(id)) => Ok(self.upload_folder(id)?),
            _ => Err(Problem::not_found("input")),
        }
    }

    fn describe(&self, job: Job, with_report: bool) -> Reconstruction {
        let report = self.result_folder(&job.id).join("report.json");
        let report = if with_report && job.state == JobState::Done { std::fs::read(report).ok() } else { None };
        Reconstruction {
            id: job.id,
            session: job.session,
            upload: job.upload,
            state: job.state,
            attempts: job.attempts,
            progress: job.progress,
            stage: job.stage,
            error: job.error,
            created: job.created,
            report: report.and_then(|bytes| serde_json::from_slice(&bytes).ok()),
        }
    }

    /// A session's own results as a reconstruction.
    fn own_results(&self, id: &str) -> Answer<Option<Reconstruction>> {
        let folder = self.session_folder(id)?;
        let Ok(bytes) = std::fs::read(folder.join("results/report.json")) else { return Ok(None) };
        Ok(Some(Reconstruction {
            id: id.to_owned(),
            session: Some(id.to_owned()),
            upload: None,
            state: JobState::Done,
            attempts: 1,
            progress: 1.0,
            stage: "done".into(),
            error: None,
            created: crate::session::SessionFile::read(&folder).map_or(0, |f| f.created),
            report: serde_json::from_slice(&bytes).ok(),
        }))
    }
}

/// Asks for a reconstruction.
#[utoipa::path(post, path = "/api/v1/reconstructions", tag = "reconstructions", operation_id = "reconstruct",
    request_body = Request, params(("Idempotency-Key" = Option<String>, Header, description = "Ask once only")),
    responses((status = 202, body = Reconstruction, headers(("Location" = String, description = "The reconstruction"))),
        (status = 400, body = Problem), (status = 404, body = Problem)))]
pub async fn begin(State(app): State<Arc<App>>, headers: HeaderMap, Body(body): Body<Request>) -> Answer<Response> {
    if body.method.as_deref().is_some_and(|m| m != "polarization") {
        return Err(Problem::bad("method can only be polarization so far"));
    }
    let model = body.model.unwrap_or_else(|| "auto".into());
    if !["auto", "sinusoid"].contains(&model.as_str()) {
        return Err(Problem::bad(format!("model is {model:?}; give auto or sinusoid")));
    }
    let offset_deg = body.offset_deg.unwrap_or(0.0);
    if body.session.is_some() == body.upload.is_some() {
        return Err(Problem::bad("give either a session or an upload"));
    }
    for id in body.session.iter().chain(&body.upload) {
        super::check_id(id)?;
    }
    let key = headers.get("idempotency-key").map(|k| crate::session::sha256(k.as_bytes()));
    if let Some(id) = key.as_ref().and_then(|k| app.remembered(k)) {
        let job = app.job(&id).await?;
        return Ok(accepted(app.describe(job, false)));
    }
    let spec = Spec { id: super::new_id(), session: body.session, upload: body.upload, model, offset_deg };
    let input = app.input_of(&spec)?;
    if !input.join(FILE_NAME).exists() {
        return Err(Problem::not_found("complete set of photographs there").remedy("finish the session first"));
    }
    // Refused here rather than by the job, so that whoever asks learns it at once.
    blocking(move || Ok(load(&input).map(drop)?)).await?;
    let job = app.jobs.submit(spec).await?;
    if let Some(key) = key {
        app.remember(key, &job.id);
    }
    Ok(accepted(app.describe(job, false)))
}

fn accepted(doc: Reconstruction) -> Response {
    let location = format!("/api/v1/reconstructions/{}", doc.id);
    (StatusCode::ACCEPTED, [(header::LOCATION, location)], Json(doc)).into_response()
}

/// Reconstructions, newest first.
#[utoipa::path(get, path = "/api/v1/reconstructions", tag = "reconstructions", operation_id = "reconstructions",
    params(PageQuery), responses((status = 200, body = ReconstructionPage), (status = 400, body = Problem)))]
pub async fn list(State(app): State<Arc<App>>, Params(query): Params<PageQuery>) -> Answer<Json<ReconstructionPage>> {
    let limit = query.limit.unwrap_or(50);
    if !(1..=1000).contains(&limit) {
        return Err(Problem::bad(format!("limit is {limit}; give 1 to 1000")));
    }
    if let Some(cursor) = &query.cursor {
        super::check_id(cursor).map_err(|_| Problem::bad("cursor is no cursor"))?;
    }
    let (jobs, next) = app.jobs.list(limit, query.cursor.as_deref()).await?;
    Ok(Json(ReconstructionPage { items: jobs.into_iter().map(|j| app.describe(j, false)).collect(), next }))
}

/// A reconstruction, or a session's own results by the session's id.
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

/// Cancels a reconstruction that is not done.
#[utoipa::path(post, path = "/api/v1/reconstructions/{id}/cancel", tag = "reconstructions",
    operation_id = "cancel_reconstruction", params(("id" = String, Path)),
    responses((status = 202, body = Reconstruction), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn cancel(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Response> {
    let job = app.job(&id).await?;
    if !matches!(job.state, JobState::Queued | JobState::Running) {
        return Err(Problem::new(Kind::Conflict, "the reconstruction has ended already"));
    }
    app.jobs.cancel(&id).await?;
    Ok(accepted(app.describe(app.job(&id).await?, false)))
}

/// Tries a reconstruction again that did not succeed.
#[utoipa::path(post, path = "/api/v1/reconstructions/{id}/retry", tag = "reconstructions",
    operation_id = "retry_reconstruction", params(("id" = String, Path)),
    responses((status = 202, body = Reconstruction), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn retry(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Response> {
    let job = app.job(&id).await?;
    if !matches!(job.state, JobState::Failed | JobState::Cancelled | JobState::SetAside) {
        return Err(Problem::new(Kind::Conflict, "the reconstruction has not failed"));
    }
    app.jobs.retry(&id).await?;
    Ok(accepted(app.describe(app.job(&id).await?, false)))
}

/// What happened to a reconstruction, line by line.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/log", tag = "reconstructions",
    operation_id = "reconstruction_log", params(("id" = String, Path)),
    responses((status = 200, content_type = "text/plain", body = String), (status = 404, body = Problem)))]
pub async fn log(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<String> {
    app.job(&id).await?;
    Ok(app.jobs.log(&id).await?.unwrap_or_default())
}

/// States of a reconstruction, as server-sent events: `state`.
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
    let mut changes = app.jobs.changes();
    let stream = events::stream(&app, &headers, log.clone())?;
    let weak = Arc::downgrade(&log);
    drop(log);
    tokio::spawn(async move {
        // Ends with the job, or when nobody listens any more.
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

/// A map: `NAME.png` for a picture (of a region), `NAME.exr`, `NAME.csv` or `NAME.npy` for its numbers; NAME is
/// orientation, sigma, dolp, mask, aolp or s0.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/maps/{file}", tag = "reconstructions", operation_id = "map",
    params(("id" = String, Path), ("file" = String, Path, description = "For instance orientation.png"), Region),
    responses((status = 200, content(([u8] = "image/png"), ([u8] = "application/octet-stream"), (String = "text/csv"))),
        (status = 400, body = Problem), (status = 404, body = Problem)))]
pub async fn map(
    State(app): State<Arc<App>>,
    At((id, file)): At<(String, String)>,
    Params(region): Params<Region>,
) -> Answer<Response> {
    let folder = app.place(&id).await?.results;
    let missing = || Problem::not_found(format!("map {file:?}"));
    let (name, kind) = file.split_once('.').ok_or_else(missing)?;
    let (exr, _) = maps::source(name).ok_or_else(missing)?;
    let (name, kind) = (name.to_owned(), kind.to_owned());
    match kind.as_str() {
        "exr" => return files::send(&files::inside(&folder, exr)?, files::BYTES).await,
        "png" | "csv" | "npy" => {}
        _ => return Err(missing()),
    }
    let view = maps::View {
        width: super::picture_width(region.width, 1024)?,
        region: match (region.x, region.y, region.w, region.h) {
            (None, None, None, None) => None,
            (x, y, w, h) => {
                let region = [x.unwrap_or(0), y.unwrap_or(0), w.unwrap_or(u16::MAX), h.unwrap_or(u16::MAX)];
                Some(region.map(usize::from))
            }
        },
    };
    let attached = format!("attachment; filename=\"{file}\"");
    let (bytes, content, range) = blocking(move || {
        let (plane, width) = maps::plane(&folder, &name)?;
        let range = maps::range_header(&name, &plane);
        let (bytes, content) = match kind.as_str() {
            "png" => (maps::picture(&name, &plane, width, &view, &encode_png8).map_err(Problem::bad)?, "image/png"),
            "csv" => (maps::csv(&name, &plane, width), "text/csv"),
            _ => (maps::npy(&plane, width), files::BYTES),
        };
        Ok((bytes, content, range))
    })
    .await?;
    if content == "image/png" {
        return Ok(([range], png(Ok(bytes))?).into_response());
    }
    Ok(([(header::CONTENT_TYPE, content.to_owned()), (header::CONTENT_DISPOSITION, attached)], bytes).into_response())
}

/// One pixel: its measured points, the fit, and what the maps say.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/pixel", tag = "reconstructions", operation_id = "pixel",
    params(("id" = String, Path), PixelQuery),
    responses((status = 200, body = Pixel), (status = 400, body = Problem), (status = 404, body = Problem)))]
pub async fn pixel(
    State(app): State<Arc<App>>,
    At(id): At<String>,
    Params(query): Params<PixelQuery>,
) -> Answer<Json<Pixel>> {
    let place = app.place(&id).await?;
    Ok(Json(blocking(move || read_pixel(&place, query.x, query.y)).await?))
}

fn read_pixel(place: &Place, x: usize, y: usize) -> Answer<Pixel> {
    let value = |name: &str| -> Answer<Option<f64>> {
        let (plane, width) = maps::plane(&place.results, name)?;
        let inside = x < width && y < plane.len() / width;
        let v = if inside {
            plane[y * width + x]
        } else {
            return Err(Problem::bad(format!("pixel {x}, {y} lies outside")));
        };
        Ok(v.is_finite().then_some(f64::from(v)))
    };
    let (orientation, sigma, dolp) = (value("orientation")?, value("sigma")?, value("dolp")?);
    let found = probe(&load(&place.input)?, x, y)?;
    let curve = |k: u32| {
        let deg = 2.0 * f64::from(k);
        let (sin, cos) = (2.0 * deg.to_radians()).sin_cos();
        FitPoint { analyser_deg: deg, value: 0.5 * (found.s0 + found.s1 * cos + found.s2 * sin) }
    };
    Ok(Pixel {
        x,
        y,
        fit: (0..=90).map(curve).collect(),
        s0: found.s0,
        s1: found.s1,
        s2: found.s2,
        residual_rms: found.residual_rms,
        saturated: found.saturated,
        points: found.points,
        orientation_deg: orientation.map(f64::to_degrees),
        sigma_deg: sigma.map(f64::to_degrees),
        dolp,
        masked: orientation.is_none(),
    })
}

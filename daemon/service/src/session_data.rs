//! Contents of a session: `/api/v1/sessions/{id}/frames`, `live.png` and `files`.

use super::devices::Width;
use super::problem::{Answer, Problem};
use super::{App, At, Params, blocking, maps, png};
use axum::Json;
use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use nacre_capture::plan::Role;
use nacre_capture::session::{Journal, SessionFile, unreadable_journal};
use nacre_image::encode_png8;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::sync::Arc;
use utoipa::{IntoParams, ToSchema};

/// Map and width of a live picture.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct LiveMap {
    /// `orientation`, `sigma` or `dolp`.
    #[param(pattern = "^(orientation|sigma|dolp)$")]
    map: Option<String>,
    /// Most pixels per row.
    #[param(minimum = 1, maximum = 16384)]
    width: Option<usize>,
}

/// A frame, with the evidence that it shows the commanded state.
#[derive(Debug, Serialize, ToSchema)]
pub struct FrameDoc {
    file: String,
    /// `series`, `dark` or `display_black`.
    role: String,
    analyser_deg: Option<f64>,
    exposure_s: f64,
    gain: f64,
    sequence: u64,
    timestamp_ns: u64,
    steady_since_ns: u64,
    dropped: u32,
    sha256: String,
}

/// The frames of a session.
#[derive(Debug, Serialize, ToSchema)]
pub struct FrameList {
    items: Vec<FrameDoc>,
}

/// A file of a session.
#[derive(Debug, Serialize, ToSchema)]
pub struct FileDoc {
    path: String,
    bytes: u64,
}

/// The files of a session.
#[derive(Debug, Serialize, ToSchema)]
pub struct FileList {
    items: Vec<FileDoc>,
}

/// Lists the frames, with the evidence that each shows the commanded state.
#[utoipa::path(get, path = "/api/v1/sessions/{id}/frames", tag = "sessions", operation_id = "session_frames",
    params(("id" = String, Path)), responses((status = 200, body = FrameList), (status = 404, body = Problem)))]
pub async fn frames(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Json<FrameList>> {
    if app.run(&id).is_some() && app.existing_session(&id).is_err() {
        // A session that still meters has no folder.
        return Ok(Json(FrameList { items: vec![] }));
    }
    let folder = app.existing_session(&id)?;
    let read = move || {
        let file = SessionFile::read(&folder).map_err(|e| Problem::bad(e.to_string()))?;
        let (journal, _) = Journal::read(&folder.join(Journal::NAME)).map_err(|e| unreadable_journal(&folder, &e))?;
        let steps = file.plan.steps_with(&journal.chosen());
        let doc = |step: &nacre_capture::plan::Step| {
            let commit = journal.commit(&step.file)?;
            let (exposure_s, gain) = commit.controls();
            Some(FrameDoc {
                file: step.file.clone(),
                role: match step.role {
                    Role::Series => "series".into(),
                    Role::Extra(extra) => nacre_capture::plan::word(extra),
                },
                analyser_deg: step.state.analyser_deg,
                exposure_s,
                gain,
                sequence: commit.sequence,
                timestamp_ns: commit.timestamp_ns,
                steady_since_ns: commit.steady_since_ns,
                dropped: commit.dropped,
                sha256: commit.sha256.clone(),
            })
        };
        Answer::Ok(FrameList { items: steps.iter().filter_map(doc).collect() })
    };
    Ok(Json(blocking(read).await?))
}

/// A frame: the stored 16-bit PNG, or with `width` a smaller picture with a display's gamma.
#[utoipa::path(get, path = "/api/v1/sessions/{id}/frames/{name}", tag = "sessions", operation_id = "session_frame",
    params(("id" = String, Path), ("name" = String, Path, description = "For instance 0000.png"), Width),
    responses((status = 200, content_type = "image/png", body = [u8]), (status = 400, body = Problem),
        (status = 404, body = Problem)))]
pub async fn frame(
    State(app): State<Arc<App>>,
    At((id, name)): At<(String, String)>,
    Params(query): Params<Width>,
    wishes: HeaderMap,
) -> Answer<Response> {
    let folder = app.existing_session(&id)?.join("frames");
    let path = super::files::inside(&folder, &name)?;
    match query.width {
        None => super::files::send(&path, "image/png", &wishes).await,
        Some(width) => {
            let width = super::picture_width(Some(width), width)?;
            let picture = app.heavy.answer(move || maps::thumbnail(&path, width)).await?;
            Ok(([(header::CONTENT_TYPE, "image/png")], picture).into_response())
        }
    }
}

/// Picture of the map computed from the frames so far.
#[utoipa::path(get, path = "/api/v1/sessions/{id}/live.png", tag = "sessions", operation_id = "live_map",
    params(("id" = String, Path), LiveMap),
    responses((status = 200, content_type = "image/png", body = [u8]), (status = 400, body = Problem),
        (status = 404, body = Problem)))]
pub async fn live(State(app): State<Arc<App>>, At(id): At<String>, Params(query): Params<LiveMap>) -> Answer<Response> {
    app.session_folder(&id)?;
    let missing = || Problem::not_found("map yet").remedy("wait for frames at three angles");
    let run = app.run(&id).ok_or_else(missing)?;
    let preview = run.preview().ok_or_else(missing)?;
    let name = query.map.unwrap_or_else(|| "orientation".into());
    let plane = match name.as_str() {
        "orientation" => &preview.orientation,
        "sigma" => &preview.sigma,
        "dolp" => &preview.dolp,
        _ => return Err(Problem::bad(format!("map is {name:?}; give orientation, sigma or dolp"))),
    };
    let options = run.plan.reconstruct.as_ref().and_then(|r| r.options_of::<nacre_polarimetry::Options>());
    let palette = options.and_then(Result::ok).map(|o| o.palette).unwrap_or_default();
    let view = maps::View { width: super::picture_width(query.width, 512)?, region: None, palette };
    let body = png(maps::picture(&name, plane, preview.width, &view, &encode_png8).map_err(std::io::Error::other));
    Ok(([maps::range_header(&name, plane), maps::palette_header(palette)], body?).into_response())
}

/// Lists the files of a session.
#[utoipa::path(get, path = "/api/v1/sessions/{id}/files", tag = "sessions", operation_id = "session_files",
    params(("id" = String, Path)), responses((status = 200, body = FileList), (status = 404, body = Problem)))]
pub async fn files(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Json<FileList>> {
    // A session that still meters has no folder.
    let folder = if app.run(&id).is_some() { app.session_folder(&id)? } else { app.existing_session(&id)? };
    let files = blocking(move || Answer::Ok(super::files::list(&folder))).await?;
    Ok(Json(FileList { items: files.into_iter().map(|(path, bytes)| FileDoc { path, bytes }).collect() }))
}

/// Downloads a file of a session.
#[utoipa::path(get, path = "/api/v1/sessions/{id}/files/{path}", tag = "sessions", operation_id = "session_file",
    params(("id" = String, Path), ("path" = String, Path, description = "For instance results/orientation.exr")),
    responses((status = 200, content_type = "application/octet-stream", body = [u8]), (status = 400, body = Problem),
        (status = 404, body = Problem)))]
pub async fn file(
    State(app): State<Arc<App>>,
    At((id, path)): At<(String, PathBuf)>,
    wishes: HeaderMap,
) -> Answer<Response> {
    let folder = app.existing_session(&id)?;
    super::files::send(&super::files::inside(&folder, &path.to_string_lossy())?, super::files::BYTES, &wishes).await
}

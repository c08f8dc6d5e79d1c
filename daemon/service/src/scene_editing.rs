//! `/api/v1/uploads/{id}/scene`: the scene of an upload while it is edited. Checks convert between TOML and JSON, and
//! drafts show it. Uploads never change: renderings take the edited text as the option `scene`.

use super::problem::{Answer, Problem};
use super::{App, At, Body, blocking, files, naming, work};
use axum::Json;
use axum::extract::State;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use nacre_base::progress::Progress;
use nacre_capture::naming::ABOUT_FILE;
use nacre_render::{Scene, scene_text};
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::Path;
use std::sync::Arc;
use tokio_util::sync::CancellationToken;
use utoipa::ToSchema;

/// Sides of drafts in pixels.
const SIDES: std::ops::RangeInclusive<usize> = 16..=512;

/// Side of a draft by default.
const SIDE: usize = 240;

/// A scene, as the text of a TOML file or as JSON with the same keys.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneBody {
    /// The scene as TOML.
    toml: Option<String>,
    /// Or the scene as JSON; its JSON Schema is at `/api/v1/scenes/schema`.
    #[schema(value_type = Option<Object>)]
    scene: Option<Value>,
}

/// A scene with the result of its check.
#[derive(Debug, Serialize, ToSchema)]
pub struct CheckedScene {
    /// Name of the upload.
    name: String,
    /// The scene as TOML, as given or converted.
    toml: String,
    /// The scene as JSON, with the keys that are given; null if the TOML cannot be read.
    #[schema(value_type = Option<Object>)]
    scene: Option<Value>,
    /// The reason why it cannot be rendered, with the key; null if it can.
    problem: Option<String>,
    /// Defaults that determine the picture and are not stated.
    hints: Vec<String>,
    /// Files of the upload that a scene may name.
    files: Vec<String>,
}

/// A draft of a scene.
#[derive(Debug, Deserialize, ToSchema)]
#[serde(deny_unknown_fields)]
pub struct Draft {
    /// The scene as TOML.
    toml: String,
    /// Longest side in pixels (default: 240).
    #[schema(minimum = 16, maximum = 512)]
    side: Option<usize>,
}

/// JSON Schema of a scene.
#[utoipa::path(get, path = "/api/v1/scenes/schema", tag = "reconstructions", operation_id = "scene_schema",
    responses((status = 200, body = Object)))]
pub async fn schema() -> Json<Value> {
    Json(schemars::schema_for!(Scene).to_value())
}

/// Reads the scene of an upload.
#[utoipa::path(get, path = "/api/v1/uploads/{id}/scene", tag = "reconstructions", operation_id = "scene",
    params(("id" = String, Path)),
    responses((status = 200, body = CheckedScene), (status = 400, body = Problem), (status = 404, body = Problem)))]
pub async fn read(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Json<CheckedScene>> {
    let folder = app.existing_upload(&id)?;
    blocking(move || Ok(Json(checked(scene_text(&folder)?, &folder)))).await
}

/// Checks an edited scene with the files of an upload, and converts between TOML and JSON.
#[utoipa::path(post, path = "/api/v1/uploads/{id}/scene", tag = "reconstructions", operation_id = "check_scene",
    request_body = SceneBody, params(("id" = String, Path)),
    responses((status = 200, body = CheckedScene), (status = 400, body = Problem), (status = 404, body = Problem)))]
pub async fn check(
    State(app): State<Arc<App>>,
    At(id): At<String>,
    Body(body): Body<SceneBody>,
) -> Answer<Json<CheckedScene>> {
    let folder = app.existing_upload(&id)?;
    let toml = match body {
        SceneBody { toml: Some(toml), scene: None } => toml,
        SceneBody { toml: None, scene: Some(scene) } => toml::to_string(&scene).map_err(|e| {
            Problem::bad(format!("the scene cannot be written as TOML: {e}")).remedy("fill all numbers")
        })?,
        _ => return Err(Problem::bad("give either toml or scene")),
    };
    blocking(move || Ok(Json(checked(toml, &folder)))).await
}

fn checked(toml: String, folder: &Path) -> CheckedScene {
    let found = Scene::beside(&toml, folder);
    let mut files: Vec<String> = files::list(folder).into_iter().map(|file| file.0).collect();
    files.retain(|name| name != ABOUT_FILE);
    let (problem, hints) = match found {
        Ok(scene) => (None, scene.hints),
        Err(error) => (Some(error.to_string()), vec![]),
    };
    CheckedScene { name: naming::of_upload(folder), scene: toml::from_str(&toml).ok(), toml, problem, hints, files }
}

/// Stops a draft whose request was dropped.
struct Waiting(CancellationToken);

impl Progress for Waiting {
    fn stage(&self, _: &str, _: u64) {}
    fn step(&self) {}
    fn cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}

/// Renders a draft of an edited scene: a small noisy picture, within seconds. It ends with its request.
#[utoipa::path(post, path = "/api/v1/uploads/{id}/scene/draft", tag = "reconstructions", operation_id = "draft_scene",
    request_body = Draft, params(("id" = String, Path)),
    responses((status = 200, content(([u8] = "image/png"))), (status = 400, body = Problem), (status = 404, body = Problem)))]
pub async fn draft(State(app): State<Arc<App>>, At(id): At<String>, Body(body): Body<Draft>) -> Answer<Response> {
    let folder = app.existing_upload(&id)?;
    let side = body.side.unwrap_or(SIDE);
    if !SIDES.contains(&side) {
        return Err(Problem::bad(format!("side is {side}")).remedy("give 16 to 512 pixels"));
    }
    let wanted = CancellationToken::new();
    let _ends_with_request = wanted.clone().drop_guard();
    let render = move || Ok(work::draft(folder, body.toml, side, &Waiting(wanted))?);
    let png = app.heavy.work(render).await?;
    Ok(([(header::CONTENT_TYPE, "image/png")], png).into_response())
}

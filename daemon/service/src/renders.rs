//! Pictures of renderings, under way and complete: `/api/v1/reconstructions/{id}/picture.png`.

use super::problem::{Answer, Kind, Problem};
use super::{App, At, Params, files, png};
use axum::extract::State;
use axum::http::{HeaderMap, header};
use axum::response::{IntoResponse, Response};
use nacre_render::SoFar;
use serde::Deserialize;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use utoipa::IntoParams;

/// Most pixels of a picture that is re-exposed for a request.
const MOST_PIXELS: usize = 4 << 20;

/// Longest side of such a picture in pixels.
const SIDE: usize = 1024;

/// An intermediate picture of a rendering.
pub struct Glimpse {
    /// The picture, as a PNG.
    pub png: Vec<u8>,
    /// Progress of the rendering.
    pub so_far: SoFar,
}

/// The newest picture of the rendering under way. Jobs run one at a time, so one picture is kept.
#[derive(Default)]
pub struct Renders(Mutex<Option<(String, Arc<Glimpse>)>>);

impl Renders {
    fn locked(&self) -> MutexGuard<'_, Option<(String, Arc<Glimpse>)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Replaces the picture by a newer one of this job.
    pub fn show(&self, id: &str, glimpse: Glimpse) {
        *self.locked() = Some((id.into(), Arc::new(glimpse)));
    }

    /// Drops the picture: no rendering is under way.
    pub fn clear(&self) {
        *self.locked() = None;
    }

    /// The picture of a job, if that job is being rendered.
    pub fn of(&self, id: &str) -> Option<Arc<Glimpse>> {
        self.locked().as_ref().filter(|shown| shown.0 == id).map(|shown| shown.1.clone())
    }
}

/// Exposure of a picture.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct Look {
    /// Exposure compensation in stops, for complete pictures; the picture is at most 1024 pixels wide.
    #[param(minimum = -16, maximum = 16)]
    stops: Option<f64>,
}

/// Picture of a rendering: intermediate pictures about every second, and render.png once it is complete.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/picture.png", tag = "reconstructions", operation_id = "picture",
    params(("id" = String, Path), Look),
    responses((status = 200, content(([u8] = "image/png"))), (status = 400, body = Problem), (status = 404, body = Problem)))]
pub async fn picture(
    State(app): State<Arc<App>>,
    At(id): At<String>,
    Params(look): Params<Look>,
    wishes: HeaderMap,
) -> Answer<Response> {
    let stops = look.stops.unwrap_or(0.0);
    if !(-16.0..=16.0).contains(&stops) {
        return Err(Problem::bad(format!("stops are {stops}; give -16 to 16")));
    }
    let job = app.job(&id).await?;
    if let Some(glimpse) = app.renders.of(&job.id) {
        return Ok(png(Ok(glimpse.png.clone()))?.into_response());
    }
    let folder = app.result_folder(&job.id);
    let Ok(done) = files::inside(&folder, "render.png") else {
        return Err(Problem::not_found("picture yet").remedy("wait for the first pass of a rendering"));
    };
    if stops == 0.0 {
        return files::send(&done, "image/png", &wishes).await;
    }
    let picture = app.heavy.answer(move || exposed(&folder, stops)).await?;
    Ok(([(header::CONTENT_TYPE, "image/png")], picture).into_response())
}

/// Keys of a report that describe its picture.
#[derive(Deserialize)]
struct Shown {
    size: [usize; 2],
    exposure: f64,
}

fn exposed(folder: &Path, stops: f64) -> Answer<Vec<u8>> {
    let internal = |e: String| Problem::new(Kind::Internal, format!("the result cannot be read: {e}"));
    let report = files::report(folder).map_err(|e| internal(e.to_string()))?;
    let Shown { size, exposure } = serde_json::from_slice(&report).map_err(|e| internal(e.to_string()))?;
    if size[0].saturating_mul(size[1]) > MOST_PIXELS {
        return Err(Problem::bad("the picture has more than 4 Mpixel").remedy("expose render.exr elsewhere"));
    }
    let picture = nacre_render::read_picture(&folder.join("render.exr"))?.shrunk(SIDE);
    nacre_render::png(&picture, exposure * stops.exp2()).map_err(|e| internal(e.to_string()))
}

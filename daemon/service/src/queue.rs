//! `/api/v1/queue`: jobs that run or wait.

use super::problem::{Answer, Problem};
use super::reconstructions::Reconstruction;
use super::{App, At};
use axum::Json;
use axum::extract::State;
use std::sync::Arc;

/// Lists the reconstructions that run or wait, in the order in which they run.
#[utoipa::path(get, path = "/api/v1/queue", tag = "reconstructions", operation_id = "queue",
    responses((status = 200, body = Vec<Reconstruction>)))]
pub async fn list(State(app): State<Arc<App>>) -> Answer<Json<Vec<Reconstruction>>> {
    let jobs = app.jobs()?.queue().await?;
    Ok(Json(jobs.into_iter().map(|job| app.describe(job, false)).collect()))
}

/// Moves a waiting reconstruction to the front of the queue.
#[utoipa::path(post, path = "/api/v1/queue/{id}/first", tag = "reconstructions", operation_id = "move_to_front",
    params(("id" = String, Path)), responses((status = 200, body = Vec<Reconstruction>),
        (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn first(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Json<Vec<Reconstruction>>> {
    super::check_id(&id)?;
    app.jobs()?.to_the_front(&id).await?;
    list(State(app)).await
}

//! `/api/v1/charts`: charts that `nacre chart` wrote below the service's data folder.

use super::problem::{Answer, Problem};
use super::{App, At, blocking, files};
use axum::Json;
use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use nacre_studies::{Chart, catalogue};
use serde::Serialize;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use utoipa::ToSchema;

/// Most folders in a list: the last ones by name, which are the newest where names are dates.
const MOST: usize = 100;

/// Folders of charts.
#[derive(Debug, Serialize, ToSchema)]
pub struct ChartList {
    items: Vec<ChartFolder>,
}

/// A folder that `nacre chart --out DATA/charts/NAME` wrote.
#[derive(Debug, Serialize, ToSchema)]
pub struct ChartFolder {
    /// Name of the folder.
    folder: String,
    /// Charts as `{name, group, title, text, quick, measured, files}`. Fetch a file from `/api/v1/charts/FOLDER/FILE`.
    #[schema(value_type = Vec<Object>)]
    charts: Vec<Chart>,
}

/// Lists all charts, the last folder by name first.
#[utoipa::path(get, path = "/api/v1/charts", tag = "charts", operation_id = "list_charts",
    responses((status = 200, body = ChartList)))]
pub async fn list(State(app): State<Arc<App>>) -> Answer<Json<ChartList>> {
    let place = app.config().data.join("charts");
    Ok(Json(ChartList { items: blocking(move || Ok(folders(&place))).await? }))
}

fn folders(place: &Path) -> Vec<ChartFolder> {
    let entries = std::fs::read_dir(place).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries.filter_map(|e| e.file_name().into_string().ok()).collect();
    names.sort_by(|a, b| b.cmp(a));
    let open = |folder: String| match catalogue(&place.join(&folder)) {
        Ok(charted) if charted.charts.is_empty() => None,
        Ok(charted) => Some(ChartFolder { folder, charts: charted.charts }),
        Err(error) => {
            tracing::warn!(%error, "a folder of charts is left out");
            None
        }
    };
    names.into_iter().filter_map(open).take(MOST).collect()
}

/// Path of a folder of charts.
///
/// # Errors
/// `not-found` if there is no such folder, or `nacre chart` did not write it.
pub fn existing(place: &Path, folder: &str) -> Answer<PathBuf> {
    let path = place.join(folder);
    let plain = Path::new(folder).components().eq([Component::Normal(folder.as_ref())]);
    let listed = || catalogue(&path).is_ok_and(|charted| !charted.charts.is_empty());
    if plain && std::fs::symlink_metadata(&path).is_ok_and(|m| m.is_dir()) && listed() {
        Ok(path)
    } else {
        Err(Problem::not_found("such folder of charts"))
    }
}

/// Downloads a file of a chart: SVG, PNG, CSV, JSON or the raw measurements.
#[utoipa::path(get, path = "/api/v1/charts/{folder}/{chart}/{file}", tag = "charts", operation_id = "chart_file",
    params(("folder" = String, Path), ("chart" = String, Path), ("file" = String, Path, description = "For instance frames.png")),
    responses((status = 200, content(([u8] = "image/png"), ([u8] = "application/octet-stream"))),
        (status = 404, body = Problem)))]
pub async fn file(
    State(app): State<Arc<App>>,
    At((folder, chart, file)): At<(String, String, String)>,
    wishes: HeaderMap,
) -> Answer<Response> {
    let path = files::inside(&app.config().data.join("charts"), &format!("{folder}/{chart}/{file}"))?;
    let kind = if path.extension().is_some_and(|e| e == "png") { "image/png" } else { files::BYTES };
    files::send(&path, kind, &wishes).await
}

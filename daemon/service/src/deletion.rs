//! Deletions and their confirmation.

use super::keeper::is_full;
use super::problem::{Answer, Kind, Problem};
use super::trash::{Deleted, Thing};
use super::{App, At, Params, blocking, charts, files, naming};
use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use nacre_capture::session::lock;
use nacre_store::catalogue::SessionRow;
use nacre_store::jobs::{JobState, Refusal};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use utoipa::{IntoParams, ToSchema};

/// Summary of a deletion, and the token that confirms it.
#[derive(Debug, Serialize, ToSchema)]
pub struct Deletion {
    token: String,
    bytes: u64,
    files: usize,
    /// Days that it can be restored from the trash; 0 deletes it at once.
    trash_days: u64,
}

impl Deletion {
    /// Summary of the deletion of these files.
    pub fn of(app: &App, id: &str, files: &[(String, u64)], trash_days: u64) -> Json<Self> {
        let bytes = files.iter().map(|f| f.1).sum();
        Json(Self { token: app.deletion_token(id), bytes, files: files.len(), trash_days })
    }
}

/// Confirmation of a deletion.
#[derive(Debug, Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
#[serde(deny_unknown_fields)]
pub struct Confirmation {
    /// Token from `deletion`.
    token: String,
}

/// Summarises the deletion of a session, and gives the token that confirms it.
#[utoipa::path(get, path = "/api/v1/sessions/{id}/deletion", tag = "sessions", operation_id = "session_deletion",
    params(("id" = String, Path)), responses((status = 200, body = Deletion), (status = 404, body = Problem)))]
pub async fn of_session(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Json<Deletion>> {
    let folder = app.existing_session(&id)?;
    let files = blocking(move || Answer::Ok(files::list(&folder))).await?;
    Ok(Deletion::of(&app, &id, &files, app.trash_days()))
}

/// Deletes a session with all its files: it goes to the trash.
#[utoipa::path(delete, path = "/api/v1/sessions/{id}", tag = "sessions", operation_id = "delete_session",
    params(("id" = String, Path), Confirmation),
    responses((status = 204), (status = 400, body = Problem), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn session(
    State(app): State<Arc<App>>,
    At(id): At<String>,
    Params(query): Params<Confirmation>,
) -> Answer<StatusCode> {
    let folder = app.existing_session(&id)?;
    confirmed(&app, &id, &query)?;
    if app.run(&id).is_some_and(|r| !r.is_over()) {
        return Err(Problem::new(Kind::Busy, "the session is running").remedy("abort it first"));
    }
    if let Some(jobs) = app.stores.jobs()
        && let Some(job) = jobs.open_of_session(&id).await?
    {
        return Err(Problem::new(Kind::Conflict, format!("reconstruction {job} of the session is not done"))
            .remedy("wait for it, or cancel it first"));
    }
    let _turn = app.trash_turn.lock().await;
    let (owner, known) = (app.clone(), id.clone());
    let row = blocking(move || {
        // The session's own lock prevents other work on it.
        let locked = lock(&folder);
        if locked.as_ref().is_err_and(|e| e.kind() == std::io::ErrorKind::WouldBlock) {
            return Err(Problem::new(Kind::Busy, "another process works on the session"));
        }
        let row = SessionRow::read(&folder).ok();
        let name = row.as_ref().map_or_else(|| known.clone(), |row| row.name.clone());
        owner.discard(&known, &Deleted::now(Thing::Session, name, None), &[folder])?;
        Ok(row)
    })
    .await?;
    app.runs.remove(&id);
    if let Some(row) = row {
        app.stores.forget(&row).await;
    }
    Ok(StatusCode::NO_CONTENT)
}

/// Summarises the deletion of a reconstruction, and gives the token that confirms it. Its upload is deleted with the
/// last reconstruction that uses it.
#[utoipa::path(get, path = "/api/v1/reconstructions/{id}/deletion", tag = "reconstructions", operation_id = "reconstruction_deletion",
    params(("id" = String, Path)), responses((status = 200, body = Deletion), (status = 404, body = Problem)))]
pub async fn of_reconstruction(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Json<Deletion>> {
    let folders = folders(&app, &id).await?;
    let files = blocking(move || Answer::Ok(folders.iter().flat_map(|f| files::list(f)).collect::<Vec<_>>())).await?;
    Ok(Deletion::of(&app, &id, &files, app.trash_days()))
}

/// Deletes a reconstruction that has ended, with all its files: they go to the trash. Results of a session are deleted
/// with the session.
#[utoipa::path(delete, path = "/api/v1/reconstructions/{id}", tag = "reconstructions", operation_id = "delete_reconstruction",
    params(("id" = String, Path), Confirmation),
    responses((status = 204), (status = 400, body = Problem), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn reconstruction(
    State(app): State<Arc<App>>,
    At(id): At<String>,
    Params(query): Params<Confirmation>,
) -> Answer<StatusCode> {
    let folders = folders(&app, &id).await?;
    confirmed(&app, &id, &query)?;
    let _turn = app.trash_turn.lock().await;
    let Some(saved) = app.jobs()?.saved(&id).await? else {
        return Err(app.missing("reconstruction", &id));
    };
    let name = app.name_of(&saved.spec);
    let deleted = Deleted::now(Thing::Reconstruction, name, Some(saved.clone()));
    let (owner, known) = (app.clone(), id.clone());
    let delete = move || owner.discard(&known, &deleted, &folders);
    // The queue comes first: it refuses while the job runs.
    match app.jobs()?.remove(&id).await {
        Ok(()) => {
            if let Err(problem) = blocking(delete).await {
                app.jobs()?.restore(&saved).await?;
                return Err(problem);
            }
        }
        // Removing a job takes some space too.
        Err(Refusal::Queue(error)) if is_full(&error) => {
            if matches!(app.job(&id).await?.state, JobState::Queued | JobState::Running) {
                return Err(Problem::new(Kind::Conflict, "the reconstruction is not done").remedy("cancel it first"));
            }
            blocking(delete).await?;
            app.jobs()?.remove(&id).await?;
        }
        Err(refusal) => return Err(refusal.into()),
    }
    Ok(StatusCode::NO_CONTENT)
}

/// Summarises the deletion of an upload. Its token is not required for the deletion.
#[utoipa::path(get, path = "/api/v1/uploads/{id}/deletion", tag = "reconstructions", operation_id = "upload_deletion",
    params(("id" = String, Path)), responses((status = 200, body = Deletion), (status = 404, body = Problem)))]
pub async fn of_upload(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Json<Deletion>> {
    let folder = app.existing_upload(&id)?;
    let files = blocking(move || Answer::Ok(files::list(&folder))).await?;
    Ok(Deletion::of(&app, &id, &files, app.trash_days()))
}

/// Deletes an upload that no reconstruction uses: it goes to the trash.
#[utoipa::path(delete, path = "/api/v1/uploads/{id}", tag = "reconstructions", operation_id = "delete_upload",
    params(("id" = String, Path)),
    responses((status = 204), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn upload(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<StatusCode> {
    let _turn = app.trash_turn.lock().await;
    let folder = app.existing_upload(&id)?;
    if let Some(job) = app.uploads_in_use().await?.get(&id).and_then(|jobs| jobs.first()) {
        return Err(Problem::new(Kind::Conflict, format!("reconstruction {job} uses the upload"))
            .remedy("delete that, and the upload goes with it"));
    }
    let owner = app.clone();
    blocking(move || {
        let deleted = Deleted::now(Thing::Upload, naming::of_upload(&folder), None);
        owner.discard(&id, &deleted, &[folder])
    })
    .await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Summarises the deletion of a folder of charts, and gives the token that confirms it.
#[utoipa::path(get, path = "/api/v1/charts/{folder}/deletion", tag = "charts", operation_id = "charts_deletion",
    params(("folder" = String, Path)), responses((status = 200, body = Deletion), (status = 404, body = Problem)))]
pub async fn of_charts(State(app): State<Arc<App>>, At(folder): At<String>) -> Answer<Json<Deletion>> {
    let (place, name) = (app.config().data.join("charts"), folder.clone());
    let files = blocking(move || Answer::Ok(files::list(&charts::existing(&place, &name)?))).await?;
    Ok(Deletion::of(&app, &format!("charts/{folder}"), &files, 0))
}

/// Deletes a folder of charts, with its measurements.
#[utoipa::path(delete, path = "/api/v1/charts/{folder}", tag = "charts", operation_id = "delete_charts",
    params(("folder" = String, Path), Confirmation),
    responses((status = 204), (status = 400, body = Problem), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn charts_folder(
    State(app): State<Arc<App>>,
    At(folder): At<String>,
    Params(query): Params<Confirmation>,
) -> Answer<StatusCode> {
    let (place, name) = (app.config().data.join("charts"), folder.clone());
    let path = blocking(move || charts::existing(&place, &name)).await?;
    confirmed(&app, &format!("charts/{folder}"), &query)?;
    blocking(move || removed(&path)).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Folders that are deleted with a reconstruction.
async fn folders(app: &App, id: &str) -> Answer<Vec<PathBuf>> {
    let job = app.job(id).await?;
    let mut folders = vec![app.result_folder(id)];
    let light = job.spec.light.as_ref().map(|light| &light.upload);
    let in_use = app.jobs()?.uploads().await?;
    for upload in job.upload.iter().chain(light.filter(|light| job.upload.as_ref() != Some(*light))) {
        if in_use.get(upload).is_none_or(|jobs| jobs.len() <= 1) {
            folders.push(app.upload_folder(upload)?);
        }
    }
    Ok(folders)
}

fn confirmed(app: &App, id: &str, given: &Confirmation) -> Answer<()> {
    if given.token == app.deletion_token(id) {
        return Ok(());
    }
    Err(Problem::new(Kind::Conflict, "the token does not confirm this deletion").remedy("ask /deletion for the token"))
}

/// Removes a folder; one that does not exist is no error.
///
/// # Errors
/// Those of the system.
pub fn removed(folder: &Path) -> Answer<()> {
    match std::fs::remove_dir_all(folder) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Problem::refused("it cannot be deleted", &e)),
        _ => Ok(()),
    }
}

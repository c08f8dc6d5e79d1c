//! `/api/v1/trash`: deleted sessions, uploads, reconstructions and calibrations, until restored, deleted for good, or
//! expired.
//!
//! `trash/ID/` in the data folder holds `deleted.json`, and the deleted folders under their former paths. An entry
//! without `deleted.json` is the remainder of an interrupted deletion.

use super::deletion::removed;
use super::problem::{Answer, Kind, Problem};
use super::{App, At, blocking, check_id, files};
use axum::Json;
use axum::extract::State;
use axum::http::StatusCode;
use nacre_base::input;
use nacre_base::temporary::TemporaryFolder;
use nacre_capture::calibrations;
use nacre_store::catalogue::DELETED_FILE;
use nacre_store::jobs::Saved;
use serde::{Deserialize, Serialize};
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use utoipa::ToSchema;

/// Largest `deleted.json`, in bytes.
const MAX_BYTES: u64 = 16 << 20;

/// Folders of the data folder whose contents can be deleted.
const FROM: [&str; 4] = ["sessions", "reconstructions", "uploads", calibrations::FOLDER];

/// Kind of an entry in the trash.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum Thing {
    /// A session with its results.
    Session,
    /// An upload that no reconstruction used.
    Upload,
    /// A reconstruction or rendering, with the uploads that no other one used.
    Reconstruction,
    /// A calibration.
    Calibration,
}

/// Contents of `deleted.json`.
#[derive(Serialize, Deserialize)]
pub struct Deleted {
    kind: Thing,
    name: String,
    /// Time of the deletion in Unix seconds.
    deleted: u64,
    job: Option<Saved>,
}

impl Deleted {
    /// Entry of a deletion at the current time.
    pub fn now(kind: Thing, name: String, job: Option<Saved>) -> Self {
        Self { kind, name, deleted: now().as_secs(), job }
    }
}

/// An entry in the trash.
#[derive(Debug, Serialize, ToSchema)]
pub struct TrashItem {
    /// Former id; restoring gives it back.
    id: String,
    kind: Thing,
    name: String,
    /// Time of the deletion in Unix seconds.
    deleted: u64,
    /// Time in Unix seconds at which it is deleted for good; earlier if disk space becomes short.
    expires: u64,
    files: usize,
    bytes: u64,
}

/// The trash, newest deletion first.
#[derive(Debug, Serialize, ToSchema)]
pub struct Trash {
    items: Vec<TrashItem>,
    /// Days that entries stay in the trash (`limits.trash_days`).
    days: u64,
}

fn now() -> Duration {
    SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default()
}

impl App {
    /// Days that an entry deleted now can be restored; 0 if deletions are immediate.
    pub fn trash_days(&self) -> u64 {
        if self.stores.is_short() { 0 } else { self.config().limits.trash_days }
    }

    /// Problem of a missing resource; the remedy names the trash if it is there.
    pub fn missing(&self, thing: &str, id: &str) -> Problem {
        let problem = Problem::not_found(format!("{thing} {id}"));
        if self.trash().join(id).join(DELETED_FILE).exists() {
            return problem.remedy("restore it from the trash");
        }
        problem
    }

    fn trash(&self) -> PathBuf {
        self.config().data.join("trash")
    }

    /// Seconds that entries stay in the trash.
    fn kept_s(&self) -> u64 {
        self.config().limits.trash_days * 24 * 3600
    }

    /// Deletes folders of the data folder: into the trash, or at once if the trash is off or `deleted.json` does not
    /// fit.
    ///
    /// # Errors
    /// Those of the system.
    pub fn discard(&self, id: &str, deleted: &Deleted, folders: &[PathBuf]) -> Answer<()> {
        if self.trash_days() > 0
            && let Err(error) = keep(&self.config().data, id, deleted, folders)
            && !matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::QuotaExceeded)
        {
            return Err(Problem::refused("it cannot be moved to the trash", &error));
        }
        folders.iter().try_for_each(|folder| removed(folder))
    }
}

/// Moves folders into the trash.
fn keep(data: &Path, id: &str, deleted: &Deleted, folders: &[PathBuf]) -> io::Result<()> {
    let (trash, place) = (data.join("trash"), data.join("trash").join(id));
    let entry = TemporaryFolder::new(&trash, id.as_ref())?;
    fs::write(entry.path().join(DELETED_FILE), serde_json::to_vec(deleted)?)?;
    if place.exists() {
        // Remainder of a deletion that was interrupted before anything was moved.
        fs::remove_dir_all(&place)?;
    }
    fs::rename(entry.path(), &place)?;
    entry.keep();
    for folder in folders.iter().filter(|folder| folder.exists()) {
        let target = place.join(folder.strip_prefix(data).map_err(io::Error::other)?);
        target.parent().map_or(Ok(()), fs::create_dir_all)?;
        fs::rename(folder, target)?;
    }
    Ok(())
}

/// Ids of the entries.
fn ids(trash: &Path) -> Vec<String> {
    let entries = fs::read_dir(trash).into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.file_name().into_string().ok()).filter(|name| check_id(name).is_ok()).collect()
}

fn read(trash: &Path, id: &str) -> Option<Deleted> {
    serde_json::from_slice(&input::read(&trash.join(id).join(DELETED_FILE), MAX_BYTES).ok()?).ok()
}

/// Folders of an entry, by their former paths in the data folder.
fn contents(entry: &Path) -> Vec<PathBuf> {
    let inside = |from: &str| {
        let ids = ids(&entry.join(from)).into_iter();
        ids.map(|id| Path::new(from).join(id)).collect::<Vec<_>>()
    };
    FROM.iter().flat_map(|from| inside(from)).collect()
}

fn item(trash: &Path, id: &str, kept_s: u64) -> Option<TrashItem> {
    let Deleted { kind, name, deleted, .. } = read(trash, id)?;
    let mut all = files::list(&trash.join(id));
    all.retain(|(name, _)| name != DELETED_FILE);
    let (files, bytes) = (all.len(), all.iter().map(|file| file.1).sum());
    Some(TrashItem { id: id.into(), kind, name, deleted, expires: deleted.saturating_add(kept_s), files, bytes })
}

fn missing(id: &str) -> Problem {
    Problem::not_found(format!("{id} in the trash")).remedy("it may have been restored or deleted for good")
}

/// Deletes an entry for good.
fn purge(trash: &Path, id: &str) -> Answer<()> {
    let entry = trash.join(id);
    // Removed first, so that an incomplete entry cannot be restored.
    match fs::remove_file(entry.join(DELETED_FILE)) {
        Err(e) if e.kind() != ErrorKind::NotFound => Err(Problem::refused("it cannot be deleted", &e)),
        _ => removed(&entry),
    }
}

/// Lists the trash.
#[utoipa::path(get, path = "/api/v1/trash", tag = "trash", operation_id = "trash", responses((status = 200, body = Trash)))]
pub async fn list(State(app): State<Arc<App>>) -> Answer<Json<Trash>> {
    let (trash, kept_s, days) = (app.trash(), app.kept_s(), app.config().limits.trash_days);
    let mut items: Vec<_> =
        blocking(move || Ok(ids(&trash).iter().filter_map(|id| item(&trash, id, kept_s)).collect())).await?;
    items.sort_by(|a: &TrashItem, b| (b.deleted, &b.id).cmp(&(a.deleted, &a.id)));
    Ok(Json(Trash { items, days }))
}

/// Restores an entry under its former id.
#[utoipa::path(post, path = "/api/v1/trash/{id}/restore", tag = "trash", operation_id = "restore", params(("id" = String, Path)),
    responses((status = 200, body = TrashItem), (status = 404, body = Problem), (status = 409, body = Problem)))]
pub async fn restore(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<Json<TrashItem>> {
    check_id(&id)?;
    let _turn = app.trash_turn.lock().await;
    let (trash, kept_s, known) = (app.trash(), app.kept_s(), id.clone());
    let found = move || item(&trash, &known, kept_s).zip(read(&trash, &known)).ok_or_else(|| missing(&known));
    let (item, deleted) = blocking(found).await?;
    // Fails before anything is moved if the queue is closed.
    if let Some(job) = &deleted.job {
        app.jobs()?.restore(job).await?;
    }
    let (data, known) = (app.config().data.clone(), id.clone());
    blocking(move || put_back(&data, &known, deleted.job.as_ref())).await?;
    if item.kind == Thing::Session {
        app.note(&app.session_folder(&id)?).await;
    }
    Ok(Json(item))
}

fn put_back(data: &Path, id: &str, job: Option<&Saved>) -> Answer<()> {
    let (trash, entry) = (data.join("trash"), data.join("trash").join(id));
    for folder in contents(&entry) {
        let target = data.join(&folder);
        if target.exists() {
            return Err(
                Problem::new(Kind::Conflict, "its id is in use").remedy("delete the resource with that id first")
            );
        }
        move_back(&entry.join(folder), &target)?;
    }
    // Uploads shared by several reconstructions are in the trash with the last of them.
    let light = job.and_then(|job| job.spec.light.as_ref()).map(|light| &light.upload);
    for upload in job.and_then(|job| job.spec.upload.as_ref()).into_iter().chain(light) {
        check_id(upload)?;
        let place = Path::new("uploads").join(upload);
        let elsewhere = ids(&trash).into_iter().map(|other| trash.join(other).join(&place)).find(|p| p.is_dir());
        if let Some(elsewhere) = elsewhere.filter(|_| !data.join(&place).exists()) {
            move_back(&elsewhere, &data.join(&place))?;
        }
    }
    purge(&trash, id)
}

fn move_back(from: &Path, to: &Path) -> Answer<()> {
    fs::rename(from, to).map_err(|e| Problem::refused("it cannot be restored", &e))
}

/// Deletes an entry of the trash for good.
#[utoipa::path(delete, path = "/api/v1/trash/{id}", tag = "trash", operation_id = "delete_for_good", params(("id" = String, Path)),
    responses((status = 204), (status = 404, body = Problem)))]
pub async fn delete(State(app): State<Arc<App>>, At(id): At<String>) -> Answer<StatusCode> {
    check_id(&id)?;
    let _turn = app.trash_turn.lock().await;
    let trash = app.trash();
    blocking(move || if trash.join(&id).is_dir() { purge(&trash, &id) } else { Err(missing(&id)) }).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Empties the trash.
#[utoipa::path(delete, path = "/api/v1/trash", tag = "trash", operation_id = "empty_trash", responses((status = 204)))]
pub async fn empty(State(app): State<Arc<App>>) -> Answer<StatusCode> {
    let _turn = app.trash_turn.lock().await;
    let trash = app.trash();
    blocking(move || ids(&trash).iter().try_for_each(|id| purge(&trash, id))).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Deletes the expired entries for good.
///
/// # Errors
/// Those of the system.
pub async fn expire(app: &Arc<App>) -> Answer<()> {
    let _turn = app.trash_turn.lock().await;
    let (trash, kept_s) = (app.trash(), app.kept_s());
    let old = move |deleted: &Deleted| deleted.deleted.saturating_add(kept_s) <= now().as_secs();
    blocking(move || {
        let over = |id: &&String| read(&trash, id).is_none_or(|deleted| old(&deleted));
        ids(&trash).iter().filter(over).try_for_each(|id| {
            tracing::info!(id, "a thing in the trash is deleted for good");
            purge(&trash, id)
        })
    })
    .await
}

/// Deletes the oldest entries for good until the disk has enough space.
///
/// # Errors
/// Those of the system.
pub async fn make_room(app: &Arc<App>) -> Answer<()> {
    let _turn = app.trash_turn.lock().await;
    let (trash, app) = (app.trash(), app.clone());
    blocking(move || {
        let mut all = ids(&trash);
        all.sort_by_cached_key(|id| read(&trash, id).map_or(0, |deleted| deleted.deleted));
        for id in all {
            if !app.stores.is_short() {
                break;
            }
            tracing::warn!(id, "disk space is short: a thing in the trash is deleted for good");
            purge(&trash, &id)?;
        }
        Ok(())
    })
    .await
}

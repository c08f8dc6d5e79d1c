//! Stored uploads: their list, and the deletion of unused ones.

use super::problem::Answer;
use super::{App, blocking, check_id, files, naming};
use axum::Json;
use axum::extract::State;
use nacre_capture::naming::ABOUT_FILE;
use serde::Serialize;
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, SystemTime};
use ulid::Ulid;
use utoipa::ToSchema;

/// Most uploads in a list, the newest.
const MOST: usize = 1000;

/// Name prefix of unfinished uploads in earlier versions.
const EARLIER: &str = ".upload-";

/// An upload.
#[derive(Clone, Debug, Serialize, ToSchema)]
pub struct StoredUpload {
    id: String,
    /// As given, or else derived from the files.
    name: String,
    /// Start of the upload in Unix seconds.
    created: u64,
    files: usize,
    bytes: u64,
    /// Ids of the reconstructions that use it; it is deleted with the last of them.
    reconstructions: Vec<String>,
    /// Deletion time in Unix seconds; null while a reconstruction uses it.
    expires: Option<u64>,
}

/// Uploads, newest first.
#[derive(Debug, Serialize, ToSchema)]
pub struct UploadList {
    items: Vec<StoredUpload>,
}

/// Ids of the uploads in a folder, newest first.
fn ids(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let names = entries.filter_map(|entry| entry.file_name().into_string().ok());
    let mut ids: Vec<String> = names.filter(|name| check_id(name).is_ok()).collect();
    ids.sort_unstable_by(|a, b| b.cmp(a));
    ids
}

/// Time at which an id was made, since the Unix epoch.
fn made(id: &str) -> Duration {
    Duration::from_millis(Ulid::from_string(id).map_or(0, |id| id.timestamp_ms()))
}

impl App {
    /// Uploads that reconstructions use, with the ids of these. While the queue is closed, no reconstruction can
    /// begin.
    pub async fn uploads_in_use(&self) -> Answer<HashMap<String, Vec<String>>> {
        match self.stores.jobs() {
            Some(jobs) => Ok(jobs.uploads().await?),
            None => Ok(HashMap::new()),
        }
    }

    /// Lifetime of an upload that no reconstruction uses.
    fn upload_lifetime(&self) -> Duration {
        Duration::from_secs(self.config().limits.upload_days * 24 * 3600)
    }

    /// Description of an existing upload.
    pub async fn stored_upload(&self, id: String) -> Answer<StoredUpload> {
        let reconstructions = self.uploads_in_use().await?.remove(&id).unwrap_or_default();
        let (folder, lifetime) = (self.upload_folder(&id)?, self.upload_lifetime());
        blocking(move || Ok(describe(&folder, id, reconstructions, lifetime))).await
    }
}

fn describe(folder: &Path, id: String, reconstructions: Vec<String>, lifetime: Duration) -> StoredUpload {
    let mut all = files::list(folder);
    all.retain(|(name, _)| name != ABOUT_FILE);
    let expires = reconstructions.is_empty().then(|| (made(&id) + lifetime).as_secs());
    let (created, bytes) = (made(&id).as_secs(), all.iter().map(|file| file.1).sum());
    StoredUpload { name: naming::of_upload(folder), id, created, files: all.len(), bytes, reconstructions, expires }
}

/// Lists uploads, newest first, at most 1000.
#[utoipa::path(get, path = "/api/v1/uploads", tag = "reconstructions", operation_id = "uploads",
    responses((status = 200, body = UploadList)))]
pub async fn list(State(app): State<Arc<App>>) -> Answer<Json<UploadList>> {
    let mut in_use = app.uploads_in_use().await?;
    let (folder, lifetime) = (app.config().data.join("uploads"), app.upload_lifetime());
    let items = blocking(move || {
        let described = |id: String| {
            let reconstructions = in_use.remove(&id).unwrap_or_default();
            describe(&folder.join(&id), id, reconstructions, lifetime)
        };
        Ok(ids(&folder).into_iter().take(MOST).map(described).collect())
    });
    Ok(Json(UploadList { items: items.await? }))
}

/// Deletes the expired uploads.
///
/// # Errors
/// Those of the queue and the disk.
pub async fn expire(app: &Arc<App>) -> Answer<()> {
    let in_use = app.uploads_in_use().await?;
    let (folder, lifetime) = (app.config().data.join("uploads"), app.upload_lifetime());
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    blocking(move || {
        let old = |id: &String| made(id) + lifetime < now && !in_use.contains_key(id);
        ids(&folder).iter().filter(|id| old(id)).try_for_each(|id| {
            tracing::info!(id, "an upload has expired");
            super::deletion::removed(&folder.join(id))
        })
    })
    .await
}

/// Removes unfinished uploads of earlier versions, which did not lock them. Call it while no other service uses the
/// folder.
pub fn sweep_earlier(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(EARLIER) && entry.path().is_dir() {
            // If removal fails, the next start tries again.
            let _ = std::fs::remove_dir_all(entry.path());
        }
    }
}

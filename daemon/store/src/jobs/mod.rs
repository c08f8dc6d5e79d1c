//! The job queue of the service: work that outlives a request and the process that took it.
//!
//! Everything is in `jobs.db`. The table `nacre_job` holds what a job is and how far it came; the tables of `apalis`
//! beside it hold *deliveries*, each a message "look at job X" to the worker. A job and its delivery change in one
//! transaction, and a delivery counts for nothing unless its job is queued, so a job is neither lost nor done twice,
//! wherever the process is killed. The file has our tables beside those of `apalis`, not in a file of their own,
//! because SQLite's transactions over two files in WAL mode are not atomic.
//!
//! One process at a time works on a folder (a lock that ends with the process). A job found running at the start was
//! therefore cut off by the end of an earlier process: it is queued again at once, without waiting for a heartbeat to be
//! missed.

mod live;
mod record;
mod row;
mod saved;
mod spec;
mod store;
#[cfg(test)]
mod tests;
mod worker;

use live::Live;
use nacre_base::Error;
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_capture::plan::Method;
use nacre_frames::Transfer;
use record::Record;
pub use saved::Saved;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
pub use spec::polarization_options;
use std::collections::HashMap;
use std::fmt;
use std::path::Path;
use std::sync::Arc;
use store::Store;
use tokio::sync::{Mutex, broadcast, watch};
use tokio::task::JoinHandle;
use worker::Shared;

/// How often a job is tried before it is set aside.
pub const MAX_ATTEMPTS: u32 = 3;
/// A job during which the service died in this attempt, or in a later one, is failed: it may be to blame.
const MAX_CUT_OFF: u32 = 2;
/// Longest log of a job, in bytes.
pub const MAX_LOG: usize = 64 * 1024;
/// Changes that a slow receiver may fall behind.
const CHANGES: usize = 256;

/// Operation of a job, with its options and its input.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "spec::Stored")]
pub struct Spec {
    /// A ULID, which holds when it was made.
    pub id: String,
    /// Its name. Jobs of earlier versions have none.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// The operation.
    pub operation: Method,
    /// Its options, by their keys; those that are left out have their defaults.
    pub options: Map<String, Value>,
    /// The session to work on.
    pub session: Option<String>,
    /// The upload to work on.
    pub upload: Option<String>,
    /// Of the operation lut: an extended light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light: Option<LightUpload>,
}

/// Uploaded photographs of a light's mirror image, as `nacre reconstruct lut --light` takes them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LightUpload {
    /// An upload: one photograph, or exposures, which are merged.
    pub upload: String,
    /// Half vector per pixel (default: that of the pattern's photograph).
    #[serde(default)]
    pub scale: Option<f64>,
    /// Its pixel, from the left and the top, that is put where the zero order is (default: the middle of its light).
    #[serde(default)]
    pub center: Option<[f64; 2]>,
    /// How its values grow with light: `linear`, `srgb` or `{"gamma": 2.2}` (default: as those of the pattern's photograph).
    #[serde(default)]
    #[schema(value_type = Option<Object>)]
    pub transfer: Option<Transfer>,
}

impl LightUpload {
    /// The option `light` of the operation lut.
    pub fn photograph(&self, uploads: &Path) -> Value {
        let path = uploads.join(&self.upload);
        json!({ "path": path, "scale": self.scale, "center": self.center, "transfer": self.transfer })
    }
}

/// Where a job is in its life.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JobState {
    /// It waits for its turn.
    Queued,
    /// It is being worked on.
    Running,
    /// It succeeded.
    Done,
    /// It cannot succeed: something the user gave cannot be used, its process died, or the service died twice meanwhile.
    Failed,
    /// The user stopped it.
    Cancelled,
    /// It failed too often; its log says how.
    SetAside,
}

impl JobState {
    /// All states.
    pub const ALL: [Self; 6] = [Self::Queued, Self::Running, Self::Done, Self::Failed, Self::Cancelled, Self::SetAside];

    /// The word for it in the database and in JSON.
    pub fn word(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Done => "done",
            Self::Failed => "failed",
            Self::Cancelled => "cancelled",
            Self::SetAside => "set_aside",
        }
    }
}

impl fmt::Display for JobState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

/// A job as the queue knows it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Job {
    /// Its ULID.
    pub id: String,
    /// The session it works on.
    pub session: Option<String>,
    /// The upload it works on.
    pub upload: Option<String>,
    /// Where it is in its life.
    pub state: JobState,
    /// How often it was begun, not counting times that a shutdown put it back.
    pub attempts: u32,
    /// Share of the current stage that is done, 0 to 1; 1 once the job is done.
    pub progress: f64,
    /// The current or last stage.
    pub stage: String,
    /// Seconds that are left, of a running job that has checked its input.
    pub remaining_s: Option<f64>,
    /// Why the last attempt did not succeed.
    pub error: Option<String>,
    /// When it was made, in Unix seconds.
    pub created: u64,
    /// What it is to do.
    pub spec: Spec,
}

/// Does a job, on a thread where it may block.
pub type Work = Arc<dyn Fn(&Spec, &dyn Progress) -> Result<(), Failure> + Send + Sync>;

/// Why a wish about a job was not fulfilled.
#[derive(Debug, thiserror::Error)]
pub enum Refusal {
    /// There is no such job.
    #[error("job {0}: does not exist")]
    Unknown(String),
    /// The job's state does not allow it.
    #[error("job {id}: is {state} and cannot be {wish}")]
    State {
        /// The job.
        id: String,
        /// Its state.
        state: JobState,
        /// What was wished.
        wish: &'static str,
    },
    /// The queue itself failed.
    #[error(transparent)]
    Queue(#[from] Error),
}

/// The job queue of one folder, and its worker. Dropping it stops the worker without waiting for it. After a shutdown,
/// everything answers `Cancelled`.
pub struct Jobs {
    shared: Arc<Shared>,
    stop: watch::Sender<bool>,
    supervisor: Mutex<Option<JoinHandle<()>>>,
}

impl Jobs {
    /// Opens the queue of a folder, makes it where there is none, and starts working on it: one job at a time, as the
    /// computation itself uses all cores.
    ///
    /// # Errors
    /// `Input` when another process works on the folder or its file is no intact job queue of this version, `Output` when
    /// it cannot be made or used.
    pub async fn open(folder: &Path, work: Work) -> Result<Self, Error> {
        let folder = std::path::absolute(folder).map_err(|e| Error::file(folder, e, "give another folder"))?;
        let lock = worker::lock(&folder).await?;
        let store = Store::open(&folder.join("jobs.db")).await?;
        store.recover().await?;
        let (changes, _) = broadcast::channel(CHANGES);
        let (stop, stopped) = watch::channel(false);
        let shared = Arc::new(Shared::new(store, work, changes, lock));
        let supervisor = tokio::spawn(worker::supervise(shared.clone(), stopped));
        Ok(Self { shared, stop, supervisor: Mutex::new(Some(supervisor)) })
    }

    /// Adds a job. Once this returns, the job survives anything.
    ///
    /// # Errors
    /// `Input` when the id is no ULID or taken, otherwise as the database answers.
    pub async fn submit(&self, spec: Spec) -> Result<Job, Error> {
        let job = self.shared.store.insert(spec).await?;
        self.shared.queued(&job.id);
        Ok(job)
    }

    /// One job.
    ///
    /// # Errors
    /// As the database answers.
    pub async fn get(&self, id: &str) -> Result<Option<Job>, Error> {
        Ok(self.shared.store.get(id).await?.map(|job| self.shared.with_progress(job)))
    }

    /// At most `limit` jobs (500 at most), newest first, after the job `after`; and the `after` of the next page.
    ///
    /// # Errors
    /// As the database answers.
    pub async fn list(&self, limit: u32, after: Option<&str>) -> Result<(Vec<Job>, Option<String>), Error> {
        let (jobs, next) = self.shared.store.list(limit.clamp(1, 500), after).await?;
        Ok((jobs.into_iter().map(|job| self.shared.with_progress(job)).collect(), next))
    }

    /// Cancels a job: at once when it is queued; a running one ends as soon as it notices, and until then stays running.
    ///
    /// # Errors
    /// [`Refusal`] when there is no such job or it has ended.
    pub async fn cancel(&self, id: &str) -> Result<Job, Refusal> {
        let job = self.shared.store.change(id, Record::cancel).await?;
        let job = job.ok_or_else(|| Refusal::Unknown(id.into()))??;
        self.shared.cancel(id);
        self.shared.changed(id);
        Ok(self.shared.with_progress(job))
    }

    /// Queues a job that did not succeed again, with all its attempts.
    ///
    /// # Errors
    /// [`Refusal`] when there is no such job, or it is done or has not ended yet.
    pub async fn retry(&self, id: &str) -> Result<Job, Refusal> {
        let job = self.shared.store.change(id, Record::retry).await?;
        let job = job.ok_or_else(|| Refusal::Unknown(id.into()))??;
        self.shared.queued(id);
        Ok(job)
    }

    /// Forgets a job that has ended, with its log. Its files are the caller's.
    ///
    /// # Errors
    /// [`Refusal`] when there is no such job, or it has not ended yet.
    pub async fn remove(&self, id: &str) -> Result<(), Refusal> {
        self.shared.store.remove(id).await?;
        self.shared.changed(id);
        Ok(())
    }

    /// Uploads that jobs need, be it what they work on or their light, and the jobs' ids.
    ///
    /// # Errors
    /// As the database answers.
    pub async fn uploads(&self) -> Result<HashMap<String, Vec<String>>, Error> {
        let mut uploads: HashMap<String, Vec<String>> = HashMap::new();
        for (upload, job) in self.shared.store.uploads().await? {
            uploads.entry(upload).or_default().push(job);
        }
        Ok(uploads)
    }

    /// The first job of a session that is queued or running.
    ///
    /// # Errors
    /// As the database answers.
    pub async fn open_of_session(&self, session: &str) -> Result<Option<String>, Error> {
        self.shared.store.open_of_session(session).await
    }

    /// What happened to a job: lines that begin with the time in UTC. The oldest are dropped beyond [`MAX_LOG`].
    ///
    /// # Errors
    /// As the database answers.
    pub async fn log(&self, id: &str) -> Result<Option<String>, Error> {
        self.shared.store.log(id).await
    }

    /// The ids of jobs as they change. A receiver that falls behind loses some and should look at all jobs again.
    pub fn changes(&self) -> broadcast::Receiver<String> {
        self.shared.subscribe()
    }

    /// Stops the worker and closes the file; returns once it is closed. A running job is asked to stop and waits for the
    /// next start, and this attempt does not count.
    pub async fn shutdown(&self) {
        self.stop.send_replace(true);
        if let Some(supervisor) = self.supervisor.lock().await.take() {
            // A panic of the supervisor ended it as well.
            let _ = supervisor.await;
        }
    }
}

impl Drop for Jobs {
    fn drop(&mut self) {
        // The supervisor may never run again, as when a panic ends the runtime, which then waits for the job's thread.
        self.shared.stop();
    }
}

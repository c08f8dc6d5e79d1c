//! Job queue of the service: work that outlives its request and the process that accepted it.
//!
//! All data is in `jobs.db`. The table `nacre_job` holds the jobs and their progress. The tables of `apalis` beside it
//! hold *deliveries*: messages "run the next job" to the worker. A job and its delivery change in one transaction, and
//! a delivery has no effect unless a job is queued. Therefore no job is lost or done twice, whenever the process is
//! killed. Our tables share one file with those of `apalis`, because SQLite's transactions over two files in WAL mode
//! are not atomic.
//!
//! One process at a time works on a folder; its lock ends with the process. A job found running at the start was
//! therefore interrupted by the end of an earlier process. It is queued again at once, without waiting for a missed
//! heartbeat.

mod live;
mod order;
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

/// Number of attempts before a job is set aside.
pub const MAX_ATTEMPTS: u32 = 3;
/// From this attempt on, a job fails when its process dies: the job may be the cause.
const MAX_CUT_OFF: u32 = 2;
/// Longest log of a job, in bytes.
pub const MAX_LOG: usize = 64 * 1024;
/// Number of changes that a slow receiver may fall behind.
const CHANGES: usize = 256;

/// Operation of a job, with its options and its input.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "spec::Stored")]
pub struct Spec {
    /// ULID, which contains the time of submission.
    pub id: String,
    /// Name of the job. Jobs of earlier versions have none.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub name: String,
    /// The operation.
    pub operation: Method,
    /// Options by key; keys left out have their defaults.
    pub options: Map<String, Value>,
    /// The session to work on.
    pub session: Option<String>,
    /// The upload to work on.
    pub upload: Option<String>,
    /// For the operation `lut`: an extended source.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub light: Option<LightUpload>,
    /// Results to work on.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub results: Vec<UsedResult>,
    /// Results that options name.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub named: Vec<UsedResult>,
}

/// A result that a job reads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct UsedResult {
    /// Id of a reconstruction, or of a session with its own results.
    pub id: String,
    /// Its name at the time of the request.
    pub name: String,
    /// Id of the session that it was made from.
    pub session: Option<String>,
}

/// Uploaded photographs of a light's mirror image, in the format of `nacre reconstruct lut --light`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(deny_unknown_fields)]
pub struct LightUpload {
    /// Id of an upload: one photograph, or exposures, which are merged.
    pub upload: String,
    /// Half vector per pixel (default: that of the pattern's photograph).
    #[serde(default)]
    pub scale: Option<f64>,
    /// Pixel (x from the left, y from the top) that is moved to the zero order. Default: the centroid of the light.
    #[serde(default)]
    pub center: Option<[f64; 2]>,
    /// Transfer function of its values: `linear`, `srgb` or `{"gamma": 2.2}` (default: that of the pattern's
    /// photograph).
    #[serde(default)]
    #[schema(value_type = Option<Object>)]
    pub transfer: Option<Transfer>,
}

impl LightUpload {
    /// Value of the option `light` of the operation `lut`.
    pub fn photograph(&self, uploads: &Path) -> Value {
        let path = uploads.join(&self.upload);
        json!({ "path": path, "scale": self.scale, "center": self.center, "transfer": self.transfer })
    }
}

/// State of a job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum JobState {
    /// Waiting for its turn.
    Queued,
    /// In progress.
    Running,
    /// Succeeded.
    Done,
    /// Failed permanently: the input cannot be used, its process died, or the service died twice during the job.
    Failed,
    /// Cancelled by the user.
    Cancelled,
    /// Failed [`MAX_ATTEMPTS`] times; the log has the errors.
    SetAside,
}

impl JobState {
    /// All states.
    pub const ALL: [Self; 6] = [Self::Queued, Self::Running, Self::Done, Self::Failed, Self::Cancelled, Self::SetAside];

    /// Name in the database and in JSON.
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

/// A job as stored in the queue.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Job {
    /// ULID of the job.
    pub id: String,
    /// Id of the session it works on.
    pub session: Option<String>,
    /// Id of the upload it works on.
    pub upload: Option<String>,
    /// State of the job.
    pub state: JobState,
    /// Number of attempts, except those that a shutdown interrupted.
    pub attempts: u32,
    /// Fraction done of the current stage, 0 to 1; 1 once the job is done.
    pub progress: f64,
    /// The current or last stage.
    pub stage: String,
    /// Remaining time in seconds of a running job that has checked its input.
    pub remaining_s: Option<f64>,
    /// Error of the last attempt, if it failed.
    pub error: Option<String>,
    /// Time of submission in Unix seconds.
    pub created: u64,
    /// Operation, options and input.
    pub spec: Spec,
}

/// Function that runs a job, on a thread where it may block.
pub type Work = Arc<dyn Fn(&Spec, &dyn Progress) -> Result<(), Failure> + Send + Sync>;

/// Error of a request about a job.
#[derive(Debug, thiserror::Error)]
pub enum Refusal {
    /// The job does not exist.
    #[error("job {0}: does not exist")]
    Unknown(String),
    /// The job's state does not allow it.
    #[error("job {id}: is {state} and cannot be {wish}")]
    State {
        /// Id of the job.
        id: String,
        /// Its state.
        state: JobState,
        /// Past participle of the request, such as "cancelled".
        wish: &'static str,
    },
    /// Error of the queue.
    #[error(transparent)]
    Queue(#[from] Error),
}

/// The job queue of one folder, and its worker.
///
/// Dropping it stops the worker without waiting. After a shutdown, all functions return `Cancelled`.
pub struct Jobs {
    shared: Arc<Shared>,
    stop: watch::Sender<bool>,
    supervisor: Mutex<Option<JoinHandle<()>>>,
}

impl Jobs {
    /// Opens the queue of a folder, creates it if missing, and starts its worker.
    ///
    /// Jobs run one at a time, as the computation itself uses all cores.
    ///
    /// # Errors
    /// `Input` when another process works on the folder, or the file is not an intact job queue of this version;
    /// `Output` when it cannot be created or used.
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

    /// Adds a job. Once this returns, the job survives crashes and power failures.
    ///
    /// # Errors
    /// `Input` when the id is not a ULID or is taken, otherwise those of the database.
    pub async fn submit(&self, spec: Spec) -> Result<Job, Error> {
        let job = self.shared.store.insert(spec).await?;
        self.shared.queued(&job.id);
        Ok(job)
    }

    /// A job by its id.
    ///
    /// # Errors
    /// Those of the database.
    pub async fn get(&self, id: &str) -> Result<Option<Job>, Error> {
        Ok(self.shared.store.get(id).await?.map(|job| self.shared.with_progress(job)))
    }

    /// Lists at most `limit` jobs (500 at most), newest first, after the job `after`. Also returns the `after` of the
    /// next page.
    ///
    /// # Errors
    /// Those of the database.
    pub async fn list(&self, limit: u32, after: Option<&str>) -> Result<(Vec<Job>, Option<String>), Error> {
        let (jobs, next) = self.shared.store.list(limit.clamp(1, 500), after).await?;
        Ok((jobs.into_iter().map(|job| self.shared.with_progress(job)).collect(), next))
    }

    /// The running job, then the queued ones in the order in which they will run.
    ///
    /// # Errors
    /// Those of the database.
    pub async fn queue(&self) -> Result<Vec<Job>, Error> {
        let jobs = self.shared.store.open_jobs().await?;
        Ok(jobs.into_iter().map(|job| self.shared.with_progress(job)).collect())
    }

    /// Moves a queued job before all others that wait.
    ///
    /// # Errors
    /// [`Refusal`] when the job does not exist or does not wait.
    pub async fn to_the_front(&self, id: &str) -> Result<(), Refusal> {
        self.shared.store.to_the_front(id).await?;
        self.shared.changed(id);
        Ok(())
    }

    /// Cancels a job. A queued job ends at once; a running one stays in the state running until it ends.
    ///
    /// # Errors
    /// [`Refusal`] when the job does not exist or has ended.
    pub async fn cancel(&self, id: &str) -> Result<Job, Refusal> {
        let job = self.shared.store.change(id, Record::cancel).await?;
        let job = job.ok_or_else(|| Refusal::Unknown(id.into()))??;
        self.shared.cancel(id);
        self.shared.changed(id);
        Ok(self.shared.with_progress(job))
    }

    /// Asks a running job to end its passes and to keep the result so far; false if it is not running.
    pub fn finish(&self, id: &str) -> bool {
        self.shared.finish(id)
    }

    /// Queues an unsuccessful job again, with all its attempts.
    ///
    /// # Errors
    /// [`Refusal`] when the job does not exist, has succeeded or has not ended.
    pub async fn retry(&self, id: &str) -> Result<Job, Refusal> {
        let job = self.shared.store.change(id, Record::retry).await?;
        let job = job.ok_or_else(|| Refusal::Unknown(id.into()))??;
        self.shared.queued(id);
        Ok(job)
    }

    /// Removes a job that has ended, with its log. The caller deletes its files.
    ///
    /// # Errors
    /// [`Refusal`] when the job does not exist or has not ended.
    pub async fn remove(&self, id: &str) -> Result<(), Refusal> {
        self.shared.store.remove(id).await?;
        self.shared.changed(id);
        Ok(())
    }

    /// Uploads in use, as inputs or lights of jobs, with the jobs' ids.
    ///
    /// # Errors
    /// Those of the database.
    pub async fn uploads(&self) -> Result<HashMap<String, Vec<String>>, Error> {
        let mut uploads: HashMap<String, Vec<String>> = HashMap::new();
        for (upload, job) in self.shared.store.uploads().await? {
            uploads.entry(upload).or_default().push(job);
        }
        Ok(uploads)
    }

    /// Id of the first job of a session that is queued or running.
    ///
    /// # Errors
    /// Those of the database.
    pub async fn open_of_session(&self, session: &str) -> Result<Option<String>, Error> {
        self.shared.store.open_of_session(session).await
    }

    /// Log of a job: lines that begin with the time in UTC. The oldest are dropped beyond [`MAX_LOG`].
    ///
    /// # Errors
    /// Those of the database.
    pub async fn log(&self, id: &str) -> Result<Option<String>, Error> {
        self.shared.store.log(id).await
    }

    /// Receives the ids of jobs as they change. A receiver that falls behind misses some and should read all jobs
    /// again.
    pub fn changes(&self) -> broadcast::Receiver<String> {
        self.shared.subscribe()
    }

    /// Stops the worker and closes the file; returns once it is closed. A running job is interrupted and continues at
    /// the next start; this attempt does not count.
    pub async fn shutdown(&self) {
        self.stop.send_replace(true);
        if let Some(supervisor) = self.supervisor.lock().await.take() {
            // The result is that of the supervisor's task; after a panic it has ended as well.
            let _ = supervisor.await;
        }
    }
}

impl Drop for Jobs {
    fn drop(&mut self) {
        // After a panic that ends the runtime, the supervisor may never run again, while the runtime waits for the
        // job's thread.
        self.shared.stop();
    }
}

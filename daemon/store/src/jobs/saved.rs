//! Jobs outside of the queue: those that were deleted and can be restored.

use super::{Job, JobState, Jobs, Refusal, Spec};
use nacre_base::Error;
use serde::{Deserialize, Serialize};

/// A job that has ended, as it is kept outside of the queue.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Saved {
    /// What it was to do.
    pub spec: Spec,
    /// How it ended.
    pub state: JobState,
    pub(super) attempts: u32,
    pub(super) progress: f64,
    pub(super) stage: String,
    pub(super) error: Option<String>,
    pub(super) log: String,
}

impl Jobs {
    /// Gives a job another name.
    ///
    /// # Errors
    /// [`Refusal`] when there is no such job.
    pub async fn rename(&self, id: &str, name: &str) -> Result<Job, Refusal> {
        self.shared.store.rename(id, name).await?;
        self.shared.changed(id);
        self.get(id).await?.ok_or_else(|| Refusal::Unknown(id.into()))
    }

    /// A job with its log, to be restored after it was removed.
    ///
    /// # Errors
    /// As the database answers.
    pub async fn saved(&self, id: &str) -> Result<Option<Saved>, Error> {
        let (Some(job), Some(log)) = (self.get(id).await?, self.log(id).await?) else { return Ok(None) };
        let Job { spec, state, attempts, progress, stage, error, .. } = job;
        Ok(Some(Saved { spec, state, attempts, progress, stage, error, log }))
    }

    /// Puts a removed job back, under its old id. One that is there stays as it is.
    ///
    /// # Errors
    /// `Input` when it had not ended, otherwise as the database answers.
    pub async fn restore(&self, saved: &Saved) -> Result<(), Error> {
        self.shared.store.restore(saved).await?;
        self.shared.changed(&saved.spec.id);
        Ok(())
    }
}

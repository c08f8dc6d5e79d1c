//! Deleted jobs that can be restored.

use super::{Job, JobState, Jobs, Refusal, Spec};
use nacre_base::Error;
use serde::{Deserialize, Serialize};

/// A job that has ended, stored outside of the queue.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Saved {
    /// Operation, options and input.
    pub spec: Spec,
    /// Final state.
    pub state: JobState,
    pub(super) attempts: u32,
    pub(super) progress: f64,
    pub(super) stage: String,
    pub(super) error: Option<String>,
    pub(super) log: String,
}

impl Jobs {
    /// Renames a job.
    ///
    /// # Errors
    /// [`Refusal`] when the job does not exist.
    pub async fn rename(&self, id: &str, name: &str) -> Result<Job, Refusal> {
        self.shared.store.rename(id, name).await?;
        self.shared.changed(id);
        self.get(id).await?.ok_or_else(|| Refusal::Unknown(id.into()))
    }

    /// A job with its log, from which [`Self::restore`] restores it.
    ///
    /// # Errors
    /// Those of the database.
    pub async fn saved(&self, id: &str) -> Result<Option<Saved>, Error> {
        let (Some(job), Some(log)) = (self.get(id).await?, self.log(id).await?) else { return Ok(None) };
        let Job { spec, state, attempts, progress, stage, error, .. } = job;
        Ok(Some(Saved { spec, state, attempts, progress, stage, error, log }))
    }

    /// Restores a removed job under its old id. An existing job stays unchanged.
    ///
    /// # Errors
    /// `Input` when the job had not ended, otherwise those of the database.
    pub async fn restore(&self, saved: &Saved) -> Result<(), Error> {
        self.shared.store.restore(saved).await?;
        self.shared.changed(&saved.spec.id);
        Ok(())
    }
}

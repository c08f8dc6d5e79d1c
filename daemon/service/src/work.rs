//! Computations of the service: jobs, and the results at the end of a session. Each runs in a separate process
//! ([`nacre_base::contained`]), so that a crash affects neither the bench nor other requests.

use super::methods;
use super::renders::{Glimpse, Renders};
use nacre_base::Error;
use nacre_base::contained::{self, Death, Ended, Limits, Link, Part};
use nacre_base::progress::Progress;
use nacre_capture::Failure;
use nacre_capture::run::reconstruct_session;
use nacre_capture::session::RESULTS;
use nacre_image::{budget, sweep_unfinished};
use nacre_render::SoFar;
use nacre_store::jobs::{Spec, Work};
use serde::{Deserialize, Serialize};
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Task of a process.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Task {
    /// A job of the queue.
    Job {
        /// Data folder of the service.
        data: PathBuf,
        /// The job.
        spec: Box<Spec>,
    },
    /// A draft of a scene with files of an upload.
    Draft {
        /// Folder of the upload.
        folder: PathBuf,
        /// The scene, as TOML.
        scene: String,
        /// Longest side in pixels.
        side: usize,
    },
    /// Results that a session's plan requests, computed from its stored frames.
    Session(PathBuf),
}

impl Task {
    /// Key of a task in the process's input.
    pub const KEY: &str = "service";

    /// Runs the task in this process.
    ///
    /// # Errors
    /// Those of the computation.
    pub fn perform(&self, link: &Link) -> Result<Part, Error> {
        match self {
            Self::Job { data, spec } => methods::perform(data, spec, link)?,
            Self::Session(folder) => drop(reconstruct_session(folder, link)?),
            Self::Draft { folder, scene, side } => {
                let bytes = nacre_render::draft(scene, folder, *side, link)?;
                return Ok(Part { bytes, ..Part::default() });
            }
        }
        Ok(Part::default())
    }

    /// Folder of the results, if any.
    fn results(&self) -> Option<PathBuf> {
        match self {
            Self::Job { data, spec } => Some(result_folder(data, &spec.id)),
            Self::Session(folder) => Some(folder.join(RESULTS)),
            Self::Draft { .. } => None,
        }
    }

    /// Runs the task in a new process. Results appear completely or not at all.
    fn run(&self, progress: &dyn Progress, shown: &mut dyn FnMut(Part)) -> Result<Part, Error> {
        let processor_s = self.results().is_none().then_some(DRAFT_S);
        let limits = Limits { memory: budget::allowed(), processor_s, background: true };
        let ended = contained::run(json!({ Self::KEY: self }), limits, progress, shown);
        ended.map_err(|ended| {
            // A killed process leaves incomplete results.
            self.results().iter().for_each(|folder| sweep_unfinished(folder));
            match ended {
                Ended::Died(Death::Time(seconds)) if self.results().is_none() => {
                    let problem = format!("takes more than {seconds} s of processor time");
                    Error::input("draft", problem, "render the scene without a draft")
                }
                Ended::Error(error) => error,
                Ended::Died(death) => Error::input("computation", &death, remedy(&death)),
            }
        })
    }
}

/// Most processor time of a draft in s.
const DRAFT_S: u64 = 60;

/// Folder of a job's results.
pub fn result_folder(data: &Path, id: &str) -> PathBuf {
    data.join("reconstructions").join(id)
}

fn remedy(death: &Death) -> &'static str {
    match death {
        Death::Memory(_) => {
            "use fewer or smaller photographs (maps, meshes, pictures), or raise limits.job_memory_mib of the service"
        }
        Death::Killed => "use fewer or smaller photographs if the machine lacks memory; otherwise ask again",
        Death::Crashed(_) | Death::Time(_) => "try other options, and report this with its photographs",
        Death::NotStarted(_) => "restart the service",
    }
}

/// Runs queued jobs in processes; pictures of renderings go to `renders`.
pub fn jobs(data: PathBuf, renders: Arc<Renders>) -> Work {
    Arc::new(move |spec: &Spec, progress: &dyn Progress| {
        let task = Task::Job { data: data.clone(), spec: Box::new(spec.clone()) };
        let done = task.run(progress, &mut |part| {
            if let Ok(so_far) = serde_json::from_value::<SoFar>(part.value) {
                renders.show(&spec.id, Glimpse { png: part.bytes, so_far });
            }
        });
        renders.clear();
        Ok(done.map(drop)?)
    })
}

/// Renders a draft in a process; returns a PNG.
///
/// # Errors
/// Those of the scene; `Cancelled`.
pub fn draft(folder: PathBuf, scene: String, side: usize, progress: &dyn Progress) -> Result<Vec<u8>, Error> {
    Ok(Task::Draft { folder, scene, side }.run(progress, &mut |_| ())?.bytes)
}

/// Computes the results of a session in a process.
///
/// # Errors
/// Those of the computation.
pub fn session(folder: &Path, progress: &dyn Progress) -> Result<(), Failure> {
    Ok(Task::Session(folder.into()).run(progress, &mut |_| ()).map(drop)?)
}

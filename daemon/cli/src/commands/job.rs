//! The hidden `nacre job`: computations for another process of this program.

use nacre_base::Error;
use nacre_base::contained::{self, Link, Part};
use nacre_image::{Decoding, budget};
use nacre_service::work::Task;
use serde::Deserialize;
use serde_json::Value;
use std::process::ExitCode;

/// A task; its key in JSON tells which.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum Asked {
    Service(Task),
    Decode(Decoding),
}

/// Serves one task on this process's standard streams.
pub fn run() -> ExitCode {
    contained::serve(perform)
}

fn perform(task: Value, link: &Link) -> Result<Part, Error> {
    let misused = |e: serde_json::Error| Error::input("job", e, "start it through another command");
    let asked = serde_json::from_value(task).map_err(misused)?;
    // Predictions refuse what would meet the limit of this process.
    if let Some(bytes) = link.limits().memory {
        budget::allow(bytes);
    }
    match asked {
        Asked::Service(task) => task.perform(link),
        Asked::Decode(decoding) => decoding.perform(),
    }
}

//! The hidden command `nacre job`: computations on behalf of another process of this program.

use nacre_base::Error;
use nacre_base::contained::{self, Link, Part};
use nacre_image::{Decoding, budget};
use nacre_service::work::Task;
use serde::Deserialize;
use serde_json::Value;
use std::process::ExitCode;

/// A task, selected by its JSON key.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum Asked {
    Service(Task),
    Decode(Decoding),
}

/// Serves one task on standard input and output.
pub fn run() -> ExitCode {
    contained::serve(perform)
}

fn perform(task: Value, link: &Link) -> Result<Part, Error> {
    let misused = |e: serde_json::Error| Error::input("job", e, "start it through another command");
    let asked = serde_json::from_value(task).map_err(misused)?;
    // The memory limit of this process, so that predicted excess is refused before the allocation fails.
    if let Some(bytes) = link.limits().memory {
        budget::allow(bytes);
    }
    match asked {
        Asked::Service(task) => task.perform(link),
        Asked::Decode(decoding) => decoding.perform(),
    }
}

//! Measures a study: every setting on every scene, several times.

use super::Study;
use super::raw::{RawFile, Record};
use crate::Result;
use crate::progress::Progress;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// How thorough.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Effort {
    /// For conclusions.
    Full,
    /// Small scenes and three runs: shows that everything works, says little about time.
    Quick,
}

impl Effort {
    /// `full`, or `quick` for a quick look.
    pub fn pick<T>(self, full: T, quick: T) -> T {
        if self == Self::Full { full } else { quick }
    }
}

/// What makes two measurements comparable.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Plan {
    /// Seed of all scenes.
    pub seed: u64,
    /// Repetitions, each with scenes of its own.
    pub runs: usize,
    /// How thorough.
    pub effort: Effort,
    /// The program that measures; measurements of different builds are not mixed.
    pub version: String,
}

impl Plan {
    /// Five runs of full size.
    pub fn new(seed: u64, version: &str) -> Self {
        Self { seed, runs: 5, effort: Effort::Full, version: version.into() }
    }
}

/// Measures what the file of raw measurements does not hold yet, and returns all. Runs are the outermost loop, so that a
/// machine that grows slow meanwhile does so for every setting; one unrecorded measurement warms it up.
///
/// # Errors
/// When the file is of another study or plan, cannot be written, when a run fails, or when `progress` says to stop (then
/// the same call goes on later).
pub fn measure(study: &Study, plan: &Plan, raw: &Path, progress: &dyn Progress) -> Result<Vec<Record>> {
    let mut file = RawFile::open(raw, study, plan)?;
    let cases = cases(study, plan);
    let missing: Vec<_> =
        cases.iter().filter(|c| !file.records.iter().any(|r| (r.run, r.scene, r.setting) == **c)).collect();
    progress.stage(study.name, missing.len() as u64);
    if let Some(&&(_, scene, setting)) = missing.first() {
        (study.run)(setting, scene, plan.seed)?;
    }
    for &&(run, scene, setting) in &missing {
        progress.check()?;
        let outcome = (study.run)(setting, scene, scene_seed(plan.seed, run, scene))?;
        file.push(Record { run, scene, setting, outcome }, raw)?;
        progress.step();
    }
    Ok(file.records)
}

fn cases(study: &Study, plan: &Plan) -> Vec<(usize, usize, usize)> {
    let of_run = |run| {
        let scenes = 0..study.scenes.len();
        scenes.flat_map(move |scene| (0..study.settings.len()).map(move |setting| (run, scene, setting)))
    };
    (0..plan.runs).flat_map(of_run).collect()
}

/// All settings see the same scene, so that they are compared on equal terms.
fn scene_seed(seed: u64, run: usize, scene: usize) -> u64 {
    seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ ((run as u64) << 32) ^ (scene as u64)
}

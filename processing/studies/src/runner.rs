//! Measures a study: every setting on every scene, several times.

use super::Study;
use super::plan::Plan;
use super::raw::{RawFile, Record};
use nacre_base::Result;
use nacre_base::progress::Progress;
use std::path::Path;

/// Measures all pairs that are missing in the file of raw measurements, and returns all. Runs are the outermost loop,
/// so that a slowdown of the machine affects all settings alike. One unrecorded measurement warms up the caches.
///
/// # Errors
/// If the file belongs to another study or plan or cannot be written, if a run fails, or if `progress` requests a stop
/// (the same call then continues later).
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

/// All settings use the same scene, for a fair comparison.
fn scene_seed(seed: u64, run: usize, scene: usize) -> u64 {
    seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ ((run as u64) << 32) ^ (scene as u64)
}

#[cfg(test)]
mod tests {
    use super::super::tests::{records_without_time, study};
    use super::*;
    use nacre_base::Error;
    use nacre_base::progress::Silent;
    use std::sync::atomic::{AtomicU64, Ordering};

    /// Requests a stop after some steps, as Ctrl-C does.
    struct Impatient(AtomicU64);

    impl Progress for Impatient {
        fn stage(&self, _: &str, _: u64) {}
        fn step(&self) {
            self.0.fetch_sub(1, Ordering::Relaxed);
        }
        fn cancelled(&self) -> bool {
            self.0.load(Ordering::Relaxed) == 0
        }
    }

    #[test]
    fn an_interrupted_chart_goes_on_to_the_same_data() {
        let folder = tempfile::tempdir().unwrap();
        let (whole, pieces) = (folder.path().join("whole"), folder.path().join("pieces"));
        let plan = Plan::new(7, "test");
        let uninterrupted = measure(&study(), &plan, &whole, &Silent).unwrap();
        assert_eq!(uninterrupted.len(), 6 * 5 * 5);
        for steps in [1, 10, 60] {
            let stopped = measure(&study(), &plan, &pieces, &Impatient(AtomicU64::new(steps)));
            assert!(matches!(stopped, Err(Error::Cancelled)));
            // Simulates a kill during a write.
            let mut bytes = std::fs::read(&pieces).unwrap();
            bytes.truncate(bytes.len() - 7);
            std::fs::write(&pieces, bytes).unwrap();
        }
        let resumed = measure(&study(), &plan, &pieces, &Silent).unwrap();
        assert_eq!(records_without_time(&resumed), records_without_time(&uninterrupted));
        let lines = |path: &Path| std::fs::read_to_string(path).unwrap().lines().count();
        assert_eq!((lines(&pieces), lines(&whole)), (151, 151));
        // A complete file is not measured again: the times are unchanged.
        assert_eq!(measure(&study(), &plan, &pieces, &Silent).unwrap(), resumed);
    }

    #[test]
    fn data_of_another_seed_or_program_or_file_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let raw = folder.path().join("raw");
        let plan = Plan::new(7, "one");
        measure(&study(), &plan, &raw, &Silent).unwrap();
        for (plan, said) in
            [(Plan { seed: 8, ..plan.clone() }, "--seed 7"), (Plan { version: "two".into(), ..plan.clone() }, "build")]
        {
            let error = measure(&study(), &plan, &raw, &Silent).unwrap_err().to_string();
            assert!(error.contains(said) && error.contains("--force"), "{error}");
        }
        std::fs::write(&raw, "my notes\n").unwrap();
        assert!(measure(&study(), &plan, &raw, &Silent).is_err());
        assert_eq!(std::fs::read_to_string(&raw).unwrap(), "my notes\n");
    }
}

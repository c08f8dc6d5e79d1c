//! Prediction of the time, memory and disk space of operations on this machine.
//!
//! Each operation states its [`Work`] in seconds of a reference machine. A [`Machine`] measures its relative speed by a
//! short benchmark, and refines it with each completed operation. The results are kept in the user's cache folder.

use crate::{Error, input, json, rewrite};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Version of the file with a machine's speed.
const VERSION: u32 = 1;

/// Maximum size of that file in bytes.
const MOST_BYTES: u64 = 1 << 20;

/// Seconds per [`calculation`] on the reference machine, with all threads busy: two threads of an idle AMD EPYC, debug
/// build of 2026-11. Debug builds optimise the crates that compute.
const REFERENCE_S: f64 = 0.0040;

/// Weight of a new measurement relative to earlier ones.
const NEW: f64 = 0.3;

/// Maximum factor by which measured times change estimates, so that a temporarily busy machine does not spoil them
/// permanently.
const MOST: f64 = 4.0;

/// Memory of the program itself, including its threads: 36 MB measured for a debug build, rounded up.
const PROGRAM_BYTES: u64 = 40 << 20;

/// Minimum duration in s of operations that refine the estimate; shorter ones are dominated by start-up.
const SHORTEST_S: f64 = 0.3;

/// Time, memory and disk space of an operation on the reference machine.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Work {
    /// Name of the operation, under which its relative speed is stored.
    pub operation: Cow<'static, str>,
    /// Seconds of the reference machine.
    pub seconds: f64,
    /// Peak memory in bytes, without that of the program itself.
    pub memory_bytes: u64,
    /// Disk space of the results in bytes.
    pub disk_bytes: u64,
    /// Seconds on this machine spent before the statement, for instance on a trial.
    #[serde(default)]
    pub taken_s: f64,
}

impl Work {
    /// Work of this operation after another one that shares its memory and leaves nothing on disk.
    #[must_use]
    pub fn preceded_by(self, other: &Self) -> Self {
        let memory_bytes = self.memory_bytes.max(other.memory_bytes);
        Self { seconds: self.seconds + other.seconds, memory_bytes, ..self }
    }
}

/// Time, memory and disk space of an operation on one machine.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Time in seconds on an otherwise idle machine; `tests/estimates` measures its accuracy.
    pub seconds: f64,
    /// Upper bound of peak memory in bytes, including the program. For calibration, height fields and renderings it is
    /// an estimate, because their headers do not determine it.
    pub memory_bytes: u64,
    /// Disk space of the results in bytes.
    pub disk_bytes: u64,
}

/// Speed of a machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    version: u32,
    /// Build of the program and number of threads to which the speed refers.
    of: String,
    /// Speed of all threads relative to the reference machine, by a short benchmark.
    pub speed: f64,
    /// Measured time of each operation relative to its estimate by `speed`.
    pub learned: BTreeMap<String, f64>,
}

impl Machine {
    /// This machine, from its file in the cache folder. Without a file for this build, it is measured (about 0.1 s).
    pub fn here() -> Self {
        let file = cache_file();
        file.as_deref().and_then(Self::read).unwrap_or_else(|| {
            let machine = Self::measured();
            machine.keep(file.as_deref());
            machine
        })
    }

    /// This machine, measured now, without stored results.
    pub fn measured() -> Self {
        let count = 2 * rayon::current_num_threads();
        let timed = |_| {
            let begun = Instant::now();
            (0..count).into_par_iter().with_max_len(1).map(|_| calculation()).max();
            begun.elapsed().as_secs_f64() / count as f64
        };
        let least = (0..5).map(timed).fold(f64::INFINITY, f64::min);
        Self { version: VERSION, of: build(), speed: REFERENCE_S / least, learned: BTreeMap::new() }
    }

    fn read(file: &Path) -> Option<Self> {
        let machine: Self = serde_json::from_slice(&input::read(file, MOST_BYTES).ok()?).ok()?;
        let sound = |v: &f64| v.is_finite() && *v > 0.0;
        let usable = machine.version == VERSION && machine.of == build();
        (usable && sound(&machine.speed) && machine.learned.values().all(sound)).then_some(machine)
    }

    /// Stores the results. Without a cache folder, the machine is measured every time.
    fn keep(&self, file: Option<&Path>) {
        let Some(file) = file else { return };
        let folder = file.parent().map_or(Ok(()), std::fs::create_dir_all);
        let write = |path: &Path| std::fs::write(path, json(self)).map_err(|e| Error::output(path, e));
        // A failure to store estimates must not fail the operation.
        let _ = folder.map(|()| rewrite(file, write));
    }

    /// Estimate of an operation on this machine.
    pub fn estimate(&self, work: &Work) -> Estimate {
        let learned = self.learned.get(&*work.operation).copied().unwrap_or(1.0);
        let Work { disk_bytes, .. } = *work;
        let memory_bytes = work.memory_bytes + PROGRAM_BYTES;
        Estimate { seconds: work.taken_s + work.seconds / self.speed * learned, memory_bytes, disk_bytes }
    }

    /// Refines the estimate with the measured duration of an operation, and stores it.
    pub fn learn(&mut self, work: &Work, seconds: f64) {
        if self.learned_from(work, seconds) {
            self.keep(cache_file().as_deref());
        }
    }

    /// Refines the estimate; returns whether the measurement was used.
    fn learned_from(&mut self, work: &Work, seconds: f64) -> bool {
        let expected = work.seconds / self.speed;
        let teaches = seconds.max(expected) >= SHORTEST_S && expected > 0.0 && seconds > 0.0;
        if teaches {
            let found = (seconds / expected).clamp(1.0 / MOST, MOST);
            let before = self.learned.get(&*work.operation).copied().unwrap_or(found);
            // Geometric mean, so that factors of two and one half cancel.
            self.learned.insert(work.operation.to_string(), before.powf(1.0 - NEW) * found.powf(NEW));
        }
        teaches
    }
}

/// A running operation with its estimate.
pub struct Running {
    machine: Machine,
    work: Work,
    begun: Instant,
    expected_s: f64,
}

impl Running {
    /// Starts the clock.
    pub fn begin(work: Work) -> Self {
        let machine = Machine::here();
        let expected_s = machine.estimate(&work).seconds - work.taken_s;
        Self { machine, work, begun: Instant::now(), expected_s }
    }

    /// Estimate of the operation.
    pub fn estimate(&self) -> Estimate {
        self.machine.estimate(&self.work)
    }

    /// Remaining time in seconds; never increases.
    pub fn remaining_s(&self) -> f64 {
        remaining_s(self.expected_s, self.begun.elapsed().as_secs_f64())
    }

    /// Completes the operation and refines the machine's estimate.
    pub fn complete(mut self) {
        self.machine.learn(&self.work, self.begun.elapsed().as_secs_f64());
    }
}

/// Remaining seconds of an operation of `expected` seconds after `gone` seconds. Decreases strictly and never reaches
/// 0.
fn remaining_s(expected: f64, gone: f64) -> f64 {
    /// Final fraction of the estimate, which is stretched for operations that take longer than expected.
    const LAST: f64 = 0.3;
    let last = LAST * expected;
    let left = expected - gone;
    if left > last { left } else { last * ((left - last) / last.max(f64::MIN_POSITIVE)).exp() }
}

/// Program, processor and number of threads to which the speed refers.
fn build() -> String {
    let kind = if cfg!(debug_assertions) { "debug" } else { "release" };
    format!("nacre {} {kind}, {} threads", env!("CARGO_PKG_VERSION"), rayon::current_num_threads())
}

/// `nacre/machine.json` in the cache folder of the unit (systemd's `CacheDirectory`) or of the user.
fn cache_file() -> Option<PathBuf> {
    let set = |name: &str| std::env::var_os(name).filter(|v| !v.is_empty()).map(PathBuf::from);
    let of_user = || set("XDG_CACHE_HOME").or_else(|| Some(set("HOME")?.join(".cache")));
    let folder = set("CACHE_DIRECTORY").or_else(|| Some(of_user()?.join("nacre")));
    folder.filter(|folder| folder.is_absolute()).map(|folder| folder.join("machine.json"))
}

/// Benchmark representative of reconstructions: sums of products over more numbers than fit into the first-level cache.
fn calculation() -> u32 {
    const COUNT: usize = 1 << 18;
    let mut values: Vec<f32> = (0..COUNT).map(|i| (i % 251) as f32).collect();
    for round in 0..4 {
        let factor = black_box(0.5 + 0.1 * round as f32);
        let mut last = 0.0;
        for value in &mut values {
            *value = factor * *value + 0.25 * last + 1.0;
            last = (*value * 0.01).sqrt();
        }
    }
    values.iter().map(|v| v.to_bits()).fold(0, u32::wrapping_add)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn work(seconds: f64) -> Work {
        Work { operation: "hdr".into(), seconds, memory_bytes: 7, disk_bytes: 9, ..Work::default() }
    }

    fn machine(speed: f64) -> Machine {
        Machine { version: VERSION, of: build(), speed, learned: BTreeMap::new() }
    }

    #[test]
    fn a_machine_twice_as_fast_takes_half_as_long() {
        let found = machine(2.0).estimate(&work(10.0));
        assert_eq!(found, Estimate { seconds: 5.0, memory_bytes: 7 + PROGRAM_BYTES, disk_bytes: 9 });
    }

    #[test]
    fn what_took_longer_is_expected_to_take_longer() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("deep/machine.json");
        let mut known = machine(1.0);
        for _ in 0..20 {
            let expected = known.estimate(&work(10.0)).seconds;
            assert!(expected < 30.001, "{expected}");
            known.learned_from(&work(10.0), 30.0);
        }
        assert!((known.estimate(&work(10.0)).seconds - 30.0).abs() < 0.1);
        // Other operations are unaffected, and an implausible duration of an hour is limited.
        assert_eq!(known.estimate(&Work { operation: "lut".into(), ..work(10.0) }).seconds, 10.0);
        known.learned_from(&work(10.0), 3600.0);
        assert!(known.estimate(&work(10.0)).seconds < 40.0);
        // Start-up time does not characterise the operation.
        known.learned_from(&Work { operation: "map".into(), ..work(0.01) }, 0.2);
        assert_eq!(known.learned.len(), 1);
        known.keep(Some(&file));
        assert_eq!(Machine::read(&file), Some(known));
    }

    #[test]
    fn what_is_left_starts_with_the_estimate_and_never_climbs() {
        assert_eq!(remaining_s(10.0, 0.0), 10.0);
        assert_eq!(remaining_s(10.0, 4.0), 6.0);
        let course: Vec<f64> = (0..300).map(|i| remaining_s(10.0, f64::from(i) * 0.1)).collect();
        assert!(course.windows(2).all(|pair| pair[1] < pair[0] && pair[1] > 0.0), "{course:?}");
        assert!((0.5..1.2).contains(&course[100]), "{}", course[100]);
        assert_eq!(remaining_s(0.0, 1.0), 0.0);
    }

    #[test]
    fn figures_of_another_build_or_damaged_ones_are_measured_anew() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("machine.json");
        for wrong in [
            Machine { of: "another".into(), ..machine(1.0) },
            Machine { version: VERSION + 1, ..machine(1.0) },
            Machine { speed: -1.0, ..machine(1.0) },
        ] {
            wrong.keep(Some(&file));
            assert_eq!(Machine::read(&file), None, "{wrong:?}");
        }
        std::fs::write(&file, "{").unwrap();
        assert_eq!(Machine::read(&file), None);
        let found = Machine::measured();
        assert!(found.speed > 0.0 && found.learned.is_empty(), "{found:?}");
    }
}

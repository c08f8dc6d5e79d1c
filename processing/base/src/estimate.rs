//! Time, memory and disk that an operation will take on this machine.
//!
//! Each operation states its [`Work`] in seconds of a reference machine. A [`Machine`] compares itself with that one by a short
//! calculation, and learns from every operation that it completes. What it knows is kept in the user's cache folder.

use crate::{Error, input, json, rewrite};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Version of the file that a machine's speed is kept in.
const VERSION: u32 = 1;

/// Largest file of that kind that is read.
const MOST_BYTES: u64 = 1 << 20;

/// Seconds of one [`calculation`] where all threads do as many as they can, on the reference machine: two threads of an AMD EPYC, idle, debug build
/// of 2026-11. Debug builds optimise the crates that compute.
const REFERENCE_S: f64 = 0.0040;

/// Weight of a new measurement against earlier ones.
const NEW: f64 = 0.3;

/// Measured times change estimates by at most this factor: a machine that was busy once does not spoil them for good.
const MOST: f64 = 4.0;

/// Bytes that the program itself takes, with its threads: 36 MB measured for a debug build, rounded up.
const PROGRAM_BYTES: u64 = 40 << 20;

/// Shorter operations teach nothing: their time is that of starting.
const SHORTEST_S: f64 = 0.3;

/// Time, memory and disk of an operation on the reference machine.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Work {
    /// Its name, under which its speed on a machine is learned.
    pub operation: Cow<'static, str>,
    /// Seconds of the reference machine.
    pub seconds: f64,
    /// Most memory at a time, in bytes, without that of the program itself.
    pub memory_bytes: u64,
    /// Disk that its results take, in bytes.
    pub disk_bytes: u64,
    /// Seconds of this machine that the operation had taken when it stated this, such as those of a trial.
    #[serde(default)]
    pub taken_s: f64,
}

impl Work {
    /// The same after another operation, which shares its memory and leaves nothing on disk.
    #[must_use]
    pub fn preceded_by(self, other: &Self) -> Self {
        let memory_bytes = self.memory_bytes.max(other.memory_bytes);
        Self { seconds: self.seconds + other.seconds, memory_bytes, ..self }
    }
}

/// Time, memory and disk of an operation on one machine.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Time in seconds on a machine that does nothing else; `tests/estimates` measures how close it is.
    pub seconds: f64,
    /// Bound of the memory at a time, that of the program included, in bytes; for calibration, height fields and renderings an estimate, as no
    /// header says what they need.
    pub memory_bytes: u64,
    /// Disk that the results take, in bytes.
    pub disk_bytes: u64,
}

/// How fast a machine is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    version: u32,
    /// Build of the program and threads that these figures hold for.
    of: String,
    /// Speed of all threads together over that of the reference machine, by a short calculation.
    pub speed: f64,
    /// Time of each operation over its estimate by `speed`, as learned.
    pub learned: BTreeMap<String, f64>,
}

impl Machine {
    /// This machine, as known from its file in the cache folder; measured (about 0.1 s) where there is none of this build.
    pub fn here() -> Self {
        let file = cache_file();
        file.as_deref().and_then(Self::read).unwrap_or_else(|| {
            let machine = Self::measured();
            machine.keep(file.as_deref());
            machine
        })
    }

    /// This machine, measured now. Nothing is learned yet.
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

    /// Keeps what is known. Without a folder for it, the machine is measured every time.
    fn keep(&self, file: Option<&Path>) {
        let Some(file) = file else { return };
        let folder = file.parent().map_or(Ok(()), std::fs::create_dir_all);
        let write = |path: &Path| std::fs::write(path, json(self)).map_err(|e| Error::output(path, e));
        // Estimates are no reason to fail.
        let _ = folder.map(|()| rewrite(file, write));
    }

    /// Estimate of an operation on this machine.
    pub fn estimate(&self, work: &Work) -> Estimate {
        let learned = self.learned.get(&*work.operation).copied().unwrap_or(1.0);
        let Work { disk_bytes, .. } = *work;
        let memory_bytes = work.memory_bytes + PROGRAM_BYTES;
        Estimate { seconds: work.taken_s + work.seconds / self.speed * learned, memory_bytes, disk_bytes }
    }

    /// Learns from an operation that took so many seconds, and keeps that.
    pub fn learn(&mut self, work: &Work, seconds: f64) {
        if self.learned_from(work, seconds) {
            self.keep(cache_file().as_deref());
        }
    }

    /// Learns, if there is anything to be learned.
    fn learned_from(&mut self, work: &Work, seconds: f64) -> bool {
        let expected = work.seconds / self.speed;
        let teaches = seconds.max(expected) >= SHORTEST_S && expected > 0.0 && seconds > 0.0;
        if teaches {
            let found = (seconds / expected).clamp(1.0 / MOST, MOST);
            let before = self.learned.get(&*work.operation).copied().unwrap_or(found);
            // In logarithms, so that twice as long and half as long cancel.
            self.learned.insert(work.operation.to_string(), before.powf(1.0 - NEW) * found.powf(NEW));
        }
        teaches
    }
}

/// An operation that has begun, with its estimate.
pub struct Running {
    machine: Machine,
    work: Work,
    begun: Instant,
    expected_s: f64,
}

impl Running {
    /// Begins now.
    pub fn begin(work: Work) -> Self {
        let machine = Machine::here();
        let expected_s = machine.estimate(&work).seconds - work.taken_s;
        Self { machine, work, begun: Instant::now(), expected_s }
    }

    /// Its estimate.
    pub fn estimate(&self) -> Estimate {
        self.machine.estimate(&self.work)
    }

    /// Seconds that are left: they never climb.
    pub fn remaining_s(&self) -> f64 {
        remaining_s(self.expected_s, self.begun.elapsed().as_secs_f64())
    }

    /// The operation is complete: the machine learns from it.
    pub fn complete(mut self) {
        self.machine.learn(&self.work, self.begun.elapsed().as_secs_f64());
    }
}

/// Seconds that are left of an operation of `expected` seconds after `gone` of them. They fall at all times and never reach 0.
fn remaining_s(expected: f64, gone: f64) -> f64 {
    /// Where an operation may take longer than expected, the last part of the estimate is stretched.
    const LAST: f64 = 0.3;
    let last = LAST * expected;
    let left = expected - gone;
    if left > last { left } else { last * ((left - last) / last.max(f64::MIN_POSITIVE)).exp() }
}

/// Which program, processor and threads figures hold for.
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

/// A calculation of the kind that reconstructions consist of: sums of products over more numbers than the first cache holds.
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
        // Other operations are not affected, and a machine that hung for an hour is not believed.
        assert_eq!(known.estimate(&Work { operation: "lut".into(), ..work(10.0) }).seconds, 10.0);
        known.learned_from(&work(10.0), 3600.0);
        assert!(known.estimate(&work(10.0)).seconds < 40.0);
        // Starting takes a while, which says nothing of the operation.
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

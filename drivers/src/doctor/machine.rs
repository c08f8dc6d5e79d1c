//! Kernel, clocks, memory and processor.

use super::{Check, Health};
use crate::discovery::{Root, entries, text};
use rustix::time::{ClockId, clock_getres, clock_gettime};
use std::path::Path;

const GIB: f64 = 1024.0 * 1024.0 * 1024.0;

/// Start of 2024 as Unix time: a clock with an earlier time was never set.
const EPOCH_2024: i64 = 1_704_067_200;

pub(super) fn versions(root: &Root) -> Check {
    let kernel = text(&root.proc.join("sys/kernel/osrelease")).unwrap_or_else(|| "of unknown version".into());
    Check::ok("versions", format!("Nacre {}, Linux {kernel}", env!("CARGO_PKG_VERSION")))
}

/// Checks the resolution of the clock that stamps frames.
pub(super) fn resolution() -> Check {
    let step = clock_getres(ClockId::Monotonic);
    let ns = step.tv_sec as f64 * 1e9 + step.tv_nsec as f64;
    let found = format!("steps of {ns:.0} ns");
    if ns <= 1e6 {
        return Check::ok("clock", found);
    }
    Check::not_ok("clock", Health::Warn, found, "boot a kernel with high-resolution timers")
}

/// Checks the date. Changing it during a measurement does no harm, since timing uses the monotonic clock.
pub(super) fn date() -> Check {
    dated(clock_gettime(ClockId::Realtime).tv_sec)
}

fn dated(seconds: i64) -> Check {
    if seconds >= EPOCH_2024 {
        return Check::ok("date", "set");
    }
    let found = "before 2024: measurements would carry a wrong date";
    Check::not_ok("date", Health::Warn, found, "run `sudo timedatectl set-ntp true`, or set the date by hand")
}

pub(super) fn memory(root: &Root) -> Check {
    let free = text(&root.proc.join("meminfo")).and_then(|t| available(&t));
    let Some(bytes) = free else {
        return Check::not_ok("memory", Health::Warn, "not told by this kernel", "see that 2 GiB are free");
    };
    let found = format!("{:.1} GiB free", bytes / GIB);
    Check::at_least("memory", bytes, [2.0 * GIB, 0.5 * GIB], found, "end other programs; measurements need 2 GiB")
}

/// Memory available to programs in bytes, from /proc/meminfo.
fn available(text: &str) -> Option<f64> {
    let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
    Some(line.trim().strip_suffix("kB")?.trim().parse::<f64>().ok()? * 1024.0)
}

/// Checks the processor's frequency governor; `None` if there is none.
pub(super) fn governor(root: &Root) -> Option<Check> {
    let cpus = entries(&root.sys.join("devices/system/cpu"));
    let slow = cpus.iter().filter_map(|cpu| text(&cpu.join("cpufreq/scaling_governor")).map(|g| (g, kept_low(cpu))));
    let governors: Vec<(String, bool)> = slow.collect();
    let first = governors.first()?.0.clone();
    let low = governors.iter().filter(|(governor, low)| *low && governor == "powersave").count();
    if low == 0 {
        return Some(Check::ok("processor", format!("governor {first}")));
    }
    let found = format!("governor powersave keeps {low} of {} cores slow", governors.len());
    Some(Check::not_ok("processor", Health::Warn, found, "run `sudo cpupower frequency-set -g schedutil`"))
}

/// With the drivers of newer processors, the governor powersave is not slow.
fn kept_low(cpu: &Path) -> bool {
    let driver = text(&cpu.join("cpufreq/scaling_driver")).unwrap_or_default();
    !matches!(driver.as_str(), "intel_pstate" | "amd-pstate-epp")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn free_memory_is_read() {
        let text = "MemTotal:       16300000 kB\nMemFree:  100 kB\nMemAvailable:    4194304 kB\n";
        assert_eq!(available(text), Some(4.0 * GIB));
        for odd in ["", "MemAvailable: many kB", "MemAvailable: 7"] {
            assert_eq!(available(odd), None);
        }
    }

    #[test]
    fn a_clock_that_was_never_set_is_noticed() {
        assert_eq!(dated(0).ok, Health::Warn);
        assert_eq!(dated(EPOCH_2024).ok, Health::Ok);
    }

    #[test]
    fn slow_governors_are_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let root = Root::under(folder.path());
        assert_eq!(governor(&root), None);
        let cpu = |n: usize, governor: &str, driver: &str| {
            let folder = root.sys.join(format!("devices/system/cpu/cpu{n}/cpufreq"));
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join("scaling_governor"), governor).unwrap();
            std::fs::write(folder.join("scaling_driver"), driver).unwrap();
        };
        cpu(0, "schedutil\n", "acpi-cpufreq\n");
        cpu(1, "powersave\n", "intel_pstate\n");
        assert_eq!(governor(&root).unwrap().ok, Health::Ok);
        cpu(2, "powersave\n", "acpi-cpufreq\n");
        let check = governor(&root).unwrap();
        assert_eq!(check.ok, Health::Warn);
        assert!(check.found.contains("1 of 3"), "{check:?}");
    }
}

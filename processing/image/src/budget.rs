//! The memory budget: photographs whose computation would not fit are refused before any memory is taken for them.

use crate::Info;
use nacre_base::{Error, Result};
use std::path::Path;

/// Bytes of a GiB, for messages.
const GIB: f64 = (1_u64 << 30) as f64;

/// Bytes that a decoded photograph takes, and as much again for its decoder: alpha, coefficients of a progressive JPEG.
pub fn decoded(info: Info) -> u64 {
    2 * (info.width * info.height * info.channels * info.depth.bytes()) as u64
}

/// Refuses photographs like this one when their computation needs more bytes than are allowed.
///
/// # Errors
/// `Input`, naming the photograph, its size, and both amounts of memory.
pub fn check(photograph: &Path, info: Info, needed: u64) -> Result<()> {
    let Some(allowed) = allowed().filter(|allowed| needed > *allowed) else { return Ok(()) };
    let [needed, allowed] = [needed, allowed].map(|bytes| bytes as f64 / GIB);
    let problem = format!(
        "is {info}; the computation needs {needed:.2} GiB of memory, and {allowed:.2} GiB are allowed (3/4 of this machine's, or of the process's limit)"
    );
    let remedy = "crop or scale down the photographs (a session: set camera.roi), raise the memory limit, or use a larger machine";
    Err(Error::file(photograph, problem, remedy))
}

#[cfg(not(target_os = "linux"))]
fn allowed() -> Option<u64> {
    None
}

/// Bytes that a computation may take, determined when first asked for; a quarter of the memory is left to the program itself, its
/// threads and other programs.
#[cfg(target_os = "linux")]
fn allowed() -> Option<u64> {
    static ALLOWED: std::sync::OnceLock<Option<u64>> = std::sync::OnceLock::new();
    *ALLOWED.get_or_init(|| {
        let least = [linux::physical(), linux::control_group(), linux::process()].into_iter().flatten().min()?;
        Some(least / 4 * 3)
    })
}

#[cfg(target_os = "linux")]
mod linux {
    use rustix::process::{Resource, getrlimit};
    use std::fs::read_to_string;
    use std::path::Path;

    /// Bytes of the machine's memory.
    pub(super) fn physical() -> Option<u64> {
        bytes("/proc/meminfo", "MemTotal:")
    }

    /// A line such as "MemTotal: 16384 kB" of the system's own text files.
    fn bytes(file: &str, key: &str) -> Option<u64> {
        let text = read_to_string(file).ok()?;
        let kib = text.lines().find_map(|line| line.strip_prefix(key))?.trim().strip_suffix(" kB")?;
        Some(kib.parse::<u64>().ok()? << 10)
    }

    /// Smallest limit of the control groups (version 2) that the process is in: a container's, or `MemoryMax` of a systemd unit.
    pub(super) fn control_group() -> Option<u64> {
        let own = read_to_string("/proc/self/cgroup").ok()?;
        smallest_limit(Path::new("/sys/fs/cgroup"), own.lines().find_map(|l| l.strip_prefix("0::/"))?)
    }

    pub(super) fn smallest_limit(root: &Path, group: &str) -> Option<u64> {
        let groups = Path::new(group).ancestors();
        groups.filter_map(|g| read_to_string(root.join(g).join("memory.max")).ok()?.trim().parse().ok()).min()
    }

    /// Bytes that the process's own limits (`ulimit -v`, `ulimit -d`) leave beside the address space in use.
    pub(super) fn process() -> Option<u64> {
        let limit = [Resource::As, Resource::Data].into_iter().filter_map(|r| getrlimit(r).current).min()?;
        Some(limit.saturating_sub(bytes("/proc/self/status", "VmSize:")?))
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use crate::Depth;
    use std::fs;

    #[test]
    fn a_refusal_says_size_memory_and_remedy() {
        let info = Info { width: 8000, height: 6000, channels: 3, depth: Depth::U16 };
        assert_eq!(decoded(info), 8000 * 6000 * 12);
        check(Path::new("a/000.png"), info, 1 << 20).unwrap();
        let said = check(Path::new("a/000.png"), info, u64::MAX).unwrap_err().to_string();
        for word in ["a/000.png", "8000 x 6000", "17179869184.00 GiB", "allowed", "crop"] {
            assert!(said.contains(word), "no {word} in: {said}");
        }
    }

    /// The machine's memory is known wherever there is a `/proc`, and less than all of it is allowed.
    #[test]
    fn the_machine_says_how_much_there_is() {
        let all = linux::physical().unwrap();
        assert!(allowed().unwrap() <= all / 4 * 3);
    }

    #[test]
    fn the_smallest_group_around_the_process_counts() {
        let root = tempfile::tempdir().unwrap();
        let group = root.path().join("system.slice/nacre.service");
        fs::create_dir_all(&group).unwrap();
        let limit = || linux::smallest_limit(root.path(), "system.slice/nacre.service");
        assert_eq!(limit(), None);
        fs::write(group.join("memory.max"), "max\n").unwrap();
        assert_eq!(limit(), None);
        fs::write(group.join("memory.max"), "4294967296\n").unwrap();
        assert_eq!(limit(), Some(4 << 30));
        fs::write(root.path().join("system.slice/memory.max"), "1073741824\n").unwrap();
        assert_eq!(limit(), Some(1 << 30));
    }
}

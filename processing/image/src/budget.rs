//! Estimates of time, memory and disk for operations. Photographs that need too much memory are refused before any is
//! allocated.

use crate::{Depth, Info, info, size};
use nacre_base::estimate::Work;
use nacre_base::{Error, Result};
use std::path::Path;
use std::sync::OnceLock;

/// Bytes per GiB, for messages.
const GIB: f64 = (1_u64 << 30) as f64;

/// Bytes of a decoded photograph, doubled for its decoder (alpha, coefficients of a progressive JPEG).
pub fn decoded(info: Info) -> u64 {
    2 * (info.width * info.height * info.channels * info.depth.bytes()) as u64
}

/// Upper bound in bytes of the memory for the overview picture of a map with this number of pixels. Maps above 1 Mpixel
/// are scaled down first.
pub fn overview(pixels: u64) -> u64 {
    40 * pixels.min(1 << 20)
}

/// Operations whose cost follows from the size of their input, each with its memory in bytes per pixel, without the
/// decoded file. Polarization and HDR depend on brackets and dark photographs too, and have estimates elsewhere.
///
/// Times are those of the reference machine ([`Work`]), measured at 0.02 to 4 Mpixel (`tests/estimates`).
///
/// Memory bounds are rounded up from measured peaks of the resident memory at 4 and 16 Mpixel, given in brackets. No
/// header determines the cost of calibration (windows of single photographs), meshes, octaves of lookup tables (at most
/// 2 GiB), transforms of height fields, and spectra of renderings. For these, the memory limit of the job's process
/// applies ([`nacre_base::contained`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// Deconvolution of a photograph or a part of it: 44 (39 with the file).
    Bokeh {
        /// Number of pixels of the part; `None` for all.
        part: Option<usize>,
        /// Number or upper limit of iterations.
        iterations: usize,
    },
    /// Lookup table with this number of entries. 12 per pixel and channel of the photograph (14 with a grey file, 27
    /// with a colour file), and 22 per entry (20).
    Table(usize),
    /// Distribution of a foil from a photograph: as [`Self::Table`], without entries.
    Foil,
    /// Gratings from this number of flash photographs. 16 for the photograph and that by room light, 160 for a tile of
    /// the same size, and 80 MiB for the search for shared gratings.
    Flash(usize),
    /// This number of fringe photographs: 8 each, and 200 for the fit.
    Fringes(usize),
    /// Height field and its transforms: 48 (42 with the file).
    Heights,
    /// Rendering with this number of samples per pixel: 64 (55).
    Rendering(usize),
    /// This number of maps and their edited copies: 24 each (value, σ and mask of both).
    Maps(usize),
}

impl Operation {
    fn bytes(self, info: Info) -> u64 {
        let pixels = info.width * info.height;
        let bytes = match self {
            Self::Bokeh { part, .. } => 44 * part.unwrap_or(pixels).min(pixels),
            Self::Table(entries) => 12 * info.channels * pixels + 22 * entries,
            Self::Foil => 12 * info.channels * pixels,
            Self::Flash(_) => (16 + 160) * pixels + (80 << 20),
            Self::Fringes(count) => (8 * count + 200) * pixels,
            Self::Heights => 48 * pixels,
            Self::Rendering(_) => 64 * pixels,
            Self::Maps(count) => 24 * count * pixels,
        };
        let file = if matches!(self, Self::Rendering(_)) { 0 } else { decoded(info) };
        bytes as u64 + file
    }

    /// Estimates time, memory and disk from the header of the input.
    ///
    /// # Errors
    /// As [`check`].
    pub fn check(self, input: &Path, info: Info) -> Result<Work> {
        let work = self.work(info);
        check(input, info, work.memory_bytes)?;
        Ok(work)
    }

    /// Estimates time, memory and disk from the header of a file, which may be a map with any channels. A file without
    /// a known header is left to its reader.
    ///
    /// # Errors
    /// As [`check`].
    pub fn check_file(self, file: &Path) -> Result<Work> {
        let any = |[width, height]: [usize; 2]| Info { width, height, channels: 3, depth: Depth::F32 };
        match info(file).or_else(|_| size(file).map(any)) {
            Ok(info) => self.check(file, info),
            Err(_) => Ok(self.work(any([0, 0]))),
        }
    }

    /// As [`Self::check`], without the limit of memory.
    pub fn work(self, info: Info) -> Work {
        let pixels = info.width * info.height;
        let mega = |count: usize| count as f64 / 1e6;
        // Seconds, and bytes of the results.
        let (operation, seconds, disk) = match self {
            Self::Bokeh { part, iterations } => {
                let part = part.unwrap_or(pixels).min(pixels);
                ("bokeh", 0.03 + mega(part) * (0.45 + 0.003 * iterations as f64), 10 * part)
            }
            Self::Table(entries) => ("lut", 0.03 + 0.09 * mega(pixels) + 0.15 * mega(entries), 17 * entries),
            Self::Foil => ("foil", 0.05 + 0.35 * mega(pixels), 1 << 20),
            Self::Flash(lights) => ("flash", 1.7 + mega(pixels) * 1.05 * lights as f64, pixels),
            Self::Fringes(count) => ("spots", 0.5 + mega(pixels) * 9.0 * count as f64, 27 * pixels),
            Self::Heights => ("brdf", 0.1 + 2.0 * mega(pixels), 1 << 22),
            Self::Rendering(samples) => ("render", 0.1 + 0.8 * mega(samples * pixels), 16 * pixels),
            Self::Maps(count) => ("map", 0.02 + 0.2 * mega(count * pixels), 24 * count * pixels),
        };
        Work {
            operation: operation.into(),
            seconds,
            memory_bytes: self.bytes(info),
            disk_bytes: disk as u64,
            ..Work::default()
        }
    }
}

/// Checks the memory for a computation on this photograph against the limit.
///
/// # Errors
/// `Input` above the limit, naming the photograph, its size, and both amounts of memory.
pub fn check(photograph: &Path, info: Info, needed: u64) -> Result<()> {
    let Some(allowed) = allowed().filter(|allowed| needed > *allowed) else { return Ok(()) };
    let [needed, allowed] = [needed, allowed].map(|bytes| bytes as f64 / GIB);
    let problem = format!(
        "is {info}; the computation needs {needed:.2} GiB of memory, and {allowed:.2} GiB are allowed (3/4 of this machine's, or of a limit)"
    );
    let remedy = "crop or scale down the photographs (a session: set camera.roi), raise the memory limit, or use a larger machine";
    Err(Error::file(photograph, problem, remedy))
}

static ALLOWED: OnceLock<Option<u64>> = OnceLock::new();

/// Largest memory of a computation in bytes, determined on the first call; `None` if the system does not report any.
///
/// This is the value given to [`allow`], or three quarters of the smallest of the machine's memory, the limit of the
/// control group, and that of the process. A quarter remains for the program, its threads and other programs.
pub fn allowed() -> Option<u64> {
    *ALLOWED.get_or_init(measured)
}

/// Sets the largest memory of a computation in bytes. It has no effect after the first call of [`allowed`].
pub fn allow(bytes: u64) {
    let _ = ALLOWED.set(Some(bytes));
}

#[cfg(not(target_os = "linux"))]
fn measured() -> Option<u64> {
    None
}

#[cfg(target_os = "linux")]
fn measured() -> Option<u64> {
    let least = [linux::physical(), linux::control_group(), linux::process()].into_iter().flatten().min()?;
    Some(least / 4 * 3)
}

#[cfg(target_os = "linux")]
mod linux {
    use rustix::process::{Resource, getrlimit};
    use std::fs::read_to_string;
    use std::path::Path;

    /// Physical memory of the machine in bytes.
    pub(super) fn physical() -> Option<u64> {
        bytes("/proc/meminfo", "MemTotal:")
    }

    /// Value in bytes of a line such as "MemTotal: 16384 kB" in a text file of the system.
    fn bytes(file: &str, key: &str) -> Option<u64> {
        let text = read_to_string(file).ok()?;
        let kib = text.lines().find_map(|line| line.strip_prefix(key))?.trim().strip_suffix(" kB")?;
        Some(kib.parse::<u64>().ok()? << 10)
    }

    /// Smallest memory limit of the control groups (version 2) of the process, as of a container or `MemoryMax` of a
    /// systemd unit.
    pub(super) fn control_group() -> Option<u64> {
        let own = read_to_string("/proc/self/cgroup").ok()?;
        smallest_limit(Path::new("/sys/fs/cgroup"), own.lines().find_map(|l| l.strip_prefix("0::/"))?)
    }

    pub(super) fn smallest_limit(root: &Path, group: &str) -> Option<u64> {
        let groups = Path::new(group).ancestors();
        groups.filter_map(|g| read_to_string(root.join(g).join("memory.max")).ok()?.trim().parse().ok()).min()
    }

    /// Smallest resource limit of the process: `ulimit -v` (address space) or `ulimit -d` (private writable memory).
    pub(super) fn process() -> Option<u64> {
        let left = |(resource, in_use)| {
            let limit = getrlimit(resource).current?;
            Some(limit.saturating_sub(bytes("/proc/self/status", in_use)?))
        };
        [(Resource::As, "VmSize:"), (Resource::Data, "VmData:")].into_iter().filter_map(left).min()
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
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

    #[test]
    fn bounds_are_above_the_measured_memory_per_pixel() {
        let grey = Info { width: 1024, height: 1024, channels: 1, depth: Depth::U16 };
        let colour = Info { channels: 3, ..grey };
        let per_pixel = |operation: Operation, info| operation.bytes(info) >> 20;
        for (operation, info, measured) in [
            (Operation::Bokeh { part: None, iterations: 30 }, grey, 39),
            (Operation::Foil, grey, 14),
            (Operation::Table(1), colour, 27),
            (Operation::Heights, grey, 42),
            (Operation::Rendering(8), colour, 55),
        ] {
            let bound = per_pixel(operation, info);
            assert!((measured..2 * measured).contains(&bound), "{operation:?}: {bound}");
        }
        assert_eq!(per_pixel(Operation::Bokeh { part: Some(1 << 18), iterations: 1 }, grey), 11 + 4);
        assert_eq!(per_pixel(Operation::Fringes(9), grey), 272 + 4);
        let told = Operation::Maps(1 << 30).check(Path::new("period.exr"), grey).unwrap_err().to_string();
        assert!(told.contains("period.exr") && told.contains("allowed"), "{told}");
    }

    /// The physical memory is known where there is a `/proc`, and the limit is below it.
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

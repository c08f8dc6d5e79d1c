//! Free space and write speed of the disk for measurements.

use super::{Check, Health};
use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

const GIB: f64 = 1024.0 * 1024.0 * 1024.0;

/// Bytes written to measure the speed.
pub(super) const AMOUNT: usize = 64 << 20;

const CHUNK: usize = 1 << 20;

pub(super) fn space(folder: &Path) -> Check {
    match rustix::fs::statvfs(folder) {
        Ok(found) => {
            let bytes = found.f_bavail as f64 * found.f_frsize as f64;
            let words = format!("{:.1} GiB free in {}", bytes / GIB, folder.display());
            Check::at_least("disk space", bytes, [10.0 * GIB, GIB], words, "remove old sessions, or use a larger disk")
        }
        Err(e) => missing("disk space", folder, e.into()),
    }
}

pub(super) fn speed(folder: &Path, amount: usize) -> Check {
    match measure(folder, amount) {
        Ok(speed) => {
            let found = format!("{speed:.0} MB/s written in {}", folder.display());
            let remedy = "keep measurements on a local disk or SSD: a slow one holds up the camera";
            Check::at_least("disk speed", speed, [50.0, 10.0], found, remedy)
        }
        Err(e) => missing("disk speed", folder, e),
    }
}

fn missing(name: &str, folder: &Path, error: io::Error) -> Check {
    let found = format!("{}: {error}", folder.display());
    Check::not_ok(name, Health::Bad, found, "give a folder that exists and that you may write to")
}

/// Removes the file in any case.
struct Removed(PathBuf);

impl Drop for Removed {
    fn drop(&mut self) {
        // The file may already be gone, and no further action is possible.
        let _ = std::fs::remove_file(&self.0);
    }
}

/// Sustained write speed in MB/s, synced to the disk.
fn measure(folder: &Path, amount: usize) -> io::Result<f64> {
    let path = folder.join(format!(".nacre-speed-{}-{:?}", std::process::id(), std::thread::current().id()));
    let mut file: File = OpenOptions::new().write(true).create_new(true).open(&path)?;
    let _removed = Removed(path);
    // Random bytes, since some file systems skip zeros.
    let mut seed = 1u64;
    let chunk: Vec<u8> = std::iter::repeat_with(|| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as u8
    })
    .take(CHUNK)
    .collect();
    let begun = Instant::now();
    for _ in 0..amount.div_ceil(CHUNK) {
        file.write_all(&chunk)?;
    }
    file.sync_data()?;
    let written = (amount.div_ceil(CHUNK) * CHUNK) as f64;
    Ok(written / 1e6 / begun.elapsed().as_secs_f64().max(1e-6))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_speed_is_measured_and_nothing_is_left() {
        let folder = tempfile::tempdir().unwrap();
        assert!(measure(folder.path(), CHUNK).unwrap() > 0.0);
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_folder_that_is_not_there_is_bad() {
        let folder = Path::new("/no/such/folder");
        assert_eq!([space(folder).ok, speed(folder, CHUNK).ok], [Health::Bad; 2]);
    }
}

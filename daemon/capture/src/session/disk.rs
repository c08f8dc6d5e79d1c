//! Disk operations of a session, abstracted so that power loss can be simulated at each of them.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;

/// Disk operations. Each returns once it is done, and where stated, once it is durable.
pub trait Disk {
    /// Creates a folder, which must not exist.
    fn create_dir(&self, path: &Path) -> io::Result<()>;
    /// Writes a file and syncs its contents (its name is durable only after the folder's sync).
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()>;
    /// Renames a file, replacing another.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;
    /// Makes names in a folder durable.
    fn sync_dir(&self, path: &Path) -> io::Result<()>;
    /// Appends to a file, creating it if necessary, and syncs its contents.
    fn append(&self, path: &Path, bytes: &[u8]) -> io::Result<()>;
    /// Truncates a file and syncs it.
    fn truncate(&self, path: &Path, length: u64) -> io::Result<()>;
}

/// The machine's file system.
pub struct RealDisk;

impl Disk for RealDisk {
    fn create_dir(&self, path: &Path) -> io::Result<()> {
        fs::create_dir(path)
    }

    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut file = File::create(path)?;
        file.write_all(bytes)?;
        file.sync_all()
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)
    }

    fn sync_dir(&self, path: &Path) -> io::Result<()> {
        File::open(path)?.sync_all()
    }

    fn append(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let mut file = OpenOptions::new().create(true).append(true).open(path)?;
        file.write_all(bytes)?;
        file.sync_data()
    }

    fn truncate(&self, path: &Path, length: u64) -> io::Result<()> {
        // A journal that never became durable is empty.
        let file = OpenOptions::new().create(true).truncate(false).write(true).open(path)?;
        file.set_len(length)?;
        file.sync_all()
    }
}

/// Kills this process just before the disk operation with the number in `NACRE_DIE_AT`, for tests of kills at any step.
/// Not in release builds.
pub struct MortalDisk {
    left: std::cell::Cell<Option<u64>>,
}

impl Default for MortalDisk {
    fn default() -> Self {
        let text = if cfg!(debug_assertions) { std::env::var("NACRE_DIE_AT").ok() } else { None };
        Self { left: text.and_then(|t| t.parse().ok()).into() }
    }
}

impl MortalDisk {
    fn one_more(&self) -> RealDisk {
        if self.left.get() == Some(0) {
            let _ = rustix::process::kill_process(rustix::process::getpid(), rustix::process::Signal::KILL);
        }
        self.left.set(self.left.get().map(|left| left - 1));
        RealDisk
    }
}

impl Disk for MortalDisk {
    fn create_dir(&self, path: &Path) -> io::Result<()> {
        self.one_more().create_dir(path)
    }

    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        self.one_more().write(path, bytes)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.one_more().rename(from, to)
    }

    fn sync_dir(&self, path: &Path) -> io::Result<()> {
        self.one_more().sync_dir(path)
    }

    fn append(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        self.one_more().append(path, bytes)
    }

    fn truncate(&self, path: &Path, length: u64) -> io::Result<()> {
        self.one_more().truncate(path, length)
    }
}

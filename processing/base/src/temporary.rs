//! Temporary folders and files beside a result. They are locked while in use. Remains of a killed process are
//! identified by the missing lock and removed by the next run with the same result.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File, Permissions, TryLockError};
use std::io;
use std::os::unix::ffi::OsStrExt;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use tempfile::{Builder, NamedTempFile, TempDir};

/// Suffix of all temporary names.
const END: &str = ".partial";

/// Number of random letters and digits in the name.
const RANDOM: usize = 6;

/// Maximum length in bytes of the result's name within a temporary name, which must fit the limit of 255 of file
/// systems.
const REPEATED: usize = 200;

/// Maximum number of attempts: a new temporary may be swept before it is locked, and another one is then created.
const ATTEMPTS: usize = 100;

/// A hidden folder `.NAME.XXXXXX.partial`, removed when dropped.
#[derive(Debug)]
pub struct TemporaryFolder {
    folder: TempDir,
    /// Held until the folder is removed or kept. File systems without locks do without.
    _lock: Option<File>,
}

impl TemporaryFolder {
    /// Creates a temporary folder in `parent` for the result `name`, with the permissions of an ordinary new folder.
    /// Remains of killed processes for the same result are removed.
    ///
    /// # Errors
    /// Those of the system.
    pub fn new(parent: &Path, name: &OsStr) -> io::Result<Self> {
        sweep(parent, name);
        for _ in 0..ATTEMPTS {
            let folder = builder(&prefix(name)).permissions(Permissions::from_mode(0o777)).tempdir_in(parent)?;
            if let Some(lock) = lock(folder.path()) {
                return Ok(Self { folder, _lock: lock });
            }
        }
        Err(io::ErrorKind::WouldBlock.into())
    }

    /// Path of the folder.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Leaves the folder to the caller, who has moved it or will do so.
    pub fn keep(self) -> PathBuf {
        self.folder.keep()
    }
}

/// Creates a hidden file `.NAME.XXXXXX.partial` in `parent` for the result `name`, with the permissions of an ordinary
/// new file.
pub(crate) fn file(parent: &Path, name: &OsStr) -> io::Result<NamedTempFile> {
    sweep(parent, name);
    for _ in 0..ATTEMPTS {
        let file = builder(&prefix(name)).permissions(Permissions::from_mode(0o666)).tempfile_in(parent)?;
        if locked(file.as_file(), file.path()) {
            return Ok(file);
        }
    }
    Err(io::ErrorKind::WouldBlock.into())
}

/// Removes unlocked temporaries of the result `name` in `parent`. Failures are ignored: the next run tries again.
pub fn sweep(parent: &Path, name: &OsStr) {
    sweep_with(parent, prefix(name).as_bytes());
}

/// Removes unlocked temporaries of all results in `parent`; for folders that belong to Nacre alone.
pub fn sweep_all(parent: &Path) {
    sweep_with(parent, b".");
}

fn sweep_with(parent: &Path, prefix: &[u8]) {
    for entry in fs::read_dir(parent).into_iter().flatten().flatten() {
        let ours = entry.file_name().as_bytes().strip_prefix(prefix).is_some_and(|rest| is_temporary(rest, prefix));
        if ours {
            remove_unused(&entry.path());
        }
    }
}

/// True if the remainder of a name identifies a temporary: after `.NAME.` the random part, after `.` anything before
/// it.
fn is_temporary(rest: &[u8], prefix: &[u8]) -> bool {
    let Some(rest) = rest.strip_suffix(END.as_bytes()) else { return false };
    let Some((before, random)) = rest.split_at_checked(rest.len().wrapping_sub(RANDOM)) else { return false };
    let whole = if prefix == b"." { before.ends_with(b".") } else { before.is_empty() };
    whole && random.iter().all(u8::is_ascii_alphanumeric)
}

/// Removes a folder or file unless a process has locked it. Without support for locks, nothing is removed.
fn remove_unused(path: &Path) {
    let Ok(kind) = fs::symlink_metadata(path).map(|m| m.file_type()) else { return };
    if !kind.is_dir() && !kind.is_file() {
        return;
    }
    let Ok(lock) = File::open(path) else { return };
    if lock.try_lock().is_ok() {
        // Failed removals are left to the next sweep.
        _ = if kind.is_dir() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    }
}

/// Locks a new folder, if the file system supports locks; the outer `None` means that a sweep was faster.
fn lock(folder: &Path) -> Option<Option<File>> {
    match File::open(folder) {
        Ok(file) => locked(&file, folder).then_some(Some(file)),
        Err(_) => folder.exists().then_some(None),
    }
}

/// Locks a new temporary; returns false if a sweep was faster.
fn locked(file: &File, path: &Path) -> bool {
    !matches!(file.try_lock(), Err(TryLockError::WouldBlock)) && path.exists()
}

fn builder(prefix: &OsStr) -> Builder<'_, 'static> {
    let mut builder = Builder::new();
    builder.prefix(prefix).suffix(END).rand_bytes(RANDOM);
    builder
}

/// Prefix of the names of a result's temporaries.
fn prefix(name: &OsStr) -> OsString {
    let mut prefix = OsString::from(".");
    prefix.push(OsStr::from_bytes(&name.as_bytes()[..name.len().min(REPEATED)]));
    prefix.push(".");
    prefix
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<String> = entries.collect();
        names.sort();
        names
    }

    #[test]
    fn leftovers_of_the_same_result_are_swept_and_all_else_stays() {
        let home = tempfile::tempdir().unwrap();
        let stays = ["r", ".r", ".r.partial", ".r.12345.partial", ".r.1234567.partial", ".r.12345_.partial"];
        let others = [".r2.abcdef.partial", ".r.x.abcdef.partial"];
        for name in [".r.abcdef.partial", ".r.ABCDEF.partial"].iter().chain(&stays).chain(&others) {
            fs::create_dir_all(home.path().join(name).join("maps")).unwrap();
        }
        fs::write(home.path().join(".r.123456.partial"), "a file").unwrap();
        std::os::unix::fs::symlink("r", home.path().join(".r.linked.partial")).unwrap();
        let used = TemporaryFolder::new(home.path(), "r".as_ref()).unwrap();
        let second = TemporaryFolder::new(home.path(), "r".as_ref()).unwrap();
        assert!(used.path().exists() && second.path().exists(), "temporaries in use stay");
        drop((used, second));
        let mut left: Vec<&str> = stays.iter().chain(&others).copied().chain([".r.linked.partial"]).collect();
        left.sort_unstable();
        assert_eq!(names(home.path()), left);
        sweep_all(home.path());
        left.retain(|name| !others.contains(name));
        assert_eq!(names(home.path()), left);
    }

    #[test]
    fn long_names_and_many_at_once_have_temporaries_too() {
        let home = tempfile::tempdir().unwrap();
        let name = "é".repeat(125);
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    for _ in 0..20 {
                        let folder = TemporaryFolder::new(home.path(), name.as_ref()).unwrap();
                        fs::write(folder.path().join("x"), "1").unwrap();
                        assert!(file(home.path(), name.as_ref()).unwrap().path().exists());
                        assert!(folder.path().join("x").exists(), "another one swept it");
                    }
                });
            }
        });
        assert_eq!(names(home.path()), Vec::<String>::new());
    }
}

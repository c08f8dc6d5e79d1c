//! Atomic writing of single files.

use std::fs::{self, File, Metadata, Permissions};
use std::io;
use std::path::{Path, PathBuf};

use tempfile::NamedTempFile;

use crate::{Error, Result, input, temporary};
use serde::Serialize;

/// Plain data with string keys as the text of a JSON file.
pub fn json(data: &impl Serialize) -> String {
    // Serialising such data cannot fail.
    serde_json::to_string_pretty(data).unwrap_or_default() + "\n"
}

/// Replaces a file atomically, even if power fails: writes a temporary file beside it ([`crate::temporary`]), syncs it
/// and renames it. A new file has ordinary permissions; a replaced file keeps its permissions. Links are followed.
///
/// # Errors
/// As [`writable`]; `Error::Output` if the system refuses. An existing file is then unchanged.
pub fn write_whole(path: &Path, bytes: &[u8]) -> Result<()> {
    let write = |file: &Path| fs::write(file, bytes).map_err(|error| Error::output(path, error));
    write_whole_with(path, write)
}

/// As [`write_whole`], with contents written by `write` to the path that it receives.
///
/// # Errors
/// As [`write_whole`], and those of `write`.
pub fn write_whole_with(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    writable(path)?;
    rewrite(path, write)
}

/// As [`write_whole_with`], for a file that a command reads and rewrites.
///
/// # Errors
/// `Error::Input` for special files; `Error::Output` if the system refuses; those of `write`.
pub fn rewrite(path: &Path, write: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    let failed = |error: io::Error| Error::output(path, error);
    let old = fs::metadata(path).ok();
    old.as_ref().map_or(Ok(()), |old| regular(path, old))?;
    let (file, target) = beside(path, old.is_some()).map_err(failed)?;
    write(file.path())?;
    let written = file.as_file().metadata().map_err(failed)?;
    place(file, &target, old.map(|old| old.permissions())).map_err(failed)?;
    input::forget(&written);
    Ok(())
}

/// Checks that a file may be written at this path: nothing exists there, or a regular file that is no input of this
/// process under any of its names.
///
/// # Errors
/// `Error::Input` for folders, devices and pipes, and for an input of this process.
pub fn writable(path: &Path) -> Result<()> {
    let Ok(found) = fs::metadata(path) else { return Ok(()) };
    regular(path, &found)?;
    if input::is_input(&found) {
        return Err(Error::file(path, "is an input of this command, which it would destroy", "choose another --out"));
    }
    Ok(())
}

fn regular(path: &Path, found: &Metadata) -> Result<()> {
    let refused = |kind| Error::file(path, format!("is a {kind}, not a regular file"), "choose another --out");
    input::kind(found).map_or(Ok(()), |kind| Err(refused(kind)))
}

/// Checks that outputs can be written: rejects existing files unless `overwrite` is set, paths that are not
/// [`writable`], missing folders, and the same file for two outputs.
///
/// # Errors
/// `Error::Input` for the first of them.
pub fn vacant(paths: &[PathBuf], overwrite: bool) -> Result<()> {
    for (k, path) in paths.iter().enumerate() {
        if paths[..k].contains(path) {
            return Err(Error::file(path, "would be written twice", "give --out the ending that the help shows"));
        }
        writable(path)?;
        if path.exists() && !overwrite {
            return Err(Error::file(path, "is already there", "choose another --out or add --force"));
        }
        let folder = path.parent().filter(|p| !p.as_os_str().is_empty());
        if let Some(folder) = folder.filter(|f| !f.is_dir()) {
            return Err(Error::file(folder, "is no folder", "make it first, or choose another --out"));
        }
    }
    Ok(())
}

/// Empty temporary file in the folder of `path`, and the path to rename it to.
fn beside(path: &Path, exists: bool) -> io::Result<(NamedTempFile, PathBuf)> {
    let target = if exists { path.canonicalize()? } else { std::path::absolute(path)? };
    let parts = target.parent().zip(target.file_name());
    let (folder, name) = parts.ok_or(io::ErrorKind::InvalidInput)?;
    Ok((temporary::file(folder, name)?, target))
}

fn place(file: NamedTempFile, target: &Path, permissions: Option<Permissions>) -> io::Result<()> {
    if let Some(permissions) = permissions {
        file.as_file().set_permissions(permissions)?;
    }
    file.as_file().sync_all()?;
    file.persist(target)?;
    File::open(target.parent().ok_or(io::ErrorKind::InvalidInput)?)?.sync_all()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt;

    fn mode(path: &Path) -> u32 {
        fs::metadata(path).unwrap().permissions().mode() & 0o777
    }

    fn count(folder: &Path) -> usize {
        fs::read_dir(folder).unwrap().count()
    }

    #[test]
    fn a_new_file_is_readable_as_any_new_file() {
        let home = tempfile::tempdir().unwrap();
        let [ours, ordinary] = ["ours", "ordinary"].map(|name| home.path().join(name));
        File::create(&ordinary).unwrap();
        write_whole(&ours, b"1").unwrap();
        assert_eq!(fs::read(&ours).unwrap(), b"1");
        assert_eq!(mode(&ours), mode(&ordinary));
    }

    #[test]
    fn a_replaced_file_keeps_its_permissions_and_the_links_to_it() {
        let home = tempfile::tempdir().unwrap();
        let [file, link] = ["file", "link"].map(|name| home.path().join(name));
        fs::write(&file, b"old").unwrap();
        fs::set_permissions(&file, Permissions::from_mode(0o640)).unwrap();
        std::os::unix::fs::symlink("file", &link).unwrap();
        write_whole(&link, b"new").unwrap();
        assert_eq!(fs::read(&file).unwrap(), b"new");
        assert_eq!(mode(&file), 0o640);
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(count(home.path()), 2);
    }

    #[test]
    fn what_fails_leaves_nothing_behind() {
        let home = tempfile::tempdir().unwrap();
        let folder = home.path().join("folder");
        fs::create_dir(&folder).unwrap();
        for path in [folder.clone(), home.path().join("no/such"), home.path().join("x".repeat(300))] {
            let error = write_whole(&path, b"1").unwrap_err().to_string();
            assert!(error.contains(&path.display().to_string()), "{error}");
        }
        assert_eq!((count(home.path()), count(&folder)), (1, 0));
    }
}

//! Atomic creation of an output folder.

use std::fs::{self, File};
use std::io::{self, ErrorKind};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

use serde::Serialize;

use crate::temporary::{TemporaryFolder, sweep};
use crate::{Error, Result, Version, writable};

/// Results are collected in a hidden folder beside the final one (or inside, if they are on different file systems) and
/// moved into place by [`OutputFolder::commit`]. Dropping it without commit removes everything. Remains of a killed
/// process are removed by the next one with the same output folder.
#[derive(Debug)]
pub struct OutputFolder {
    out: PathBuf,
    overwrite: bool,
    /// `None` once committed.
    temporary: Option<TemporaryFolder>,
    /// True if files are moved individually rather than the folder as a whole, because the folder is in use or is a
    /// mount point.
    piecewise: bool,
    /// Newly created parents of `out`, outermost first.
    made: Vec<PathBuf>,
}

impl OutputFolder {
    /// Prepares the output folder `out`, which becomes visible with [`OutputFolder::commit`]. With `overwrite`, files
    /// of the same names in an existing folder are replaced, and others are kept.
    ///
    /// # Errors
    /// `Error::Input` if `out` is a file, or a non-empty folder without `overwrite`; `Error::Output` if the system
    /// refuses.
    pub fn begin(out: &Path, overwrite: bool) -> Result<Self> {
        let refused = |error| Error::output(out, error);
        let exists = out.try_exists().map_err(refused)?;
        if exists && !out.is_dir() {
            return Err(Error::file(out, "exists and is not a folder", "choose another --out"));
        }
        if exists && !overwrite && !is_empty(out).map_err(refused)? {
            return Err(not_empty(out));
        }
        let mut folder =
            Self { out: out.to_path_buf(), overwrite, temporary: None, piecewise: false, made: Vec::new() };
        if exists { folder.beside_existing() } else { folder.beside_missing() }.map_err(refused)?;
        Ok(folder)
    }

    fn beside_missing(&mut self) -> io::Result<()> {
        self.out = std::path::absolute(&self.out)?;
        let name = self.out.file_name().ok_or(ErrorKind::InvalidInput)?.to_os_string();
        let parent = self.out.parent().ok_or(ErrorKind::InvalidInput)?.to_path_buf();
        let missing: Vec<PathBuf> = parent.ancestors().take_while(|p| !p.exists()).map(Path::to_path_buf).collect();
        for folder in missing.into_iter().rev() {
            fs::create_dir(&folder)?;
            self.made.push(folder);
        }
        self.temporary = Some(TemporaryFolder::new(&parent, &name)?);
        Ok(())
    }

    fn beside_existing(&mut self) -> io::Result<()> {
        self.out = self.out.canonicalize()?;
        let name = self.out.file_name().unwrap_or_default().to_os_string();
        // A killed process may have left its temporary folder inside.
        sweep(&self.out, &name);
        let own_device = fs::metadata(&self.out)?.dev();
        let parent = self.out.parent().filter(|p| fs::metadata(p).is_ok_and(|m| m.dev() == own_device));
        let beside = parent.and_then(|parent| TemporaryFolder::new(parent, &name).ok());
        let in_use = std::env::current_dir().and_then(|d| d.canonicalize()).is_ok_and(|d| d == self.out);
        self.piecewise = in_use || beside.is_none() || !is_empty(&self.out)?;
        self.temporary = Some(match beside {
            Some(folder) => folder,
            None => TemporaryFolder::new(&self.out, &name)?,
        });
        Ok(())
    }

    /// Path of the file `name`, a relative path, before commit. Subfolders must have been created with
    /// [`OutputFolder::create_dir`].
    pub fn path(&self, name: &str) -> PathBuf {
        self.temporary.as_ref().map_or(self.out.as_path(), TemporaryFolder::path).join(name)
    }

    /// Creates the subfolder `name` and its parents; it may already exist.
    ///
    /// # Errors
    /// `Error::Output` if the system refuses.
    pub fn create_dir(&self, name: &str) -> Result<()> {
        fs::create_dir_all(self.path(name)).map_err(|error| self.failed(name, error))
    }

    /// Writes the file `name`.
    ///
    /// # Errors
    /// `Error::Output` if the system refuses.
    pub fn write(&self, name: &str, bytes: &[u8]) -> Result<()> {
        fs::write(self.path(name), bytes).map_err(|error| self.failed(name, error))
    }

    /// Writes plain data as the JSON file `name`.
    ///
    /// # Errors
    /// `Error::Output` if the system refuses.
    pub fn write_json(&self, name: &str, data: &impl Serialize) -> Result<()> {
        self.write(name, crate::json(data).as_bytes())
    }

    /// Writes a report as `report.json`, with the version of its format.
    ///
    /// # Errors
    /// `Error::Output` if the system refuses.
    pub fn write_report(&self, report: &impl Serialize) -> Result<()> {
        #[derive(Serialize)]
        struct Versioned<'a, R> {
            version: Version<1>,
            #[serde(flatten)]
            report: &'a R,
        }
        self.write_json("report.json", &Versioned { version: Version, report })
    }

    /// Syncs the complete file `name` to the disk. [`OutputFolder::commit`] syncs all files; an early sync shortens its
    /// wait.
    ///
    /// # Errors
    /// `Error::Output` if the system refuses.
    pub fn sync(&self, name: &str) -> Result<()> {
        sync_one(&self.path(name)).map_err(|error| self.failed(name, error))
    }

    /// Reports an error under the final name of the file.
    fn failed(&self, name: &str, error: io::Error) -> Error {
        Error::output(&self.out.join(name), error)
    }

    /// Syncs everything to the disk and moves it into place: atomically if `out` does not exist or is empty, otherwise
    /// file by file (each file atomically).
    ///
    /// # Errors
    /// `Error::Output` if the system refuses. `Error::Input` if another process has filled `out` meanwhile, and if a
    /// file would replace an input of this process or a special file.
    pub fn commit(mut self) -> Result<()> {
        let Some(temporary) = self.temporary.take() else { return Ok(()) };
        if self.piecewise {
            may_be_replaced(temporary.path(), &self.out)?;
        }
        let placed = sync(temporary.path()).and_then(|()| self.place(temporary.path()));
        match placed {
            Ok(()) => {
                if !self.piecewise {
                    // The folder has been moved, so its guard must not remove it.
                    _ = temporary.keep();
                }
                self.made.clear();
                Ok(())
            }
            Err(error) if matches!(error.kind(), ErrorKind::DirectoryNotEmpty | ErrorKind::AlreadyExists) => {
                Err(not_empty(&self.out))
            }
            Err(error) => Err(Error::output(&self.out, error)),
        }
    }

    fn place(&self, from: &Path) -> io::Result<()> {
        if self.piecewise {
            let others = fs::read_dir(&self.out)?.filter_map(|e| e.ok()).any(|entry| entry.path() != from);
            if others && !self.overwrite {
                return Err(ErrorKind::DirectoryNotEmpty.into());
            }
            return merge(from, &self.out);
        }
        fs::rename(from, &self.out)?;
        // Parents of all new folders, from the inside out.
        let parents = self.made.iter().rev().map(PathBuf::as_path).filter_map(Path::parent);
        self.out.parent().into_iter().chain(parents).try_for_each(sync_one)
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        drop(self.temporary.take());
        for folder in self.made.iter().rev() {
            // Removal fails if another process has added files, which must be kept.
            _ = fs::remove_dir(folder);
        }
    }
}

/// Removes the remains of a killed process for the output folder `out`.
pub fn sweep_unfinished(out: &Path) {
    let Some(name) = out.file_name() else { return };
    out.parent().into_iter().chain([out]).for_each(|place| sweep(place, name));
}

fn not_empty(out: &Path) -> Error {
    Error::file(out, "exists and is not empty", "choose another --out or add --force")
}

fn is_empty(folder: &Path) -> io::Result<bool> {
    Ok(fs::read_dir(folder)?.next().is_none())
}

/// Syncs every file and folder below `folder`, and `folder` itself.
fn sync(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_type()?.is_dir() { sync(&entry.path())? } else { sync_one(&entry.path())? }
    }
    sync_one(folder)
}

fn sync_one(path: &Path) -> io::Result<()> {
    File::open(path)?.sync_all()
}

/// Validates every file of `to` that will be replaced, before replacing any.
fn may_be_replaced(from: &Path, to: &Path) -> Result<()> {
    let failed = |error| Error::output(to, error);
    for entry in fs::read_dir(from).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let target = to.join(entry.file_name());
        if entry.file_type().map_err(failed)?.is_dir() {
            may_be_replaced(&entry.path(), &target)?
        } else {
            writable(&target)?
        }
    }
    Ok(())
}

/// Moves every file below `from` to the same relative path below `to`.
fn merge(from: &Path, to: &Path) -> io::Result<()> {
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        let target = to.join(entry.file_name());
        if entry.file_type()?.is_dir() {
            fs::create_dir(&target).or_else(|e| if target.is_dir() { Ok(()) } else { Err(e) })?;
            merge(&entry.path(), &target)?;
        } else {
            fs::rename(entry.path(), target)?;
        }
    }
    sync_one(to)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn listing(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> =
            fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }

    #[test]
    fn uncommitted_leaves_nothing() {
        let home = tempfile::tempdir().unwrap();
        let out = home.path().join("a/b/result");
        let folder = OutputFolder::begin(&out, false).unwrap();
        folder.create_dir("maps").unwrap();
        folder.write("maps/x.txt", b"1").unwrap();
        assert!(!out.exists());
        assert_eq!(listing(&home.path().join("a/b")).len(), 1);
        drop(folder);
        assert_eq!(listing(home.path()), Vec::<String>::new());
    }

    #[test]
    fn commit_makes_parents_and_ordinary_permissions() {
        let home = tempfile::tempdir().unwrap();
        let out = home.path().join("a/result");
        let folder = OutputFolder::begin(&out, false).unwrap();
        folder.create_dir("maps").unwrap();
        folder.write("maps/x.txt", b"1").unwrap();
        fs::write(folder.path("y.txt"), b"2").unwrap();
        folder.commit().unwrap();
        assert_eq!(listing(&home.path().join("a")), ["result"]);
        assert_eq!(listing(&out), ["maps", "y.txt"]);
        assert_eq!(fs::read(out.join("maps/x.txt")).unwrap(), b"1");
        let ordinary = home.path().join("ordinary");
        fs::create_dir(&ordinary).unwrap();
        assert_eq!(fs::metadata(&out).unwrap().mode(), fs::metadata(&ordinary).unwrap().mode());
    }

    #[test]
    fn empty_folder_is_filled_and_full_one_refused() {
        let home = tempfile::tempdir().unwrap();
        let out = home.path().join("result");
        fs::create_dir(&out).unwrap();
        let folder = OutputFolder::begin(&out, false).unwrap();
        folder.write("x", b"1").unwrap();
        folder.commit().unwrap();
        assert_eq!(listing(&out), ["x"]);

        let error = OutputFolder::begin(&out, false).unwrap_err().to_string();
        assert!(error.contains("result: exists and is not empty; choose another --out or add --force"), "{error}");
        let error = OutputFolder::begin(&out.join("x"), true).unwrap_err().to_string();
        assert!(error.contains("not a folder"), "{error}");
        assert_eq!(listing(home.path()), ["result"]);
    }

    #[test]
    fn overwrite_replaces_namesakes_only() {
        let home = tempfile::tempdir().unwrap();
        let out = home.path().join("result");
        fs::create_dir_all(out.join("maps")).unwrap();
        for name in ["x", "keep", "maps/x", "maps/keep"] {
            fs::write(out.join(name), b"old").unwrap();
        }
        let folder = OutputFolder::begin(&out, true).unwrap();
        folder.create_dir("maps").unwrap();
        folder.write("x", b"new").unwrap();
        folder.write("maps/x", b"new").unwrap();
        assert_eq!(fs::read(out.join("x")).unwrap(), b"old");
        folder.commit().unwrap();
        for (name, content) in [("x", "new"), ("keep", "old"), ("maps/x", "new"), ("maps/keep", "old")] {
            assert_eq!(fs::read_to_string(out.join(name)).unwrap(), content);
        }
        assert_eq!(listing(home.path()), ["result"]);
    }

    #[test]
    fn the_next_run_removes_what_a_killed_one_left() {
        let home = tempfile::tempdir().unwrap();
        let out = home.path().join("result");
        for existing in [false, true] {
            let left = [home.path(), out.as_path()].map(|parent| parent.join(".result.aBc123.partial/maps"));
            left.iter().take(1 + usize::from(existing)).for_each(|folder| fs::create_dir_all(folder).unwrap());
            let running = OutputFolder::begin(&out, true).unwrap();
            let folder = OutputFolder::begin(&out, true).unwrap();
            folder.write("x", b"1").unwrap();
            folder.commit().unwrap();
            assert!(running.path("").exists(), "a folder in use stays");
            drop(running);
            assert_eq!((listing(home.path()), listing(&out)), (vec!["result".into()], vec!["x".into()]));
        }
    }

    #[test]
    fn filled_by_another_meanwhile() {
        let home = tempfile::tempdir().unwrap();
        let out = home.path().join("result");
        let folder = OutputFolder::begin(&out, false).unwrap();
        folder.write("x", b"mine").unwrap();
        fs::create_dir(&out).unwrap();
        fs::write(out.join("x"), b"theirs").unwrap();
        let error = folder.commit().unwrap_err().to_string();
        assert!(error.contains("not empty"), "{error}");
        assert_eq!(fs::read(out.join("x")).unwrap(), b"theirs");
        assert_eq!(listing(home.path()), ["result"]);
    }

    #[test]
    fn folder_inside_when_the_parent_is_another_file_system() {
        let Ok(mount) = tempfile::tempdir_in("/dev/shm") else {
            println!("skipped: no /dev/shm");
            return;
        };
        // Not itself a mount point; the variant with an inner folder is selected explicitly.
        let out = mount.path().canonicalize().unwrap();
        let inner = TemporaryFolder::new(&out, "x".as_ref()).unwrap();
        let folder = OutputFolder {
            out: out.clone(),
            overwrite: false,
            temporary: Some(inner),
            piecewise: true,
            made: Vec::new(),
        };
        folder.write("x", b"1").unwrap();
        folder.commit().unwrap();
        assert_eq!(listing(&out), ["x"]);
    }
}

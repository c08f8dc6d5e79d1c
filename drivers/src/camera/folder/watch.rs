//! New files in a folder, once they are complete.

use std::collections::{HashMap, HashSet};
use std::ffi::OsString;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Largest number of entries in the folder.
pub(super) const MAX_ENTRIES: usize = 50_000;
/// Time for which size and time of a file must not change before it is read.
const STABLE: Duration = Duration::from_millis(250);
/// Pause before a file that could not be read is read again, without a change.
const AGAIN: Duration = Duration::from_secs(2);
/// Largest number of new files that are watched at a time.
const MAX_WATCHED: usize = 1000;

/// Size and time of a file.
type Version = (u64, i64, i64);

/// Identity of a file: a renamed file is another one.
type Identity = (OsString, u64);

/// A new file.
struct Watched {
    version: Version,
    /// When this version was first seen.
    since: Duration,
    /// When it was last returned.
    tried: Option<Duration>,
}

/// Detects new files in a folder.
pub(super) struct Watch {
    folder: PathBuf,
    known: HashSet<Identity>,
    watched: HashMap<Identity, Watched>,
}

impl Watch {
    pub(super) fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), known: HashSet::new(), watched: HashMap::new() }
    }

    /// All files now in the folder are old.
    ///
    /// # Errors
    /// The system's error; `Other` for too many entries.
    pub(super) fn mark(&mut self) -> io::Result<()> {
        self.watched.clear();
        self.known = identities(&self.folder)?.into_iter().collect();
        Ok(())
    }

    /// A file will not be returned again.
    pub(super) fn done(&mut self, file: &Path) {
        let Some(name) = file.file_name() else { return };
        let of_name: Vec<Identity> = self.watched.keys().filter(|(n, _)| n == name).cloned().collect();
        for identity in of_name {
            self.watched.remove(&identity);
            self.known.insert(identity);
        }
    }

    /// New regular files that have not changed for a while, from the oldest. A file that was returned comes again only
    /// after a change or a pause.
    ///
    /// # Errors
    /// As [`Self::mark`].
    pub(super) fn complete(&mut self, now: Duration) -> io::Result<Vec<PathBuf>> {
        let present = identities(&self.folder)?;
        let fresh: Vec<Identity> = present.into_iter().filter(|i| !self.known.contains(i)).take(MAX_WATCHED).collect();
        let present: HashSet<&Identity> = fresh.iter().collect();
        self.watched.retain(|identity, _| present.contains(identity));
        let mut ready = vec![];
        for identity in &fresh {
            // Links are not followed. A file may disappear at any time.
            let Ok(found) = std::fs::symlink_metadata(self.folder.join(&identity.0)) else { continue };
            if !found.is_file() {
                continue;
            }
            let version = (found.len(), found.mtime(), found.mtime_nsec());
            let entry = Watched { version, since: now, tried: None };
            let watched = self.watched.entry(identity.clone()).or_insert(entry);
            if watched.version != version {
                *watched = Watched { version, since: now, tried: None };
            }
            let stable = now.saturating_sub(watched.since) >= STABLE && version.0 > 0;
            if stable && watched.tried.is_none_or(|at| now.saturating_sub(at) >= AGAIN) {
                watched.tried = Some(now);
                ready.push(((version.1, version.2), self.folder.join(&identity.0)));
            }
        }
        ready.sort();
        Ok(ready.into_iter().map(|(_, path)| path).collect())
    }
}

/// Regular files of a folder, from the newest.
pub(super) fn newest(folder: &Path, accept: impl Fn(&str) -> bool) -> io::Result<Vec<PathBuf>> {
    let mut files = vec![];
    for (name, _) in identities(folder)? {
        let path = folder.join(&name);
        let accepted = name.to_str().is_some_and(&accept);
        let found = std::fs::symlink_metadata(&path).ok().filter(|f| accepted && f.is_file() && f.len() > 0);
        files.extend(found.map(|f| ((f.mtime(), f.mtime_nsec()), path)));
    }
    files.sort();
    Ok(files.into_iter().rev().map(|(_, path)| path).collect())
}

fn identities(folder: &Path) -> io::Result<Vec<Identity>> {
    use std::os::unix::fs::DirEntryExt;
    let mut found = vec![];
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        if found.len() >= MAX_ENTRIES {
            return Err(io::Error::other(format!("more than {MAX_ENTRIES} files")));
        }
        found.push((entry.file_name(), entry.ino()));
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    #[test]
    fn files_are_returned_once_they_are_complete() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let ms = Duration::from_millis;
        fs::write(path("old.jpg"), "x").unwrap();
        let mut watch = Watch::new(folder.path());
        watch.mark().unwrap();
        fs::write(path("a.jpg"), "half").unwrap();
        fs::write(path("empty.jpg"), "").unwrap();
        fs::create_dir(path("folder.jpg")).unwrap();
        std::os::unix::fs::symlink("/dev/zero", path("link.jpg")).unwrap();
        assert!(watch.complete(ms(0)).unwrap().is_empty());
        fs::write(path("a.jpg"), "the whole").unwrap();
        assert!(watch.complete(ms(300)).unwrap().is_empty(), "it has grown");
        assert_eq!(watch.complete(ms(600)).unwrap(), [path("a.jpg")]);
        assert!(watch.complete(ms(700)).unwrap().is_empty(), "not again at once");
        assert_eq!(watch.complete(ms(2700)).unwrap(), [path("a.jpg")]);
        watch.done(&path("a.jpg"));
        // A temporary name becomes the final one.
        fs::write(path("b.part"), "b").unwrap();
        watch.complete(ms(3000)).unwrap();
        fs::rename(path("b.part"), path("b.jpg")).unwrap();
        watch.complete(ms(3100)).unwrap();
        assert_eq!(watch.complete(ms(3400)).unwrap(), [path("b.jpg")]);
        let newest = newest(folder.path(), |name| name.ends_with("jpg")).unwrap();
        assert_eq!(newest.len(), 3, "{newest:?}");
        watch.mark().unwrap();
        assert!(watch.complete(ms(9000)).unwrap().is_empty());
        assert!(Watch::new(&path("missing")).mark().is_err());
    }
}

//! Reading of untrusted files: only regular files are opened, up to a size limit.
//!
//! A command-line process records its inputs ([`remember`]), so that no output can replace one
//! ([`write_whole`](crate::write_whole)).

use std::collections::HashSet;
use std::fs::{File, Metadata, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Reason why a file cannot be read, as the predicate of a sentence about it.
#[derive(Debug, thiserror::Error)]
pub enum Unreadable {
    /// Error of the system.
    #[error("cannot be read: {0}")]
    System(io::Error),
    /// A folder, pipe, socket or device.
    #[error("is a {0}, not a regular file")]
    NotAFile(&'static str),
    /// The file exceeds the size limit.
    #[error("has more than the {most} bytes that are read")]
    TooLarge {
        /// Size limit in bytes.
        most: u64,
    },
}

impl From<Unreadable> for io::Error {
    fn from(error: Unreadable) -> Self {
        match error {
            Unreadable::System(error) => error,
            other => Self::new(io::ErrorKind::InvalidData, other),
        }
    }
}

/// Opens a regular file of at most `most` bytes for reading. Links are followed. The call never blocks, whatever the
/// path leads to.
///
/// # Errors
/// [`Unreadable`] for any other file.
pub fn open(path: &Path, most: u64) -> Result<File, Unreadable> {
    // Opening a pipe blocks until it has a writer, and opening a device may have side effects.
    regular(&std::fs::metadata(path).map_err(Unreadable::System)?)?;
    let flags = rustix::fs::OFlags::NONBLOCK.bits().cast_signed();
    let file = OpenOptions::new().read(true).custom_flags(flags).open(path).map_err(Unreadable::System)?;
    // The path may have been redirected meanwhile.
    let found = file.metadata().map_err(Unreadable::System)?;
    regular(&found)?;
    if found.len() > most {
        return Err(Unreadable::TooLarge { most });
    }
    add(&found);
    Ok(file)
}

/// Reads a regular file of at most `most` bytes, as [`open`].
///
/// # Errors
/// [`Unreadable`], also for a file that grows beyond `most` while it is read.
pub fn read(path: &Path, most: u64) -> Result<Vec<u8>, Unreadable> {
    let file = open(path, most)?;
    let mut bytes = Vec::new();
    let size = file.metadata().map_err(Unreadable::System)?.len().min(most);
    bytes.try_reserve(size as usize).map_err(|e| Unreadable::System(e.into()))?;
    file.take(most.saturating_add(1)).read_to_end(&mut bytes).map_err(Unreadable::System)?;
    if bytes.len() as u64 > most {
        return Err(Unreadable::TooLarge { most });
    }
    Ok(bytes)
}

fn regular(found: &Metadata) -> Result<(), Unreadable> {
    kind(found).map_or(Ok(()), |kind| Err(Unreadable::NotAFile(kind)))
}

/// Name of the kind of a special file; `None` for a regular file.
pub(crate) fn kind(found: &Metadata) -> Option<&'static str> {
    let kind = found.file_type();
    match () {
        () if kind.is_file() => None,
        () if kind.is_dir() => Some("folder"),
        () if kind.is_fifo() => Some("pipe"),
        () if kind.is_socket() => Some("socket"),
        () => Some("device"),
    }
}

/// Device and inode of this process's inputs, which identify a file under any of its names; `None` unless recording is
/// enabled.
static INPUTS: Mutex<Option<HashSet<(u64, u64)>>> = Mutex::new(None);

fn inputs<T>(work: impl FnOnce(&mut Option<HashSet<(u64, u64)>>) -> T) -> T {
    work(&mut INPUTS.lock().unwrap_or_else(PoisonError::into_inner))
}

fn add(found: &Metadata) {
    inputs(|inputs| inputs.as_mut().map(|inputs| inputs.insert((found.dev(), found.ino()))));
}

/// Enables the recording of inputs: the files among these paths, and every file opened by [`open`]. For a process that
/// runs one command; in a service, the record would grow without limit.
pub fn remember<P: AsRef<Path>>(paths: impl IntoIterator<Item = P>) {
    inputs(|inputs| _ = inputs.get_or_insert_default());
    paths.into_iter().filter_map(|path| std::fs::metadata(path).ok()).filter(Metadata::is_file).for_each(|f| add(&f));
}

/// Removes a file written by this process from the record, because a new file may reuse the inode of a removed input.
pub(crate) fn forget(written: &Metadata) {
    inputs(|inputs| inputs.as_mut().map(|inputs| inputs.remove(&(written.dev(), written.ino()))));
}

/// True if a file is an input of this process.
pub(crate) fn is_input(found: &Metadata) -> bool {
    inputs(|inputs| inputs.as_ref().is_some_and(|inputs| inputs.contains(&(found.dev(), found.ino()))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_up_to_the_limit_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name);
        std::fs::write(path("file"), "twelve bytes").unwrap();
        std::os::unix::fs::symlink("file", path("link")).unwrap();
        rustix::fs::mknodat(rustix::fs::CWD, path("pipe"), rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
        let _socket = std::os::unix::net::UnixListener::bind(path("socket")).unwrap();
        std::os::unix::fs::symlink("/dev/zero", path("zeros")).unwrap();
        File::create(path("sparse")).unwrap().set_len(1 << 40).unwrap();
        for name in ["file", "link"] {
            assert_eq!(read(&path(name), 12).unwrap(), b"twelve bytes");
        }
        for (name, words) in [
            ("file", "more than the 11 bytes"),
            ("sparse", "more than the 11 bytes"),
            (".", "is a folder"),
            ("pipe", "is a pipe"),
            ("socket", "is a socket"),
            ("zeros", "is a device"),
            ("none", "cannot be read: No such file"),
        ] {
            let error = read(&path(name), 11).unwrap_err().to_string();
            assert!(error.contains(words), "{name}: {error}");
        }
    }
}

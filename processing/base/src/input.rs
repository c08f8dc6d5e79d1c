//! Files from outside: only regular files are opened, and read up to a limit.
//!
//! A command of the command line remembers its inputs ([`remember`]), so that no output replaces one
//! ([`write_whole`](crate::write_whole)).

use std::collections::HashSet;
use std::fs::{File, Metadata, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::{FileTypeExt, MetadataExt, OpenOptionsExt};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Why a file is not read, as the predicate of a sentence about it.
#[derive(Debug, thiserror::Error)]
pub enum Unreadable {
    /// The system refuses.
    #[error("cannot be read: {0}")]
    System(io::Error),
    /// A folder, pipe, socket or device.
    #[error("is a {0}, not a regular file")]
    NotAFile(&'static str),
    /// The file is larger than what is read.
    #[error("has more than the {most} bytes that are read")]
    TooLarge {
        /// Most bytes that are read.
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

/// Opens a regular file of at most `most` bytes for reading. Links are followed. The call never waits, whatever the path leads to.
///
/// # Errors
/// [`Unreadable`] for everything else.
pub fn open(path: &Path, most: u64) -> Result<File, Unreadable> {
    // Opening a pipe waits for its writer, and opening a device may have an effect.
    regular(&std::fs::metadata(path).map_err(Unreadable::System)?)?;
    let flags = rustix::fs::OFlags::NONBLOCK.bits().cast_signed();
    let file = OpenOptions::new().read(true).custom_flags(flags).open(path).map_err(Unreadable::System)?;
    // The path may lead elsewhere by now.
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
/// [`Unreadable`], also for a file that grows beyond `most` meanwhile.
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

/// The kind of what is no regular file.
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

/// Device and inode of the inputs of this process, by which a file is known under each of its names; None unless they are remembered.
static INPUTS: Mutex<Option<HashSet<(u64, u64)>>> = Mutex::new(None);

fn inputs<T>(work: impl FnOnce(&mut Option<HashSet<(u64, u64)>>) -> T) -> T {
    work(&mut INPUTS.lock().unwrap_or_else(PoisonError::into_inner))
}

fn add(found: &Metadata) {
    inputs(|inputs| inputs.as_mut().map(|inputs| inputs.insert((found.dev(), found.ino()))));
}

/// Remembers from now on which files are inputs of this process: those of these paths that are files, and every file that
/// [`open`] opens. For a process that runs one command; a service would remember them for ever.
pub fn remember<P: AsRef<Path>>(paths: impl IntoIterator<Item = P>) {
    inputs(|inputs| _ = inputs.get_or_insert_default());
    paths.into_iter().filter_map(|path| std::fs::metadata(path).ok()).filter(Metadata::is_file).for_each(|f| add(&f));
}

/// Forgets a file that this process wrote: the system gives the number of a removed input to a new file.
pub(crate) fn forget(written: &Metadata) {
    inputs(|inputs| inputs.as_mut().map(|inputs| inputs.remove(&(written.dev(), written.ino()))));
}

/// Whether a file is an input of this process.
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

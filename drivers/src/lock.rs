//! Exclusive access to a device: a lock file per stable device ID, which names its holder. All users of the machine
//! share the locks, since they share the devices.

use crate::{Class, DeviceError, DeviceResult};
use std::fs::{File, OpenOptions, Permissions, TryLockError};
use std::io::{ErrorKind, Read, Seek, Write};
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

/// Lock on a device until dropped. The system also releases it when the process is killed.
pub struct DeviceLock {
    /// The open file holds the lock.
    file: File,
    path: PathBuf,
}

impl DeviceLock {
    /// Locks the device `id`. `place` distinguishes devices of the same ID on different benches.
    ///
    /// # Errors
    /// `Setup` with the holder's name if another process holds the lock; `Setup` if locks cannot be created.
    pub fn take(id: &str, place: &str) -> DeviceResult<Self> {
        let folder = lock_folder();
        let path = folder.join(file_name(id, place));
        let cannot = |e: std::io::Error| {
            DeviceError::new(id, "lock the device", "a lock file", format!("{}: {e}", path.display()))
                .remedy("make the folder writable")
                .class(Class::Setup)
        };
        make_folder(&folder).map_err(cannot)?;
        loop {
            let mut file = open(&path).map_err(cannot)?;
            match file.try_lock() {
                Ok(()) => {}
                Err(TryLockError::WouldBlock) => return Err(taken(id, &holder(&mut file))),
                Err(TryLockError::Error(e)) => return Err(cannot(e)),
            }
            let lock = Self { file, path: path.clone() };
            // The previous holder may have removed the file between opening and locking.
            if lock.is_in_place() {
                lock.name_holder();
                return Ok(lock);
            }
        }
    }

    /// Whether the path still refers to the locked file.
    fn is_in_place(&self) -> bool {
        let [held, there] = [self.file.metadata(), std::fs::symlink_metadata(&self.path)];
        matches!((held, there), (Ok(held), Ok(there)) if (held.dev(), held.ino()) == (there.dev(), there.ino()))
    }

    /// A read-only file of another user is a valid lock, but cannot name its holder.
    fn name_holder(&self) {
        let mut file = &self.file;
        let _ =
            file.set_len(0).and_then(|()| file.rewind()).and_then(|()| write!(file, "process {}", std::process::id()));
    }

    /// Present holder of the device.
    pub fn holder(id: &str, place: &str) -> Option<String> {
        // Any user may create files in the folder. A pipe must not block the open.
        let flags = (rustix::fs::OFlags::NOFOLLOW | rustix::fs::OFlags::NONBLOCK).bits().cast_signed();
        let place = lock_folder().join(file_name(id, place));
        let mut file = OpenOptions::new().read(true).custom_flags(flags).open(place).ok()?;
        match file.try_lock() {
            Err(TryLockError::WouldBlock) => Some(holder(&mut file)),
            _ => None,
        }
    }
}

impl Drop for DeviceLock {
    /// Removes the file while it is still locked, so that no other process's lock is removed.
    fn drop(&mut self) {
        if self.is_in_place() {
            // A file of another user cannot be removed and stays.
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

fn holder(file: &mut File) -> String {
    let mut text = String::new();
    let read = file.rewind().and_then(|()| file.take(200).read_to_string(&mut text));
    if read.is_ok() && !text.is_empty() { text } else { "another process".into() }
}

fn taken(id: &str, holder: &str) -> DeviceError {
    DeviceError::new(id, "lock the device", "a free device", format!("one in use by {holder}"))
        .remedy("wait for that process or stop it")
        .class(Class::Setup)
}

/// Linux's folder for device locks. Environment variables are ignored, since they differ between users.
fn lock_folder() -> PathBuf {
    let locks = Path::new("/run/lock/nacre");
    // On some systems only root may write to it.
    if make_folder(locks).is_ok() { locks.into() } else { "/tmp/nacre-locks".into() }
}

/// Permissions as for /tmp: any user may add files, and nobody may remove those of others.
fn make_folder(folder: &Path) -> std::io::Result<()> {
    match std::fs::create_dir(folder) {
        Ok(()) => std::fs::set_permissions(folder, Permissions::from_mode(0o1777)),
        Err(e) if e.kind() == ErrorKind::AlreadyExists => Ok(()),
        Err(e) => Err(e),
    }
}

/// Opens a lock file, which another user may have created. The kernel refuses `O_CREAT` on another user's file in such
/// a folder, so creation is tried last. Symbolic links are not followed.
fn open(path: &Path) -> std::io::Result<File> {
    let plain = || {
        let mut options = OpenOptions::new();
        options.read(true).custom_flags(rustix::fs::OFlags::NOFOLLOW.bits().cast_signed());
        options
    };
    match plain().write(true).open(path) {
        Err(e) if e.kind() == ErrorKind::PermissionDenied => plain().open(path),
        Err(e) if e.kind() == ErrorKind::NotFound => {
            let made = plain().write(true).create_new(true).open(path);
            match made {
                Ok(file) => file.set_permissions(Permissions::from_mode(0o666)).map(|()| file),
                // Another process was first.
                Err(_) => plain().write(true).open(path),
            }
        }
        other => other,
    }
}

/// A readable and unique file name: characters other than letters and digits are written as their bytes.
fn file_name(id: &str, place: &str) -> PathBuf {
    let plain = |text: &str| -> String {
        text.bytes()
            .map(|b| if b.is_ascii_alphanumeric() { (b as char).to_string() } else { format!("-{b:x}") })
            .collect()
    };
    let name = if place.is_empty() { plain(id) } else { format!("{}@{}", plain(id), plain(place)) };
    // File systems limit names to 255 bytes.
    Path::new(&name[name.len().saturating_sub(200)..]).with_extension("lock")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_second_holder_is_refused_by_name_until_the_first_lets_go() {
        let place = format!("test {}", std::process::id());
        let first = DeviceLock::take("stage 7", &place).unwrap();
        let error = DeviceLock::take("stage 7", &place).err().unwrap();
        assert!(error.got.contains(&format!("process {}", std::process::id())), "{error}");
        assert!(DeviceLock::holder("stage 7", &place).is_some());
        assert!(DeviceLock::take("stage-7", &place).is_ok(), "another device");
        drop(first);
        assert!(DeviceLock::holder("stage 7", &place).is_none());
        DeviceLock::take("stage 7", &place).unwrap();
        assert!(!lock_folder().join(file_name("stage 7", &place)).exists(), "nothing is left behind");
    }
}

//! Serial port of an emulated device: a pseudo-terminal behind a named symbolic link.

use super::{Action, Emulator};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use std::io;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Interval in ns at which the device can send bytes unasked.
const TICK_NS: i64 = 2_000_000;

/// Time for which a dropped link is missing.
const AWAY: Duration = Duration::from_millis(300);

/// An emulated device on a serial port, until dropped.
pub struct Pty {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Pty {
    /// Runs a device on a new port. `link` becomes a symbolic link to it; an existing link of that name is replaced.
    ///
    /// # Errors
    /// The port or the link cannot be created.
    pub fn start(link: &Path, device: impl Emulator + 'static) -> io::Result<Self> {
        let mut line = Line::open(link)?;
        let stop = Arc::new(AtomicBool::new(false));
        let (stopped, mut device) = (stop.clone(), device);
        let run = move || {
            while !stopped.load(Ordering::Relaxed) {
                // The port is lost, so the thread ends. Opening the link fails from then on.
                if line.turn(&mut device).is_err() {
                    break;
                }
            }
        };
        let thread = std::thread::Builder::new().name("emulator".into()).spawn(run)?;
        Ok(Self { stop, thread: Some(thread) })
    }
}

impl Drop for Pty {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Both ends of a pseudo-terminal. The device's end stays open here, so that the terminal outlives its users.
struct Ends {
    host: OwnedFd,
    _device: OwnedFd,
}

/// A port and its link.
struct Line {
    link: PathBuf,
    ends: Option<Ends>,
}

impl Line {
    fn open(link: &Path) -> io::Result<Self> {
        let mut line = Self { link: link.to_path_buf(), ends: None };
        line.connect()?;
        Ok(line)
    }

    fn connect(&mut self) -> io::Result<()> {
        let host = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)?;
        unlockpt(&host)?;
        let name = ptsname(&host, Vec::new())?;
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
        let device = rustix::fs::open(&*name, flags, Mode::empty())?;
        let mut settings = tcgetattr(&device)?;
        settings.make_raw();
        tcsetattr(&device, OptionalActions::Now, &settings)?;
        rustix::io::ioctl_fionbio(&host, true)?;
        let target = name.to_str().map_err(|_| io::ErrorKind::InvalidData)?;
        self.unlink();
        std::os::unix::fs::symlink(target, &self.link)?;
        self.ends = Some(Ends { host, _device: device });
        Ok(())
    }

    /// Removes the link; a file of another kind stays.
    fn unlink(&self) {
        let link = std::fs::symlink_metadata(&self.link).is_ok_and(|found| found.is_symlink());
        if link {
            // It may have been removed already.
            let _ = std::fs::remove_file(&self.link);
        }
    }

    /// Waits up to one tick for bytes, passes them to the device, and executes the device's actions.
    fn turn(&mut self, device: &mut impl Emulator) -> io::Result<()> {
        let came = self.receive()?;
        let mut actions = if came.is_empty() { vec![] } else { device.receive(&came) };
        actions.extend(device.tick());
        for action in actions {
            match action {
                Action::Send(bytes) => self.send(&bytes),
                Action::Close => {
                    self.unlink();
                    self.ends = None;
                    std::thread::sleep(AWAY);
                    self.connect()?;
                    // Later actions are lost with the link.
                    break;
                }
            }
        }
        Ok(())
    }

    fn receive(&self) -> io::Result<Vec<u8>> {
        let Some(ends) = &self.ends else { return Ok(vec![]) };
        let tick = Timespec { tv_sec: 0, tv_nsec: TICK_NS };
        match poll(&mut [PollFd::new(&ends.host, PollFlags::IN)], Some(&tick)) {
            Ok(0) | Err(rustix::io::Errno::INTR) => return Ok(vec![]),
            Ok(_) => {}
            Err(e) => return Err(e.into()),
        }
        let mut bytes = vec![0; 1024];
        match rustix::io::read(&ends.host, &mut bytes) {
            Ok(count) => bytes.truncate(count),
            Err(rustix::io::Errno::AGAIN | rustix::io::Errno::INTR) => bytes.clear(),
            Err(e) => return Err(e.into()),
        }
        Ok(bytes)
    }

    /// Sends bytes; bytes that nobody reads are lost, as on a real line.
    fn send(&self, bytes: &[u8]) {
        if let Some(ends) = &self.ends {
            let _ = rustix::io::write(&ends.host, bytes);
        }
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        self.unlink();
    }
}

//! Emulated USB devices behind a Unix socket.
//!
//! A transfer is a frame: kind, tag, length (16 bits, little-endian), payload. It is answered by a frame: status, the
//! same tag, length, payload. The status is 0 (done), 1 (stalled) or 2 (the host would time out). After half an answer
//! the connection ends.

use super::fault::{ByteFault, ByteFaultKind, Strikes};
use std::io::{self, Read, Write};
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Longest payload in bytes.
const MAX_PAYLOAD: usize = 4096;

/// Most simultaneous connections.
const MAX_CONNECTIONS: usize = 16;

/// Delay of a slow answer.
const LATE: Duration = Duration::from_millis(150);

/// Status of a missing answer.
const NOTHING: u8 = 2;

/// A transfer between host and device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer<'a> {
    /// An output report.
    Output(&'a [u8]),
    /// A feature report for the device.
    SetFeature(&'a [u8]),
    /// Request for the feature report of this number.
    Feature(u8),
    /// Bytes to the device.
    BulkOut(&'a [u8]),
    /// Request for bytes from the device.
    BulkIn,
}

/// Outcome of a transfer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Done; the bytes are the device's data.
    Done(Vec<u8>),
    /// Refused.
    Stalled,
    /// No answer.
    Silent,
}

/// An emulated USB device.
pub trait Peripheral: Send {
    /// Executes a transfer.
    ///
    /// The device itself implements the faults `WrongStatus`, `StuckBusy` and `Resend`; the connection implements the
    /// others.
    fn transfer(&mut self, transfer: Transfer<'_>, fault: Option<ByteFaultKind>) -> Outcome;

    /// Resets the device to its state after power-up.
    fn reset(&mut self);

    /// Called periodically, for actions of the device without a transfer.
    fn tick(&mut self) {}
}

/// A device served on a socket, until dropped.
pub struct Served {
    path: PathBuf,
    /// Device and inode number of the socket, so that no other file is removed in its place.
    inode: (u64, u64),
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Served {
    /// Serves a device on a socket.
    ///
    /// # Errors
    /// The socket cannot be created, for example because a file of that name exists; the file stays unchanged.
    pub fn start(path: &Path, device: Box<dyn Peripheral>, faults: Vec<ByteFault>) -> io::Result<Self> {
        remove_stale(path);
        let listener = UnixListener::bind(path)?;
        listener.set_nonblocking(true)?;
        let inode = std::fs::symlink_metadata(path).map(|found| (found.dev(), found.ino()))?;
        let stop = Arc::new(AtomicBool::new(false));
        let mut server = Server { listener, device, strikes: Strikes::new(faults), connections: vec![] };
        let stopped = stop.clone();
        let serve = move || {
            while !stopped.load(Ordering::Relaxed) {
                server.turn();
                std::thread::sleep(Duration::from_millis(1));
            }
        };
        let thread = std::thread::Builder::new().name("emulated device".into()).spawn(serve)?;
        Ok(Self { path: path.into(), inode, stop, thread: Some(thread) })
    }

    /// Device path for a driver.
    pub fn path(&self) -> String {
        format!("unix:{}", self.path.display())
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic of the device has already been reported.
            let _ = thread.join();
        }
        if std::fs::symlink_metadata(&self.path).is_ok_and(|found| (found.dev(), found.ino()) == self.inode) {
            // The file may have been removed already.
            let _ = std::fs::remove_file(&self.path);
        }
    }
}

/// Removes a socket without a listener. Other files and link targets are kept.
fn remove_stale(path: &Path) {
    let is_socket = std::fs::symlink_metadata(path).is_ok_and(|found| found.file_type().is_socket());
    if is_socket && UnixStream::connect(path).is_err() {
        // If this fails, binding reports it.
        let _ = std::fs::remove_file(path);
    }
}

struct Server {
    listener: UnixListener,
    device: Box<dyn Peripheral>,
    strikes: Strikes,
    connections: Vec<Connection>,
}

struct Connection {
    stream: UnixStream,
    received: Vec<u8>,
}

struct Answer {
    bytes: Vec<u8>,
    /// The connection ends after this answer.
    last: bool,
}

impl Server {
    /// Accepts connections, serves each one, and ticks the device; does not block.
    fn turn(&mut self) {
        while let Ok((stream, _)) = self.listener.accept() {
            if self.connections.len() < MAX_CONNECTIONS && stream.set_nonblocking(true).is_ok() {
                self.connections.push(Connection { stream, received: vec![] });
            }
        }
        let connections = std::mem::take(&mut self.connections);
        self.connections = connections.into_iter().filter_map(|c| self.serve(c)).collect();
        self.device.tick();
    }

    /// Answers the received transfers; `None` when the connection has ended.
    fn serve(&mut self, mut connection: Connection) -> Option<Connection> {
        let mut bytes = [0; MAX_PAYLOAD];
        match connection.stream.read(&mut bytes) {
            Ok(0) => return None,
            Ok(n) => connection.received.extend(&bytes[..n]),
            Err(e) if matches!(e.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => {}
            Err(_) => return None,
        }
        while let Some((&[kind, tag, low, high], rest)) = connection.received.split_first_chunk() {
            let length = usize::from(low) | usize::from(high) << 8;
            if length > MAX_PAYLOAD {
                return None;
            }
            let Some(payload) = rest.get(..length) else { break };
            let answer = self.answer(kind, tag, payload)?;
            connection.stream.write_all(&answer.bytes).ok()?;
            if answer.last {
                return None;
            }
            connection.received.drain(..4 + length);
        }
        Some(connection)
    }

    /// Answer to a transfer; `None` when the connection is lost.
    fn answer(&mut self, kind: u8, tag: u8, payload: &[u8]) -> Option<Answer> {
        let fault = self.strikes.strike();
        let whole = |bytes: Vec<u8>| Answer { bytes, last: false };
        match fault {
            Some(ByteFaultKind::NoAnswer) => return Some(whole(vec![NOTHING, tag, 0, 0])),
            Some(ByteFaultKind::Dropped) => return None,
            Some(ByteFaultKind::Reset) => {
                self.device.reset();
                // The reset has erased the data sent before, so a transfer to the device counts as done without
                // effect.
                if !matches!(kind, 3 | 5) {
                    return Some(whole(vec![0, tag, 0, 0]));
                }
            }
            Some(ByteFaultKind::Slow) => std::thread::sleep(LATE),
            _ => {}
        }
        let outcome = match (kind, payload) {
            (1, report) => self.device.transfer(Transfer::Output(report), fault),
            (2, report) => self.device.transfer(Transfer::SetFeature(report), fault),
            (3, [id, ..]) => self.device.transfer(Transfer::Feature(*id), fault),
            (4, bytes) => self.device.transfer(Transfer::BulkOut(bytes), fault),
            (5, _) => self.device.transfer(Transfer::BulkIn, fault),
            _ => Outcome::Stalled,
        };
        let (status, mut bytes) = match outcome {
            Outcome::Done(bytes) => (0, bytes),
            Outcome::Stalled => (1, vec![]),
            Outcome::Silent => return Some(whole(vec![NOTHING, tag, 0, 0])),
        };
        if fault == Some(ByteFaultKind::Garbage) {
            bytes.iter_mut().for_each(|b| *b = !*b);
        }
        let mut frame = vec![status, tag, bytes.len() as u8, (bytes.len() >> 8) as u8];
        frame.extend(bytes);
        match fault {
            Some(ByteFaultKind::HalfAnswer) => frame.truncate(frame.len() / 2),
            Some(ByteFaultKind::Resend) => frame.extend(frame.clone()),
            _ => {}
        }
        Some(Answer { bytes: frame, last: fault == Some(ByteFaultKind::HalfAnswer) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Nothing;

    impl Peripheral for Nothing {
        fn transfer(&mut self, _: Transfer<'_>, _: Option<ByteFaultKind>) -> Outcome {
            Outcome::Stalled
        }

        fn reset(&mut self) {}
    }

    #[test]
    fn only_stale_sockets_are_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let [file, link, socket] = ["file", "link", "socket"].map(|name| folder.path().join(name));
        std::fs::write(&file, "precious").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        for taken in [&file, &link] {
            assert!(Served::start(taken, Box::new(Nothing), vec![]).is_err());
        }
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "precious");
        drop(UnixListener::bind(&socket).unwrap());
        let served = Served::start(&socket, Box::new(Nothing), vec![]).unwrap();
        assert!(Served::start(&socket, Box::new(Nothing), vec![]).is_err(), "somebody listens");
        drop(served);
        assert!(!socket.exists());
    }

    #[test]
    fn nonsense_ends_a_connection_only() {
        let folder = tempfile::tempdir().unwrap();
        let served = Served::start(&folder.path().join("socket"), Box::new(Nothing), vec![]).unwrap();
        let mut one = UnixStream::connect(&served.path).unwrap();
        one.write_all(&[0xff; 64]).unwrap();
        assert_eq!(one.read(&mut [0; 8]).unwrap_or(0), 0);
        let mut other = UnixStream::connect(&served.path).unwrap();
        other.write_all(&[9, 7, 0, 0, 3, 8, 0, 0]).unwrap();
        let mut answers = [0; 8];
        other.read_exact(&mut answers).unwrap();
        assert_eq!(answers, [1, 7, 0, 0, 1, 8, 0, 0], "unknown kinds and empty questions are refused");
    }
}

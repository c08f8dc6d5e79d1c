//! Transport for emulated USB devices: a Unix socket in place of a device node, given as `unix:/path`.
//!
//! Each transfer is a request frame followed by an answer frame.
//!
//! Byte 0 of a request is its kind:
//! - 1: output report
//! - 2: set a feature report
//! - 3: get a feature report (payload: its ID, then the number of bytes, 16 bits)
//! - 4: bulk out
//! - 5: bulk in (payload: the number of bytes, 16 bits)
//!
//! Byte 0 of an answer is its status: 0 done, 1 refused (a stalled transfer), 2 timeout. The other bytes of both frames
//! are:
//! - byte 1: a tag, which the answer repeats; answers with other tags are dropped
//! - bytes 2-3: length of the payload, 16 bits, at most 4096
//! - bytes 4…: payload
//!
//! Numbers are little endian. The emulated device reports a timeout explicitly, and closes the link after an incomplete
//! answer, so that results do not depend on timing. As on USB, transfers are independent: after an error, the next one
//! reconnects.

use crate::{Class, DeviceError};
use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Prefix of an emulated device's path.
pub const PREFIX: &str = "unix:";

/// Maximum payload in bytes.
pub const MAX_PAYLOAD: usize = 4096;

/// Time limit of a transfer, after which the other end counts as hung.
const TIMEOUT: Duration = Duration::from_secs(60);

/// Answer status: timeout.
const STATUS_TIMEOUT: u8 = 2;

/// Kind of a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Transfer {
    Output = 1,
    SetFeature = 2,
    Feature = 3,
    BulkOut = 4,
    BulkIn = 5,
}

/// Connection to an emulated device.
pub(crate) struct SocketTransport {
    path: PathBuf,
    stream: Option<UnixStream>,
    tag: u8,
    timeout: Duration,
}

impl SocketTransport {
    /// Opens the connection.
    pub fn open(path: &Path) -> io::Result<Self> {
        let stream = Some(connect(path)?);
        Ok(Self { path: path.into(), stream, tag: 0, timeout: TIMEOUT })
    }

    /// Executes a transfer; returns the answer's payload.
    pub fn transfer(&mut self, kind: Transfer, payload: &[u8]) -> io::Result<Vec<u8>> {
        let mut stream = match self.stream.take() {
            Some(stream) => stream,
            None => connect(&self.path)?,
        };
        self.tag = self.tag.wrapping_add(1);
        let answer = exchange(&mut stream, kind, self.tag, payload, self.timeout)?;
        self.stream = Some(stream);
        answer.ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "a stalled transfer"))
    }
}

fn connect(path: &Path) -> io::Result<UnixStream> {
    let stream = UnixStream::connect(path)?;
    stream.set_write_timeout(Some(TIMEOUT))?;
    Ok(stream)
}

/// Payload of the answer; `None` if the device refuses.
fn exchange(
    stream: &mut UnixStream,
    kind: Transfer,
    tag: u8,
    payload: &[u8],
    timeout: Duration,
) -> io::Result<Option<Vec<u8>>> {
    let length = u16::try_from(payload.len()).ok().filter(|n| usize::from(*n) <= MAX_PAYLOAD);
    let [low, high] = length.ok_or(io::ErrorKind::InvalidInput)?.to_le_bytes();
    let mut frame = vec![kind as u8, tag, low, high];
    frame.extend(payload);
    stream.write_all(&frame)?;
    let until = Instant::now() + timeout;
    loop {
        let mut head = [0; 4];
        read(stream, &mut head[..1], until)?;
        let half =
            |e: io::Error| if e.kind() == io::ErrorKind::UnexpectedEof { io::ErrorKind::TimedOut.into() } else { e };
        read(stream, &mut head[1..], until).map_err(half)?;
        let length = usize::from(u16::from_le_bytes([head[2], head[3]]));
        if length > MAX_PAYLOAD || head[0] > STATUS_TIMEOUT {
            return Err(io::Error::new(io::ErrorKind::InvalidData, "bytes that are no frame"));
        }
        let mut answer = vec![0; length];
        read(stream, &mut answer, until).map_err(half)?;
        if head[1] == tag {
            if head[0] == STATUS_TIMEOUT {
                return Err(io::ErrorKind::TimedOut.into());
            }
            return Ok((head[0] == 0).then_some(answer));
        }
    }
}

/// Fills the buffer until a deadline, with as many reads as needed.
fn read(stream: &mut UnixStream, mut buffer: &mut [u8], until: Instant) -> io::Result<()> {
    while !buffer.is_empty() {
        let left = until.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(io::ErrorKind::TimedOut.into());
        }
        stream.set_read_timeout(Some(left.max(Duration::from_millis(1))))?;
        match stream.read(buffer) {
            Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
            Ok(n) => buffer = &mut buffer[n..],
            Err(e) if matches!(e.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => {}
            Err(e) => return Err(e),
        }
    }
    Ok(())
}

/// Converts a failed transfer into a device error. A refused transfer may be repeated; after other errors the link
/// counts as lost.
pub(crate) fn failed(device: &str, command: &str, error: &io::Error) -> DeviceError {
    let (got, class) = match error.kind() {
        io::ErrorKind::InvalidInput => ("a refusal".into(), Class::Retry),
        io::ErrorKind::TimedOut | io::ErrorKind::WouldBlock => ("nothing in time".into(), Class::Lost),
        _ => (format!("a lost link ({error})"), Class::Lost),
    };
    DeviceError::new(device, command, "an answer", got)
        .remedy("check that it is plugged in, then resume the session")
        .class(class)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::os::unix::net::UnixListener;

    /// Result of a transfer whose answer consists of arbitrary bytes, followed by a disconnection.
    fn answered(bytes: &[u8]) -> io::Result<Vec<u8>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("socket");
        let listener = UnixListener::bind(&path)?;
        let mut transport = SocketTransport::open(&path)?;
        let (mut other, _) = listener.accept()?;
        other.write_all(bytes)?;
        other.shutdown(std::net::Shutdown::Write)?;
        transport.transfer(Transfer::Feature, &[1, 8, 0])
    }

    #[test]
    fn late_answers_are_passed_over() {
        assert_eq!(answered(&[0, 200, 1, 0, 9, 0, 1, 2, 0, 5, 6]).unwrap(), [5, 6]);
        assert_eq!(answered(&[1, 1, 0, 0]).unwrap_err().kind(), io::ErrorKind::InvalidInput);
        assert_eq!(answered(&[]).unwrap_err().kind(), io::ErrorKind::UnexpectedEof);
        for half in [&[0, 1, 2, 0, 5][..], &[0, 1]] {
            assert_eq!(answered(half).unwrap_err().kind(), io::ErrorKind::TimedOut);
        }
        assert_eq!(answered(&[2, 1, 0, 0]).unwrap_err().kind(), io::ErrorKind::TimedOut);
        assert_eq!(answered(&[7, 1, 0, 0]).unwrap_err().kind(), io::ErrorKind::InvalidData);
    }

    #[test]
    fn a_silent_device_times_out() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("socket");
        let _listener = UnixListener::bind(&path).unwrap();
        let mut transport =
            SocketTransport { timeout: Duration::from_millis(10), ..SocketTransport::open(&path).unwrap() };
        assert_eq!(transport.transfer(Transfer::Output, &[0]).unwrap_err().kind(), io::ErrorKind::TimedOut);
        let long = vec![0; MAX_PAYLOAD + 1];
        assert!(transport.transfer(Transfer::Output, &long).is_err(), "too long");
    }

    proptest! {
        #[test]
        fn any_answer_is_read(bytes in proptest::collection::vec(any::<u8>(), 0..40)) {
            let _ = answered(&bytes);
        }
    }
}

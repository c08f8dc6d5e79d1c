//! The seam where emulated USB devices attach: a Unix socket in place of a device node, given as `unix:/path`.
//!
//! Each transfer is one frame, and is answered by one:
//!
//! | byte | request | answer |
//! |---|---|---|
//! | 0 | 1 output report, 2 set a feature report, 3 get one (payload: its id, then how many bytes are wanted, 16 bits), 4 bulk out, 5 bulk in (payload: how many bytes are wanted, 16 bits) | 0 done, 1 refused (a stalled transfer), 2 nothing came in time |
//! | 1 | a tag | the same tag; others are dropped |
//! | 2-3 | length of the payload, 16 bits, at most 4096 | the same |
//! | 4… | payload | payload |
//!
//! Numbers have their low byte first. The emulated device ends the wait of a transfer that it does not answer, and closes the link after
//! half an answer, so that how long anything takes does not decide how it ends. As on USB, no transfer remembers the one before: after an error, the next one
//! connects again.

use crate::{Class, DeviceError};
use std::io::{self, Read, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// What a path of an emulated device begins with.
pub const PREFIX: &str = "unix:";

/// Longest payload.
pub const MAX_PAYLOAD: usize = 4096;

/// A transfer has failed after this long without an answer: the other end hangs.
const SILENCE: Duration = Duration::from_secs(60);

/// An answer with this status says that nothing came in time.
const NOTHING: u8 = 2;

/// A transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Transfer {
    Output = 1,
    SetFeature = 2,
    Feature = 3,
    BulkOut = 4,
    BulkIn = 5,
}

/// A link to an emulated device.
pub(crate) struct Seam {
    path: PathBuf,
    stream: Option<UnixStream>,
    tag: u8,
    silence: Duration,
}

impl Seam {
    /// Connects.
    pub fn open(path: &Path) -> io::Result<Self> {
        let stream = Some(connect(path)?);
        Ok(Self { path: path.into(), stream, tag: 0, silence: SILENCE })
    }

    /// Carries a transfer out; returns the answer's payload.
    pub fn transfer(&mut self, kind: Transfer, payload: &[u8]) -> io::Result<Vec<u8>> {
        let mut stream = match self.stream.take() {
            Some(stream) => stream,
            None => connect(&self.path)?,
        };
        self.tag = self.tag.wrapping_add(1);
        let answer = exchange(&mut stream, kind, self.tag, payload, self.silence)?;
        self.stream = Some(stream);
        answer.ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "a stalled transfer"))
    }
}

fn connect(path: &Path) -> io::Result<UnixStream> {
    let stream = UnixStream::connect(path)?;
    stream.set_write_timeout(Some(SILENCE))?;
    Ok(stream)
}

/// The answer's payload; None if the device refuses.
fn exchange(
    stream: &mut UnixStream,
    kind: Transfer,
    tag: u8,
    payload: &[u8],
    silence: Duration,
) -> io::Result<Option<Vec<u8>>> {
    let length = u16::try_from(payload.len()).ok().filter(|n| usize::from(*n) <= MAX_PAYLOAD);
    let [low, high] = length.ok_or(io::ErrorKind::InvalidInput)?.to_le_bytes();
    let mut frame = vec![kind as u8, tag, low, high];
    frame.extend(payload);
    stream.write_all(&frame)?;
    let until = Instant::now() + silence;
    loop {
        let mut head = [0; 4];
        read(stream, &mut head[..1], until)?;
        let half =
            |e: io::Error| if e.kind() == io::ErrorKind::UnexpectedEof { io::ErrorKind::TimedOut.into() } else { e };
        read(stream, &mut head[1..], until).map_err(half)?;
        let length = usize::from(u16::from_le_bytes([head[2], head[3]]));
        if length > MAX_PAYLOAD || head[0] > NOTHING {
            return Err(io::Error::new(io::ErrorKind::InvalidData, "bytes that are no frame"));
        }
        let mut answer = vec![0; length];
        read(stream, &mut answer, until).map_err(half)?;
        if head[1] == tag {
            if head[0] == NOTHING {
                return Err(io::ErrorKind::TimedOut.into());
            }
            return Ok((head[0] == 0).then_some(answer));
        }
    }
}

/// Fills the buffer until a time, however the bytes trickle in.
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

/// A failed transfer as a device error: refused ones may work again, after others the link is not to be trusted.
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

    /// What a transfer makes of an answer of any bytes, after which the other end is gone.
    fn answered(bytes: &[u8]) -> io::Result<Vec<u8>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("socket");
        let listener = UnixListener::bind(&path)?;
        let mut seam = Seam::open(&path)?;
        let (mut other, _) = listener.accept()?;
        other.write_all(bytes)?;
        other.shutdown(std::net::Shutdown::Write)?;
        seam.transfer(Transfer::Feature, &[1, 8, 0])
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
    fn silence_ends() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("socket");
        let _listener = UnixListener::bind(&path).unwrap();
        let mut seam = Seam { silence: Duration::from_millis(10), ..Seam::open(&path).unwrap() };
        assert_eq!(seam.transfer(Transfer::Output, &[0]).unwrap_err().kind(), io::ErrorKind::TimedOut);
        let long = vec![0; MAX_PAYLOAD + 1];
        assert!(seam.transfer(Transfer::Output, &long).is_err(), "too long");
    }

    proptest! {
        #[test]
        fn any_answer_is_read(bytes in proptest::collection::vec(any::<u8>(), 0..40)) {
            let _ = answered(&bytes);
        }
    }
}

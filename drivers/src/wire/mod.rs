//! Byte streams to and from a device on a serial cable, and their division into lines.
//!
//! Timeouts here use the cable's clock, not the bench's.

#[cfg(test)]
pub(crate) mod replay;
mod serial;

pub use serial::SerialWire;

use crate::{Class, DeviceError, DeviceResult};
use std::collections::VecDeque;
use std::future::Future;
use std::io;
use std::pin::pin;
use std::task::{Context, Poll, Waker};
use std::time::{Duration, Instant};

/// Interval at which waiting for bytes yields, so that a call can be dropped.
const SLICE: Duration = Duration::from_millis(20);

/// Maximum line length; longer lines arrive in pieces, which no protocol accepts.
const MAX_LINE: usize = 256;

/// Maximum number of buffered lines; beyond it the oldest are lost.
const MAX_LINES: usize = 256;

/// Time after the deadline in which buffered lines are still read.
const FLOOD: Duration = Duration::from_secs(1);

/// Limit of a wait for silence, as a multiple of the required silence.
const MAX_TALK: u32 = 10;

/// A cable to a device.
pub trait Wire: Send {
    /// Sends all bytes.
    ///
    /// # Errors
    /// If the link is gone.
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Receives bytes; returns 0 if none arrived within `limit`.
    ///
    /// # Errors
    /// If the link is gone.
    fn receive(&mut self, buffer: &mut [u8], limit: Duration) -> io::Result<usize>;

    /// Discards unread bytes.
    ///
    /// # Errors
    /// If the link is gone.
    fn clear(&mut self) -> io::Result<()>;

    /// Time on this cable: the system's, except in a replay.
    fn now(&self) -> Instant {
        Instant::now()
    }
}

/// Splits bytes into lines, of bounded length and number.
pub struct LineBuffer {
    /// Line terminators.
    ends: Vec<u8>,
    begun: Vec<u8>,
    lines: VecDeque<Vec<u8>>,
}

impl LineBuffer {
    /// Lines that end with one or more of these bytes; empty lines are skipped.
    pub fn new(ends: &[u8]) -> Self {
        Self { ends: ends.to_vec(), begun: Vec::new(), lines: VecDeque::new() }
    }

    /// Adds received bytes.
    pub fn push(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            let ended = self.ends.contains(&byte);
            if !ended {
                self.begun.push(byte);
            }
            if (ended && !self.begun.is_empty()) || self.begun.len() == MAX_LINE {
                self.lines.push_back(std::mem::take(&mut self.begun));
                if self.lines.len() > MAX_LINES {
                    self.lines.pop_front();
                }
            }
        }
    }

    /// The next complete line, without its terminator.
    pub fn pop(&mut self) -> Option<Vec<u8>> {
        self.lines.pop_front()
    }

    /// Discards everything.
    pub fn clear(&mut self) {
        self.begun.clear();
        self.lines.clear();
    }
}

/// Lines to and from a device.
pub struct Lines {
    wire: Box<dyn Wire>,
    buffer: LineBuffer,
    /// Name of the device in error messages.
    device: String,
}

impl Lines {
    /// Lines over a cable. `ends` are the line terminators of the device.
    pub fn new(wire: Box<dyn Wire>, device: &str, ends: &[u8]) -> Self {
        Self { wire, buffer: LineBuffer::new(ends), device: device.to_owned() }
    }

    /// Name of the device in error messages.
    pub fn device(&self) -> &str {
        &self.device
    }

    /// Sets the device's name, once it is known.
    pub fn rename(&mut self, device: &str) {
        self.device = device.to_owned();
    }

    /// Time on the cable.
    pub fn now(&self) -> Instant {
        self.wire.now()
    }

    /// Sends raw bytes.
    ///
    /// # Errors
    /// `Lost`.
    pub fn send(&mut self, command: &str, bytes: &[u8]) -> DeviceResult<()> {
        self.wire.send(bytes).map_err(|e| self.lost(command, &e))
    }

    /// Discards unread bytes.
    ///
    /// # Errors
    /// `Lost`.
    pub fn clear(&mut self, command: &str) -> DeviceResult<()> {
        self.buffer.clear();
        self.wire.clear().map_err(|e| self.lost(command, &e))
    }

    /// The next line without its terminator; `None` if no complete line arrived before the deadline.
    ///
    /// # Errors
    /// `Lost`.
    pub async fn next(&mut self, command: &str, until: Instant) -> DeviceResult<Option<Vec<u8>>> {
        let mut bytes = [0; 256];
        loop {
            // A caller that skips lines must also terminate if the device sends without end.
            if self.now() > until + FLOOD {
                self.buffer.clear();
                return Ok(None);
            }
            if let Some(line) = self.buffer.pop() {
                return Ok(Some(line));
            }
            let limit = until.saturating_duration_since(self.now()).min(SLICE);
            let count = self.wire.receive(&mut bytes, limit).map_err(|e| self.lost(command, &e))?;
            self.buffer.push(bytes.get(..count).unwrap_or(&bytes));
            if count == 0 && self.now() >= until {
                return Ok(None);
            }
            tokio::task::yield_now().await;
        }
    }

    /// Returns after a period of silence; bytes received before are discarded.
    ///
    /// # Errors
    /// `Lost`; `Retry` if the device does not become silent.
    pub async fn quiet(&mut self, command: &str, time: Duration) -> DeviceResult<()> {
        let begun = self.now();
        while self.next(command, self.now() + time).await?.is_some() {
            if self.now() - begun > MAX_TALK * time {
                let got = "a device that talks all the time";
                return Err(DeviceError::new(&self.device, command, "an answer", got)
                    .remedy("check the cable and the settings of the port, then try again")
                    .class(Class::Retry));
            }
        }
        self.clear(command)
    }

    fn lost(&self, command: &str, e: &io::Error) -> DeviceError {
        DeviceError::new(&self.device, command, "an answer", format!("a lost link ({e})"))
            .remedy("check cable and power, then resume the session")
            .class(Class::Lost)
    }
}

/// A line as shown in error messages.
pub fn shown(line: &[u8]) -> String {
    let text: String = line.iter().take(40).map(|b| b.escape_ascii().to_string()).collect();
    format!("“{text}”")
}

/// Runs a future that waits only for bytes, without a runtime: each of its steps blocks for them.
pub fn wait<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    loop {
        if let Poll::Ready(done) = future.as_mut().poll(&mut Context::from_waker(Waker::noop())) {
            return done;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::replay::Replay;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn lines_are_the_same_however_they_are_cut(
            lines in prop::collection::vec("[ -~]{1,40}", 0..20),
            cuts in prop::collection::vec(1_usize..30, 1..20),
        ) {
            let text = lines.iter().map(|l| format!("{l}\r\n")).collect::<String>().into_bytes();
            let mut buffer = LineBuffer::new(b"\r\n");
            let (mut rest, mut cuts) = (&text[..], cuts.iter().cycle());
            while !rest.is_empty() {
                let (piece, after) = rest.split_at(rest.len().min(*cuts.next().unwrap()));
                buffer.push(piece);
                rest = after;
            }
            let found: Vec<String> = std::iter::from_fn(|| buffer.pop()).map(|l| String::from_utf8(l).unwrap()).collect();
            prop_assert_eq!(found, lines);
        }

        #[test]
        fn any_input_is_bounded(bytes in prop::collection::vec(any::<u8>(), 0..5000)) {
            let mut buffer = LineBuffer::new(b"\r\n");
            buffer.push(&bytes);
            while let Some(line) = buffer.pop() {
                prop_assert!(!line.is_empty() && line.len() <= MAX_LINE);
            }
        }
    }

    #[test]
    fn a_flood_loses_the_oldest_lines() {
        let mut buffer = LineBuffer::new(b"\n");
        (0..1000).for_each(|n| buffer.push(format!("{n}\n").as_bytes()));
        assert_eq!(buffer.pop(), Some((1000 - MAX_LINES).to_string().into_bytes()));
    }

    #[test]
    fn half_a_line_is_none() {
        let mut lines = Lines::new(Box::new(Replay::new(&[("a", "0PO00")])), "stage", b"\r\n");
        lines.send("ask", b"a").unwrap();
        let until = lines.now() + Duration::from_millis(5);
        assert_eq!(wait(lines.next("ask", until)), Ok(None));
    }

    /// Sends the same line without end.
    struct Chatter;

    impl Wire for Chatter {
        fn send(&mut self, _: &[u8]) -> io::Result<()> {
            Ok(())
        }

        fn receive(&mut self, buffer: &mut [u8], _: Duration) -> io::Result<usize> {
            buffer[..6].copy_from_slice(b"hello\n");
            Ok(6)
        }

        fn clear(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn who_never_stops_talking_is_not_listened_to_for_ever() {
        let mut lines = Lines::new(Box::new(Chatter), "stage", b"\n");
        let error = wait(lines.quiet("ask", Duration::from_millis(2))).unwrap_err();
        assert!(error.class == Class::Retry && error.got.contains("talks"), "{error}");
        let until = Instant::now();
        while wait(lines.next("ask", until)).unwrap().is_some() {}
    }

    #[test]
    fn a_lost_link_says_so() {
        let mut lines = Lines::new(Box::new(Replay::new(&[])), "stage", b"\r\n");
        let error = lines.send("ask", b"a").unwrap_err();
        assert!(error.class == Class::Lost && error.remedy.contains("cable"), "{error}");
    }
}

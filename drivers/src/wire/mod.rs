//! Bytes to and from a device on a cable, and the lines that they make.
//!
//! Time here is the cable's: how long a device may be silent has nothing to do with the bench's clock.

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

/// Whoever waits for bytes gives way after this long, so that a call can be dropped in the middle.
const SLICE: Duration = Duration::from_millis(20);

/// Longest line; what is longer comes in pieces, which no protocol understands.
const MAX_LINE: usize = 256;

/// Most lines that wait; a device that sends more than anybody reads loses the oldest.
const MAX_LINES: usize = 256;

/// Lines that came in time are read for this long afterwards.
const FLOOD: Duration = Duration::from_secs(1);

/// A device that is to be quiet for a time is waited for this many times as long.
const MAX_TALK: u32 = 10;

/// A cable to a device.
pub trait Wire: Send {
    /// Sends all of these bytes.
    ///
    /// # Errors
    /// The link is gone.
    fn send(&mut self, bytes: &[u8]) -> io::Result<()>;

    /// Bytes that came; 0 when none did within `limit`.
    ///
    /// # Errors
    /// The link is gone.
    fn receive(&mut self, buffer: &mut [u8], limit: Duration) -> io::Result<usize>;

    /// Forgets what came and was not read.
    ///
    /// # Errors
    /// The link is gone.
    fn clear(&mut self) -> io::Result<()>;

    /// What time it is on this cable: the machine's own, where nothing is replayed.
    fn now(&self) -> Instant {
        Instant::now()
    }
}

/// Cuts bytes into lines, of bounded length and number.
pub struct LineBuffer {
    /// Bytes that end a line.
    ends: Vec<u8>,
    begun: Vec<u8>,
    lines: VecDeque<Vec<u8>>,
}

impl LineBuffer {
    /// Lines that end with any of these bytes, or several of them; empty ones do not count.
    pub fn new(ends: &[u8]) -> Self {
        Self { ends: ends.to_vec(), begun: Vec::new(), lines: VecDeque::new() }
    }

    /// Takes what came.
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

    /// The next whole line, without its end.
    pub fn pop(&mut self) -> Option<Vec<u8>> {
        self.lines.pop_front()
    }

    /// Forgets everything.
    pub fn clear(&mut self) {
        self.begun.clear();
        self.lines.clear();
    }
}

/// Lines to and from a device.
pub struct Lines {
    wire: Box<dyn Wire>,
    buffer: LineBuffer,
    /// What error messages call the device.
    device: String,
}

impl Lines {
    /// Lines over a cable. `ends` are the bytes that end a line of the device.
    pub fn new(wire: Box<dyn Wire>, device: &str, ends: &[u8]) -> Self {
        Self { wire, buffer: LineBuffer::new(ends), device: device.to_owned() }
    }

    /// What error messages call the device.
    pub fn device(&self) -> &str {
        &self.device
    }

    /// Gives the device its name, once it is known.
    pub fn rename(&mut self, device: &str) {
        self.device = device.to_owned();
    }

    /// What time it is on the cable.
    pub fn now(&self) -> Instant {
        self.wire.now()
    }

    /// Sends bytes as they are.
    ///
    /// # Errors
    /// `Lost`.
    pub fn send(&mut self, command: &str, bytes: &[u8]) -> DeviceResult<()> {
        self.wire.send(bytes).map_err(|e| self.lost(command, &e))
    }

    /// Forgets what came and was not read.
    ///
    /// # Errors
    /// `Lost`.
    pub fn clear(&mut self, command: &str) -> DeviceResult<()> {
        self.buffer.clear();
        self.wire.clear().map_err(|e| self.lost(command, &e))
    }

    /// The next line, without its end; none when no whole one came until then.
    ///
    /// # Errors
    /// `Lost`.
    pub async fn next(&mut self, command: &str, until: Instant) -> DeviceResult<Option<Vec<u8>>> {
        let mut bytes = [0; 256];
        loop {
            // Whoever skips the lines of a device that never stops talking must come to an end, too.
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

    /// Returns once nothing came for a while; what comes until then is forgotten.
    ///
    /// # Errors
    /// `Lost`; `Retry` when it does not become quiet.
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

/// A line as error messages show it.
pub fn shown(line: &[u8]) -> String {
    let text: String = line.iter().take(40).map(|b| b.escape_ascii().to_string()).collect();
    format!("“{text}”")
}

/// Runs what only ever waits for bytes, where no runtime is at hand: each step of it waits for them itself.
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
        fn whatever_comes_is_held_in_bounds(bytes in prop::collection::vec(any::<u8>(), 0..5000)) {
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

    /// Says the same line for ever.
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

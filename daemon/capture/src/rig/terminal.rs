//! Prompts at the terminal to rotate the analyser.

use super::Stop;
use nacre_drivers::Prompt;
use std::sync::atomic::Ordering;

/// Prompts the person at the terminal; gives up when the program must stop.
pub struct Terminal {
    /// Number of requests to stop.
    pub stop: Stop,
}

impl Prompt for Terminal {
    fn ask(&mut self, request: &str) -> std::io::Result<()> {
        use rustix::event::{PollFd, PollFlags, Timespec, poll};
        use std::io::{Error, ErrorKind, Write};
        writeln!(std::io::stderr().lock(), "{request}")?;
        let stdin = std::io::stdin();
        let wait = Timespec { tv_sec: 0, tv_nsec: 100_000_000 };
        loop {
            if self.stop.load(Ordering::Relaxed) > 0 {
                return Err(ErrorKind::Interrupted.into());
            }
            if !poll(&mut [PollFd::new(&stdin, PollFlags::IN)], Some(&wait)).is_ok_and(|ready| ready > 0) {
                continue;
            }
            // Read byte by byte, because buffered input is invisible to the next poll.
            let mut byte = [0];
            match rustix::io::read(&stdin, &mut byte)? {
                0 => return Err(Error::new(ErrorKind::UnexpectedEof, "the end of the terminal's input")),
                _ if byte == *b"\n" => return Ok(()),
                _ => {}
            }
        }
    }
}

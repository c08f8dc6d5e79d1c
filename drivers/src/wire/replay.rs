//! A cable that replays a transcript on a simulated clock. Independent of the machine's speed, answers arrive at once,
//! and silence lasts as long as the caller waits.

use super::Wire;
use std::collections::VecDeque;
use std::io;
use std::time::{Duration, Instant};

/// Expected bytes, and the answers to them.
pub(crate) struct Replay {
    steps: VecDeque<(String, String)>,
    waiting: VecDeque<u8>,
    now: Instant,
}

impl Replay {
    /// Sending anything else, or in another order, is a lost link.
    pub(crate) fn new(steps: &[(&str, &str)]) -> Self {
        let steps = steps.iter().map(|(sent, came)| ((*sent).to_owned(), (*came).to_owned())).collect();
        Self { steps, waiting: VecDeque::new(), now: Instant::now() }
    }
}

impl Wire for Replay {
    fn send(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self.steps.pop_front() {
            Some((sent, came)) if sent.as_bytes() == bytes => {
                self.waiting.extend(came.bytes());
                Ok(())
            }
            step => Err(io::Error::other(format!("sent “{}”, transcript: {step:?}", bytes.escape_ascii()))),
        }
    }

    fn receive(&mut self, buffer: &mut [u8], limit: Duration) -> io::Result<usize> {
        if self.waiting.is_empty() {
            self.now += limit;
        }
        let count = self.waiting.len().min(buffer.len());
        self.waiting.drain(..count).zip(buffer).for_each(|(byte, place)| *place = byte);
        Ok(count)
    }

    fn clear(&mut self) -> io::Result<()> {
        self.waiting.clear();
        Ok(())
    }

    fn now(&self) -> Instant {
        self.now
    }
}

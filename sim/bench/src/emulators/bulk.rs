//! Custom flash electronics with USB bulk transfers: frames of 8 bytes, and a watchdog that switches the bench's flash
//! off.

use super::fault::ByteFaultKind;
use super::lamp::Load;
use super::reports::{Outcome, Peripheral, Transfer};
use crate::devices::Port;
use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Most answers that wait to be read.
const MAX_WAITING: usize = 16;

/// Time unit of the watchdog.
const STEP: Duration = Duration::from_millis(10);

/// A flash with bulk transfers.
pub struct BulkEmulator {
    load: Load,
    off_at: Option<Instant>,
    waiting: VecDeque<[u8; 8]>,
}

impl BulkEmulator {
    /// A device with the flash off.
    pub fn new(port: Box<dyn Port>) -> Self {
        Self { load: Load::new(port), off_at: None, waiting: VecDeque::new() }
    }

    /// Executes a command; returns its status.
    fn command(&mut self, command: u8, steps: u16, fault: Option<ByteFaultKind>) -> u8 {
        if fault == Some(ByteFaultKind::StuckBusy) {
            return 3;
        }
        match command {
            1 => {}
            2 => {
                self.load.set(true);
                self.off_at = Some(Instant::now() + STEP * u32::from(steps));
            }
            3 => {
                self.load.set(false);
                self.off_at = None;
            }
            _ => return 1,
        }
        if fault == Some(ByteFaultKind::WrongStatus) { 2 } else { 0 }
    }

    fn request(&mut self, frame: [u8; 8], fault: Option<ByteFaultKind>) {
        let [0x4e, sequence, command, low, high, 0, 0, check] = frame else { return };
        if check != checksum(&frame[..7]) {
            return;
        }
        let status = self.command(command, u16::from(low) + 256 * u16::from(high), fault);
        let left = self.off_at.map_or(0, |end| end.saturating_duration_since(Instant::now()).as_millis() / 10);
        let mut answer =
            [0x6e, sequence, command, status, u8::from(self.load.is_on()), left as u8, (left >> 8) as u8, 0];
        answer[7] = checksum(&answer[..7]);
        let times = if fault == Some(ByteFaultKind::Resend) { 2 } else { 1 };
        for _ in 0..times {
            self.waiting.truncate(MAX_WAITING);
            self.waiting.push_back(answer);
        }
    }
}

/// CRC-8 with the polynomial x⁸+x²+x+1, bit by bit.
fn checksum(bytes: &[u8]) -> u8 {
    let mut remainder = 0u8;
    for bit in bytes.iter().flat_map(|byte| (0..8).rev().map(move |n| byte >> n & 1)) {
        let carry = (remainder >> 7) ^ bit;
        remainder = (remainder << 1) ^ (carry * 0x07);
    }
    remainder
}

impl Peripheral for BulkEmulator {
    fn transfer(&mut self, transfer: Transfer<'_>, fault: Option<ByteFaultKind>) -> Outcome {
        match transfer {
            Transfer::BulkOut(bytes) => {
                // Data of another length is not a frame and is not answered.
                if let Ok(frame) = bytes.try_into() {
                    self.request(frame, fault);
                }
                Outcome::Done(vec![])
            }
            Transfer::BulkIn => self.waiting.pop_front().map_or(Outcome::Silent, |frame| Outcome::Done(frame.to_vec())),
            _ => Outcome::Stalled,
        }
    }

    fn reset(&mut self) {
        self.waiting.clear();
        self.off_at = None;
        self.load.set(false);
    }

    fn tick(&mut self) {
        if self.off_at.take_if(|end| Instant::now() >= *end).is_some() {
            self.load.set(false);
        }
    }
}

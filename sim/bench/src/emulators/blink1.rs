//! A blink(1) whose light is the bench's flash. Like old firmware, it plays its pattern when its watchdog expires.

use super::fault::ByteFaultKind;
use super::lamp::Load;
use super::reports::{Outcome, Peripheral, Transfer};
use crate::devices::Port;
use std::time::{Duration, Instant};

/// First colour of the factory pattern (red, green, blue).
const SOLD_WITH: [u8; 3] = [255, 0, 0];

/// A blink(1) mk2.
pub struct Blink1Emulator {
    load: Load,
    colour: [u8; 3],
    pattern: [[u8; 3]; 16],
    /// Time at which the watchdog expires.
    watch: Option<Instant>,
    /// Answer to the next feature request.
    answer: [u8; 8],
}

impl Blink1Emulator {
    /// A blink(1) with the light off.
    pub fn new(port: Box<dyn Port>) -> Self {
        let answer = [0; 8];
        Self { load: Load::new(port), colour: [0; 3], pattern: [SOLD_WITH; 16], watch: None, answer }
    }

    fn show(&mut self, colour: [u8; 3]) {
        self.colour = colour;
        self.load.set(colour != [0; 3]);
    }

    /// The colour that is visible; it differs from the command if the flash is on for another reason.
    fn shown(&self) -> [u8; 3] {
        if self.load.is_on() && self.colour == [0; 3] { [1; 3] } else { self.colour }
    }

    fn command(&mut self, command: u8, a: [u8; 6], fault: Option<ByteFaultKind>) {
        let stuck = fault == Some(ByteFaultKind::StuckBusy);
        match command {
            b'n' | b'c' if !stuck => self.show([a[0], a[1], a[2]]),
            b'D' if !stuck => {
                let time = Duration::from_millis(10 * (u64::from(a[1]) << 8 | u64::from(a[2])));
                self.watch = (a[0] == 1).then(|| Instant::now() + time);
            }
            b'P' if !stuck => {
                if let Some(line) = self.pattern.get_mut(usize::from(a[5])) {
                    *line = [a[0], a[1], a[2]];
                }
            }
            b'r' => {
                let [r, g, b] = match fault {
                    Some(ByteFaultKind::WrongStatus) if self.shown() == [0; 3] => [255; 3],
                    Some(ByteFaultKind::WrongStatus) => [0; 3],
                    _ => self.shown(),
                };
                self.answer = [1, b'r', r, g, b, 0, 0, 0];
            }
            b'v' => self.answer = [1, b'v', 0, b'2', b'0', 0, 0, 0],
            _ => {}
        }
    }
}

impl Peripheral for Blink1Emulator {
    fn transfer(&mut self, transfer: Transfer<'_>, fault: Option<ByteFaultKind>) -> Outcome {
        match transfer {
            Transfer::SetFeature(&[1, command, a, b, c, d, e, f]) => {
                self.command(command, [a, b, c, d, e, f], fault);
                Outcome::Done(vec![])
            }
            Transfer::Feature(1) => Outcome::Done(self.answer.to_vec()),
            _ => Outcome::Stalled,
        }
    }

    fn reset(&mut self) {
        self.watch = None;
        self.pattern = [SOLD_WITH; 16];
        self.answer = [0; 8];
        self.show([0; 3]);
    }

    fn tick(&mut self) {
        if self.watch.take_if(|end| Instant::now() >= *end).is_some() {
            let colour = self.pattern.into_iter().find(|line| *line != [0; 3]);
            self.show(colour.unwrap_or_default());
        }
    }
}

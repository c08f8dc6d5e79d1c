//! A Thorlabs ELL14 that turns the bench's analyser.
//!
//! After power-up it counts from its present angle. A move is answered when it ends; requests meanwhile are answered
//! with busy. A stop ends cleaning only. Requests need no end of line: their letters determine their length.

use super::axis::{Axis, Progress};
use super::response_queue::ResponseQueue;
use super::{Action, ByteFault, ByteFaultKind, Emulator, Strikes};
use crate::Port;
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

/// Options and faults of an emulated ELL14.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Bus address: a capital hexadecimal digit.
    pub address: char,
    /// Serial number of 8 digits.
    pub serial: u32,
    /// Type number; 14 is the ELL14.
    pub kind: u8,
    /// Encoder pulses per turn.
    pub pulses_per_turn: u32,
    /// Status code for [`ByteFaultKind::WrongStatus`].
    pub wrong_status: u8,
    /// Delay of an answer for [`ByteFaultKind::Slow`], in ms.
    pub late_ms: u64,
    /// Duration in ms of cleaning, and of a frequency search.
    pub care_ms: u64,
    /// Faults.
    pub faults: Vec<ByteFault>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            address: '0',
            serial: 11_400_517,
            kind: 14,
            pulses_per_turn: 143_360,
            wrong_status: 2,
            late_ms: 400,
            care_ms: 500,
            faults: vec![],
        }
    }
}

/// Startup time.
const STARTING: Duration = Duration::from_millis(60);

const OK: u8 = 0;
const MECHANICAL_TIMEOUT: u8 = 2;
const COMMAND_ERROR: u8 = 3;
const INITIALISING: u8 = 7;
const BUSY: u8 = 9;

/// The emulated module.
pub struct Elliptec {
    options: Options,
    axis: Axis,
    responses: ResponseQueue,
    strikes: Strikes,
    /// Bytes of an incomplete request.
    heard: String,
    /// Fault of the answer to the current movement.
    spoiled: Option<ByteFaultKind>,
    /// End of cleaning or of a frequency search.
    caring: Option<Instant>,
    starting: Option<Instant>,
    stuck: bool,
}

impl Elliptec {
    /// A module after power-up.
    pub fn new(port: Box<dyn Port>, options: Options) -> Self {
        Self {
            axis: Axis::new(port),
            responses: ResponseQueue::new(Duration::from_millis(options.late_ms)),
            strikes: Strikes::new(options.faults.clone()),
            options,
            heard: String::new(),
            spoiled: None,
            caring: None,
            starting: None,
            stuck: false,
        }
    }

    /// The next complete request to any module; inner `None` if it is for another module.
    fn request(&mut self) -> Option<Option<(String, String)>> {
        let start = self.heard.find(|c: char| c.is_ascii_hexdigit()).unwrap_or(self.heard.len());
        self.heard.drain(..start);
        let letters = self.heard.get(1..3)?.to_owned();
        let end = 3 + data_length(&letters);
        let data = self.heard.get(3..end)?.to_owned();
        let mine = self.heard.starts_with(self.options.address);
        self.heard.drain(..end);
        Some(mine.then_some((letters, data)))
    }

    fn obey(&mut self, letters: &str, data: &str) -> Option<Action> {
        let fault = self.strikes.strike();
        match fault {
            Some(ByteFaultKind::NoAnswer) => return None,
            Some(ByteFaultKind::Dropped) => {
                self.responses.clear();
                return Some(Action::Close);
            }
            Some(ByteFaultKind::Reset) => self.restart(),
            Some(ByteFaultKind::StuckBusy) => self.stuck = true,
            _ => {}
        }
        if self.stuck {
            self.status(fault, BUSY);
        } else if self.starting.is_some() {
            self.status(fault, INITIALISING);
        } else if fault == Some(ByteFaultKind::WrongStatus) {
            self.status(None, self.options.wrong_status);
        } else if self.axis.is_turning() || (self.caring.is_some() && letters != "st") {
            self.status(fault, BUSY);
        } else {
            self.carry_out(fault, letters, data);
        }
        None
    }

    fn carry_out(&mut self, fault: Option<ByteFaultKind>, letters: &str, data: &str) {
        match letters {
            "in" => {
                let Options { kind, serial, pulses_per_turn, .. } = self.options;
                self.answer(fault, &format!("IN{kind:02X}{serial:08}202317010168{pulses_per_turn:08X}"));
            }
            "gs" => self.status(fault, OK),
            "gp" => self.position(fault),
            "ho" => {
                let begun = self.axis.home();
                self.begun(fault, begun);
            }
            "ma" | "mr" => match u32::from_str_radix(data, 16) {
                Ok(bits) => {
                    let from = if letters == "mr" { self.axis.counted_deg() } else { 0.0 };
                    let turn = f64::from(bits as i32) / f64::from(self.options.pulses_per_turn);
                    let begun = self.axis.move_to(from + 360.0 * turn);
                    self.begun(fault, begun);
                }
                Err(_) => self.status(fault, COMMAND_ERROR),
            },
            "s1" | "s2" | "cm" => {
                self.spoiled = fault;
                self.caring = Some(Instant::now() + Duration::from_millis(self.options.care_ms));
            }
            "st" => {
                self.caring = None;
                self.status(fault, OK);
            }
            _ => self.status(fault, COMMAND_ERROR),
        }
    }

    fn begun(&mut self, fault: Option<ByteFaultKind>, begun: bool) {
        if begun {
            self.spoiled = fault;
        } else {
            self.status(fault, MECHANICAL_TIMEOUT);
        }
    }

    fn restart(&mut self) {
        self.axis.restart();
        self.responses.clear();
        (self.stuck, self.caring, self.spoiled) = (false, None, None);
        self.starting = Some(Instant::now() + STARTING);
    }

    fn position(&mut self, fault: Option<ByteFaultKind>) {
        let turns = self.axis.counted_deg() / 360.0;
        let pulses = (turns * f64::from(self.options.pulses_per_turn)).round() as i32;
        self.answer(fault, &format!("PO{:08X}", pulses as u32));
    }

    fn status(&mut self, fault: Option<ByteFaultKind>, code: u8) {
        self.answer(fault, &format!("GS{code:02X}"));
    }

    fn answer(&mut self, fault: Option<ByteFaultKind>, text: &str) {
        self.responses.push(fault, &format!("{}{text}\r\n", self.options.address));
    }
}

/// Number of digits after the letters of a request.
fn data_length(letters: &str) -> usize {
    match letters {
        "ho" | "fw" | "bw" | "ca" => 1,
        "sv" => 2,
        "ma" | "mr" | "sj" | "so" => 8,
        _ => 0,
    }
}

impl Emulator for Elliptec {
    fn receive(&mut self, bytes: &[u8]) -> Vec<Action> {
        let readable = bytes.iter().filter(|b| b.is_ascii_alphanumeric());
        self.heard.extend(readable.map(|b| char::from(*b)));
        while let Some(request) = self.request() {
            let Some((letters, data)) = request else { continue };
            if let Some(action) = self.obey(&letters, &data) {
                self.heard.clear();
                return vec![action];
            }
        }
        self.responses.due()
    }

    fn tick(&mut self) -> Vec<Action> {
        let now = Instant::now();
        self.starting = self.starting.filter(|until| *until > now);
        if self.caring.take_if(|until| *until <= now).is_some() {
            let fault = self.spoiled.take();
            self.status(fault, OK);
        }
        match self.axis.progress() {
            Progress::Done => {
                let fault = self.spoiled.take();
                self.position(fault);
            }
            Progress::Failed => self.status(None, MECHANICAL_TIMEOUT),
            Progress::Rest | Progress::Turning => {}
        }
        self.responses.due()
    }
}

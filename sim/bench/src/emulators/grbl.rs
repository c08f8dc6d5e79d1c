//! A GRBL 1.1 motor controller whose rotary axis turns the bench's analyser.
//!
//! Lines are answered when they are queued; `?` is answered at once, except during homing. After a feed hold the axis
//! decelerates; a reset during a movement causes an alarm.

use super::axis::{Axis, Progress};
use super::response_queue::ResponseQueue;
use super::{Action, ByteFault, ByteFaultKind, Emulator, Strikes};
use crate::Port;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;
use std::time::Duration;

/// Options and faults of an emulated controller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Options {
    /// Letter of the rotary axis: X, Y, Z, A, B or C.
    pub axis: char,
    /// Degrees per unit of the axis.
    pub degrees_per_unit: f64,
    /// Whether it has a limit switch at zero ($22=1) and is locked until homed.
    pub homes: bool,
    /// Whether reports contain work coordinates ($10=0).
    pub work: bool,
    /// Error code for [`ByteFaultKind::WrongStatus`]; status reports show an alarm.
    pub wrong_status: u8,
    /// Delay of an answer for [`ByteFaultKind::Slow`], in ms.
    pub late_ms: u64,
    /// Faults.
    pub faults: Vec<ByteFault>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            axis: 'A',
            degrees_per_unit: 1.0,
            homes: true,
            work: false,
            wrong_status: 9,
            late_ms: 400,
            faults: vec![],
        }
    }
}

/// Offset of the work coordinates in units.
const WORK: f64 = 12.5;

/// Every tenth status report contains the work coordinate offset.
const WORK_EVERY: u32 = 10;

/// Longest accepted line in bytes.
const MAX_LINE: usize = 80;

/// The emulated controller.
pub struct Grbl {
    options: Options,
    axis: Axis,
    responses: ResponseQueue,
    strikes: Strikes,
    line: String,
    /// Targets in units of the movements that follow.
    queue: VecDeque<f64>,
    /// Target of the current movement in units.
    target: Option<f64>,
    jogging: bool,
    /// Step counter at rest in units. Backlash behind the motor does not change it.
    counted: Option<f64>,
    /// Fault of the answer at the end of homing; outer `None`: not homing.
    homing: Option<Option<ByteFaultKind>>,
    held: bool,
    locked: bool,
    checking: bool,
    stuck: bool,
    reports: u32,
}

impl Grbl {
    /// A controller after power-up.
    pub fn new(port: Box<dyn Port>, options: Options) -> Self {
        Self {
            axis: Axis::new(port),
            responses: ResponseQueue::new(Duration::from_millis(options.late_ms)),
            strikes: Strikes::new(options.faults.clone()),
            line: String::new(),
            queue: VecDeque::new(),
            target: None,
            jogging: false,
            counted: None,
            homing: None,
            held: false,
            locked: options.homes,
            checking: false,
            stuck: false,
            reports: 0,
            options,
        }
    }

    /// Fault of a command: `Ok` for commands that are still executed, `Err` for commands without effect.
    fn struck(&mut self) -> Result<Option<ByteFaultKind>, Option<Action>> {
        let fault = self.strikes.strike();
        match fault {
            Some(ByteFaultKind::NoAnswer) => Err(None),
            Some(ByteFaultKind::Dropped) => {
                self.responses.clear();
                Err(Some(Action::Close))
            }
            Some(ByteFaultKind::Reset) => {
                self.axis.restart();
                self.counted = None;
                self.responses.clear();
                self.locked = self.options.homes;
                self.start();
                Err(None)
            }
            Some(ByteFaultKind::StuckBusy) => {
                self.stuck = true;
                Ok(fault)
            }
            _ => Ok(fault),
        }
    }

    /// Restarts, and sends the greeting; the step counter survives a reset.
    fn start(&mut self) {
        self.queue.clear();
        self.line.clear();
        (self.target, self.homing, self.jogging) = (None, None, false);
        (self.held, self.checking, self.stuck, self.reports) = (false, false, false, 0);
        self.responses.push(None, "\r\nGrbl 1.1h ['$' for help]\r\n");
        if self.locked {
            self.responses.push(None, "[MSG:'$H'|'$X' to unlock]\r\n");
        }
    }

    fn reset(&mut self) {
        if self.axis.is_turning() {
            self.axis.halt();
            self.locked = true;
            let code = if self.homing.is_some() { 6 } else { 3 };
            self.responses.push(None, &format!("ALARM:{code}\r\n"));
        }
        self.start();
    }

    fn hold(&mut self) {
        self.axis.halt();
        if self.jogging {
            self.queue.clear();
            (self.jogging, self.target) = (false, None);
        } else {
            self.held = true;
        }
    }

    fn resume(&mut self) {
        if std::mem::take(&mut self.held)
            && let Some(target) = self.target
        {
            self.go(target);
        }
    }

    /// Position in units, from the step counter.
    fn units(&mut self) -> f64 {
        self.counted.unwrap_or_else(|| self.axis.counted_deg() / self.options.degrees_per_unit)
    }

    fn go(&mut self, units: f64) {
        (self.target, self.counted) = (Some(units), None);
        if !self.axis.move_to(units * self.options.degrees_per_unit) {
            self.locked = true;
            self.responses.push(None, "ALARM:2\r\n");
        }
    }

    fn state(&self) -> &'static str {
        match self {
            _ if self.stuck => "Run",
            _ if self.locked => "Alarm",
            _ if self.checking => "Check",
            _ if self.held => "Hold:0",
            _ if self.axis.is_turning() && self.jogging => "Jog",
            _ if self.axis.is_turning() || !self.queue.is_empty() => "Run",
            _ => "Idle",
        }
    }

    fn report(&mut self, fault: Option<ByteFaultKind>) {
        let state = if fault == Some(ByteFaultKind::WrongStatus) { "Alarm" } else { self.state() };
        let units = self.units();
        let index = "XYZABC".find(self.options.axis).unwrap_or(0);
        let (kind, start) = if self.options.work { ("WPos", WORK) } else { ("MPos", 0.0) };
        let axes = |value: f64| {
            let of = |i| format!("{:.3}", if i == index { value } else { 0.0 });
            (0..(index + 1).max(3)).map(of).collect::<Vec<_>>().join(",")
        };
        let work = match self.reports % WORK_EVERY {
            0 => format!("|WCO:{}", axes(WORK)),
            _ => String::new(),
        };
        self.reports += 1;
        self.responses.push(fault, &format!("<{state}|{kind}:{}|FS:0,0{work}>\r\n", axes(units - start)));
    }

    fn obey(&mut self, line: &str, fault: Option<ByteFaultKind>) {
        if self.stuck {
            // The queue is full, so the line waits.
            return;
        }
        let answer = match fault {
            Some(ByteFaultKind::WrongStatus) => Err(self.options.wrong_status),
            _ => self.carry_out(line),
        };
        match answer {
            Ok(()) if self.homing.is_some() => self.homing = Some(fault),
            Ok(()) => self.responses.push(fault, "ok\r\n"),
            Err(code) => self.responses.push(fault, &format!("error:{code}\r\n")),
        }
    }

    fn carry_out(&mut self, line: &str) -> Result<(), u8> {
        match line {
            "" | "$$" | "$G" => Ok(()),
            "$I" => {
                self.responses.push(None, "[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\n");
                Ok(())
            }
            "$X" => {
                self.locked = false;
                Ok(())
            }
            "$C" => {
                self.checking = !self.checking;
                Ok(())
            }
            "$H" if !self.options.homes => Err(5),
            "$H" if self.axis.is_turning() => Err(8),
            "$H" => {
                (self.locked, self.counted) = (false, None);
                self.homing = self.axis.home().then_some(None);
                if self.homing.is_some() { Ok(()) } else { Err(8) }
            }
            _ if self.locked => Err(9),
            _ => match line.strip_prefix("$J=") {
                Some(jog) => self.code(jog, true),
                None if line.starts_with('$') => Err(3),
                None => self.code(line, false),
            },
        }
    }

    /// Executes a block of G-code: modes, target of the axis, feed rate.
    fn code(&mut self, block: &str, jog: bool) -> Result<(), u8> {
        let (mut relative, mut target, mut rest) = (false, None, block);
        while let Some(letter) = rest.chars().next() {
            let end = rest[1..].find(|c: char| c.is_ascii_alphabetic()).map_or(rest.len(), |at| at + 1);
            let value: f64 = rest[1..end].parse().map_err(|_| 2)?;
            match (letter, (10.0 * value).round() as i64) {
                ('G', 0 | 10 | 210 | 530 | 900 | 940) => {}
                ('G', 910) => relative = true,
                ('G', _) => return Err(20),
                ('F', _) => {}
                (letter, _) if letter == self.options.axis => target = Some(value),
                _ => return Err(20),
            }
            rest = &rest[end..];
        }
        if let Some(value) = target.filter(|_| !self.checking) {
            let from = if relative { self.units() } else { 0.0 };
            self.jogging = jog;
            self.queue.push_back(from + value);
            self.follow();
        }
        Ok(())
    }

    /// Starts the next movement of the queue, if the axis rests.
    fn follow(&mut self) {
        if !self.axis.is_turning() && !self.held && !self.locked {
            match self.queue.pop_front() {
                Some(next) => self.go(next),
                None => self.target = None,
            }
        }
    }

    fn hear(&mut self, byte: u8) -> Option<Action> {
        let realtime = matches!(byte, b'?' | b'!' | b'~' | 0x18);
        let ended = matches!(byte, b'\r' | b'\n');
        // White space in a block has no meaning.
        if !realtime && !ended {
            let letter = char::from(byte).to_ascii_uppercase();
            if byte.is_ascii_graphic() && self.line.len() < MAX_LINE {
                self.line.push(letter);
            }
            return None;
        }
        // During homing it ignores everything but a reset. Empty lines are ignored.
        if (self.homing.is_some() && byte != 0x18) || (ended && self.line.is_empty()) {
            return None;
        }
        let line = if ended { std::mem::take(&mut self.line) } else { String::new() };
        let fault = match self.struck() {
            Ok(fault) => fault,
            Err(action) => return action,
        };
        match byte {
            b'?' => self.report(fault),
            b'!' => self.hold(),
            b'~' => self.resume(),
            0x18 => self.reset(),
            _ => self.obey(&line, fault),
        }
        None
    }
}

impl Emulator for Grbl {
    fn receive(&mut self, bytes: &[u8]) -> Vec<Action> {
        for byte in bytes {
            if let Some(action) = self.hear(*byte) {
                return vec![action];
            }
        }
        self.responses.due()
    }

    fn tick(&mut self) -> Vec<Action> {
        let progress = self.axis.progress();
        if progress == Progress::Failed {
            self.locked = true;
            self.responses.push(None, "ALARM:1\r\n");
        }
        if progress == Progress::Done {
            self.counted = self.target;
            if let Some(fault) = self.homing.take() {
                self.counted = Some(0.0);
                self.responses.push(fault, "ok\r\n");
            }
            self.follow();
        }
        self.responses.due()
    }
}

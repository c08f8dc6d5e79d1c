//! The line protocol of GRBL 1.1.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Requests a status report; like the other two real-time commands it needs no end of line.
pub const REPORT: &[u8] = b"?";
/// Holds the movement.
pub const HOLD: &[u8] = b"!";
/// Resets the controller, which discards the held movement.
pub const RESET: &[u8] = &[0x18];

/// Maximum number of axes in a report.
const MAX_AXES: usize = 6;

/// An axis letter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[allow(missing_docs, reason = "letters")]
pub enum Axis {
    X,
    Y,
    Z,
    #[default]
    A,
    B,
    C,
}

impl Axis {
    /// Index in a report.
    pub fn index(self) -> usize {
        self as usize
    }

    fn letter(self) -> char {
        ['X', 'Y', 'Z', 'A', 'B', 'C'][self.index()]
    }
}

/// A move in machine coordinates, independent of the units, offsets and modes in force.
pub fn move_line(axis: Axis, units: f64, feed: f64) -> String {
    format!("G21G90G94G53G1{}{units:.4}F{feed:.1}\n", axis.letter())
}

/// A line sent by GRBL.
#[derive(Clone, Debug, PartialEq)]
pub enum Line {
    /// The line was accepted into the queue; it has not been executed.
    Ok,
    /// The line was rejected.
    Error(u8),
    /// The controller is locked by an alarm.
    Alarm(u8),
    /// A status report.
    Report(Report),
    /// The controller has just started, with this version.
    Started(String),
    /// A message in brackets.
    Message(String),
}

/// A status report.
#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    /// Machine state.
    pub state: State,
    /// Position of the axes.
    pub place: Option<Place>,
    /// Origin of the work coordinates; not in every report.
    pub offset: Option<Vec<f64>>,
}

/// Coordinates of all axes.
#[derive(Clone, Debug, PartialEq)]
pub enum Place {
    /// Machine coordinates.
    Machine(Vec<f64>),
    /// Work coordinates.
    Work(Vec<f64>),
}

/// Machine state of GRBL.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "named as in the protocol")]
pub enum State {
    Idle,
    Run,
    /// Holding; `still` once the axes stand.
    Hold {
        still: bool,
    },
    Jog,
    Alarm,
    Door,
    Check,
    Home,
    Sleep,
}

/// Parses a line without its terminator; `None` if GRBL does not send such lines.
pub fn parse(line: &[u8]) -> Option<Line> {
    let text = std::str::from_utf8(line).ok()?.trim();
    if text == "ok" {
        Some(Line::Ok)
    } else if let Some(code) = text.strip_prefix("error:") {
        Some(Line::Error(number(code)?))
    } else if let Some(code) = text.strip_prefix("ALARM:") {
        Some(Line::Alarm(number(code)?))
    } else if let Some(started) = text.strip_prefix("Grbl ") {
        let version = started.split_whitespace().next().filter(|_| started.ends_with(']'))?;
        Some(Line::Started(version.to_owned()))
    } else if let Some(report) = text.strip_prefix('<') {
        Some(Line::Report(self::report(report.strip_suffix('>')?)?))
    } else {
        let message = text.strip_prefix('[')?.strip_suffix(']')?;
        Some(Line::Message(message.to_owned()))
    }
}

fn number(digits: &str) -> Option<u8> {
    let sane = digits.bytes().all(|b| b.is_ascii_digit());
    if sane { digits.parse().ok() } else { None }
}

fn report(text: &str) -> Option<Report> {
    let mut fields = text.split('|');
    let mut report = Report { state: state(fields.next()?)?, place: None, offset: None };
    for field in fields {
        match field.split_once(':')? {
            ("MPos", axes) => report.place = Some(Place::Machine(coordinates(axes)?)),
            ("WPos", axes) => report.place = Some(Place::Work(coordinates(axes)?)),
            ("WCO", axes) => report.offset = Some(coordinates(axes)?),
            // Feeds, buffers, overrides and pins are ignored.
            _ => {}
        }
    }
    Some(report)
}

fn state(text: &str) -> Option<State> {
    let (name, detail) = text.split_once(':').map_or((text, None), |(name, detail)| (name, Some(detail)));
    Some(match name {
        "Idle" => State::Idle,
        "Run" => State::Run,
        "Hold" => State::Hold { still: detail == Some("0") },
        "Jog" => State::Jog,
        "Alarm" => State::Alarm,
        "Door" => State::Door,
        "Check" => State::Check,
        "Home" => State::Home,
        "Sleep" => State::Sleep,
        _ => return None,
    })
}

fn coordinates(text: &str) -> Option<Vec<f64>> {
    let numbers: Option<Vec<f64>> = text.split(',').take(MAX_AXES + 1).map(decimal).collect();
    numbers.filter(|n| n.len() <= MAX_AXES)
}

/// A plain decimal number, without exponent or infinity.
fn decimal(text: &str) -> Option<f64> {
    let plain = text.len() <= 20 && text.bytes().all(|b| b.is_ascii_digit() || b == b'.' || b == b'-');
    if plain { text.parse().ok() } else { None }
}

/// Meaning of an error code.
pub fn error_name(code: u8) -> &'static str {
    match code {
        1 => "a word without a letter",
        2 => "a number in a wrong format",
        3 => "a $ command that it does not know",
        4 => "a negative value",
        5 => "homing is switched off in its settings ($22)",
        6 => "a step pulse that is too short",
        7 => "its settings could not be read",
        8 => "not allowed unless it is idle",
        9 => "locked by an alarm",
        10 => "soft limits need homing",
        11 => "a line that is too long",
        12 => "a step rate that is too high",
        13 => "a safety door that is open",
        14 => "a start-up line that is too long",
        15 => "a jog beyond its travel",
        16 => "a jog without a target",
        17 => "laser mode needs a spindle",
        20 => "a command that it does not have",
        21 => "two commands of one group",
        22 => "no feed rate",
        23..=38 => "G-code that is not valid",
        _ => "an error without a name",
    }
}

/// Meaning of an alarm code.
pub fn alarm_name(code: u8) -> &'static str {
    match code {
        1 => "a limit switch was hit",
        2 => "a target beyond its travel",
        3 => "reset while it moved",
        4 | 5 => "a probe failed",
        6 => "homing was reset",
        7 => "a door was opened while homing",
        8 => "the limit switch did not open while homing",
        9 => "no limit switch was found while homing",
        10 => "the second switch was not found while homing",
        _ => "an alarm without a name",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn report(text: &str) -> Report {
        match parse(text.as_bytes()) {
            Some(Line::Report(report)) => report,
            other => panic!("{text}: {other:?}"),
        }
    }

    #[test]
    fn lines_of_the_manual_are_read() {
        assert_eq!(parse(b"ok"), Some(Line::Ok));
        assert_eq!(parse(b"error:9"), Some(Line::Error(9)));
        assert_eq!(parse(b"ALARM:3"), Some(Line::Alarm(3)));
        assert_eq!(parse(b"Grbl 1.1h ['$' for help]"), Some(Line::Started("1.1h".into())));
        assert_eq!(parse(b"[MSG:'$H'|'$X' to unlock]"), Some(Line::Message("MSG:'$H'|'$X' to unlock".into())));
        let idle = report("<Idle|MPos:0.000,0.000,0.000,45.250|FS:0,0|WCO:0.000,1.000,0.000,-5.000>");
        assert_eq!(idle.state, State::Idle);
        assert_eq!(idle.place, Some(Place::Machine(vec![0.0, 0.0, 0.0, 45.25])));
        assert_eq!(idle.offset, Some(vec![0.0, 1.0, 0.0, -5.0]));
        assert_eq!(report("<Hold:0|WPos:1.000,2.000,3.000>").state, State::Hold { still: true });
        assert_eq!(report("<Hold:1|WPos:1.000,2.000,3.000>").place, Some(Place::Work(vec![1.0, 2.0, 3.0])));
        assert_eq!(report("<Check|MPos:0.000,0.000,0.000|Pn:PXYZ>").state, State::Check);
    }

    #[test]
    fn truncated_or_corrupt_lines_are_refused() {
        let bent = ["", "o", "okok", "error:", "error:x", "error:900", "ALARM", "<Idle|MPos:0.000", "<Idl|MPos:0>"];
        for line in bent.into_iter().chain(["<Idle|MPos:1,,2>", "<Idle|MPos:inf>", "<Idle|MPos>", "Grbl", "[MSG"]) {
            assert_eq!(parse(line.as_bytes()), None, "{line}");
        }
        let many = format!("<Idle|MPos:{}>", ["0"; 7].join(","));
        assert_eq!(parse(many.as_bytes()), None);
    }

    #[test]
    fn moves_are_absolute_in_machine_coordinates() {
        assert_eq!(move_line(Axis::A, 45.0, 1800.0), "G21G90G94G53G1A45.0000F1800.0\n");
        assert_eq!(move_line(Axis::X, -0.125, 0.5), "G21G90G94G53G1X-0.1250F0.5\n");
    }

    proptest! {
        #[test]
        fn places_come_back(axes in prop::collection::vec(-9999.0..9999.0_f64, 1..=MAX_AXES)) {
            let text = axes.iter().map(|a| format!("{a:.3}")).collect::<Vec<_>>().join(",");
            let Some(Place::Machine(back)) = report(&format!("<Run|MPos:{text}|FS:500,0>")).place else { panic!() };
            prop_assert_eq!(back.len(), axes.len());
            prop_assert!(back.iter().zip(&axes).all(|(a, b)| (a - b).abs() < 6e-4));
        }

        #[test]
        fn targets_come_back(units in -1e4..1e4_f64, feed in 1.0..1e5_f64) {
            let line = move_line(Axis::B, units, feed);
            let (place, rate) = line.trim().split_once('B').unwrap().1.split_once('F').unwrap();
            prop_assert!((place.parse::<f64>().unwrap() - units).abs() < 6e-5);
            prop_assert!((rate.parse::<f64>().unwrap() - feed).abs() < 0.06);
            prop_assert!(line.len() < 80, "GRBL takes no longer lines");
        }

        #[test]
        fn codes_come_back(code: u8) {
            prop_assert_eq!(parse(format!("error:{code}").as_bytes()), Some(Line::Error(code)));
            prop_assert_eq!(parse(format!("ALARM:{code}").as_bytes()), Some(Line::Alarm(code)));
            prop_assert!(!error_name(code).is_empty() && !alarm_name(code).is_empty());
        }

        #[test]
        fn no_bytes_are_too_strange(line in prop::collection::vec(any::<u8>(), 0..100)) {
            parse(&line);
        }
    }
}

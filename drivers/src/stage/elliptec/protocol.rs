//! Messages of Thorlabs' Elliptec modules: an address, two letters, and data in hexadecimal digits.
//!
//! Requests use lower-case letters, replies upper-case ones. Positions are encoder pulses, 32 bits in two's complement.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Address of a module on its bus: a hexadecimal digit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "char", into = "char")]
#[schemars(with = "char")]
pub struct Address(u8);

impl TryFrom<char> for Address {
    type Error = String;

    fn try_from(digit: char) -> Result<Self, String> {
        let value = digit.to_digit(16).and_then(|d| u8::try_from(d).ok());
        value.map(Self).ok_or_else(|| format!("{digit:?} is no address; give 0 to 9 or A to F"))
    }
}

impl From<Address> for char {
    fn from(address: Address) -> Self {
        char::from_digit(u32::from(address.0), 16).unwrap_or('0').to_ascii_uppercase()
    }
}

/// Commands of a module.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Report the identity.
    Identity,
    /// Report the status, which clears it.
    Status,
    /// Find the zero; a rotary module turns clockwise.
    Home,
    /// Move to a position in pulses from zero.
    MoveTo(i32),
    /// Report the position in pulses from zero.
    Position,
    /// Search for the best frequency of motor 1 or 2.
    SearchFrequency(Motor),
    /// Run back and forth to clean the track.
    Clean,
    /// End cleaning or continuous motion, but not a move to a position.
    Stop,
}

/// One of a module's motors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motor {
    /// The first.
    One,
    /// The second.
    Two,
}

impl Command {
    /// Encodes the request.
    pub fn encode(self, address: Address) -> Vec<u8> {
        let text = match self {
            Self::Identity => "in".to_owned(),
            Self::Status => "gs".into(),
            Self::Home => "ho0".into(),
            Self::MoveTo(pulses) => format!("ma{pulses:08X}"),
            Self::Position => "gp".into(),
            Self::SearchFrequency(Motor::One) => "s1".into(),
            Self::SearchFrequency(Motor::Two) => "s2".into(),
            Self::Clean => "cm".into(),
            Self::Stop => "st".into(),
        };
        format!("{}{text}", char::from(address)).into_bytes()
    }
}

/// Replies of a module.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reply {
    /// Identity.
    Identity(Identity),
    /// Status.
    Status(Status),
    /// Position in pulses; after a move it also signals the end.
    Position(i32),
    /// A reply to another program's request.
    Other,
}

/// Identity reported by a module.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Type number: 14 for the ELL14.
    pub kind: u8,
    /// Serial number.
    pub serial: String,
    /// Year of manufacture.
    pub year: String,
    /// Travel in degrees, or in mm.
    pub travel: u16,
    /// Pulses of the encoder per turn, or per mm.
    pub pulses: u32,
}

impl Identity {
    /// Catalogue name.
    pub fn name(&self) -> String {
        format!("ELL{}", self.kind)
    }

    /// Description of a module that is not a rotation stage; `None` for a rotation stage.
    pub fn not_rotary(&self) -> Option<&'static str> {
        match self.kind {
            8 | 14 | 16 | 18 | 21 if self.travel == 360 && self.pulses > 0 => None,
            6 => Some("a shutter of two positions"),
            7 | 10 | 17 | 20 => Some("a linear stage"),
            9 => Some("a slider of four positions"),
            12 => Some("a slider of six positions"),
            15 => Some("an iris"),
            _ => Some("no rotation stage that is known"),
        }
    }
}

/// Status of a module: a number, not a bit mask.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(missing_docs, reason = "named as in the protocol")]
pub enum Status {
    Ok,
    CommunicationTimeout,
    MechanicalTimeout,
    CommandError,
    OutOfRange,
    Isolated,
    OutOfIsolation,
    Initialising,
    Thermal,
    Busy,
    Sensor,
    Motor,
    OutOfTravel,
    OverCurrent,
    /// A number without a documented meaning.
    Reserved(u8),
}

impl Status {
    /// Status of a code.
    pub fn of(code: u8) -> Self {
        match code {
            0 => Self::Ok,
            1 => Self::CommunicationTimeout,
            2 => Self::MechanicalTimeout,
            3 => Self::CommandError,
            4 => Self::OutOfRange,
            5 => Self::Isolated,
            6 => Self::OutOfIsolation,
            7 => Self::Initialising,
            8 => Self::Thermal,
            9 => Self::Busy,
            10 => Self::Sensor,
            11 => Self::Motor,
            12 => Self::OutOfTravel,
            13 => Self::OverCurrent,
            other => Self::Reserved(other),
        }
    }

    /// Code of the status.
    pub fn code(self) -> u8 {
        match self {
            Self::Ok => 0,
            Self::CommunicationTimeout => 1,
            Self::MechanicalTimeout => 2,
            Self::CommandError => 3,
            Self::OutOfRange => 4,
            Self::Isolated => 5,
            Self::OutOfIsolation => 6,
            Self::Initialising => 7,
            Self::Thermal => 8,
            Self::Busy => 9,
            Self::Sensor => 10,
            Self::Motor => 11,
            Self::OutOfTravel => 12,
            Self::OverCurrent => 13,
            Self::Reserved(code) => code,
        }
    }

    /// Meaning of the status.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::CommunicationTimeout => "communication timeout",
            Self::MechanicalTimeout => "mechanical timeout",
            Self::CommandError => "command error",
            Self::OutOfRange => "value out of range",
            Self::Isolated => "module isolated",
            Self::OutOfIsolation => "module out of isolation",
            Self::Initialising => "initialising",
            Self::Thermal => "thermal error",
            Self::Busy => "busy",
            Self::Sensor => "sensor error",
            Self::Motor => "motor error",
            Self::OutOfTravel => "out of travel",
            Self::OverCurrent => "over-current error",
            Self::Reserved(_) => "a reserved code",
        }
    }
}

/// Parses a line without its terminator; `None` if it is not a valid reply.
pub fn parse(line: &[u8]) -> Option<(Address, Reply)> {
    let text = std::str::from_utf8(line).ok().filter(|t| t.is_ascii())?;
    let address = Address::try_from(text.chars().next()?).ok()?;
    let reply = match (text.get(1..3)?, text.get(3..)?) {
        ("IN", data) => Reply::Identity(identity(data)?),
        ("GS", data) => Reply::Status(Status::of(u8::try_from(hex(data, 2)?).ok()?)),
        // Two's complement: the same 32 bits, signed.
        ("PO", data) => Reply::Position(hex(data, 8)?.cast_signed()),
        (letters, _) if letters.bytes().all(|b| b.is_ascii_uppercase() || b.is_ascii_digit()) => Reply::Other,
        _ => return None,
    };
    Some((address, reply))
}

/// Type, serial number, year, two versions, travel, pulses.
fn identity(data: &str) -> Option<Identity> {
    if data.len() != 30 || !data.bytes().all(|b| b.is_ascii_alphanumeric()) {
        return None;
    }
    Some(Identity {
        kind: u8::try_from(hex(data.get(..2)?, 2)?).ok()?,
        serial: data.get(2..10)?.to_owned(),
        year: data.get(10..14)?.to_owned(),
        travel: u16::try_from(hex(data.get(18..22)?, 4)?).ok()?,
        pulses: hex(data.get(22..)?, 8)?,
    })
}

/// Parses exactly this number of hexadecimal digits.
fn hex(data: &str, digits: usize) -> Option<u32> {
    let sane = data.len() == digits && data.bytes().all(|b| b.is_ascii_hexdigit());
    if sane { u32::from_str_radix(data, 16).ok() } else { None }
}

/// Pulses at an angle; `None` beyond 32 bits.
pub fn pulses(angle_deg: f64, pulses_per_turn: u32) -> Option<i32> {
    let pulses = (angle_deg / 360.0 * f64::from(pulses_per_turn)).round();
    (pulses >= f64::from(i32::MIN) && pulses <= f64::from(i32::MAX)).then_some(pulses as i32)
}

/// Angle in degrees of a position in pulses.
pub fn degrees(pulses: i32, pulses_per_turn: u32) -> f64 {
    f64::from(pulses) * 360.0 / f64::from(pulses_per_turn.max(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn address(digit: char) -> Address {
        Address::try_from(digit).unwrap()
    }

    #[test]
    fn an_identity_is_read() {
        let (from, reply) = parse(b"2IN0E1140051720231701016800023000").unwrap();
        let expected =
            Identity { kind: 0x0e, serial: "11400517".into(), year: "2023".into(), travel: 360, pulses: 143_360 };
        assert_eq!((char::from(from), &reply), ('2', &Reply::Identity(expected.clone())));
        assert_eq!((expected.name().as_str(), expected.not_rotary()), ("ELL14", None));
    }

    #[test]
    fn requests_are_as_in_the_protocol() {
        let text = |command: Command, digit| String::from_utf8(command.encode(address(digit))).unwrap();
        assert_eq!(text(Command::MoveTo(143_360 / 8), '0'), "0ma00004600");
        assert_eq!(text(Command::MoveTo(-1), 'a'), "AmaFFFFFFFF");
        assert_eq!(text(Command::Home, 'F'), "Fho0");
        assert_eq!(text(Command::SearchFrequency(Motor::Two), '1'), "1s2");
    }

    #[test]
    fn truncated_or_corrupt_replies_are_refused() {
        let bent =
            ["", "0", "0P", "0PO", "0PO0000460", "0PO000046000", "0PO0000460G", "0GS", "0GS0", "0GS-1", "GPO00000000"];
        for line in bent.into_iter().chain(["0in", "0gs", "0IN0E11400517", "0PO0000°0", "0PO+0000460"]) {
            assert_eq!(parse(line.as_bytes()), None, "{line}");
        }
    }

    /// Case found by fuzzing.
    #[test]
    fn the_lowest_position_has_an_angle_and_comes_back() {
        let (_, reply) = parse(b"0PO80000000").unwrap();
        assert_eq!(reply, Reply::Position(i32::MIN));
        assert_eq!(pulses(degrees(i32::MIN, 143_360), 143_360), Some(i32::MIN));
        assert_eq!([1e9, f64::NAN].map(|angle| pulses(angle, 143_360)), [None; 2]);
    }

    #[test]
    fn each_status_has_its_number_and_only_one_is_ok() {
        for code in 0..=u8::MAX {
            let status = Status::of(code);
            assert_eq!((status.code(), status == Status::Ok), (code, code == 0));
        }
    }

    proptest! {
        #[test]
        fn positions_come_back_as_they_went(pulses: i32, digit in "[0-9A-F]") {
            let digit = digit.chars().next().unwrap();
            let sent = String::from_utf8(Command::MoveTo(pulses).encode(address(digit))).unwrap();
            let reply = sent.replace("ma", "PO");
            prop_assert_eq!(parse(reply.as_bytes()), Some((address(digit), Reply::Position(pulses))));
        }

        #[test]
        fn identities_come_back(kind: u8, serial in "[0-9]{8}", year in 2000_u16..2100, travel: u16, pulses: u32) {
            let line = format!("7IN{kind:02X}{serial}{year}1701{travel:04X}{pulses:08X}");
            let expected = Identity { kind, serial, year: year.to_string(), travel, pulses };
            prop_assert_eq!(parse(line.as_bytes()), Some((address('7'), Reply::Identity(expected))));
        }

        #[test]
        fn angles_come_back_within_half_a_pulse(angle in -720.0..720.0_f64, per_turn in 1000_u32..1_000_000) {
            let back = degrees(pulses(angle, per_turn).unwrap(), per_turn);
            prop_assert!((back - angle).abs() <= 180.0 / f64::from(per_turn) + 1e-9);
        }

        #[test]
        fn no_bytes_are_too_strange(line in prop::collection::vec(any::<u8>(), 0..60)) {
            parse(&line);
        }

        #[test]
        fn addresses_come_back(digit in "[0-9A-F]") {
            let digit = digit.chars().next().unwrap();
            prop_assert_eq!(char::from(address(digit)), digit);
        }
    }
}

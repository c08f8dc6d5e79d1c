//! Frames of 8 bytes in both directions.
//!
//! Request:
//! - byte 0: `0x4e`
//! - byte 1: sequence number
//! - byte 2: command: 1 STATE, 2 ON, 3 OFF
//! - bytes 3-4: for ON, the time limit in steps of 10 ms, after which the device switches off unless it receives
//!   another ON; otherwise 0
//! - bytes 5-6: 0
//! - byte 7: CRC-8 of bytes 0 to 6
//!
//! Answer:
//! - byte 0: `0x6e`
//! - bytes 1 and 2: those of the request
//! - byte 3: 0 done, 1 unknown command, 2 refused (too hot, lid open), 3 busy
//! - byte 4: 1 while the light is on, otherwise 0
//! - bytes 5-6: remaining time limit in steps of 10 ms; 0 if the light is off
//! - byte 7: CRC-8 of bytes 0 to 6
//!
//! Numbers are little endian. The CRC has the polynomial x⁸+x²+x+1, starts at 0 and is not reflected. The state in an
//! answer is measured at the lamp (its current), not copied from the command.

/// Length of a frame.
pub const LENGTH: usize = 8;

const REQUEST: u8 = 0x4e;
const ANSWER: u8 = 0x6e;

/// Commands of the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Report the state.
    State,
    /// Switch on, with a time limit in steps of 10 ms.
    On(u16),
    /// Switch off.
    Off,
}

/// Content of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answer {
    /// Sequence number of the request.
    pub sequence: u8,
    /// Command of the request.
    pub command: u8,
    /// Status of the request.
    pub status: Status,
    /// Whether the light is on.
    pub on: bool,
    /// Remaining time limit in steps of 10 ms.
    pub left: u16,
}

/// Status of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Executed.
    Done,
    /// Unknown command.
    Unknown,
    /// Not permitted at present.
    Refused,
    /// The device is busy.
    Busy,
}

impl Command {
    /// Number of the command.
    pub fn number(self) -> u8 {
        match self {
            Self::State => 1,
            Self::On(_) => 2,
            Self::Off => 3,
        }
    }
}

/// Encodes a request.
pub fn request(sequence: u8, command: Command) -> [u8; LENGTH] {
    let [low, high] = match command {
        Command::On(steps) => steps.to_le_bytes(),
        Command::State | Command::Off => [0; 2],
    };
    let body = [REQUEST, sequence, command.number(), low, high, 0, 0];
    let mut frame = [0; LENGTH];
    frame[..7].copy_from_slice(&body);
    frame[7] = crc(&body);
    frame
}

/// Decodes an answer; `None` for an invalid frame.
pub fn answer(frame: &[u8]) -> Option<Answer> {
    let [ANSWER, sequence, command, status, on @ 0..=1, low, high, sum] = *frame else { return None };
    let status = match status {
        0 => Status::Done,
        1 => Status::Unknown,
        2 => Status::Refused,
        3 => Status::Busy,
        _ => return None,
    };
    let left = u16::from_le_bytes([low, high]);
    (sum == crc(&frame[..7])).then_some(Answer { sequence, command, status, on: on == 1, left })
}

/// CRC-8 with the polynomial 0x07.
pub fn crc(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |crc, byte| {
        (0..8).fold(crc ^ byte, |crc: u8, _| if crc & 0x80 == 0 { crc << 1 } else { crc << 1 ^ 0x07 })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn frames_are_those_of_the_protocol() {
        assert_eq!(crc(b"123456789"), 0xf4, "the check value of this CRC");
        let frame = request(5, Command::On(1050));
        assert_eq!(frame[..7], [0x4e, 5, 2, 0x1a, 0x04, 0, 0]);
        assert_eq!(frame[7], crc(&frame[..7]));
    }

    proptest! {
        #[test]
        fn any_bytes_are_read(frame in proptest::collection::vec(any::<u8>(), 0..20)) {
            answer(&frame);
        }

        #[test]
        fn answers_repeat_the_written_values(sequence: u8, command: u8, on: bool, left: u16, status in 0u8..4) {
            let [low, high] = left.to_le_bytes();
            let mut frame = vec![0x6e, sequence, command, status, u8::from(on), low, high];
            frame.push(crc(&frame));
            let read = answer(&frame).unwrap();
            prop_assert_eq!((read.sequence, read.command, read.on, read.left), (sequence, command, on, left));
            prop_assert_eq!(read.status == Status::Done, status == 0);
        }

        #[test]
        fn a_flipped_bit_is_found(sequence: u8, on: bool, left: u16, bit in 0usize..64) {
            let [low, high] = left.to_le_bytes();
            let mut frame = vec![0x6e, sequence, 1, 0, u8::from(on), low, high];
            frame.push(crc(&frame));
            frame[bit / 8] ^= 1 << (bit % 8);
            prop_assert_eq!(answer(&frame), None);
        }

        #[test]
        fn requests_differ_from_answers(sequence: u8, steps: u16) {
            prop_assert_eq!(answer(&request(sequence, Command::On(steps))), None);
        }
    }
}

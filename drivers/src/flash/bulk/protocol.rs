//! Frames of 8 bytes in both directions.
//!
//! | byte | request | answer |
//! |---|---|---|
//! | 0 | `0x4e` | `0x6e` |
//! | 1 | sequence number | that of the request |
//! | 2 | command: 1 STATE, 2 ON, 3 OFF | that of the request |
//! | 3-4 | ON: after so many steps of 10 ms without another ON the device switches off by itself; else 0 | byte 3: 0 done, 1 unknown command, 2 refused (too hot, lid open), 3 busy; byte 4: 1 while the light is on, else 0 |
//! | 5-6 | 0 | steps of 10 ms until it switches off by itself; 0 when it is off |
//! | 7 | CRC-8 of bytes 0 to 6 | the same |
//!
//! Numbers have their low byte first. The CRC has the polynomial x⁸+x²+x+1, starts at 0 and is not reflected. The state in
//! an answer is measured at the lamp (its current), not what was commanded.

/// Length of a frame.
pub const LENGTH: usize = 8;

const REQUEST: u8 = 0x4e;
const ANSWER: u8 = 0x6e;

/// What the device can be asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Report the state.
    State,
    /// Switch on, for so many steps of 10 ms at most.
    On(u16),
    /// Switch off.
    Off,
}

/// What an answer says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Answer {
    /// Sequence number of the request.
    pub sequence: u8,
    /// Command of the request.
    pub command: u8,
    /// How it went.
    pub status: Status,
    /// The light is on.
    pub on: bool,
    /// Steps of 10 ms until it switches off by itself.
    pub left: u16,
}

/// How a request went.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// Carried out.
    Done,
    /// It does not know the command.
    Unknown,
    /// It must not be done now.
    Refused,
    /// It is busy.
    Busy,
}

impl Command {
    /// The command's number.
    pub fn number(self) -> u8 {
        match self {
            Self::State => 1,
            Self::On(_) => 2,
            Self::Off => 3,
        }
    }
}

/// A request's frame.
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

/// Reads an answer; None when it is none.
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
        fn answers_say_what_was_written(sequence: u8, command: u8, on: bool, left: u16, status in 0u8..4) {
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

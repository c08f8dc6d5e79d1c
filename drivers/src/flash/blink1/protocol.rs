//! Reports of the blink(1): feature report 1 of 8 bytes, with a command letter and six arguments.

/// Report ID.
pub const REPORT: u8 = 1;

/// Length of the report, including its ID.
pub const LENGTH: usize = 8;

/// Number of lines of the stored pattern.
pub const PATTERN_LINES: u8 = 16;

/// A feature report.
pub type Report = [u8; LENGTH];

fn report(command: u8, arguments: [u8; 6]) -> Report {
    let [a, b, c, d, e, f] = arguments;
    [REPORT, command, a, b, c, d, e, f]
}

/// Shows a colour immediately.
pub fn set([r, g, b]: [u8; 3]) -> Report {
    report(b'n', [r, g, b, 0, 0, 0])
}

/// Requests the colour; the next report read contains it.
pub fn ask_colour() -> Report {
    report(b'r', [0; 6])
}

/// Requests the version; the next report read contains it.
pub fn ask_version() -> Report {
    report(b'v', [0; 6])
}

/// Starts the watchdog: the light goes off after this time without a command.
pub fn watch(time_ms: u64) -> Report {
    let [high, low] = ticks(time_ms);
    report(b'D', [1, high, low, 0, 0, 0])
}

/// Cancels the watchdog.
pub fn unwatch() -> Report {
    report(b'D', [0; 6])
}

/// Stops playing a pattern.
pub fn stop_playing() -> Report {
    report(b'p', [0; 6])
}

/// Overwrites a line of the pattern with black. Old firmware plays the pattern when its watchdog expires.
pub fn black_line(line: u8) -> Report {
    report(b'P', [0, 0, 0, 0, 1, line])
}

/// Time in steps of 10 ms, at least one, clamped to the maximum.
fn ticks(time_ms: u64) -> [u8; 2] {
    u16::try_from(time_ms.div_ceil(10).max(1)).unwrap_or(u16::MAX).to_be_bytes()
}

/// Colour in an answer to [`ask_colour`]; `None` for other reports.
pub fn colour(report: &[u8]) -> Option<[u8; 3]> {
    match *report {
        [REPORT, b'r', r, g, b, _, _, _, ..] => Some([r, g, b]),
        _ => None,
    }
}

/// Major and minor version in an answer to [`ask_version`]; `None` for other reports.
pub fn version(report: &[u8]) -> Option<[u8; 2]> {
    match *report {
        [REPORT, b'v', _, major @ b'0'..=b'9', minor @ b'0'..=b'9', _, _, _, ..] => Some([major - b'0', minor - b'0']),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn reports_are_those_of_the_protocol() {
        assert_eq!(set([255, 128, 0]), [1, b'n', 255, 128, 0, 0, 0, 0]);
        assert_eq!(watch(11_000), [1, b'D', 1, 0x04, 0x4c, 0, 0, 0]);
        assert_eq!(unwatch(), [1, b'D', 0, 0, 0, 0, 0, 0]);
        assert_eq!(black_line(3), [1, b'P', 0, 0, 0, 0, 1, 3]);
        assert_eq!(watch(u64::MAX)[3..5], [255, 255]);
        assert_eq!(watch(0)[3..5], [0, 1], "no time at all would be no watch");
        assert_eq!(colour(&[1, b'r', 9, 8, 7, 0, 0, 0]), Some([9, 8, 7]));
        assert_eq!(version(&[1, b'v', 0, b'2', b'6', 0, 0, 0]), Some([2, 6]));
    }

    proptest! {
        #[test]
        fn any_answer_is_read(report in proptest::collection::vec(any::<u8>(), 0..20)) {
            colour(&report);
            version(&report);
        }

        #[test]
        fn times_are_never_shorter_than_asked(ms in 0u64..655_350) {
            let report = watch(ms);
            let reported = u64::from(u16::from_be_bytes([report[3], report[4]])) * 10;
            prop_assert!(reported >= ms && reported <= ms + 10);
        }

        #[test]
        fn only_answers_to_the_question_are_taken(report in proptest::array::uniform8(any::<u8>())) {
            prop_assert_eq!(colour(&report).is_some(), report[..2] == [1, b'r']);
        }
    }
}

//! Reports of the relay.

/// Maximum number of channels of this kind of relay.
pub const MAX_CHANNELS: u8 = 8;

/// ID of the feature report with serial number and state.
pub const STATUS_REPORT: u8 = 1;

/// Length of the status report.
pub const STATUS_LENGTH: usize = 8;

/// Serial number of a relay without one in its memory (all bytes 0 or FF). Such a relay works normally.
pub const UNREADABLE: &str = "unreadable";

const ON: u8 = 0xff;
const OFF: u8 = 0xfd;

/// Content of the status report.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Status {
    /// Serial number: five letters or digits, or [`UNREADABLE`].
    pub serial: String,
    /// Bit mask of the channels that are on: bit 0 for channel 1.
    pub on: u8,
}

/// The output report that switches one channel, counted from 1.
pub fn switch(channel: u8, on: bool) -> [u8; 9] {
    [0, if on { ON } else { OFF }, channel, 0, 0, 0, 0, 0, 0]
}

/// The output report that switches one channel, counted from 1, of a relay without a status report.
pub fn switch_blind(channel: u8, on: bool) -> [u8; 9] {
    let command = if on { 0xf0 } else { 0x00 } | channel & 0x0f;
    [0, command, 0, 0, 0, 0, 0, 0, 0]
}

/// Parses a status report; `None` if it is invalid. The serial number replaces the report ID.
pub fn status(report: &[u8]) -> Option<Status> {
    let [serial @ .., 0, _, on] = <&[u8; STATUS_LENGTH]>::try_from(report).ok()? else { return None };
    let erased = [0, 0xff].iter().any(|erased| serial.iter().all(|b| b == erased));
    let serial = match erased {
        true => UNREADABLE.to_owned(),
        false if serial.iter().all(u8::is_ascii_graphic) => serial.iter().map(|b| char::from(*b)).collect(),
        false => return None,
    };
    Some(Status { serial, on: *on })
}

impl Status {
    /// Whether a channel, counted from 1, is on.
    pub fn is_on(&self, channel: u8) -> bool {
        (1..=MAX_CHANNELS).contains(&channel) && self.on >> (channel - 1) & 1 == 1
    }
}

/// Number of channels from a relay's name, such as `USBRelay2`.
pub fn channels(name: &str) -> Option<u8> {
    let (_, number) = name.split_once("USBRelay")?;
    number.trim().parse().ok().filter(|n| (1..=MAX_CHANNELS).contains(n))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn reports_are_those_of_the_protocol() {
        assert_eq!(switch(1, true), [0, 0xff, 1, 0, 0, 0, 0, 0, 0]);
        assert_eq!(switch(2, false), [0, 0xfd, 2, 0, 0, 0, 0, 0, 0]);
        let status = status(b"BITFT\0\0\x02").unwrap();
        assert_eq!((status.serial.as_str(), status.is_on(1), status.is_on(2)), ("BITFT", false, true));
        assert_eq!(channels("www.dcttech.com USBRelay2"), Some(2));
        assert_eq!(channels("USBRelay99"), None);
        assert_eq!(switch_blind(1, true)[..2], [0, 0xf1]);
        assert_eq!(switch_blind(9, false)[..2], [0, 0x09]);
    }

    #[test]
    fn erased_serial_numbers_are_unreadable() {
        for erased in [0, 0xff] {
            let report = [erased, erased, erased, erased, erased, 0, 0, 1];
            assert_eq!(status(&report), Some(Status { serial: UNREADABLE.into(), on: 1 }));
        }
        assert_eq!(status(&[0xff, 0xff, 0xff, 0xff, 0, 0, 0, 1]), None);
    }

    #[test]
    fn reports_of_other_devices_are_none() {
        let others: [&[u8]; 5] = [b"", b"BITFT\0\0", b"BITFT\0\0\0\0", b"BIT T\0\0\0", b"BITFT\x01\0\0"];
        assert!(others.iter().all(|report| status(report).is_none()));
        let none = Status { serial: String::new(), on: 0xff };
        assert!(!none.is_on(0) && !none.is_on(9));
    }

    proptest! {
        #[test]
        fn any_report_is_read(report in proptest::collection::vec(any::<u8>(), 0..20), channel: u8) {
            if let Some(status) = status(&report) {
                status.is_on(channel);
            }
        }

        #[test]
        fn channels_that_are_on_are_read(serial in "[A-Z0-9]{5}", on: u8, channel in 1u8..=8) {
            let mut report = serial.as_bytes().to_vec();
            report.extend([0, 0, on]);
            let status = status(&report).unwrap();
            prop_assert_eq!(&status.serial, &serial);
            prop_assert_eq!(status.is_on(channel), on & (1 << (channel - 1)) != 0);
        }

        #[test]
        fn only_one_channel_is_named(channel in 1u8..=8, on: bool) {
            let report = switch(channel, on);
            prop_assert_eq!((report[2], report[1] == 0xff), (channel, on));
        }
    }
}

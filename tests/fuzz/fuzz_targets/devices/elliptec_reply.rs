//! Replies of Elliptec modules.

#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::stage::elliptec::protocol::{Reply, degrees, parse, pulses};

fuzz_target!(|line: &[u8]| {
    match parse(line) {
        Some((_, Reply::Position(at))) => assert_eq!(pulses(degrees(at, 143_360), 143_360), Some(at)),
        Some((_, Reply::Identity(identity))) => {
            assert!(identity.name().starts_with("ELL"));
            assert!(identity.not_rotary().is_some() || identity.pulses > 0);
        }
        Some((_, Reply::Status(status))) => assert_eq!(line.get(1..3), Some(&b"GS"[..]), "{}", status.name()),
        _ => {}
    }
});

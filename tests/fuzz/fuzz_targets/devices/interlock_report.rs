//! A feature report with the bit of an interlock, after its number, byte and bit.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::interlock::report::level;

fuzz_target!(|bytes: &[u8]| {
    if let Some((&[number, low, high, bit], report)) = bytes.split_first_chunk() {
        let _ = level(report, number, u16::from_le_bytes([low, high]), bit);
    }
});

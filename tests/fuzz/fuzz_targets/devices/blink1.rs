//! A blink(1)'s answers.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::flash::blink1::protocol;

fuzz_target!(|report: &[u8]| {
    protocol::colour(report);
    protocol::version(report);
});

//! Answers of a flash with bulk transfers.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::flash::bulk::protocol;

fuzz_target!(|frame: &[u8]| {
    protocol::answer(frame);
});

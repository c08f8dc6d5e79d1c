//! What monitors say of themselves.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::display::edid;

fuzz_target!(|bytes: &[u8]| {
    let _ = edid::parse(bytes);
});

//! Photographs of any format, detected by content.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| nacre_fuzz::photograph(&nacre_fuzz::file("photograph", bytes)));

//! Kernel descriptions of HID devices, with names chosen by the devices.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::discovery::uevent;

fuzz_target!(|bytes: &[u8]| {
    uevent::parse(&String::from_utf8_lossy(bytes));
});

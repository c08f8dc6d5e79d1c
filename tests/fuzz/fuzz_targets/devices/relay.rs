//! A relay's report of its state, and its name.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::flash::relay::protocol;

fuzz_target!(|report: &[u8]| {
    if let Some(status) = protocol::status(report) {
        for channel in 0..=u8::MAX {
            let _ = status.is_on(channel);
        }
    }
    protocol::channels(&String::from_utf8_lossy(report));
});

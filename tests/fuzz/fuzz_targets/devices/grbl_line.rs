//! Lines of GRBL controllers.

#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::stage::grbl::protocol::{Line, Place, alarm_name, error_name, parse};

fuzz_target!(|line: &[u8]| {
    match parse(line) {
        Some(Line::Report(report)) => {
            let axes = match report.place {
                Some(Place::Machine(axes) | Place::Work(axes)) => axes,
                None => vec![],
            };
            let numbers = axes.iter().chain(report.offset.iter().flatten());
            assert!(axes.len() <= 6 && numbers.into_iter().all(|n| n.is_finite()));
        }
        Some(Line::Error(code)) => assert!(!error_name(code).is_empty()),
        Some(Line::Alarm(code)) => assert!(!alarm_name(code).is_empty()),
        _ => {}
    }
});

//! Any label of a camera's setting gives a sane value or none, and any message of the library has a cause.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::camera::gphoto2::labels::{self, Speed};
use nacre_drivers::camera::gphoto2::node;
use nacre_drivers::camera::photograph::speed;

fuzz_target!(|input: (i32, f64, &str)| {
    let (code, seconds, label) = input;
    if let Some(Speed::Seconds(seconds)) = labels::speed(label) {
        assert!(seconds > 0.0 && seconds <= 3600.0);
        assert!(!speed(seconds).is_empty());
    }
    assert!(labels::aperture(label).is_none_or(|f| f > 0.0 && f <= 256.0));
    assert!(labels::iso(label).is_none_or(|iso| iso >= 1.0 && iso <= 1e7));
    assert!(labels::battery(label).is_none_or(|percent| (0.0..=100.0).contains(&percent)));
    let _ = (labels::is_manual(label), labels::image_format(label), node::cause(code, label), speed(seconds));
});

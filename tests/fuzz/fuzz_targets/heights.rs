//! Height fields from files of AFMs and profilometers and from text.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_brdf::height::{self, Quality, Scale};

fuzz_target!(|bytes: &[u8]| {
    let path = nacre_fuzz::file("heights", bytes);
    for scale in [
        Scale::default(),
        Scale { pixel_um: Some(0.1), range_um: Some(0.2), channel: None, fill_gaps: Some(0.3) },
        Scale { channel: Some("2".into()), ..Scale::default() },
    ] {
        if let Ok(field) = height::read(&path, &scale) {
            assert_eq!(field.um.len(), field.width * field.height);
            assert!(field.um.iter().all(|h| h.is_finite()));
            let _ = Quality::of(&field, 1.0);
        }
    }
});

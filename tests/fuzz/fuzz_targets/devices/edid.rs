//! Any bytes are parsed as an EDID or rejected.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::display::edid;

fuzz_target!(|bytes: &[u8]| {
    let mut sealed = bytes.to_vec();
    if let Some(block) = sealed.first_chunk_mut::<{ edid::BLOCK }>() {
        // Valid header and checksum, which random inputs would not hit.
        block[..8].copy_from_slice(&[0, 255, 255, 255, 255, 255, 255, 0]);
        block[127] = block[..127].iter().fold(0u8, |sum, b| sum.wrapping_sub(*b));
    }
    for bytes in [bytes, sealed.as_slice()] {
        if let Ok(edid) = edid::parse(bytes) {
            assert!(edid.id().is_ascii());
        }
    }
});

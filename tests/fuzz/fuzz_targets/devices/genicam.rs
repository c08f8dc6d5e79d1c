//! Any payload of any PFNC format is unpacked to one code per pixel, or rejected; any answer of a camera is read.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::camera::pfnc::{CODES, Packing, Picture, PixelFormat};
use nacre_drivers::discovery::gvcp;

fuzz_target!(|input: (u8, u8, u8, u8, &str, &[u8])| {
    let (format, width, height, padding, name, payload) = input;
    let [width, height, padding] = [width, height, padding].map(usize::from);
    let known = CODES[usize::from(format) % CODES.len()].0;
    for format in [PixelFormat::named(known), PixelFormat::named(name)].into_iter().flatten() {
        let picture = Picture { format, width, height, padding };
        if let Ok(codes) = picture.unpack(payload) {
            assert_eq!(codes.len(), width * height);
            assert!(format.packing == Packing::Whole || codes.iter().all(|code| *code <= format.white()));
        }
    }
    let _ = gvcp::register(payload, 1);
});

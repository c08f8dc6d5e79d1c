//! Any payload of any format is unpacked to one code per pixel, or rejected.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::camera::v4l2::pixels::{FORMATS, Picture};

fuzz_target!(|input: (u8, u8, u8, u16, &[u8])| {
    let (format, width, height, stride, payload) = input;
    let [width, height] = [width, height].map(usize::from);
    let picture =
        Picture { format: FORMATS[usize::from(format) % FORMATS.len()], width, height, stride: stride.into() };
    if let Ok(codes) = picture.unpack(payload) {
        assert_eq!(codes.len(), width * height);
    }
});

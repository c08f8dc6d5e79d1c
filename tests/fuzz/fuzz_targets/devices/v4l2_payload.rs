//! Any payload of any format, with any header before it, is unpacked to one code per pixel, or rejected.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::camera::v4l2::formats::FORMATS;
use nacre_drivers::camera::v4l2::node::plane_payload;
use nacre_drivers::camera::v4l2::pixels::Picture;

fuzz_target!(|input: (u8, u8, u8, u16, u32, u32, &[u8])| {
    let (format, width, height, stride, used, offset, memory) = input;
    let [width, height] = [width, height].map(usize::from);
    let picture =
        Picture { format: FORMATS[usize::from(format) % FORMATS.len()], width, height, stride: stride.into() };
    for payload in [memory, plane_payload(memory, used, offset)] {
        if let Ok(codes) = picture.unpack(payload) {
            assert_eq!(codes.len(), width * height);
        }
    }
});

//! TIFF files of both byte orders, as photographs and as height fields; the first byte selects the order.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_brdf::height::{self, Scale};

const MARKS: [&[u8]; 4] = [b"II\x2a\0", b"MM\0\x2a", b"II\x2b\0", b"MM\0\x2b"];

fuzz_target!(|bytes: &[u8]| {
    let Some((choice, bytes)) = bytes.split_first() else { return };
    let mark = MARKS[usize::from(*choice) % MARKS.len()];
    let path = nacre_fuzz::file("photograph.tif", &[mark, bytes].concat());
    nacre_fuzz::photograph(&path);
    let scale = Scale { pixel_um: Some(0.1), range_um: Some(0.1), ..Scale::default() };
    let _ = height::read(&path, &scale);
});

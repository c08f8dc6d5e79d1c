//! Exif tags in the segment of a JPEG.
#![no_main]

use libfuzzer_sys::fuzz_target;

fuzz_target!(|tags: &[u8]| {
    let size = (tags.len() + 8).min(0xffff) as u16;
    let jpeg = [b"\xff\xd8\xff\xe1", &size.to_be_bytes()[..], b"Exif\0\0", tags, b"\xff\xd9"].concat();
    let path = nacre_fuzz::file("photograph.jpg", &jpeg);
    let _ = nacre_image::exposure(&path);
    let _ = nacre_image::origin(&path);
    let _ = nacre_image::details(&path);
});

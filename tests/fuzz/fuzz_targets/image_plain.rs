//! Formats with parsers in this project; the first byte selects one, so that mutations do not change the format.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_render::environment::Environment;

const MARKS: [&[u8]; 5] = [b"#?", b"BM", b"SIMPLE  =", b"\x93NUMPY", b""];

fuzz_target!(|bytes: &[u8]| {
    let Some((choice, bytes)) = bytes.split_first() else { return };
    let mark = MARKS[usize::from(*choice) % MARKS.len()];
    let path = nacre_fuzz::file("photograph", &[mark, bytes].concat());
    nacre_fuzz::photograph(&path);
    if mark == b"#?" {
        let _ = Environment::read(&path, None);
    }
});

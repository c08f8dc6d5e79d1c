//! Camera raw files, decoded in this process; the first byte selects the format.
#![no_main]

use libfuzzer_sys::fuzz_target;

const MARKS: [&[u8]; 8] = [
    b"II\x2a\0",
    b"MM\0\x2a",
    b"II\x2a\0\x10\0\0\0CR\x02",
    b"IIRO",
    b"MMOR",
    b"II\x55\0",
    b"\0\0\0\x18ftypcrx ",
    b"FUJIFILMCCD-RAW",
];

fuzz_target!(|bytes: &[u8]| {
    let Some((choice, bytes)) = bytes.split_first() else { return };
    let mark = MARKS[usize::from(*choice) % MARKS.len()];
    nacre_fuzz::photograph(&nacre_fuzz::file("photograph.dng", &[mark, bytes].concat()));
});

//! Bytes split into lines. The first byte determines how the rest is fragmented, which must not change the result.

#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::wire::LineBuffer;

fn lines(buffer: &mut LineBuffer) -> Vec<Vec<u8>> {
    std::iter::from_fn(|| buffer.pop()).collect()
}

fuzz_target!(|bytes: &[u8]| {
    let Some((size, bytes)) = bytes.split_first() else { return };
    let (mut whole, mut pieces) = (LineBuffer::new(b"\r\n"), LineBuffer::new(b"\r\n"));
    whole.push(bytes);
    bytes.chunks(usize::from(*size).max(1)).for_each(|piece| pieces.push(piece));
    let found = lines(&mut whole);
    assert_eq!(found, lines(&mut pieces));
    assert!(found.iter().all(|line| !line.is_empty() && line.len() <= 256 && !line.contains(&b'\n')));
});

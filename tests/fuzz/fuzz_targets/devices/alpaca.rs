//! Any answer of an Alpaca server is read or refused: HTTP, lists of devices, pictures and datagrams.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::alpaca::image_bytes::{self, Image};
use nacre_drivers::alpaca::{client, discovery, http};
use std::io::Cursor;

const MOST: usize = 4096;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(answer) = http::read_answer(&mut Cursor::new(bytes), MOST) {
        assert!(answer.body.len() <= MOST);
        let _ = client::read_list(&answer.body);
    }
    let _ = client::read_list(bytes);
    let _ = discovery::port(bytes);
    if let Ok(Image::Plane { width, height, codes }) = image_bytes::read(bytes) {
        assert_eq!(codes.len(), width * height);
    }
});

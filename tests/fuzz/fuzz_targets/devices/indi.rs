//! Any messages of an INDI server are read or refused, also in pieces, and so are its pictures.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::indi::camera::decode;
use nacre_drivers::indi::fits;
use nacre_drivers::indi::property::Properties;
use nacre_drivers::indi::xml::{Element, Reader};

/// Largest file of a picture.
const MOST: usize = 64 * 1024;

fn elements(pieces: &[&[u8]]) -> Option<Vec<Element>> {
    let mut reader = Reader::default();
    for piece in pieces {
        reader.push(piece).ok()?;
    }
    Some(std::iter::from_fn(|| reader.next_element()).collect())
}

fuzz_target!(|input: (u16, &[u8])| {
    let (cut, bytes) = input;
    let (first, second) = bytes.split_at(usize::from(cut).min(bytes.len()));
    let whole = elements(&[bytes]);
    assert_eq!(whole, elements(&[first, second]));
    let device = whole.iter().flatten().find(|e| !e.get("device").is_empty()).map(|e| e.get("device").to_owned());
    let mut known = Properties::new(&device.unwrap_or_default());
    for element in whole.into_iter().flatten() {
        known.take(element);
        if let Some(blob) = &known.blob {
            let _ = decode(blob, MOST);
        }
    }
    if let Ok(image) = fits::read(bytes) {
        assert_eq!(image.codes.len(), image.width * image.height);
    }
});

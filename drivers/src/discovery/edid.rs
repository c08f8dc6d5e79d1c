//! EDID: what a monitor says of itself, in blocks of 128 bytes of which the first is enough here.

/// What a monitor is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Edid {
    /// Three letters of its maker.
    pub maker: String,
    /// Product number.
    pub product: u16,
    /// Serial number, 0 when there is none.
    pub serial: u32,
    /// Its name; empty when it does not say.
    pub name: String,
    /// Its serial number as text; empty when it does not say.
    pub serial_text: String,
    /// Width and height of the picture in mm; None when it does not say (projectors).
    pub size_mm: Option<[u32; 2]>,
    /// Pixels of its preferred mode.
    pub pixels: Option<[u32; 2]>,
}

const MAGIC: [u8; 8] = [0, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0];

/// Where the four descriptors of 18 bytes are.
const DESCRIPTORS: [usize; 4] = [54, 72, 90, 108];

/// Reads an EDID; None when it is none: too short, of another kind or with a wrong sum.
pub fn parse(bytes: &[u8]) -> Option<Edid> {
    let block: &[u8; 128] = bytes.first_chunk()?;
    let sum = block.iter().fold(0u8, |sum, b| sum.wrapping_add(*b));
    if block[..8] != MAGIC || sum != 0 {
        return None;
    }
    let mut edid = Edid {
        maker: maker(u16::from_be_bytes([block[8], block[9]])),
        product: u16::from_le_bytes([block[10], block[11]]),
        serial: u32::from_le_bytes([block[12], block[13], block[14], block[15]]),
        // In whole cm; the preferred mode says it in mm.
        size_mm: known([u32::from(block[21]) * 10, u32::from(block[22]) * 10]),
        ..Edid::default()
    };
    for at in DESCRIPTORS {
        describe(&mut edid, &block[at..at + 18]);
    }
    Some(edid)
}

fn describe(edid: &mut Edid, descriptor: &[u8]) {
    match descriptor {
        [0, 0, 0, 0xfc, _, text @ ..] => edid.name = words(text),
        [0, 0, 0, 0xff, _, text @ ..] => edid.serial_text = words(text),
        [0, 0, ..] => {}
        // The first timing is the preferred one.
        timing if edid.pixels.is_none() => {
            let twelve = |low: usize, high: u8| u32::from(timing[low]) | (u32::from(high) << 8);
            edid.pixels = known([twelve(2, timing[4] >> 4), twelve(5, timing[7] >> 4)]);
            edid.size_mm = known([twelve(12, timing[14] >> 4), twelve(13, timing[14] & 15)]).or(edid.size_mm);
        }
        _ => {}
    }
}

fn known(pair: [u32; 2]) -> Option<[u32; 2]> {
    (pair[0] > 0 && pair[1] > 0).then_some(pair)
}

/// Three letters of five bits each, 1 for A.
fn maker(bits: u16) -> String {
    let letter = |shift: u16| match (bits >> shift) & 31 {
        n @ 1..=26 => char::from(b'A' + n as u8 - 1),
        _ => '?',
    };
    [10, 5, 0].map(letter).iter().collect()
}

/// Text up to the line feed that ends it.
fn words(bytes: &[u8]) -> String {
    let printable = bytes.iter().take_while(|b| **b != b'\n').filter(|b| (b' '..=b'~').contains(*b));
    printable.map(|b| char::from(*b)).collect::<String>().trim().to_owned()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A monitor "Panel 24" by ABC of 527 mm × 296 mm with 1920 × 1080 pixels.
    pub(crate) fn example() -> Vec<u8> {
        let mut block = vec![0u8; 128];
        block[..8].copy_from_slice(&MAGIC);
        block[8..16].copy_from_slice(&[0x04, 0x43, 0x34, 0x12, 7, 0, 0, 0]);
        block[21..23].copy_from_slice(&[53, 30]);
        let timing =
            [0x02, 0x3a, 0x80, 0x18, 0x71, 0x38, 0x2d, 0x40, 0x58, 0x2c, 0x45, 0x00, 0x0f, 0x28, 0x21, 0, 0, 0x1e];
        block[54..72].copy_from_slice(&timing);
        block[72..90].copy_from_slice(b"\0\0\0\xfc\0Panel 24\n    ");
        block[90..108].copy_from_slice(b"\0\0\0\xff\0S123\n        ");
        let sum = block.iter().fold(0u8, |sum, b| sum.wrapping_add(*b));
        block[127] = sum.wrapping_neg();
        block
    }

    #[test]
    fn a_monitor_says_name_and_size() {
        let edid = parse(&example()).unwrap();
        assert_eq!((edid.maker.as_str(), edid.product, edid.serial), ("ABC", 0x1234, 7));
        assert_eq!((edid.name.as_str(), edid.serial_text.as_str()), ("Panel 24", "S123"));
        assert_eq!((edid.size_mm, edid.pixels), (Some([527, 296]), Some([1920, 1080])));
    }

    #[test]
    fn damaged_ones_are_none() {
        let mut damaged = example();
        damaged[60] ^= 1;
        assert_eq!(parse(&damaged), None);
        assert_eq!(parse(&example()[..127]), None);
        assert_eq!(parse(&[]), None);
    }

    proptest! {
        #[test]
        fn any_bytes_are_read(bytes in proptest::collection::vec(any::<u8>(), 0..300)) {
            parse(&bytes);
        }

        #[test]
        fn any_block_with_a_right_sum_is_read(body in proptest::collection::vec(any::<u8>(), 119)) {
            let mut block = MAGIC.to_vec();
            block.extend(body);
            let sum = block.iter().fold(0u8, |sum, b| sum.wrapping_add(*b));
            block.push(sum.wrapping_neg());
            prop_assert!(parse(&block).is_some());
        }
    }
}

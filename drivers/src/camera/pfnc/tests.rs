//! Layouts as drawn in the PFNC and in the GigE Vision standard, and round trips.

use super::*;
use proptest::prelude::*;

fn picture(name: &str, width: usize, height: usize, padding: usize) -> Picture {
    Picture { format: PixelFormat::named(name).unwrap(), width, height, padding }
}

/// All formats of the table of values, and those known by name only.
fn names() -> Vec<String> {
    let by_name = PREFIXES.iter().flat_map(|(prefix, _)| SUFFIXES.iter().map(move |(s, ..)| format!("{prefix}{s}")));
    CODES.iter().map(|(name, _)| (*name).to_owned()).chain(by_name).collect()
}

/// Packs codes as a camera would.
fn pack(picture: &Picture, codes: &[u16]) -> Vec<u8> {
    let run = |codes: &[u16]| -> Vec<u8> {
        let (bits, low) = (picture.format.bits as usize, picture.format.bits.saturating_sub(8));
        match picture.format.packing {
            Packing::Whole if bits == 8 => codes.iter().map(|c| *c as u8).collect(),
            Packing::Whole => codes.iter().flat_map(|c| c.to_le_bytes()).collect(),
            Packing::Lsb => {
                let mut bytes = vec![0u8; (codes.len() * bits).div_ceil(8)];
                for at in 0..codes.len() * bits {
                    let bit = (codes[at / bits] >> (at % bits)) & 1;
                    bytes[at / 8] |= (bit as u8) << (at % 8);
                }
                bytes
            }
            Packing::Gige => {
                let mask = (1u16 << low) - 1;
                let group = |pair: &[u16]| match *pair {
                    [a, b] => vec![(a >> low) as u8, ((a & mask) | ((b & mask) << 4)) as u8, (b >> low) as u8],
                    [a, ..] => vec![(a >> low) as u8, (a & mask) as u8],
                    [] => vec![],
                };
                codes.chunks(2).flat_map(group).collect()
            }
        }
    };
    match picture.padding {
        0 => run(codes),
        gap => codes.chunks(picture.width).flat_map(|row| [run(row), vec![0xA5; gap]].concat()).collect(),
    }
}

#[test]
fn packed_layouts_are_those_of_the_standards() {
    // Mono10p: four pixels in five bytes; bits 0 to 7 of pixel 0, then its bits 8 and 9 in the low bits of byte 1.
    let bytes = [0b1111_1111, 0b0000_0011, 0b0000_1111, 0b0100_0000, 0b1000_0000];
    assert_eq!(picture("Mono10p", 4, 1, 0).unpack(&bytes), Ok(vec![0x3FF, 0x3C0, 0x000, 0x201]));
    // Mono12p: two pixels in three bytes; the low half of byte 1 is the upper bits of pixel 0.
    assert_eq!(picture("Mono12p", 2, 1, 0).unpack(&[0xBC, 0x3A, 0x12]), Ok(vec![0xABC, 0x123]));
    // Mono12Packed of GigE Vision: byte 1 holds the low bits of both pixels.
    assert_eq!(picture("Mono12Packed", 2, 1, 0).unpack(&[0xAB, 0x3C, 0x12]), Ok(vec![0xABC, 0x123]));
    // Mono10Packed: bits 0 and 1 of byte 1 belong to pixel 0, bits 4 and 5 to pixel 1.
    assert_eq!(picture("Mono10Packed", 2, 1, 0).unpack(&[0xFF, 0x12, 0x80]), Ok(vec![0x3FE, 0x201]));
    // Mono14p: pixel 1 begins in bit 6 of byte 1.
    assert_eq!(picture("Mono14p", 2, 1, 0).unpack(&[0xFF, 0x7F, 0x00, 0x00]), Ok(vec![0x3FFF, 0x0001]));
    // Unpacked codes are little endian, with zeros above.
    assert_eq!(picture("Mono12", 2, 1, 0).unpack(&[0xBC, 0x0A, 0x23, 0x01]), Ok(vec![0xABC, 0x123]));
    assert_eq!(picture("Mono16", 1, 1, 0).unpack(&[0xCD, 0xAB]), Ok(vec![0xABCD]));
    assert_eq!(picture("BayerRG8", 2, 1, 0).unpack(&[7, 9]), Ok(vec![7, 9]));
}

#[test]
fn packed_codes_continue_across_rows_unless_rows_are_padded() {
    // Three pixels per row: pixel 3 shares a byte with pixel 2.
    let across = [0x01, 0x20, 0x00, 0x03, 0x40, 0x00, 0x05, 0x60, 0x00];
    assert_eq!(picture("Mono12p", 3, 2, 0).unpack(&across), Ok(vec![1, 2, 3, 4, 5, 6]));
    let padded = [0x01, 0x20, 0x00, 0x03, 0x00, 0xA5, 0x04, 0x50, 0x00, 0x06, 0x00];
    assert_eq!(picture("Mono12p", 3, 2, 1).unpack(&padded), Ok(vec![1, 2, 3, 4, 5, 6]));
}

#[test]
fn names_and_values_agree() {
    for (i, (name, code)) in CODES.iter().enumerate() {
        let format = PixelFormat::named(name).unwrap();
        assert!(format.fits(*code), "{name}");
        assert_eq!(code_of(name), Some(*code));
        // The highest byte is 1 for one channel, with the highest bit for a manufacturer's format.
        assert!(matches!(code >> 24, 0x01 | 0x81), "{name}");
        assert!(CODES[..i].iter().all(|(other, value)| other != name && value != code), "{name}");
    }
    let kind = |name: &str| PixelFormat::named(name).map(|f| (f.mosaic, f.bits));
    assert_eq!(kind("Polarized12p"), Some((Mosaic::Polarized, 12)));
    assert_eq!(kind("PolarizeMono16"), Some((Mosaic::Polarized, 16)));
    assert_eq!(kind("PolarizedMono12Packed"), Some((Mosaic::Polarized, 12)));
    assert_eq!(kind("BayerRGPolarized8"), Some((Mosaic::BayerPolarized, 8)));
    for several in ["RGB8", "YUV422_8", "PolarizedAngles_0d_45d_90d_135d_Mono8", "Mono", "Mono9", "BayerRG8p", ""] {
        assert_eq!(PixelFormat::named(several), None, "{several}");
    }
}

#[test]
fn many_bits_and_raw_mosaics_are_preferred() {
    let mut names = ["Mono8", "Mono12Packed", "BayerRG12", "Mono12p", "Polarized12p", "Mono16", "BayerRG12p"];
    names.sort_by_key(|name| std::cmp::Reverse(PixelFormat::named(name).unwrap().preference()));
    assert_eq!(names, ["Mono16", "Polarized12p", "BayerRG12", "BayerRG12p", "Mono12p", "Mono12Packed", "Mono8"]);
}

proptest! {
    #[test]
    fn packed_pixels_are_unpacked(
        index: prop::sample::Index, width in 1usize..20, height in 1usize..6, padding in 0usize..5, seed: u64,
    ) {
        let names = names();
        let picture = picture(&names[index.index(names.len())], width, height, padding);
        let codes: Vec<u16> = (0..width * height)
            .map(|i| (seed.wrapping_mul(i as u64 + 1).rotate_left(17) as u16) & picture.format.white())
            .collect();
        let bytes = pack(&picture, &codes);
        prop_assert_eq!(bytes.len(), picture.bytes());
        prop_assert_eq!(picture.unpack(&bytes), Ok(codes));
        prop_assert!(picture.unpack(&bytes[..bytes.len() - padding - 1]).is_err());
    }

    #[test]
    fn no_payload_is_too_wild(
        index: prop::sample::Index, width in 0usize..70, height in 0usize..9, padding in 0usize..99, bytes: Vec<u8>,
    ) {
        let names = names();
        let picture = picture(&names[index.index(names.len())], width, height, padding);
        if let Ok(codes) = picture.unpack(&bytes) {
            prop_assert_eq!(codes.len(), width * height);
        }
    }
}

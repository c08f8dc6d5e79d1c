//! EDID: 128 bytes in which a display describes itself.

/// Length of an EDID's first block; extension blocks are not read.
pub const BLOCK: usize = 128;

const HEADER: [u8; 8] = [0, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0];
/// Byte range of the four descriptors, and their length.
const DESCRIPTORS: std::ops::Range<usize> = 54..126;
const DESCRIPTOR: usize = 18;
/// Smallest plausible size in mm: some displays report their aspect ratio instead of their size.
const SMALLEST_MM: f64 = 20.0;

/// Properties from an EDID.
#[derive(Clone, Debug, PartialEq)]
pub struct Edid {
    /// Manufacturer code of three letters.
    pub maker: String,
    /// Product code.
    pub product: u16,
    /// Serial number; 0 for none.
    pub serial: u32,
    /// Name of the product.
    pub name: Option<String>,
    /// Serial number as text.
    pub serial_text: Option<String>,
    /// Width and height in mm.
    pub size_mm: Option<[f64; 2]>,
    /// Native resolution: width and height in pixels.
    pub pixels: Option<[u32; 2]>,
}

/// Reason why bytes are not a valid EDID.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EdidError {
    /// Fewer than [`BLOCK`] bytes.
    #[error("{0} bytes in place of 128")]
    Short(usize),
    /// The header is wrong.
    #[error("another beginning")]
    Header,
    /// The bytes do not add up to 0 modulo 256.
    #[error("a wrong checksum")]
    Checksum,
}

impl Edid {
    /// Identity of the display: manufacturer, product and serial number. Displays of one model without serial numbers
    /// share it.
    pub fn id(&self) -> String {
        let serial = match (&self.serial_text, self.serial) {
            (Some(text), _) => text.clone(),
            (None, 0) => "without serial number".to_owned(),
            (None, number) => number.to_string(),
        };
        let name = self.name.as_deref().unwrap_or("panel");
        format!("{} {:04x} {name} {serial}", self.maker, self.product)
    }
}

/// Parses an EDID's first block.
///
/// # Errors
/// The reason why the bytes are invalid.
pub fn parse(bytes: &[u8]) -> Result<Edid, EdidError> {
    let block: &[u8; BLOCK] = bytes.first_chunk().ok_or(EdidError::Short(bytes.len()))?;
    if !block.starts_with(&HEADER) {
        return Err(EdidError::Header);
    }
    if block.iter().fold(0u8, |sum, b| sum.wrapping_add(*b)) != 0 {
        return Err(EdidError::Checksum);
    }
    let mut edid = Edid {
        maker: maker(u16::from_be_bytes([block[8], block[9]])),
        product: u16::from_le_bytes([block[10], block[11]]),
        serial: u32::from_le_bytes([block[12], block[13], block[14], block[15]]),
        name: None,
        serial_text: None,
        size_mm: None,
        pixels: None,
    };
    for descriptor in block[DESCRIPTORS].as_chunks::<DESCRIPTOR>().0 {
        read_descriptor(&mut edid, descriptor);
    }
    // The first detailed timing gives the size in mm, these bytes give it in cm.
    edid.size_mm = edid.size_mm.or_else(|| plausible([block[21], block[22]].map(|cm| 10.0 * f64::from(cm))));
    Ok(edid)
}

/// A detailed timing starts with a pixel clock; the other descriptors have a type.
fn read_descriptor(edid: &mut Edid, d: &[u8; DESCRIPTOR]) {
    let wide = |low: u8, high: u8| (u32::from(high) << 8) | u32::from(low);
    if d[0] != 0 || d[1] != 0 {
        if edid.pixels.is_none() {
            edid.pixels = Some([wide(d[2], d[4] >> 4), wide(d[5], d[7] >> 4)]).filter(|p| p[0] > 0 && p[1] > 0);
            edid.size_mm = plausible([wide(d[12], d[14] >> 4), wide(d[13], d[14] & 15)].map(f64::from));
        }
        return;
    }
    match d[3] {
        0xFC => edid.name = text(&d[5..]),
        0xFF => edid.serial_text = text(&d[5..]),
        _ => {}
    }
}

fn plausible(size_mm: [f64; 2]) -> Option<[f64; 2]> {
    (size_mm[0] >= SMALLEST_MM && size_mm[1] >= SMALLEST_MM).then_some(size_mm)
}

/// Five bits per letter.
fn maker(code: u16) -> String {
    let letter = |shift: u16| match (code >> shift) & 31 {
        n @ 1..=26 => char::from(b'@' + n as u8),
        _ => '?',
    };
    [10, 5, 0].map(letter).iter().collect()
}

/// The text ends with a line feed; unprintable characters are removed.
fn text(bytes: &[u8]) -> Option<String> {
    let text: String =
        bytes.iter().take_while(|b| **b != b'\n').map(|b| char::from(*b)).filter(|c| (' '..='~').contains(c)).collect();
    let text = text.trim();
    (!text.is_empty()).then(|| text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sealed(mut block: [u8; BLOCK]) -> [u8; BLOCK] {
        let sum = block[..127].iter().fold(0u8, |sum, b| sum.wrapping_add(*b));
        block[127] = sum.wrapping_neg();
        block
    }

    /// A display of 1920 × 1080 pixels, 527 × 296 mm.
    fn example() -> [u8; BLOCK] {
        let mut block = [0; BLOCK];
        block[..8].copy_from_slice(&HEADER);
        block[8..16].copy_from_slice(&[0x10, 0xAC, 0xA0, 0xA0, 0x4C, 0x31, 0x30, 0x30]);
        (block[21], block[22]) = (53, 30);
        let timing = [2, 0x3A, 0x80, 0x18, 0x71, 0x38, 0x2D, 0x40, 0x58, 0x2C, 0x45, 0, 0x0F, 0x28, 0x21, 0, 0, 0x1E];
        block[54..72].copy_from_slice(&timing);
        block[72..90].copy_from_slice(b"\0\0\0\xFF\0KX0JT2\x0700L1\n ");
        block[90..108].copy_from_slice(b"\0\0\0\xFC\0DELL U2410\n  ");
        sealed(block)
    }

    #[test]
    fn an_edid_is_read() {
        let edid = parse(&example()).unwrap();
        assert_eq!((edid.pixels, edid.size_mm), (Some([1920, 1080]), Some([527.0, 296.0])));
        assert_eq!(edid.id(), "DEL a0a0 DELL U2410 KX0JT200L1");
    }

    #[test]
    fn a_size_that_is_a_ratio_is_not_believed() {
        let mut block = example();
        (block[66], block[67], block[68]) = (16, 9, 0);
        assert_eq!(parse(&sealed(block)).unwrap().size_mm, Some([530.0, 300.0]), "that in cm");
        (block[21], block[22]) = (0, 0);
        assert_eq!(parse(&sealed(block)).unwrap().size_mm, None);
    }

    #[test]
    fn invalid_edids_are_refused() {
        let good = example();
        assert_eq!(parse(&good[..127]), Err(EdidError::Short(127)));
        let mut bad = good;
        bad[0] = 1;
        assert_eq!(parse(&bad), Err(EdidError::Header));
        bad = good;
        bad[60] ^= 1;
        assert_eq!(parse(&bad), Err(EdidError::Checksum));
    }

    proptest! {
        #[test]
        fn no_edid_is_too_wild(body in proptest::collection::vec(any::<u8>(), 119)) {
            let mut block = [0; BLOCK];
            block[..8].copy_from_slice(&HEADER);
            block[8..127].copy_from_slice(&body);
            let edid = parse(&sealed(block)).unwrap();
            prop_assert!(edid.id().chars().all(|c| (' '..='~').contains(&c)));
            prop_assert!(edid.size_mm.is_none_or(|s| s.iter().all(|v| (20.0..=4095.0).contains(v))));
        }

        #[test]
        fn any_bytes_are_read_or_refused(bytes: Vec<u8>) {
            let _ = parse(&bytes);
        }
    }
}

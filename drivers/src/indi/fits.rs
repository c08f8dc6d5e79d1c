//! FITS pictures of INDI cameras: the primary image, with unsigned or offset integers of 8 or 16 bits.
//!
//! INDI writes the rows as the sensor is read, the first at the top, whether `ROWORDER` states it or not; only
//! `BOTTOM-UP` turns them.

/// Bytes per block; header and data consist of whole blocks.
const BLOCK: usize = 2880;
/// Bytes per card, which holds one keyword.
const CARD: usize = 80;
/// Largest number of header blocks.
const MAX_BLOCKS: usize = 100;
/// Longest side in pixels.
const MAX_SIDE: f64 = 65_536.0;

/// A picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Codes, row by row, the top row first.
    pub codes: Vec<u16>,
    /// Exposure in s (`EXPTIME`).
    pub exposure_s: Option<f64>,
}

/// Largest file of a picture of this size in bytes.
pub fn most(width: usize, height: usize) -> usize {
    width.saturating_mul(height).saturating_mul(2).saturating_add((MAX_BLOCKS + 1) * BLOCK)
}

/// Reads a picture.
///
/// # Errors
/// A description of the defect.
pub fn read(bytes: &[u8]) -> Result<Image, String> {
    if !bytes.starts_with(b"SIMPLE  =") {
        return Err("a file that is not FITS".into());
    }
    let (cards, data) = header(bytes)?;
    let number = |keyword: &str| number(&cards, keyword);
    if number("NAXIS")? != Some(2.0) {
        let planes = number("NAXIS3")?.unwrap_or(0.0);
        return Err(format!("a FITS file of {planes} planes, not one"));
    }
    let side = |keyword: &str| -> Result<usize, String> {
        let length = number(keyword)?.filter(|n| (1.0..=MAX_SIDE).contains(n) && n.fract() == 0.0);
        length.map(|n| n as usize).ok_or_else(|| format!("a FITS file without a valid {keyword}"))
    };
    let (width, height) = (side("NAXIS1")?, side("NAXIS2")?);
    let (bits, zero) = (number("BITPIX")?.unwrap_or(0.0), number("BZERO")?.unwrap_or(0.0));
    let scale = number("BSCALE")?.unwrap_or(1.0);
    let bytes_per_pixel = match (bits as i64, zero as i64, scale as i64) {
        (8, 0, 1) => 1,
        (16, 0 | 32_768, 1) => 2,
        _ => return Err(format!("FITS values of {bits} bits with offset {zero} and scale {scale}")),
    };
    let length = width * height * bytes_per_pixel;
    let data = data.get(..length).ok_or_else(|| format!("a FITS file with {} of {length} bytes", data.len()))?;
    let flip = if zero > 0.0 { 0x8000 } else { 0 };
    let bottom_up = text(&cards, "ROWORDER").is_some_and(|order| order.eq_ignore_ascii_case("BOTTOM-UP"));
    let mut codes = Vec::with_capacity(width * height);
    for row in 0..height {
        let row = if bottom_up { height - 1 - row } else { row };
        let stored = data.chunks_exact(width * bytes_per_pixel).nth(row).unwrap_or_default();
        match bytes_per_pixel {
            1 => codes.extend(stored.iter().map(|b| u16::from(*b))),
            // Signed without an offset; negative values are below black.
            _ if flip == 0 => codes.extend(pairs(stored).map(|pair| i16::from_be_bytes(pair).max(0).unsigned_abs())),
            _ => codes.extend(pairs(stored).map(|pair| u16::from_be_bytes(pair) ^ flip)),
        }
    }
    Ok(Image { width, height, codes, exposure_s: number("EXPTIME")?.filter(|s| *s > 0.0) })
}

fn pairs(bytes: &[u8]) -> impl Iterator<Item = [u8; 2]> {
    bytes.as_chunks::<2>().0.iter().copied()
}

/// Cards of the header, and the bytes after it.
fn header(bytes: &[u8]) -> Result<(Vec<&[u8]>, &[u8]), String> {
    let mut cards = vec![];
    for (index, block) in bytes.chunks_exact(BLOCK).take(MAX_BLOCKS).enumerate() {
        for card in block.chunks_exact(CARD) {
            if card.get(..8) == Some(b"END     ") {
                return Ok((cards, bytes.get((index + 1) * BLOCK..).unwrap_or_default()));
            }
            cards.push(card);
        }
    }
    Err("a FITS header without an end".into())
}

/// Value of a keyword as text, without quotes and comment.
fn text(cards: &[&[u8]], keyword: &str) -> Option<String> {
    let card = cards.iter().find(|card| {
        let name = card.get(..8).unwrap_or_default();
        name.trim_ascii_end() == keyword.as_bytes() && card.get(8..10) == Some(b"= ")
    })?;
    let value = String::from_utf8_lossy(card.get(10..)?).trim().to_owned();
    Some(match value.strip_prefix('\'') {
        Some(quoted) => quoted.split('\'').next().unwrap_or_default().trim_end().to_owned(),
        None => value.split('/').next().unwrap_or_default().trim().to_owned(),
    })
}

fn number(cards: &[&[u8]], keyword: &str) -> Result<Option<f64>, String> {
    let Some(text) = text(cards, keyword) else { return Ok(None) };
    match text.replace(['D', 'd'], "E").parse::<f64>() {
        Ok(number) if number.is_finite() => Ok(Some(number)),
        _ => Err(format!("a FITS file whose {keyword} is not a number")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn file(cards: &[&str], data: &[u8]) -> Vec<u8> {
        let mut bytes: Vec<u8> = cards.iter().chain(&["END"]).flat_map(|c| format!("{c:<80}").into_bytes()).collect();
        bytes.resize(bytes.len().div_ceil(BLOCK) * BLOCK, b' ');
        bytes.extend_from_slice(data);
        bytes
    }

    const HEAD: [&str; 6] = [
        "SIMPLE  =                    T / standard",
        "BITPIX  =                   16",
        "NAXIS   =                    2",
        "NAXIS1  =                    2",
        "NAXIS2  =                    2",
        "EXPTIME =         5.000000D-02 / s",
    ];

    fn with(more: &[&str], data: &[u8]) -> Result<Image, String> {
        read(&file(&[&HEAD[..], more].concat(), data))
    }

    #[test]
    fn rows_are_read_from_the_top() {
        let data = [0x80, 0, 0x80, 1, 0x7f, 0xff, 0, 0];
        let offset = "BZERO   =                32768 / unsigned";
        let image = with(&[offset, "ROWORDER= 'TOP-DOWN'"], &data).unwrap();
        assert_eq!((image.width, image.height, image.exposure_s), (2, 2, Some(0.05)));
        assert_eq!(image.codes, [0, 1, 65_535, 32_768]);
        assert_eq!(with(&[offset], &data).unwrap().codes, image.codes);
        assert_eq!(with(&[offset, "ROWORDER= 'BOTTOM-UP'"], &data).unwrap().codes, [65_535, 32_768, 0, 1]);
        assert_eq!(with(&[], &data).unwrap().codes, [0, 0, 32_767, 0]);
        let bytes: Vec<&str> = HEAD.iter().map(|c| if c.starts_with("BITPIX") { "BITPIX  = 8" } else { c }).collect();
        assert_eq!(read(&file(&bytes, &[1, 2, 3, 4])).unwrap().codes, [1, 2, 3, 4]);
    }

    #[test]
    fn defects_are_named() {
        let head = |from: &str, to: &str| {
            let cards: Vec<&str> = HEAD.iter().map(|c| if c.starts_with(from) { to } else { c }).collect();
            read(&file(&cards, &[0; 8])).unwrap_err()
        };
        assert!(head("SIMPLE", "XTENSION").contains("not FITS"));
        assert!(head("BITPIX", "BITPIX  = -32").contains("-32 bits"));
        assert!(head("NAXIS ", "NAXIS   = 3").contains("planes"));
        assert!(head("NAXIS1", "NAXIS1  = 1e9").contains("NAXIS1"));
        assert!(head("NAXIS2", "NAXIS2  = x").contains("not a number"));
        assert!(head("NAXIS2", "NAXIS2  = 60000").contains("of 240000 bytes"));
        assert!(with(&["BSCALE  = 2"], &[0; 8]).unwrap_err().contains("scale 2"));
        assert!(read(&file(&HEAD, &[])[..80]).unwrap_err().contains("without an end"));
    }

    proptest! {
        #[test]
        fn any_bytes_are_a_picture_or_refused(cards in prop::collection::vec("[A-Z0-9]{1,8} *= .{0,12}", 0..6), data: Vec<u8>) {
            let cards: Vec<&str> = HEAD.iter().copied().chain(cards.iter().map(String::as_str)).collect();
            if let Ok(image) = read(&file(&cards, &data)) {
                prop_assert_eq!(image.codes.len(), image.width * image.height);
            }
            let _ = read(&data);
        }
    }
}

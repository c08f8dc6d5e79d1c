//! Pictures of Alpaca cameras in the format ImageBytes: eleven 32-bit words and the pixels, little-endian.
//!
//! The array's first index is the column, so that the pixels of a column follow each other. The first row is at the
//! top.

/// Media type of the format.
pub const MEDIA_TYPE: &str = "application/imagebytes";
/// Length of the head in bytes.
pub const HEAD: usize = 44;
/// Longest message of an error.
const MAX_MESSAGE: usize = 400;

/// A picture, or the camera's error.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Image {
    /// A picture of one plane.
    Plane {
        /// Width in pixels.
        width: usize,
        /// Height in pixels.
        height: usize,
        /// Codes, row by row. Values outside 0 to 65535 are clipped.
        codes: Vec<u16>,
    },
    /// The camera reports an error.
    Refused {
        /// Alpaca's error number.
        number: i32,
        /// Message.
        message: String,
    },
}

/// Type of the transmitted pixels.
#[derive(Clone, Copy)]
enum Element {
    I16,
    I32,
    U8,
    U16,
    U32,
}

impl Element {
    fn of(code: i32) -> Option<Self> {
        match code {
            1 => Some(Self::I16),
            2 => Some(Self::I32),
            6 => Some(Self::U8),
            8 => Some(Self::U16),
            9 => Some(Self::U32),
            _ => None,
        }
    }

    fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 => 4,
        }
    }

    fn code(self, bytes: &[u8]) -> u16 {
        let mut word = [0; 4];
        word.iter_mut().zip(bytes).for_each(|(to, from)| *to = *from);
        let [low, high, ..] = word;
        let clipped = |value: i64| value.clamp(0, i64::from(u16::MAX)) as u16;
        match self {
            Self::U8 => u16::from(low),
            Self::U16 => u16::from_le_bytes([low, high]),
            Self::I16 => clipped(i16::from_le_bytes([low, high]).into()),
            Self::I32 => clipped(i32::from_le_bytes(word).into()),
            Self::U32 => clipped(u32::from_le_bytes(word).into()),
        }
    }
}

/// Largest answer with a picture of this size in bytes.
pub fn most(width: usize, height: usize) -> usize {
    width.saturating_mul(height).saturating_mul(4).saturating_add(HEAD + 4096)
}

/// Reads a picture.
///
/// # Errors
/// A description of the defect.
pub fn read(bytes: &[u8]) -> Result<Image, String> {
    let word = |k: usize| -> Result<i32, String> {
        let four = bytes.get(4 * k..4 * k + 4).and_then(|b| b.first_chunk::<4>());
        four.map(|b| i32::from_le_bytes(*b)).ok_or_else(|| format!("{} bytes, shorter than its head", bytes.len()))
    };
    word(HEAD / 4 - 1)?;
    let size = |k: usize| usize::try_from(word(k)?).map_err(|_| "negative sizes".to_owned());
    if word(0)? != 1 {
        return Err(format!("version {} of ImageBytes", word(0)?));
    }
    let data = size(4).ok().filter(|start| *start >= HEAD).and_then(|start| bytes.get(start..));
    let data = data.ok_or("pixels that start outside of the answer")?;
    match word(1)? {
        0 => {}
        number => {
            let text = String::from_utf8_lossy(data.get(..MAX_MESSAGE).unwrap_or(data));
            return Ok(Image::Refused { number, message: text.trim_end_matches('\0').to_owned() });
        }
    }
    if word(7)? != 2 {
        return Err(format!("{} planes of colours, already converted", size(10)?));
    }
    let element = Element::of(word(6)?).ok_or_else(|| format!("pixels of type {}", word(6).unwrap_or_default()))?;
    let (width, height) = (size(8)?, size(9)?);
    let length = width.checked_mul(height).and_then(|n| n.checked_mul(element.bytes()));
    if length != Some(data.len()) || width == 0 || height == 0 {
        return Err(format!("{} bytes of pixels for {width} × {height}", data.len()));
    }
    Ok(Image::Plane { width, height, codes: rows(data, element, width, height) })
}

/// Converts columns to rows, in blocks that fit the processor's cache.
fn rows(data: &[u8], element: Element, width: usize, height: usize) -> Vec<u16> {
    const BLOCK: usize = 64;
    let mut codes = vec![0; width * height];
    for left in (0..width).step_by(BLOCK) {
        for (y, row) in codes.chunks_exact_mut(width).enumerate() {
            for (x, code) in row.iter_mut().enumerate().skip(left).take(BLOCK) {
                let at = (x * height + y) * element.bytes();
                *code = data.get(at..at + element.bytes()).map_or(0, |bytes| element.code(bytes));
            }
        }
    }
    codes
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn image(element: i32, rank: i32, [width, height]: [i32; 2], data: &[u8]) -> Vec<u8> {
        let words = [1, 0, 7, 8, HEAD as i32, 2, element, rank, width, height, 0];
        words.iter().flat_map(|w: &i32| w.to_le_bytes()).chain(data.iter().copied()).collect()
    }

    fn codes(bytes: &[u8]) -> Vec<u16> {
        let Image::Plane { codes, .. } = read(bytes).unwrap() else { panic!("an error") };
        codes
    }

    #[test]
    fn columns_become_rows() {
        // Three columns of two rows.
        assert_eq!(codes(&image(6, 2, [3, 2], &[1, 4, 2, 5, 3, 6])), [1, 2, 3, 4, 5, 6]);
        let words = |values: &[i32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
        assert_eq!(codes(&image(2, 2, [2, 2], &words(&[-1, 7, 65_535, 70_000]))), [0, 65_535, 7, 65_535]);
        assert_eq!(codes(&image(8, 2, [1, 2], &[0, 1, 255, 255])), [256, 65_535]);
        assert_eq!(codes(&image(1, 2, [1, 1], &[255, 255])), [0]);
    }

    #[test]
    fn defects_are_named() {
        for (bytes, word) in [
            (image(6, 2, [3, 2], &[0; 5]), "bytes of pixels for 3 × 2"),
            (image(6, 2, [-3, -2], &[0; 6]), "negative"),
            (image(6, 2, [i32::MAX, i32::MAX], &[0; 6]), "bytes of pixels"),
            (image(3, 2, [1, 1], &[0; 8]), "type 3"),
            (image(6, 3, [1, 1], &[0; 3]), "planes"),
            (image(6, 2, [1, 1], &[0]).split_at(40).0.to_vec(), "shorter than its head"),
        ] {
            assert!(read(&bytes).unwrap_err().contains(word), "{word}: {:?}", read(&bytes));
        }
        let mut refused = image(6, 0, [0, 0], b"not ready\0");
        refused[4] = 11;
        assert_eq!(read(&refused), Ok(Image::Refused { number: 11, message: "not ready".into() }));
        refused[16] = 43;
        assert!(read(&refused).unwrap_err().contains("outside"));
    }

    proptest! {
        #[test]
        fn any_bytes_are_a_picture_or_refused(words in prop::array::uniform11(-3..70_i32), data: Vec<u8>) {
            let head = words.iter().flat_map(|w| w.to_le_bytes());
            let bytes: Vec<u8> = head.chain(data).collect();
            if let Ok(Image::Plane { width, height, codes }) = read(&bytes) {
                prop_assert_eq!(codes.len(), width * height);
            }
        }

        #[test]
        fn every_pixel_keeps_its_place(width in 1..200_usize, height in 1..70_usize) {
            let code = |x: usize, y: usize| (x * 251 + y) as u16;
            let columns = (0..width).flat_map(|x| (0..height).flat_map(move |y| code(x, y).to_le_bytes()));
            let bytes = image(8, 2, [width as i32, height as i32], &columns.collect::<Vec<_>>());
            let codes = codes(&bytes);
            for y in 0..height {
                for x in 0..width {
                    prop_assert_eq!(codes[y * width + x], code(x, y));
                }
            }
        }
    }
}

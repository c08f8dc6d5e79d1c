//! Text in the standard fonts of PDF, which no file has to embed.

/// A standard font.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Font {
    /// Helvetica.
    Plain,
    /// Helvetica bold.
    Bold,
    /// Courier.
    Code,
}

impl Font {
    /// All fonts.
    pub const ALL: [Self; 3] = [Self::Plain, Self::Bold, Self::Code];

    /// Name in the file.
    pub fn base(self) -> &'static [u8] {
        match self {
            Self::Plain => b"Helvetica",
            Self::Bold => b"Helvetica-Bold",
            Self::Code => b"Courier",
        }
    }

    /// Name among the resources of a page.
    pub fn key(self) -> &'static [u8] {
        match self {
            Self::Plain => b"F1",
            Self::Bold => b"F2",
            Self::Code => b"F3",
        }
    }

    /// Width of encoded text in the units of `size`.
    pub fn width(self, text: &[u8], size: f32) -> f32 {
        let table = match self {
            Self::Plain => &PLAIN,
            Self::Bold => &BOLD,
            Self::Code => return 0.6 * size * text.len() as f32,
        };
        let of = |c: &u8| table.get(usize::from(c.wrapping_sub(FIRST))).copied().unwrap_or(OTHER);
        text.iter().map(|c| f32::from(of(c))).sum::<f32>() * size / 1000.0
    }
}

/// First character of the tables.
const FIRST: u8 = b' ';

/// Width of characters beyond the tables: that of most letters with accents.
const OTHER: u16 = 584;

/// Widths of the characters from space to tilde in thousandths, from the font metrics of Adobe.
const PLAIN: [u16; 95] = [
    278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278, 556, 556, 556, 556, 556, 556, 556,
    556, 556, 556, 278, 278, 584, 584, 584, 556, 1015, 667, 667, 722, 722, 667, 611, 778, 722, 278, 500, 667, 556, 833,
    722, 778, 667, 778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 278, 278, 278, 469, 556, 333, 556, 556, 500, 556,
    556, 278, 556, 556, 222, 222, 500, 222, 833, 556, 556, 556, 556, 333, 500, 278, 556, 500, 722, 500, 500, 500, 334,
    260, 334, 584,
];
const BOLD: [u16; 95] = [
    278, 333, 474, 556, 556, 889, 722, 238, 333, 333, 389, 584, 278, 333, 278, 278, 556, 556, 556, 556, 556, 556, 556,
    556, 556, 556, 333, 333, 584, 584, 584, 611, 975, 722, 722, 722, 722, 667, 611, 778, 722, 278, 556, 722, 611, 833,
    722, 778, 667, 778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 333, 278, 333, 584, 556, 333, 556, 611, 556, 611,
    556, 333, 611, 611, 278, 278, 556, 278, 889, 611, 611, 611, 611, 389, 556, 333, 611, 556, 778, 556, 556, 500, 389,
    280, 389, 584,
];

/// Text in the encoding `WinAnsiEncoding`. The fonts have no σ, which becomes "SD" (standard deviation); characters of
/// other scripts become question marks.
pub fn encoded(text: &str) -> Vec<u8> {
    let mut bytes = vec![];
    for sign in text.chars() {
        match sign {
            'σ' => bytes.extend(b"SD"),
            '–' => bytes.push(0x96),
            '—' => bytes.push(0x97),
            '’' => bytes.push(0x92),
            '“' => bytes.push(0x93),
            '”' => bytes.push(0x94),
            '…' => bytes.push(0x85),
            '€' => bytes.push(0x80),
            ' '..='~' | '\u{a0}'..='ÿ' => bytes.push(u32::from(sign) as u8),
            _ => bytes.push(b'?'),
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_encoded_and_measured() {
        assert_eq!(encoded("2 σ, 3 µm² – é 膜"), b"2 SD, 3 \xb5m\xb2 \x96 \xe9 ?");
        assert_eq!(Font::Plain.width(b"Wi ", 1000.0), 944.0 + 222.0 + 278.0);
        assert_eq!(Font::Bold.width(b"~", 1000.0), 584.0);
        assert_eq!(Font::Code.width(b"abc", 10.0), 18.0);
    }
}

//! Numbers, gaps and style of a table: separator and decimal sign.

/// Words for missing heights, in lower case.
const GAPS: &[&str] = &[
    "nan",
    "+nan",
    "-nan",
    "nanq",
    "nan(ind)",
    "-nan(ind)",
    "1.#qnan",
    "-1.#qnan",
    "1.#ind",
    "-1.#ind",
    "1.#inf",
    "-1.#inf",
    "inf",
    "+inf",
    "-inf",
    "infinity",
    "+infinity",
    "-infinity",
    "∞",
    "-∞",
    "bad",
    "-",
    "--",
    "---",
    "----",
    "-----",
    "–",
    "—",
    "n/a",
    "na",
    "n.a.",
    "nd",
    "n.d.",
    "n.v.",
    "nv",
    "null",
    "none",
    "nil",
    "void",
    "invalid",
    "missing",
    "nodata",
    "no_data",
    "no-data",
    "masked",
    "*",
    "**",
    "***",
    "****",
    "*****",
    "?",
    "??",
    "???",
    "#n/a",
    "#nv",
    "#na",
    "#value!",
    "#wert!",
    "#valeur!",
    "#num!",
    "#zahl!",
    "err",
    "error",
    "overflow",
    "underflow",
    "saturated",
    "blank",
    "empty",
    "leer",
    "vide",
    "ungültig",
    "ungueltig",
    "fehlt",
    "invalide",
    "manquant",
    "inválido",
    "k.a.",
    "undef",
    "undefined",
    "outlier",
    "x",
    ".",
    "_",
];

/// Whether a cell denotes a gap.
pub(super) fn is_gap(cell: &str) -> bool {
    let cell = cell.trim_matches(['"', '\'']).trim().to_lowercase();
    GAPS.contains(&cell.as_str())
}

/// Number with this decimal sign; `None` for other signs, thousands separators and words.
pub(super) fn number(cell: &str, decimal: char) -> Option<f64> {
    let cell = cell.trim_matches(['"', '\'']).trim();
    // The usual case needs no copy.
    let plain = |text: &str| {
        let known = text.bytes().all(|b| b.is_ascii_digit() || matches!(b, b'+' | b'-' | b'.' | b'e' | b'E'));
        if known { text.parse().ok() } else { None }
    };
    if decimal == '.'
        && let Some(value) = plain(cell)
    {
        return Some(value);
    }
    if cell.is_empty() || cell.len() > 64 || (decimal == ',' && cell.contains('.')) {
        return None;
    }
    let turned: String = cell
        .chars()
        .map(|c| match c {
            ',' if decimal == ',' => '.',
            '\u{2212}' => '-',
            'd' | 'D' => 'e',
            other => other,
        })
        .collect();
    plain(&turned)
}

/// Whether all words of a line are numbers or gaps, with any separators, and at least one is a number.
pub(super) fn is_row(line: &str) -> bool {
    let mut numbers = 0;
    let words = line.split([' ', '\t', ';', '|', ',']).map(str::trim).filter(|w| !w.is_empty());
    for word in words {
        if number(word, '.').is_some() {
            numbers += 1;
        } else if !is_gap(word) {
            return false;
        }
    }
    numbers > 0
}

/// Separator of the cells of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Separator {
    Tab,
    Semicolon,
    Comma,
    Bar,
    Space,
}

impl Separator {
    fn sign(self) -> Option<char> {
        match self {
            Self::Tab => Some('\t'),
            Self::Semicolon => Some(';'),
            Self::Comma => Some(','),
            Self::Bar => Some('|'),
            Self::Space => None,
        }
    }

    /// Calls `each` with every cell of a line, also empty ones between separators other than blanks.
    pub(super) fn cells<'a>(self, line: &'a str, mut each: impl FnMut(&'a str)) {
        match self.sign() {
            Some(sign) => line.split(sign).for_each(|cell| each(cell.trim())),
            None => line.split_ascii_whitespace().for_each(each),
        }
    }
}

/// Style of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Style {
    pub separator: Separator,
    pub decimal: char,
    /// Whether every row ends or begins with a separator.
    pub ends_with: bool,
    pub begins_with: bool,
}

/// Evidence of the style of rows of numbers, collected line by line.
#[derive(Clone, Debug, Default)]
pub(super) struct Signs {
    lines: usize,
    tabs: usize,
    semicolons: usize,
    bars: usize,
    commas: usize,
    points: usize,
    /// Number of lines with white space between words.
    spaced: usize,
    /// Number of lines that begin and end with their separator.
    ends: usize,
    begins: usize,
    /// Number of words of digits with one comma inside.
    fractions: usize,
    /// Of these, those that cannot be groups of thousands: `0,5`, `12,25`.
    not_thousands: usize,
    /// Words that begin or end with a comma, or have several.
    trailing: usize,
    leading: usize,
    several: usize,
    words: usize,
    /// Integers with leading zeros, among the parts between commas.
    zeros: usize,
    /// Parts between commas that are not integers.
    broken: usize,
    /// Number of digits of every second part between commas, if equal, else 0.
    second: Option<usize>,
    second_varies: bool,
    first_varies: bool,
    first: Option<usize>,
    odd: bool,
    /// Parts between commas with an unclosed quotation mark.
    torn: usize,
    /// Word with comma and point.
    mixed: Option<usize>,
    /// First word with a comma.
    sample: Option<String>,
}

impl Signs {
    /// Adds a row.
    pub(super) fn add(&mut self, at: usize, line: &str) {
        self.lines += 1;
        self.tabs += usize::from(line.contains('\t'));
        self.semicolons += usize::from(line.contains(';'));
        self.bars += usize::from(line.contains('|'));
        let line = line.trim_matches(' ');
        self.ends += usize::from(line.ends_with(['\t', ';', ',', '|']));
        self.begins += usize::from(line.starts_with(['\t', ';', ',', '|']));
        self.spaced += usize::from(line.trim().contains(' '));
        if line.contains(',') {
            self.commas += 1;
            self.parts(line);
        }
        for word in line.trim_matches(',').split([' ', '\t', ';', '|', '\u{a0}']).filter(|w| !w.is_empty()) {
            self.words += 1;
            let point = word.contains('.');
            self.points += usize::from(point && !is_gap(word));
            if word.contains(',') {
                self.word(at, word, point);
            }
        }
    }

    fn word(&mut self, at: usize, word: &str, point: bool) {
        self.trailing += usize::from(word.ends_with(','));
        self.leading += usize::from(word.starts_with(','));
        let inner = word.trim_matches(',').trim_matches(['"', '+', '-', '\u{2212}']);
        match inner.matches(',').count() {
            0 => return,
            1 => {}
            _ => {
                self.several += 1;
                return;
            }
        }
        if self.sample.is_none() {
            self.sample = Some(inner.chars().take(24).collect());
        }
        if point && self.mixed.is_none() {
            self.mixed = Some(at);
        }
        if let Some((whole, fraction)) = inner.split_once(',') {
            let plain = fraction.bytes().all(|b| b.is_ascii_digit());
            self.fractions += 1;
            let thousands = plain && fraction.len() == 3 && (1..=3).contains(&whole.len()) && !whole.starts_with('0');
            self.not_thousands += usize::from(!thousands);
        }
    }

    /// Counts the parts between commas.
    fn parts(&mut self, line: &str) {
        let mut count = 0;
        for (k, cell) in line.trim_end_matches(',').split(',').map(str::trim).enumerate() {
            count += 1;
            self.torn += usize::from(cell.matches('"').count() % 2 == 1);
            let digits = cell.trim_start_matches(['+', '-']);
            if digits.is_empty() || !digits.bytes().all(|b| b.is_ascii_digit()) {
                self.broken += 1;
                continue;
            }
            self.zeros += usize::from(digits.len() > 1 && digits.starts_with('0'));
            let (known, varies) = if k % 2 == 1 {
                (&mut self.second, &mut self.second_varies)
            } else {
                (&mut self.first, &mut self.first_varies)
            };
            *varies |= known.is_some_and(|n| n != digits.len()) || (k % 2 == 1 && cell.len() > digits.len());
            *known = Some(digits.len());
        }
        self.odd |= count % 2 == 1;
    }

    /// Style of the table, or a description of its ambiguity.
    ///
    /// `decimal_comma`: the header has decimal commas. `relative`: only the ratio of the values matters.
    pub(super) fn style(&self, decimal_comma: bool, relative: bool) -> Result<Style, String> {
        let sample = self.sample.as_deref().unwrap_or_default();
        let separator = self.separator()?;
        let comma_inside = separator != Separator::Comma && self.fractions > 0;
        if let (Some(line), true) = (self.mixed, separator != Separator::Comma) {
            return Err(format!(
                "holds numbers with comma and point (line {line}), so that neither is surely the decimal sign"
            ));
        }
        if comma_inside && self.several > 0 {
            return Err(format!("holds numbers with several commas, such as {sample}"));
        }
        if comma_inside && self.points > 0 {
            return Err(format!("holds numbers with decimal points and others with commas, such as {sample}"));
        }
        // Up to a common factor, thousands and decimals are the same surface.
        let alike = relative && self.fractions == self.words;
        if comma_inside && self.not_thousands == 0 && !decimal_comma && !alike {
            return Err(format!("holds numbers such as {sample}, which are read as decimals or as thousands"));
        }
        let all = |count: usize| count == self.lines && separator != Separator::Space;
        let decimal = if comma_inside { ',' } else { '.' };
        Ok(Style { separator, decimal, ends_with: all(self.ends), begins_with: all(self.begins) })
    }

    fn separator(&self) -> Result<Separator, String> {
        let marks = [(self.semicolons, Separator::Semicolon), (self.tabs, Separator::Tab), (self.bars, Separator::Bar)];
        let mut found = marks.iter().filter(|(count, _)| *count > 0);
        if let Some((_, separator)) = found.next() {
            return match found.next() {
                // Tabs beside semicolons are blanks.
                Some((_, Separator::Tab)) | None => Ok(*separator),
                Some(_) => Err("separates its cells by several signs (semicolons, tabs, bars)".into()),
            };
        }
        if self.commas == 0 {
            return Ok(Separator::Space);
        }
        if self.spaced > 0 && self.fractions > 0 {
            // `1,5 2,5` versus `1.5, 2.5` and `1, 2`; `1,5, 2,5` is ambiguous.
            let lists = self.trailing + self.leading > 0;
            if !lists {
                return Ok(Separator::Space);
            }
            return Err("separates its numbers by commas and writes commas inside them".into());
        }
        self.comma()
    }

    /// Only commas: separators, unless they may be decimal signs.
    fn comma(&self) -> Result<Separator, String> {
        if self.torn > 0 {
            return Err("holds numbers with commas in quotation marks".into());
        }
        let integers = self.broken == 0 && self.points == 0;
        let sample = self.sample.as_deref().unwrap_or("1,5");
        if integers && self.zeros > 0 {
            return Err(format!(
                "holds commas both between and inside its numbers, or decimal commas, such as {sample}"
            ));
        }
        let pairs = !self.odd && !self.second_varies && self.second.is_some_and(|n| n > 1) && self.first_varies;
        let single = !self.odd && self.first.is_some() && self.several == 0 && self.spaced == 0;
        if integers && (pairs || single) && self.trailing + self.leading == 0 {
            return Err(format!("holds rows such as {sample}, whose commas separate integers or are decimal signs"));
        }
        Ok(Separator::Comma)
    }
}

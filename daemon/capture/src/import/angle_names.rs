//! Analyser angles from the names of photographs.
//!
//! All names of a series are parsed together, because in `x-45` alone the dash may be a sign or a separator. Ambiguous
//! names are rejected, since a wrong angle gives a wrong map.

use std::path::{Path, PathBuf};

/// Signs directly before a number (in lower case), and true for negative ones.
const SIGNS: [(&str, bool); 13] = [
    ("", false),
    ("+", false),
    ("p", false),
    ("pos", false),
    ("positive", false),
    ("plus", false),
    ("-", true),
    (MINUS, true),
    ("m", true),
    ("n", true),
    ("neg", true),
    ("negative", true),
    ("minus", true),
];

/// Senses of rotation, which are not parsed as signs.
const SENSES: [&str; 2] = ["cw", "ccw"];

/// Typographic minus sign, which never serves as a separator.
const MINUS: &str = "\u{2212}";

/// Characters between two digits that form a decimal number: `22.5`, `22,5`, `22p5`.
const DECIMAL_MARKS: [&str; 3] = [".", ",", "p"];

/// Decimal places of even divisions of a turn: after `_`, `-` or similar characters they may be decimals.
const FRACTIONS: [&str; 7] = ["5", "25", "75", "125", "375", "625", "875"];

/// Units of numbers that are not angles in degrees.
const OTHER_UNITS: [&str; 26] = [
    "ns", "us", "µs", "μs", "ms", "s", "sec", "min", "nm", "um", "µm", "μm", "mm", "cm", "px", "bit", "bits", "hz",
    "fps", "ev", "rad", "mrad", "grad", "gon", "mw", "v",
];

/// Degree signs.
const DEGREES: [char; 3] = ['°', 'º', '˚'];

/// Words that turn degrees into temperatures.
const TEMPERATURES: [&str; 3] = ["c", "f", "celsius"];

/// Mean step below which a number counts photographs.
const COUNT_STEP: f64 = 1.5;

/// Maximum number of file names in a message.
const SHOWN: usize = 6;

/// A number in a name.
struct Number<'a> {
    whole: &'a str,
    fraction: &'a str,
    /// Text since the number before, or since the start of the name.
    before: &'a str,
    /// Text up to the next number, or to the end of the name.
    after: &'a str,
}

impl Number<'_> {
    /// Absolute value.
    fn value(&self) -> f64 {
        format!("{}.{}", self.whole, self.fraction).parse().unwrap_or(f64::NAN)
    }

    /// Text after a degree sign or word.
    fn after_degrees(&self) -> Option<&str> {
        let unit = self.after.trim_start_matches(['_', '-', ' ']);
        unit.strip_prefix("deg").or_else(|| unit.strip_prefix(DEGREES))
    }

    fn in_degrees(&self) -> bool {
        self.after_degrees().is_some() && !self.in_other_units()
    }

    fn in_other_units(&self) -> bool {
        OTHER_UNITS.contains(&word(self.after))
            || self.after_degrees().is_some_and(|rest| TEMPERATURES.contains(&word(rest)))
    }
}

/// Angles in degrees from the names of all these files.
///
/// # Errors
/// Why no reading, or more than one, exists, with the file names.
pub fn angles(files: &[PathBuf]) -> Result<Vec<f64>, String> {
    if files.is_empty() {
        return Err("there is no file".into());
    }
    let stems: Vec<String> = files.iter().map(|f| plain(f)).collect();
    let series = Series { files, names: stems.iter().map(|stem| numbers(stem)).collect() };
    let column = series.column()?;
    series.check_decimals(&column)?;
    series.check_ends(&column)?;
    let signs = series.signs(&column)?;
    let of = |(k, negative): (usize, bool)| {
        let value = series.at(&column, k).value();
        if negative { -value } else { value }
    };
    Ok(signs.into_iter().enumerate().map(of).collect())
}

/// Name without extension, in lower case, with one kind of dash and one kind of minus.
fn plain(file: &Path) -> String {
    let stem = file.file_stem().unwrap_or_default().to_string_lossy().to_lowercase();
    stem.replace(['\u{2010}', '\u{2011}', '\u{2012}', '\u{2013}'], "-").replace(['\u{fe63}', '\u{ff0d}'], MINUS)
}

/// Letters at the start of a text.
fn word(text: &str) -> &str {
    &text[..text.find(|c: char| !c.is_alphabetic()).unwrap_or(text.len())]
}

/// Letters at the end of a text.
fn last_word(text: &str) -> &str {
    &text[text
        .rfind(|c: char| !c.is_alphabetic())
        .map_or(0, |at| at + text[at..].chars().next().map_or(1, char::len_utf8))..]
}

/// Numbers in a name. Two groups of digits with a decimal mark between them form one number; three or more (a date, a
/// version) do not.
fn numbers(stem: &str) -> Vec<Number<'_>> {
    let digits = |c: char| c.is_ascii_digit();
    let (mut groups, mut from) = (vec![], 0);
    while let Some(start) = stem[from..].find(digits).map(|at| from + at) {
        from = stem[start..].find(|c| !digits(c)).map_or(stem.len(), |at| start + at);
        groups.push(start..from);
    }
    let marked =
        |k: usize| groups.get(k + 1).is_some_and(|next| DECIMAL_MARKS.contains(&&stem[groups[k].end..next.start]));
    let (mut spans, mut k) = (vec![], 0);
    while k < groups.len() {
        let last = (k..).find(|j| !marked(*j)).unwrap_or(k);
        if last == k + 1 {
            spans.push((groups[k].clone(), groups[last].clone()));
        } else {
            spans.extend(groups[k..=last].iter().map(|g| (g.clone(), g.end..g.end)));
        }
        k = last + 1;
    }
    let number = |k: usize| {
        let (whole, fraction) = spans[k].clone();
        let begun = if k == 0 { 0 } else { spans[k - 1].1.end };
        let end = spans.get(k + 1).map_or(stem.len(), |next| next.0.start);
        Number {
            before: &stem[begun..whole.start],
            after: &stem[fraction.end..end],
            whole: &stem[whole],
            fraction: &stem[fraction],
        }
    };
    (0..spans.len()).map(number).collect()
}

/// Index of the selected number in each name.
type Column = Vec<usize>;

/// Numbers of all names.
struct Series<'a> {
    files: &'a [PathBuf],
    names: Vec<Vec<Number<'a>>>,
}

impl Series<'_> {
    fn at(&self, column: &[usize], k: usize) -> &Number<'_> {
        &self.names[k][column[k]]
    }

    fn of<'s>(&'s self, column: &'s [usize]) -> impl Iterator<Item = &'s Number<'s>> {
        (0..column.len()).map(|k| self.at(column, k))
    }

    /// Adjacent column, if every name has it.
    fn beside(&self, column: &[usize], step: isize) -> Option<Column> {
        let shifted = column.iter().map(|c| c.checked_add_signed(step));
        shifted.zip(&self.names).map(|(c, numbers)| c.filter(|c| *c < numbers.len())).collect()
    }

    /// Error message with the readings of the first files.
    fn refuse(&self, why: &str, reading: impl Fn(usize) -> String) -> String {
        let shown = self.files.iter().take(SHOWN).enumerate().map(|(k, f)| format!("{}: {}", f.display(), reading(k)));
        let more = if self.files.len() > SHOWN { "; …" } else { "" };
        format!("{why} ({}{more})", shown.collect::<Vec<_>>().join("; "))
    }

    /// Column of the angle: the one in degrees, otherwise the only one that varies without counting photographs.
    fn column(&self) -> Result<Column, String> {
        let in_degrees: Option<Column> = self
            .names
            .iter()
            .map(|numbers| {
                let mut places = (0..numbers.len()).filter(|c| numbers[*c].in_degrees());
                places.next().filter(|_| places.next().is_none())
            })
            .collect();
        if let Some(column) = in_degrees.as_ref().filter(|c| self.differs(c)) {
            return Ok(column.clone());
        }
        let count = self.names.first().map_or(0, Vec::len);
        if count == 0 || self.names.iter().any(|n| n.len() != count) {
            return in_degrees.ok_or_else(|| "the file names do not all hold an angle".into());
        }
        let possible = |c: &Column| self.of(c).all(|n| n.value() <= 360.0 && !n.in_other_units()) && self.differs(c);
        let mut found: Vec<Column> = (0..count).map(|c| vec![c; self.names.len()]).filter(possible).collect();
        if found.len() > 1 && self.names.len() > 2 {
            found.retain(|column| !self.counts(column));
        }
        match found.as_slice() {
            [one] if self.counts(one) => Err(self
                .refuse("the numbers in the file names look like a count, not like angles", |k| {
                    self.at(one, k).value().to_string()
                })),
            [one] => Ok(one.clone()),
            [] => in_degrees
                .ok_or_else(|| "the file names do not differ in a number that could be an angle in degrees".into()),
            [first, second, ..] => Err(self.refuse("several numbers differ between the file names", |k| {
                format!("{} or {}", self.at(first, k).value(), self.at(second, k).value())
            })),
        }
    }

    fn differs(&self, column: &[usize]) -> bool {
        let first = self.at(column, 0).value();
        let mixed = |signs: Vec<bool>| signs.contains(&true) && signs.contains(&false);
        self.of(column).any(|n| n.value() != first) || self.signs(column).is_ok_and(mixed)
    }

    /// True if numbers increase by about one from photograph to photograph.
    fn counts(&self, column: &[usize]) -> bool {
        let mut values: Vec<f64> = self.of(column).map(Number::value).collect();
        values.sort_by(f64::total_cmp);
        let distinct = values.windows(2).all(|w| w[0] < w[1]);
        distinct && values[values.len() - 1] - values[0] < COUNT_STEP * values.len() as f64
    }

    /// Rejects numbers that may be decimals of an angle, and angles that may be decimals of another number.
    fn check_decimals(&self, column: &[usize]) -> Result<(), String> {
        let first = self.at(column, 0);
        if self.of(column).all(|n| n.whole == first.whole) && self.of(column).any(|n| n.fraction != first.fraction) {
            return Err(self.refuse("a point, comma or p may separate numbers or decimals", |k| {
                let n = self.at(column, k);
                format!("{}.{} or {}", n.whole, n.fraction, n.fraction)
            }));
        }
        let counted = |other: Option<Column>| other.is_some_and(|c| self.names.len() > 2 && self.counts(&c));
        let next = |k: usize| self.names[k].get(column[k] + 1).filter(|next| !next.in_other_units());
        let dropped = |k: usize| {
            next(k).is_some_and(|next| may_join(next.before) && FRACTIONS.contains(&next.whole.trim_end_matches('0')))
                || next(k).is_some_and(|next| always_joins(next.before) && next.value() != 0.0)
        };
        if (0..column.len()).any(dropped) && !counted(self.beside(column, 1)) {
            return Err(self.refuse("a number after the angle may be its decimals", |k| {
                let n = self.at(column, k);
                next(k).map_or_else(|| n.whole.into(), |next| format!("{0} or {0}.{1}", n.whole, next.whole))
            }));
        }
        let previous = |k: usize| {
            column[k].checked_sub(1).map(|c| &self.names[k][c]).filter(|_| may_join(self.at(column, k).before))
        };
        let constant = |c: Column| self.of(&c).all(|n| n.value() == self.at(&c, 0).value());
        let before = self.beside(column, -1);
        let harmless = before.is_some_and(|c| self.counts(&c) || constant(c));
        if (0..column.len()).any(|k| previous(k).is_some_and(|p| p.value() <= 360.0)) && !harmless {
            return Err(self.refuse("a number before the angle may belong to it", |k| {
                let n = self.at(column, k);
                previous(k).map_or_else(|| n.whole.into(), |p| format!("{} or {}.{}", n.whole, p.whole, n.whole))
            }));
        }
        Ok(())
    }

    /// Rejects signs and parts of numbers in positions where they would be ignored.
    fn check_ends(&self, column: &[usize]) -> Result<(), String> {
        let starts_name = column.iter().all(|c| *c == 0);
        let odd = |n: &Number| {
            let without_mark = n.before.strip_suffix(['.', ',']);
            let dangling =
                |rest: &str| if rest.is_empty() { starts_name } else { !rest.ends_with(char::is_alphanumeric) };
            n.after.starts_with(char::is_numeric) || without_mark.is_some_and(dangling)
        };
        let trailing = |n: &Number| {
            let end = n.after.trim_start_matches(['_', ' ']);
            let dash =
                end.strip_prefix(['-', '+', '\u{2212}']).is_some_and(|rest| !rest.starts_with(char::is_alphanumeric));
            dash || SENSES.contains(&word(end)) || SIGNS.iter().any(|(sign, _)| !sign.is_empty() && word(end) == *sign)
        };
        let alike = self.of(column).all(|n| n.after == self.at(column, 0).after);
        if self.of(column).any(|n| odd(n) || !alike && trailing(n)) {
            return Err(self.refuse("there is more to an angle than its digits", |k| {
                let n = self.at(column, k);
                format!("{}{}{}", n.before, n.whole, n.after)
            }));
        }
        Ok(())
    }

    /// True for each negative number of a column.
    fn signs(&self, column: &[usize]) -> Result<Vec<bool>, String> {
        let before: Vec<&str> = self.of(column).map(|n| n.before).collect();
        let zeros: Vec<bool> = self.of(column).map(|n| n.value() == 0.0).collect();
        let first = column.iter().all(|c| *c == 0);
        let signs = if before.iter().all(|b| *b == before[0]) {
            common_sign(before[0], first, zeros.contains(&true)).map(|negative| vec![negative; before.len()])
        } else {
            own_signs(&before, &zeros)
        };
        signs.ok_or_else(|| {
            self.refuse("the sign of the angles is ambiguous", |k| {
                let value = self.at(column, k).value();
                if zeros[k] { "0°".into() } else { format!("{value}° or -{value}°") }
            })
        })
    }
}

/// True if the text between two numbers leaves open whether the second one is decimals of the first.
fn may_join(between: &str) -> bool {
    let mut chars = between.chars();
    let single = chars.next().filter(|_| chars.next().is_none());
    single.is_some_and(|c| !c.is_alphabetic() || c == 'd')
}

/// True if the text between two numbers makes the second one a part of the first: arc minutes, powers of ten.
fn always_joins(between: &str) -> bool {
    ["°", "º", "˚", "deg", "e"].contains(&between)
}

/// True if numbers with this common preceding text are negative; `None` if the text is ambiguous.
fn common_sign(before: &str, first: bool, zero: bool) -> Option<bool> {
    let text = before.trim_end_matches(['_', ' ']);
    if text.ends_with(MINUS) || last_word(text) == "minus" {
        return Some(true);
    }
    if ["m", "n", "neg", "negative"].contains(&last_word(text)) {
        // There is no negative zero, so the dash belongs to the name.
        return zero.then_some(false);
    }
    let Some(rest) = before.strip_suffix('-') else { return Some(false) };
    match rest.chars().next_back() {
        None if !first => Some(false),
        // A dash at the start of a name, or after another separator, is a sign.
        None | Some('_' | '=' | '(' | '[' | '-' | ',' | ';' | ':' | '@') => (!zero).then_some(true),
        Some(' ' | '.') => None,
        // After a word, it is a separator.
        Some(_) => Some(false),
    }
}

/// Signs of numbers whose preceding texts differ, by their signs only or by words as well; `None` if ambiguous.
fn own_signs(before: &[&str], zeros: &[bool]) -> Option<Vec<bool>> {
    let common = before.iter().skip(1).fold(before[0], |common, b| {
        let alike = common.chars().zip(b.chars()).take_while(|(x, y)| x == y).map(|(x, _)| x.len_utf8()).sum();
        &common[..alike]
    });
    let sign = |b: &&str| {
        let mark = &b[common.len()..];
        // A sign consisting of letters may be separated from its number.
        let apart = mark.trim_end_matches(['_', ' ']);
        let mark = if apart.ends_with(char::is_alphabetic) { apart } else { mark };
        SIGNS.iter().find(|(text, _)| *text == mark).map(|(_, negative)| *negative)
    };
    if let Some(signs) = before.iter().map(sign).collect::<Option<Vec<bool>>>() {
        let minus_zero = signs.iter().zip(zeros).any(|(negative, zero)| *negative && *zero);
        return (!minus_zero).then_some(signs);
    }
    let separated = |b: &str| b.strip_suffix('-').is_some_and(|rest| rest.ends_with(char::is_alphanumeric));
    let clean = |b: &&str| {
        let mut words = b.split(|c: char| !c.is_alphabetic());
        !b.contains(MINUS) && !words.any(|w| SIGNS.contains(&(w, true)) || SENSES.contains(&w))
    };
    let dashes = before.iter().filter(|b| b.trim_end_matches(['_', ' ']).ends_with('-')).count();
    let unambiguous = dashes == 0 || before.iter().all(|b| separated(b));
    (unambiguous && before.iter().all(clean)).then(|| vec![false; before.len()])
}

#[cfg(test)]
#[path = "angle_names_tests.rs"]
mod tests;

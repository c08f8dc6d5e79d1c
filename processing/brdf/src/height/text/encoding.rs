//! Text encodings: UTF-8, UTF-16 and UTF-32 with byte order marks, UTF-16 without, Windows-1252.

use super::super::formats::fault::{Fault, Outcome};
use std::borrow::Cow;

/// Decoded text, and the name of its encoding unless it is UTF-8.
type Text<'a> = (Cow<'a, str>, Option<&'static str>);

/// Number of bytes by which UTF-16 without a byte order mark is recognised.
const PROBE: usize = 4096;

/// Windows-1252 from 0x80 to 0x9f; unassigned bytes keep their value.
const WINDOWS: [char; 32] = [
    '€', '\u{81}', '‚', 'ƒ', '„', '…', '†', '‡', 'ˆ', '‰', 'Š', '‹', 'Œ', '\u{8d}', 'Ž', '\u{8f}', '\u{90}', '‘', '’',
    '“', '”', '•', '–', '—', '˜', '™', 'š', '›', 'œ', '\u{9d}', 'ž', 'Ÿ',
];

/// Decodes a file.
pub(in crate::height) fn decode(bytes: &[u8]) -> Outcome<Text<'_>> {
    match bytes {
        [0xef, 0xbb, 0xbf, rest @ ..] => Ok(utf8(rest)),
        [0xff, 0xfe, 0, 0, rest @ ..] => utf32(rest, u32::from_le_bytes),
        [0, 0, 0xfe, 0xff, rest @ ..] => utf32(rest, u32::from_be_bytes),
        [0xff, 0xfe, rest @ ..] => utf16(rest, u16::from_le_bytes, "UTF-16 LE"),
        [0xfe, 0xff, rest @ ..] => utf16(rest, u16::from_be_bytes, "UTF-16 BE"),
        _ => match zeros(bytes) {
            [0, most] if most > 0 => utf16(bytes, u16::from_le_bytes, "UTF-16 LE without byte order mark"),
            [most, 0] if most > 0 => utf16(bytes, u16::from_be_bytes, "UTF-16 BE without byte order mark"),
            _ => Ok(utf8(bytes)),
        },
    }
}

/// Counts zero bytes at even and odd positions of the beginning, if most of them have the same parity.
fn zeros(bytes: &[u8]) -> [usize; 2] {
    let probe = &bytes[..bytes.len().min(PROBE) & !1];
    let mut found = [0; 2];
    probe.iter().enumerate().filter(|(_, b)| **b == 0).for_each(|(k, _)| found[k % 2] += 1);
    if found[0].max(found[1]) * 10 > probe.len() / 2 * 9 { found } else { [0, 0] }
}

fn utf8(bytes: &[u8]) -> Text<'_> {
    match std::str::from_utf8(bytes) {
        Ok(text) => (text.into(), None),
        Err(_) => {
            let letter = |b: &u8| match b {
                0x80..=0x9f => WINDOWS[usize::from(b - 0x80)],
                _ => char::from(*b),
            };
            (bytes.iter().map(letter).collect::<String>().into(), Some("Windows-1252 (Latin-1)"))
        }
    }
}

fn utf16(bytes: &[u8], unit: fn([u8; 2]) -> u16, name: &'static str) -> Outcome<Text<'static>> {
    let (pairs, rest) = bytes.as_chunks::<2>();
    if !rest.is_empty() {
        return Err(Fault::Truncated(format!("{name} text ends within a character")));
    }
    let text: Result<String, _> = char::decode_utf16(pairs.iter().map(|p| unit(*p))).collect();
    let text = text.map_err(|_| Fault::damaged(format!("is no valid {name} text")))?;
    Ok((text.into(), Some(name)))
}

fn utf32(bytes: &[u8], unit: fn([u8; 4]) -> u32) -> Outcome<Text<'static>> {
    let (words, rest) = bytes.as_chunks::<4>();
    if !rest.is_empty() {
        return Err(Fault::Truncated("UTF-32 text ends within a character".into()));
    }
    let text: Option<String> = words.iter().map(|w| char::from_u32(unit(*w))).collect();
    let text = text.ok_or_else(|| Fault::damaged("is no valid UTF-32 text"))?;
    Ok((text.into(), Some("UTF-32")))
}

/// Lines with their numbers from 1, ended by line feeds or carriage returns.
pub(in crate::height) fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let end = if text.contains('\n') { '\n' } else { '\r' };
    text.split(end).enumerate().map(|(k, line)| (k + 1, line.trim_matches(['\r', '\u{1a}', '\u{feff}'])))
}

/// Whether a text has characters that do not occur in text files.
pub(in crate::height) fn is_binary(text: &str) -> bool {
    text.chars().any(|c| {
        c.is_control() && !matches!(c, '\t' | '\n' | '\r' | '\u{b}' | '\u{c}' | '\u{1a}' | '\u{80}'..='\u{9f}')
    })
}

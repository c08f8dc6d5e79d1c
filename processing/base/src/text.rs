//! Reading of small untrusted text files.

use crate::{Error, input};
use serde::de::DeserializeOwned;
use std::path::Path;

/// Reads a text file of at most `most` bytes.
///
/// # Errors
/// `Input`, with this remedy, for an unreadable, special or larger file, and for text that is not UTF-8.
pub fn read_text(path: &Path, most: u64, remedy: &str) -> Result<String, Error> {
    let bytes = input::read(path, most).map_err(|e| Error::file(path, e, remedy))?;
    String::from_utf8(bytes).map_err(|e| Error::file(path, format!("is no UTF-8 text: {}", e.utf8_error()), remedy))
}

/// A field of a CSV file, quoted as in RFC 4180.
pub fn csv_field(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

/// Reads a value from JSON directly, without an intermediate tree, which would silently accept repeated keys.
///
/// # Errors
/// The key and its problem, with line and column.
pub fn from_json<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    let mut json = serde_json::Deserializer::from_str(text);
    let value = serde_path_to_error::deserialize(&mut json).map_err(|e| format!("{}{}", key(e.path()), e.inner()))?;
    json.end().map_err(|e| format!("something follows the closing brace: {e}"))?;
    Ok(value)
}

/// Reads a value from TOML.
///
/// # Errors
/// The key and its problem, with its line.
pub fn from_toml<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    let toml = toml::Deserializer::parse(text).map_err(|e| e.to_string().trim_end().to_owned())?;
    serde_path_to_error::deserialize(toml).map_err(|e| {
        let line = |at: std::ops::Range<usize>| text.get(..at.start).map(|before| 1 + before.matches('\n').count());
        let place = e.inner().span().and_then(line).map(|line| format!(" (line {line})")).unwrap_or_default();
        format!("{}{}{place}", key(e.path()), e.inner().message())
    })
}

/// A key as the start of a sentence; empty for the whole document.
fn key(path: &serde_path_to_error::Path) -> String {
    if path.iter().next().is_some() { format!("{path}: ") } else { String::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_small_texts_are_read() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("a.txt");
        std::fs::write(&file, "twelve bytes").unwrap();
        assert_eq!(read_text(&file, 12, "").unwrap(), "twelve bytes");
        let refused = |path: &Path, most| read_text(path, most, "do something").unwrap_err().to_string();
        assert!(refused(&file, 11).contains("11 bytes"));
        assert!(refused(dir.path(), 11).contains("is a folder"));
        assert!(refused(&dir.path().join("b.txt"), 11).contains("cannot be read"));
        std::fs::write(&file, [0xff, 0xfe]).unwrap();
        assert!(refused(&file, 12).contains("a.txt"));
    }

    #[test]
    fn errors_of_values_name_key_and_line() {
        #[derive(serde::Deserialize, PartialEq, Debug)]
        #[serde(deny_unknown_fields)]
        struct Inner {
            size_mm: f64,
        }
        #[derive(serde::Deserialize, PartialEq, Debug)]
        struct Outer {
            panel: Inner,
        }
        let right = Outer { panel: Inner { size_mm: 2.5 } };
        assert_eq!(from_json::<Outer>("{\"panel\": {\"size_mm\": 2.5}}").unwrap(), right);
        assert_eq!(from_toml::<Outer>("panel = { size_mm = 2.5 }").unwrap(), right);
        for (text, words) in [
            ("{\"panel\": {\"size_mm\": \"x\"}}", ["panel.size_mm: ", "line 1"]),
            ("{\"panel\": {\"size_mm\": 1, \"size_mm\": 2}}", ["panel", "duplicate"]),
            ("{\"panel\": {\"size_mm\": 1}} more", ["closing brace", "line 1"]),
        ] {
            let problem = from_json::<Outer>(text).unwrap_err();
            assert!(words.iter().all(|w| problem.contains(w)), "{problem}");
        }
        for (text, words) in [
            ("\n[panel]\nsize_mm = true", ["panel.size_mm: ", "(line 3)"]),
            ("[panel]\nsize_mm = 1\nwidth = 2", ["width", "(line 3)"]),
            ("panel = {", ["line 1", "TOML"]),
        ] {
            let problem = from_toml::<Outer>(text).unwrap_err();
            assert!(words.iter().all(|w| problem.contains(w)), "{problem}");
        }
    }
    #[test]
    fn fields_are_quoted_where_they_must_be() {
        assert_eq!(csv_field("12 frames"), "12 frames");
        assert_eq!(csv_field("r 1.1, ζ 45°, \"clean\""), "\"r 1.1, ζ 45°, \"\"clean\"\"\"");
    }
}

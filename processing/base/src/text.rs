//! Small text files from outside.

use crate::{Error, Result};
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Reads a text file of at most `most` bytes.
///
/// # Errors
/// `Input`, with this remedy, for what cannot be read, is no file, is larger or is no UTF-8 text.
pub fn read_text(path: &Path, most: u64, remedy: &str) -> Result<String> {
    let bad = |problem: String| Error::file(path, problem, remedy);
    let cannot = |e: std::io::Error| bad(format!("cannot be read: {e}"));
    // A pipe has no length, and opening one waits for its writer.
    if !std::fs::metadata(path).map_err(cannot)?.is_file() {
        return Err(bad("is no file".into()));
    }
    let mut text = String::new();
    File::open(path).map_err(cannot)?.take(most + 1).read_to_string(&mut text).map_err(cannot)?;
    if text.len() as u64 > most {
        return Err(bad(format!("has more than the {most} bytes that are read")));
    }
    Ok(text)
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
        assert!(refused(dir.path(), 11).contains("is no file"));
        assert!(refused(&dir.path().join("b.txt"), 11).contains("cannot be read"));
        std::fs::write(&file, [0xff, 0xfe]).unwrap();
        assert!(refused(&file, 12).contains("a.txt"));
    }
}

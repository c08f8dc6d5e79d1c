//! Photographs in a folder.

use super::EXTENSIONS;
use nacre_base::{Error, Result};
use std::path::{Path, PathBuf};

/// Largest number of listed files.
const LIMIT: usize = 100_000;
/// Largest number of names in a message.
const SHOWN: usize = 6;

/// Paths of the photographs in a folder, recognised by extension and sorted, without hidden files.
///
/// # Errors
/// `Input` if the folder cannot be read or has no photographs.
pub fn photographs(folder: &Path) -> Result<Vec<PathBuf>> {
    list(folder).map(|(files, _)| files)
}

/// As [`photographs`], with the paths of all other files that are not hidden.
///
/// # Errors
/// As [`photographs`].
pub fn list(folder: &Path) -> Result<(Vec<PathBuf>, Vec<PathBuf>)> {
    let bad =
        |problem: String| Error::file(folder, problem, format!("give a folder with {} files", EXTENSIONS.join(", ")));
    let entries = std::fs::read_dir(folder).map_err(|e| bad(format!("cannot be read: {e}")))?;
    let seen = entries.flatten().filter(|entry| !entry.file_name().to_string_lossy().starts_with('.')).take(LIMIT);
    let is_photograph = |name: &PathBuf| {
        let extension = name.extension().map(|e| e.to_string_lossy().to_lowercase());
        extension.is_some_and(|e| EXTENSIONS.contains(&e.as_str()))
    };
    let named = seen.filter(|entry| !entry.path().is_dir()).map(|entry| PathBuf::from(entry.file_name()));
    let (mut files, mut others): (Vec<_>, Vec<_>) = named.partition(is_photograph);
    files.sort();
    others.sort();
    if !files.is_empty() {
        return Ok((files, others));
    }
    let names: Vec<String> = others.iter().take(SHOWN).map(|f| f.display().to_string()).collect();
    let but = if names.is_empty() { String::new() } else { format!(", but {}", names.join(", ")) };
    Err(bad(format!("holds no photograph{but}")))
}

/// File of this name in a folder, or else the folder's only photograph; `None` if there is neither.
pub fn photograph_in(folder: &Path, name: &str) -> Option<PathBuf> {
    let named = folder.join(name);
    if named.is_file() {
        return Some(named);
    }
    match photographs(folder).ok()?.as_slice() {
        [only] => Some(folder.join(only)),
        _ => None,
    }
}

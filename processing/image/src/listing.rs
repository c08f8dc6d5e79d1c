//! Photographs of a folder.

use super::EXTENSIONS;
use nacre_base::{Error, Result};
use std::path::{Path, PathBuf};

/// Most that are listed.
const LIMIT: usize = 100_000;

/// Names of the photographs in a folder, sorted, by their endings; hidden files are left out.
///
/// # Errors
/// `Input` when the folder cannot be read or holds none.
pub fn photographs(folder: &Path) -> Result<Vec<PathBuf>> {
    let bad =
        |problem: String| Error::file(folder, problem, format!("give a folder with {} files", EXTENSIONS.join(", ")));
    let entries = std::fs::read_dir(folder).map_err(|e| bad(format!("cannot be read: {e}")))?;
    let mut files: Vec<PathBuf> = entries
        .flatten()
        .map(|entry| PathBuf::from(entry.file_name()))
        .filter(|name| {
            let extension = name.extension().map(|e| e.to_string_lossy().to_lowercase());
            extension.is_some_and(|e| EXTENSIONS.contains(&e.as_str())) && !name.to_string_lossy().starts_with('.')
        })
        .take(LIMIT)
        .collect();
    files.sort();
    if files.is_empty() { Err(bad("holds no photograph".into())) } else { Ok(files) }
}

/// The file of this name in a folder; without one, the folder's only photograph. None where there is neither.
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

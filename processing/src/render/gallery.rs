//! Scenes to start from.

use crate::Result;
use crate::image::OutputFolder;

/// Writes scenes with their maps into a folder; their names.
///
/// # Errors
/// `Output` when the system refuses.
pub fn gallery(_folder: &OutputFolder) -> Result<Vec<&'static str>> {
    Ok(vec![])
}

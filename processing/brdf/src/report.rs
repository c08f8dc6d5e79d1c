//! Report of a product, in words and numbers.

use super::choose::Choice;
use super::height::Quality;
use super::settings::Settings;
use nacre_base::Result;
use nacre_image::{json, write_whole};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// What was computed, how, and how good it is.
#[derive(Serialize)]
pub struct Report<'a, T: Serialize> {
    /// The product.
    pub product: &'static str,
    /// What the reader must know before trusting the result.
    pub warnings: Vec<String>,
    /// Height field.
    pub input: PathBuf,
    /// What it holds.
    pub quality: &'a Quality,
    /// What was asked for.
    pub settings: &'a Settings,
    /// How densities were computed.
    pub choice: &'a Choice,
    /// Largest relative error of lobes with a thousandth of the light.
    pub error_estimate: f64,
    /// What is of this product only.
    #[serde(flatten)]
    pub more: T,
    /// Time in s.
    pub seconds: f64,
    /// Files that were written.
    pub files: Vec<PathBuf>,
}

impl<T: Serialize> Report<'_, T> {
    /// Writes it to its place.
    ///
    /// # Errors
    /// `Output` when the system refuses.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_whole(path, json(self).as_bytes())
    }
}

//! Input of operations on a single photograph: a file, merged exposures in a folder, or a series of exposures to merge
//! first.

use super::input::{bracket, work};
use super::{Options, Report, reconstruct};
use crate::stated::warnings_of;
use crate::{FILE_NAME, Transfer};
use nacre_base::estimate::Work;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_image::budget::Operation;
use nacre_image::{Depth, Info, photograph_in, size};
use std::path::{Path, PathBuf};

/// One photograph.
pub struct Source {
    /// Path of the file.
    pub path: PathBuf,
    /// Report of the merge, for a series of exposures. Their light is per second of exposure and unit of gain.
    pub merged: Option<Report>,
    /// Temporary folder of merged exposures.
    _folder: Option<tempfile::TempDir>,
}

impl Source {
    /// Finds the photograph at `input`; merges exposures if necessary.
    ///
    /// # Errors
    /// As [`reconstruct`] for exposures.
    pub fn find(input: &Path, progress: &dyn Progress) -> Result<Self> {
        if !is_bracket(input) {
            let path = file(input).unwrap_or_else(|| input.to_owned());
            return Ok(Self { path, merged: None, _folder: None });
        }
        let folder = tempfile::tempdir()
            .map_err(|e| Error::input("temporary folder", e.to_string(), "make room for it, or set TMPDIR"))?;
        let out = folder.path().join("hdr");
        let merged = Some(reconstruct(input, &out, &Options::default(), progress)?);
        Ok(Self { path: out.join("hdr.exr"), merged, _folder: Some(folder) })
    }

    /// Warnings about the photographs' files: those of merging, or those of a single file read with this transfer
    /// function.
    pub fn warnings(&self, transfer: Transfer) -> Vec<String> {
        match &self.merged {
            Some(merged) => merged.warnings.clone(),
            None => warnings_of(&self.path, transfer),
        }
    }

    /// Predicts the work of an operation on the photograph from its header, including merging. Rejects other files, too
    /// large photographs, and operations beyond the memory limit.
    ///
    /// # Errors
    /// `Input`.
    pub fn check(input: &Path, operation: Operation) -> Result<Work> {
        if is_bracket(input) {
            let frames = bracket(input, None)?;
            let merged = Info { depth: Depth::F32, ..frames.info };
            let (merging, after) = (work(&frames), operation.check(&frames.file(&frames.set.frames[0].file), merged)?);
            return Ok(after.preceded_by(&merging));
        }
        let file = file(input).unwrap_or_else(|| input.to_owned());
        size(&file)?;
        operation.check_file(&file)
    }
}

/// True if the input is a series of exposures.
pub fn is_bracket(input: &Path) -> bool {
    let json = input.extension().is_some_and(|e| e == "json");
    json || input.is_dir() && (input.join(FILE_NAME).is_file() || file(input).is_none())
}

/// The photograph: the input itself, the merged exposures in it, or its only photograph.
fn file(input: &Path) -> Option<PathBuf> {
    if input.is_dir() { photograph_in(input, "hdr.exr") } else { Some(input.to_owned()) }
}

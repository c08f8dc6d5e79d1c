//! What is merged: a `frames.json`, or a folder of photographs whose times are in their tags.

use crate::frames::{FILE_NAME, Frame, FrameSet, Kind, LoadedFrames, Transfer, check, load};
use crate::image::{Depth, exposure, photographs};
use crate::{Error, Result};
use std::path::Path;

/// Whether there is something to merge, without a look at any pixel.
///
/// # Errors
/// As [`reconstruct`](super::reconstruct) for what is no bracket.
pub fn check_input(input: &Path) -> Result<()> {
    bracket(input).map(drop)
}

/// Reads and checks what is to be merged.
///
/// # Errors
/// `Input` for anything that is not one view in several exposures.
pub(super) fn bracket(input: &Path) -> Result<LoadedFrames> {
    let bare = input.is_dir() && !input.join(FILE_NAME).exists();
    let frames = if bare { tagged(input)? } else { load(input)? };
    let set = &frames.set;
    let refuse = |problem: &str, remedy: &str| Err(Error::file(&frames.path, problem, remedy));
    if set.kind == Kind::DivisionOfFocalPlane {
        return refuse("holds frames of a polarization sensor", "give a set of kind exposures");
    }
    let first = &set.frames[0];
    let view = |f: &Frame| (f.analyser_deg, f.spot, f.fringes, f.flash, f.light_mm);
    if set.frames.iter().any(|f| view(f) != view(first)) {
        let problem = "holds several views: analyser, spot or flash differ between its frames";
        return refuse(problem, "merge one view at a time, or reconstruct polarization, which merges exposures itself");
    }
    Ok(frames)
}

/// A folder without a `frames.json`, whose photographs say their exposure times.
fn tagged(folder: &Path) -> Result<LoadedFrames> {
    let mut frames = vec![];
    for file in photographs(folder)? {
        let path = folder.join(&file);
        let tags = exposure(&path);
        let Some(seconds) = tags.and_then(|t| t.seconds) else {
            let remedy =
                "give photographs as the camera wrote them, or a frames.json with exposure_s (`nacre schema frames`)";
            return Err(Error::file(&path, "does not say its exposure time (Exif)", remedy));
        };
        frames.push(Frame {
            exposure_s: Some(seconds),
            gain: tags.and_then(|t| t.iso).map(|iso| iso / 100.0),
            ..Frame::new(file)
        });
    }
    let frames = check(folder.join(FILE_NAME), FrameSet::new(Kind::Exposures, frames))?;
    let transfer = if frames.info.depth == Depth::U8 { Transfer::Recover } else { Transfer::Linear };
    Ok(LoadedFrames { set: FrameSet { transfer, ..frames.set }, ..frames })
}

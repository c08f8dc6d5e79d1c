//! Input of a merge: a `frames.json`, or a folder of photographs with exposure times in their tags.

use crate::{FILE_NAME, Frame, FrameSet, Kind, LoadedFrames, Transfer, check, exposures, load};
use nacre_base::estimate::Work;
use nacre_base::{Error, Result};
use nacre_image::budget;
use nacre_image::{Depth, Info, details, photographs};
use std::path::Path;

/// Number of exposures decoded and merged together.
pub(super) const BATCH: usize = 4;

/// Maximum memory in bytes of decoded exposures kept for reuse.
pub(super) const KEPT: usize = 256 << 20;

/// Validates the input without reading pixels, and predicts the work.
///
/// # Errors
/// As [`reconstruct`](super::reconstruct) for inputs that are no bracket.
pub(super) fn check_input(input: &Path, white: Option<f64>) -> Result<Work> {
    bracket(input, white).map(|frames| work(&frames))
}

/// Predicted work of a merge.
pub(super) fn work(frames: &LoadedFrames) -> Work {
    let LoadedFrames { set, info, .. } = frames;
    let channels = if set.channel.is_some() { 1 } else { info.channels };
    Work { memory_bytes: needed(frames), ..work_of(Info { channels, ..*info }, set.frames.len()) }
}

/// Predicted work of a merge without dark photographs.
pub fn work_of(info: Info, photographs: usize) -> Work {
    let samples = info.width * info.height * info.channels;
    let seconds = 0.08 + 1e-6 * samples as f64 * (0.1 + 0.05 * photographs as f64);
    let memory_bytes = 16 * samples as u64 + BATCH as u64 * budget::decoded(info) + kept(info, photographs);
    // Light, variance and flags, and a picture.
    Work { operation: "hdr".into(), seconds, memory_bytes, disk_bytes: 13 * samples as u64, ..Work::default() }
}

/// Reads and validates the bracket. `white` overrides that of the photographs and of their description.
///
/// # Errors
/// `Input` unless the photographs show one view in several exposures, and unless `white` is above black.
pub(super) fn bracket(input: &Path, white: Option<f64>) -> Result<LoadedFrames> {
    let bare = input.is_dir() && !input.join(FILE_NAME).exists();
    let mut frames = if bare { tagged(input)? } else { load(input)? };
    if let Some(white) = white {
        let black = frames.set.black.unwrap_or(0.0);
        if !(white.is_finite() && white > black) {
            let problem = format!("{white} is not above black ({black})");
            return Err(Error::input("--white", problem, "give the file value of a saturated pixel"));
        }
        frames.set.white = Some(white);
    }
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
    budget::check(&frames.file(&first.file), frames.info, needed(&frames))?;
    Ok(frames)
}

/// Peak memory of a merge in bytes: sums, a resampled photograph, a batch of decoded photographs, and kept photographs
/// with their dark photographs.
fn needed(frames: &LoadedFrames) -> u64 {
    let LoadedFrames { set, info, .. } = frames;
    let channels = if set.channel.is_some() { 1 } else { info.channels };
    let floats = 4 * (info.width * info.height * channels) as u64;
    let dark = set.dark.is_some() || set.frames.iter().any(|f| f.dark.is_some());
    // Sums and a resampled exposure have two floats each. A dark photograph is kept, and scaled for each photograph of
    // a batch.
    let planes = 4 + if dark { 1 + BATCH as u64 } else { 0 } + u64::from(set.flat.is_some());
    planes * floats + BATCH as u64 * budget::decoded(*info) + kept(*info, set.frames.len())
}

/// Peak memory in bytes of kept photographs and of the preview computed from them.
fn kept(info: Info, photographs: usize) -> u64 {
    let each = info.width * info.height * info.channels * info.depth.bytes();
    each.saturating_mul(photographs).min(KEPT) as u64 + budget::overview((info.width * info.height) as u64)
}

/// A folder without `frames.json`, with exposure times from the photographs' tags.
fn tagged(folder: &Path) -> Result<LoadedFrames> {
    let mut frames = vec![];
    let files = photographs(folder)?;
    let (tags, apertures) = exposures(folder, &files)?;
    for (file, tags) in files.into_iter().zip(tags) {
        let path = folder.join(&file);
        let Some(seconds) = tags.seconds else {
            let remedy =
                "give photographs as the camera wrote them, or a frames.json with exposure_s (`nacre schema frames`)";
            return Err(Error::file(&path, "does not say its exposure time (Exif)", remedy));
        };
        frames.push(Frame { exposure_s: Some(seconds), gain: tags.gain, ..Frame::new(file) });
    }
    // Cameras apply a tone curve to 8-bit files, whatever transfer function these state.
    let first = details(&folder.join(&frames[0].file))?;
    let stated = first.encoding.and_then(|encoding| Transfer::of(encoding.curve)).unwrap_or(Transfer::Linear);
    let transfer = if first.info.depth == Depth::U8 { Transfer::Recover } else { stated };
    let set = FrameSet { transfer, ..FrameSet::new(Kind::Exposures, frames) };
    let mut frames = check(folder.join(FILE_NAME), set)?;
    frames.warnings.extend(apertures);
    Ok(frames)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn need_grows_with_samples_and_dark_photographs_but_not_with_exposures() {
        let mib = |change: &dyn Fn(&mut FrameSet, &mut Info)| {
            let mut set = FrameSet::new(Kind::Exposures, vec![Frame::new("a.png"), Frame::new("b.png")]);
            let mut info = Info { width: 1 << 10, height: 1 << 10, channels: 3, depth: Depth::U8 };
            change(&mut set, &mut info);
            let frames = LoadedFrames {
                path: FILE_NAME.into(),
                folder: ".".into(),
                set,
                info,
                warnings: vec![],
                from_session: false,
            };
            (needed(&frames) - kept(info, frames.set.frames.len())) >> 20
        };
        let one = mib(&|_, _| ());
        assert_eq!(one, 3 * 16 + 4 * 2 * 3);
        assert_eq!(mib(&|set, _| set.frames.extend(set.frames.clone())), one);
        assert_eq!(mib(&|_, info| info.width *= 2), 2 * one);
        assert_eq!(mib(&|_, info| info.depth = Depth::F32), 3 * 16 + 4 * 2 * 12);
        assert_eq!(mib(&|set, _| set.channel = Some(crate::Channel::G)), 16 + 4 * 2 * 3);
        assert_eq!(mib(&|set, _| set.frames[0].dark = Some("d.png".into())), one + 3 * 4 * 5);
        assert_eq!(mib(&|set, _| set.flat = Some("f.png".into())), one + 3 * 4);

        let info = Info { width: 1 << 10, height: 1 << 10, channels: 3, depth: Depth::U8 };
        assert_eq!([2, 4, 1 << 20].map(|count| kept(info, count) >> 20), [40 + 6, 40 + 12, 40 + 256]);
    }
}

//! Time, memory and disk space of a reconstruction.

use crate::fit::demosaic::Demosaic;
use crate::fit::views::{View, brackets, views};
use crate::{Model, Options};
use nacre_base::Result;
use nacre_base::estimate::Work;
use nacre_frames::LoadedFrames;
use nacre_image::budget;
use std::collections::BTreeSet;

/// Bytes per pixel of the maps: 11 floats while registered photographs are refitted (10 while the map is smoothed).
const ALIKE: u64 = 44;

/// Bytes per pixel with merged exposures: 22 floats.
const MERGED: u64 = 88;

/// Memory in bytes of grating models, for each of the first [`MODELLED`] pixels of the map. Measured at 0.26 to 16
/// Mpixel, as the next two constants.
const MODELS: u64 = 24;
const MODELLED: u64 = 4 << 20;

/// Memory in bytes of grating models for a map of any size.
const MODELS_ALONE: u64 = 12 << 20;

/// Bytes per pixel while a photograph is interpolated: the four images and two estimates of one.
const INTERPOLATED: u64 = 24;

/// Photographs, or brackets of them, that are decoded simultaneously.
const AT_A_TIME: u64 = 2;

/// Work of the reconstruction of a set, from the headers of its photographs; `gratings` if grating models are compared.
///
/// # Errors
/// `Input`, naming the first photograph, if the reconstruction would not fit into memory, and for sets of another kind.
pub fn work(frames: &LoadedFrames, demosaic: Demosaic, gratings: bool) -> Result<Work> {
    let brackets = brackets(&frames.set.frames);
    let views = views(frames, &brackets, demosaic)?;
    let step = views.first().map_or(1, |view| view.step);
    let size = [frames.info.width / step, frames.info.height / step];
    let needed = needed(frames, &brackets, &views, demosaic) + of_results(size[0] * size[1], gratings);
    frames.set.frames.first().map_or(Ok(()), |first| budget::check(&frames.file(&first.file), frames.info, needed))?;
    Ok(Work { memory_bytes: needed, ..work_of(frames.set.frames.len() * step * step, size, gratings) })
}

/// Work of the reconstruction of maps from this number and size of photographs, without dark photographs and brackets.
pub fn work_of(photographs: usize, size: [usize; 2], gratings: bool) -> Work {
    let pixels = size[0] * size[1];
    let mega = 1e-6 * pixels as f64;
    // The models are compared on a fixed number of points, for maps of any size.
    let models = if gratings { 0.7 + 0.6 * mega } else { 0.0 };
    let seconds = 0.05 + mega * (0.06 + 0.012 * photographs as f64) + models;
    let memory_bytes = pixels as u64 * (ALIKE + 4 * AT_A_TIME) + of_results(pixels, gratings);
    let disk_bytes = pixels as u64 * if gratings { 48 } else { 40 };
    let operation = if gratings { "polarization of gratings" } else { "polarization" };
    Work { operation: operation.into(), seconds, memory_bytes, disk_bytes, ..Work::default() }
}

impl Options {
    /// Work of the reconstruction of a set.
    ///
    /// # Errors
    /// As [`work`].
    pub fn work(&self, frames: &LoadedFrames) -> Result<Work> {
        work(frames, self.demosaic, self.model_for(frames) != Model::Plain)
    }
}

/// Refuses a set whose reconstruction would not fit into memory.
///
/// # Errors
/// As [`work`].
pub fn check_memory(frames: &LoadedFrames, demosaic: Demosaic) -> Result<()> {
    work(frames, demosaic, false).map(drop)
}

/// Upper bound in bytes of the memory for pictures and models of a map with this number of pixels.
fn of_results(pixels: usize, gratings: bool) -> u64 {
    let pixels = pixels as u64;
    let models = if gratings { MODELS * pixels.min(MODELLED) + MODELS_ALONE } else { 0 };
    budget::overview(pixels) + models
}

/// Largest number of bytes of photographs and maps in memory at a time, independent of the number of photographs.
fn needed(frames: &LoadedFrames, brackets: &[Vec<usize>], views: &[View], demosaic: Demosaic) -> u64 {
    let LoadedFrames { set, info, .. } = frames;
    let pixels = (info.width * info.height) as u64;
    let step = views.first().map_or(1, |view| view.step) as u64;
    let exposures = brackets.iter().map(Vec::len).max().unwrap_or(1) as u64;
    let darks: BTreeSet<_> = set.frames.iter().filter_map(|f| f.dark.as_ref()).chain(&set.dark).collect();
    let planes = darks.len() as u64 + u64::from(set.flat.is_some());
    let map = if exposures > 1 { MERGED } else { ALIKE };
    let images = if demosaic == Demosaic::None { 0 } else { INTERPOLATED };
    pixels / (step * step) * map
        + AT_A_TIME * exposures * (budget::decoded(*info) + pixels * images)
        + 4 * pixels * planes
}

#[cfg(test)]
mod tests {
    use super::*;
    use nacre_frames::{Frame, FrameSet, Kind, Layout, Sensor};
    use nacre_image::{Depth, Info};
    use std::path::Path;

    const MEGAPIXEL: u64 = 1 << 20;

    fn bytes_per_pixel(kind: Kind, change: impl Fn(&mut FrameSet)) -> u64 {
        interpolated(kind, Demosaic::None, change)
    }

    fn interpolated(kind: Kind, demosaic: Demosaic, change: impl Fn(&mut FrameSet)) -> u64 {
        let frame = |angle: f64| Frame { analyser_deg: Some(angle), ..Frame::new("a.png") };
        let mut set = FrameSet::new(kind, [0.0, 45.0, 90.0, 135.0].map(frame).to_vec());
        if kind == Kind::DivisionOfFocalPlane {
            (set.frames, set.layout) = (vec![Frame::new("a.png")], Some(Layout::Named(Sensor::Sony)));
        }
        change(&mut set);
        let info = Info { width: 1024, height: 1024, channels: 1, depth: Depth::U16 };
        let (path, folder) = ("frames.json".into(), Path::new(".").into());
        let frames = LoadedFrames { path, folder, set, info, warnings: vec![], from_session: false };
        let brackets = brackets(&frames.set.frames);
        needed(&frames, &brackets, &views(&frames, &brackets, demosaic).unwrap(), demosaic) / MEGAPIXEL
    }

    #[test]
    fn need_grows_with_pixels_exposures_and_dark_photographs_alone() {
        let one = bytes_per_pixel(Kind::Polarization, |_| ());
        assert_eq!(one, 44 + 2 * 4);
        let twice = |set: &mut FrameSet| set.frames.extend(set.frames.clone());
        assert_eq!(bytes_per_pixel(Kind::Polarization, twice), one);
        let bracketed = |set: &mut FrameSet| {
            let longer = |f: &Frame| Frame { exposure_s: Some(8.0), ..f.clone() };
            set.frames.extend(set.frames.iter().map(longer).collect::<Vec<_>>());
        };
        assert_eq!(bytes_per_pixel(Kind::Polarization, bracketed), 88 + 4 * 4);
        assert_eq!(bytes_per_pixel(Kind::DivisionOfFocalPlane, |_| ()), 11 + 2 * 4);
        assert_eq!(interpolated(Kind::DivisionOfFocalPlane, Demosaic::Bilinear, |_| ()), 44 + 2 * (4 + 24));
        let corrected = |set: &mut FrameSet| {
            (set.dark, set.flat) = (Some("dark.png".into()), Some("flat.png".into()));
            set.frames.iter_mut().for_each(|f| f.dark = Some("own.png".into()));
        };
        assert_eq!(bytes_per_pixel(Kind::Polarization, corrected), one + 3 * 4);
    }
}

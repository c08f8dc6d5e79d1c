//! The complete job: from a set of photographs to maps, pictures and a report in a new folder.

use crate::{Options, Report};
use nacre_base::Result;
use nacre_base::operation::perform;
use nacre_base::progress::Progress;
use std::path::Path;

/// Reconstructs the orientation map of `input` (a session folder, or `frames.json` of kind polarization or
/// division_of_focal_plane) into the new folder `out`.
///
/// Memory: 6 floats per pixel and two decoded photographs, for any number of frames. With merged exposures 22 floats
/// and the photographs at two angles; 10 floats while the map is smoothed.
///
/// # Errors
/// `Input` for faults of the photographs, before anything is written. `Output` if writing fails; the output is then
/// removed. `Cancelled`.
pub fn reconstruct(input: &Path, out: &Path, options: &Options, progress: &dyn Progress) -> Result<Report> {
    perform(options, input, out, false, progress)
}

//! The whole job: a set of photographs to maps, pictures and a report in a new folder.

use crate::{Options, Report};
use nacre_base::Result;
use nacre_base::operation::perform;
use nacre_base::progress::Progress;
use std::path::Path;

/// Reconstructs the orientation map of `input` (a session folder or `frames.json` of kind polarization or
/// division_of_focal_plane) into the new folder `out`.
///
/// Memory: 6 floats per pixel and two decoded photographs, whatever the number of frames; where several exposures at each
/// angle are merged, 22 floats and the photographs at two angles; 10 while the map is smoothed.
///
/// # Errors
/// `Input` for anything about the photographs, before anything is written; `Output` when writing fails, after which
/// nothing is left behind; `Cancelled`.
pub fn reconstruct(input: &Path, out: &Path, options: &Options, progress: &dyn Progress) -> Result<Report> {
    perform(options, input, out, false, progress)
}

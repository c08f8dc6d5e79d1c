//! Merge of photographs in memory.

use super::coding::{Coding, Curve};
use super::merge::{Exposed, Sums};
use crate::{FrameSet, planned};
use nacre_base::{Error, Result};
use nacre_image::Raster;
use std::path::Path;

/// Merged light.
#[derive(Clone, Debug)]
pub struct Merged {
    /// `width · height · channels` samples as in a [`Raster`]: linear value per exposure and gain, and its variance;
    /// NaN where all exposures are saturated.
    pub samples: Vec<[f32; 2]>,
}

/// Merges all channels of photographs with a known response; `rasters` are those of the set's frames, in order. Dark
/// and flat photographs and registration require [`reconstruct`](super::reconstruct).
///
/// # Errors
/// `Input` for an invalid set, and for rasters that do not match it.
pub fn merge(set: FrameSet, rasters: Vec<Raster>) -> Result<Merged> {
    let bad =
        |problem: &str| Error::input("photographs", problem, "give one raster per frame, all of one size and depth");
    let first = rasters.first().map(Raster::info).ok_or_else(|| bad("there are none"))?;
    if rasters.len() != set.frames.len() || rasters.iter().any(|r| r.info() != first) {
        return Err(bad("do not belong together"));
    }
    let transfer = set.transfer;
    let frames = planned(Path::new(""), set, first)?;
    let coding = Coding::new(&frames, Curve::Stated(transfer));
    let channels: Vec<usize> = (0..first.channels).collect();
    let mut sums = Sums::new(first.width * first.height, &channels);
    let exposed = rasters.into_iter().zip(&frames.set.frames);
    let mut exposed: Vec<Exposed> = exposed.map(|(raster, frame)| Exposed { frame, raster, dark: vec![] }).collect();
    exposed.sort_by(|a, b| a.frame.scale().total_cmp(&b.frame.scale()));
    sums.add(&coding, &exposed);
    Ok(Merged { samples: sums.solved() })
}

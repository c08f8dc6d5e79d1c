//! Camera raw files: linear sensor values at half size. Each cell of 2 × 2 colour filters (Bayer) becomes one pixel:
//! red, mean of both greens, blue. White balance and colour matrix are not applied, and black is not subtracted.
//!
//! Decoding needs the feature `raw` (the crate rawler). Without it these files are recognised and refused by name.

#[cfg(feature = "raw")]
mod boxes;
#[cfg(feature = "raw")]
mod cells;
#[cfg(feature = "raw")]
mod contained;
#[cfg(feature = "raw")]
mod decode;
#[cfg(feature = "raw")]
mod limits;
mod recognise;
#[cfg_attr(not(feature = "raw"), expect(dead_code, reason = "only decoding needs all of it"))]
mod tags;

use serde::{Deserialize, Serialize};

pub(super) use recognise::{Kind, by_magic, by_tags};

#[cfg(feature = "raw")]
pub use contained::Decoding;
#[cfg(feature = "raw")]
pub(super) use contained::{exposure, info, levels, read};

/// Exposure settings; `None` without the tag.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Taken {
    /// Exposure time in s.
    pub(super) seconds: Option<f64>,
    /// Sensitivity (ISO).
    pub(super) iso: Option<f64>,
    /// f-number.
    pub(super) aperture: Option<f64>,
}

#[cfg(not(feature = "raw"))]
pub use absent::Decoding;
#[cfg(not(feature = "raw"))]
pub(super) use absent::{exposure, info, levels, read};

#[cfg(not(feature = "raw"))]
mod absent {
    use std::path::Path;

    use nacre_base::contained::Part;
    use nacre_base::{Error, Result};
    use serde::Deserialize;

    use super::{Kind, Taken};
    use crate::fault::{Decoded, Fault};
    use crate::raster::{Info, Raster};
    use crate::source::Source;

    /// Remedy; the command makes the same picture as this module: linear, half the size, without white balance.
    const REMEDY: &str = "convert it with `dcraw -4 -h -o 0 -r 1 1 1 1 -T FILE` to a linear 16-bit TIFF of half the size, or use a build with `--features raw`";

    /// Request to decode a camera raw file in another process; not supported by this build.
    #[derive(Debug, Deserialize)]
    pub struct Decoding {}

    impl Decoding {
        /// Decodes the file in this process.
        ///
        /// # Errors
        /// Always `Input`, because this build does not decode raw files.
        pub fn perform(&self) -> Result<Part> {
            Err(Error::input("camera raw files", "are not read by this build of nacre", REMEDY))
        }
    }

    fn refused<T>(kind: Kind) -> Decoded<T> {
        let problem = format!("is a {} file (camera raw), which this build of nacre does not read", kind.name);
        Err(Fault::unusable(problem, REMEDY))
    }

    pub(crate) fn info(_: &Path, _: Source, kind: Kind) -> Decoded<Info> {
        refused(kind)
    }

    pub(crate) fn read(_: &Path, _: Source, kind: Kind) -> Decoded<Raster> {
        refused(kind)
    }

    pub(crate) fn levels(_: &Path, _: Source, kind: Kind) -> Decoded<Option<[f64; 2]>> {
        refused(kind)
    }

    pub(crate) fn exposure(_: &Path, _: Source, _: Kind) -> Option<Taken> {
        None
    }
}

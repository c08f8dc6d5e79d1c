//! Opens image files for decoders, and converts their faults and panics to errors that name the file.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use super::fault::{Decoded, Fault, RENEW};
use super::raster::MAX_BYTES;
use nacre_base::Result;
use nacre_base::guard::guarded;
use nacre_base::input::{self, Unreadable};

/// Open image file, at its start.
pub(super) type Source = BufReader<File>;

/// Opens a regular file that is neither empty nor larger than the limit.
pub(super) fn open(path: &Path) -> Decoded<Source> {
    let file = input::open(path, MAX_BYTES).map_err(|error| match error {
        Unreadable::System(error) => error.into(),
        Unreadable::NotAFile(_) => Fault::unusable(error, "name one image file"),
        Unreadable::TooLarge { .. } => Fault::too_large(format!("is larger than {} GiB", MAX_BYTES >> 30)),
    })?;
    if file.metadata()?.len() == 0 {
        return Err(Fault::unusable("is empty", RENEW));
    }
    Ok(BufReader::with_capacity(1 << 16, file))
}

/// Runs a decoder on the file at `path`; its panic counts as damage of the file.
pub(super) fn decode<T>(path: &Path, decoder: impl FnOnce() -> Decoded<T>) -> Result<T> {
    guarded(decoder).unwrap_or_else(|panic| Err(Fault::unusable(panic, RENEW))).map_err(|fault| fault.at(path))
}

//! Opens image files for decoders and turns their faults and panics into errors that name the file.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use super::fault::{Decoded, Fault, RENEW};
use super::raster::MAX_BYTES;
use nacre_base::Result;
use nacre_base::guard::guarded;

/// An open image file, at its start.
pub(super) type Source = BufReader<File>;

/// Opens a regular, not empty, not gigantic file.
pub(super) fn open(path: &Path) -> Decoded<Source> {
    let meta = std::fs::metadata(path)?;
    if meta.is_dir() {
        return Err(Fault::unusable("is a folder, not an image", "name one image file"));
    }
    if !meta.is_file() {
        return Err(Fault::unusable("is not a regular file", "name an image file"));
    }
    if meta.len() == 0 {
        return Err(Fault::unusable("is empty", RENEW));
    }
    if meta.len() > MAX_BYTES {
        return Err(Fault::too_large(format!("is larger than {} GiB", MAX_BYTES >> 30)));
    }
    Ok(BufReader::with_capacity(1 << 16, File::open(path)?))
}

/// Runs a decoder on the file at `path`; its panic is damage of the file, like any other.
pub(super) fn decode<T>(path: &Path, decoder: impl FnOnce() -> Decoded<T>) -> Result<T> {
    guarded(decoder).unwrap_or_else(|panic| Err(Fault::unusable(panic, RENEW))).map_err(|fault| fault.at(path))
}

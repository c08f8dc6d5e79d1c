//! Rows of one channel of an OpenEXR file. Other channels are not read from disk if the file is stored in blocks of
//! rows.

use std::collections::BTreeMap;
use std::path::Path;

use super::layer::Layer;
use super::{attributes, utf8};
use crate::source::{decode, open};
use nacre_base::Result;

/// Header of the first flat layer of an EXR file.
#[derive(Debug, Clone, PartialEq)]
pub struct ExrHeader {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Names of the channels.
    pub channels: Vec<String>,
    /// Text and number attributes other than those that every EXR has, as text.
    pub attributes: BTreeMap<String, String>,
}

/// Reads size, channel names and attributes of the first flat layer of an EXR file, without its pixels.
///
/// # Errors
/// `Error::Input` when the file cannot be read, is not an EXR, is damaged, or is beyond the size limits.
pub fn read_exr_header(path: &Path) -> Result<ExrHeader> {
    decode(path, || {
        let layer = Layer::first(open(path)?)?;
        let [width, height] = layer.window.size;
        let channels = layer.header().channels.list.iter().map(|c| utf8(&c.name)).collect();
        Ok(ExrHeader { width, height, channels, attributes: attributes(layer.header()) })
    })
}

/// Calls `put(row, column, values)` for pieces of the rows of one channel that `wanted` selects, row 0 on top. Pixels
/// outside of the data window are left out. Answers with width and height; `None` if there is no channel of that name.
///
/// Blocks of the file without a selected row are not read. The memory does not grow with the height of the picture.
///
/// # Errors
/// As [`read_exr_header`].
pub fn read_exr_rows(
    path: &Path,
    name: &str,
    wanted: &(dyn Fn(usize) -> bool + Sync),
    mut put: impl FnMut(usize, usize, &[f32]),
) -> Result<Option<[usize; 2]>> {
    decode(path, || {
        let layer = Layer::first(open(path)?)?;
        let size = layer.window.size;
        let Some(channel) = layer.header().channels.list.iter().position(|c| utf8(&c.name) == name) else {
            return Ok(None);
        };
        layer.decode_rows(wanted, &|c| c == channel, |_, start, line| {
            put(start / size[0], start % size[0], line);
        })?;
        Ok(Some(size))
    })
}

//! Meshes from OBJ, PLY and glTF files.
//!
//! Faces become triangles, concave ones by ear clipping. [`LeftOut`] counts the ignored parts of a file.

mod draft;
mod fault;
mod gltf;
mod left_out;
mod obj;
mod ply;
mod ply_header;
mod polygon;
#[cfg(test)]
mod tests;

pub(crate) use left_out::LeftOut;

use crate::shape::mesh::Raw;
use draft::Draft;
use fault::Fault;
use nacre_base::guard::guarded;
use nacre_base::input::{self, Unreadable};
use nacre_base::{Error, Result};
use std::path::Path;

/// Maximum file size in bytes.
const MAX_BYTES: u64 = 1 << 30;

const REMEDY: &str = "give an OBJ, PLY or glTF (.gltf, .glb) file";

/// Reads a mesh. The first bytes determine the format, or else the file extension.
///
/// # Errors
/// `Input` for other formats, and for files that are damaged, too large, or need an unsupported feature.
pub(crate) fn read(path: &Path) -> Result<Raw> {
    let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let bytes = bytes(path)?;
    let decode = || {
        let mut draft = Draft::default();
        let unmarked = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&bytes);
        match unmarked {
            [b'p', b'l', b'y', b'\r' | b'\n' | b' ', ..] => ply::read(unmarked, &mut draft)?,
            [b'g', b'l', b'T', b'F', ..] => gltf::read(unmarked, path, &mut draft)?,
            _ => match ending.as_str() {
                "obj" => obj::read(&bytes, &mut draft)?,
                "ply" => return Err(Fault::refused("does not begin with the line \"ply\"", REMEDY)),
                "gltf" | "glb" => gltf::read(unmarked, path, &mut draft)?,
                _ => return Err(Fault::refused(format!("ends in {ending:?}"), REMEDY)),
            },
        }
        draft.checked()
    };
    let draft = guarded(decode)
        .unwrap_or_else(|panic| Err(Fault::damaged(panic.to_string())))
        .map_err(|fault| fault.at(path))?;
    let Draft { corners, triangles, left_out, .. } = draft;
    Ok(Raw { name: path.display().to_string(), corners, triangles, left_out })
}

fn bytes(path: &Path) -> Result<Vec<u8>> {
    input::read(path, MAX_BYTES).map_err(|error| match error {
        Unreadable::TooLarge { .. } => {
            Error::file(path, error, format!("give a mesh of at most {} MiB", MAX_BYTES >> 20))
        }
        _ => Error::file(path, error, REMEDY),
    })
}

/// The file as text without a byte order mark; UTF-16 is decoded.
fn text(bytes: &[u8]) -> std::borrow::Cow<'_, str> {
    let utf16 = |bytes: &[u8], word: fn([u8; 2]) -> u16| {
        let words: Vec<u16> = bytes.as_chunks::<2>().0.iter().map(|pair| word(*pair)).collect();
        String::from_utf16_lossy(&words).into()
    };
    match bytes {
        [0xef, 0xbb, 0xbf, rest @ ..] => String::from_utf8_lossy(rest),
        [0xff, 0xfe, rest @ ..] => utf16(rest, u16::from_le_bytes),
        [0xfe, 0xff, rest @ ..] => utf16(rest, u16::from_be_bytes),
        _ => String::from_utf8_lossy(bytes),
    }
}

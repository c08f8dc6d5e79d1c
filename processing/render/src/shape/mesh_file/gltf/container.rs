//! The binary container of glTF (GLB): a JSON chunk and a data chunk.

use crate::shape::mesh_file::fault::{Decoded, Fault};

const JSON: u32 = 0x4e4f_534a;
const BINARY: u32 = 0x004e_4942;

/// Splits a file into JSON and data; text files have no data.
pub(super) fn split(bytes: &[u8]) -> Decoded<(&[u8], Option<&[u8]>)> {
    let Some(rest) = bytes.strip_prefix(b"glTF") else { return Ok((bytes, None)) };
    let damaged = || Fault::damaged("is a truncated GLB file");
    let word =
        |bytes: &[u8], at: usize| -> Option<u32> { Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?)) };
    let version = word(rest, 0).ok_or_else(damaged)?;
    if version != 2 {
        return Err(Fault::refused(format!("is binary glTF {version}; 2 is read"), "export it as glTF 2.0"));
    }
    let mut rest = rest.get(8..).ok_or_else(damaged)?;
    let (mut json, mut binary) = (None, None);
    while rest.len() >= 8 {
        let (Some(length), Some(kind)) = (word(rest, 0), word(rest, 4)) else { break };
        let chunk = rest.get(8..8 + length as usize).ok_or_else(damaged)?;
        match kind {
            JSON if json.is_none() => json = Some(chunk),
            BINARY if binary.is_none() => binary = Some(chunk),
            _ => {}
        }
        rest = &rest[8 + length as usize..];
    }
    Ok((json.ok_or_else(damaged)?, binary))
}

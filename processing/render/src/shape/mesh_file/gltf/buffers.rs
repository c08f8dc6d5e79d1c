//! Buffers of a glTF file: external, embedded in its JSON, or in its binary chunk.

use super::document::Document;
use crate::scene::inside;
use crate::shape::mesh_file::fault::{Decoded, Fault};
use crate::shape::mesh_file::{MAX_BYTES, bytes};
use base64::Engine;
use base64::alphabet::{STANDARD, URL_SAFE};
use base64::engine::{DecodePaddingMode, GeneralPurpose, GeneralPurposeConfig};
use std::path::Path;

/// The data of all buffers.
pub(super) struct Buffers(Vec<Vec<u8>>);

impl Buffers {
    pub(super) fn read(document: &Document, binary: Option<&[u8]>, path: &Path) -> Decoded<Self> {
        let mut all = vec![];
        let mut total = 0;
        for (k, buffer) in document.buffers.iter().enumerate() {
            let data = match (&buffer.uri, binary) {
                (Some(uri), _) => match uri.get(..5).filter(|scheme| scheme.eq_ignore_ascii_case("data:")) {
                    Some(_) => embedded(&uri[5..]).ok_or_else(|| {
                        Fault::damaged(format!(
                            "has buffer {k} in its text, which is neither base64 nor percent-encoded"
                        ))
                    })?,
                    None => beside(uri, path)?,
                },
                (None, Some(binary)) if k == 0 => binary.to_vec(),
                // Buffers of compressed views have no data; such views are refused where they are used.
                (None, _) => vec![],
            };
            if !data.is_empty() && data.len() < buffer.byte_length {
                let problem = format!("has {} bytes in buffer {k}, which promises {}", data.len(), buffer.byte_length);
                return Err(Fault::damaged(problem));
            }
            total += data.len() as u64;
            if total > MAX_BYTES {
                let problem = format!("has more than {} MiB of buffers", MAX_BYTES >> 20);
                return Err(Fault::refused(problem, "give a smaller mesh"));
            }
            all.push(data);
        }
        Ok(Self(all))
    }

    /// Bytes of a buffer.
    pub(super) fn get(&self, index: usize) -> Option<&[u8]> {
        self.0.get(index).map(Vec::as_slice)
    }
}

/// Reads a file in the folder of the mesh, or below it.
fn beside(uri: &str, path: &Path) -> Decoded<Vec<u8>> {
    let decoded = String::from_utf8(percent_decoded(uri)).unwrap_or_else(|_| uri.to_owned());
    // Unencoded names may contain a percent sign.
    let folder = path.with_file_name("");
    let name = if !folder.join(&decoded).exists() && inside(Path::new(uri)) && folder.join(uri).exists() {
        uri
    } else {
        &decoded
    };
    if !inside(Path::new(name)) || name.contains("://") {
        let problem = format!("has a buffer outside of its folder: {uri}");
        return Err(Fault::refused(problem, "put the file beside the mesh and name it alone"));
    }
    bytes(&folder.join(name)).map_err(|e| {
        Fault::refused(format!("has a buffer {name:?} that cannot be read ({e})"), "put this file beside the mesh")
    })
}

/// Decodes a URI after `data:`.
fn embedded(uri: &str) -> Option<Vec<u8>> {
    let (kind, data) = uri.split_once(',')?;
    let data = percent_decoded(data);
    if !kind.to_ascii_lowercase().ends_with(";base64") {
        return Some(data);
    }
    let data: Vec<u8> = data.into_iter().filter(|b| !b.is_ascii_whitespace()).collect();
    let alphabet = if data.iter().any(|b| matches!(b, b'-' | b'_')) { URL_SAFE } else { STANDARD };
    let config = GeneralPurposeConfig::new()
        .with_decode_padding_mode(DecodePaddingMode::Indifferent)
        .with_decode_allow_trailing_bits(true);
    GeneralPurpose::new(&alphabet, config).decode(data).ok()
}

/// Percent-decodes text to bytes; percent signs without two hexadecimal digits are kept.
fn percent_decoded(text: &str) -> Vec<u8> {
    let bytes = text.as_bytes();
    let digit = |at: usize| bytes.get(at).and_then(|b| (*b as char).to_digit(16));
    let mut decoded = Vec::with_capacity(bytes.len());
    let mut at = 0;
    while at < bytes.len() {
        match (bytes[at], digit(at + 1), digit(at + 2)) {
            (b'%', Some(high), Some(low)) => {
                decoded.push((16 * high + low) as u8);
                at += 3;
            }
            (byte, ..) => {
                decoded.push(byte);
                at += 1;
            }
        }
    }
    decoded
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percent_signs() {
        assert_eq!(percent_decoded("a%20b%c3%A9%2"), "a bé%2".as_bytes());
        assert_eq!(percent_decoded("100%"), b"100%");
    }

    #[test]
    fn data_in_the_text() {
        assert_eq!(embedded("application/octet-stream;base64,AAEC").unwrap(), [0, 1, 2]);
        assert!(embedded("application/gltf-buffer;base64,AAECA-_/").is_none());
        assert_eq!(embedded(";base64,AA\nE").unwrap(), [0, 1]);
        assert_eq!(embedded("application/octet-stream,%00a%ff").unwrap(), [0, b'a', 255]);
        assert!(embedded("nothing").is_none());
    }
}

//! `geometry.json`. It may come from anywhere, so nothing in it is trusted.

use super::Geometry;
use nacre_base::text::{from_json, read_text};
use nacre_base::write_whole;
use nacre_base::{Error, Result};
use std::path::Path;

/// Largest file that is read; a geometry needs about 2 KiB.
const MAX_BYTES: u64 = 1 << 20;

const REMEDY: &str =
    "give a geometry.json as `nacre calibrate geometry` writes it; `nacre schema geometry` prints what is allowed";

/// The geometry that lies beside photographs.
const NAME: &str = "geometry.json";

/// The geometry in the folder of photographs, if there is one.
///
/// # Errors
/// As [`load`].
pub fn beside(folder: &Path) -> Result<Option<Geometry>> {
    let path = folder.join(NAME);
    if path.is_file() { load(&path).map(Some) } else { Ok(None) }
}

/// Reads and checks a geometry.
///
/// # Errors
/// `Input`, naming the file and the key, for anything that cannot be used: unknown keys too.
pub fn load(path: &Path) -> Result<Geometry> {
    let text = read_text(path, MAX_BYTES, REMEDY)?;
    parse(&text).map_err(|problem| Error::file(path, problem, REMEDY))
}

/// Reads and checks the text of a geometry.
///
/// # Errors
/// What is wrong, naming the key.
pub fn parse(text: &str) -> std::result::Result<Geometry, String> {
    let geometry: Geometry = from_json(text)?;
    match geometry.check() {
        Err(Error::Input { subject, problem, remedy }) => Err(format!("{subject} {problem} ({remedy})")),
        Err(other) => Err(other.to_string()),
        Ok(()) => Ok(geometry),
    }
}

/// Writes a geometry, whole or not at all; a file that is there is replaced.
///
/// # Errors
/// `Input` when [`load`] would refuse it, `Output` when the system refuses.
pub fn save(geometry: &Geometry, path: &Path) -> Result<()> {
    geometry.check()?;
    write_whole(path, text(geometry).as_bytes())
}

/// Text of a geometry: a key a line, as far as that reads well.
pub fn text(geometry: &Geometry) -> String {
    // Serialising plain data with string keys cannot fail.
    let value = serde_json::to_value(geometry).unwrap_or_default();
    let mut out = String::new();
    put(&mut out, &value, 0);
    out + "\n"
}

/// Objects with a key a line, lists on one.
fn put(out: &mut String, value: &serde_json::Value, depth: usize) {
    let Some(object) = value.as_object().filter(|o| !o.is_empty()) else {
        out.push_str(&value.to_string().replace(',', ", "));
        return;
    };
    out.push_str("{\n");
    for (k, (key, value)) in object.iter().enumerate() {
        out.push_str(&"  ".repeat(depth + 1));
        out.push_str(&format!("\"{key}\": "));
        put(out, value, depth + 1);
        out.push_str(if k + 1 < object.len() { ",\n" } else { "\n" });
    }
    out.push_str(&"  ".repeat(depth));
    out.push('}');
}

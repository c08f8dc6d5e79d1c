//! The file `geometry.json`. It may come from anywhere, so all its values are checked.

use super::Geometry;
use nacre_base::text::{from_json, read_text};
use nacre_base::write_whole;
use nacre_base::{Error, Result};
use std::path::Path;

/// Largest file in bytes; a geometry needs about 2 KiB.
const MAX_BYTES: u64 = 1 << 20;

const REMEDY: &str =
    "give a geometry.json as `nacre calibrate geometry` writes it; `nacre schema geometry` prints what is allowed";

/// Name of the geometry file in a folder of photographs.
const NAME: &str = "geometry.json";

/// Loads the geometry in a folder of photographs; `None` without a file.
///
/// # Errors
/// As [`load`].
pub fn beside(folder: &Path) -> Result<Option<Geometry>> {
    let path = folder.join(NAME);
    if path.is_file() { load(&path).map(Some) } else { Ok(None) }
}

/// Reads and checks a geometry file.
///
/// # Errors
/// `Input`, naming the file and the key. Unknown keys are errors too.
pub fn load(path: &Path) -> Result<Geometry> {
    let text = read_text(path, MAX_BYTES, REMEDY)?;
    parse(&text).map_err(|problem| Error::file(path, problem, REMEDY))
}

/// Parses and checks the text of a geometry file.
///
/// # Errors
/// A description of the problem, naming the key.
pub fn parse(text: &str) -> std::result::Result<Geometry, String> {
    let geometry: Geometry = from_json(text)?;
    match geometry.check() {
        Err(Error::Input { subject, problem, remedy }) => Err(format!("{subject} {problem} ({remedy})")),
        Err(other) => Err(other.to_string()),
        Ok(()) => Ok(geometry),
    }
}

/// Writes a geometry file atomically, replacing an existing one.
///
/// # Errors
/// `Input` if [`load`] would refuse the file, `Output` if the system refuses to write it.
pub fn save(geometry: &Geometry, path: &Path) -> Result<()> {
    geometry.check()?;
    write_whole(path, text(geometry).as_bytes())
}

/// JSON text of a geometry, one key per line.
pub fn text(geometry: &Geometry) -> String {
    // Serialising plain data with string keys cannot fail.
    let value = serde_json::to_value(geometry).unwrap_or_default();
    let mut out = String::new();
    put(&mut out, &value, 0);
    out + "\n"
}

/// Writes objects with one key per line, and lists on one line.
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

//! The second table of `docs/validation/faults.md`: faults of devices whose other side others wrote.

use serde_json::Value;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

const TITLE: &str = "## Devices with simulators of others\n";

/// Text above the table.
const HEADER: &str = "
Written by the tests of these drivers (`NACRE_UPDATE_DOCS=1`). The fault occurred in a session after each of these
numbers of frames. Every session stopped with an error that names the device. After the fault was removed, it was
resumed and completed, unless the table says otherwise.

| device | fault | after frames | message |
|---|---|---|---|
";

/// The document.
pub fn document() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/validation/faults.md")
}

/// The title of this table and all that follows in the document.
pub fn section(document: &str) -> &str {
    document.find(TITLE).map_or("", |at| &document[at..])
}

/// Number of frames of a session, as the service describes it.
pub fn committed(session: &Value) -> usize {
    session["frames_committed"].as_u64().map_or(0, |count| count as usize)
}

/// Enters a fault into the document, if `NACRE_UPDATE_DOCS` asks for it.
///
/// # Panics
/// If the document cannot be written.
#[allow(clippy::unwrap_used)]
pub fn record(device: &str, fault: &str, after: &[usize], message: &str) {
    if std::env::var_os("NACRE_UPDATE_DOCS").is_none() {
        return;
    }
    let path = document();
    let lock = File::open(&path).unwrap();
    lock.lock().unwrap();
    let text = fs::read_to_string(&path).unwrap();
    let rows = section(&text).lines().filter(|line| line.starts_with("| ")).skip(1);
    let mut rows: BTreeMap<[String; 2], String> = rows.map(|row| (key(row), row.to_owned())).collect();
    let mut after = after.to_vec();
    after.sort_unstable();
    let after: Vec<String> = after.iter().map(ToString::to_string).collect();
    let row = format!("| {device} | {fault} | {} | {} |", after.join(", "), message.replace('|', "\\|"));
    rows.insert(key(&row), row);
    let rows: Vec<String> = rows.into_values().collect();
    let before = text.strip_suffix(section(&text)).unwrap_or(&text).trim_end();
    // In place, so that the lock stays that of the document.
    fs::write(&path, format!("{before}\n\n{TITLE}{HEADER}{}\n", rows.join("\n"))).unwrap();
}

/// Device and fault of a row.
fn key(row: &str) -> [String; 2] {
    let mut cells = row.split('|').skip(1).map(|cell| cell.trim().to_owned());
    std::array::from_fn(|_| cells.next().unwrap_or_default())
}

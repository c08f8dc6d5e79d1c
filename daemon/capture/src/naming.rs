//! Names of sessions and uploads. A name that a person gives is kept in `about.json` of the folder, which no checksum
//! covers. Without one, the name is derived from the contents.

use crate::plan::{Plan, word};
use nacre_base::{Error, input, write_whole};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the file in the folder.
pub const ABOUT_FILE: &str = "about.json";

/// Longest name, in characters.
const LONGEST: usize = 200;

/// Largest file that is read, in bytes.
const MAX_BYTES: u64 = 64 << 10;

#[derive(Serialize, Deserialize)]
struct About {
    name: String,
}

/// The name that a person gave a folder, if any.
pub fn given(folder: &Path) -> Option<String> {
    let bytes = input::read(&folder.join(ABOUT_FILE), MAX_BYTES).ok()?;
    let About { name } = serde_json::from_slice(&bytes).ok()?;
    checked(&name).ok().filter(|name| !name.is_empty())
}

/// Gives a folder a name; an empty one gives it the derived name back.
///
/// # Errors
/// `Output` if the system refuses.
pub fn give(folder: &Path, name: &str) -> Result<(), Error> {
    let file = folder.join(ABOUT_FILE);
    if !name.is_empty() {
        return write_whole(&file, format!("{}\n", serde_json::json!(About { name: name.into() })).as_bytes());
    }
    match std::fs::remove_file(&file) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::output(&file, e)),
        _ => Ok(()),
    }
}

/// A name without blanks around it.
///
/// # Errors
/// A sentence about its length, or about characters that are not shown or change how others are.
pub fn checked(name: &str) -> Result<String, String> {
    let name = name.trim();
    match name.chars().count() {
        length if length > LONGEST => Err(format!("name has {length} characters; shorten it to at most {LONGEST}")),
        _ if name.contains(is_hidden) => Err("name has control characters; leave them out".into()),
        _ => Ok(name.into()),
    }
}

/// A derived name as [`checked`] allows it.
pub fn shortened(name: &str) -> String {
    let shown: String = name.chars().map(|c| if is_hidden(c) { ' ' } else { c }).collect();
    let shown = shown.trim();
    match shown.char_indices().nth(LONGEST) {
        Some(_) => shown.chars().take(LONGEST - 1).chain(['…']).collect(),
        None => shown.into(),
    }
}

/// Control characters, and those that reverse the direction of the text after them.
fn is_hidden(c: char) -> bool {
    c.is_control() || matches!(c, '\u{2028}' | '\u{2029}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

/// The name of a session: as given, else that in its plan, else the sample, else the kind of plan.
pub fn of_session(folder: &Path, plan: &Plan) -> String {
    given(folder).unwrap_or_else(|| of_plan(plan))
}

/// The name of a session that has no folder yet.
pub fn of_plan(plan: &Plan) -> String {
    let named = [&plan.name, &plan.sample].map(|text| shortened(text)).into_iter().find(|text| !text.is_empty());
    named.unwrap_or_else(|| of_kind(plan))
}

/// The name of a session whose plan has neither name nor sample: its kind.
pub fn of_kind(plan: &Plan) -> String {
    capitalised(&word(plan.kind))
}

/// A word with a capital first letter.
pub fn capitalised(word: &str) -> String {
    let mut rest = word.chars();
    rest.next().into_iter().flat_map(char::to_uppercase).chain(rest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_given_taken_back_and_checked() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path();
        assert_eq!(given(folder), None);
        give(folder, "Ausweis „7“ / front").unwrap();
        assert_eq!(given(folder).unwrap(), "Ausweis „7“ / front");
        give(folder, "").unwrap();
        give(folder, "").unwrap();
        assert_eq!(std::fs::read_dir(folder).unwrap().count(), 0);
        std::fs::write(folder.join(ABOUT_FILE), "{\"name\":\"a\\u0007\"}").unwrap();
        assert_eq!(given(folder), None);
        assert_eq!(checked("  disc 7 ").unwrap(), "disc 7");
        for bad in ["a\nb", "a\u{202e}b", &"x".repeat(201)] {
            assert!(checked(bad).is_err(), "{bad:?}");
            assert!(checked(&shortened(bad)).is_ok());
        }
    }
}

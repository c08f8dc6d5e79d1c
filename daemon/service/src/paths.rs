//! Removes the folders of this machine from texts for clients.

use std::path::Path;
use std::sync::OnceLock;

/// Data folder as it appears in texts. Its name may contain blanks, so a search needs the exact name.
static DATA: OnceLock<String> = OnceLock::new();

/// Sets the data folder; later calls have no effect.
pub fn set_data_folder(folder: &Path) {
    let whole = std::path::absolute(folder).unwrap_or_else(|_| folder.into());
    let _ = DATA.set(format!("{}/", whole.display()));
}

/// Removes the folders of absolute paths: `/home/anna/data/a.png` becomes `a.png`, and files in the data folder keep
/// their path in it. Paths of the service (`/api/…`) and devices (`/dev/…`) are kept.
pub fn without_folders(text: &str) -> String {
    let text = match DATA.get() {
        Some(data) => text.replace(data.as_str(), ""),
        None => text.to_owned(),
    };
    let mut shown = String::with_capacity(text.len());
    let mut rest = text.as_str();
    let mut before = ' ';
    while let Some(next) = rest.chars().next() {
        let begins = next == '/' && (before.is_whitespace() || "\"'`([{<:=,;".contains(before));
        let length = if begins { path_length(rest) } else { 0 };
        let (path, after) = rest.split_at(length.max(next.len_utf8()));
        shown += if length > 0 { file_name(path) } else { path };
        before = path.chars().next_back().unwrap_or(' ');
        rest = after;
    }
    shown
}

/// Length in bytes of the absolute file path at the start of a text; 0 if there is none.
fn path_length(text: &str) -> usize {
    let end = text.find(|c: char| c.is_whitespace() || "\"'`)]}>,;".contains(c)).unwrap_or(text.len());
    // `https://…` is not a path, and `/display` names a page.
    let path = text[..end].trim_end_matches([':', '.', '/']);
    let ours = ["//", "/api/", "/dev/"].iter().any(|start| path.starts_with(start));
    if ours || path.matches('/').count() < 2 { 0 } else { path.len() }
}

fn file_name(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_left_out_and_all_else_stays() {
        for (text, shown) in [
            ("/home/anna/data/a.png: cannot be read", "a.png: cannot be read"),
            ("give \"/srv/x/y.toml\", or (/srv/z/)", "give \"y.toml\", or (z/)"),
            ("error:/a/b/ü.png;/c/d.", "error:ü.png;d."),
            ("see /api/v1/plans/schema or /display", "see /api/v1/plans/schema or /display"),
            ("/dev/ttyUSB0 is gone; 3 cycles/mm and a/b/c", "/dev/ttyUSB0 is gone; 3 cycles/mm and a/b/c"),
            ("https://nacre.invalid/problems/x and / and //", "https://nacre.invalid/problems/x and / and //"),
            ("", ""),
        ] {
            assert_eq!(without_folders(text), shown, "{text}");
        }
    }
}

//! Texts without the folders of this machine, which are nobody's business.

use std::path::Path;
use std::sync::OnceLock;

/// The data folder as it stands in texts. Its name may hold blanks, so that it has to be known to be found.
static DATA: OnceLock<String> = OnceLock::new();

/// Says where the data folder is; the first call counts.
pub fn set_data_folder(folder: &Path) {
    let whole = std::path::absolute(folder).unwrap_or_else(|_| folder.into());
    let _ = DATA.set(format!("{}/", whole.display()));
}

/// Leaves out the folders of absolute paths: of `/home/anna/data/a.png` stays `a.png`, of files in the data folder their path in
/// it. Paths of the service (`/api/…`) and devices (`/dev/…`) stay.
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

/// Bytes of the absolute path that a text begins with; 0 for what is no path of a file.
fn path_length(text: &str) -> usize {
    let end = text.find(|c: char| c.is_whitespace() || "\"'`)]}>,;".contains(c)).unwrap_or(text.len());
    // `https://…` is no path, and `/display` names a page.
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

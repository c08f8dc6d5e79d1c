//! Files of sessions and results: listed and streamed, only from inside their folder.

use super::blocking;
use super::paths::without_folders;
use super::problem::{Answer, Problem};
use axum::body::Body;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use nacre_base::input::{self, Unreadable};
use std::fs::Metadata;
use std::io::{ErrorKind, SeekFrom};
use std::ops::Range;
use std::path::{Component, Path, PathBuf};
use std::time::SystemTime;
use tokio::io::{AsyncReadExt, AsyncSeekExt};
use tokio_util::io::ReaderStream;

/// Levels of folders that are listed.
const MAX_DEPTH: usize = 8;

/// Path of a file inside a folder: no `..`, no absolute path, no link that leads out.
///
/// # Errors
/// `not-found` for any other name.
pub fn inside(folder: &Path, name: &str) -> Answer<PathBuf> {
    let missing = || Problem::not_found("such file");
    let path = Path::new(name);
    let plain =
        !name.is_empty() && !name.contains('\0') && path.components().all(|c| matches!(c, Component::Normal(_)));
    if !plain {
        return Err(missing());
    }
    let (real, base) = (folder.join(path).canonicalize(), folder.canonicalize());
    match (real, base) {
        (Ok(real), Ok(base)) if real.starts_with(&base) && real.is_file() => Ok(real),
        _ => Err(missing()),
    }
}

/// All files below a folder, by relative path, with their sizes in bytes; links are not followed.
pub fn list(folder: &Path) -> Vec<(String, u64)> {
    let mut files = vec![];
    walk(folder, folder, 0, &mut files);
    files.sort();
    files
}

fn walk(root: &Path, folder: &Path, depth: usize, files: &mut Vec<(String, u64)>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let Ok(metadata) = entry.metadata() else { continue };
        if metadata.is_dir() && depth < MAX_DEPTH {
            walk(root, &entry.path(), depth + 1, files);
        } else if metadata.is_file()
            && let Ok(path) = entry.path().strip_prefix(root)
        {
            files.push((path.to_string_lossy().into_owned(), metadata.len()));
        }
    }
}

/// Reads the `report.json` of a folder of results.
///
/// # Errors
/// [`Unreadable`] if it is missing, not a regular file, or larger than 64 MiB.
pub fn report(folder: &Path) -> Result<Vec<u8>, Unreadable> {
    input::read(&folder.join(REPORT), LARGEST_REPORT)
}

/// Media type of downloads that browsers must not interpret.
pub const BYTES: &str = "application/octet-stream";

/// Report in a folder of results.
const REPORT: &str = "report.json";

/// Largest report in bytes.
const LARGEST_REPORT: u64 = 64 << 20;

/// Streams a file as a download: the requested part (`Range`, one range), or no content if the client has this version
/// (`If-None-Match`).
///
/// # Errors
/// `not-found` if the file no longer exists; the system's error if it cannot be opened.
pub async fn send(path: &Path, kind: &'static str, wishes: &HeaderMap) -> Answer<Response> {
    let refused = |error: Unreadable| match error {
        Unreadable::System(error) if error.kind() != ErrorKind::NotFound => {
            Problem::refused("the file cannot be read", &error)
        }
        _ => Problem::not_found("such file"),
    };
    let (owned, is_report) = (path.to_owned(), path.ends_with(REPORT));
    let most = if is_report { LARGEST_REPORT } else { u64::MAX };
    let opened = blocking(move || Ok(input::open(&owned, most))).await?;
    let mut file = tokio::fs::File::from_std(opened.map_err(refused)?);
    if is_report {
        // Reports name their input files with their folders.
        let mut text = String::new();
        let read = file.read_to_string(&mut text).await;
        read.map_err(|error| refused(Unreadable::System(error)))?;
        let headers =
            [(header::CONTENT_TYPE, kind), (header::CONTENT_DISPOSITION, "attachment; filename=\"report.json\"")];
        return Ok((headers, without_folders(&text)).into_response());
    }
    let metadata = file.metadata().await.map_err(|error| refused(Unreadable::System(error)))?;
    let (length, tag) = (metadata.len(), tag(&metadata));
    let wish = |name| wishes.get(name).and_then(|value| value.to_str().ok());
    let same = |tags: &str| tags.split(',').any(|one| one.trim().trim_start_matches("W/") == tag || one.trim() == "*");
    if wish(header::IF_NONE_MATCH).is_some_and(same) {
        return Ok((StatusCode::NOT_MODIFIED, [(header::ETAG, tag)]).into_response());
    }
    let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    let plain: String = name.chars().filter(|c| c.is_ascii_alphanumeric() || "._-".contains(*c)).collect();
    // A part of another version would not fit the client's part.
    let current = wish(header::IF_RANGE).is_none_or(|wanted| wanted == tag);
    let part = wish(header::RANGE).filter(|_| current).and_then(|range| part(range, length));
    let headers = [
        (header::CONTENT_TYPE, kind.to_owned()),
        (header::CONTENT_DISPOSITION, format!("attachment; filename=\"{plain}\"")),
        (header::ETAG, tag),
        (header::ACCEPT_RANGES, "bytes".to_owned()),
    ];
    match part {
        None => {
            let body = Body::from_stream(ReaderStream::new(file));
            Ok(([(header::CONTENT_LENGTH, length.to_string())], headers, body).into_response())
        }
        Some(part) if part.is_empty() => {
            let all = [(header::CONTENT_RANGE, format!("bytes */{length}"))];
            Ok((StatusCode::RANGE_NOT_SATISFIABLE, all).into_response())
        }
        Some(part) => {
            let sought = file.seek(SeekFrom::Start(part.start)).await;
            sought.map_err(|error| refused(Unreadable::System(error)))?;
            let count = part.end - part.start;
            let of_all = [
                (header::CONTENT_LENGTH, count.to_string()),
                (header::CONTENT_RANGE, format!("bytes {}-{}/{length}", part.start, part.end - 1)),
            ];
            let body = Body::from_stream(ReaderStream::new(file.take(count)));
            Ok((StatusCode::PARTIAL_CONTENT, of_all, headers, body).into_response())
        }
    }
}

/// `ETag` of a file's version: its length and modification time.
fn tag(metadata: &Metadata) -> String {
    let changed = metadata.modified().ok().and_then(|time| time.duration_since(SystemTime::UNIX_EPOCH).ok());
    format!("\"{:x}-{:x}\"", metadata.len(), changed.map_or(0, |time| time.as_nanos()))
}

/// Byte range of a `Range` with one part; empty if the file has none of these bytes. `None` for any other header,
/// which the whole file answers (RFC 9110, section 14.2).
fn part(range: &str, length: u64) -> Option<Range<u64>> {
    let (first, last) = range.trim().strip_prefix("bytes=")?.split_once('-')?;
    let (first, last) = (first.trim(), last.trim());
    let number = |text: &str| text.chars().all(|c| c.is_ascii_digit()).then(|| text.parse::<u64>().ok()).flatten();
    if first.is_empty() {
        return Some(length.saturating_sub(number(last)?)..length);
    }
    let (first, end) = (number(first)?, if last.is_empty() { length } else { number(last)?.checked_add(1)? });
    if end <= first {
        return if last.is_empty() { Some(length..length) } else { None };
    }
    Some(first.min(length)..end.min(length))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_read_as_rfc_9110_has_them() {
        for (range, wanted) in [
            ("bytes=0-499", Some(0..500)),
            ("bytes=500-", Some(500..1000)),
            ("bytes=-1", Some(999..1000)),
            ("bytes=-2000", Some(0..1000)),
            ("bytes=990-2000", Some(990..1000)),
            ("bytes=1000-", Some(1000..1000)),
            ("bytes=1000-1001", Some(1000..1000)),
            ("bytes=5-4", None),
            ("bytes=0-1,3-4", None),
            ("bytes=a-b", None),
            ("bytes=--1", None),
            ("lines=0-1", None),
            ("bytes=0-18446744073709551615", None),
        ] {
            assert_eq!(part(range, 1000), wanted, "{range}");
        }
    }

    #[test]
    fn only_files_inside_are_found() {
        let place = tempfile::tempdir().unwrap();
        let folder = place.path().join("session");
        std::fs::create_dir_all(folder.join("frames")).unwrap();
        std::fs::write(folder.join("frames/0.png"), "x").unwrap();
        std::fs::write(place.path().join("secret"), "x").unwrap();
        std::os::unix::fs::symlink(place.path().join("secret"), folder.join("link")).unwrap();
        assert!(inside(&folder, "frames/0.png").is_ok());
        for name in
            ["../secret", "link", "frames", "", "/etc/passwd", "frames/../../secret", "a\0b", "./frames/0.png/.."]
        {
            assert!(inside(&folder, name).is_err(), "{name:?}");
        }
        assert_eq!(list(&folder), [("frames/0.png".to_owned(), 1)]);
    }
}

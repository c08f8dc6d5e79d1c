//! Files of sessions and results: only what lies inside, streamed.

use super::blocking;
use super::paths::without_folders;
use super::problem::{Answer, Problem};
use axum::body::Body;
use axum::http::header;
use axum::response::{IntoResponse, Response};
use nacre_base::input::{self, Unreadable};
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};
use tokio::io::AsyncReadExt;
use tokio_util::io::ReaderStream;

/// Deepest folder that is listed.
const MAX_DEPTH: usize = 8;

/// Path of a file that is really inside a folder: no `..`, no absolute path, no link that leads out.
///
/// # Errors
/// `not-found` for anything else.
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

/// All files below a folder, by relative path, with their sizes; links are not followed.
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
/// [`Unreadable`] if it is missing, no regular file, or larger than 64 MiB.
pub fn report(folder: &Path) -> Result<Vec<u8>, Unreadable> {
    input::read(&folder.join(REPORT), LARGEST_REPORT)
}

/// Media type of a download that no browser is to look into.
pub const BYTES: &str = "application/octet-stream";

/// Report in a folder of results.
const REPORT: &str = "report.json";

/// Most bytes of a report.
const LARGEST_REPORT: u64 = 64 << 20;

/// Streams a file as a download.
///
/// # Errors
/// `not-found` when it is not there any more; as the system answers when it cannot be opened.
pub async fn send(path: &Path, kind: &'static str) -> Answer<Response> {
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
        // Reports name the files that they were made of, with their folders.
        let mut text = String::new();
        let read = file.read_to_string(&mut text).await;
        read.map_err(|error| refused(Unreadable::System(error)))?;
        let headers =
            [(header::CONTENT_TYPE, kind), (header::CONTENT_DISPOSITION, "attachment; filename=\"report.json\"")];
        return Ok((headers, without_folders(&text)).into_response());
    }
    let length = file.metadata().await.map(|m| m.len()).unwrap_or_default();
    let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    let plain: String = name.chars().filter(|c| c.is_ascii_alphanumeric() || "._-".contains(*c)).collect();
    let headers = [
        (header::CONTENT_TYPE, kind.to_owned()),
        (header::CONTENT_LENGTH, length.to_string()),
        (header::CONTENT_DISPOSITION, format!("attachment; filename=\"{plain}\"")),
    ];
    Ok((headers, Body::from_stream(ReaderStream::new(file))).into_response())
}

#[cfg(test)]
mod tests {
    use super::*;

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

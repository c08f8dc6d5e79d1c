//! Search for session folders on the disk. All file access runs on blocking threads, so that a server stays
//! responsive.

use super::SessionRow;
use nacre_base::Error;
use nacre_base::progress::Progress;
use nacre_capture::session::SESSION_FILE;
use std::collections::BTreeSet;
use std::io;
use std::path::{Path, PathBuf};

/// Levels of folders below a root that are searched.
const MAX_DEPTH: usize = 8;

/// Name of the file that marks a deleted folder; nothing below it is searched.
pub const DELETED_FILE: &str = "deleted.json";

/// Reads all sessions under the roots. Also returns warnings about unreadable folders.
pub(super) async fn survey(
    roots: &[PathBuf],
    progress: &dyn Progress,
) -> Result<(Vec<SessionRow>, Vec<String>), Error> {
    let mut warnings = vec![];
    let mut folders = BTreeSet::new();
    for root in roots {
        let root = root
            .canonicalize()
            .and_then(|path| if path.is_dir() { Ok(path) } else { Err(io::ErrorKind::NotADirectory.into()) })
            .map_err(|e| Error::file(root, format!("cannot be searched: {e}"), "give a folder that holds sessions"))?;
        find(root, progress, &mut folders, &mut warnings).await?;
    }
    progress.stage("reading sessions", folders.len() as u64);
    let mut sessions = vec![];
    for folder in folders {
        progress.check()?;
        let name = folder.clone();
        match on_a_thread(move || Ok(SessionRow::read(&folder))).await {
            Ok(Ok(row)) => sessions.push(row),
            Ok(Err(e)) => warnings.push(e.to_string()),
            Err(e) => warnings.push(cannot_be_read(&name, &e)),
        }
        progress.step();
    }
    Ok((sessions, warnings))
}

/// Collects the session folders under a root. Folders inside a session belong to it and are not searched.
async fn find(
    root: PathBuf,
    progress: &dyn Progress,
    found: &mut BTreeSet<PathBuf>,
    warnings: &mut Vec<String>,
) -> Result<(), Error> {
    let mut waiting = vec![(root, 0)];
    while let Some((folder, depth)) = waiting.pop() {
        progress.check()?;
        let listed = folder.clone();
        match on_a_thread(move || list(&listed)).await {
            Ok(Listing::Session) => _ = found.insert(folder),
            Ok(Listing::Folders(inside)) if depth < MAX_DEPTH => {
                waiting.extend(inside.into_iter().map(|folder| (folder, depth + 1)));
            }
            Ok(Listing::Folders(_)) => {}
            Err(e) => warnings.push(cannot_be_read(&folder, &e)),
        }
    }
    Ok(())
}

enum Listing {
    Session,
    Folders(Vec<PathBuf>),
}

/// Entries of a folder; symbolic links are skipped.
fn list(folder: &Path) -> io::Result<Listing> {
    let mut folders = vec![];
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        let kind = entry.file_type()?;
        if kind.is_file() && entry.file_name() == SESSION_FILE {
            return Ok(Listing::Session);
        }
        if entry.file_name() == DELETED_FILE {
            return Ok(Listing::Folders(vec![]));
        }
        if kind.is_dir() {
            folders.push(entry.path());
        }
    }
    Ok(Listing::Folders(folders))
}

async fn on_a_thread<T: Send + 'static>(work: impl FnOnce() -> io::Result<T> + Send + 'static) -> io::Result<T> {
    tokio::task::spawn_blocking(work).await?
}

fn cannot_be_read(folder: &Path, error: &io::Error) -> String {
    format!("{}: cannot be read: {error}; give yourself access to it, or search elsewhere", folder.display())
}

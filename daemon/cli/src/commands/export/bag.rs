//! Folders as bags: payload in `data/`, checksums and description beside it (BagIt 1.0, RFC 8493).

use super::{Exported, written};
use nacre_base::calendar::date_time;
use nacre_base::progress::Progress;
use nacre_base::{Error, Result};
use nacre_capture::session::{check, sha256};
use nacre_image::OutputFolder;
use sha2::{Digest, Sha256};
use std::fmt::Write;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Bytes copied at once.
const PIECE: usize = 1 << 20;

/// Copies a folder into a bag. Damage of a session is a warning: a bag of a damaged session is better than none.
pub fn write(input: &Path, is_session: bool, folder: &OutputFolder, progress: &dyn Progress) -> Result<Exported> {
    let files = files(input)?;
    let mut exported = Exported::default();
    if is_session {
        exported.warnings = warnings(input);
    }
    progress.stage("copying with checksums", files.len() as u64);
    let (mut manifest, mut bytes) = (String::new(), 0);
    for file in &files {
        progress.check()?;
        let name = format!("data/{}", file.display());
        if let Some(parent) = Path::new(&name).parent() {
            folder.create_dir(&parent.to_string_lossy())?;
        }
        let (sum, length) = copy(&input.join(file), folder, &name)?;
        bytes += length;
        let _ = writeln!(manifest, "{sum}  {}", encoded(&name));
        written(&mut exported, folder, name)?;
        progress.step();
    }
    let seconds = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_secs() as i64);
    let [year, month, day, ..] = date_time(seconds);
    let title = std::path::absolute(input).ok().and_then(|p| Some(p.file_name()?.to_string_lossy().into_owned()));
    let info = format!(
        "Bag-Software-Agent: Nacre {}\nBagging-Date: {year}-{month:02}-{day:02}\nExternal-Identifier: {}\nPayload-Oxum: {bytes}.{}\n",
        env!("CARGO_PKG_VERSION"),
        title.unwrap_or_default().replace(['\n', '\r'], " "),
        files.len()
    );
    let tags = [
        ("bagit.txt", "BagIt-Version: 1.0\nTag-File-Character-Encoding: UTF-8\n".to_owned()),
        ("bag-info.txt", info),
        ("manifest-sha256.txt", manifest),
    ];
    let mut of_tags = String::new();
    for (name, text) in tags {
        folder.write(name, text.as_bytes())?;
        let _ = writeln!(of_tags, "{}  {name}", sha256(text.as_bytes()));
        written(&mut exported, folder, name.into())?;
    }
    folder.write("tagmanifest-sha256.txt", of_tags.as_bytes())?;
    written(&mut exported, folder, "tagmanifest-sha256.txt".into())?;
    Ok(exported)
}

/// Problems of a session's files.
pub(super) fn warnings(session: &Path) -> Vec<String> {
    match check(session) {
        Ok(condition) if condition.finished => {
            condition.trouble.iter().map(|t| format!("{}: {}", t.file, t.problem)).collect()
        }
        Ok(condition) => vec![format!("the session has {} of {} frames", condition.intact, condition.planned)],
        Err(error) => vec![error.to_string()],
    }
}

/// Regular files below a folder, as relative paths in order of their names. Links are left out: their targets may be
/// elsewhere.
fn files(input: &Path) -> Result<Vec<PathBuf>> {
    if !input.is_dir() {
        return Err(Error::file(input, "is not a folder", "give a session or another folder"));
    }
    let mut found = vec![];
    let mut left = vec![PathBuf::new()];
    while let Some(folder) = left.pop() {
        let unreadable = |e| Error::file(&input.join(&folder), format!("cannot be read: {e}"), "check its permissions");
        for entry in std::fs::read_dir(input.join(&folder)).map_err(unreadable)? {
            let entry = entry.map_err(unreadable)?;
            let path = folder.join(entry.file_name());
            match entry.file_type().map_err(unreadable)? {
                kind if kind.is_dir() => left.push(path),
                kind if kind.is_file() => found.push(path),
                _ => {}
            }
        }
    }
    found.sort();
    Ok(found)
}

/// Copies a file; returns its SHA-256 and its length.
fn copy(from: &Path, folder: &OutputFolder, name: &str) -> Result<(String, u64)> {
    let unreadable = |e| Error::file(from, format!("cannot be read: {e}"), "check its permissions");
    let mut source = BufReader::new(File::open(from).map_err(unreadable)?);
    let to = folder.path(name);
    let failed = |e| Error::output(Path::new(name), e);
    let mut target = File::create(&to).map_err(failed)?;
    let (mut sum, mut length, mut piece) = (Sha256::new(), 0, vec![0; PIECE]);
    loop {
        let count = source.read(&mut piece).map_err(unreadable)?;
        if count == 0 {
            let sum = sum.finalize().iter().map(|b| format!("{b:02x}")).collect();
            return Ok((sum, length));
        }
        sum.update(&piece[..count]);
        std::io::Write::write_all(&mut target, &piece[..count]).map_err(failed)?;
        length += count as u64;
    }
}

/// Path in a manifest: line ends and the escape itself are percent-encoded (RFC 8493, 2.1.3).
fn encoded(name: &str) -> String {
    name.replace('%', "%25").replace('\n', "%0A").replace('\r', "%0D")
}

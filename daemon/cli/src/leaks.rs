//! A check that a command leaves no thread and no open file in its own process. Tests enable it with `NACRE_LEAKS`;
//! release builds omit it.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

/// Time allowed for threads and files to close by themselves.
const PATIENCE: Duration = Duration::from_secs(2);

/// Threads and files that were open before the command.
pub struct Leaks(Option<Open>);

/// Number of threads, and open files by descriptor.
struct Open {
    threads: usize,
    files: BTreeMap<String, String>,
}

impl Leaks {
    /// Records the open threads and files, after libraries with permanent threads and files have started theirs.
    pub fn watch() -> Self {
        if !cfg!(debug_assertions) || std::env::var_os("NACRE_LEAKS").is_none() {
            return Self(None);
        }
        rayon::broadcast(|_| ());
        if let Ok(runtime) = tokio::runtime::Builder::new_current_thread().enable_all().build() {
            let _inside = runtime.enter();
            let _ = tokio::signal::unix::signal(tokio::signal::unix::SignalKind::user_defined1());
        }
        Self(Some(now()))
    }

    /// Threads and files opened since then and still open after `PATIENCE`.
    pub fn found(&self) -> Option<String> {
        let before = self.0.as_ref()?;
        let begun = Instant::now();
        loop {
            let after = now();
            let new: Vec<&String> =
                after.files.iter().filter(|(k, v)| before.files.get(*k) != Some(v)).map(|f| f.1).collect();
            if after.threads <= before.threads && new.is_empty() {
                return None;
            }
            if begun.elapsed() > PATIENCE {
                return Some(format!("threads {:?}, before {}; new files {new:?}", threads(), before.threads));
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

/// Names of the threads, without the permanent one of a library.
fn threads() -> Vec<String> {
    let name = |t: std::fs::DirEntry| std::fs::read_to_string(t.path().join("comm")).ok();
    let names = list("/proc/self/task").filter_map(name).map(|name| name.trim().to_owned());
    names.filter(|name| name != "futures-timer").collect()
}

fn list(folder: &str) -> impl Iterator<Item = std::fs::DirEntry> {
    std::fs::read_dir(folder).into_iter().flatten().flatten()
}

fn now() -> Open {
    let file = |entry: std::fs::DirEntry| {
        let target = std::fs::read_link(entry.path()).ok()?;
        // The directory listing itself is open while it is read.
        let own = target.starts_with(Path::new("/proc"));
        (!own).then(|| (entry.file_name().to_string_lossy().into_owned(), target.to_string_lossy().into_owned()))
    };
    Open { threads: threads().len(), files: list("/proc/self/fd").filter_map(file).collect() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_open_file_is_found() {
        let leaks = Leaks(Some(now()));
        let file = tempfile::NamedTempFile::new().unwrap();
        let name = file.path().file_name().unwrap().to_string_lossy().into_owned();
        let found = leaks.found().unwrap();
        assert!(found.contains(&name), "{found}");
    }
}

//! A check that a command leaves nothing behind in its own process: no thread, no open file. Tests ask for it with
//! `NACRE_LEAKS`; release builds do not have it.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

/// What goes by itself is gone after this.
const PATIENCE: Duration = Duration::from_secs(2);

/// What was open before.
pub struct Leaks(Option<Open>);

/// How many threads, and which files by descriptor.
struct Open {
    threads: usize,
    files: BTreeMap<String, String>,
}

impl Leaks {
    /// Notes what is open, after the libraries that keep threads and files for good have opened theirs.
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

    /// What is open that was not before, once what ends by itself has ended.
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

/// Names of the threads, without the one that a library keeps for good once it was used.
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
        // The listing itself is open too while it is made.
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

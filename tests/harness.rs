//! Harness of the end-to-end tests: they run the program as a user does.

#![allow(clippy::expect_used, clippy::panic, clippy::print_stdout)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The binary under test: `NACRE_BIN` (as `tests/run` sets it), or the one beside this test's build.
///
/// # Panics
/// When there is none.
pub fn binary() -> PathBuf {
    if let Some(path) = std::env::var_os("NACRE_BIN") {
        return path.into();
    }
    let beside = std::env::current_exe().ok().and_then(|exe| Some(exe.parent()?.parent()?.join("nacre")));
    match beside {
        Some(path) if path.exists() => path,
        _ => panic!("set NACRE_BIN to the built program, or run tests/run"),
    }
}

/// Runs `nacre` with these arguments.
///
/// # Panics
/// When it cannot be started.
pub fn nacre<S: AsRef<std::ffi::OsStr>>(args: impl IntoIterator<Item = S>) -> Run {
    Run(Command::new(binary()).args(args).output().expect("nacre starts"))
}

/// A finished run.
pub struct Run(pub Output);

impl Run {
    /// Exit code, -1 for a signal.
    pub fn code(&self) -> i32 {
        self.0.status.code().unwrap_or(-1)
    }

    /// Standard error.
    pub fn stderr(&self) -> String {
        String::from_utf8_lossy(&self.0.stderr).into_owned()
    }

    /// Standard output.
    pub fn stdout(&self) -> String {
        String::from_utf8_lossy(&self.0.stdout).into_owned()
    }

    /// Standard output as JSON.
    ///
    /// # Panics
    /// When it is something else.
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.stdout())
            .unwrap_or_else(|e| panic!("{e}\nstdout: {}\nstderr: {}", self.stdout(), self.stderr()))
    }

    /// Checks the exit code, showing the output when it is another.
    ///
    /// # Panics
    /// When the code is another.
    pub fn expect(self, code: i32) -> Self {
        assert_eq!(self.code(), code, "stdout: {}\nstderr: {}", self.stdout(), self.stderr());
        self
    }
}

/// Real photographs: `NACRE_TEST_DATA`, or `shared/data` beside the project. None means that the test is to say so
/// and end.
pub fn test_data() -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data");
    let path = std::env::var_os("NACRE_TEST_DATA").map_or_else(beside, PathBuf::from);
    if path.is_dir() {
        return Some(path);
    }
    println!("skipped: no real photographs at {} (set NACRE_TEST_DATA)", path.display());
    None
}

/// Names of everything in a folder, hidden files included.
///
/// # Panics
/// When it cannot be read.
pub fn listing(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("folder is there").flatten();
    let mut names: Vec<String> = entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

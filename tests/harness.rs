//! Harness of the end-to-end tests, which run the program as a user does.

#![allow(clippy::expect_used, clippy::panic, clippy::print_stdout)]

pub mod chromium;
pub mod fault_table;
pub mod http;

use nacre_sim::socket::RemoteBench;
use nacre_sim::{Port, Reply, Request};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// Time limit of any wait, on any busy machine.
pub const NEVER: Duration = Duration::from_secs(60);

/// A small bench.
pub const BENCH: &str = "camera = { width = 64, height = 48 }\n";

/// A plan that uses all devices, flash and panel alternately; its angles are whole pulses of an ELL14, ascending and
/// descending.
pub const PLAN: &str = r#"
    kind = "free"
    steps = [
        { analyser_deg = 22.5, exposure_ms = 8 },
        { analyser_deg = 67.5, exposure_ms = 8 },
        { analyser_deg = 67.5, exposure_ms = 8, flash = true },
        { analyser_deg = 45, exposure_ms = 4 },
        { exposure_ms = 4, flash = true, display = { pattern = "black" } },
    ]
"#;

/// The binary under test: `NACRE_BIN` (as set by `tests/run`), or the one beside this test's build.
///
/// # Panics
/// If there is none.
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
/// If it cannot be started.
pub fn nacre<S: AsRef<std::ffi::OsStr>>(args: impl IntoIterator<Item = S>) -> Run {
    let (mut command, mark) = command();
    let run = Run(command.args(args).output().expect("nacre starts"));
    assert_gone(&mark);
    run
}

/// The program, without arguments: with separate catalogue and cache, with its leak check enabled, and with a mark in
/// its environment. [`assert_gone`] finds it and its children by this mark.
pub fn command() -> (Command, String) {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let mark = format!("NACRE_MARK={}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
    let own = std::env::temp_dir().join(format!("nacre-tests-{}", std::process::id()));
    let mut command = Command::new(binary());
    command.env("NACRE_LEAKS", "1").env("NACRE_MARK", &mark["NACRE_MARK=".len()..]);
    command.env("NACRE_CATALOGUE", own.join("catalogue.db")).env("XDG_CACHE_HOME", own.join("cache"));
    (command, mark)
}

/// Asserts that no process with this mark remains, allowing for the time that it takes to end.
///
/// # Panics
/// If one remains.
pub fn assert_gone(mark: &str) {
    let begun = Instant::now();
    loop {
        let left = marked(mark);
        if left.is_empty() {
            return;
        }
        assert!(begun.elapsed() < NEVER, "left behind: {left:?}");
        std::thread::sleep(Duration::from_millis(5));
    }
}

/// Command lines of the processes with a mark.
fn marked(mark: &str) -> Vec<String> {
    let processes = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let with_mark = processes.filter(|p| {
        let environment = std::fs::read(p.path().join("environ")).unwrap_or_default();
        environment.split(|b| *b == 0).any(|line| line == mark.as_bytes())
    });
    with_mark
        .map(|p| {
            String::from_utf8_lossy(&std::fs::read(p.path().join("cmdline")).unwrap_or_default()).replace('\0', " ")
        })
        .collect()
}

/// A simulated bench in a separate process, ended when dropped.
pub struct BenchProcess {
    child: Child,
    /// Path of its socket.
    pub socket: PathBuf,
    mark: String,
}

impl BenchProcess {
    /// Starts a bench on a socket with this bench.toml, and waits until it listens.
    ///
    /// # Panics
    /// If it does not listen.
    pub fn start(socket: &Path, bench: &Path, more: &[&str]) -> Self {
        let (mut command, mark) = command();
        command.args(["sim", "bench", "--socket"]).arg(socket).arg("--bench").arg(bench).args(more);
        let child = command.spawn().expect("bench starts");
        let begun = Instant::now();
        while UnixStream::connect(socket).is_err() {
            assert!(begun.elapsed() < NEVER, "no bench at {}", socket.display());
            std::thread::sleep(Duration::from_millis(5));
        }
        Self { child, socket: socket.to_path_buf(), mark }
    }
}

impl Drop for BenchProcess {
    fn drop(&mut self) {
        let _ = Command::new("kill").arg(self.child.id().to_string()).status();
        let status = self.child.wait();
        if !std::thread::panicking() {
            assert!(status.as_ref().is_ok_and(|s| s.success()), "the bench ended badly: {status:?}");
            assert_gone(&self.mark);
        }
    }
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
    /// If it is not JSON.
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.stdout())
            .unwrap_or_else(|e| panic!("{e}\nstdout: {}\nstderr: {}", self.stdout(), self.stderr()))
    }

    /// Asserts the exit code, and shows the output if it differs.
    ///
    /// # Panics
    /// If the code differs.
    pub fn expect(self, code: i32) -> Self {
        assert_eq!(self.code(), code, "stdout: {}\nstderr: {}", self.stdout(), self.stderr());
        self
    }
}

/// Real photographs: `NACRE_TEST_DATA`, or `shared/data` beside the project. With `None`, the test should print a note
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

/// Names of all files in a folder, including hidden ones.
///
/// # Panics
/// If it cannot be read.
pub fn listing(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("folder is there").flatten();
    let mut names: Vec<String> = entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// A folder with a small bench and a plan.
pub struct Place {
    folder: tempfile::TempDir,
}

#[allow(clippy::unwrap_used, clippy::missing_panics_doc)]
impl Place {
    /// With a bench of 64 × 48 pixels.
    pub fn new(plan: &str) -> Self {
        Self::with_bench(plan, BENCH)
    }

    /// With this bench.
    pub fn with_bench(plan: &str, bench: &str) -> Self {
        let place = Self { folder: tempfile::tempdir().unwrap() };
        std::fs::write(place.path("bench.toml"), bench).unwrap();
        std::fs::write(place.path("plan.toml"), plan).unwrap();
        place
    }

    /// A path inside the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A path inside the folder, as text.
    pub fn text(&self, name: &str) -> String {
        self.path(name).to_string_lossy().into_owned()
    }

    /// Folder of the only session of a service in this folder.
    ///
    /// # Panics
    /// If there is none.
    pub fn only_session(&self) -> PathBuf {
        let mut found = vec![self.path("data")];
        while let Some(folder) = found.pop() {
            if folder.join("session.json").exists() {
                return folder;
            }
            let entries = std::fs::read_dir(folder).expect("a folder").flatten();
            found.extend(entries.map(|e| e.path()).filter(|p| p.is_dir()));
        }
        panic!("no session in {}", self.text("data"));
    }

    /// Arguments for a new capture into `session`.
    pub fn capture(&self, session: &str) -> Vec<String> {
        let fixed =
            ["--json", "capture", &self.text("plan.toml"), "--sim", "--bench", &self.text("bench.toml"), "--out"];
        fixed.iter().map(|s| (*s).to_owned()).chain([self.text(session)]).collect()
    }

    /// Arguments to resume `session`.
    pub fn resume(&self, session: &str) -> Vec<String> {
        ["capture", "--sim", "--resume"].iter().map(|s| (*s).to_owned()).chain([self.text(session)]).collect()
    }

    /// The arguments, on a bench process.
    pub fn on(args: Vec<String>, bench: &BenchProcess) -> Vec<String> {
        let socket = bench.socket.to_string_lossy().into_owned();
        let mut kept = vec![];
        let mut args = args.into_iter();
        while let Some(arg) = args.next() {
            if arg == "--bench" {
                args.next();
            } else {
                kept.push(arg);
            }
        }
        kept.extend(["--socket".into(), socket]);
        kept
    }
}

/// All files of a session except journal and description, by name.
///
/// # Panics
/// If one is missing.
pub fn data(session: &Path) -> Vec<(String, Vec<u8>)> {
    let folder = std::fs::read_dir(session.join("frames")).expect("frames are there");
    let mut files: Vec<_> = folder.flatten().map(|e| e.path()).collect();
    files.push(session.join("frames.json"));
    files.sort();
    let read = |p: PathBuf| {
        let bytes = std::fs::read(&p).unwrap_or_else(|e| panic!("{}: {e}", p.display()));
        (p.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned()), bytes)
    };
    files.into_iter().map(read).collect()
}

/// True for each of panel and flash of a bench process that is lit.
///
/// # Panics
/// If it does not answer.
pub fn light(bench: &BenchProcess) -> [bool; 2] {
    match ask(bench, &Request::Light) {
        Reply::Light { panel, flash } => [panel, flash],
        other => panic!("{other:?}"),
    }
}

/// True angle of a bench process's analyser, independent of its stage's report.
///
/// # Panics
/// If it does not answer.
pub fn analyser_deg(bench: &BenchProcess) -> f64 {
    match ask(bench, &Request::Position) {
        Reply::Angle(degrees) => degrees,
        other => panic!("{other:?}"),
    }
}

/// Reply of a bench process to an observer.
fn ask(bench: &BenchProcess, request: &Request) -> Reply {
    let mut port = RemoteBench::connect(&bench.socket).expect("the bench listens");
    port.call(request).expect("the bench answers")
}

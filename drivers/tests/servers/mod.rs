//! Device servers of others, in a private network.

use serde::de::DeserializeOwned;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// Marks the process within the private network.
const INSIDE: &str = "NACRE_TEST_NETWORK";

/// Sets up a private network and runs a command in it. A server that was killed can use its port again at once.
const NETWORK: &str =
    "ip link set lo up && { echo 0 >/proc/sys/net/ipv4/tcp_max_tw_buckets; } 2>/dev/null; exec \"$0\" \"$@\"";

/// Runs a test in a private network; returns whether this process is within it.
pub fn alone(test: &str, server: impl AsRef<Path>) -> bool {
    if std::env::var_os(INSIDE).is_some() {
        return true;
    }
    let network = |run: &[&str]| {
        let mut command = Command::new("unshare");
        command.args(["--net", "--map-root-user", "sh", "-c", NETWORK]).args(run);
        command
    };
    let server = server.as_ref().to_str().unwrap();
    let there = format!("command -v '{server}'");
    let can = network(&["sh", "-c", &there]).stdout(Stdio::null()).stderr(Stdio::null()).status();
    if !can.is_ok_and(|status| status.success()) {
        println!("skipped: no {server}, or no right to make a private network");
        return false;
    }
    let this = std::env::current_exe().unwrap();
    let run = network(&[this.to_str().unwrap(), "--exact", test, "--nocapture"]).env(INSIDE, "1").status();
    assert!(run.unwrap().success(), "see above");
    false
}

/// A server, which ends with the test.
pub struct Server {
    child: Child,
    _home: tempfile::TempDir,
}

impl Server {
    /// Starts a server in a new process group, and waits until it is ready.
    pub fn start(command: &[&str], ready: impl Fn() -> bool) -> Self {
        use std::os::unix::process::CommandExt;
        let home = tempfile::tempdir().unwrap();
        let mut server = Command::new(command[0]);
        server.args(&command[1..]).env("HOME", home.path()).process_group(0);
        let child = server.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let (server, begun) = (Self { child, _home: home }, Instant::now());
        while !ready() {
            assert!(begun.elapsed() < Duration::from_secs(30), "the server does not answer");
            std::thread::sleep(Duration::from_millis(20));
        }
        server
    }
}

impl Drop for Server {
    /// Ends the server with its drivers.
    fn drop(&mut self) {
        let group = format!("-{}", self.child.id());
        let _ = Command::new("kill").args(["-KILL", "--", &group]).status();
        let _ = self.child.wait();
    }
}

/// Runs a future of a driver.
pub fn run<T>(future: impl Future<Output = T>) -> T {
    tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap().block_on(future)
}

/// Settings of a driver in TOML.
pub fn settings<T: DeserializeOwned>(text: &str) -> T {
    toml::from_str(text).unwrap()
}

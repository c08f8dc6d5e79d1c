//! A service process, and plain HTTP requests to it, composed byte by byte.

use crate::{NEVER, Place, assert_gone, command};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::time::{Duration, Instant};

/// `nacre serve` in a separate process, stopped in order when dropped.
pub struct Service {
    child: Child,
    /// Listening address.
    pub address: SocketAddr,
    mark: String,
}

/// A service whose data folder is a private disk.
pub struct SmallDisk {
    /// Service.
    pub service: Service,
    /// Data folder, as seen from this process.
    pub data: PathBuf,
}

#[allow(clippy::unwrap_used, clippy::missing_panics_doc)]
impl SmallDisk {
    /// A disk of `size`, prepared by a shell script in the data folder. `None` if no private disk can be mounted.
    pub fn new(place: &Place, size: &str, prepare: &str) -> Option<Self> {
        let flag = private_mount()?;
        std::fs::create_dir_all(place.path("data")).unwrap();
        let script =
            format!("mount -t tmpfs -o size={size} tmpfs data && (cd data && {prepare}) && exec \"$0\" \"$@\"");
        let service = Service::within(place, &["unshare", flag, "sh", "-c", &script], &[]);
        let data = PathBuf::from(format!("/proc/{}/root{}", service.pid(), place.text("data")));
        Some(Self { service, data })
    }
}

/// Flag of `unshare` that gives a process private mounts: as root, or as any user if the system permits user
/// namespaces. Otherwise `None`, with a note.
pub fn private_mount() -> Option<&'static str> {
    let works = |flag: &&str| {
        let mut tried = Command::new("unshare");
        tried.args([flag, "mount", "-t", "tmpfs", "tmpfs", "/mnt"]).stdout(Stdio::null()).stderr(Stdio::null());
        tried.status().is_ok_and(|status| status.success())
    };
    let found = ["-m", "-Urm"].into_iter().find(works);
    if found.is_none() {
        println!("skipped: no private mount here");
    }
    found
}

/// Fills the disk of a data folder.
///
/// # Panics
/// If the file cannot be created.
pub fn fill(data: &Path) {
    let mut file = std::fs::File::create(data.join("fill")).expect("a file without contents");
    while file.write_all(&[7; 4096]).is_ok() {}
}

/// Frees the space taken by [`fill`].
///
/// # Panics
/// If there is nothing to free.
pub fn free(data: &Path) {
    std::fs::remove_file(data.join("fill")).expect("the disk was filled");
}

/// Response of the service.
pub struct Answer {
    /// Status.
    pub status: u16,
    /// Header lines.
    pub head: String,
    /// Body.
    pub body: Vec<u8>,
}

#[allow(clippy::unwrap_used, clippy::missing_panics_doc, missing_docs)]
impl Service {
    /// On a small simulated bench, with its data in `place`.
    pub fn start(place: &Place, more: &[&str]) -> Self {
        Self::serve(place, &[&["--sim", "--bench", &place.text("bench.toml")], more].concat())
    }

    /// With the devices of a configuration, or other arguments.
    pub fn serve(place: &Place, args: &[&str]) -> Self {
        let (command, mark) = command();
        Self::run(command, mark, place, args)
    }

    /// On a small simulated bench, with this limit of open files.
    pub fn with_open_files(place: &Place, most: usize, more: &[&str]) -> Self {
        Self::within(place, &["sh", "-c", &format!("ulimit -n {most}; exec \"$0\" \"$@\"")], more)
    }

    /// On a small simulated bench, started by a command that replaces itself by the program and the arguments that
    /// follow.
    pub fn within(place: &Place, starter: &[&str], more: &[&str]) -> Self {
        let (program, mark) = command();
        let mut command = Command::new(starter[0]);
        command.args(&starter[1..]).arg(program.get_program());
        command.envs(program.get_envs().filter_map(|(name, value)| Some((name, value?))));
        Self::run(command, mark, place, &[&["--sim", "--bench", &place.text("bench.toml")], more].concat())
    }

    /// On a small simulated bench, with these environment variables.
    pub fn with_environment(place: &Place, variables: &[(&str, &str)]) -> Self {
        let (mut command, mark) = command();
        command.envs(variables.iter().copied());
        Self::run(command, mark, place, &["--sim", "--bench", &place.text("bench.toml")])
    }

    /// With the devices of a configuration, at a terminal with an operator, who presses Enter after each request. Then
    /// `act` follows with the request.
    pub fn at_terminal(place: &Place, args: &[&str], mut act: impl FnMut(&str) + Send + 'static) -> Self {
        let (mut command, mark) = command();
        command.stdin(Stdio::piped());
        Self::watched(command, mark, place, args, move |line, terminal| {
            if let Some(terminal) = terminal.filter(|_| line.contains("press Enter")) {
                // The service may have ended.
                let _ = terminal.write_all(b"\n");
                act(line);
            }
        })
    }

    fn run(command: Command, mark: String, place: &Place, args: &[&str]) -> Self {
        Self::watched(command, mark, place, args, |_, _| ())
    }

    fn watched(
        mut command: Command,
        mark: String,
        place: &Place,
        args: &[&str],
        mut seen: impl FnMut(&str, Option<&mut ChildStdin>) + Send + 'static,
    ) -> Self {
        command.args(["serve", "--listen", "127.0.0.1:0"]).args(args);
        command.args(["--data", &place.text("data")]).current_dir(place.path(""));
        let mut child = command.stderr(Stdio::piped()).stdout(Stdio::null()).spawn().expect("the service starts");
        let mut stdin = child.stdin.take();
        let mut line = String::new();
        let mut stderr = BufReader::new(child.stderr.take().unwrap());
        stderr.read_line(&mut line).unwrap();
        let address = line.split("http://").nth(1).and_then(|rest| rest.split('/').next()?.parse().ok());
        let address = address.unwrap_or_else(|| panic!("the service says: {line}"));
        std::thread::spawn(move || {
            stderr.lines().map_while(Result::ok).for_each(|line| {
                println!("service: {line}");
                seen(&line, stdin.as_mut());
            });
        });
        Self { child, address, mark }
    }

    /// Waits until the service reports that its disk is full, or no longer full.
    pub fn until_full(&self, full: bool) {
        self.until("/api/v1/about", |about| about["problems"].to_string().contains("full") == full);
    }

    /// Process id.
    pub fn pid(&self) -> u32 {
        self.child.id()
    }

    /// Kills it (SIGKILL).
    pub fn kill(mut self) {
        self.child.kill().unwrap();
        self.child.wait().unwrap();
        assert_gone(&self.mark);
    }

    /// Sends a signal.
    pub fn signal(&self, name: &str) {
        let sent = Command::new("kill").args([&format!("-{name}"), &self.child.id().to_string()]).status();
        assert!(sent.unwrap().success());
    }

    /// Exit code, once it has ended by itself.
    pub fn ended(&mut self) -> Option<i32> {
        let begun = Instant::now();
        while begun.elapsed() < Duration::from_secs(120) {
            if let Some(status) = self.child.try_wait().unwrap() {
                return status.code();
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        self.child.kill().unwrap();
        panic!("the service does not end");
    }

    /// A connection on which these bytes have been sent.
    pub fn connect(&self, bytes: &[u8]) -> TcpStream {
        let mut stream = TcpStream::connect(self.address).unwrap();
        stream.write_all(bytes).unwrap();
        stream
    }

    /// Sends bytes; reads until the server closes the connection, at most for `patience`.
    pub fn raw(&self, bytes: &[u8], patience: Duration) -> Vec<u8> {
        raw(self.address, bytes, patience)
    }

    /// Uploads a form with these parts: name, file name, bytes.
    pub fn upload(&self, parts: &[(&str, &str, &[u8])]) -> Answer {
        self.send("POST", "/api/v1/uploads", &["Content-Type: multipart/form-data; boundary=edge"], &form(parts))
    }

    /// Sends a request with these header lines.
    pub fn send(&self, method: &str, path: &str, headers: &[&str], body: &[u8]) -> Answer {
        let host = if headers.iter().any(|h| h.to_lowercase().starts_with("host:")) {
            String::new()
        } else {
            format!("Host: {}\r\n", self.address)
        };
        let lines: String = headers.iter().map(|h| format!("{h}\r\n")).collect();
        let head = format!(
            "{method} {path} HTTP/1.1\r\n{host}{lines}Content-Length: {}\r\nConnection: close\r\n\r\n",
            body.len()
        );
        Answer::parse(&self.raw(&[head.as_bytes(), body].concat(), 2 * NEVER))
    }

    pub fn get(&self, path: &str) -> Answer {
        self.send("GET", path, &[], b"")
    }

    pub fn post(&self, path: &str, body: &Value) -> Answer {
        self.send("POST", path, &["Content-Type: application/json"], body.to_string().as_bytes())
    }

    /// Waits until a document at a path satisfies `wanted`; returns it.
    pub fn until(&self, path: &str, wanted: impl Fn(&Value) -> bool) -> Value {
        let begun = Instant::now();
        loop {
            let answer = self.get(path);
            if answer.status == 200 && wanted(&answer.json()) {
                return answer.json();
            }
            assert!(begun.elapsed() < Duration::from_secs(180), "{path}: {}", answer.text());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Resident memory in KiB.
    pub fn memory(&self) -> u64 {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.child.id())).unwrap();
        let line = status.lines().find_map(|l| l.strip_prefix("VmRSS:")).unwrap();
        line.trim().trim_end_matches(" kB").parse().unwrap()
    }
}

#[allow(clippy::unwrap_used, clippy::missing_panics_doc, missing_docs)]
impl Answer {
    fn parse(bytes: &[u8]) -> Self {
        let Some(at) = bytes.windows(4).position(|w| w == b"\r\n\r\n") else {
            return Self { status: 0, head: String::from_utf8_lossy(bytes).into_owned(), body: vec![] };
        };
        let head = String::from_utf8_lossy(&bytes[..at]).into_owned();
        let status = head.split(' ').nth(1).and_then(|s| s.parse().ok()).unwrap_or(0);
        let rest = &bytes[at + 4..];
        let chunked = head.to_lowercase().contains("transfer-encoding: chunked");
        Self { status, body: if chunked { dechunked(rest) } else { rest.to_vec() }, head }
    }

    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {} {}", self.head, self.text()))
    }

    /// Asserts the status, and shows the response if it differs.
    pub fn expect(self, status: u16) -> Self {
        assert_eq!(self.status, status, "{}\n{}", self.head, self.text());
        self
    }

    pub fn header(&self, name: &str) -> Option<String> {
        let wanted = format!("{}:", name.to_lowercase());
        self.head.lines().find(|l| l.to_lowercase().starts_with(&wanted)).map(|l| l[wanted.len()..].trim().to_owned())
    }
}

/// Sends bytes; reads until the server closes the connection, at most for `patience`.
fn raw(address: SocketAddr, bytes: &[u8], patience: Duration) -> Vec<u8> {
    let mut stream = TcpStream::connect(address).expect("the other end listens");
    stream.set_read_timeout(Some(Duration::from_millis(50))).expect("a timeout can be set");
    // A service that rejects a large body may close the connection early.
    let _ = stream.write_all(bytes);
    let (begun, mut answer, mut buffer) = (Instant::now(), vec![], [0; 65536]);
    while begun.elapsed() < patience {
        match stream.read(&mut buffer) {
            Ok(0) => break,
            Ok(n) => answer.extend_from_slice(&buffer[..n]),
            Err(e) if e.kind() == std::io::ErrorKind::WouldBlock => {}
            Err(_) => break,
        }
        if complete(&answer) {
            break;
        }
    }
    answer
}

/// True if a response is complete according to its header.
fn complete(answer: &[u8]) -> bool {
    let Some(at) = answer.windows(4).position(|w| w == b"\r\n\r\n") else { return false };
    let head = String::from_utf8_lossy(&answer[..at]).to_lowercase();
    let length =
        head.lines().find_map(|l| l.strip_prefix("content-length:")).and_then(|v| v.trim().parse::<usize>().ok());
    length.is_some_and(|n| answer.len() >= at + 4 + n)
}

/// A form with these parts: name, file name, bytes.
pub fn form(parts: &[(&str, &str, &[u8])]) -> Vec<u8> {
    let mut body = vec![];
    for (name, file, bytes) in parts {
        let head = format!("--edge\r\nContent-Disposition: form-data; name=\"{name}\"; filename=\"{file}\"\r\n\r\n");
        body.extend([head.as_bytes(), bytes, b"\r\n"].concat());
    }
    body.extend(b"--edge--\r\n");
    body
}

/// One request to any server.
///
/// # Panics
/// If no server listens.
pub fn exchange(address: SocketAddr, request: &[u8], patience: Duration) -> Answer {
    Answer::parse(&raw(address, request, patience))
}

fn dechunked(mut bytes: &[u8]) -> Vec<u8> {
    let mut all = vec![];
    while let Some(at) = bytes.windows(2).position(|w| w == b"\r\n") {
        let size = std::str::from_utf8(&bytes[..at]).ok().and_then(|s| usize::from_str_radix(s, 16).ok()).unwrap_or(0);
        let end = (at + 2 + size).min(bytes.len());
        all.extend_from_slice(&bytes[at + 2..end]);
        bytes = &bytes[(end + 2).min(bytes.len())..];
        if size == 0 {
            break;
        }
    }
    all
}

impl Drop for Service {
    fn drop(&mut self) {
        if let Ok(None) = self.child.try_wait() {
            let _ = Command::new("kill").arg(self.child.id().to_string()).status();
        }
        let status = self.child.wait();
        if !std::thread::panicking() {
            assert!(
                status.as_ref().is_ok_and(|s| s.success() || s.code().is_none()),
                "the service ended badly: {status:?}"
            );
            assert_gone(&self.mark);
        }
    }
}

/// A plan with this number of angles.
pub fn plan(angles: usize, exposure_ms: f64) -> Value {
    let angles: Vec<f64> = (0..angles).map(|k| 180.0 * k as f64 / angles as f64).collect();
    json!({ "plan": {
        "kind": "polarization", "name": "a tile", "sample": "kinematic", "camera": { "exposure_ms": exposure_ms },
        "analyser": { "angles_deg": angles }, "reconstruct": { "operation": "polarization" }
    } })
}

/// Starts a session; returns its id.
///
/// # Panics
/// If the service refuses.
pub fn begin(service: &Service, plan: &Value) -> String {
    let answer = service.post("/api/v1/sessions", plan).expect(202);
    let id = answer.json()["id"].as_str().expect("a number").to_owned();
    assert_eq!(answer.header("location").expect("a place"), format!("/api/v1/sessions/{id}"));
    id
}

/// The session, once its map is finished.
pub fn finished(service: &Service, id: &str) -> Value {
    service.until(&format!("/api/v1/sessions/{id}"), |s| s["state"] == "finished" && s["has_results"] == true)
}

/// Events of a stream: number, name and data.
pub fn events(bytes: &[u8]) -> Vec<(u64, String, Value)> {
    let text = String::from_utf8_lossy(bytes).into_owned();
    let field = |block: &str, name: &str| block.lines().find_map(|l| l.strip_prefix(name)).map(|v| v.trim().to_owned());
    let event = |block: &str| {
        let (id, name, data) = (field(block, "id:")?, field(block, "event:")?, field(block, "data:")?);
        Some((id.parse().ok()?, name, serde_json::from_str(&data).ok()?))
    };
    text.split("\n\n").filter_map(event).collect()
}

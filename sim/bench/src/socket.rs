//! The bench in a separate process, so that it outlives a killed capture.
//!
//! Requests and replies travel over a Unix socket as lines of JSON. The codes of a frame follow its line, 16 bits
//! little-endian.

use crate::devices::Port;
use crate::messages::{Reply, Request, error};
use crate::port::SharedBench;
use nacre_drivers::{Class, Clock, DeviceError, DeviceResult};
use std::io::{self, BufRead, BufReader, Read, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

/// Longest line in bytes.
const MAX_LINE: u64 = 1 << 20;

/// Most pixels of a frame.
const MAX_PIXELS: usize = 16_384 * 16_384;

/// Time limit of an answer: more than two of the longest exposures.
const PATIENCE: Duration = Duration::from_secs(180);

/// Serves a bench on a socket, one thread per connection, until `stop` returns true.
///
/// # Errors
/// The socket cannot be created.
pub fn serve(bench: &SharedBench, path: &Path, stop: impl Fn() -> bool) -> io::Result<()> {
    // A socket without a listener is left from a killed bench.
    if UnixStream::connect(path).is_err() {
        match std::fs::symlink_metadata(path) {
            Ok(found) if std::os::unix::fs::FileTypeExt::is_socket(&found.file_type()) => std::fs::remove_file(path)?,
            _ => {}
        }
    }
    let listener = UnixListener::bind(path)?;
    listener.set_nonblocking(true)?;
    while !stop() {
        match listener.accept() {
            Ok((stream, _)) => {
                let bench = bench.clone();
                std::thread::spawn(move || serve_one(&bench, stream));
            }
            // Temporary errors, such as too many open files, are retried.
            Err(_) => std::thread::sleep(Duration::from_millis(2)),
        }
    }
    match std::fs::remove_file(path) {
        // The socket was already removed.
        Err(e) if e.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    }
}

/// Serves one connection.
fn serve_one(bench: &SharedBench, stream: UnixStream) {
    let reader = stream.set_nonblocking(false).and_then(|()| stream.try_clone()).map(BufReader::new);
    if let Ok(reader) = reader {
        answer_all(bench, reader, stream);
    }
}

/// Answers the requests of one connection until it ends.
///
/// When the panel's connection closes, the panel goes black, like the page in a browser without heartbeat. The flash
/// keeps its state, like a relay.
pub fn answer_all(bench: &SharedBench, mut requests: impl BufRead, mut answers: impl Write) {
    let mut showed = false;
    while let Ok(Some(line)) = read_line(&mut requests) {
        let answer = match serde_json::from_slice::<Request>(&line) {
            Ok(request) => {
                showed |= matches!(request, Request::Show { .. });
                bench.answer(&request)
            }
            Err(e) => Err(DeviceError::new("simulated bench", "understand a request", "JSON", e.to_string())),
        };
        let lost = answer.as_ref().is_err_and(|e| e.class == Class::Lost);
        if write_answer(&mut answers, &answer).is_err() || lost {
            break;
        }
    }
    if showed {
        bench.close_panel();
    }
}

fn write_answer(stream: &mut impl Write, answer: &DeviceResult<Reply>) -> io::Result<()> {
    let mut bytes = serde_json::to_vec(answer)?;
    bytes.push(b'\n');
    if let Ok(Reply::Frame { codes, .. }) = answer {
        bytes.extend(codes.iter().flat_map(|c| c.to_le_bytes()));
    }
    stream.write_all(&bytes)
}

fn read_line(reader: &mut impl BufRead) -> io::Result<Option<Vec<u8>>> {
    let mut line = Vec::new();
    reader.take(MAX_LINE).read_until(b'\n', &mut line)?;
    match line.pop() {
        Some(b'\n') => Ok(Some(line)),
        None => Ok(None),
        Some(_) => Err(io::ErrorKind::InvalidData.into()),
    }
}

/// Client of a bench in another process.
pub struct RemoteBench {
    reader: BufReader<UnixStream>,
    path: PathBuf,
}

impl RemoteBench {
    /// Connects to a bench's socket.
    ///
    /// # Errors
    /// `Setup` when no bench listens there.
    pub fn connect(path: &Path) -> DeviceResult<Self> {
        let opened = UnixStream::connect(path).and_then(|s| s.set_read_timeout(Some(PATIENCE)).map(|()| s));
        let stream = opened.map_err(|e| {
            DeviceError::new("simulated bench", format!("connect to {}", path.display()), "a bench", e.to_string())
                .remedy("start one with `nacre sim bench --socket PATH`")
                .class(Class::Setup)
        })?;
        Ok(Self::over(stream, path))
    }

    /// Uses an open connection; `path` names it in messages.
    pub fn over(stream: UnixStream, path: &Path) -> Self {
        Self { reader: BufReader::new(stream), path: path.to_path_buf() }
    }

    fn exchange(&mut self, request: &Request) -> io::Result<DeviceResult<Reply>> {
        let mut line = serde_json::to_vec(request)?;
        line.push(b'\n');
        self.reader.get_mut().write_all(&line)?;
        let line = read_line(&mut self.reader)?.ok_or(io::ErrorKind::UnexpectedEof)?;
        let mut answer: DeviceResult<Reply> = match serde_json::from_slice(&line) {
            Ok(answer) => answer,
            Err(e) => return Ok(Err(error(request, "an answer of its protocol", &format!("nonsense ({e})")))),
        };
        if let Ok(Reply::Frame { stamp, width, height, codes, .. }) = &mut answer {
            let pixels = width.checked_mul(*height).filter(|n| *n <= MAX_PIXELS).ok_or(io::ErrorKind::InvalidData)?;
            let follows = matches!(request, Request::NextFrame { fresh } if fresh.accepts(*stamp));
            let size = if follows { 2 * pixels } else { 0 };
            // Memory grows with the received bytes, not with the length in the line, which may be wrong.
            let mut bytes = vec![];
            self.reader.by_ref().take(size as u64).read_to_end(&mut bytes)?;
            if bytes.len() < size {
                return Err(io::ErrorKind::UnexpectedEof.into());
            }
            *codes = bytes.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect();
        }
        Ok(answer)
    }
}

/// Clock of a bench in another process.
pub struct RemoteClock {
    bench: Mutex<(RemoteBench, Duration)>,
}

impl RemoteClock {
    /// Connects to a bench's socket.
    ///
    /// # Errors
    /// `Setup` when no bench listens there.
    pub fn connect(path: &Path) -> DeviceResult<Self> {
        Ok(Self { bench: Mutex::new((RemoteBench::connect(path)?, Duration::ZERO)) })
    }
}

impl Clock for RemoteClock {
    /// Time of the last answer, if the bench is gone.
    fn now(&self) -> Duration {
        let mut bench = self.bench.lock().unwrap_or_else(PoisonError::into_inner);
        if let Ok(Reply::At(now)) = bench.0.call(&Request::Now) {
            bench.1 = now;
        }
        bench.1
    }

    fn wait(&self, duration: Duration) {
        std::thread::sleep(duration);
    }
}

impl Port for RemoteBench {
    fn call(&mut self, request: &Request) -> DeviceResult<Reply> {
        self.exchange(request).unwrap_or_else(|e| {
            let got = format!("a lost link to {} ({e})", self.path.display());
            Err(error(request, "an answer", &got).remedy("check that the bench still runs").class(Class::Lost))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::Bench;
    use crate::config::BenchConfig;
    use nacre_base::progress::Silent;
    use nacre_drivers::Freshness;
    use std::net::Shutdown;

    /// Found by fuzzing: times whose sum overflows.
    #[test]
    fn settings_that_the_camera_does_not_have_are_refused_and_the_connection_goes_on() {
        let config = BenchConfig::from_toml("camera = { width = 8, height = 6 }").unwrap();
        let bench = SharedBench::new(Bench::new(&config, &Silent).unwrap());
        let configure = |secs: &str, gain: &str| {
            format!("{{\"configure\":{{\"exposure\":{{\"secs\":{secs},\"nanos\":0}},\"gain\":{gain}}}}}\n")
        };
        let lines =
            [configure("18446744073709551615", "1"), configure("0", "1"), configure("1", "0"), configure("1", "1")];
        let mut answers = vec![];
        answer_all(&bench, lines.concat().as_bytes(), &mut answers);
        let answers = String::from_utf8(answers).unwrap();
        let answers: Vec<DeviceResult<Reply>> =
            answers.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        for refused in &answers[..3] {
            assert!(matches!(refused, Err(e) if e.class == Class::Setup && e.expected.contains("a gain of 1 to 100")));
        }
        assert!(matches!(answers[..], [_, _, _, Ok(Reply::Controls(_))]));
    }

    #[test]
    fn a_frame_that_does_not_arrive_is_a_lost_link() {
        let (mut bench, client) = UnixStream::pair().unwrap();
        let line = "{\"Ok\":{\"frame\":{\"stamp\":{\"sequence\":9,\"timestamp\":{\"secs\":9,\"nanos\":0}},\"width\":16384,\"height\":16384,\"damaged\":false}}}\n";
        bench.write_all(line.as_bytes()).unwrap();
        bench.write_all(&[0; 100]).unwrap();
        bench.shutdown(Shutdown::Write).unwrap();
        let mut client = RemoteBench::over(client, Path::new("bench"));
        let error = client.call(&Request::NextFrame { fresh: Freshness::default() }).unwrap_err();
        assert_eq!(error.class, Class::Lost);
    }
}

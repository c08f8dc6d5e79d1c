//! TCP connections to device servers, with a deadline on every step.

use std::io::{self, ErrorKind, Read, Write};
use std::net::{IpAddr, SocketAddr, TcpStream, ToSocketAddrs};
use std::sync::mpsc;
use std::time::{Duration, Instant};

/// Longest accepted address.
const MAX_ADDRESS: usize = 260;
/// Shortest timeout of a socket; zero would mean none.
const SHORTEST: Duration = Duration::from_millis(1);

/// Host and port of an address such as `192.168.1.7:11111`, `bench.local` or `[fe80::1]:7624`.
///
/// # Errors
/// A description of valid addresses.
pub(crate) fn host_and_port(address: &str, default_port: u16) -> Result<(&str, u16), String> {
    let wrong = || format!("address is {address:?}; give a host, or host:port, such as 192.168.1.7:{default_port}");
    let (host, port) = match address.strip_prefix('[') {
        Some(rest) => {
            let (host, rest) = rest.split_once(']').ok_or_else(wrong)?;
            (host, rest.strip_prefix(':'))
        }
        // More than one colon is an IPv6 address without a port.
        None if address.matches(':').count() == 1 => {
            address.split_once(':').map_or((address, None), |(host, port)| (host, Some(port)))
        }
        None => (address, None),
    };
    let port = port.map_or(Ok(default_port), |port| port.parse().map_err(|_| wrong()))?;
    let sane = |c: char| c.is_ascii_alphanumeric() || "-_.:%".contains(c);
    if host.is_empty() || address.len() > MAX_ADDRESS || !host.chars().all(sane) || port == 0 {
        return Err(wrong());
    }
    Ok((host, port))
}

/// A connection whose reads and writes end at a deadline.
pub(crate) struct Connection {
    stream: TcpStream,
    /// Deadline of the following reads and writes.
    pub until: Instant,
}

impl Connection {
    /// Connects within `limit`, which is also the first deadline.
    ///
    /// # Errors
    /// If no address of the host accepts the connection in time.
    pub fn open(host: &str, port: u16, limit: Duration) -> io::Result<Self> {
        let until = Instant::now() + limit;
        let mut last = io::Error::new(ErrorKind::NotFound, "the name has no address");
        for address in resolve(host, port, limit)? {
            match TcpStream::connect_timeout(&address, left(until)?) {
                Ok(stream) => {
                    stream.set_nodelay(true)?;
                    return Ok(Self { stream, until });
                }
                Err(e) => last = e,
            }
        }
        Err(last)
    }

    /// Whether an error means that nothing arrived in time.
    pub fn is_timeout(error: &io::Error) -> bool {
        matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut)
    }
}

impl Read for Connection {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.stream.set_read_timeout(Some(left(self.until)?))?;
        self.stream.read(buffer)
    }
}

impl Write for Connection {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.stream.set_write_timeout(Some(left(self.until)?))?;
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

/// Time until a deadline.
fn left(until: Instant) -> io::Result<Duration> {
    let left = until.saturating_duration_since(Instant::now());
    if left.is_zero() {
        return Err(ErrorKind::TimedOut.into());
    }
    Ok(left.max(SHORTEST))
}

/// Addresses of a host. The system's resolver has no deadline, so that it runs in another thread.
fn resolve(host: &str, port: u16, limit: Duration) -> io::Result<Vec<SocketAddr>> {
    if let Ok(ip) = host.parse::<IpAddr>() {
        return Ok(vec![SocketAddr::new(ip, port)]);
    }
    let (tell, told) = mpsc::channel();
    let host = host.to_owned();
    std::thread::Builder::new().name("resolve".into()).spawn(move || {
        let found = (host.as_str(), port).to_socket_addrs().map(|all| all.take(8).collect());
        // The caller may have given up.
        let _ = tell.send(found);
    })?;
    told.recv_timeout(limit).unwrap_or_else(|_| Err(io::Error::new(ErrorKind::TimedOut, "the name was not resolved")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::net::TcpListener;

    #[test]
    fn addresses_have_a_host_and_perhaps_a_port() {
        for (text, host, port) in [
            ("10.0.0.7", "10.0.0.7", 11),
            ("10.0.0.7:80", "10.0.0.7", 80),
            ("bench-2.local:80", "bench-2.local", 80),
            ("::1", "::1", 11),
            ("[::1]", "::1", 11),
            ("[fe80::1%eth0]:80", "fe80::1%eth0", 80),
        ] {
            assert_eq!(host_and_port(text, 11), Ok((host, port)), "{text}");
        }
        for wrong in ["", ":80", "a:b", "a:0", "a:70000", "http://a", "a b", "a\r\nHost: b", "[::1", "a/b", "[]:80"] {
            assert!(host_and_port(wrong, 11).unwrap_err().contains("address"), "{wrong}");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_an_address_or_refused(text in ".{0,40}") {
            if let Ok((host, port)) = host_and_port(&text, 11) {
                prop_assert!(!host.is_empty() && port > 0 && !host.contains(['\r', '\n', ' ', '/']));
            }
        }
    }

    #[test]
    fn a_silent_server_ends_at_the_deadline() {
        let silent = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = silent.local_addr().unwrap().port();
        let mut connection = Connection::open("localhost", port, Duration::from_secs(20)).unwrap();
        connection.until = Instant::now() + Duration::from_millis(50);
        let error = connection.read(&mut [0; 8]).unwrap_err();
        assert!(Connection::is_timeout(&error), "{error}");
        drop(silent);
        assert!(Connection::open("127.0.0.1", port, Duration::from_secs(20)).is_err());
    }
}

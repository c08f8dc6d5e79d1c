//! A small HTTP/1.1 client: one request per connection, with a deadline and a limit on the size of the answer.

use crate::net::Connection;
use std::io::{self, Read, Write};
use std::time::{Duration, Instant};

/// Largest head of an answer in bytes.
const MAX_HEAD: usize = 16 * 1024;
/// Largest number of header lines.
const MAX_HEADERS: usize = 64;
/// Longest line with the size of a chunk.
const MAX_CHUNK_LINE: usize = 64;

/// An answer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Answer {
    /// Status code.
    pub status: u16,
    /// Media type without parameters, in lower case.
    pub content_type: String,
    /// Body.
    pub body: Vec<u8>,
}

/// Failure of a request.
#[derive(Debug)]
pub enum Failure {
    /// The server does not accept connections, or closed this one.
    Unreachable(String),
    /// No complete answer in time.
    Slow(Duration),
    /// The answer is not valid HTTP, or too large.
    Invalid(String),
}

/// A request.
pub(crate) struct Request<'a> {
    pub host: &'a str,
    pub port: u16,
    /// Path and query.
    pub target: &'a str,
    /// Body of a PUT request; `None` for a GET request.
    pub form: Option<&'a str>,
    pub accept: &'a str,
    /// Largest body of the answer in bytes.
    pub most: usize,
    /// Maximum time of the whole exchange.
    pub limit: Duration,
}

/// Sends a request and reads the answer.
///
/// # Errors
/// [`Failure`].
pub(crate) fn exchange(request: &Request<'_>) -> Result<Answer, Failure> {
    let failed = |e: &io::Error| match Connection::is_timeout(e) {
        true => Failure::Slow(request.limit),
        false if e.kind() == io::ErrorKind::InvalidData => Failure::Invalid(e.to_string()),
        false => Failure::Unreachable(e.to_string()),
    };
    let until = Instant::now() + request.limit;
    let mut link = Connection::open(request.host, request.port, request.limit).map_err(|e| failed(&e))?;
    link.until = until;
    link.write_all(head_and_body(request).as_bytes()).map_err(|e| failed(&e))?;
    read_answer(&mut link, request.most).map_err(|e| failed(&e))
}

fn head_and_body(request: &Request<'_>) -> String {
    let Request { host, port, target, accept, .. } = request;
    let host = if host.contains(':') { format!("[{host}]") } else { (*host).to_owned() };
    let method = if request.form.is_some() { "PUT" } else { "GET" };
    let mut text = format!(
        "{method} {target} HTTP/1.1\r\nHost: {host}:{port}\r\nUser-Agent: nacre\r\nAccept: {accept}\r\nConnection: close\r\n"
    );
    if let Some(form) = request.form {
        let length = form.len();
        text.push_str("Content-Type: application/x-www-form-urlencoded\r\n");
        text.push_str(&format!("Content-Length: {length}\r\n\r\n{form}"));
    } else {
        text.push_str("\r\n");
    }
    text
}

fn invalid(text: impl Into<String>) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, text.into())
}

/// Reads an answer with a body of at most `most` bytes.
///
/// # Errors
/// `InvalidData` if it is not HTTP/1.1 or too large; those of the reader.
pub fn read_answer(from: &mut impl Read, most: usize) -> io::Result<Answer> {
    let (head, rest) = read_head(from)?;
    let mut headers = [httparse::EMPTY_HEADER; MAX_HEADERS];
    let mut response = httparse::Response::new(&mut headers);
    let parsed = response.parse(&head).map_err(|e| invalid(format!("not an answer in HTTP ({e})")))?;
    let status = response.code.filter(|_| parsed.is_complete()).ok_or_else(|| invalid("an incomplete head"))?;
    let header = |name: &str| {
        let found = response.headers.iter().find(|h| h.name.eq_ignore_ascii_case(name));
        found.map(|h| String::from_utf8_lossy(h.value).trim().to_owned())
    };
    let content_type = header("content-type").unwrap_or_default().to_ascii_lowercase();
    let content_type = content_type.split(';').next().unwrap_or_default().trim().to_owned();
    let chunked = header("transfer-encoding").is_some_and(|v| v.to_ascii_lowercase().contains("chunked"));
    let length = header("content-length").map(|text| text.parse::<usize>()).transpose();
    let length = length.map_err(|_| invalid("an unreadable Content-Length"))?;
    let mut body = rest.chain(from);
    let body = match length {
        _ if chunked => read_chunks(&mut body, most)?,
        Some(length) if length > most => return Err(too_large(most)),
        Some(length) => {
            let mut bytes = Vec::new();
            body.take(length as u64).read_to_end(&mut bytes)?;
            if bytes.len() < length {
                return Err(invalid(format!("{} bytes of {length}", bytes.len())));
            }
            bytes
        }
        None => bounded(&mut body, most)?,
    };
    Ok(Answer { status, content_type, body })
}

fn too_large(most: usize) -> io::Error {
    invalid(format!("an answer of more than {most} bytes"))
}

/// Reads up to the empty line; returns the head and the bytes that were read beyond it.
fn read_head(from: &mut impl Read) -> io::Result<(Vec<u8>, io::Cursor<Vec<u8>>)> {
    let (mut head, mut buffer) = (Vec::new(), [0; 2048]);
    loop {
        let count = from.read(&mut buffer)?;
        if count == 0 {
            return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the connection was closed before the answer"));
        }
        let searched = head.len().saturating_sub(3);
        head.extend_from_slice(buffer.get(..count).unwrap_or(&buffer));
        if let Some(at) = head.get(searched..).and_then(|new| new.windows(4).position(|w| w == b"\r\n\r\n")) {
            let rest = head.split_off(searched + at + 4);
            return Ok((head, io::Cursor::new(rest)));
        }
        if head.len() > MAX_HEAD {
            return Err(invalid("a head without an end"));
        }
    }
}

fn bounded(from: &mut impl Read, most: usize) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    from.take(most as u64 + 1).read_to_end(&mut bytes)?;
    if bytes.len() > most { Err(too_large(most)) } else { Ok(bytes) }
}

/// Reads a body in chunks, each with its size in hexadecimal digits before it.
fn read_chunks(from: &mut impl Read, most: usize) -> io::Result<Vec<u8>> {
    let (mut bytes, mut reader) = (Vec::new(), io::BufReader::new(from));
    loop {
        let line = chunk_line(&mut reader)?;
        let digits = line.split(';').next().unwrap_or_default().trim();
        let size = usize::from_str_radix(digits, 16).map_err(|_| invalid("an unreadable size of a chunk"))?;
        if size > most - bytes.len() {
            return Err(too_large(most));
        }
        if size == 0 {
            return Ok(bytes);
        }
        let before = bytes.len();
        reader.by_ref().take(size as u64).read_to_end(&mut bytes)?;
        if bytes.len() - before < size || !chunk_line(&mut reader)?.is_empty() {
            return Err(invalid("an incomplete chunk"));
        }
    }
}

/// Reads a line without its end.
fn chunk_line(from: &mut impl Read) -> io::Result<String> {
    let (mut line, mut byte) = (Vec::new(), [0]);
    while line.len() <= MAX_CHUNK_LINE {
        from.read_exact(&mut byte).map_err(|e| match e.kind() {
            io::ErrorKind::UnexpectedEof => invalid("an incomplete chunk"),
            _ => e,
        })?;
        match byte[0] {
            b'\n' => return Ok(String::from_utf8_lossy(&line).trim_end_matches('\r').to_owned()),
            other => line.push(other),
        }
    }
    Err(invalid("a line of a chunk without an end"))
}

/// Encodes a value of a form or query.
pub(crate) fn encoded(text: &str) -> String {
    let mut out = String::new();
    for byte in text.bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'_' | b'.' | b'~' => out.push(char::from(byte)),
            other => out.push_str(&format!("%{other:02X}")),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(text: &[u8]) -> io::Result<Answer> {
        read_answer(&mut io::Cursor::new(text), 20)
    }

    #[test]
    fn bodies_have_a_length_chunks_or_the_end_of_the_connection() {
        let sized =
            b"HTTP/1.1 200 OK\r\nContent-Type: Application/JSON; charset=utf-8\r\nContent-Length: 5\r\n\r\nhello more";
        let answer = read(sized).unwrap();
        assert_eq!((answer.status, answer.content_type.as_str()), (200, "application/json"));
        assert_eq!(answer.body, b"hello");
        let chunks = b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n5\r\nhello\r\n3;x=1\r\n wo\r\n0\r\n\r\n";
        assert_eq!(read(chunks).unwrap().body, b"hello wo");
        assert_eq!(read(b"HTTP/1.0 404 Not Found\r\n\r\ngone").unwrap().body, b"gone");
    }

    #[test]
    fn endless_large_and_broken_answers_are_refused() {
        let text = |tail: &str| format!("HTTP/1.1 200 OK\r\n{tail}").into_bytes();
        for wrong in [
            text("Content-Length: 21\r\n\r\n"),
            text("Content-Length: 99999999999999999999\r\n\r\n"),
            text("Content-Length: 4\r\n\r\nabc"),
            text("Transfer-Encoding: chunked\r\n\r\n15\r\n"),
            text("Transfer-Encoding: chunked\r\n\r\nFFFFFFFFFFFFFFFF\r\n"),
            text("Transfer-Encoding: chunked\r\n\r\n3\r\nab"),
            text("Transfer-Encoding: chunked\r\n\r\n3\r\nabcde\r\n"),
            text("Transfer-Encoding: chunked\r\n\r\n3"),
            text(&"x: y\r\n".repeat(65)),
            text(&format!("{}\r\n", "x".repeat(20_000))),
            [text("\r\n"), vec![b'a'; 21]].concat(),
            b"<INDI>\r\n\r\n".to_vec(),
        ] {
            let error = read(&wrong).unwrap_err();
            assert!(["InvalidData", "UnexpectedEof"].contains(&format!("{:?}", error.kind()).as_str()), "{error:?}");
        }
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(head in ".{0,60}", body: Vec<u8>) {
            for start in ["", "HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n"] {
                let bytes = [start.as_bytes(), head.as_bytes(), b"\r\n\r\n", &body].concat();
                if let Ok(answer) = read(&bytes) {
                    prop_assert!(answer.body.len() <= 20);
                }
            }
        }

        #[test]
        fn encoded_values_hold_only_safe_characters(text in ".{0,40}") {
            prop_assert!(encoded(&text).bytes().all(|b| b.is_ascii_alphanumeric() || b"-_.~%".contains(&b)));
        }
    }
}

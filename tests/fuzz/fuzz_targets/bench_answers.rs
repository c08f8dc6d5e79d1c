//! Responses of a bench in another process, as received by its client. The first byte selects the request.
#![no_main]

use libfuzzer_sys::fuzz_target;
use nacre_drivers::{Freshness, Pattern};
use nacre_sim::socket::RemoteBench;
use nacre_sim::{Port, Request};
use std::io::Write;
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::path::Path;

fuzz_target!(|bytes: &[u8]| {
    let Some((choice, bytes)) = bytes.split_first() else { return };
    let request = match choice % 4 {
        0 => Request::Describe,
        1 => Request::NextFrame { fresh: Freshness::default() },
        2 => Request::Show { pattern: Pattern::Black },
        _ => Request::Now,
    };
    let (mut bench, client) = UnixStream::pair().expect("a pair of sockets");
    // Below the capacity of the socket's buffer.
    bench.write_all(&bytes[..bytes.len().min(65_536)]).expect("room for the answers");
    bench.shutdown(Shutdown::Write).expect("an open socket");
    let mut client = RemoteBench::over(client, Path::new("bench"));
    while client.call(&request).is_ok() {}
});

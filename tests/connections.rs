//! Connections of clients that send nothing or incomplete requests, or that do not read: other clients are served, and
//! the service stops in time.

#![allow(clippy::unwrap_used)]

use nacre_tests::http::{Service, begin, finished, plan};
use nacre_tests::{BENCH, Place, listing};
use serde_json::json;
use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixDatagram;
use std::time::{Duration, Instant};

/// Clients have a time limit of 5 s.
const LIMITS: &str = "limits = { client_s = 5, requests = 2, subscribers = 4 }";

fn with_limits() -> (Place, Service) {
    let place = Place::with_bench("", BENCH);
    fs::write(place.path("nacre.toml"), LIMITS).unwrap();
    let service = Service::start(&place, &["--config", "nacre.toml"]);
    (place, service)
}

/// Response until the server closes the connection, while one byte is sent from time to time.
fn trickle(mut stream: TcpStream) -> String {
    stream.set_read_timeout(Some(Duration::from_millis(200))).unwrap();
    let (begun, mut answer, mut buffer) = (Instant::now(), vec![], [0; 4096]);
    loop {
        assert!(begun.elapsed() < Duration::from_secs(180), "the connection never ends");
        match stream.read(&mut buffer) {
            Ok(0) => return String::from_utf8_lossy(&answer).into_owned(),
            Ok(n) => answer.extend_from_slice(&buffer[..n]),
            // The connection may be closed between reading and writing.
            Err(e) if e.kind() == ErrorKind::WouldBlock => drop(stream.write(b"x")),
            Err(_) => return String::from_utf8_lossy(&answer).into_owned(),
        }
    }
}

#[test]
fn idle_connections_shut_nobody_out() {
    let place = Place::with_bench("", BENCH);
    fs::write(place.path("nacre.toml"), "limits = { client_s = 5 }").unwrap();
    let service = Service::with_open_files(&place, 256, &["--config", "nacre.toml"]);
    let id = begin(&service, &plan(12, 100.0));
    let base = format!("/api/v1/sessions/{id}");
    let head = format!("GET {base}/events HTTP/1.1\r\nHost: {}\r\n", service.address);
    let mut stream = service.connect(format!("{head}\r\n").as_bytes());
    service.until(&base, |s| s["frames_committed"].as_u64() > Some(0));
    let idle: Vec<_> = (0..400).map(|k| service.connect(&head.as_bytes()[..k % head.len()])).collect();
    finished(&service, &id);
    service.post("/api/v1/stop", &json!({})).expect(200);
    assert_eq!(service.get("/api/v1/sessions").expect(200).json()["items"][0]["id"], id.as_str());
    // The event stream was kept throughout.
    let mut told = vec![];
    stream.set_read_timeout(Some(Duration::from_secs(180))).unwrap();
    while !String::from_utf8_lossy(&told).contains("finished") {
        let mut buffer = [0; 4096];
        let n = stream.read(&mut buffer).unwrap();
        assert!(n > 0, "the event stream ended early");
        told.extend_from_slice(&buffer[..n]);
    }
    assert!(told.windows(5).filter(|w| w == b"frame").count() >= 12);
    idle.into_iter().for_each(|stream| drop(trickle(stream)));
}

#[test]
fn idle_event_streams_stay_and_other_idle_connections_end() {
    let (_place, service) = with_limits();
    let id = begin(&service, &plan(6, 60.0));
    let base = format!("/api/v1/sessions/{id}");
    service.post(&format!("{base}/pause"), &json!({})).expect(202);
    service.until(&base, |s| s["state"] == "paused");
    let host = format!("HTTP/1.1\r\nHost: {}\r\n", service.address);
    let mut watching = service.connect(format!("GET {base}/events {host}Connection: close\r\n\r\n").as_bytes());
    let kept_alive = service.connect(format!("GET /healthz {host}\r\n").as_bytes());
    for stream in [service.connect(b""), service.connect(b"GET /heal"), service.connect(host.as_bytes()), kept_alive] {
        trickle(stream);
    }
    service.post(&format!("{base}/resume"), &json!({})).expect(202);
    finished(&service, &id);
    let mut told = vec![];
    watching.set_read_timeout(Some(Duration::from_secs(180))).unwrap();
    watching.read_to_end(&mut told).unwrap();
    let told = String::from_utf8_lossy(&told).into_owned();
    assert!(told.contains("\"finished\""), "{told}");
}

#[test]
fn slow_requests_hold_nobody_up_and_end() {
    let (place, service) = with_limits();
    let upload = "--edge\r\nContent-Disposition: form-data; name=\"file\"; filename=\"a.png\"\r\n\r\n";
    let slow: Vec<_> = ["uploads", "plans/check", "sessions", "reconstructions", "display/pattern"]
        .into_iter()
        .flat_map(|path| {
            let kind = if path == "uploads" { "multipart/form-data; boundary=edge" } else { "application/json" };
            let request = format!(
                "POST /api/v1/{path} HTTP/1.1\r\nHost: {}\r\nContent-Type: {kind}\r\nContent-Length: 60000\r\n\r\n{}",
                service.address,
                if path == "uploads" { upload } else { "{" }
            );
            [service.connect(request.as_bytes()), service.connect(request.as_bytes())]
        })
        .collect();
    let ends: Vec<_> = slow.into_iter().map(|stream| std::thread::spawn(|| trickle(stream))).collect();
    while ends.iter().any(|end| !end.is_finished()) {
        service.get("/api/v1/about").expect(200);
        service.post("/api/v1/plans/check", &plan(6, 20.0)).expect(200);
        service.post("/api/v1/stop", &json!({})).expect(200);
        std::thread::sleep(Duration::from_millis(50));
    }
    for end in ends {
        let answer = end.join().unwrap();
        assert!(answer.starts_with("HTTP/1.1 408") && answer.contains("/problems/slow"), "{answer}");
    }
    assert!(listing(&place.path("data/uploads")).is_empty());
}

#[test]
fn a_download_that_nobody_reads_ends() {
    let (place, service) = with_limits();
    let id = begin(&service, &plan(3, 5.0));
    finished(&service, &id);
    let file = place.path(&format!("data/sessions/{id}/frames/large.png"));
    fs::write(&file, vec![7; 16 << 20]).unwrap();
    let path = format!("/api/v1/sessions/{id}/files/frames/large.png");
    let open = || {
        let files = fs::read_dir(format!("/proc/{}/fd", service.pid())).unwrap().flatten();
        files.filter_map(|f| fs::read_link(f.path()).ok()).filter(|target| *target == file).count()
    };
    let request = format!("GET {path} HTTP/1.1\r\nHost: {}\r\n\r\n", service.address);
    let mut streams: Vec<_> = (0..8).map(|_| service.connect(request.as_bytes())).collect();
    for stream in &mut streams {
        stream.read_exact(&mut [0; 15]).unwrap();
    }
    assert!(open() > 0, "the answers fit what the system keeps for readers");
    service.post("/api/v1/stop", &json!({})).expect(200);
    let begun = Instant::now();
    while open() > 0 {
        assert!(begun.elapsed() < Duration::from_secs(180), "never closed");
        std::thread::sleep(Duration::from_millis(20));
    }
    assert_eq!(service.get(&path).expect(200).body.len(), 16 << 20);
}

#[test]
fn the_service_ends_whatever_clients_do() {
    for signals in [&["TERM"][..], &["INT"], &["TERM", "INT"], &["INT", "INT", "INT"]] {
        let place = Place::with_bench("", BENCH);
        let mut service = Service::start(&place, &[]);
        let id = begin(&service, &plan(12, 400.0));
        service.until(&format!("/api/v1/sessions/{id}"), |s| s["state"] == "running");
        let host = format!("HTTP/1.1\r\nHost: {}\r\n", service.address);
        let body = format!("{host}Content-Type: application/json\r\nContent-Length: 60000\r\n\r\n{{");
        let clients: Vec<_> = [
            String::new(),
            "GET / HTTP/1.1\r\nHost: x".into(),
            format!("GET /healthz {host}\r\n"),
            format!("POST /api/v1/plans/check {body}"),
            format!("GET /api/v1/sessions/{id}/events {host}\r\n"),
            format!("GET /api/v1/display/link?page=a {host}\r\n"),
        ]
        .map(|request| service.connect(request.as_bytes()))
        .into();
        service.until("/api/v1/about", |_| true);
        let begun = Instant::now();
        signals.iter().for_each(|signal| service.signal(signal));
        assert_eq!(service.ended(), Some(0), "{signals:?}");
        println!("{signals:?}: {:.1} s", begun.elapsed().as_secs_f64());
        drop(clients);
        let again = Service::start(&place, &[]);
        let left = again.get(&format!("/api/v1/sessions/{id}")).expect(200).json();
        assert_eq!(left["state"], "idle", "{left}");
    }
}

/// Notifications required by a systemd unit with `Type=notify` and `WatchdogSec=`.
#[test]
fn systemd_is_told_that_it_is_ready_alive_and_stopping() {
    let place = Place::with_bench("", BENCH);
    let socket = UnixDatagram::bind(place.path("notify")).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let next = || {
        let mut bytes = [0; 512];
        let count = socket.recv(&mut bytes).unwrap();
        String::from_utf8_lossy(&bytes[..count]).into_owned()
    };
    let variables = [("NOTIFY_SOCKET", place.text("notify")), ("WATCHDOG_USEC", "200000".into())];
    let mut service =
        Service::with_environment(&place, &variables.each_ref().map(|(name, value)| (*name, value.as_str())));
    let ready = next();
    assert!(ready.starts_with("READY=1\n") && ready.contains(&service.address.to_string()), "{ready}");
    assert_eq!([next(), next()], ["WATCHDOG=1\n"; 2]);
    service.signal("TERM");
    while next() != "STOPPING=1\n" {}
    assert_eq!(service.ended(), Some(0));
}

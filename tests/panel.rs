//! The service with emulated devices: sessions through the real drivers, and with a browser page as panel.

#![allow(clippy::unwrap_used)]

use nacre_tests::http::{Service, begin, exchange};
use nacre_tests::{BENCH, BenchProcess, Place, analyser_deg, light};
use serde_json::{Value, json};
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// A bench at real pace with an emulated GRBL axis and relay, and a service that drives them.
fn driven(place: &Place, display: &str) -> (BenchProcess, Service) {
    let [socket, stage, lamp] = ["socket", "stage", "lamp"].map(|name| place.text(name));
    let config = format!(
        "[bench]\nsim = true\nsocket = {socket:?}\n{display}\n[bench.stage]\n\
         driver = {{ kind = \"grbl\", port = {stage:?}, settling_ms = 20 }}\n\
         [bench.flash]\ndriver = {{ kind = \"relay\", path = \"unix:{lamp}\" }}\n"
    );
    fs::write(place.path("driven.toml"), config).unwrap();
    let devices = [format!("grbl={stage}"), format!("relay={lamp}")];
    let more = ["--real-time", "--device", &devices[0], "--device", &devices[1]];
    let bench = BenchProcess::start(&place.path("socket"), &place.path("bench.toml"), &more);
    let service = Service::serve(place, &["--config", &place.text("driven.toml")]);
    (bench, service)
}

#[test]
fn the_service_drives_devices_and_stop_cuts_their_movements_short() {
    let place = Place::with_bench("", &format!("{BENCH}stage = {{ speed_deg_s = 18 }}\n"));
    let (bench, service) = driven(&place, "");
    let devices = service.get("/api/v1/devices").expect(200).json();
    assert!(devices["stage"]["id"].as_str().unwrap().contains("GRBL") && devices["simulated"] == false, "{devices}");
    let plan = json!({ "plan": {
        "kind": "free",
        "steps": [
            { "analyser_deg": 20.0, "exposure_ms": 8.0 },
            { "analyser_deg": 45.0, "exposure_ms": 8.0, "flash": true },
        ],
    } });
    let id = begin(&service, &plan);
    // Without a stage of work it has released the devices; when its state changes, it still holds them.
    let over = |s: &Value| s["state"] == "finished" && s["stage"].is_null();
    let done = service.until(&format!("/api/v1/sessions/{id}"), over);
    assert_eq!(done["frames_committed"], 2, "{done}");
    assert_eq!(light(&bench), [false, false]);

    // A movement of nine seconds, so that a busy machine has time to stop it.
    let away = json!({ "analyser_deg": 210.0 });
    std::thread::scope(|scope| {
        let moved = scope.spawn(|| service.post("/api/v1/devices/stage/move", &away));
        while analyser_deg(&bench) < 50.0 {
            assert!(!moved.is_finished(), "it does not move: {}", moved.join().unwrap().text());
            std::thread::sleep(Duration::from_millis(20));
        }
        let begun = Instant::now();
        service.post("/api/v1/stop", &json!({})).expect(200);
        println!("STOP took {:.0} ms", 1000.0 * begun.elapsed().as_secs_f64());
        moved.join().unwrap().expect(409);
    });
    let stood = analyser_deg(&bench);
    assert!((50.0..200.0).contains(&stood), "stopped at {stood}°, on its way from 45° to 210°");
    std::thread::sleep(Duration::from_millis(500));
    let stands = analyser_deg(&bench);
    assert!((stands - stood).abs() < 0.01, "it moves on, from {stood}° to {stands}°");
    let told = service.get("/api/v1/devices").expect(200).json()["stage"]["analyser_deg"].as_f64().unwrap();
    assert!((told - stands).abs() < 0.1, "it stands at {stands}°, but is said to stand at {told}°");
}

/// A simulated browser page, which acknowledges the requested patterns and sends heartbeats.
pub(crate) struct Page {
    pub(crate) shown: Arc<Mutex<Vec<Value>>>,
    stream: TcpStream,
    /// Heartbeats go on while this exists.
    _beats: Arc<()>,
}

impl Page {
    /// Opens the page and waits until it has acknowledged its first pattern.
    pub(crate) fn open(service: &Service) -> Self {
        let address = service.address;
        let mut stream = TcpStream::connect(address).unwrap();
        let request = "GET /api/v1/display/link?page=tests HTTP/1.1\r\nHost: localhost\r\n\r\n";
        stream.write_all(request.as_bytes()).unwrap();
        let shown: Arc<Mutex<Vec<Value>>> = Arc::default();
        let (seen, reader) = (shown.clone(), BufReader::new(stream.try_clone().unwrap()));
        std::thread::spawn(move || {
            let event = |line: String| serde_json::from_str(line.strip_prefix("data:")?.trim()).ok();
            let events = reader.lines().map_while(Result::ok).filter_map(event);
            events.for_each(|event: Value| {
                seen.lock().unwrap().push(event["pattern"].clone());
                acknowledge(address, &event["hash"]);
            });
        });
        let page = Self { shown, stream, _beats: Arc::default() };
        let beats = Arc::downgrade(&page._beats);
        std::thread::spawn(move || {
            // The service may end first.
            while beats.upgrade().is_some() && TcpStream::connect(address).is_ok() {
                post(address, "/api/v1/display/beat", &json!({ "page": "tests", "visible": true }));
                std::thread::sleep(Duration::from_millis(300));
            }
        });
        service.until("/api/v1/display", |d| d["acknowledged"] == true);
        page
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        // A stopped service has already closed the connection.
        let _ = self.stream.shutdown(Shutdown::Both);
    }
}

fn acknowledge(address: SocketAddr, hash: &Value) {
    let told = json!({ "page": "tests", "hash": hash, "viewport": [800, 600], "pixel_ratio": 1, "visible": true });
    post(address, "/api/v1/display/acknowledge", &told);
}

fn post(address: SocketAddr, path: &str, told: &Value) {
    let body = told.to_string();
    let request = format!(
        "POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n\
         Connection: close\r\nContent-Length: {}\r\n\r\n{body}",
        body.len()
    );
    exchange(address, request.as_bytes(), Duration::from_secs(2));
}

/// Sessions use the pattern page as their light; without a page they stop, and can be resumed once there is one.
#[test]
fn sessions_light_the_sample_with_the_pattern_page() {
    let place = Place::with_bench("", BENCH);
    let display = "[bench.display]\ndriver = { kind = \"page\", size_mm = [500, 300] }\n";
    let (_bench, service) = driven(&place, display);
    let plan = json!({ "plan": {
        "kind": "free",
        "steps": [{ "analyser_deg": 20.0, "exposure_ms": 8.0, "display": { "diameter_mm": 120.0 } }],
    } });
    let id = begin(&service, &plan);
    let base = format!("/api/v1/sessions/{id}");
    let stopped = service.until(&base, |s| s["error"].is_string());
    assert!(stopped["error"].as_str().unwrap().contains("no pattern page is open"), "{stopped}");

    let page = Page::open(&service);
    // No pattern is shown while an interlock is open or after STOP.
    let past = service.post("/api/v1/display/pattern", &json!({ "pattern": { "kind": "full" } })).expect(409);
    assert!(past.text().contains("the pattern page is the bench's panel"), "{}", past.text());
    service.post(&format!("{base}/resume"), &json!({})).expect(202);
    let done = service.until(&base, |s| s["state"] == "finished");
    assert_eq!(done["frames_committed"], 1, "{done}");
    let shown = page.shown.lock().unwrap().clone();
    let disc = shown.iter().any(|p| p["kind"] == "disc" && p["diameter_mm"] == 120.0);
    assert!(shown.iter().all(|p| p["kind"] != "full"), "{shown:?}");
    assert!(disc && shown.last().unwrap()["kind"] == "black", "{shown:?}");
}

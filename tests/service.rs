//! The service over HTTP: sessions, events, reconstructions, and what it refuses.

#![allow(clippy::unwrap_used)]

use nacre_tests::http::{Answer, Service};
use nacre_tests::{Place, listing, nacre};
use serde_json::{Value, json};
use std::fs;
use std::time::{Duration, Instant};

const BENCH: &str = "camera = { width = 64, height = 48 }";

fn plan(angles: usize, exposure_ms: f64) -> Value {
    let angles: Vec<f64> = (0..angles).map(|k| 180.0 * k as f64 / angles as f64).collect();
    json!({ "plan": {
        "kind": "polarization", "name": "a tile", "sample": "kinematic", "camera": { "exposure_ms": exposure_ms },
        "analyser": { "angles_deg": angles }, "reconstruct": { "method": "polarization" }
    } })
}

fn begin(service: &Service, plan: &Value) -> String {
    let answer = service.post("/api/v1/sessions", plan).expect(202);
    let id = answer.json()["id"].as_str().unwrap().to_owned();
    assert_eq!(answer.header("location").unwrap(), format!("/api/v1/sessions/{id}"));
    id
}

fn finished(service: &Service, id: &str) -> Value {
    service.until(&format!("/api/v1/sessions/{id}"), |s| s["state"] == "finished" && s["has_results"] == true)
}

/// Events of a stream: number, name and data.
fn events(bytes: &[u8]) -> Vec<(u64, String, Value)> {
    let text = String::from_utf8_lossy(bytes).into_owned();
    let field = |block: &str, name: &str| block.lines().find_map(|l| l.strip_prefix(name)).map(|v| v.trim().to_owned());
    let event = |block: &str| {
        let (id, name, data) = (field(block, "id:")?, field(block, "event:")?, field(block, "data:")?);
        Some((id.parse().ok()?, name, serde_json::from_str(&data).ok()?))
    };
    text.split("\n\n").filter_map(event).collect()
}

/// Near and from the side oblique incidence shows; whether it is taken out is asked for, and said.
#[test]
fn oblique_incidence_is_taken_out_on_request() {
    let near = "camera = { width = 96, height = 96 }\ngeometry = { distance_mm = 300, baseline_mm = 240 }";
    let place = Place::with_bench("", near);
    let service = Service::start(&place, &[]);
    let id = begin(&service, &plan(6, 20.0));
    finished(&service, &id);
    let report = |asked: Value| {
        let answer = service.post("/api/v1/reconstructions", &asked).expect(202).json();
        let path = format!("/api/v1/reconstructions/{}", answer["id"].as_str().unwrap());
        service.until(&path, |r| r["state"] == "done")["report"].clone()
    };
    let oblique = report(json!({ "session": id, "oblique": "auto" }))["oblique"].clone();
    assert!(oblique["largest_deg"].as_f64().unwrap() > 10.0, "{oblique}");
    for asked in [json!({ "session": id, "oblique": "off" }), json!({ "session": id })] {
        assert!(report(asked)["oblique"].is_null());
    }
    service.post("/api/v1/reconstructions", &json!({ "session": id, "oblique": "sideways" })).expect(400);
}

#[test]
fn a_session_runs_is_watched_and_its_map_is_looked_at() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let sound = service.post("/api/v1/plans/check", &plan(6, 20.0)).expect(200).json();
    assert_eq!((&sound["sound"], &sound["frames"]), (&json!(true), &json!(6)));
    let estimate = service.post("/api/v1/plans/estimate", &plan(6, 20.0)).expect(200).json();
    let id = begin(&service, &plan(6, 20.0));
    let base = format!("/api/v1/sessions/{id}");
    let stream = service.send("GET", &format!("{base}/events"), &[], b"").expect(200);
    let all = events(&stream.body);
    let count = |name: &str| all.iter().filter(|e| e.1 == name).count();
    assert_eq!((count("frame"), count("results")), (6, 1), "{all:?}");
    assert!(count("map") >= 1 && all.last().unwrap().2["state"] == "finished", "{all:?}");
    assert!(all.iter().enumerate().all(|(i, e)| e.0 == i as u64 + 1), "numbers without a gap");
    // Who lost the connection goes on where it broke.
    let rest = service.send("GET", &format!("{base}/events"), &[&format!("Last-Event-ID: {}", all[4].0)], b"");
    assert_eq!(events(&rest.body), all[5..]);

    let session = finished(&service, &id);
    let took = session["timing"]["device_s"].as_f64().unwrap();
    // Its 10 % are tested in the bench's own time; here a loaded machine takes part.
    let ratio = estimate["seconds"].as_f64().unwrap() / took;
    assert!((0.5..1.25).contains(&ratio), "{estimate} {took}");
    let frames = service.get(&format!("{base}/frames")).expect(200).json();
    assert_eq!(frames["items"].as_array().unwrap().len(), 6);
    let stored = service.get(&format!("{base}/frames/0000.png")).expect(200);
    assert_eq!(stored.body, fs::read(place.path(&format!("data/sessions/{id}/frames/0000.png"))).unwrap());
    assert_eq!(
        image::load_from_memory(&service.get(&format!("{base}/frames/0000.png?width=32")).expect(200).body)
            .unwrap()
            .width(),
        32
    );
    assert_eq!(
        image::load_from_memory(&service.get(&format!("{base}/live.png")).expect(200).body).unwrap().width(),
        64
    );

    let result = format!("/api/v1/reconstructions/{id}");
    assert_eq!(service.get(&result).expect(200).json()["report"]["model"], "sinusoid");
    let exr = service.get(&format!("{result}/maps/orientation.exr")).expect(200);
    assert_eq!(exr.body, fs::read(place.path(&format!("data/sessions/{id}/results/orientation.exr"))).unwrap());
    let npy = service.get(&format!("{result}/maps/sigma.npy")).expect(200).body;
    assert_eq!(npy.len() % 64, 64 * 48 * 4 % 64);
    assert_eq!(service.get(&format!("{result}/maps/dolp.csv")).expect(200).text().lines().count(), 64 * 48 + 1);
    let part = service.get(&format!("{result}/maps/orientation.png?x=10&y=10&w=16&h=8")).expect(200).body;
    let part = image::load_from_memory(&part).unwrap();
    assert_eq!((part.width(), part.height()), (16, 8));

    // The pixel's fit is the maps', and close to what was measured.
    let pixel = service.get(&format!("{result}/pixel?x=31&y=20")).expect(200).json();
    assert_eq!((pixel["points"].as_array().unwrap().len(), pixel["fit"].as_array().unwrap().len()), (6, 91));
    let (s1, s2) = (pixel["s1"].as_f64().unwrap(), pixel["s2"].as_f64().unwrap());
    let theta = 0.5 * s2.atan2(s1).to_degrees().rem_euclid(360.0);
    assert!((theta - pixel["orientation_deg"].as_f64().unwrap()).abs() < 0.01, "{theta} {pixel}");
    service.get(&format!("{result}/pixel?x=64&y=0")).expect(400);

    let found = service.get("/api/v1/sessions?text=tile&kind=polarization").expect(200).json();
    assert_eq!(found["items"][0]["id"], id.as_str());
    let deletion = service.get(&format!("{base}/deletion")).expect(200).json();
    service.send("DELETE", &format!("{base}?token=wrong"), &[], b"").expect(409);
    let token = deletion["token"].as_str().unwrap();
    service.send("DELETE", &format!("{base}?token={token}"), &[], b"").expect(204);
    service.get(&base).expect(404);
    assert_eq!(service.get("/api/v1/sessions").expect(200).json()["items"], json!([]));
    assert!(listing(&place.path("data/sessions")).is_empty());
}

#[test]
fn a_session_is_steered_and_outlives_the_service() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let id = begin(&service, &plan(12, 60.0));
    let base = format!("/api/v1/sessions/{id}");
    service.until(&base, |s| s["frames_committed"].as_u64() > Some(1));
    service.post("/api/v1/sessions", &plan(3, 5.0)).expect(409);
    service.post("/api/v1/devices/stage/home", &json!({})).expect(409);
    service.post(&format!("{base}/pause"), &json!({})).expect(202);
    let paused = service.until(&base, |s| s["state"] == "paused");
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(service.get(&base).json()["frames_committed"], paused["frames_committed"]);
    service.post(&format!("{base}/resume"), &json!({})).expect(202);
    service.until(&base, |s| s["state"] == "running");
    service.post(&format!("{base}/resume"), &json!({})).expect(409);
    service.post(&format!("{base}/stop"), &json!({})).expect(202);
    service.until(&base, |s| s["state"] == "idle" && s["stage"] == Value::Null);
    service.post(&format!("{base}/resume"), &json!({})).expect(202);
    service.until(&base, |s| s["state"] == "running" && s["frames_committed"].as_u64() > Some(5));
    service.kill();

    let service = Service::start(&place, &[]);
    let left = service.get(&base).expect(200).json();
    assert!(left["state"] == "idle" && left["frames_committed"].as_u64() < Some(12), "{left}");
    service.post(&format!("{base}/resume"), &json!({})).expect(202);
    finished(&service, &id);
    nacre(["check", &place.text(&format!("data/sessions/{id}"))]).expect(0);
}

#[test]
fn stop_stops_within_200_ms_and_devices_are_moved_by_hand() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let moved = service.post("/api/v1/devices/stage/move", &json!({ "analyser_deg": 40.0 })).expect(200).json();
    assert!((moved["stage"]["analyser_deg"].as_f64().unwrap() - 40.0).abs() < 0.1);
    let disc = json!({ "pattern": { "disc": { "center_mm": [0, 0], "diameter_mm": 200 } } });
    let shown = service.post("/api/v1/devices/display/show", &disc).expect(200).json();
    assert_eq!(shown["display"]["pattern"]["disc"]["diameter_mm"], 200.0);
    let bright = service.get("/api/v1/devices/camera/preview").expect(200).json()["mean"].as_f64().unwrap();
    let lit = service.post("/api/v1/devices/flash/switch", &json!({ "on": true, "seconds": 0.3 })).expect(200).json();
    assert_eq!(lit["flash"]["on"], true);
    service.until("/api/v1/devices", |d| d["flash"]["on"] == false);
    service.post("/api/v1/stop", &json!({})).expect(200);
    let dark = service.get("/api/v1/devices/camera/preview").expect(200).json()["mean"].as_f64().unwrap();
    assert!(bright > 2.0 * dark, "{bright} {dark}");
    assert_eq!(
        image::load_from_memory(&service.get("/api/v1/devices/camera/preview.png").expect(200).body).unwrap().height(),
        48
    );

    // A jog shows in the very next frame of the preview.
    service.post("/api/v1/devices/display/show", &disc).expect(200);
    let look = || service.get("/api/v1/devices/camera/preview.png").expect(200).body;
    let before = image::load_from_memory(&look()).unwrap().into_luma8();
    service.post("/api/v1/devices/stage/move", &json!({ "analyser_deg": 130.0 })).expect(200);
    let after = image::load_from_memory(&look()).unwrap().into_luma8();
    let change = before.pixels().zip(after.pixels()).map(|(a, b)| f64::from(a.0[0].abs_diff(b.0[0]))).sum::<f64>()
        / (64.0 * 48.0);
    assert!(change > 10.0, "{change}");

    let id = begin(&service, &plan(12, 400.0));
    let base = format!("/api/v1/sessions/{id}");
    service.until(&base, |s| s["frames_committed"].as_u64() > Some(0));
    let begun = Instant::now();
    service.post("/api/v1/stop", &json!({})).expect(200);
    let took = begun.elapsed();
    println!("STOP took {:.0} ms", 1000.0 * took.as_secs_f64());
    assert!(took < Duration::from_millis(200), "{took:?}");
    let after = service.until(&base, |s| s["state"] == "idle");
    assert!(after["error"].as_str().unwrap().contains("interrupted"), "{after}");
    assert_eq!(service.get("/api/v1/devices").json()["display"]["pattern"], "black");
}

/// STOP reaches what has not begun yet as well: a queued movement never runs, a session that was just asked for never
/// lights anything.
#[test]
fn stop_reaches_what_waits() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let away = json!({ "analyser_deg": 700.0 });
    let back = json!({ "analyser_deg": -300.0 });
    std::thread::scope(|scope| {
        let first = scope.spawn(|| service.post("/api/v1/devices/stage/move", &away));
        std::thread::sleep(Duration::from_millis(300));
        let second = scope.spawn(|| service.post("/api/v1/devices/stage/move", &back));
        std::thread::sleep(Duration::from_millis(300));
        service.post("/api/v1/stop", &json!({})).expect(200);
        for answer in [first.join().unwrap(), second.join().unwrap()] {
            let told = answer.expect(409).json();
            assert!(told["detail"].as_str().unwrap().to_lowercase().contains("stop"), "{told}");
        }
    });
    let stage = |service: &Service| service.get("/api/v1/devices").expect(200).json()["stage"]["analyser_deg"].clone();
    let angle = stage(&service).as_f64().unwrap();
    assert!(angle > 0.0, "the second never began: {angle}");
    service.post("/api/v1/devices/stage/home", &json!({})).expect(200);

    for pause_ms in 0..20 {
        let id = begin(&service, &plan(12, 60.0));
        std::thread::sleep(Duration::from_millis(pause_ms * 3));
        service.post("/api/v1/stop", &json!({})).expect(200);
        let begun = Instant::now();
        let base = format!("/api/v1/sessions/{id}");
        service.until(&base, |s| s["state"] == "idle" && s["stage"] == Value::Null);
        assert!(begun.elapsed() < Duration::from_secs(2), "after {pause_ms} ms: {:?}", begun.elapsed());
        let devices = service.get("/api/v1/devices").expect(200).json();
        assert!(devices["display"]["pattern"] == "black" && devices["flash"]["on"] == false, "{devices}");
    }
}

#[test]
fn light_by_hand_goes_off_when_an_interlock_opens() {
    let fault = "{ device = \"interlock\", kind = \"opens\", after = 40 }";
    let place = Place::with_bench("", &format!("{BENCH}\nfaults = [{fault}]"));
    let service = Service::start(&place, &[]);
    let disc = json!({ "pattern": { "disc": { "center_mm": [0, 0], "diameter_mm": 200 } } });
    let shown = service.post("/api/v1/devices/display/show", &disc).expect(200).json();
    assert_eq!(shown["interlocks"][0]["holds"], true);
    let after = service.until("/api/v1/devices", |d| d["interlocks"][0]["holds"] == false);
    let dark = service.until("/api/v1/devices", |d| d["display"]["pattern"] == "black");
    println!("{after} {dark}");
    let refused = service.post("/api/v1/devices/display/show", &disc).expect(409).json();
    assert!(refused["detail"].as_str().unwrap().contains("open interlock"), "{refused}");
}

/// A form with these parts: name, file name, bytes.
fn form(parts: &[(&str, &str, &[u8])]) -> Vec<u8> {
    let mut body = vec![];
    for (name, file, bytes) in parts {
        let head = format!("--edge\r\nContent-Disposition: form-data; name=\"{name}\"; filename=\"{file}\"\r\n\r\n");
        body.extend([head.as_bytes(), bytes, b"\r\n"].concat());
    }
    body.extend(b"--edge--\r\n");
    body
}

fn upload(service: &Service, parts: &[(&str, &str, &[u8])]) -> Answer {
    service.send("POST", "/api/v1/uploads", &["Content-Type: multipart/form-data; boundary=edge"], &form(parts))
}

fn photograph(level: u8) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(vec![]);
    let picture = image::GrayImage::from_fn(16, 12, |x, _| image::Luma([level + x as u8]));
    picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

#[test]
fn uploaded_photographs_become_maps() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let photographs: Vec<_> =
        [(0, 60), (45, 90), (90, 120), (135, 80)].map(|(a, l)| (format!("{a:03}.png"), photograph(l))).into();
    let parts: Vec<(&str, &str, &[u8])> = photographs.iter().map(|(n, b)| ("file", n.as_str(), b.as_slice())).collect();
    let uploaded = upload(&service, &parts).expect(201).json();
    let body = json!({ "upload": uploaded["id"], "method": "polarization" });
    let headers = ["Content-Type: application/json", "Idempotency-Key: once"];
    let send = || service.send("POST", "/api/v1/reconstructions", &headers, body.to_string().as_bytes()).expect(202);
    let id = send().json()["id"].as_str().unwrap().to_owned();
    assert_eq!(send().json()["id"], id.as_str(), "asked twice, made once");
    let base = format!("/api/v1/reconstructions/{id}");
    let stream = service.send("GET", &format!("{base}/events"), &[], b"").expect(200);
    assert_eq!(events(&stream.body).last().unwrap().2["state"], "done");
    let done = service.get(&base).expect(200).json();
    assert_eq!(done["report"]["width"], 16);
    assert!(service.get(&format!("{base}/log")).expect(200).text().contains("attempt"));
    service.post(&format!("{base}/cancel"), &json!({})).expect(409);
    service.get(&format!("{base}/pixel?x=3&y=4")).expect(200);
    assert_eq!(service.get("/api/v1/reconstructions").expect(200).json()["items"][0]["id"], id.as_str());

    let good = photograph(60);
    for (parts, words) in [
        (&[("file", "../../etc/passwd", good.as_slice())][..], &["passwd", "no name of a photograph"][..]),
        (&[("file", "a.sh", good.as_slice())], &["a.sh"]),
        (&[("file", "no angle.png", good.as_slice())], &["angle"]),
        (&[("file", "000.png", b"nonsense".as_slice()), ("file", "045.png", &good)], &["000.png"]),
        (&[("file", "000.png", good.as_slice()), ("file", "000.png", &good)], &["one name"]),
        (&[("other", "000.png", good.as_slice())], &["neither"]),
        (&[], &["no photograph"]),
    ] {
        let refused = upload(&service, parts).expect(400).json();
        let detail = refused["detail"].as_str().unwrap();
        words.iter().for_each(|w| assert!(detail.contains(w), "no {w} in {refused}"));
        assert!(!detail.contains("/data/"), "paths of the machine are told: {refused}");
    }
    let cut = &form(&parts)[..200];
    service.send("POST", "/api/v1/uploads", &["Content-Type: multipart/form-data; boundary=edge"], cut).expect(400);
    assert_eq!(listing(&place.path("data/uploads")).len(), 1, "what is refused leaves nothing");
}

#[test]
fn requests_from_elsewhere_and_into_elsewhere_are_refused() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let host = format!("Host: {}", service.address);
    for headers in [
        &["Host: evil.example"][..],
        &["Host: 127.0.0.1.evil.example:80"],
        &[&host, "Origin: https://evil.example"],
        &[&host, "Origin: null"],
        &[&host, "Sec-Fetch-Site: cross-site"],
    ] {
        for path in ["/api/v1/devices", "/", "/api/v1/stop"] {
            let refused = service.send("POST", path, headers, b"{}").expect(403);
            assert!(refused.head.contains("application/problem+json"), "{}", refused.head);
        }
    }
    service.send("GET", "/healthz", &[&host, "Origin: http://localhost:8465"], b"").expect(200);

    fs::write(place.path("data/secret.png"), "secret").unwrap();
    let id = begin(&service, &plan(3, 5.0));
    finished(&service, &id);
    for path in [
        "/api/v1/sessions/..%2f..%2fdata/files/secret.png",
        "/api/v1/sessions/../files/secret.png",
        "/api/v1/sessions/%2e%2e/frames/secret.png",
        &format!("/api/v1/sessions/{id}/files/..%2f..%2fsecret.png"),
        &format!("/api/v1/sessions/{id}/files/../../secret.png"),
        &format!("/api/v1/sessions/{id}/files/%2fetc%2fpasswd"),
        &format!("/api/v1/sessions/{id}/files//etc/passwd"),
        &format!("/api/v1/sessions/{id}/frames/..%2f..%2f..%2fsecret.png"),
        &format!("/api/v1/sessions/{id}/frames/..%2f..%2f..%2fsecret.png?width=10"),
        &format!("/api/v1/reconstructions/{id}/maps/..%2f..%2f..%2fsecret.png"),
        "/api/v1/reconstructions/..%2fsessions/maps/orientation.png",
        "/assets/..%2fCargo.toml",
        "/assets/../Cargo.toml",
    ] {
        let answer = service.get(path);
        assert_eq!(answer.status, 404, "{path}: {}", answer.text());
    }
    service.get(&format!("/api/v1/sessions/{id}/files/frames.json")).expect(200);
}

#[test]
fn large_slow_and_many_requests_are_bounded() {
    let place = Place::with_bench("", BENCH);
    fs::write(
        place.path("nacre.toml"),
        "limits = { body_kib = 64, upload_mib = 1, request_s = 2, requests = 16, subscribers = 50 }",
    )
    .unwrap();
    let service = Service::start(&place, &["--config", "nacre.toml"]);
    let large =
        service.send("POST", "/api/v1/plans/check", &["Content-Type: application/json"], &vec![b' '; 100 << 10]);
    assert_eq!(large.expect(413).json()["type"], "https://nacre.invalid/problems/too-large");
    let photograph = vec![7_u8; 2 << 20];
    upload(&service, &[("file", "000.png", &photograph)]).expect(413);
    assert!(listing(&place.path("data/uploads")).is_empty());

    let begun = Instant::now();
    let slow = format!(
        "POST /api/v1/plans/check HTTP/1.1\r\nHost: {}\r\nContent-Type: application/json\r\nContent-Length: 100\r\n\r\n{{",
        service.address
    );
    let answer = String::from_utf8_lossy(&service.raw(slow.as_bytes(), Duration::from_secs(3))).into_owned();
    assert!(answer.contains("too long") && begun.elapsed() < Duration::from_secs(5), "{answer}");

    // Half-sent requests take the places of others, but not that of STOP.
    let stuck: Vec<_> = (0..20)
        .map(|_| {
            let mut stream = std::net::TcpStream::connect(service.address).unwrap();
            std::io::Write::write_all(&mut stream, slow.as_bytes()).unwrap();
            stream
        })
        .collect();
    std::thread::sleep(Duration::from_millis(200));
    assert_eq!(service.get("/healthz").expect(429).json()["type"], "https://nacre.invalid/problems/too-many");
    service.post("/api/v1/stop", &json!({})).expect(200);
    drop(stuck);
    service.until("/api/v1/devices", |_| true);
}

#[test]
fn a_thousand_event_subscribers_are_bounded_in_memory() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    // Everything that a session needs is there before memory is measured.
    let first = begin(&service, &plan(3, 5.0));
    finished(&service, &first);
    let id = begin(&service, &plan(60, 100.0));
    service.until(&format!("/api/v1/sessions/{id}"), |s| s["state"] == "running");
    let before = service.memory();
    let request = format!("GET /api/v1/sessions/{id}/events HTTP/1.1\r\nHost: {}\r\n\r\n", service.address);
    // Nobody reads, so that what the service would store for them shows.
    let streams: Vec<_> = (0..1000)
        .map(|_| {
            let mut stream = std::net::TcpStream::connect(service.address).unwrap();
            std::io::Write::write_all(&mut stream, request.as_bytes()).unwrap();
            stream
        })
        .collect();
    finished(&service, &id);
    let grown = service.memory().saturating_sub(before);
    let mut refused = 0;
    for mut stream in streams {
        stream.set_read_timeout(Some(Duration::from_secs(2))).unwrap();
        let mut head = [0; 12];
        std::io::Read::read_exact(&mut stream, &mut head).unwrap();
        refused += u32::from(&head[9..] == b"429");
    }
    println!("1000 subscribers: {refused} refused, {grown} KiB more memory");
    assert_eq!(refused, 1000 - 256);
    assert!(grown < 64 * 1024, "{grown} KiB");
    let metrics = service.get("/metrics").expect(200).text();
    assert!(metrics.contains("nacre_requests_total{status=\"429\"} 744"), "{metrics}");
}

#[test]
fn other_addresses_need_a_token_with_a_role() {
    let place = Place::with_bench("", BENCH);
    let token = |name: &str, role: &str| {
        let run = nacre(["token", name, "--role", role]).expect(0);
        let secret = run.stderr().trim().rsplit(' ').next().unwrap().to_owned();
        assert!(!run.stdout().contains(&secret), "only the hash is kept");
        (run.stdout(), secret)
    };
    let ((viewer, view), (operator, operate)) = (token("eye", "view"), token("hand", "operate"));
    fs::write(place.path("nacre.toml"), format!("{viewer}\n{operator}")).unwrap();
    let service = Service::start(&place, &["--config", "nacre.toml"]);
    let send = |method: &str, path: &str, secret: &str| {
        let bearer = format!("Authorization: Bearer {secret}");
        service.send(method, path, &[&bearer, "Content-Type: application/json"], b"{}")
    };
    service.get("/api/v1/devices").expect(401);
    let wrong = send("GET", "/api/v1/devices", "nonsense").expect(401);
    assert!(!wrong.text().contains("nonsense"), "{}", wrong.text());
    send("GET", "/api/v1/devices", &view).expect(200);
    send("POST", "/api/v1/devices/stage/home", &view).expect(403);
    send("POST", "/api/v1/stop", &view).expect(200);
    send("POST", "/api/v1/devices/stage/home", &operate).expect(200);
    send("DELETE", "/api/v1/sessions/01ARZ3NDEKTSV4RRFFQ69G5FAV?token=x", &operate).expect(403);
    service.get("/").expect(200);
    service.get("/healthz").expect(200);
}

#[test]
fn wrong_configurations_are_refused_and_init_writes_a_good_one() {
    let place = Place::with_bench("", BENCH);
    fs::write(place.path("bad.toml"), "lisen = \"x\"").unwrap();
    let run = nacre(["serve", "--sim", "--config", &place.text("bad.toml")]).expect(2);
    assert!(run.stderr().contains("did you mean listen"), "{}", run.stderr());
    let run = nacre(["serve", "--sim", "--listen", "0.0.0.0:0", "--data", &place.text("d")]).expect(2);
    assert!(run.stderr().contains("no token"), "{}", run.stderr());
    assert!(nacre(["serve"]).expect(2).stderr().contains("--sim"));
    nacre(["init", "--sim", "--out", &place.text("nacre.toml")]).expect(0);
    assert!(nacre(["init", "--sim", "--out", &place.text("nacre.toml")]).expect(2).stderr().contains("--force"));
    assert!(place.path("nacre.trial.png").exists());
    let service = Service::start(&place, &["--config", "nacre.toml"]);
    service.get("/readyz").expect(200);
}

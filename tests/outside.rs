//! External interfaces of the service: uploads, requests from other hosts, large, slow and numerous requests, tokens,
//! configurations.

#![allow(clippy::unwrap_used)]

use nacre_processing::image::Palette;
use nacre_tests::http::{Service, begin, events, finished, form, plan};
use nacre_tests::{BENCH, NEVER, Place, listing, nacre};
use serde_json::json;
use std::fs;
use std::io::Read;
use std::time::{Duration, Instant};

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
    let uploaded = service.upload(&parts).expect(201).json();
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
    // No illumination was stated, so plain polarimetry is used.
    assert_eq!(done["report"]["model"], "plain");
    let pixel = service.get(&format!("{base}/pixel?x=3&y=4")).expect(200).json();
    assert!(pixel["aolp_deg"].is_f64() && pixel["orientation_deg"].is_null() && pixel["masked"] == false, "{pixel}");
    for map in ["aolp.png", "sigma.npy", "mask.csv", "dolp.exr"] {
        service.get(&format!("{base}/maps/{map}")).expect(200);
    }
    service.get(&format!("{base}/maps/orientation.png")).expect(404);
    let gratings = json!({ "upload": uploaded["id"], "model": "auto" });
    let other = service.post("/api/v1/reconstructions", &gratings).expect(202).json();
    let other = format!("/api/v1/reconstructions/{}", other["id"].as_str().unwrap());
    service.until(&other, |job| job["state"] == "done");
    service.get(&format!("{other}/maps/orientation.png")).expect(200);
    for wrong in [json!({ "offset_deg": 3 }), json!({ "model": "none" }), json!({ "smoothed_exr": true })] {
        let mut asked = json!({ "upload": uploaded["id"] });
        asked.as_object_mut().unwrap().extend(wrong.as_object().unwrap().clone());
        service.post("/api/v1/reconstructions", &asked).expect(400);
    }
    assert_eq!(service.get("/api/v1/reconstructions").expect(200).json()["items"][1]["id"], id.as_str());
    // Pictures use the palette stated in the report, as requested.
    for (asked, palette) in [(json!({}), "cyclic"), (json!({ "palette": "hsv" }), "hsv")] {
        let mut body = json!({ "upload": uploaded["id"] });
        body.as_object_mut().unwrap().extend(asked.as_object().unwrap().clone());
        let job = service.post("/api/v1/reconstructions", &body).expect(202).json();
        let job = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
        service.until(&job, |job| job["state"] == "done");
        assert_eq!(service.get(&job).expect(200).json()["report"]["palette"], palette);
        let picture = service.get(&format!("{job}/maps/aolp.png")).expect(200);
        assert_eq!(picture.header("x-nacre-palette"), Some(palette.to_owned()));
        let drawn = image::load_from_memory(&picture.body).unwrap().into_rgb8();
        let pixel = service.get(&format!("{job}/pixel?x=3&y=4")).expect(200).json();
        let theta = pixel["aolp_deg"].as_f64().unwrap().to_radians() as f32;
        let wanted = palette.parse::<Palette>().unwrap().color(theta);
        assert!(
            drawn.get_pixel(3, 4).0.iter().zip(wanted).all(|(a, b)| a.abs_diff(b) <= 2),
            "{palette}: not {wanted:?}"
        );
    }
    service.post("/api/v1/reconstructions", &json!({ "upload": uploaded["id"], "palette": "jet" })).expect(400);

    let good = photograph(60);
    for (parts, words) in [
        (&[("file", "../../etc/passwd", good.as_slice())][..], &["passwd", "not a file name of a photograph"][..]),
        (&[("file", "a.sh", good.as_slice())], &["a.sh"]),
        (&[("file", "no angle.png", good.as_slice())], &["angle"]),
        (&[("file", "000.png", b"nonsense".as_slice()), ("file", "045.png", &good)], &["000.png"]),
        (&[("file", "000.png", good.as_slice()), ("file", "000.png", &good)], &["same name"]),
        (&[("other", "000.png", good.as_slice())], &["unknown part"]),
        (&[], &["no photograph"]),
    ] {
        let refused = service.upload(parts).expect(400).json();
        let detail = refused["detail"].as_str().unwrap();
        words.iter().for_each(|w| assert!(detail.contains(w), "no {w} in {refused}"));
        assert!(!detail.contains("/data/"), "paths of the machine are told: {refused}");
    }
    // Signs and decimals in names are parsed; if an angle is ambiguous, the remedy refers to the request.
    let named = |names: &[&str]| {
        let parts: Vec<(&str, &str, &[u8])> = names.iter().map(|n| ("file", *n, good.as_slice())).collect();
        service.upload(&parts)
    };
    let signed = named(&["I_-22,5.png", "I_0.png", "I_45.png"]).expect(201).json();
    let kept = place.path("data/uploads").join(signed["id"].as_str().unwrap()).join("frames.json");
    let set: serde_json::Value = serde_json::from_slice(&fs::read(kept).unwrap()).unwrap();
    assert_eq!(set["frames"][0]["analyser_deg"], -22.5);
    let refused = named(&["I_-0.png", "I_-45.png", "I_-90.png"]).expect(400).text();
    assert!(refused.contains("45° or -45°") && refused.contains("frames.json"), "{refused}");
    assert!(!refused.contains("--") && !refused.contains(".upload"), "{refused}");
    let cut = &form(&parts)[..200];
    service.send("POST", "/api/v1/uploads", &["Content-Type: multipart/form-data; boundary=edge"], cut).expect(400);
    assert_eq!(listing(&place.path("data/uploads")).len(), 2, "what is refused leaves nothing");
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
fn the_page_loads_compressed_and_is_kept() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let page = service.get("/").expect(200).text();
    let scripts: Vec<&str> = page.split("src=\"").skip(1).filter_map(|rest| rest.split('"').next()).collect();
    assert!(scripts.len() > 1, "{page}");
    for script in scripts {
        let plain = service.get(script).expect(200);
        assert!(plain.head.contains("immutable"), "{}", plain.head);
        let packed = service.send("GET", script, &["Accept-Encoding: gzip, br"], b"").expect(200);
        let mut text = String::new();
        flate2::read::GzDecoder::new(&packed.body[..]).read_to_string(&mut text).unwrap();
        assert!(text == plain.text() && packed.body.len() < text.len(), "{script}");
    }
    assert!(service.get("/assets/app.js").expect(200).head.contains("no-cache"));
    service.get("/assets/0123456789abcdef/app.js").expect(404);
    let document = service.send("GET", "/api/v1/openapi.json", &["Accept-Encoding: gzip"], b"").expect(200);
    assert!(document.head.contains("gzip") && document.body.starts_with(&[0x1f, 0x8b]), "{}", document.head);
    // Pictures are already compressed.
    let picture =
        service.send("GET", "/api/v1/devices/camera/preview.png", &["Accept-Encoding: gzip"], b"").expect(200);
    assert!(!picture.head.contains("content-encoding"), "{}", picture.head);
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
    service.upload(&[("file", "000.png", &photograph)]).expect(413);
    assert!(listing(&place.path("data/uploads")).is_empty());

    let slow = format!(
        "POST /api/v1/plans/check HTTP/1.1\r\nHost: {}\r\nContent-Type: application/json\r\nContent-Length: 100\r\n\r\n{{",
        service.address
    );
    let answer = String::from_utf8_lossy(&service.raw(slow.as_bytes(), NEVER)).into_owned();
    assert!(answer.contains("too long"), "{answer}");

    // Incomplete requests occupy no slot. Requests in progress do, but not that of STOP.
    let stuck: Vec<_> = (0..20).map(|_| service.connect(slow.as_bytes())).collect();
    service.get("/healthz").expect(200);
    drop(stuck);
    let turn = json!({ "analyser_deg": 700.0 }).to_string();
    let turn = format!(
        "POST /api/v1/devices/stage/move HTTP/1.1\r\nHost: {}\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\r\n{turn}",
        service.address,
        turn.len()
    );
    let busy: Vec<_> = (0..20).map(|_| service.connect(turn.as_bytes())).collect();
    let begun = Instant::now();
    let refused = loop {
        let answer = service.get("/healthz");
        if answer.status == 429 {
            break answer.json();
        }
        assert!(begun.elapsed() < NEVER, "never refused");
    };
    assert_eq!(refused["type"], "https://nacre.invalid/problems/too-many");
    service.post("/api/v1/stop", &json!({})).expect(200);
    drop(busy);
    service.until("/api/v1/devices", |_| true);
}

#[test]
fn a_thousand_event_subscribers_are_bounded_in_memory() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    // Everything that a session needs is allocated before memory is measured.
    let first = begin(&service, &plan(3, 5.0));
    finished(&service, &first);
    let id = begin(&service, &plan(60, 100.0));
    service.until(&format!("/api/v1/sessions/{id}"), |s| s["state"] == "running");
    let before = service.memory();
    let request = format!("GET /api/v1/sessions/{id}/events HTTP/1.1\r\nHost: {}\r\n\r\n", service.address);
    // No client reads, so that any buffering by the service becomes visible.
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
        Read::read_exact(&mut stream, &mut head).unwrap();
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

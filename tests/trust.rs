//! Access control of the service: requests from other origins, roles of tokens, keys of requests, and information
//! disclosed by responses.

#![allow(clippy::unwrap_used)]

use nacre_processing::operations::OPERATIONS;
use nacre_tests::http::{Answer, Service, begin, finished, plan};
use nacre_tests::{BENCH, Place, nacre};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fs;

#[test]
fn pages_of_other_origins_change_nothing() {
    let place = Place::with_bench("", BENCH);
    fs::write(place.path("nacre.toml"), "hosts = [\"bench.lab\", \"https://proxy.lab:8443\"]").unwrap();
    let service = Service::start(&place, &["--config", "nacre.toml"]);
    let port = service.address.port();
    let body = serde_json::to_vec(&plan(3, 5.0)).unwrap();
    let send = |method: &str, path: &str, headers: &[String]| {
        let mut lines: Vec<&str> = headers.iter().map(String::as_str).collect();
        lines.push("Content-Type: application/json");
        service.send(method, path, &lines, &body)
    };
    let elsewhere = [
        format!("Origin: http://127.0.0.1:{}", port ^ 1),
        "Origin: http://127.0.0.1".to_owned(),
        format!("Origin: https://127.0.0.1:{port}"),
        format!("Origin: http://localhost:{port}"),
        "Origin: null".to_owned(),
        "Origin: http://bench.lab:3000".to_owned(),
        "Sec-Fetch-Site: same-site".to_owned(),
        "Sec-Fetch-Site: cross-site".to_owned(),
    ];
    for header in elsewhere {
        for (method, path) in [
            ("POST", "/api/v1/stop"),
            ("POST", "/api/v1/sessions"),
            ("POST", "/api/v1/sessions/01ARZ3NDEKTSV4RRFFQ69G5FAV/abort"),
            ("POST", "/api/v1/uploads"),
            ("DELETE", "/api/v1/uploads/01ARZ3NDEKTSV4RRFFQ69G5FAV"),
            ("GET", "/api/v1/display/link?page=evil"),
        ] {
            let refused = send(method, path, std::slice::from_ref(&header));
            assert_eq!(refused.status, 403, "{method} {path} {header}: {}", refused.text());
        }
    }
    assert_eq!(service.get("/api/v1/sessions").expect(200).json()["items"], json!([]));
    // Pages of the service itself, also through a forwarded port and behind a proxy.
    for own in [
        [format!("Host: 127.0.0.1:{port}"), format!("Origin: http://127.0.0.1:{port}")],
        ["Host: localhost:9000".to_owned(), "Origin: http://localhost:9000".to_owned()],
        ["Host: bench.lab".to_owned(), "Origin: https://bench.lab".to_owned()],
        [format!("Host: 127.0.0.1:{port}"), "Origin: https://bench.lab".to_owned()],
        [format!("Host: 127.0.0.1:{port}"), "Origin: https://proxy.lab:8443".to_owned()],
    ] {
        let headers = [&own[..], &["Sec-Fetch-Site: same-origin".to_owned()]].concat();
        send("POST", "/api/v1/stop", &headers).expect(200);
    }
}

/// All requests with the minimum role, except the operations' own.
const ROLES: &[(&str, &str, &str)] = &[
    ("view", "GET", "/api/v1/about"),
    ("view", "GET", "/api/v1/calibrations"),
    ("operate", "POST", "/api/v1/calibrations"),
    ("view", "GET", "/api/v1/calibrations/{id}"),
    ("administer", "DELETE", "/api/v1/calibrations/{id}"),
    ("view", "GET", "/api/v1/calibrations/{id}/deletion"),
    ("view", "GET", "/api/v1/calibrations/{id}/files"),
    ("view", "GET", "/api/v1/calibrations/{id}/files/{file}"),
    ("view", "GET", "/api/v1/charts"),
    ("administer", "DELETE", "/api/v1/charts/{folder}"),
    ("view", "GET", "/api/v1/charts/{folder}/deletion"),
    ("view", "GET", "/api/v1/charts/{folder}/{chart}/{file}"),
    ("view", "GET", "/api/v1/devices"),
    ("view", "GET", "/api/v1/devices/camera/preview"),
    ("view", "GET", "/api/v1/devices/camera/preview.png"),
    ("operate", "POST", "/api/v1/devices/camera/meter"),
    ("operate", "POST", "/api/v1/devices/camera/set"),
    ("operate", "POST", "/api/v1/devices/display/measure"),
    ("view", "GET", "/api/v1/devices/display/measurement"),
    ("operate", "POST", "/api/v1/devices/display/show"),
    ("operate", "POST", "/api/v1/devices/flash/switch"),
    ("operate", "POST", "/api/v1/devices/stage/home"),
    ("operate", "POST", "/api/v1/devices/stage/move"),
    ("view", "GET", "/api/v1/display"),
    ("operate", "POST", "/api/v1/display/acknowledge"),
    ("operate", "POST", "/api/v1/display/beat"),
    // It binds the panel's page.
    ("operate", "GET", "/api/v1/display/link"),
    ("operate", "POST", "/api/v1/display/pattern"),
    ("view", "GET", "/api/v1/operations"),
    ("operate", "POST", "/api/v1/plans/check"),
    ("operate", "POST", "/api/v1/plans/estimate"),
    ("view", "GET", "/api/v1/plans/schema"),
    ("view", "GET", "/api/v1/queue"),
    ("operate", "POST", "/api/v1/queue/{id}/first"),
    ("view", "GET", "/api/v1/reconstructions"),
    ("operate", "POST", "/api/v1/reconstructions"),
    ("operate", "POST", "/api/v1/reconstructions/estimate"),
    ("administer", "DELETE", "/api/v1/reconstructions/{id}"),
    ("view", "GET", "/api/v1/reconstructions/{id}"),
    ("operate", "POST", "/api/v1/reconstructions/{id}/cancel"),
    ("view", "GET", "/api/v1/reconstructions/{id}/deletion"),
    ("view", "GET", "/api/v1/reconstructions/{id}/events"),
    ("view", "GET", "/api/v1/reconstructions/{id}/files"),
    ("view", "GET", "/api/v1/reconstructions/{id}/files/{file}"),
    ("view", "GET", "/api/v1/reconstructions/{id}/log"),
    ("view", "GET", "/api/v1/reconstructions/{id}/maps"),
    ("view", "GET", "/api/v1/reconstructions/{id}/maps/{file}"),
    ("view", "GET", "/api/v1/reconstructions/{id}/picture.png"),
    ("view", "GET", "/api/v1/reconstructions/{id}/pixel"),
    ("view", "GET", "/api/v1/reconstructions/{id}/profile/{map}"),
    ("operate", "POST", "/api/v1/reconstructions/{id}/retry"),
    ("view", "GET", "/api/v1/reconstructions/{id}/statistics/{map}"),
    ("view", "GET", "/api/v1/reconstructions/{id}/tiles/{map}/{level}/{column}/{row}"),
    ("view", "GET", "/api/v1/reconstructions/{id}/view"),
    ("view", "GET", "/api/v1/reconstructions/{id}/view.html"),
    ("view", "GET", "/api/v1/samples"),
    ("view", "GET", "/api/v1/samples/{kind}/photographs.png"),
    ("view", "GET", "/api/v1/samples/{kind}/picture.png"),
    ("operate", "POST", "/api/v1/samples/{kind}/sessions"),
    ("view", "GET", "/api/v1/sessions"),
    ("operate", "POST", "/api/v1/sessions"),
    ("administer", "DELETE", "/api/v1/sessions/{id}"),
    ("view", "GET", "/api/v1/sessions/{id}"),
    ("operate", "POST", "/api/v1/sessions/{id}/abort"),
    ("view", "GET", "/api/v1/sessions/{id}/deletion"),
    ("view", "GET", "/api/v1/sessions/{id}/events"),
    ("view", "GET", "/api/v1/sessions/{id}/files"),
    ("view", "GET", "/api/v1/sessions/{id}/files/{path}"),
    ("view", "GET", "/api/v1/sessions/{id}/frames"),
    ("view", "GET", "/api/v1/sessions/{id}/frames/{name}"),
    ("view", "GET", "/api/v1/sessions/{id}/live.png"),
    ("operate", "POST", "/api/v1/sessions/{id}/pause"),
    ("operate", "POST", "/api/v1/sessions/{id}/resume"),
    ("operate", "POST", "/api/v1/sessions/{id}/stop"),
    ("administer", "GET", "/api/v1/settings"),
    ("administer", "PUT", "/api/v1/settings"),
    ("administer", "POST", "/api/v1/settings/check"),
    ("administer", "GET", "/api/v1/settings/schema"),
    // Anyone who sees danger may stop the bench.
    ("view", "POST", "/api/v1/stop"),
    ("view", "GET", "/api/v1/uploads"),
    ("operate", "POST", "/api/v1/uploads"),
    ("operate", "POST", "/api/v1/uploads/angles"),
    ("administer", "DELETE", "/api/v1/uploads/{id}"),
    ("administer", "PATCH", "/api/v1/sessions/{id}"),
    ("administer", "PATCH", "/api/v1/reconstructions/{id}"),
    ("administer", "PATCH", "/api/v1/uploads/{id}"),
    ("view", "GET", "/api/v1/uploads/{id}/deletion"),
    ("view", "GET", "/api/v1/uploads/{id}/scene"),
    ("operate", "POST", "/api/v1/uploads/{id}/scene"),
    ("operate", "POST", "/api/v1/uploads/{id}/scene/draft"),
    ("view", "GET", "/api/v1/scenes/schema"),
    ("operate", "POST", "/api/v1/reconstructions/{id}/finish"),
    ("view", "GET", "/api/v1/trash"),
    ("administer", "DELETE", "/api/v1/trash"),
    ("administer", "DELETE", "/api/v1/trash/{id}"),
    ("administer", "POST", "/api/v1/trash/{id}/restore"),
];

#[test]
fn each_operation_needs_its_role() {
    let place = Place::with_bench("", BENCH);
    let names = ["view", "operate", "administer"];
    let mut config = String::new();
    let bearers = names.map(|role| {
        let run = nacre(["token", role, "--role", role]).expect(0);
        config += &run.stdout();
        format!("Authorization: Bearer {}", run.stderr().trim().rsplit(' ').next().unwrap())
    });
    fs::write(place.path("nacre.toml"), config).unwrap();
    let service = Service::start(&place, &["--config", "nacre.toml"]);
    let send = |method: &str, path: &str, headers: &[&str]| {
        service.send(method, path, &[headers, &["Content-Type: application/json"]].concat(), b"{}")
    };
    let document = send("GET", "/api/v1/openapi.json", &[&bearers[0]]).expect(200).json();
    let paths = document["paths"].as_object().unwrap();
    let operations: BTreeSet<(String, String)> = paths
        .iter()
        .flat_map(|(path, item)| item.as_object().unwrap().keys().map(|m| (m.to_uppercase(), path.clone())))
        .collect();
    // Whoever may operate the bench may run every operation.
    let runs: Vec<String> = OPERATIONS.iter().map(|o| format!("/api/v1/operations/{}", o.name())).collect();
    let roles: Vec<_> =
        ROLES.iter().copied().chain(runs.iter().map(|path| ("operate", "POST", path.as_str()))).collect();
    let listed = roles.iter().map(|(_, method, path)| ((*method).to_owned(), (*path).to_owned())).collect();
    assert_eq!(operations, listed, "the table of roles is not that of the operations");
    for (role, method, path) in &roles {
        let least = names.iter().position(|name| name == role).unwrap();
        let path = path.replace("{id}", "01ARZ3NDEKTSV4RRFFQ69G5FAV").replace(['{', '}'], "");
        let refused = send(method, &path, &[]);
        assert_eq!(refused.status, 401, "{method} {path} without a token: {}", refused.text());
        for (rank, bearer) in bearers.iter().enumerate() {
            let answer = send(method, &path, &[bearer]);
            assert_eq!(answer.status == 403, rank < least, "{} calls {method} {path}: {}", names[rank], answer.text());
        }
        if *method == "GET" {
            let answer = send("HEAD", &path, &[&bearers[0]]);
            assert_eq!(answer.status == 403, least > 0, "view calls HEAD {path}");
        }
    }
}

/// Sends `times` concurrent requests with a key.
fn at_once(service: &Service, path: &str, key: &str, body: &Value, times: usize) -> Vec<Answer> {
    let key = format!("Idempotency-Key: {key}");
    let headers = ["Content-Type: application/json", key.as_str()];
    let body = body.to_string();
    std::thread::scope(|scope| {
        let all: Vec<_> =
            (0..times).map(|_| scope.spawn(|| service.send("POST", path, &headers, body.as_bytes()))).collect();
        all.into_iter().map(|one| one.join().unwrap()).collect()
    })
}

fn ids(answers: Vec<Answer>) -> BTreeSet<String> {
    answers.into_iter().map(|a| a.expect(202).json()["id"].as_str().unwrap().to_owned()).collect()
}

#[test]
fn a_key_makes_one_thing() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let sessions = ids(at_once(&service, "/api/v1/sessions", "one", &plan(3, 5.0), 20));
    assert_eq!(sessions.len(), 1);
    let session = sessions.first().unwrap().clone();
    finished(&service, &session);
    let body = json!({ "session": session, "offset_deg": 0.0 });
    let jobs = ids(at_once(&service, "/api/v1/reconstructions", "one", &body, 20));
    assert_eq!(jobs.len(), 1);
    let count = |service: &Service| {
        let list = |path: &str| service.get(path).expect(200).json()["items"].as_array().unwrap().len();
        (list("/api/v1/sessions"), list("/api/v1/reconstructions"))
    };
    assert_eq!(count(&service), (1, 1));
    let once = |service: &Service, path: &str, body: &Value| at_once(service, path, "one", body, 1).remove(0);
    for (path, other) in [
        ("/api/v1/reconstructions", json!({ "session": session, "offset_deg": 1.0 })),
        ("/api/v1/sessions", plan(4, 5.0)),
    ] {
        let refused = once(&service, path, &other).expect(422).json();
        assert_eq!(refused["type"], "https://nacre.invalid/problems/reused-key");
        assert!(refused["remedy"].as_str().unwrap().contains("new key"), "{refused}");
    }
    // The same content in another spelling, and after a restart.
    let spaced = format!("{{ \"offset_deg\": 0.0,\n \"session\": \"{session}\" }}");
    let headers = ["Content-Type: application/json", "Idempotency-Key: one"];
    let same = service.send("POST", "/api/v1/reconstructions", &headers, spaced.as_bytes()).expect(202).json();
    assert_eq!(same["id"], jobs.first().unwrap().as_str());
    service.kill();
    let service = Service::start(&place, &[]);
    assert_eq!(once(&service, "/api/v1/reconstructions", &body).expect(202).json()["id"], same["id"]);
    assert_eq!(once(&service, "/api/v1/sessions", &plan(3, 5.0)).expect(202).json()["id"], session.as_str());
    once(&service, "/api/v1/sessions", &plan(4, 5.0)).expect(422);
    assert_eq!(count(&service), (1, 1));
    // A failed request does not consume its key, and failing requests create nothing.
    let wrong = json!({ "session": session, "model": "none" });
    at_once(&service, "/api/v1/reconstructions", "two", &wrong, 5).into_iter().for_each(|a| _ = a.expect(400));
    assert_eq!(ids(at_once(&service, "/api/v1/reconstructions", "two", &body, 5)).len(), 1);
    for key in ["", &"k".repeat(201)] {
        let refused = at_once(&service, "/api/v1/sessions", key, &plan(3, 5.0), 1).remove(0);
        assert!(refused.expect(400).text().contains("1 to 200 characters"));
    }
}

#[test]
fn texts_have_limits_that_are_named() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    for (key, longest) in [("name", 200), ("sample", 200), ("operator", 200), ("notes", 10_000)] {
        let mut body = plan(3, 5.0);
        body["plan"][key] = "é".repeat(longest).into();
        service.post("/api/v1/plans/check", &body).expect(200);
        body["plan"][key] = "é".repeat(longest + 1).into();
        for path in ["/api/v1/plans/check", "/api/v1/sessions"] {
            let refused = service.post(path, &body).expect(400).text();
            let (found, most) = (format!("{key} has {} characters", longest + 1), format!("at most {longest}"));
            assert!(refused.contains(&found) && refused.contains(&most), "{refused}");
        }
        let plan = body["plan"].to_string();
        fs::write(place.path("plan.json"), plan).unwrap();
        let args = ["capture", &place.text("plan.json"), "--sim", "--out", &place.text("s")];
        assert!(nacre(args).expect(2).stderr().contains(&format!("{key} has")));
    }
    let long = format!("/api/v1/sessions?text={}", "x".repeat(1001));
    assert!(service.get(&long).expect(400).text().contains("1000 characters"));
    let names = json!({ "names": ["x".repeat(201)] });
    assert!(service.post("/api/v1/uploads/angles", &names).expect(400).text().contains("200 bytes"));
}

#[test]
fn answers_do_not_say_where_files_are() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let data = place.path("data");
    let picture = {
        let mut bytes = std::io::Cursor::new(vec![]);
        let drawn = image::GrayImage::from_fn(64, 64, |x, y| image::Luma([(x * y % 251) as u8]));
        drawn.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
        bytes.into_inner()
    };
    let parts: [(&str, &str, &[u8]); 2] = [("kind", "", b"surface"), ("file", "a.png", &picture)];
    let upload = service.upload(&parts).expect(201).json()["id"].clone();
    let folder = data.join("uploads").join(upload.as_str().unwrap());
    assert!(folder.is_dir());
    let options = json!({ "pixel_um": 0.1, "range_um": 0.2, "size": 16 });
    let body = json!({ "upload": upload, "method": "brdf", "options": options });
    let job = service.post("/api/v1/reconstructions", &body).expect(202).json();
    let base = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
    service.until(&base, |job| job["state"] == "done");
    fs::write(folder.join("a.png"), "nonsense").unwrap();
    let bad = service.post("/api/v1/reconstructions", &body).expect(202).json();
    let bad = format!("/api/v1/reconstructions/{}", bad["id"].as_str().unwrap());
    let failed = service.until(&bad, |job| job["state"] == "failed")["error"].to_string();
    assert!(failed.contains("a.png"), "{failed}");
    let id = begin(&service, &plan(3, 5.0));
    finished(&service, &id);
    let session = format!("/api/v1/sessions/{id}");
    fs::write(data.join("sessions").join(&id).join("journal"), "nonsense\n\n\n").unwrap();
    let damaged = service.get(&session).text();
    assert!(damaged.contains("journal"), "{damaged}");
    for path in [&base, &format!("{base}/files/report.json"), &bad, &format!("{bad}/log"), &session] {
        let text = service.get(path).text();
        assert!(!text.is_empty() && !text.contains(&place.text("")), "{path}: {text}");
    }
}

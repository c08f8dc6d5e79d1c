//! The service over HTTP: sessions, events, reconstructions.

#![allow(clippy::unwrap_used)]

use nacre_tests::http::{Service, begin, events, finished, plan};
use nacre_tests::{BENCH, Place, listing, nacre};
use serde_json::{Value, json};
use std::fs;
use std::time::{Duration, Instant};

/// At short distance and from the side, oblique incidence is significant; its correction is optional, and reported.
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
        let left = report(asked)["oblique"].clone();
        assert!(
            left["asked"] == false && left["corrected"] == false && left["left_deg"].as_f64().unwrap() > 0.0,
            "{left}"
        );
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
    // A client that lost the connection continues after its last event.
    let rest = service.send("GET", &format!("{base}/events"), &[&format!("Last-Event-ID: {}", all[4].0)], b"");
    assert_eq!(events(&rest.body), all[5..]);

    let session = finished(&service, &id);
    let took = session["timing"]["device_s"].as_f64().unwrap();
    // The 10 % bound is tested with the bench's own time; here, machine load contributes.
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
    let orientations = service.get(&format!("{result}/maps/orientation.csv")).expect(200).text();
    assert!(orientations.starts_with("x_px,y_px,orientation_rad\n"), "{}", orientations.lines().next().unwrap());
    let part = service.get(&format!("{result}/maps/orientation.png?x=10&y=10&w=16&h=8")).expect(200).body;
    let part = image::load_from_memory(&part).unwrap();
    assert_eq!((part.width(), part.height()), (16, 8));

    // The pixel's fit agrees with the maps and with the measurement.
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

    // A change of the pattern is visible in the very next frame of the preview.
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
    let after = service.until(&base, |s| s["state"] == "idle");
    assert!(after["error"].as_str().unwrap().contains("interrupted"), "{after}");
    assert_eq!(service.get("/api/v1/devices").json()["display"]["pattern"], "black");
}

/// STOP also applies to pending work: a queued movement never runs, and a session just requested never emits light.
#[test]
fn stop_reaches_what_waits() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let away = json!({ "analyser_deg": 700.0 });
    let back = json!({ "analyser_deg": -300.0 });
    std::thread::scope(|scope| {
        let first = scope.spawn(|| service.post("/api/v1/devices/stage/move", &away));
        // The first movement takes four seconds.
        std::thread::sleep(Duration::from_secs(1));
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
    assert!(angle < 690.0, "the first was cut short: {angle}");
    service.post("/api/v1/devices/stage/home", &json!({})).expect(200);

    for pause_ms in 0..20 {
        let id = begin(&service, &plan(12, 60.0));
        std::thread::sleep(Duration::from_millis(pause_ms * 3));
        service.post("/api/v1/stop", &json!({})).expect(200);
        let base = format!("/api/v1/sessions/{id}");
        service.until(&base, |s| s["state"] == "idle" && s["stage"] == Value::Null);
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

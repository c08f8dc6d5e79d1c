//! Remains in the data folder: unfinished results and uploads, unused uploads, and sessions needed by pending jobs.

#![allow(clippy::unwrap_used)]

use nacre_tests::chromium::Browser;
use nacre_tests::http::{Service, begin, finished, form, plan};
use nacre_tests::{BENCH, NEVER, Place, binary, listing, nacre};
use serde_json::json;
use std::fs;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A run that is stopped while its temporary folder in `parent` has entries, hence after the folder was locked. The
/// folder is read only while the run is stopped; a run that ends before is repeated.
fn stopped_amid_results(args: &[&str], parent: &Path) -> Child {
    let before = listing(parent);
    let begun = Instant::now();
    loop {
        assert!(begun.elapsed() < NEVER, "no run was stopped while it wrote its results");
        let mut child = Command::new(binary()).args(args).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        while stop(&mut child) {
            let mut new =
                listing(parent).into_iter().filter(|name| name.ends_with(".partial") && !before.contains(name));
            if new.any(|name| !listing(&parent.join(name)).is_empty()) {
                return child;
            }
            signal(&child, "CONT");
            std::thread::sleep(Duration::from_millis(1));
        }
        child.wait().unwrap();
    }
}

fn signal(child: &Child, name: &str) {
    Command::new("kill").args(["-s", name, &child.id().to_string()]).status().unwrap();
}

/// Stops a process and waits until it is stopped; returns false if it has ended.
fn stop(child: &mut Child) -> bool {
    signal(child, "STOP");
    while child.try_wait().unwrap().is_none() {
        let status = fs::read_to_string(format!("/proc/{}/stat", child.id())).unwrap();
        if status.rsplit(')').next().is_some_and(|rest| rest.trim_start().starts_with('T')) {
            return true;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    false
}

/// The next run with the same result removes remains of killed ones, but not files of a running one.
#[test]
fn the_next_run_sweeps_what_killed_ones_left() {
    let folder = tempfile::tempdir().unwrap();
    let [input, out] = ["in", "r"].map(|name| folder.path().join(name).to_string_lossy().into_owned());
    nacre(["sim", "render", "--sample", "cd", "--size", "300", "--angles-deg", "0,45,90,135", "--out", &input])
        .expect(0);
    let args = ["reconstruct", "polarization", &input, "--out", &out, "--force"];
    let partial = || listing(folder.path()).into_iter().filter(|name| name.ends_with(".partial")).collect::<Vec<_>>();
    for _ in 0..3 {
        let mut child = stopped_amid_results(&args, folder.path());
        // Another run with the same result leaves it alone.
        let used = partial();
        assert_eq!(used.len(), 1);
        nacre(args).expect(0);
        assert_eq!(partial(), used);
        child.kill().unwrap();
        child.wait().unwrap();
        assert_eq!(partial(), used);
    }
    nacre(args).expect(0);
    assert_eq!(listing(folder.path()), ["in", "r"]);
}

#[test]
fn a_start_sweeps_unfinished_uploads_and_results() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let id = begin(&service, &plan(3, 5.0));
    finished(&service, &id);
    let part = form(&[("kind", "", b"photographs"), ("file", "a.png", &[7; 5000])]);
    let head = format!(
        "POST /api/v1/uploads HTTP/1.1\r\nHost: {}\r\nContent-Type: multipart/form-data; boundary=edge\r\nContent-Length: {}\r\n\r\n",
        service.address,
        part.len() + 1000
    );
    let uploads = place.path("data/uploads");
    let sending = service.connect(&[head.as_bytes(), &part[..4000]].concat());
    let begun = Instant::now();
    while listing(&uploads).is_empty() {
        assert!(begun.elapsed() < NEVER, "the upload never began");
        std::thread::sleep(Duration::from_millis(5));
    }
    service.kill();
    drop(sending);
    let session = place.path(&format!("data/sessions/{id}"));
    let before = listing(&session);
    let left = [
        place.path("data/reconstructions/.01ARZ3NDEKTSV4RRFFQ69G5FAV.aBc123.partial/maps"),
        session.join(".results.aBc123.partial"),
        // Of earlier versions.
        uploads.join(".upload-aBc123"),
    ];
    left.iter().for_each(|folder| fs::create_dir_all(folder).unwrap());
    assert_eq!(listing(&uploads).len(), 2);
    let service = Service::start(&place, &[]);
    assert!(listing(&uploads).is_empty() && listing(&place.path("data/reconstructions")).is_empty());
    assert_eq!(listing(&session), before);
    service.get(&format!("/api/v1/sessions/{id}")).expect(200);
}

#[test]
fn uploads_are_listed_deleted_and_expire() {
    let place = Place::with_bench("", BENCH);
    fs::write(place.path("nacre.toml"), "limits = { upload_days = 3 }").unwrap();
    let service = Service::start(&place, &["--config", "nacre.toml"]);
    let upload = |service: &Service| {
        let parts: [(&str, &str, &[u8]); 2] =
            [("kind", "", b"surface"), ("file", "a.txt", b"0 1 0 1\n1 0 1 0\n0 1 0 1\n")];
        service.upload(&parts).expect(201).json()["id"].as_str().unwrap().to_owned()
    };
    assert_eq!(service.get("/api/v1/uploads").expect(200).json()["items"], json!([]));
    let [used, unused] = [(); 2].map(|()| upload(&service));
    let options = json!({ "pixel_um": 0.1, "range_um": 0.2, "size": 16 });
    let body = json!({ "upload": used, "method": "brdf", "options": options });
    let job = service.post("/api/v1/reconstructions", &body).expect(202).json()["id"].clone();
    let items = service.get("/api/v1/uploads").expect(200).json()["items"].clone();
    assert_eq!((&items[0]["id"], &items[1]["id"]), (&json!(unused), &json!(used)), "newest first");
    assert_eq!((&items[0]["files"], &items[0]["bytes"]), (&json!(1), &json!(24)));
    assert_eq!((&items[0]["reconstructions"], &items[1]["reconstructions"]), (&json!([]), &json!([job])));
    let days = |item: &serde_json::Value| {
        (item["expires"].as_f64().unwrap() - item["created"].as_f64().unwrap()) / (24.0 * 3600.0)
    };
    assert_eq!((days(&items[0]), &items[1]["expires"]), (3.0, &json!(null)));
    let refused = service.send("DELETE", &format!("/api/v1/uploads/{used}"), &[], b"").expect(409).text();
    assert!(refused.contains(job.as_str().unwrap()), "{refused}");
    service.send("DELETE", &format!("/api/v1/uploads/{unused}"), &[], b"").expect(204);
    service.send("DELETE", &format!("/api/v1/uploads/{unused}"), &[], b"").expect(404);
    service.send("DELETE", "/api/v1/uploads/..%2fsessions", &[], b"").expect(404);
    assert_eq!(listing(&place.path("data/uploads")), std::slice::from_ref(&used));

    // Uploads of the year 2016: one unused, and one used by a reconstruction.
    let old = |id: &str| place.path(&format!("data/uploads/{id}"));
    let [forgotten, needed] = ["01ARZ3NDEKTSV4RRFFQ69G5FAV", "01ARZ3NDEKTSV4RRFFQ69G5FAW"];
    [forgotten, needed].iter().for_each(|id| {
        fs::create_dir(old(id)).unwrap();
        fs::copy(place.path(&format!("data/uploads/{used}/a.txt")), old(id).join("a.txt")).unwrap();
    });
    let body = json!({ "upload": needed, "method": "brdf", "options": options });
    service.post("/api/v1/reconstructions", &body).expect(202);
    drop(service);
    let service = Service::start(&place, &["--config", "nacre.toml"]);
    service.until("/api/v1/uploads", |list| list["items"].as_array().unwrap().len() == 2);
    assert!(old(needed).is_dir() && !old(forgotten).exists());
}

#[test]
fn a_session_that_a_job_waits_for_stays() {
    let place = Place::with_bench("", "camera = { width = 640, height = 480 }");
    let service = Service::start(&place, &[]);
    let id = begin(&service, &plan(6, 5.0));
    finished(&service, &id);
    // The last of them waits for the others.
    let asked = || service.post("/api/v1/reconstructions", &json!({ "session": id })).expect(202).json()["id"].clone();
    let jobs: Vec<_> = (0..10).map(|_| asked()).collect();
    let base = format!("/api/v1/sessions/{id}");
    let token = service.get(&format!("{base}/deletion")).expect(200).json()["token"].as_str().unwrap().to_owned();
    let delete = || service.send("DELETE", &format!("{base}?token={token}"), &[], b"");
    let refused = delete().expect(409).text();
    assert!(jobs.iter().any(|job| refused.contains(job.as_str().unwrap())), "{refused}");
    for job in &jobs {
        let path = format!("/api/v1/reconstructions/{}", job.as_str().unwrap());
        // It may already be done.
        service.post(&format!("{path}/cancel"), &json!({}));
        service.until(&path, |job| !["queued", "running"].contains(&job["state"].as_str().unwrap()));
    }
    delete().expect(204);
    service.get(&base).expect(404);
}

#[test]
fn the_page_lists_and_deletes_uploads_without_a_result() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let parts: [(&str, &str, &[u8]); 2] = [("kind", "", b"surface"), ("file", "a.txt", b"0 1\n1 0\n")];
    let [first, second] = [(); 2].map(|()| service.upload(&parts).expect(201).json()["id"].clone());
    browser.open(&format!("http://{}/#/results", service.address));
    browser.until("document.querySelectorAll('#unused-uploads li').length === 2");
    browser.click("#unused-uploads summary");
    browser.click(&format!("[data-upload=\"{}\"] button[aria-label^=Delete]", second.as_str().unwrap()));
    browser.until("document.querySelector('#notices').innerText.includes('is deleted')");
    browser.until("document.querySelectorAll('#unused-uploads li').length === 1");
    let left = service.get("/api/v1/uploads").expect(200).json()["items"].clone();
    assert_eq!((left.as_array().unwrap().len(), &left[0]["id"]), (1, &first));
}

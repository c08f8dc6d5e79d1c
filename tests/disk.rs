//! A data folder on a disk that is full, read-only, or owned by another user.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

use nacre_tests::http::{Answer, Service, SmallDisk, begin, fill, finished, free, plan, private_mount};
use nacre_tests::{BENCH, NEVER, Place, binary, listing, nacre};
use serde_json::{Value, json};
use std::collections::HashSet;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::Command;
use std::time::Instant;

fn about(service: &Service, full: bool) {
    service.until_full(full);
    let health = service.get("/healthz").expect(200).text();
    assert_eq!(health == "ok", !full, "{health}");
}

fn exposures() -> Value {
    json!({ "plan": { "kind": "exposures", "exposures_ms": [20, 21, 22, 23], "name": "stairs" } })
}

fn full(answer: Answer) {
    let problem = answer.expect(507).json();
    assert_eq!(problem["type"], "https://nacre.invalid/problems/full");
    assert!(problem["remedy"].as_str().unwrap().contains("delete sessions"), "{problem}");
}

#[test]
fn after_a_full_disk_all_is_well() {
    let place = Place::with_bench("", BENCH);
    let Some(disk) = SmallDisk::new(&place, "6m", "true") else { return };
    let service = &disk.service;
    let id = begin(service, &exposures());
    service.until(&format!("/api/v1/sessions/{id}"), |s| s["state"] == "finished");
    let ask = || service.post("/api/v1/reconstructions", &json!({ "session": id, "method": "hdr" }));
    let first = ask().expect(202).json()["id"].clone();
    fill(&disk.data);
    about(&disk.service, true);
    let answers: Vec<Answer> = (0..8).map(|_| ask()).collect();
    // A few may fit into free space of the database; the remaining ones fail.
    assert!(answers.iter().all(|a| [202, 507].contains(&a.status)), "{:?}", answers.last().unwrap().text());
    full(ask());
    full(service.post("/api/v1/sessions", &exposures()));
    full(service.upload(&[("kind", "", b"photographs"), ("file", "a.png", &[7; 1 << 16])]));
    // Reading still works, and finished items can be deleted.
    service.get(&format!("/api/v1/sessions/{id}")).expect(200);
    service.get("/api/v1/reconstructions").expect(200);

    free(&disk.data);
    about(&disk.service, false);
    for _ in 0..8 {
        let job = ask().expect(202).json()["id"].as_str().unwrap().to_owned();
        let path = format!("/api/v1/reconstructions/{job}");
        service.until(&path, |job| job["state"] == "done");
        let token = service.get(&format!("{path}/deletion")).expect(200).json()["token"].as_str().unwrap().to_owned();
        service.send("DELETE", &format!("{path}?token={token}"), &[], b"").expect(204);
    }
    let path = format!("/api/v1/reconstructions/{}", first.as_str().unwrap());
    service.until(&path, |job| job["state"] == "done");
}

/// A reconstruction can be deleted while the disk is full, and sessions captured meanwhile are found afterwards.
#[test]
fn a_full_disk_is_emptied_over_rest() {
    let place = Place::with_bench("", BENCH);
    let Some(disk) = SmallDisk::new(&place, "6m", "true") else { return };
    let service = &disk.service;
    let [kept, deleted] = [(); 2].map(|()| begin_and_finish(service));
    let job = service.post("/api/v1/reconstructions", &json!({ "session": kept })).expect(202).json();
    let job = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
    service.until(&job, |job| job["state"] == "done");
    fill(&disk.data);
    about(&disk.service, true);
    for base in [format!("/api/v1/sessions/{deleted}"), job] {
        let token = service.get(&format!("{base}/deletion")).expect(200).json()["token"].as_str().unwrap().to_owned();
        service.send("DELETE", &format!("{base}?token={token}"), &[], b"").expect(204);
        service.get(&base).expect(404);
        fill(&disk.data);
    }
    free(&disk.data);
    about(&disk.service, false);
    service.until("/api/v1/sessions", |page| page["items"].as_array().unwrap().len() == 1);
    assert_eq!(service.get("/api/v1/sessions").json()["items"][0]["id"], kept.as_str());
}

fn begin_and_finish(service: &Service) -> String {
    let id = begin(service, &plan(3, 5.0));
    finished(service, &id);
    id
}

#[test]
fn on_a_full_disk_the_service_starts_and_recovers() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let [kept, deleted] = [(); 2].map(|()| begin_and_finish(&service));
    let upload = service.upload(&[("kind", "", b"surface"), ("file", "a.txt", &[b'1'; 9000])]).expect(201).json();
    let upload = upload["id"].as_str().unwrap().to_owned();
    // Killed, so that the databases have a log to recover.
    service.kill();
    fs::rename(place.path("data"), place.path("before")).unwrap();
    let script = "cp -a ../before/. . && rm -f *-shm && { dd if=/dev/zero of=fill bs=4k 2>/dev/null; true; }";
    let Some(disk) = SmallDisk::new(&place, "4m", script) else { return };
    let service = &disk.service;
    about(&disk.service, true);
    service.get("/readyz").expect(507);
    full(service.get("/api/v1/reconstructions"));
    full(service.post("/api/v1/sessions", &exposures()));
    let found = service.get("/api/v1/sessions?text=tile").expect(200).json();
    assert_eq!(found["items"].as_array().unwrap().len(), 2, "{found}");
    assert_eq!(service.get("/api/v1/uploads").expect(200).json()["items"][0]["id"], upload.as_str());
    service.send("DELETE", &format!("/api/v1/uploads/{upload}"), &[], b"").expect(204);
    let base = format!("/api/v1/sessions/{deleted}");
    let token = service.get(&format!("{base}/deletion")).expect(200).json()["token"].as_str().unwrap().to_owned();
    service.send("DELETE", &format!("{base}?token={token}"), &[], b"").expect(204);
    free(&disk.data);
    about(&disk.service, false);
    service.get("/readyz").expect(200);
    let job = service.post("/api/v1/reconstructions", &json!({ "session": kept })).expect(202).json();
    service.until(&format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap()), |job| job["state"] == "done");
    let all = service.until("/api/v1/sessions", |page| page["items"].as_array().unwrap().len() == 1);
    assert_eq!(all["items"][0]["id"], kept.as_str());
}

/// Runs `nacre serve` in a shell after a preparation; returns exit code and output.
fn serve(place: &Place, flag: &str, prepare: &str) -> (Option<i32>, String) {
    let script = format!("{prepare} exec \"$NACRE\" serve --sim --listen 127.0.0.1:0 --data \"$DATA\"");
    let mut command = Command::new("unshare");
    command.args([flag, "sh", "-c", &script]).env("NACRE", binary()).env("DATA", place.path("data"));
    let run = command.output().unwrap();
    (run.status.code(), String::from_utf8_lossy(&run.stderr).into_owned())
}

#[test]
fn a_read_only_disk_is_named() {
    let place = Place::with_bench("", BENCH);
    fs::create_dir(place.path("data")).unwrap();
    let Some(flag) = private_mount() else { return };
    let (code, message) = serve(&place, flag, "mount -t tmpfs -o ro tmpfs \"$DATA\" || exit 77;");
    assert_eq!(code, Some(2), "{message}");
    assert!(message.contains("read-only") && message.contains("--data"), "{message}");
}

#[test]
fn the_data_folder_is_nobody_elses_business() {
    let place = Place::with_bench("", BENCH);
    let _service = Service::start(&place, &[]);
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
    assert_eq!(mode(&place.path("data")), 0o700);
    assert!(listing(&place.path("data")).contains(&"sessions".to_owned()));
}

#[test]
fn too_many_open_files_are_named() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let id = begin_and_finish(&service);
    let limit = |most: usize| {
        let limit = format!("--nofile={most}:");
        assert!(
            Command::new("prlimit").args(["--pid", &service.pid().to_string(), &limit]).status().unwrap().success()
        );
    };
    // The system limits the numbers of descriptors. Some below the highest one are free.
    let number_of_free = |spare: usize| {
        let files = fs::read_dir(format!("/proc/{}/fd", service.pid())).unwrap();
        let open: HashSet<usize> =
            files.map(|file| file.unwrap().file_name().into_string().unwrap().parse().unwrap()).collect();
        (0..).filter(|number| !open.contains(number)).nth(spare).unwrap()
    };
    let path = format!("/api/v1/sessions/{id}/files/frames.json");
    // With one number of free descriptors, one is available for the connection, but none for the request. Databases
    // open and close some files meanwhile.
    let begun = Instant::now();
    let mut answers = (1..8).rev().cycle().map(|spare| {
        limit(number_of_free(spare));
        service.get(&path)
    });
    let refused = answers.find(|answer| answer.status == 503 || begun.elapsed() > NEVER);
    let refused = refused.unwrap().expect(503).text();
    assert!(refused.contains("too many files are open") && refused.contains("ulimit -n"), "{refused}");
    limit(1024);
    service.get(&path).expect(200);
    nacre(["check", &place.text(&format!("data/sessions/{id}"))]).expect(0);
}

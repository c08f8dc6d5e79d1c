//! Names of sessions, uploads and results; deletion and restoring.

#![allow(clippy::unwrap_used)]

use nacre_tests::chromium::Browser;
use nacre_tests::http::{Answer, Service, SmallDisk, begin, fill, finished, free, plan};
use nacre_tests::{BENCH, Place, listing, nacre};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

const STEPS: &[u8] = b"0 1 0 1\n1 0 1 0\n0 1 0 1\n";

fn rename(service: &Service, path: &str, name: &str) -> Answer {
    let body = json!({ "name": name }).to_string();
    service.send("PATCH", path, &["Content-Type: application/json"], body.as_bytes())
}

fn delete(service: &Service, path: &str) {
    let token = service.get(&format!("{path}/deletion")).expect(200).json()["token"].as_str().unwrap().to_owned();
    service.send("DELETE", &format!("{path}?token={token}"), &[], b"").expect(204);
    service.get(path).expect(404);
}

fn restore(service: &Service, id: &str) -> Value {
    service.post(&format!("/api/v1/trash/{id}/restore"), &json!({})).expect(200).json()
}

fn trash(service: &Service) -> Vec<Value> {
    service.get("/api/v1/trash").expect(200).json()["items"].as_array().unwrap().clone()
}

/// A session without a name, of a sample.
fn session(service: &Service) -> String {
    let mut asked = plan(3, 5.0);
    asked["plan"]["name"] = json!("");
    let id = begin(service, &asked);
    finished(service, &id);
    id
}

/// Runs an operation to its end; its id.
fn result(service: &Service, method: &str, order: &Value) -> String {
    let job = service.post(&format!("/api/v1/operations/{method}"), order).expect(202).json();
    let id = job["id"].as_str().unwrap().to_owned();
    service.until(&format!("/api/v1/reconstructions/{id}"), |job| job["state"] == "done");
    id
}

fn upload(service: &Service, parts: &[(&str, &str, &[u8])]) -> String {
    service.upload(parts).expect(201).json()["id"].as_str().unwrap().to_owned()
}

fn brdf(upload: &str) -> Value {
    json!({ "upload": upload, "options": { "pixel_um": 0.1, "range_um": 0.2, "size": 16 } })
}

fn name(service: &Service, path: &str) -> String {
    service.get(path).expect(200).json()["name"].as_str().unwrap().to_owned()
}

/// Contents of all files of a folder, with their paths.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut all = vec![];
    for name in listing(folder) {
        let path = folder.join(&name);
        if path.is_dir() {
            all.extend(contents(&path).into_iter().map(|(inner, bytes)| (format!("{name}/{inner}"), bytes)));
        } else {
            all.push((name, fs::read(path).unwrap()));
        }
    }
    all
}

#[test]
fn sessions_are_named_by_their_samples_or_by_people() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let id = session(&service);
    let base = format!("/api/v1/sessions/{id}");
    assert_eq!(name(&service, &base), "kinematic");
    assert_eq!(name(&service, &format!("/api/v1/reconstructions/{id}")), "Polarization of kinematic");
    let first = format!("/api/v1/reconstructions/{}", result(&service, "polarization", &json!({ "session": id })));
    assert_eq!(name(&service, &first), "Polarization of kinematic");
    assert_eq!(rename(&service, &base, "  Disc 7, front ").expect(200).json()["name"], "Disc 7, front");
    // A result keeps its name; later ones have the session's new one, or their own.
    assert_eq!(name(&service, &first), "Polarization of kinematic");
    let second = result(&service, "polarization", &json!({ "session": id }));
    assert_eq!(name(&service, &format!("/api/v1/reconstructions/{second}")), "Polarization of Disc 7, front");
    let own = result(&service, "polarization", &json!({ "session": id, "name": "Third try" }));
    assert_eq!(name(&service, &format!("/api/v1/reconstructions/{own}")), "Third try");
    rename(&service, &first, "First try").expect(200);
    rename(&service, &format!("/api/v1/reconstructions/{id}"), "Mine").expect(409);

    let bad = ["line\nbreak".to_owned(), "a\u{202e}b".into(), "x".repeat(201)];
    for (path, bad) in [&base, &first].into_iter().flat_map(|path| bad.iter().map(move |bad| (path, bad))) {
        let refused = rename(&service, path, bad).expect(400).text();
        assert!(refused.contains("name has"), "{refused}");
    }
    for kind in ["sessions", "reconstructions", "uploads"] {
        rename(&service, &format!("/api/v1/{kind}/01ARZ3NDEKTSV4RRFFQ69G5FAV"), "x").expect(404);
        rename(&service, &format!("/api/v1/{kind}/..%2fsessions"), "x").expect(404);
    }
    let found = |service: &Service, words: &str| {
        let page = service.get(&format!("/api/v1/sessions?text={words}")).expect(200).json();
        page["items"].as_array().unwrap().iter().map(|s| s["name"].clone()).collect::<Vec<_>>()
    };
    assert_eq!(found(&service, "disc%20front"), [json!("Disc 7, front")]);
    // The catalogue is rebuilt, and no checksum knows of the name.
    drop(service);
    fs::remove_file(place.path("data/catalogue.db")).unwrap();
    let folder = place.text(&format!("data/sessions/{id}"));
    nacre(["check", &folder]).expect(0);
    let service = Service::start(&place, &[]);
    assert_eq!(found(&service, "disc%20front"), [json!("Disc 7, front")]);
    assert_eq!(name(&service, &first), "First try");
    let catalogue = place.text("own.db");
    let listed = |args: &[&str]| nacre([&["catalogue", "--catalogue", &catalogue], args].concat()).expect(0).stdout();
    listed(&["rebuild", &place.text("data/sessions")]);
    assert!(listed(&["list"]).contains("Disc 7, front"), "{}", listed(&["list"]));
    assert_eq!(rename(&service, &base, "").expect(200).json()["name"], "kinematic");
    assert_eq!(found(&service, "disc"), Vec::<Value>::new());
    assert_eq!(rename(&service, &first, " ").expect(200).json()["name"], "Polarization of kinematic");
}

#[test]
fn uploads_and_renderings_are_named_by_their_files() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let named = |parts: &[(&str, &str, &[u8])]| service.upload(parts).expect(201).json();
    let steps = named(&[("kind", "", b"surface"), ("file", "steps.txt", STEPS)]);
    let given = named(&[("kind", "", b"surface"), ("name", "", "Grübchen 3".as_bytes()), ("file", "a.txt", STEPS)]);
    assert_eq!((&steps["name"], &given["name"]), (&json!("steps"), &json!("Grübchen 3")));
    assert_eq!((&given["files"], &given["bytes"]), (&json!(1), &json!(STEPS.len())));
    let refused = [("kind", "", &b"surface"[..]), ("name", "", b"a\tb"), ("file", "a.txt", STEPS)];
    service.upload(&refused).expect(400);
    let id = given["id"].as_str().unwrap();
    let light = result(&service, "brdf", &brdf(id));
    assert_eq!(name(&service, &format!("/api/v1/reconstructions/{light}")), "Diffracted light of Grübchen 3");
    let path = format!("/api/v1/uploads/{id}");
    assert_eq!(rename(&service, &path, "Pits").expect(200).json()["name"], "Pits");
    let items = service.get("/api/v1/uploads").expect(200).json()["items"].clone();
    assert_eq!((&items[0]["name"], &items[0]["bytes"]), (&json!("Pits"), &json!(STEPS.len())));
    assert_eq!(rename(&service, &path, "").expect(200).json()["name"], "a");

    let scene = upload(&service, &[("kind", "", b"scene"), ("gallery", "", b"cd")]);
    let order = json!({ "upload": scene, "options": { "samples": 4 } });
    let picture = result(&service, "render", &order);
    assert_eq!(name(&service, &format!("/api/v1/reconstructions/{picture}")), "Rendering of cd");
}

#[test]
fn what_is_deleted_is_restored_as_it_was() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let id = session(&service);
    let (base, folder) = (format!("/api/v1/sessions/{id}"), place.path(&format!("data/sessions/{id}")));
    let (before, described) = (contents(&folder), service.get(&base).json());
    assert_eq!(service.get(&format!("{base}/deletion")).expect(200).json()["trash_days"], 7);
    delete(&service, &base);
    assert!(service.get(&base).text().contains("from the trash"));
    assert!(!folder.exists() && service.get("/api/v1/sessions").json()["items"] == json!([]));
    let item = &trash(&service)[0];
    assert_eq!((&item["id"], &item["kind"], &item["name"]), (&json!(id), &json!("session"), &json!("kinematic")));
    assert_eq!(item["files"].as_u64().unwrap() as usize, before.len());
    let seconds = item["expires"].as_u64().unwrap() - item["deleted"].as_u64().unwrap();
    assert_eq!(seconds, 7 * 24 * 3600);
    // Deleted sessions are not found in the data folder either.
    let catalogue = place.text("own.db");
    let rebuilt = nacre(["catalogue", "--json", "--catalogue", &catalogue, "rebuild", &place.text("data")]).expect(0);
    assert_eq!(rebuilt.json()["sessions"], 0);
    assert_eq!(restore(&service, &id)["name"], "kinematic");
    assert_eq!((contents(&folder), service.get(&base).json()), (before, described));
    assert_eq!(service.get("/api/v1/sessions?text=kinematic").json()["items"][0]["id"], json!(id));
    nacre(["check", &folder.display().to_string()]).expect(0);
    assert_eq!(listing(&place.path("data/trash")), Vec::<String>::new());

    // Two results of one upload, which goes with the last of them and comes back with the first.
    let steps = upload(&service, &[("kind", "", b"surface"), ("file", "steps.txt", STEPS)]);
    let jobs = [(); 2].map(|()| result(&service, "brdf", &brdf(&steps)));
    let paths = jobs.each_ref().map(|job| format!("/api/v1/reconstructions/{job}"));
    let state = |path: &str| (service.get(path).expect(200).json(), service.get(&format!("{path}/log")).text());
    let before = paths.each_ref().map(|path| state(path));
    let uploads = || service.get("/api/v1/uploads").expect(200).json()["items"].clone();
    delete(&service, &paths[0]);
    assert_eq!(uploads()[0]["reconstructions"], json!([jobs[1]]));
    delete(&service, &paths[1]);
    assert_eq!((uploads(), trash(&service).len()), (json!([]), 2));
    restore(&service, &jobs[0]);
    assert_eq!((state(&paths[0]), &uploads()[0]["reconstructions"]), (before[0].clone(), &json!([jobs[0]])));
    service.get(&format!("{}/files/report.json", paths[0])).expect(200);
    restore(&service, &jobs[1]);
    assert_eq!(state(&paths[1]), before[1]);
    service.post(&format!("/api/v1/trash/{}/restore", jobs[1]), &json!({})).expect(404);

    // For good, one by one and all.
    let other = upload(&service, &[("kind", "", b"surface"), ("file", "other.txt", STEPS)]);
    service.send("DELETE", &format!("/api/v1/uploads/{other}"), &[], b"").expect(204);
    delete(&service, &paths[0]);
    delete(&service, &base);
    assert_eq!(trash(&service).len(), 3);
    for wrong in ["..%2fsessions", "01ARZ3NDEKTSV4RRFFQ69G5FAV", &jobs[1]] {
        service.send("DELETE", &format!("/api/v1/trash/{wrong}"), &[], b"").expect(404);
        service.post(&format!("/api/v1/trash/{wrong}/restore"), &json!({})).expect(404);
    }
    service.send("DELETE", &format!("/api/v1/trash/{other}"), &[], b"").expect(204);
    service.post(&format!("/api/v1/trash/{other}/restore"), &json!({})).expect(404);
    assert!(!service.get("/api/v1/trash").text().contains(&place.text("data")));
    service.send("DELETE", "/api/v1/trash", &[], b"").expect(204);
    assert_eq!((trash(&service).len(), listing(&place.path("data/trash")).len()), (0, 0));
    assert_eq!(state(&paths[1]), before[1]);
}

#[test]
fn the_trash_expires_and_can_be_turned_off() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let ids = [(); 3].map(|()| upload(&service, &[("kind", "", b"surface"), ("file", "steps.txt", STEPS)]));
    for id in &ids {
        service.send("DELETE", &format!("/api/v1/uploads/{id}"), &[], b"").expect(204);
    }
    drop(service);
    // One was deleted nine days ago, and the deletion of another was interrupted.
    let file = |id: &str| place.path(&format!("data/trash/{id}/deleted.json"));
    let mut old: Value = serde_json::from_slice(&fs::read(file(&ids[0])).unwrap()).unwrap();
    old["deleted"] = json!(old["deleted"].as_u64().unwrap() - 9 * 24 * 3600);
    fs::write(file(&ids[0]), old.to_string()).unwrap();
    fs::remove_file(file(&ids[1])).unwrap();
    let service = Service::start(&place, &[]);
    service.until("/api/v1/trash", |trash| trash["items"].as_array().unwrap().len() == 1);
    assert_eq!(listing(&place.path("data/trash")), [ids[2].clone()]);
    drop(service);

    fs::write(place.path("nacre.toml"), "limits = { trash_days = 0 }").unwrap();
    let service = Service::start(&place, &["--config", "nacre.toml"]);
    service.until("/api/v1/trash", |trash| trash["items"] == json!([]) && trash["days"] == 0);
    let id = session(&service);
    let base = format!("/api/v1/sessions/{id}");
    assert_eq!(service.get(&format!("{base}/deletion")).expect(200).json()["trash_days"], 0);
    delete(&service, &base);
    assert_eq!(listing(&place.path("data/trash")), Vec::<String>::new());
}

#[test]
fn a_full_disk_has_no_trash() {
    let place = Place::with_bench("", BENCH);
    let Some(disk) = SmallDisk::new(&place, "6m", "true") else { return };
    let service = &disk.service;
    let [first, second] = [(); 2].map(|()| session(service));
    delete(service, &format!("/api/v1/sessions/{first}"));
    assert_eq!(trash(service)[0]["id"], json!(first));
    fill(&disk.data);
    service.until("/api/v1/trash", |trash| trash["items"] == json!([]));
    fill(&disk.data);
    service.until_full(true);
    let base = format!("/api/v1/sessions/{second}");
    assert_eq!(service.get(&format!("{base}/deletion")).expect(200).json()["trash_days"], 0);
    delete(service, &base);
    assert_eq!(listing(&disk.data.join("trash")), Vec::<String>::new());
    free(&disk.data);
    service.until_full(false);
}

#[test]
fn a_person_renames_deletes_and_undoes() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let url = format!("http://{}", service.address);
    let id = session(&service);
    let job = result(&service, "polarization", &json!({ "session": id }));
    let heading = |name: &str| {
        browser.until(&format!(
            "document.querySelector('h1')?.textContent === '{name}' && document.title === '{name} · Nacre'"
        ));
    };
    let write = |name: &str| {
        browser.click(".naming .rename");
        browser.run(&format!("document.querySelector('.naming input').value = '{name}'"));
        browser.both(&format!("rename-{}", if name.contains("Disc") { "session" } else { "result" }));
        browser.click(".naming form .primary");
    };
    browser.open(&format!("{url}/#/session/{id}"));
    browser.until("document.querySelector('#live-map')?.naturalWidth > 0");
    heading("kinematic");
    write("Disc 7, front");
    heading("Disc 7, front");
    browser.open(&format!("{url}/#/result/{job}"));
    heading("Polarization of kinematic");
    write("First try");
    heading("First try");
    browser.open(&format!("{url}/#/results"));
    browser.until("document.querySelector('.card .title')?.textContent === 'First try'");
    let both = |list: &str, title: &str, path: &str| {
        browser.open(&format!("{url}/#/{list}"));
        browser.until(&format!("document.querySelector('.card .title')?.textContent === '{title}'"));
        browser.click(".card button[aria-label^=Delete]");
        browser.until("!document.querySelector('.card') && document.querySelector('.notice button:not(.icon)')");
        service.get(path).expect(404);
        browser.both(&format!("undo-{list}"));
        browser.click(".notice button:not(.icon)");
        browser.until(&format!("document.querySelector('.card .title')?.textContent === '{title}'"));
        service.get(path).expect(200);
    };
    both("sessions", "Disc 7, front", &format!("/api/v1/sessions/{id}"));
    both("results", "First try", &format!("/api/v1/reconstructions/{job}"));

    delete(&service, &format!("/api/v1/sessions/{id}"));
    delete(&service, &format!("/api/v1/reconstructions/{job}"));
    browser.open(&format!("{url}/#/trash"));
    browser.until("document.querySelectorAll('.card').length === 2 && document.body.innerText.includes('7 days left')");
    let found = browser.run(include_str!("accessible.js"));
    assert_eq!(found[0], json!([]), "the trash");
    browser.both("trash");
    browser.click(&format!("[data-deleted=\"{id}\"] button"));
    browser.until("document.querySelectorAll('.card').length === 1");
    service.get(&format!("/api/v1/sessions/{id}")).expect(200);
    browser.click("#empty-trash");
    browser.until("document.querySelector('dialog[open]')?.innerText.includes('gone for good')");
    browser.click("dialog[open] button.danger");
    browser.until("document.body.innerText.includes('The trash is empty')");
    assert!(trash(&service).is_empty());
}

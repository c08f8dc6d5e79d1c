//! Settings and queue of jobs on the page, in headless Chromium.

#![allow(clippy::unwrap_used)]

use nacre_tests::chromium::Browser;
use nacre_tests::http::Service;
use nacre_tests::{BENCH, Place};
use serde_json::{Value, json};

const CONFIG: &str = "# Bench of room 3\nhosts = [\"bench.lab\"]\n\n[limits]\ntrash_days = 5 # a small disk\n";

/// Types into a field.
fn set(browser: &Browser, id: &str, value: &str) {
    browser.run(&format!(
        "const e = document.getElementById('{id}'); e.value = {}; e.dispatchEvent(new Event('input', {{ bubbles: true }}))",
        json!(value)
    ));
}

fn says(browser: &Browser, css: &str, words: &str) {
    browser.until(&format!("document.querySelector('{css}').innerText.includes({})", json!(words)));
}

#[test]
fn the_configuration_is_changed_on_the_page() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", BENCH);
    let file = place.path("nacre.toml");
    std::fs::write(&file, CONFIG).unwrap();
    let service = Service::start(&place, &["--config", &place.text("nacre.toml")]);
    browser.open(&format!("http://{}/#/settings", service.address));
    browser.until("document.getElementById('limits-limits-trash-days').value === '5'");
    assert_eq!(browser.run("return document.getElementById('service-hosts').value"), "bench.lab");
    assert_eq!(browser.run("return document.getElementById('settings-save').disabled"), true);

    // A wrong value is reported with its key and its range, and *Save* is disabled.
    set(&browser, "limits-limits-trash-days", "40000");
    says(&browser, "#settings-outcome", "limits.trash_days is 40000; give 0 to 36500");
    assert_eq!(browser.run("return document.getElementById('settings-save').disabled"), true);
    set(&browser, "limits-limits-trash-days", "9");
    set(&browser, "limits-limits-requests", "32");
    says(&browser, "#settings-outcome", "After a restart");
    let effects =
        browser.run("return [...document.querySelectorAll('#settings-outcome table')].map((t) => t.innerText)");
    assert!(effects[0].as_str().unwrap().contains("limits.trash_days"), "{effects}");
    assert!(effects[1].as_str().unwrap().contains("limits.requests"), "{effects}");
    browser.click("#settings-check");
    says(&browser, "#settings-outcome", "The configuration is valid");
    assert_eq!(std::fs::read_to_string(&file).unwrap(), CONFIG);
    browser.both("settings");
    browser.click("#settings-save");
    says(&browser, "#notices", "Saved. The file before is kept as nacre.toml.");
    let text = std::fs::read_to_string(&file).unwrap();
    assert_eq!(text, CONFIG.replace("= 5 #", "= 9 #") + "requests = 32\n");
    let backups = std::fs::read_dir(place.path("")).unwrap().flatten().map(|e| e.path());
    let backup = backups.filter(|p| p.extension().is_some_and(|e| e == "bak")).collect::<Vec<_>>();
    assert_eq!(std::fs::read_to_string(&backup[0]).unwrap(), CONFIG);
    assert_eq!(service.get("/api/v1/trash").expect(200).json()["days"], 9);

    // As text: an unknown key, then a change of another editor meanwhile.
    browser.click(".segments [data-key=text]");
    browser.until("document.getElementById('settings-text')?.value.includes('trash_days = 9')");
    set(&browser, "settings-text", "lisen = 1\n");
    says(&browser, "#settings-outcome", "did you mean listen");
    browser.both("settings-text");
    set(&browser, "settings-text", &text.replace("= 9 #", "= 3 #"));
    says(&browser, "#settings-outcome", "limits.trash_days");
    std::fs::write(&file, "# by hand\n").unwrap();
    browser.click("#settings-save");
    says(&browser, "#notices", "changed meanwhile");
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "# by hand\n");
    browser.click("#settings-outcome button");
    browser.until("document.getElementById('settings-text').value === '# by hand\\n'");
    assert_eq!(browser.run("return document.getElementById('settings-save').disabled"), true);
}

#[test]
fn a_service_without_a_configuration_says_where_it_is_saved() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    browser.open(&format!("http://{}/#/settings", service.address));
    says(&browser, "main", "The service runs without a configuration file.");
    says(&browser, "main", "nacre serve --config");
    set(&browser, "limits-limits-upload-days", "3");
    says(&browser, "#settings-outcome", "limits.upload_days");
    browser.click("#settings-save");
    says(&browser, "#notices", "Saved.");
    assert_eq!(std::fs::read_to_string(place.path("nacre.toml")).unwrap(), "[limits]\nupload_days = 3\n");
    browser.until("!document.querySelector('main').innerText.includes('nacre serve --config')");
}

#[test]
fn settings_are_for_administrators_and_need_the_version_of_the_file() {
    let place = Place::with_bench("", BENCH);
    std::fs::write(place.path("nacre.toml"), CONFIG).unwrap();
    let service = Service::start(&place, &["--config", &place.text("nacre.toml")]);
    let put = |headers: &[&str], text: &str| {
        let headers = [&["Content-Type: application/json"][..], headers].concat();
        service.send("PUT", "/api/v1/settings", &headers, json!({ "text": text }).to_string().as_bytes())
    };
    let found = service.get("/api/v1/settings").expect(200);
    let version = format!("If-Match: {}", found.header("etag").unwrap());
    assert_eq!((&found.json()["text"], &found.json()["problem"]), (&json!(CONFIG), &Value::Null));
    assert!(found.json()["overridden"].to_string().contains("listen"), "{}", found.text());
    assert!(put(&[], "").expect(400).text().contains("If-Match"));
    put(&["If-Match: \"0123456789abcdef\""], "").expect(412);
    assert!(put(&[&version], "listen = \"0.0.0.0:1\"").expect(400).text().contains("no token"));
    assert!(put(&[&version], "a = [").expect(400).text().contains("line 1"));
    assert_eq!(std::fs::read_to_string(place.path("nacre.toml")).unwrap(), CONFIG);
    let check = |body: Value| service.post("/api/v1/settings/check", &body);
    let values = json!({ "hosts": ["bench.lab"], "limits": { "trash_days": 2 } });
    let checked = check(json!({ "text": CONFIG, "values": values })).expect(200).json();
    assert_eq!(checked["text"], CONFIG.replace("= 5", "= 2"));
    assert!(
        check(json!({ "text": "[bench]\nsim = 3" })).expect(200).json()["problem"].to_string().contains("bench.sim")
    );
    let schema = service.get("/api/v1/settings/schema").expect(200).json();
    assert!(schema["properties"]["listen"]["description"].is_string());

    // A token is needed at once; its role decides.
    let hash = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08";
    let token = |role: &str| format!("{CONFIG}[[tokens]]\nname = \"t\"\nrole = \"{role}\"\nsha256 = \"{hash}\"\n");
    let saved = put(&[&version], &token("operate")).expect(200);
    assert!(saved.json()["backup"].as_str().unwrap().ends_with(".bak"));
    service.get("/api/v1/settings").expect(401);
    service.send("GET", "/api/v1/settings", &["Authorization: Bearer test"], b"").expect(403);
    service.send("GET", "/api/v1/trash", &["Authorization: Bearer test"], b"").expect(200);
}

#[test]
fn waiting_jobs_are_seen_moved_and_cancelled() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let scene = service.upload(&[("kind", "", &b"scene"[..]), ("gallery", "", &b"cd"[..])]).expect(201).json();
    let ids: Vec<String> = (0..3)
        .map(|_| {
            let asked = json!({ "upload": scene["id"], "method": "render", "options": { "samples": 1_000_000, "max_error": 0.00001 } });
            let job = service.post("/api/v1/reconstructions", &asked).expect(202).json();
            job["id"].as_str().unwrap().to_owned()
        })
        .collect();
    browser.open(&format!("http://{}/#/bench", service.address));
    browser.until("document.querySelector('#jobs')?.innerText === '3 jobs'");
    browser.click("#jobs");
    let order = "[...document.querySelectorAll('[data-job]')].map((e) => e.dataset.job).join()";
    let is = |ids: &[&String]| {
        let ids: Vec<&str> = ids.iter().map(|id| id.as_str()).collect();
        browser.until(&format!("{order} === '{}'", ids.join(",")));
    };
    browser.until(&format!("document.querySelector('[data-job=\"{}\"] progress:not([hidden])')", ids[0]));
    is(&[&ids[0], &ids[1], &ids[2]]);
    browser.click(&format!("[data-job=\"{}\"] button[aria-label^=\"To the front\"]", ids[2]));
    is(&[&ids[0], &ids[2], &ids[1]]);
    let queue = service.get("/api/v1/queue").expect(200).json();
    assert_eq!((&queue[1]["id"], &queue[1]["state"]), (&json!(ids[2]), &json!("queued")));
    service.post(&format!("/api/v1/queue/{}/first", ids[0]), &json!({})).expect(409);
    service.post("/api/v1/queue/01ARZ3NDEKTSV4RRFFQ69G5FAV/first", &json!({})).expect(404);
    browser.both("queue");
    // The next job runs once the first one is cancelled.
    browser.click(&format!("[data-job=\"{}\"] button[aria-label^=Cancel]", ids[0]));
    is(&[&ids[2], &ids[1]]);
    for id in [&ids[2], &ids[1]] {
        browser.click(&format!("[data-job=\"{id}\"] button[aria-label^=Cancel]"));
    }
    says(&browser, "main", "Nothing is running or waiting.");
    browser
        .until("document.querySelectorAll('.lamp[data-tone=warn]').length === 3 && !document.querySelector('#jobs')");
}

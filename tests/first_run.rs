//! The page as a new user meets it, in headless Chromium: two ways to begin, a lit bench, regions and presets.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

use nacre_tests::Place;
use nacre_tests::chromium::Browser;
use nacre_tests::http::Service;
use serde_json::json;

/// Arrow keys in the browser's protocol.
const RIGHT: &str = "\u{E014}";
const DOWN: &str = "\u{E015}";
const SHIFT: &str = "\u{E008}";

fn press(browser: &Browser, keys: &[&str]) {
    let down = keys.iter().map(|key| json!({ "type": "keyDown", "value": key }));
    let up = keys.iter().rev().map(|key| json!({ "type": "keyUp", "value": key }));
    let actions: Vec<_> = down.chain(up).collect();
    browser.call("POST", "/actions", &json!({ "actions": [{ "type": "key", "id": "keys", "actions": actions }] }));
}

/// Drags from the middle of one element to a point of another, in parts of its size from its top left corner.
fn drag(browser: &Browser, from: &str, to: &str, part: [f64; 2]) {
    let place = |css: &str, [x, y]: [f64; 2]| {
        let found = browser.run(&format!(
            "const b = document.querySelector('{css}').getBoundingClientRect(); return [b.left + {x} * b.width, b.top + {y} * b.height]"
        ));
        let [x, y] = [0, 1].map(|k| found[k].as_f64().unwrap().round() as i64);
        json!({ "type": "pointerMove", "duration": 0, "x": x, "y": y })
    };
    let (from, to) = (place(from, [0.5, 0.5]), place(to, part));
    let [down, up] = ["pointerDown", "pointerUp"].map(|kind| json!({ "type": kind, "button": 0 }));
    let pointer = json!({ "type": "pointer", "id": "mouse", "actions": [from, down, to, up] });
    browser.call("POST", "/actions", &json!({ "actions": [pointer] }));
}

fn accessible(browser: &Browser, page: &str) {
    let found = browser.run(include_str!("accessible.js"));
    assert_eq!(found[0], json!([]), "{page}");
}

#[test]
fn a_new_user_tries_a_sample() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", "camera = { width = 128, height = 128 }");
    let service = Service::start(&place, &[]);
    let url = format!("http://{}", service.address);
    browser.open(&url);
    // Every sample has its picture, and the bench is lit.
    browser.until("document.querySelectorAll('.doors:not(.line) [data-sample] img').length === 10");
    browser.until("[...document.querySelectorAll('.doors img')].every((i) => i.naturalWidth > 100)");
    browser.until("document.querySelector('#light').textContent === 'Light off'");
    browser.until("document.querySelector('#preview')?.naturalWidth > 0");
    browser.both("first-run");
    accessible(&browser, "first run");
    assert!(browser.run("return document.querySelector('#door-photographs').hash") == "#/upload");

    // The headless browser shows no notifications.
    browser.run(
        "window.Notification = class { static permission = 'default'; constructor(title) { window.told = title; }
            static async requestPermission() { Notification.permission = 'granted'; return 'granted'; } }",
    );
    browser.click("[data-sample=polygons]");
    browser.until("location.hash.startsWith('#/session/')");
    browser.click("#notify");
    browser.until("document.querySelector('#notify').getAttribute('aria-pressed') === 'true'");
    let id = browser.run("return location.hash.split('/')[2]").as_str().unwrap().to_owned();
    // The page shows each activity and the remaining time during the session.
    browser.until("/turning the analyser to \\d+\\.\\d°/.test(document.querySelector('#session-now').textContent)");
    browser.until("/^(\\d+ s|soon)$/.test(document.querySelector('#session-eta').textContent)");
    browser.until("/^\\d+ % · Sample: polygons/.test(document.title)");
    browser.until("document.querySelector('.phases [aria-current]')?.textContent === 'Results'");
    browser.until("!document.querySelector('#open-result').hidden && document.title.startsWith('Sample: polygons')");
    browser.until("document.querySelectorAll('.phases [data-is=done]').length === 3");
    browser.both("first-run-session");
    browser.until("window.told === 'Sample: polygons: finished'");
    let session = service.get(&format!("/api/v1/sessions/{id}")).expect(200).json();
    assert_eq!(
        (&session["state"], &session["eta_s"], &session["activity"]),
        (&json!("finished"), &json!(null), &json!(null))
    );
    browser.click("#open-result");
    browser.until("document.querySelector('#result-map')");
    // The devices of the bench were left alone.
    let devices = service.get("/api/v1/devices").expect(200).json();
    assert!(devices["display"]["pattern"]["disc"]["diameter_mm"] == 180.0, "{devices}");

    // After the first result, the two ways are one line.
    browser.open(&format!("{url}/#/bench"));
    browser.until("document.querySelector('.doors.line summary') && !document.querySelector('.doors.line img')");
    browser.click(".doors.line summary");
    browser.until("document.querySelectorAll('.doors.line img').length === 10");
}

#[test]
fn a_region_is_drawn_on_the_live_picture() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", "camera = { width = 128, height = 128 }");
    let service = Service::start(&place, &[]);
    let url = format!("http://{}", service.address);
    browser.open(&format!("{url}/#/bench"));
    browser.until("document.querySelector('#preview')?.naturalWidth > 0");
    browser.click("#draw-region");
    browser.until("document.querySelector('#region').textContent === '64 × 64 px, from 32, 32'");
    browser.run("document.querySelector('[data-corner=bottom-right]').focus()");
    press(&browser, &[RIGHT]);
    press(&browser, &[SHIFT, DOWN]);
    browser.until("document.querySelector('#region').textContent === '65 × 84 px, from 32, 32'");
    browser.run("document.querySelector('.region .frame').focus()");
    press(&browser, &[SHIFT, RIGHT]);
    browser.until("document.querySelector('#region').textContent === '65 × 84 px, from 52, 32'");
    accessible(&browser, "region");
    // The handle follows the pointer, at most to the frame's edge.
    browser.run("document.querySelector('.well.preview').scrollIntoView({ block: 'center' })");
    drag(&browser, "[data-corner=top-left]", ".well.preview", [0.0, 0.5]);
    browser.until("/^117 × 5\\d px, from 0, 6\\d$/.test(document.querySelector('#region').textContent)");
    browser.both("first-run-region");
    let drawn = browser.run(
        "const [w, h, x, y] = document.querySelector('#region').textContent.match(/\\d+/g).map(Number); return [x, y, w, h]",
    );
    browser.click("#use-region");
    browser.until("document.querySelector('#plan-roi')");
    browser.until("!document.querySelector('#start').disabled");

    // A preset keeps the region, states its time, and determines the plan.
    browser.until("[...document.querySelectorAll('.preset .time')].every((t) => /^(about \\d+|\\d+ s to \\d+)/.test(t.textContent))");
    browser.click("[data-preset=quick]");
    browser.until("document.querySelector('[data-preset=quick]').getAttribute('aria-pressed') === 'true'");
    let plan = || browser.run("return JSON.parse(document.querySelector('pre[aria-label]').textContent)");
    assert_eq!((&plan()["analyser"]["angles_deg"], &plan()["camera"]["roi"]), (&json!([0, 45, 90, 135]), &drawn));
    browser.until("!document.querySelector('#start').disabled");
    browser.both("first-run-presets");
    accessible(&browser, "presets");
}

#[test]
fn light_stays_off_after_stop() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", "camera = { width = 96, height = 96 }");
    let service = Service::start(&place, &[]);
    let url = format!("http://{}", service.address);
    let black = || service.get("/api/v1/devices").expect(200).json()["display"]["pattern"] == "black";
    browser.open(&format!("{url}/#/bench"));
    browser.until(
        "document.querySelector('#light')?.textContent === 'Light off' && !document.querySelector('#light').disabled",
    );
    assert!(!black());
    let metered = service.get("/api/v1/devices/camera/preview").expect(200).json();
    let level = metered["mean"].as_f64().unwrap();
    assert!(level > 0.1 && metered["saturated"].as_f64().unwrap() < 0.002, "{metered}");
    let [low, high] = [0, 1].map(|k| metered["stretch"][k].as_f64().unwrap());
    assert!(low < level && level < high && high <= 1.0, "{metered}");
    browser.click("#stop");
    browser.until("document.querySelector('#light').textContent === 'Light the sample'");
    // Neither another page nor the way back switches it on.
    browser.open(&format!("{url}/#/sessions"));
    browser.until("document.querySelector('#search')");
    browser.open(&format!("{url}/#/bench"));
    browser.until("document.querySelector('.dark-note')?.checkVisibility()");
    browser.until("document.querySelector('#preview')?.naturalWidth > 0");
    assert!(black());
    browser.click("#light");
    browser.until(
        "document.querySelector('#light').textContent === 'Light off' && !document.querySelector('#light').disabled",
    );
    // Without stretch, the picture has the camera's black and white.
    let [stretched, raw] = ["true", "false"]
        .map(|on| service.get(&format!("/api/v1/devices/camera/preview.png?stretch={on}")).expect(200));
    assert!(stretched.body != raw.body);
}

//! Every page of the service in headless Chromium: whether people can use it who see, hear or point otherwise, what it weighs, and whether it
//! stands still.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

use nacre_tests::chromium::Browser;
use nacre_tests::http::{Service, begin, finished, plan};
use nacre_tests::{Place, nacre};
use serde_json::json;
use std::time::Duration;

/// Most bytes of a first load without data.
const WEIGHT: u64 = 500_000;

/// Largest sum of layout shifts, as the web's vitals count them.
const SHIFT: f64 = 0.1;

#[test]
fn every_page_is_accessible_light_and_stands_still() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", "camera = { width = 96, height = 96 }");
    nacre(["chart", "frames", "--quick", "--out", &place.text("data/charts/today")]).expect(0);
    let service = Service::start(&place, &[]);
    let url = format!("http://{}", service.address);

    browser.open(&format!("{url}/#/bench"));
    browser.until("document.querySelector('#preview')?.naturalWidth > 0");
    let weight = browser.run(
        "return performance.getEntriesByType('resource').filter((e) => !e.name.includes('/api/')).concat(performance.getEntriesByType('navigation'))
            .reduce((sum, e) => sum + e.encodedBodySize + 300, 0)",
    );
    println!("first load: {weight} bytes");
    assert!((100_000..WEIGHT).contains(&weight.as_u64().unwrap()), "{weight}");

    let id = begin(&service, &plan(4, 10.0));
    finished(&service, &id);
    service.until(&format!("/api/v1/sessions/{id}"), |s| s["has_results"] == true);
    let job =
        service.post("/api/v1/reconstructions", &json!({ "session": id, "model": "sinusoid" })).expect(202).json();
    let job = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
    service.until(&job, |j| j["state"] == "done");
    // Each with what is there once it has all come.
    let pages = [
        ("bench".to_owned(), "document.querySelector('#preview')?.naturalWidth > 0"),
        ("new".into(), "/\\d/.test(document.querySelector('#estimate').textContent)"),
        ("sessions".into(), "document.querySelector('.card img')?.naturalWidth > 0"),
        ("results".into(), "document.querySelector('.card img')?.naturalWidth > 0"),
        ("charts".into(), "document.querySelectorAll('.study .mark').length > 20"),
        ("upload".into(), "document.querySelector('#upload-start')"),
        ("calibrate".into(), "document.querySelector('#board-make')"),
        ("render".into(), "document.body.innerText.includes('Rolled sheet')"),
        (format!("session/{id}"), "document.querySelector('#session-state').textContent.includes('inished')"),
        (format!("result/{id}"), "document.querySelector('a[data-download=npy]')"),
        (format!("view/{id}?quality=0.03"), "document.querySelector('#view').viewer.painter.count > 0"),
    ];
    for (page, there) in &pages {
        browser.open("about:blank");
        browser.open(&format!("{url}/#/{page}"));
        browser.until(there);
        browser.run(
            "window.shift = 0; new PerformanceObserver((list) => list.getEntries().filter((e) => !e.hadRecentInput)
                .forEach((e) => { window.shift += e.value; })).observe({ type: 'layout-shift', buffered: true })",
        );
        std::thread::sleep(Duration::from_millis(300));
        let shift = browser.run("return window.shift").as_f64().unwrap();
        println!("{page}: layout shift {shift:.3}");
        assert!(shift < SHIFT, "{page}: the layout shifts by {shift}");
        for theme in ["light", "dark"] {
            browser.run(&format!("document.documentElement.dataset.theme = '{theme}'"));
            // Colours change in 0.12 s.
            std::thread::sleep(Duration::from_millis(250));
            let found = browser.run(include_str!("accessible.js"));
            assert_eq!(found[0], json!([]), "{page}, {theme}");
            assert!(found[1].as_u64() > Some(10) && found[2].as_u64() > Some(10), "{page} was not there: {found}");
        }
    }
    // A result is found by words, and deleted when that is confirmed.
    browser.open("about:blank");
    browser.open(&format!("{url}/#/results"));
    browser.until("document.querySelector('.card img')?.naturalWidth > 0");
    browser.both("results");
    let search = |words: &str| {
        browser.run(&format!(
            "const s = document.querySelector('#search'); s.value = '{words}'; s.dispatchEvent(new Event('input'))"
        ));
    };
    search("no such thing");
    browser.until("document.body.innerText.includes('No result matches')");
    search("POLAR");
    browser.click(".card button[aria-label^=Delete]");
    browser.until("document.querySelector('dialog[open]')?.innerText.includes('gone for good')");
    browser.click("dialog[open] button.danger");
    browser.until("!document.querySelector('.card')");
    service.get(&job).expect(404);
}

#[test]
fn what_is_wrong_is_found() {
    let Some(browser) = Browser::start() else { return };
    browser.open("data:text/html,<h1>A</h1><h3>B</h3><p style='color:%23999;background:%23fff'>faint</p><input><img src='x'><button id='a' style='width:9px;padding:0'></button><p id='a'>x</p><a href='/' style='outline:0'>link</a><label for='none'>l</label>");
    let found = browser.run(include_str!("accessible.js"))[0].to_string();
    for word in [
        "level 3",
        "contrast 2.8",
        "has no label",
        "no alt",
        "has no name",
        "occurs twice",
        "9 by",
        "does not show",
        "label of nothing",
    ] {
        assert!(found.contains(word), "{word} is not found: {found}");
    }
}

#[test]
fn a_study_is_read_by_keyboard() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", "camera = { width = 64, height = 64 }");
    nacre(["chart", "frames", "--quick", "--out", &place.text("data/charts/today")]).expect(0);
    let service = Service::start(&place, &[]);
    browser.open(&format!("http://{}/#/charts", service.address));
    browser.until("document.querySelectorAll('.study .mark').length > 20");
    browser.run("document.querySelector('.mark[tabindex=\"0\"]').focus()");
    let press = |key: &str| {
        let actions = json!([{ "type": "keyDown", "value": key }, { "type": "keyUp", "value": key }]);
        browser.call("POST", "/actions", &json!({ "actions": [{ "type": "key", "id": "keys", "actions": actions }] }));
        browser.run("return document.querySelector('.detail').innerText").as_str().unwrap().to_owned()
    };
    // Arrow right, and back: another setting each.
    let [second, first] = ["\u{E014}", "\u{E012}"].map(press);
    assert!(first != second && first.contains("Wrong and confident") && first.contains("quartiles"), "{first}");
    // The numbers are those of the study's own file.
    let study = service.get("/api/v1/charts/today/frames/frames.json").expect(200).json();
    let fastest = study["points"].as_array().unwrap().iter().filter(|p| p["scene"] == study["reference"]);
    let fastest = fastest
        .min_by(|a, b| a["seconds"]["median"].as_f64().unwrap().total_cmp(&b["seconds"]["median"].as_f64().unwrap()));
    let fastest = fastest.unwrap();
    let setting = &study["settings"][fastest["setting"].as_u64().unwrap() as usize];
    assert!(first.contains(setting["label"].as_str().unwrap()), "{first}\n{setting}");
    let error = fastest["error"]["median"].as_f64().unwrap();
    let digits = (2.0 - error.log10().floor()).max(0.0) as usize;
    assert!(first.contains(&format!("{error:.digits$} °")), "{first}\n{error}");
    browser.both("charts");

    // A chart is found by words, and a folder of them deleted when that is confirmed.
    let search = |words: &str| {
        browser.run(&format!(
            "const s = document.querySelector('#search'); s.value = '{words}'; s.dispatchEvent(new Event('input'))"
        ));
    };
    search("no such thing");
    browser.until("document.body.innerText.includes('No chart matches')");
    search("ANGLES");
    browser.until("!document.querySelector('.charts > section').hidden");
    browser.click("button[aria-label^=Delete]");
    browser.until("document.querySelector('dialog[open]')?.innerText.includes('gone for good')");
    browser.click("dialog[open] button.danger");
    browser.until("document.body.innerText.includes('No charts yet')");
    service.get("/api/v1/charts/today/deletion").expect(404);
}

#[test]
fn a_camera_is_calibrated_step_by_step() {
    let Some(browser) = Browser::start() else { return };
    let Some(data) = nacre_tests::test_data() else { return };
    let place = Place::with_bench("", "camera = { width = 96, height = 96 }");
    let service = Service::start(&place, &[]);
    let url = format!("http://{}", service.address);
    browser.open(&format!("{url}/#/calibrate"));
    let closed = "document.querySelector('#board-photographs').closest('.stack').hidden";
    browser.until(closed);
    let set = |id: &str, value: &str| {
        browser.run(&format!(
            "const e = document.querySelector('#{id}'); e.value = '{value}'; e.dispatchEvent(new Event('input', {{ bubbles: true }}))"
        ));
    };
    // A row that cannot be right keeps the next step closed.
    set("board-measured", "200");
    browser.until("document.body.innerText.includes('the row is off by 20')");
    assert_eq!(browser.run(&format!("return {closed}")), true);
    set("board-measured", "251");
    browser.until("document.body.innerText.includes('a square is 25.100 mm')");
    // The driver takes no path with a step back.
    let folder = data.join("calibration").canonicalize().unwrap();
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().flatten().map(|e| e.path()).collect();
    files.retain(|f| f.extension().is_some_and(|e| e == "jpg"));
    files.sort();
    let names: Vec<_> = files.iter().map(|f| f.display().to_string()).collect();
    browser.attach("#board-photographs", &names[..2].join("\n"));
    browser.until("document.body.innerText.includes('2 of at least 3')");
    browser.attach("#board-photographs", &names[2..].join("\n"));
    browser.until("document.querySelectorAll('.thumbs li').length > 10");
    browser.choose("place-which", "left03.jpg");
    accessible(&browser, "calibrate, all steps");
    browser.both("calibrate");
    browser.run("window.scrollTo(0, 0)");
    browser.click("#calibrate-start");
    browser.until("document.querySelector('#geometry')");
    accessible(&browser, "calibrated");
    browser.both("calibrated");
    let text = browser.run("return document.querySelector('main').innerText");
    let text = text.as_str().unwrap();
    for words in [
        "can be used",
        "13 of 13",
        "Focal length",
        "known to 0.1",
        "as the board in left03.jpg",
        "corners of the picture",
    ] {
        assert!(text.contains(words), "no “{words}” in: {text}");
    }
    // The chosen photograph is where the sample is.
    let id = browser.run("return location.hash.split('/').pop()");
    let job = service.get(&format!("/api/v1/reconstructions/{}", id.as_str().unwrap())).expect(200).json();
    assert!(job["report"]["photographs"][0]["file"].as_str().unwrap().contains("left03"), "{job}");
}

#[test]
fn a_stopped_session_says_what_to_do() {
    let Some(browser) = Browser::start() else { return };
    let bench = "camera = { width = 64, height = 48 }\nfaults = [{ device = \"stage\", kind = \"lost\", after = 6 }]";
    let place = Place::with_bench("", bench);
    let service = Service::start(&place, &[]);
    let url = format!("http://{}", service.address);
    let id = begin(&service, &plan(8, 10.0));
    service.until(&format!("/api/v1/sessions/{id}"), |s| !s["error"].is_null() && s["stage"].is_null());
    let session = service.get(&format!("/api/v1/sessions/{id}")).expect(200).json();
    println!("{}", session["fault"]);
    assert_eq!(session["fault"]["class"], "lost");
    browser.open(&format!("{url}/#/session/{id}"));
    browser.until("document.querySelector('.remedy:not([hidden]) .todo')");
    let text = browser.run("return document.querySelector('.remedy').innerText");
    let text = text.as_str().unwrap();
    for key in ["device", "command", "expected", "got"] {
        let words = session["fault"][key].as_str().unwrap();
        assert!(text.contains(words), "no “{words}” in: {text}");
    }
    browser.click("#remedy-check");
    browser.until("document.querySelector('.remedy [role=status]').innerText.includes('camera answers')");
    accessible(&browser, "stopped");
    browser.both("stopped");
    browser.click("#remedy-dark");
    browser.until("document.querySelector('#notices').innerText.includes('All light is off')");
    browser.click("#remedy-resume");
    browser.until("document.querySelector('.log').innerText.includes('again after') || document.querySelector('.log').innerText.includes('stopped')");
}

/// Nothing keeps people from using what is shown, in light and dark.
fn accessible(browser: &Browser, what: &str) {
    for theme in ["light", "dark"] {
        browser.run(&format!("document.documentElement.dataset.theme = '{theme}'"));
        std::thread::sleep(Duration::from_millis(250));
        let found = browser.run(include_str!("accessible.js"));
        assert_eq!(found[0], json!([]), "{what}, {theme}");
    }
}

//! All pages of the service in headless Chromium: accessibility, size, and layout stability.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

use nacre_processing::geometry::{Camera, Geometry, Pose};
use nacre_tests::chromium::Browser;
use nacre_tests::http::{Service, begin, finished, plan};
use nacre_tests::{Place, nacre};
use serde_json::json;
use std::time::Duration;

/// Maximum number of bytes of a first load without data.
const WEIGHT: u64 = 140_000;

/// Maximum number of requests of a first load without data.
const REQUESTS: u64 = 11;

/// Maximum cumulative layout shift, as defined by Web Vitals.
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
    let load = browser.run(
        "const all = performance.getEntriesByType('resource').filter((e) => !e.name.includes('/api/')).concat(performance.getEntriesByType('navigation'));
            return [all.reduce((sum, e) => sum + e.encodedBodySize + 300, 0), all.length, Math.round(performance.getEntriesByType('navigation')[0].domContentLoadedEventEnd)]",
    );
    println!("first load: {} bytes in {} requests, scripts done after {} ms", load[0], load[1], load[2]);
    assert!((50_000..WEIGHT).contains(&load[0].as_u64().unwrap()) && load[1].as_u64().unwrap() <= REQUESTS, "{load}");

    let id = begin(&service, &plan(4, 10.0));
    finished(&service, &id);
    service.until(&format!("/api/v1/sessions/{id}"), |s| s["has_results"] == true);
    let job =
        service.post("/api/v1/reconstructions", &json!({ "session": id, "model": "sinusoid" })).expect(202).json();
    let job = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
    service.until(&job, |j| j["state"] == "done");
    // Each page with an element that appears when it is complete.
    let pages = [
        ("bench".to_owned(), "document.querySelector('#preview')?.naturalWidth > 0"),
        ("new".into(), "/\\d/.test(document.querySelector('#estimate').textContent)"),
        ("sessions".into(), "document.querySelector('.card img')?.naturalWidth > 0"),
        ("results".into(), "document.querySelector('.card img')?.naturalWidth > 0"),
        ("trash".into(), "document.body.innerText.includes('The trash is empty')"),
        ("charts".into(), "document.querySelectorAll('.study .mark').length > 20"),
        ("upload".into(), "document.querySelector('#upload-start')"),
        ("calibrate".into(), "document.querySelector('#board-make')"),
        ("calibrate/light".into(), "document.querySelector('#light-geometry')"),
        ("calibrate/panel".into(), "document.querySelector('#panel-light')"),
        ("render".into(), "document.body.innerText.includes('Rolled sheet')"),
        ("queue".into(), "document.body.innerText.includes('Polarization of')"),
        ("settings".into(), "document.querySelector('#limits-limits-trash-days')"),
        ("nowhere".into(), "document.body.innerText.includes('no page at this address')"),
        ("result/01ARZ3NDEKTSV4RRFFQ69G5FAV".into(), "document.body.innerText.includes('This result does not exist')"),
        (format!("session/{id}"), "document.querySelector('#session-state').textContent.includes('inished')"),
        (format!("result/{id}"), "document.querySelector('a[data-download=npy]')"),
        (format!("maps/{id}"), "document.querySelector('a[data-download=npy]')"),
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
            // Colours change within 0.12 s, which a busy browser starts late.
            browser.until("document.getAnimations().every((a) => !(a instanceof CSSTransition))");
            let found = browser.run(include_str!("accessible.js"));
            assert_eq!(found[0], json!([]), "{page}, {theme}");
            assert!(found[1].as_u64() > Some(10) && found[2].as_u64() > Some(10), "{page} was not there: {found}");
        }
        browser.phone(true);
        let found = browser.run(include_str!("accessible.js"));
        assert_eq!(found[0], json!([]), "{page}, phone");
        browser.run("scrollTo(0, 0)");
        let hidden = browser.run(
            "return [...document.querySelectorAll('.nav a, #service a, #settings, #theme, #stop')].filter((e) => {
                const { left, top, right, bottom } = e.getBoundingClientRect();
                return !e.contains(document.elementFromPoint((left + right) / 2, (top + bottom) / 2));
            }).map((e) => e.innerText)",
        );
        assert_eq!(hidden, json!([]), "{page}: navigation is hidden on a phone");
        browser.phone(false);
    }
    // A result is found by words, and deleted.
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
    // Arrow right, and back: another setting each time.
    let [second, first] = ["\u{E014}", "\u{E012}"].map(press);
    assert!(first != second && first.contains("Wrong and confident") && first.contains("quartiles"), "{first}");
    // The numbers equal those of the study's file.
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

    // A chart is found by words, and a folder of charts is deleted after confirmation.
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
    // An implausible value keeps the next step closed.
    set("board-measured", "200");
    browser.until("document.body.innerText.includes('the row is off by 20')");
    assert_eq!(browser.run(&format!("return {closed}")), true);
    set("board-measured", "251");
    browser.until("document.body.innerText.includes('a square is 25.100 mm')");
    // The driver accepts no path with `..`.
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
    // The chosen photograph determines the pose of the sample.
    let id = browser.run("return location.hash.split('/').pop()");
    let job = service.get(&format!("/api/v1/reconstructions/{}", id.as_str().unwrap())).expect(200).json();
    assert!(job["report"]["photographs"][0]["file"].as_str().unwrap().contains("left03"), "{job}");
}

/// A camera half a metre above a sample, slightly tilted, and a light. Its mirror images at two heights are simulated
/// from geometry, and the wizard determines its position and wavelength from photographs.
#[test]
fn a_light_is_calibrated_step_by_step() {
    let Some(browser) = Browser::start() else { return };
    let camera = Camera { focal_px: [900.0; 2], center_px: [319.5, 239.5], distortion: [0.0; 5] };
    let mut geometry = Geometry::new(camera, Pose::from_rotation_vector([3.0, 0.1, 0.0], [4.0, -6.0, 500.0]));
    geometry.image_px = Some([640, 480]);
    let light = [20.0, 35.0, 410.0];
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("geometry.json");
    nacre_processing::geometry::save(&geometry, &file).unwrap();
    let photographs: Vec<String> = [0.0, 120.0]
        .map(|height| {
            // The light's virtual image behind the mirror, projected into the camera.
            let [x, y] = geometry.pixel([light[0], light[1], 2.0 * height - light[2]]).unwrap();
            let lobe = |px: u32, py: u32| {
                let square = (f64::from(px) - x).powi(2) + (f64::from(py) - y).powi(2);
                image::Luma([(900.0 * (-square / 72.0).exp()).min(255.0) as u8])
            };
            let path = dir.path().join(format!("mirror-{height}.png"));
            image::GrayImage::from_fn(640, 480, lobe).save(&path).unwrap();
            path.display().to_string()
        })
        .into();
    std::fs::write(dir.path().join("filter.csv"), "nm,share\n520,0\n530,0.8\n534,0.8\n544,0\n").unwrap();
    std::fs::write(dir.path().join("words.csv"), "nm,share\n520,0\nfive,six\n").unwrap();

    let place = Place::with_bench("", "camera = { width = 96, height = 96 }");
    let service = Service::start(&place, &[]);
    browser.open(&format!("http://{}/#/calibrate/light", service.address));
    let closed = "document.querySelector('#light-photographs').closest('.panel > .stack').hidden";
    browser.until(closed);
    browser.attach("#light-geometry", &photographs[0]);
    browser.until("document.body.innerText.includes('mirror-0.png is no JSON')");
    assert_eq!(browser.run(&format!("return {closed}")), true);
    browser.attach("#light-geometry", &file.display().to_string());
    browser.until("document.body.innerText.includes('focal length 900 pixels, pictures of 640 × 480')");
    browser.attach("#light-photographs", &photographs.join("\n"));
    browser.until("document.body.innerText.includes('heights are alike')");
    let set = |css: &str, value: &str| {
        browser.run(&format!(
            "const e = document.querySelector('{css}'); e.value = '{value}'; e.dispatchEvent(new Event('input', {{ bubbles: true }}))"
        ));
    };
    set("[aria-label*=\"mirror-120\"][type=number]", "120");
    browser.until("document.body.innerText.includes('2 photographs')");
    browser.choose("color-how", "spectra");
    browser.attach("#color-filter", &dir.path().join("words.csv").display().to_string());
    browser.until("document.body.innerText.includes('no two numbers in row 3')");
    browser.attach("#color-filter", &dir.path().join("filter.csv").display().to_string());
    browser.until("document.body.innerText.includes('1 spectrum')");
    accessible(&browser, "calibrate light, all steps");
    browser.both("calibrate-light");
    browser.click("#light-start");
    browser.until("document.querySelector('#geometry')");
    accessible(&browser, "light calibrated");
    browser.both("calibrated-light");
    let text = browser.run("return document.querySelector('main').innerText");
    let text = text.as_str().unwrap();
    for words in ["mirror-120.png at", "Place of the light", "532.0 nm", "wide at half its height", "This calibration"]
    {
        assert!(text.contains(words), "no “{words}” in: {text}");
    }
    let id = browser.run("return location.hash.split('/').pop()").as_str().unwrap().to_owned();
    let job = service.get(&format!("/api/v1/reconstructions/{id}")).expect(200).json();
    let found = &job["report"]["geometry"];
    let off = (0..3).map(|k| (found["light_mm"][k].as_f64().unwrap() - light[k]).powi(2)).sum::<f64>().sqrt();
    let sigma = (0..3).map(|k| found["sigma"]["light_mm"][k].as_f64().unwrap().powi(2)).sum::<f64>().sqrt();
    println!("the light is {off:.2} mm off, σ {sigma:.2} mm");
    assert!(off < 3.0 * sigma && sigma < 20.0, "{found}");
    assert!((found["wavelength_nm"].as_f64().unwrap() - 532.0).abs() < 0.2, "{found}");
    // Invalid requests are also rejected over REST; a wavelength requires no photographs.
    let ask = |options: serde_json::Value| {
        service.post("/api/v1/reconstructions", &json!({ "method": "calibrate", "options": options }))
    };
    let known = serde_json::to_value(&geometry).unwrap();
    for (options, words) in [
        (json!({}), "no photographs"),
        (json!({ "geometry": known }), "as it is"),
        (json!({ "geometry": known, "wavelength_nm": 5 }), "200 to 2000"),
        (json!({ "geometry": known, "lamp": "A" }), "narrow band"),
        (json!({ "geometry": known, "lamp": "/etc/passwd", "filter": [[500, 1], [600, 1]] }), "lamp"),
        (json!({ "geometry": known, "filter": [[600, 1], [500, 1]] }), "rise"),
        (json!({ "geometry": known, "highlights": [{ "file": "../x.png" }], "light_height_mm": [300, 5] }), "x.png"),
        (json!({ "geometry": known, "highlights": [{ "pixel": [3, 4] }] }), "fewer than two"),
        (json!({ "highlights": [{ "pixel": [3, 4] }], "light_height_mm": [300, 5] }), "no camera"),
        (json!({ "geometry": known, "wavelength_nm": 532, "colour": 3 }), "colour"),
    ] {
        let problem = ask(options.clone()).expect(400).text();
        assert!(problem.contains(words), "{options}: {problem}");
    }
    let picked = json!({ "geometry": known, "highlights": [{ "pixel": [330, 250] }], "light_height_mm": [300, 5], "wavelength_nm": 500 });
    let id = ask(picked).expect(202).json()["id"].as_str().unwrap().to_owned();
    let job = service.until(&format!("/api/v1/reconstructions/{id}"), |j| j["state"] == "done");
    assert_eq!(job["report"]["geometry"]["wavelength_nm"], 500.0, "{job}");
    assert!((job["report"]["geometry"]["light_mm"][2].as_f64().unwrap() - 300.0).abs() < 1.0, "{job}");
}

#[test]
fn a_panel_is_measured_step_by_step() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", "camera = { width = 96, height = 96 }\n[panel]\ngamma = 1.8\n");
    let service = Service::start(&place, &[]);
    let url = format!("http://{}", service.address);
    assert_eq!(service.get("/api/v1/devices/display/measurement").expect(200).json()["state"], "none");
    let measure = |levels: u32| service.post("/api/v1/devices/display/measure", &json!({ "levels": levels }));
    assert!(measure(7).expect(400).text().contains("whole codes"));
    browser.open(&format!("{url}/#/calibrate/panel"));
    let closed = "document.querySelector('#panel-start').closest('.panel > .stack').hidden";
    browser.until(closed);
    browser.click("#panel-light");
    browser.until("document.body.innerText.includes('gets brighter by')");
    browser.until("document.querySelector('#preview')?.naturalWidth > 0");
    accessible(&browser, "calibrate panel, all steps");
    browser.both("calibrate-panel");
    browser.click("#panel-start");
    browser.until("document.querySelector('#panel-save')");
    accessible(&browser, "panel measured");
    browser.both("calibrated-panel");
    let text = browser.run("return document.querySelector('#panel-result').innerText");
    let text = text.as_str().unwrap();
    for words in ["to the power 1.8", "every frame showed", "spots.fringes.gamma = 1.8", "This calibration"] {
        assert!(text.contains(words), "no “{words}” in: {text}");
    }
    // The measurement is found on return; the light is off, and the bench is free.
    browser.open("about:blank");
    browser.open(&format!("{url}/#/calibrate/panel"));
    browser.until("document.querySelector('#panel-save')");
    let found = service.get("/api/v1/devices/display/measurement").expect(200).json();
    assert_eq!((&found["state"], &found["progress"]), (&json!("done"), &json!(1.0)), "{found}");
    let devices = service.until("/api/v1/devices", |d| d["activity"] == "idle");
    assert_eq!(devices["display"]["pattern"], "black", "{devices}");
    // STOP ends a measurement.
    measure(86).expect(202);
    service.post("/api/v1/stop", &json!({})).expect(200);
    let ended = service.until("/api/v1/devices/display/measurement", |m| m["state"] != "running");
    assert!(["stopped", "done"].contains(&ended["state"].as_str().unwrap()), "{ended}");
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

/// Asserts that a page is accessible in light and dark theme.
fn accessible(browser: &Browser, what: &str) {
    for theme in ["light", "dark"] {
        browser.run(&format!("document.documentElement.dataset.theme = '{theme}'"));
        // Colours change gradually.
        browser.until("document.getAnimations().every((a) => a.playState !== 'running')");
        let found = browser.run(include_str!("accessible.js"));
        assert_eq!(found[0], json!([]), "{what}, {theme}");
    }
}

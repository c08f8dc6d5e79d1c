//! Results under a light in headless Chromium: comparison, measurement, rotation, and export to a file that opens from
//! disk.

#![allow(clippy::unwrap_used, clippy::print_stdout)]

use image::RgbImage;
use nacre_tests::Place;
use nacre_tests::chromium::Browser;
use nacre_tests::http::{Service, begin, finished, plan};
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

const VIEW: &str = "document.querySelector('#view').viewer";

/// Waits for all samples of a small picture, because software rendering is slow.
fn settle(browser: &Browser) {
    browser.until(VIEW);
    browser.run("for (const c of document.querySelectorAll('canvas.view')) { c.style.minHeight = 0; } \
                 const v = document.querySelector('#view').style; v.width = v.height = '180px'; v.justifySelf = 'start'; v.alignSelf = 'start'; \
                 document.querySelector('.viewwell').style.width = '180px';");
    browser.until("document.querySelector('#view').width === 180 && document.querySelector('#view').height === 180");
    browser.run(&format!("{VIEW}.change({{ quality: 0.03 }}, false)"));
    drawn(browser);
}

fn drawn(browser: &Browser) {
    browser.until(&format!("{VIEW}.painter.count >= {VIEW}.enough()"));
}

/// Screenshot of the view.
fn screen(browser: &Browser) -> RgbImage {
    let shot = browser.element_shot("#view");
    image::load_from_memory(&shot).unwrap().to_rgb8()
}

fn lit(picture: &RgbImage) -> f64 {
    let lit = picture.pixels().filter(|p| p.0.iter().any(|v| *v > 40)).count();
    lit as f64 / f64::from(picture.width() * picture.height())
}

/// Mean difference of parts of two pictures, in levels of 255; columns between fractions of the width.
fn difference(a: &RgbImage, b: &RgbImage, [from, to]: [f64; 2]) -> f64 {
    assert_eq!(a.dimensions(), b.dimensions());
    let columns = (from * f64::from(a.width())) as u32..(to * f64::from(a.width())) as u32;
    let places = columns.flat_map(|x| (0..a.height()).map(move |y| (x, y)));
    let each: Vec<f64> = places
        .flat_map(|(x, y)| (0..3).map(move |c| f64::from(a.get_pixel(x, y)[c].abs_diff(b.get_pixel(x, y)[c]))))
        .collect();
    each.iter().sum::<f64>() / each.len() as f64
}

fn errors(browser: &Browser) -> Vec<Value> {
    let said = browser.call("POST", "/se/log", &json!({ "type": "browser" }));
    said.as_array().unwrap().iter().filter(|entry| entry["level"] == "SEVERE").cloned().collect()
}

/// A click at fractions of the view's width and height.
fn click(browser: &Browser, [x, y]: [f64; 2]) {
    let origin = json!({ "element-6066-11e4-a52e-4f735466cecf": browser.element("#view") });
    let at = |share: f64| (180.0 * (share - 0.5)).round();
    let actions = json!([
        { "type": "pointerMove", "duration": 0, "x": at(x), "y": at(y), "origin": origin },
        { "type": "pointerDown", "button": 0 },
        { "type": "pointerUp", "button": 0 },
    ]);
    let mouse = json!({ "actions": [{ "type": "pointer", "id": "mouse", "actions": actions }] });
    browser.call("POST", "/actions", &mouse);
}

/// A file downloaded by the browser, once it is complete.
fn downloaded(folder: &Path, end: &str) -> std::path::PathBuf {
    let begun = Instant::now();
    loop {
        let files = std::fs::read_dir(folder).unwrap().flatten().map(|e| e.path());
        if let Some(file) = files.into_iter().find(|f| f.to_string_lossy().ends_with(end)) {
            return file;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "no {end} came");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn views_are_drawn_by_webgpu_or_webgl2_as_is_wished() {
    let Some(browser) = Browser::with_webgpu() else { return };
    let place = Place::with_bench("", "camera = { width = 96, height = 96 }");
    let service = Service::start(&place, &[]);
    let id = begin(&service, &plan(4, 10.0));
    finished(&service, &id);
    service.until(&format!("/api/v1/sessions/{id}"), |s| s["has_results"] == true);
    let open = |draw: &str| {
        browser.open("about:blank");
        browser.open(&format!("http://{}/#/view/{id}?pan=10&quality=0.03&{draw}", service.address));
        browser.until(VIEW);
        browser.run(&format!("return {VIEW}.card.way")).as_str().unwrap().to_owned()
    };
    assert_eq!(open("draw=webgl2"), "WebGL2");
    settle(&browser);
    let (translated, there) = (picture(&browser), screen(&browser));
    if open("") != "WebGPU" {
        println!("skipped: {}", browser.run(&format!("return {VIEW}.card.why")));
        return;
    }
    settle(&browser);
    browser.both("view-webgpu");
    let (direct, here) = (picture(&browser), screen(&browser));
    let most = translated.iter().copied().fold(0.0, f64::max);
    let mean = translated.iter().zip(&direct).map(|(a, b)| (a - b).abs() / most).sum::<f64>() / direct.len() as f64;
    let seen = difference(&there, &here, [0.0, 1.0]);
    println!("WebGPU against WebGL2: {mean:.1e} of the brightest, {seen:.3} levels on the screen");
    assert!(lit(&here) > 0.05 && mean < 1e-3 && seen < 0.5, "{mean} {seen}");
    // The page's selection has the same effect, and the link contains it.
    browser.choose("view-draw", "webgl2");
    browser.until(&format!("location.hash.includes('draw=webgl2') && {VIEW}.card.way === 'WebGL2'"));
    assert!(errors(&browser).is_empty(), "{:?}", errors(&browser));
}

#[test]
fn results_are_measured_compared_turned_and_kept_in_a_file() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", "camera = { width = 128, height = 128 }");
    let service = Service::start(&place, &[]);
    let url = format!("http://{}", service.address);
    let id = begin(&service, &plan(8, 10.0));
    finished(&service, &id);
    service.until(&format!("/api/v1/sessions/{id}"), |s| s["has_results"] == true);
    // Half a period of the polarization: another map, and another picture.
    let asked = json!({ "session": id, "method": "polarization", "offset_deg": 50 });
    let other = service.post("/api/v1/reconstructions", &asked).expect(202).json()["id"].as_str().unwrap().to_owned();
    service.until(&format!("/api/v1/reconstructions/{other}"), |j| j["state"] == "done");

    browser.open(&format!("{url}/#/view/{id}?pan=10"));
    settle(&browser);
    let alone = screen(&browser);
    assert!(lit(&alone) > 0.05, "{}", lit(&alone));

    // The sheet's edge lies at the picture's border: 100 of 122.8 mm in frontal view.
    browser.run(&format!("{VIEW}.change({{ pan: 0 }}, false)"));
    drawn(&browser);
    let edge = browser
        .run("const b = document.querySelector('.over .outline').getBBox(); return [b.x, b.y, b.width, b.height]");
    let expected = [0.0928, 0.0928, 0.8144, 0.8144].map(|share| 180.0 * share);
    for (found, expected) in edge.as_array().unwrap().iter().zip(expected) {
        assert!((found.as_f64().unwrap() - expected).abs() < 0.5, "{edge}");
    }

    browser.click("#view-ruler");
    click(&browser, [0.2, 0.8]);
    click(&browser, [0.6, 0.5]);
    let said = browser.run("return document.querySelector('#view-measured').textContent");
    println!("ruler: {said}");
    // 72 by 54 of 180 pixels, each 122.785 / 180 mm: 61.39 mm at 36.87°, with rows counted downwards.
    let words = said.as_str().unwrap();
    let mm: f64 = words.split(' ').next().unwrap().parse().unwrap();
    assert!((mm - 61.39).abs() < 0.3 && words.contains("at 36.9°"), "{words}");
    assert!(words.contains("1000.0 lines/mm, of the assumed period"), "{words}");
    browser.run("document.querySelector('.over .end').focus()");
    browser.call(
        "POST",
        "/actions",
        &json!({ "actions": [{ "type": "key", "id": "keys", "actions": [
        { "type": "keyDown", "value": "\u{E014}" }, { "type": "keyUp", "value": "\u{E014}" } ] }] }),
    );
    assert_ne!(browser.run("return document.querySelector('#view-measured').textContent"), said);
    browser.click("#view-ruler");
    the_picture_moves(&browser);

    // Left of the divider nothing changes; right of it is the other map.
    let before = screen(&browser);
    browser.choose("view-with", &other);
    browser.until("!document.querySelector('.comparing').hidden");
    drawn(&browser);
    browser.run("document.querySelector('.divider').style.visibility = 'hidden'; document.querySelectorAll('.called').forEach((c) => { c.hidden = true; })");
    let both = screen(&browser);
    let [left, right] = [[0.0, 0.49], [0.51, 1.0]].map(|part| difference(&before, &both, part));
    println!("compared: {left:.2} left of the line, {right:.1} right of it");
    assert!(left < 0.5 && right > 5.0, "{left} {right}");
    browser.run("const line = document.querySelector('.divider'); line.style.visibility = ''; line.focus()");
    browser.call(
        "POST",
        "/actions",
        &json!({ "actions": [{ "type": "key", "id": "keys", "actions": [
        { "type": "keyDown", "value": "\u{E010}" }, { "type": "keyUp", "value": "\u{E010}" } ] }] }),
    );
    assert_eq!(browser.run("return document.querySelector('.divider').getAttribute('aria-valuenow')"), "100");
    // The divider's handle covers a small part.
    assert!(difference(&before, &screen(&browser), [0.0, 0.85]) < 0.5);
    browser.until(&format!("location.hash.includes('with={other}') && location.hash.includes('split=100')"));
    browser.choose("view-with", "");

    // Three pictures of a turn, in an archive that another program can read.
    let folder = tempfile::tempdir().unwrap();
    browser.downloads_to(folder.path());
    browser.run("document.querySelector('#turn-count').value = 3");
    browser.click("#turn-start");
    let archive = downloaded(folder.path(), "-turn.zip");
    let unpacked = Command::new("python3").args(["-m", "zipfile", "-e"]).arg(&archive).arg(folder.path()).status();
    assert!(unpacked.unwrap().success());
    let mut frames: Vec<_> = std::fs::read_dir(folder.path()).unwrap().flatten().map(|e| e.path()).collect();
    frames.retain(|f| f.extension().is_some_and(|e| e == "png"));
    frames.sort();
    assert_eq!(frames.len(), 3);
    let frames: Vec<RgbImage> = frames.iter().map(|f| image::open(f).unwrap().to_rgb8()).collect();
    assert!(frames.iter().all(|f| f.dimensions() == (180, 180) && lit(f) > 0.02));
    assert!(
        difference(&frames[0], &frames[1], [0.0, 1.0]) > 3.0 && difference(&frames[1], &frames[2], [0.0, 1.0]) > 3.0
    );
    drawn(&browser);
    assert!(difference(&frames[0], &screen_without_outline(&browser), [0.0, 1.0]) < 0.5);

    // The file opens from disk and shows the same view.
    browser.run(&format!("{VIEW}.change({{ pan: 10, azimuth: 70 }}, false)"));
    drawn(&browser);
    let (shown, numbers) = (screen(&browser), picture(&browser));
    browser.run("window.scrollTo(0, 0)");
    browser.click("#view-export");
    let file = downloaded(folder.path(), ".html");
    assert!(errors(&browser).is_empty());
    same_from_disk(&browser, &file, &shown, &numbers);
}

/// When zoomed in, each edge of the sheet can be moved into view; the point under the pointer stays in place.
fn the_picture_moves(browser: &Browser) {
    let state = |key: &str| browser.run(&format!("return {VIEW}.state.{key}")).as_f64().unwrap();
    let origin = json!({ "element-6066-11e4-a52e-4f735466cecf": browser.element("#view") });
    let drag = |button: u8, [x, y]: [i32; 2]| {
        let actions = json!([
            { "type": "pointerMove", "duration": 0, "x": 0, "y": 0, "origin": origin },
            { "type": "pointerDown", "button": button },
            { "type": "pointerMove", "duration": 50, "x": x, "y": y, "origin": origin },
            { "type": "pointerUp", "button": button },
        ]);
        let mouse = json!({ "actions": [{ "type": "pointer", "id": "mouse", "actions": actions }] });
        browser.call("POST", "/actions", &mouse);
    };
    let keys = |keys: &[&str]| {
        let press = |kind: &str, key: &&str| json!({ "type": kind, "value": key });
        let all: Vec<Value> =
            keys.iter().map(|k| press("keyDown", k)).chain(keys.iter().rev().map(|k| press("keyUp", k))).collect();
        browser.run("document.querySelector('#view').focus()");
        browser.call("POST", "/actions", &json!({ "actions": [{ "type": "key", "id": "keys", "actions": all }] }));
    };
    let wheel = |[x, y]: [i32; 2], by: i32| {
        let turn =
            json!({ "type": "scroll", "x": x, "y": y, "deltaX": 0, "deltaY": by, "duration": 0, "origin": origin });
        let actions = json!({ "actions": [{ "type": "wheel", "id": "wheel", "actions": [turn] }] });
        browser.call("POST", "/actions", &actions);
    };
    // 122.785 mm over 180 pixels.
    let scale = 122.785 / 180.0;
    drag(2, [36, 18]);
    let [x, y] = [state("x"), state("y")];
    assert!((x + 36.0 * scale).abs() < 0.7 && (y - 18.0 * scale).abs() < 0.7, "{x} {y}");
    assert_eq!((state("pan"), state("tilt")), (0.0, 0.0), "the sample turned as well");
    browser.until("location.hash.includes('x=-2')");
    // The outline moves with the picture, and the pointer reads the map drawn there.
    let edge = browser.run("const b = document.querySelector('.over .outline').getBBox(); return [b.x, b.y]");
    let at = |k: usize| edge[k].as_f64().unwrap();
    assert!((at(0) - 16.7 - 36.0).abs() < 1.0 && (at(1) - 16.7 - 18.0).abs() < 1.0, "{edge}");
    keys(&["0"]);
    assert_eq!((state("x"), state("y"), state("zoom")), (0.0, 0.0, 1.0));

    // The corner of the sheet stays under the pointer, up to the maximum zoom.
    for _ in 0..4 {
        wheel([-73, -73], -500);
    }
    assert!(state("zoom") > 39.0, "{}", state("zoom"));
    let edge = browser.run("const b = document.querySelector('.over .outline').getBBox(); return [b.x, b.y]");
    let off = (edge[0].as_f64().unwrap() - 17.0).hypot(edge[1].as_f64().unwrap() - 17.0);
    assert!(off < 25.0, "{edge}");
    let before = state("x");
    keys(&["\u{E009}", "\u{E014}"]);
    assert!(state("x") > before, "Ctrl and an arrow do not move the picture");
    // Panning is limited to the sheet.
    keys(&["0"]);
    for _ in 0..9 {
        drag(2, [80, 0]);
    }
    assert!((state("x") + 50.0).abs() < 1e-6, "{}", state("x"));
    let twice = json!([
        { "type": "pointerMove", "duration": 0, "x": 18, "y": 0, "origin": origin },
        { "type": "pointerDown", "button": 0 }, { "type": "pointerUp", "button": 0 },
        { "type": "pointerDown", "button": 0 }, { "type": "pointerUp", "button": 0 },
    ]);
    browser.call("POST", "/actions", &json!({ "actions": [{ "type": "pointer", "id": "mouse", "actions": twice }] }));
    browser.until(&format!("{VIEW}.state.x === 0"));
    drawn(browser);
}

fn screen_without_outline(browser: &Browser) -> RgbImage {
    browser.run("document.querySelector('.over').style.visibility = 'hidden'");
    let picture = screen(browser);
    browser.run("document.querySelector('.over').style.visibility = ''");
    picture
}

/// Linear sRGB of the picture.
fn picture(browser: &Browser) -> Vec<f64> {
    let values = browser.run(&format!("return {VIEW}.painter.pixels().then((v) => Array.from(v))"));
    values.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

fn same_from_disk(browser: &Browser, file: &Path, shown: &RgbImage, numbers: &[f64]) {
    browser.open(&format!("file://{}", file.display()));
    browser.until(VIEW);
    // A picture appears after the first sample, not only after the last.
    browser.until(&format!("{VIEW}.painter.count >= 1"));
    let first = screen(browser);
    println!("from disk: {:.3} of the screen lit when the first samples are there", lit(&first));
    assert!(lit(&first) > 0.02, "{}", lit(&first));
    settle(browser);
    let most = numbers.iter().copied().fold(0.0, f64::max);
    let off = picture(browser).iter().zip(numbers).map(|(a, b)| (a - b).abs() / most).fold(0.0, f64::max);
    let seen = difference(shown, &screen(browser), [0.0, 1.0]);
    println!("from disk: pixels off by {off:.1e} of the brightest, {seen:.3} levels on the screen");
    assert!(off < 1e-4 && seen < 0.5, "{off} {seen}");
    assert!(errors(browser).is_empty(), "{:?}", errors(browser));
}

//! Calibration on the page, in headless Chromium: the list of calibrations, and the steps of new ones.

#![allow(clippy::unwrap_used)]

use nacre_tests::Place;
use nacre_tests::chromium::Browser;
use nacre_tests::http::{Service, begin};
use serde_json::{Value, json};
use std::fs;

/// A polarizer on a mirror, and an analyser with an error of its zero.
const POLARIZER: &str = "camera = { width = 64, height = 48 }\nsample = { kind = \"polarizer\", turn_deg = 20 }\n\
                         stage = { zero_deg = 33, extinction_ratio = 500 }\n";

/// A mirror, and the panel with its film.
const FILM: &str = "camera = { width = 64, height = 48 }\nsample = { kind = \"mirror\" }\n\
                    panel = { retarder_deg = 48, retardance_deg = 84 }\n";

/// White paper in focus, for a flat field.
const PAPER: &str = "camera = { width = 64, height = 48 }\nsample = { kind = \"paper\" }\n";

/// A grating along 0°, whose orientation is known.
const RULED: &str = "camera = { width = 64, height = 48 }\nsample = { kind = \"ruled\" }\n";

/// A camera out of focus, for even light.
const EVEN: &str = "camera = { width = 64, height = 48, blur_px = 8 }\n";

struct Page {
    browser: Browser,
    service: Service,
}

impl Page {
    fn visit(&self, hash: &str) {
        self.browser.open("about:blank");
        self.browser.open(&format!("http://{}/#/{hash}", self.service.address));
    }

    fn says(&self, css: &str, words: &str) {
        self.browser.until(&format!("document.querySelector('{css}')?.innerText.includes({})", json!(words)));
    }

    fn set(&self, id: &str, value: &str) {
        self.browser.run(&format!(
            "const e = document.getElementById('{id}'); e.value = '{value}'; for (const what of ['input', 'change']) e.dispatchEvent(new Event(what, {{ bubbles: true }}))"
        ));
    }

    /// Checks the light, which opens the step of the first photographs.
    fn light(&self) {
        self.browser.until("document.querySelector('#light')?.innerText === 'Light off'");
        self.browser.until("!document.querySelector('#check-light').disabled");
        self.browser.click("#check-light");
        self.says("#light-said", "Saturated:");
        self.says("#light-said", "The light is suitable.");
        self.browser.until("document.querySelector('#take-first').checkVisibility()");
    }

    /// Takes a series, and waits until all frames are there.
    fn take(&self, series: &str) {
        self.browser.until(&format!("!document.querySelector('#take-{series}').disabled"));
        self.browser.click(&format!("#take-{series}"));
        self.browser.until(&format!(
            "document.querySelector('#take-{series}').innerText === 'Repeat the photographs' && !document.querySelector('#take-{series}').disabled"
        ));
    }

    fn calibrations(&self) -> Value {
        self.service.get("/api/v1/calibrations").expect(200).json()["items"].clone()
    }

    /// Opens the same address at a service with another bench.
    fn on_another_bench(&mut self, place: &Place, bench: &str) {
        let hash = self.browser.run("return location.hash");
        let hash = hash.as_str().unwrap().trim_start_matches("#/").to_owned();
        self.service.signal("TERM");
        self.service.ended();
        fs::write(place.path("bench.toml"), bench).unwrap();
        self.service = Service::start(place, &[]);
        self.visit(&hash);
    }

    /// Takes both series of a calibration, the second one on another bench, and computes the result.
    fn two_series(&mut self, place: &Place, kind: &str, second: &str) {
        self.visit(&format!("calibration/{kind}"));
        self.light();
        self.take("first");
        self.on_another_bench(place, second);
        self.browser.until("document.querySelector('#take-second')?.checkVisibility()");
        self.take("second");
        self.browser.until("document.querySelector('#compute').checkVisibility()");
        self.browser.click("#compute");
    }

    /// Stores the result, and returns the stored calibration.
    fn keep(&self) -> Value {
        self.browser.until("document.querySelector('#keep')");
        self.browser.click("#keep");
        self.says("#calibration-result", "This calibration is stored.");
        self.calibrations()[0].clone()
    }

    fn accessible(&self, name: &str) {
        self.browser.until("document.getAnimations().every((a) => !(a instanceof CSSTransition))");
        assert_eq!(self.browser.run(include_str!("accessible.js"))[0], json!([]), "{name}");
    }
}

fn page(bench: &str, place: &Place) -> Option<Page> {
    fs::write(place.path("bench.toml"), bench).unwrap();
    Some(Page { browser: Browser::start()?, service: Service::start(place, &[]) })
}

/// A simulated polarizer cannot be turned over while the service runs, so both series are those of its front.
#[test]
fn the_analyser_is_calibrated_step_by_step() {
    let place = Place::with_bench("", POLARIZER);
    let Some(page) = page(POLARIZER, &place) else { return };
    let browser = &page.browser;
    page.visit("calibration/analyser");
    page.light();
    page.accessible("first step");
    page.take("first");
    // The address keeps the progress.
    browser.run("location.reload()");
    browser.until("document.querySelector('#take-second')?.checkVisibility()");
    assert!(browser.run("return location.hash").as_str().unwrap().contains("first="));
    browser.both("calibration-analyser");
    page.take("second");
    browser.click("#compute");
    page.says("#calibration-result", "about 20° from the horizontal");
    assert_eq!(browser.run("return document.querySelector('#keep')"), Value::Null);
    page.accessible("refusal");
    // The list leads back to the unfinished calibration.
    page.visit("calibration");
    page.says("[data-calibrate=analyser]", "Continue");
    browser.click("[data-calibrate=analyser]");
    page.says("#calibration-result", "about 20° from the horizontal");
    browser.click("#start-over");
    browser.until("document.querySelector('#check-light') && !location.hash.includes('?')");
}

#[test]
fn the_retarder_is_calibrated_and_stored() {
    let place = Place::with_bench("", FILM);
    let Some(page) = page(FILM, &place) else { return };
    let browser = &page.browser;
    page.visit("calibration/retarder");
    page.light();
    page.take("first");
    browser.click("[data-key=stated]");
    page.set("calibration-panel_deg", "0");
    browser.until("document.querySelector('#compute').checkVisibility()");
    browser.click("#compute");
    page.says("#calibration-result", "Retardance");
    page.says("#calibration-result", "the analyser is not calibrated");
    browser.until("document.querySelector('#calibration-result img:not([hidden])')");
    page.accessible("result");
    browser.both("calibration-retarder");
    page.set("calibration-name", "film of May");
    browser.click("#keep");
    page.says("#calibration-result", "This calibration is stored.");
    let kept = page.calibrations();
    let film = &kept[0]["values"]["retarder"];
    assert_eq!((&kept[0]["name"], kept.as_array().unwrap().len()), (&json!("film of May"), 1));
    let off = |key: &str, truth: f64| (film[key].as_f64().unwrap() - truth).abs();
    assert!(off("azimuth_deg", 48.0) < 1.0 && off("retardance_deg", 84.0) < 1.0, "{film}");
    // A session that uses it names it.
    let plan = json!({ "plan": { "kind": "polarization", "camera": { "exposure_ms": 5 }, "analyser": { "angles_deg": [0, 60, 120] } } });
    page.visit(&format!("session/{}", begin(&page.service, &plan)));
    page.says("[aria-label=Calibrations]", "Retarder");
    // The page of its result has the same report.
    page.visit(&format!("result/{}", kept[0]["reconstruction"].as_str().unwrap()));
    page.says("[aria-label=Report]", "Retardance");
    page.accessible("page of the result");
}

/// The polarizer is turned over, which is another bench.
#[test]
fn the_analyser_is_calibrated_with_both_sides_and_stored() {
    let place = Place::with_bench("", POLARIZER);
    let Some(mut page) = page(POLARIZER, &place) else { return };
    page.two_series(&place, "analyser", &POLARIZER.replace("turn_deg = 20", "turn_deg = -20"));
    page.says("#calibration-result", "Zero");
    page.browser.both("calibration-analyser-result");
    let kept = page.keep();
    let analyser = &kept["values"]["analyser"];
    assert!((analyser["zero_deg"].as_f64().unwrap() - 33.0).abs() < 0.2, "{analyser}");
    assert!((analyser["extinction_ratio"].as_f64().unwrap() / 500.0 - 1.0).abs() < 0.2, "{analyser}");
}

/// Without its film, the panel is another bench.
#[test]
fn the_retarder_is_calibrated_with_the_film_removed() {
    let place = Place::with_bench("", FILM);
    let Some(mut page) = page(FILM, &place) else { return };
    page.two_series(&place, "retarder", &FILM.replace("retardance_deg = 84", "retardance_deg = 0"));
    page.says("#calibration-result", "Retardance");
    let film = page.keep()["values"]["retarder"].clone();
    let off = |key: &str, truth: f64| (film[key].as_f64().unwrap() - truth).abs();
    assert!(
        off("azimuth_deg", 48.0) < 0.5 && off("retardance_deg", 84.0) < 0.5 && off("panel_deg", 0.0) < 0.5,
        "{film}"
    );
}

#[test]
fn a_flat_field_is_measured_and_stored() {
    let place = Place::with_bench("", PAPER);
    let Some(page) = page(PAPER, &place) else { return };
    page.visit("calibration/flat");
    page.light();
    page.take("first");
    page.says("#calibration-result", "The session has stored this calibration.");
    page.browser.until("document.querySelector('#calibration-result img:not([hidden])')");
    page.accessible("flat field");
    page.browser.both("calibration-flat");
    page.browser.phone(true);
    page.browser.both("calibration-flat-phone");
    let kept = page.calibrations();
    assert!(kept[0]["values"]["flat"]["sigma"].as_f64().unwrap() > 0.0, "{kept}");
}

#[test]
fn the_offset_of_orientations_is_stored() {
    let place = Place::with_bench("", RULED);
    let Some(page) = page(RULED, &place) else { return };
    let plan = json!({ "plan": { "kind": "polarization", "name": "ruled", "camera": { "exposure_ms": 5 },
        "analyser": { "angles_deg": [0, 30, 60, 90, 120, 150] }, "reconstruct": { "method": "polarization" } } });
    let session = begin(&page.service, &plan);
    page.service.until(&format!("/api/v1/sessions/{session}"), |s| s["has_results"] == true);
    page.visit("calibration/orientation");
    page.says("#offset-from", "ruled");
    page.browser.click("#compute");
    page.says("main", "State the direction of the grating vector in degrees.");
    page.set("offset-known_deg", "0");
    page.browser.click("#compute");
    page.says("#calibration-result", "Offset");
    page.accessible("offset");
    page.browser.both("calibration-offset");
    let offset = page.keep()["values"]["orientation"].clone();
    assert!(offset["sigma_deg"].as_f64().unwrap() < 1.0, "{offset}");
}

#[test]
fn camera_calibrations_are_listed_and_deleted() {
    let place = Place::with_bench("", EVEN);
    let Some(page) = page(EVEN, &place) else { return };
    let browser = &page.browser;
    page.visit("calibration");
    page.says("[data-kind=camera]", "missing");
    browser.click("[data-calibrate=camera]");
    page.light();
    page.take("first");
    page.says("#calibration-result", "The session has stored this calibration.");
    page.says("#calibration-result", "Read noise");
    page.accessible("camera");
    browser.both("calibration-camera");
    let id = page.calibrations()[0]["id"].as_str().unwrap().to_owned();
    // One that is too old is not in use.
    let record = place.path(&format!("data/calibrations/{id}/record.json"));
    let mut old: Value = serde_json::from_slice(&fs::read(&record).unwrap()).unwrap();
    old["taken"] = json!(old["taken"].as_u64().unwrap() - 100 * 86_400);
    fs::write(&record, old.to_string()).unwrap();
    page.visit("calibration");
    page.says("[data-kind=camera]", "not in use");
    page.says("[data-kind=camera]", "100 days");
    page.accessible("list");
    browser.both("calibrations");
    browser.phone(true);
    page.accessible("list on a phone");
    browser.both("calibrations-phone");
    browser.phone(false);
    browser.click("[data-kind=camera] [aria-label^=Report]");
    page.says("main", "Read noise");
    page.accessible("detail");
    browser.both("calibration-detail");
    page.visit("calibration");
    page.says("[data-kind=camera]", "Read noise");
    browser.click("[data-kind=camera] [aria-label^=Delete]");
    page.says("[data-kind=camera]", "missing");
    browser.click("#notices button:not(.icon)");
    page.says("[data-kind=camera]", "not in use");
    // Orientations need a result first.
    page.visit("calibration/orientation");
    page.says("main", "There is no result with orientations yet.");
    page.accessible("orientation");
}

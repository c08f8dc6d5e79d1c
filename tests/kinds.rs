//! Sessions of fringes, flash and exposures from the form to their results, in headless Chromium.

#![allow(clippy::unwrap_used)]

use nacre_tests::chromium::Browser;
use nacre_tests::http::Service;
use nacre_tests::{Place, nacre};

fn service() -> (Place, Service, String) {
    let place = Place::with_bench("", "camera = { width = 96, height = 96 }");
    let service = Service::start(&place, &[]);
    let url = format!("http://{}", service.address);
    (place, service, url)
}

/// Waits for the results of the session on the page, and opens them.
fn opened(browser: &Browser, service: &Service) {
    browser.until("location.hash.startsWith('#/session/')");
    let id = browser.run("return location.hash.split('/')[2]").as_str().unwrap().to_owned();
    let path = format!("/api/v1/sessions/{id}");
    // Fringes take minutes to simulate on a busy machine; each part of a session has a time limit.
    let taken = |session: &serde_json::Value| session["frames_committed"].as_u64().unwrap();
    service.until(&path, |session| taken(session) > 0);
    service.until(&path, |session| 2 * taken(session) >= session["frames_planned"].as_u64().unwrap());
    service.until(&path, |session| session["state"] == "finished");
    service.until(&path, |session| session["has_results"] == true);
    browser.until("document.querySelector('#open-result') && !document.querySelector('#open-result').hidden");
    browser.click("#open-result");
    browser.until("location.hash.startsWith('#/result/')");
}

#[test]
fn periods_of_a_simulated_sample_are_measured_from_the_form() {
    let Some(browser) = Browser::start() else { return };
    let (_place, service, url) = service();
    browser.open(&format!("{url}/#/new"));
    browser.click("input[name=kind][value=spots]");
    // The default bench stands too far away for the periods of its sample, and the page says so.
    browser.until("/\\d µm/.test(document.querySelector('#reach')?.textContent)");
    browser.enter(&[("plan-fringes", "10"), ("plan-sample", "mosaic")]);
    browser.click("#try-simulated");
    opened(&browser, &service);
    browser.until("document.querySelector('h1').textContent.includes('mosaic')");
    browser.until("document.querySelector('#pixel-shares svg')");
    let resolved = browser.run("return parseFloat(document.querySelector('.figures strong').textContent)");
    assert!(resolved.as_f64().unwrap() > 40.0, "{resolved}");
    browser.until("document.querySelectorAll('#worst-residuals button').length === 5");
    browser.click("#worst-residuals button");
    // The histogram of the periods stands beside their map.
    browser.until("document.querySelector('svg.contrast .bars').getAttribute('d').length > 100");
    browser.until("document.querySelector('svg.contrast').getAttribute('aria-label').includes('Period')");
    browser.both("result-spots");
}

#[test]
fn a_flash_session_needs_no_options() {
    let Some(browser) = Browser::start() else { return };
    let (_place, service, url) = service();
    browser.open(&format!("{url}/#/new"));
    browser.click("input[name=kind][value=flash]");
    browser.choose("plan-exposing", "several");
    browser.enter(&[("plan-exposures_ms", "20, 80"), ("plan-sample", "polygons")]);
    browser.click("#start");
    opened(&browser, &service);
    browser.until("document.querySelector('#hdr-view').width === 96 && !document.querySelector('#exposure').disabled");
    browser.click("#hdr-marks");
    browser.both("result-flash-session");
    // On the page of the session, another result of the same photographs, called by the sample and the task.
    let id = browser.run("return location.hash.split('/')[2]").as_str().unwrap().to_owned();
    browser.open(&format!("{url}/#/session/{id}"));
    browser.until("document.querySelector('#session-forms')");
    browser.run("document.querySelector('#session-forms').open = true");
    browser.click("#session-reconstruct");
    browser.until(&format!("location.hash.startsWith('#/result/') && !location.hash.includes('{id}')"));
    browser.until("document.querySelector('h1')?.textContent === 'Merged exposures of polygons'");
    browser.until("document.querySelector('#hdr-view')?.width === 96");
    let list = service.get("/api/v1/reconstructions").expect(200).json();
    assert!(list["items"].as_array().unwrap().iter().all(|job| job["name"] != "Merged exposures of Flash"), "{list}");
}

#[test]
fn a_folder_of_flash_photographs_describes_itself() {
    let Some(browser) = Browser::start() else { return };
    let (place, _service, url) = service();
    let [scene, photos] = ["sheet.toml", "photos"].map(|name| place.path(name).to_str().unwrap().to_owned());
    std::fs::write(&scene, "tiles = [6, 5]\nwidth = 240\nheight = 184\ncoherence_um = 8\nband_nm = 4\n").unwrap();
    nacre(["sim", "photograph", "tiles", "--scene", &scene, "--out", &photos]).expect(0);
    let files = std::fs::read_dir(&photos).unwrap().flatten().map(|entry| entry.path().display().to_string());
    let wanted = |file: &String| [".png", "/frames.json", "/geometry.json"].iter().any(|end| file.ends_with(end));
    let files: Vec<String> = files.filter(wanted).collect();
    browser.open(&format!("{url}/#/upload"));
    browser.until("document.querySelector('#photographs')");
    browser.attach("#photographs", &files.join("\n"));
    browser.until("document.querySelector('#method').value === 'flash'");
    browser.until("document.querySelector('#described').textContent.startsWith('frames.json and geometry.json')");
    browser.until("document.querySelector('#upload-start').disabled");
    browser.enter(&[
        ("flash-tiles", "6"),
        ("flash-tiles-1", "5"),
        ("flash-size-mm", "178.2"),
        ("flash-size-mm-1", "131.25"),
    ]);
    browser.enter(&[("upload-name", "paper of polygons")]);
    browser.click("#upload-start");
    browser.until("document.querySelector('h1')?.textContent === 'Flash orientation of paper of polygons'");
    browser.until("document.querySelectorAll('#flash-directions circle').length === 5");
    browser.until("document.querySelector('#pixel-shares').textContent.includes('ambiguous')");
    browser.both("result-flash-upload");
}

//! Scenes edited and rendered on the page, in headless Chromium.

#![allow(clippy::unwrap_used)]

use crate::renders::SCENE;
use nacre_tests::Place;
use nacre_tests::chromium::Browser;
use nacre_tests::http::{Service, begin, finished, plan};

/// Changes a field of the page as a person does.
fn enter(browser: &Browser, id: &str, value: &str) {
    browser.run(&format!(
        "const f = document.getElementById('{id}'); f.focus(); f.value = '{value}'; f.dispatchEvent(new Event('change', {{ bubbles: true }}));"
    ));
}

/// Waits until the service has answered an edit and the text of the scene satisfies a condition.
fn until_text(browser: &Browser, condition: &str) {
    browser.until(&format!("((text) => {condition})(document.querySelector('#scene-text').value)"));
}

/// Presses Ctrl (and Shift) with Z.
fn undo(browser: &Browser, again: bool) {
    let shift = if again { "true" } else { "false" };
    browser.run(&format!(
        "document.activeElement.dispatchEvent(new KeyboardEvent('keydown', {{ key: 'z', ctrlKey: true, shiftKey: {shift}, bubbles: true, cancelable: true }}));"
    ));
}

/// On the page, in headless Chromium: a scene of the gallery is edited, drafted, rendered, kept early and edited again.
#[test]
fn a_person_edits_and_renders_a_scene() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", "camera = { width = 64, height = 64 }");
    let service = Service::start(&place, &[]);
    let url = format!("http://{}", service.address);
    browser.open(&format!("{url}/#/render"));
    browser.until("document.querySelectorAll('[data-scene]').length === 10");
    browser.both("render");
    browser.click("[data-scene=cd]");
    browser.until("document.querySelector('#draft')?.naturalWidth === 240");
    let draft = "document.querySelector('#draft').src";
    let first = browser.run(&format!("return {draft}"));

    // A light more, and back and forth.
    browser.choose("add-light", "directional");
    until_text(&browser, "text.split('[[light]]').length === 5");
    browser.until(&format!("{draft} !== {first}"));
    browser.both("render-light");
    enter(&browser, "part-illuminance", "3");
    until_text(&browser, "text.includes('illuminance = 3')");
    undo(&browser, false);
    undo(&browser, false);
    until_text(&browser, "text.split('[[light]]').length === 4");
    assert!(browser.run("return document.querySelector('#undo').disabled").as_bool().unwrap());
    undo(&browser, true);
    until_text(&browser, "text.split('[[light]]').length === 5 && !text.includes('illuminance')");

    // A part that cannot be rendered is named, and its removal heals the scene.
    browser.choose("add-shape", "mesh");
    browser.until("document.querySelector('#scene-problems').innerText.includes('shape[1].file')");
    assert!(browser.run("return document.querySelector('#render-start').disabled").as_bool().unwrap());
    browser.click("#remove-part");
    browser.until("document.querySelector('#scene-problems').innerText === '' && !document.querySelector('#render-start').disabled");

    // A material under another name, with another layer.
    browser.click("[data-place=\"material/sample\"]");
    enter(&browser, "part-name", "disc");
    until_text(&browser, "text.includes('[material.disc.base]') && text.includes('material = \"disc\"')");
    browser.click("[data-place=\"material/disc/diffraction\"]");
    enter(&browser, "part-period-um", "1.2");
    until_text(&browser, "text.includes('period_um = 1.2')");
    browser.choose("part-kind", "grating");
    until_text(&browser, "text.includes('type = \"grating\"') && text.includes('period_um = 1.2')");
    undo(&browser, false);

    // The camera, by numbers, by steps and by the text.
    enter(&browser, "camera-fov", "16");
    browser.choose("camera-size", "180×180");
    browser.click("[aria-label=\"Around to the right\"]");
    until_text(
        &browser,
        "text.includes('fov_deg = 16') && text.includes('width = 180') && !text.includes('position = [0, 0, 500]')",
    );
    browser.until("document.querySelector('#scene-estimate').innerText.includes('At most')");
    enter(&browser, "scene-text", "[camera");
    browser.until("document.querySelector('#scene-problems').innerText.includes('line 1')");
    browser.run("const t = document.querySelector('#scene-text'); t.value = ''; t.dispatchEvent(new Event('change', { bubbles: true }))");
    undo(&browser, false);
    until_text(&browser, "text.includes('height = 180') && text.includes('position = [0, 0, 500]')");
    undo(&browser, true);
    until_text(&browser, "text.includes('height = 180') && !text.includes('position = [0, 0, 500]')");
    browser.both("render-edited");

    enter(&browser, "render-max-error", "0.0001");
    enter(&browser, "render-samples", "1000000");
    browser.click("#render-start");
    browser.until("document.querySelector('#so-far')?.naturalWidth === 180");
    let first = browser.run("return document.querySelector('#so-far').src");
    browser.until(&format!("document.querySelector('#so-far').src !== '{}'", first.as_str().unwrap()));
    browser.until(
        "document.querySelector('.figures').innerText.includes('to go') && document.querySelector('.noise .curve')",
    );
    browser.both("render-progress");
    browser.click("#keep-so-far");
    browser.until("document.querySelector('#result-picture')?.naturalWidth === 180");
    browser.until("document.body.innerText.includes('stopped on request')");
    browser.both("result-render");
    let before = browser.run("return document.querySelector('#result-picture').src");
    browser.run("const s = document.querySelector('#exposure'); s.value = 2; s.dispatchEvent(new Event('input'));");
    browser.until(&format!("document.querySelector('#result-picture').src !== '{}'", before.as_str().unwrap()));
    assert_eq!(browser.run("return document.querySelector('output[for=exposure]').textContent"), "+2.00 stops");

    // The edited scene once more, as it was rendered.
    browser.click("#edit-scene");
    until_text(&browser, "text.includes('[material.disc.base]') && text.includes('fov_deg = 16')");
    assert_eq!(browser.run("return document.querySelector('#render-samples').value"), "1000000");
}

/// On the page: files of one's own, and materials of results.
#[test]
fn a_person_renders_own_files_and_results() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", "camera = { width = 64, height = 64 }");
    let service = Service::start(&place, &[]);
    let url = format!("http://{}", service.address);
    let scene = place.path("foil.toml");
    // A custom scene must not access files outside of its folder.
    browser.open(&format!("{url}/#/render"));
    browser.until("document.querySelector('#scene-files')");
    let foil = SCENE.replace("width = 48", "width = 240").replace("height = 40", "height = 180");
    std::fs::write(&scene, foil.replace("albedo.exr", "/etc/passwd")).unwrap();
    browser.attach("#scene-files", scene.to_str().unwrap());
    browser.click("#scene-open");
    browser.until("document.querySelector('.message')?.innerText.includes('outside')");
    browser.both("render-refused");
    std::fs::write(&scene, foil.replace("\"albedo.exr\"", "[0.1, 0.1, 0.1]")).unwrap();
    browser.attach("#scene-files", scene.to_str().unwrap());
    browser.click("#scene-open");
    browser.until("document.querySelector('#render-max-error')");
    enter(&browser, "render-max-error", "0.05");
    browser.run("document.querySelector('#render-check').click()");
    browser.click("#render-start");
    browser.until("document.querySelector('#result-picture')?.naturalWidth === 240");
    browser.until("[...document.querySelectorAll('.downloads a')].some((a) => a.textContent === 'scene.toml')");
    browser.until("document.body.innerText.includes('sums off by, measured')");
    browser.click("#make-next");
    browser.until("document.querySelector('#render-check')?.checked && location.hash.includes('result')");

    // Results of a session: as a material of a scene, and on a sheet.
    let session = begin(&service, &plan(4, 10.0));
    finished(&service, &session);
    browser.open("about:blank");
    browser.open(&format!("{url}/#/render"));
    browser.click("[data-scene=cd]");
    browser.until(&format!("document.querySelector('option[value=\"{session}\"]')"));
    browser.choose("material-result", &session);
    browser.click("#add-result");
    until_text(&browser, "/maps = \"[a-z0-9-]+\"/.test(text) && text.includes('[material.sample.diffraction]')");
    browser.until("document.querySelector('#scene-problems').innerText === ''");
    browser.click("[data-place=\"shape/0\"]");
    let name = browser.run("return document.querySelector('#scene-text').value.match(/maps = \"([a-z0-9-]+)\"/)[1]");
    browser.choose("part-material", name.as_str().unwrap());
    until_text(&browser, &format!("text.includes('material = \"{}\"')", name.as_str().unwrap()));
    browser.open(&format!("{url}/#/result/{session}"));
    browser.click(&format!("a[href=\"#/render/{session}\"]"));
    browser.until("document.querySelector('#draft')?.naturalWidth > 0");
    browser.both("render-maps");
    enter(&browser, "render-samples", "4");
    browser.click("#render-start");
    browser.until("document.querySelector('#result-picture')?.naturalWidth === 360");
    browser.both("result-render-maps");
}

//! Scenes rendered by the service: uploads, progress, intermediate pictures, results, and rejected input.

#![allow(clippy::unwrap_used)]

use nacre_processing::image::{read_exr, write_exr};
use nacre_tests::chromium::Browser;
use nacre_tests::http::{Answer, Service, begin, finished, plan};
use nacre_tests::{BENCH, Place, listing, nacre};
use serde_json::{Value, json};
use std::time::{Duration, Instant};

const SCENE: &str = "
[camera]
position = [0, 0, 300]
target = [0, 0, 0]
fov_deg = 20
width = 48
height = 40
[[shape]]
type = \"plane\"
size = [80, 80]
material = \"foil\"
[[light]]
type = \"point\"
position = [0, 100, 280]
sigma_mm = 3
[material.foil.base]
albedo = \"albedo.exr\"
[material.foil.diffraction]
type = \"grating\"
period_um = 1.6
orientation_deg = 90
relief = { depth_um = 0.1 }
coherence_um = 20
";

/// A picture of one value except for its first pixel.
fn albedo(place: &Place, first: f32) -> Vec<u8> {
    let path = place.path("albedo.exr");
    write_exr(&path, 8, 8, &["R", "G", "B"], &[], &|_, y, row| {
        row.fill(0.05);
        if y == 0 {
            row[0] = first;
        }
    })
    .unwrap();
    std::fs::read(path).unwrap()
}

fn upload(service: &Service, files: &[(&str, &[u8])]) -> Answer {
    let mut parts: Vec<(&str, &str, &[u8])> = vec![("kind", "", b"scene")];
    parts.extend(files.iter().map(|(name, bytes)| ("file", *name, *bytes)));
    service.upload(&parts)
}

/// Path of a job that renders an upload.
fn rendered(service: &Service, upload: &Value, options: &Value) -> String {
    let asked = json!({ "upload": upload["id"], "method": "render", "options": options });
    let job = service.post("/api/v1/reconstructions", &asked).expect(202).json();
    format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap())
}

fn ended(service: &Service, job: &str) -> Value {
    service.until(job, |r| !["queued", "running"].contains(&r["state"].as_str().unwrap()))
}

#[test]
fn a_scene_is_rendered_as_on_the_command_line() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let albedo = albedo(&place, 0.05);
    let sent = upload(&service, &[("foil.toml", SCENE.as_bytes()), ("albedo.exr", &albedo)]).expect(201).json();
    assert_eq!(sent["files"], 2);
    let job = rendered(&service, &sent, &json!({ "samples": 64, "max_error": 0.2, "check": true, "spectral_nm": 40 }));
    let done = ended(&service, &job);
    assert_eq!((&done["state"], &done["so_far"]), (&json!("done"), &Value::Null), "{done}");

    std::fs::write(place.path("foil.toml"), SCENE).unwrap();
    let [scene, out] = [place.text("foil.toml"), place.text("out.exr")];
    let asked = ["--samples", "64", "--max-error", "0.2", "--check", "--spectral", "40"];
    let told = nacre(["--json", "render", &scene, "--out", &out].into_iter().chain(asked));
    let (report, told) = (&done["report"], told.expect(0).json());
    assert_eq!((&report["spectral"]["bands"], &report["spectral"]["noise"]), (&json!(11), &told["spectral"]["noise"]));
    for key in ["samples", "noise", "size", "materials", "measured_model_error", "predicted_model_error", "warnings"] {
        assert_eq!(report[key], told[key], "{key}");
    }
    assert_eq!(report["settings"]["max_error"], 0.2);
    let file = |name: &str| service.get(&format!("{job}/files/{name}")).expect(200).body;
    std::fs::write(place.path("rest.exr"), file("render.exr")).unwrap();
    let bits = |name: &str| -> Vec<(String, Vec<u32>)> {
        let map = read_exr(&place.path(name)).unwrap();
        map.channels.into_iter().map(|(n, p)| (n, p.iter().map(|v| v.to_bits()).collect())).collect()
    };
    assert!(bits("rest.exr") == bits("out.exr") && bits("out.exr").len() == 15);
    let png = std::fs::read(place.path("out.png")).unwrap();
    assert!(file("render.png") == png && service.get(&format!("{job}/picture.png")).expect(200).body == png);

    // New exposures: brighter, darker, and rejected values.
    let light = |query: &str| {
        let picture = service.get(&format!("{job}/picture.png{query}")).expect(200).body;
        let picture = image::load_from_memory(&picture).unwrap().into_luma8();
        picture.pixels().map(|p| f64::from(p.0[0])).sum::<f64>()
    };
    assert!(light("?stops=-2") < light("") && light("") < light("?stops=2"));
    service.get(&format!("{job}/picture.png?stops=99")).expect(400);
    service.get(&format!("{job}/picture.png?stop=1")).expect(400);
}

#[test]
fn a_picture_is_seen_while_it_is_made_and_given_up() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let scene = SCENE.replace("\"albedo.exr\"", "[0.05, 0.05, 0.05]").replace("width = 48", "width = 160");
    let sent = upload(&service, &[("scene.toml", scene.as_bytes())]).expect(201).json();
    let job = rendered(&service, &sent, &json!({ "samples": 1_000_000, "max_error": 0.00001 }));
    let first = service.until(&job, |r| r["so_far"]["passes"].as_u64() > Some(0));
    let picture = || service.get(&format!("{job}/picture.png")).expect(200).body;
    let early = picture();
    let early = image::load_from_memory(&early).unwrap();
    assert_eq!((early.width(), early.height()), (160, 40));
    let passes = first["so_far"]["passes"].as_u64().unwrap();
    let memory = service.memory();
    let begun = Instant::now();
    let mut seen = vec![passes];
    while seen.len() < 5 {
        let next = service.until(&job, |r| r["so_far"]["passes"].as_u64().is_some_and(|n| n > seen[seen.len() - 1]));
        let so_far = &next["so_far"];
        assert!(so_far["noise"].as_f64().unwrap() > 0.0 && so_far["seconds_left"].as_f64().unwrap() > 0.0, "{next}");
        assert!(so_far["of"].as_u64() >= so_far["passes"].as_u64(), "{next}");
        seen.push(so_far["passes"].as_u64().unwrap());
    }
    // Four more, about a second apart, within the memory of one.
    assert!(begun.elapsed() > Duration::from_millis(2900), "{seen:?} in {:?}", begun.elapsed());
    assert!(service.memory() < memory + 4096, "{memory} {}", service.memory());
    assert!(image::load_from_memory(&picture()).unwrap() != early);
    service.post(&format!("{job}/cancel"), &json!({})).expect(202);
    assert_eq!(ended(&service, &job)["state"], "cancelled");
    assert!(service.get(&format!("{job}/picture.png")).expect(404).text().contains("no picture yet"));
    assert!(listing(&place.path("data/reconstructions")).is_empty());
    // Another one is kept as it is when it is stopped.
    let kept = rendered(&service, &sent, &json!({ "samples": 1_000_000, "max_error": 0.00001 }));
    service.until(&kept, |r| r["so_far"]["noise"].as_f64().is_some());
    service.post(&format!("{kept}/finish"), &json!({})).expect(202);
    let done = ended(&service, &kept);
    assert!(done["state"] == "done" && done["report"]["noise"].as_f64() > Some(0.00001), "{done}");
    assert!(done["report"]["warnings"].to_string().contains("stopped on request"), "{done}");
    let whole = service.get(&format!("{kept}/picture.png")).expect(200).body;
    assert_eq!(image::load_from_memory(&whole).unwrap().width(), 160);
    service.post(&format!("{kept}/finish"), &json!({})).expect(409);
}

#[test]
fn scenes_that_reach_out_or_make_no_sense_are_refused() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let plain = SCENE.replace("\"albedo.exr\"", "[0.05, 0.05, 0.05]");
    let table = "[material.foil.diffraction]\ntype = \"table\"\nfile = \"FILE\"\n";
    let before = plain.split("[material.foil.diffraction]").next().unwrap();
    let secret = place.text("bench.toml");
    for (scene, key, word) in [
        (SCENE.to_owned(), "material.foil.base.albedo", "albedo.exr"),
        (SCENE.replace("albedo.exr", "../../bench.toml"), "material.foil.base.albedo", "outside"),
        (SCENE.replace("albedo.exr", &secret), "material.foil.base.albedo", "outside"),
        (plain.replace("sigma_mm = 3", "spectrum = \"../light.csv\""), "light[0].spectrum", "outside"),
        (plain.replace("sigma_mm = 3", "spectrum = \"/etc/hostname\""), "light[0].spectrum", "outside"),
        (plain.replace("sigma_mm = 3", "spectrum = \"D66\""), "light[0].spectrum", "D66"),
        (plain.replace("period_um = 1.6", "maps = \"..\""), "material.foil.diffraction.maps", "outside"),
        (format!("{before}{}", table.replace("FILE", "a/../../lut.exr")), "material.foil.diffraction.file", "outside"),
        (plain.replace("\"plane\"\nsize = [80, 80]", "\"mesh\"\nfile = \"/dev/zero\""), "shape[0].file", "outside"),
        (plain.replace("[material.foil.base]", "normals = \"x\"\n[material.foil.base]"), "sigma_mm", "normals"),
        (
            plain.replace("[material.foil.base]", "[material.foil]\nnormals = \"./../n.png\"\n[material.foil.base]"),
            "material.foil.normals",
            "outside",
        ),
        (plain.replace("fov_deg", "fov"), "camera.fov", "line"),
        (plain.replace("width = 48", "width = 60000").replace("height = 40", "height = 60000"), "camera", "60000"),
        (plain.replace("\"plane\"", "\"plane"), "scene", "line"),
    ] {
        let answer = upload(&service, &[("scene.toml", scene.as_bytes())]);
        let told = answer.expect(400).json();
        let (detail, data) = (told["detail"].as_str().unwrap(), place.text("data"));
        assert!((detail.contains(key) || key == "sigma_mm") && detail.contains(word), "{key} {word}: {told}");
        assert!(told["remedy"].is_string() && !detail.contains(&data), "{told}");
    }
    for (files, word) in [
        (&[("a.toml", plain.as_bytes()), ("b.toml", plain.as_bytes())][..], "more than once"),
        (&[("a.exr", &b"no picture"[..])][..], "scene"),
        (&[("../a.toml", plain.as_bytes())][..], "not a file name"),
        (&[("a.sh", plain.as_bytes())][..], "not a file name"),
    ] {
        let told = upload(&service, files).expect(400).text();
        assert!(told.contains(word), "{word}: {told}");
    }
    assert!(listing(&place.path("data/uploads")).is_empty());

    // Options are validated at once, contents of files by the job, with messages suitable for the sender.
    let sent = upload(&service, &[("scene.toml", plain.as_bytes())]).expect(201).json();
    for options in
        [json!({ "samples": 0 }), json!({ "max_error": -1 }), json!({ "wavelengths": 1 }), json!({ "keep": "/x" })]
    {
        let asked = json!({ "upload": sent["id"], "method": "render", "options": options });
        service.post("/api/v1/reconstructions", &asked).expect(400);
    }
    let session = json!({ "session": sent["id"], "method": "render" });
    service.post("/api/v1/reconstructions", &session).expect(400);
    let nan = albedo(&place, f32::NAN);
    let sent = upload(&service, &[("scene.toml", SCENE.as_bytes()), ("albedo.exr", &nan)]).expect(201).json();
    let failed = ended(&service, &rendered(&service, &sent, &json!({})));
    let error = failed["error"].as_str().unwrap();
    assert!(failed["state"] == "failed" && error.starts_with("albedo.exr: ") && error.contains("NaN"), "{failed}");
    // A mesh may refer to files, too.
    let mesh = plain.replace("\"plane\"\nsize = [80, 80]", "\"mesh\"\nfile = \"a.gltf\"");
    let gltf = "{\"asset\":{\"version\":\"2.0\"},\"buffers\":[{\"byteLength\":8,\"uri\":\"../../../bench.toml\"}]}";
    let sent = upload(&service, &[("scene.toml", mesh.as_bytes()), ("a.gltf", gltf.as_bytes())]).expect(201).json();
    let failed = ended(&service, &rendered(&service, &sent, &json!({})));
    let error = failed["error"].as_str().unwrap();
    assert!(failed["state"] == "failed" && error.contains("a.gltf") && error.contains("outside"), "{failed}");
}

#[test]
fn scenes_start_from_the_gallery_or_from_a_result() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let sent = |parts: &[(&str, &str, &[u8])]| service.upload(&[&[("kind", "", &b"scene"[..])], parts].concat());
    for (name, files) in [("cd", 1), ("snake-room", 5)] {
        let upload = sent(&[("gallery", "", name.as_bytes())]).expect(201).json();
        assert_eq!(upload["files"], files, "{name}");
        let done = ended(&service, &rendered(&service, &upload, &json!({ "samples": 4 })));
        assert_eq!(done["state"], "done", "{done}");
        assert!(done["report"]["warnings"].to_string().contains("more than the 0.01"), "{done}");
    }
    assert!(sent(&[("gallery", "", b"../cd")]).expect(400).text().contains("kinematic-tile"));

    let twice = [("gallery", "", &b"cd"[..]), ("gallery", "", &b"tv"[..])];
    assert!(sent(&twice).expect(400).text().contains("more than one"));

    let session = begin(&service, &plan(4, 10.0));
    finished(&service, &session);
    let upload = sent(&[("result", "", session.as_bytes())]).expect(201).json();
    let done = ended(&service, &rendered(&service, &upload, &json!({ "samples": 16, "max_error": 0.5 })));
    assert_eq!(done["state"], "done", "{done}");
    // An edited text of that upload, with another material's maps in a subfolder of a copy of it.
    let id = |doc: &Value| doc["id"].as_str().unwrap().to_owned();
    let more = [("upload", "", id(&upload)), ("folder", "", "foil".into()), ("result", "", session.clone())];
    let more = sent(&more.iter().map(|(part, file, value)| (*part, *file, value.as_bytes())).collect::<Vec<_>>());
    let more = more.expect(201).json();
    let path = format!("/api/v1/uploads/{}/scene", id(&more));
    let read = service.get(&path).expect(200).json();
    assert!(read["files"].to_string().contains("foil/orientation.exr") && read["problem"].is_null(), "{read}");
    let mut edited = read["scene"].clone();
    edited["camera"]["width"] = json!(30);
    edited["material"]["sample"]["diffraction"]["maps"] = json!("foil");
    let checked = service.post(&path, &json!({ "scene": edited })).expect(200).json();
    assert!(checked["problem"].is_null() && checked["scene"] == edited, "{checked}");
    let draft =
        service.post(&format!("{path}/draft"), &json!({ "toml": checked["toml"], "side": 20 })).expect(200).body;
    let draft = image::load_from_memory(&draft).unwrap();
    assert_eq!((draft.width(), draft.height()), (1, 20));
    let options = json!({ "samples": 4, "max_error": 1, "scene": checked["toml"] });
    let done = ended(&service, &rendered(&service, &more, &options));
    assert_eq!(done["report"]["size"][0], 30, "{done}");
    let text = service.get(&format!("/api/v1/reconstructions/{}/files/scene.toml", id(&done))).expect(200).text();
    assert_eq!(json!(text), checked["toml"]);
    // Problems are named by key; nothing outside of the upload can be reached.
    for (toml, word) in [("[camera", "line 1"), ("[camera]\nfov = 2", "fov"), ("", "camera")] {
        let checked = service.post(&path, &json!({ "toml": toml })).expect(200).json();
        assert!(checked["problem"].as_str().unwrap().contains(word), "{checked}");
    }
    edited["material"]["sample"]["diffraction"]["maps"] = json!("../x");
    let checked = service.post(&path, &json!({ "scene": edited })).expect(200).json();
    assert!(checked["problem"].as_str().unwrap().contains("outside"), "{checked}");
    service.post(&format!("{path}/draft"), &json!({ "toml": checked["toml"] })).expect(400);
    service.post(&path, &json!({})).expect(400);
    sent(&[("folder", "", b"../x"), ("result", "", session.as_bytes())]).expect(400);
    // The same maps in a custom scene.
    let scene = SCENE
        .replace("\"albedo.exr\"", "[0.05, 0.05, 0.05]")
        .replace("orientation_deg = 90", "maps = \"orientation.exr\"");
    let upload = sent(&[("result", "", session.as_bytes()), ("file", "own.toml", scene.as_bytes())]).expect(201).json();
    let done = ended(&service, &rendered(&service, &upload, &json!({ "samples": 16, "max_error": 0.5 })));
    assert!(done["state"] == "done" && done["report"]["size"] == json!([48, 40]), "{done}");
    sent(&[("result", "", b"../../x")]).expect(404);
    let job = done["id"].as_str().unwrap();
    assert!(sent(&[("result", "", job.as_bytes())]).expect(400).text().contains("orientation.exr"));
}

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

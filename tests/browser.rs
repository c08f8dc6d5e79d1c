//! The page in headless Chromium, with the simulated bench. Screenshots go to `target/screenshots`.

#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

use nacre_tests::chromium::Browser;
use nacre_tests::http::Service;
use nacre_tests::{NEVER, Place, nacre};
use serde_json::{Value, json};
use std::path::Path;
use std::time::{Duration, Instant};

fn service(size: u32) -> (Place, Service, String) {
    let place = Place::with_bench("", &format!("camera = {{ width = {size}, height = {size} }}"));
    let service = Service::start(&place, &[]);
    let url = format!("http://{}", service.address);
    (place, service, url)
}

#[test]
fn a_person_takes_a_session_and_looks_at_its_map() {
    let Some(browser) = Browser::start() else { return };
    let (_place, service, url) = service(256);
    let disc = json!({ "pattern": { "disc": { "center_mm": [0, 0], "diameter_mm": 180 } } });
    service.post("/api/v1/devices/display/show", &disc).expect(200);
    browser.open(&format!("{url}/#/bench"));
    browser.until("document.querySelector('#preview')?.complete !== false && document.querySelector('#preview')");
    browser.click("#jog-plus-10");
    browser.until("Math.abs(parseFloat(document.querySelector('#analyser-deg').textContent) - 10) < 0.2");
    browser.both("bench");
    // Focusing aids report their findings; a drawn ellipse is measured as drawn.
    for aid in ["focus", "clipped", "grid", "region"] {
        browser.click(&format!("#aid-{aid}"));
    }
    browser.until("/Sharpness 1?\\d\\d % .*(middle|stands out)/.test(document.querySelector('#aids').textContent)");
    browser.until("document.querySelector('canvas.aids').width > 100");
    browser.both("bench-aids");
    let drawn = "const [width, height] = [300, 200]; const t = Math.PI / 6;
        const gray = Uint8Array.from({ length: width * height }, (_, i) => {
            const [x, y] = [(i % width) - 180, 90 - Math.floor(i / width)];
            const [a, b] = [(x * Math.cos(t) + y * Math.sin(t)) / 60, (y * Math.cos(t) - x * Math.sin(t)) / 45];
            return a * a + b * b < 1 ? 200 : 20;
        });";
    browser.run(&format!(
        "import('/assets/aids.js').then((m) => {{ {drawn} window.found = {{ ...m.region({{ gray, width, height }}), sharp: m.sharpness({{ gray, width, height }}),
            half: m.sharpness({{ gray: gray.map((v) => v / 2), width, height }}) }}; }})"
    ));
    browser.until("window.found");
    let found = browser.run("return window.found");
    // Stripes do not count as a region.
    browser.run(
        "import('/assets/aids.js').then((m) => { window.none = String(m.region({ gray: Uint8Array.from({ length: 6400 }, (_, i) => (i % 20 < 8 ? 200 : 20)), width: 80, height: 80 })); })",
    );
    browser.until("window.none === 'null'");
    for (key, wanted, within) in
        [("right", 30.5, 0.1), ("up", 9.5, 0.1), ("longer", 120.0, 0.5), ("shorter", 90.0, 0.5), ("turn", 30.0, 0.5)]
    {
        assert!((found[key].as_f64().unwrap() - wanted).abs() < within, "{key}: {found}");
    }
    // Sharpness is independent of the amount of light.
    assert!((found["sharp"].as_f64().unwrap() / found["half"].as_f64().unwrap() - 1.0).abs() < 0.01, "{found}");

    browser.open(&format!("{url}/#/new"));
    browser.until("/\\d/.test(document.querySelector('#estimate').textContent)");
    browser.both("new");
    // Enough frames that the session can still be paused on a busy machine.
    browser.run("const step = document.getElementById('plan-step'); step.value = '6'; step.dispatchEvent(new Event('input', { bubbles: true }));");
    browser.until("document.querySelector('pre[aria-label]').textContent.includes('150')");
    browser.click("#start");
    browser.until("location.hash.startsWith('#/session/')");
    let id = browser.run("return location.hash.split('/')[2]").as_str().unwrap().to_owned();
    browser.until(
        "document.querySelector('#live-map')?.naturalWidth > 0 || document.querySelector('#live-map')?.width > 0",
    );
    browser.click("#pause");
    browser.until("document.querySelector('#session-state').textContent.toLowerCase().includes('paused')");
    browser.both("session");
    browser.click("#resume");
    browser.until("document.querySelector('#session-state').textContent.toLowerCase().includes('finished')");
    service.until(&format!("/api/v1/sessions/{id}"), |s| s["has_results"] == true);

    browser.open(&format!("{url}/#/result/{id}"));
    browser.until("document.querySelector('#result-map') && document.querySelector('a[data-download=npy]')");
    std::thread::sleep(Duration::from_millis(700));
    browser.click("#result-map");
    browser.until("document.querySelectorAll('#pixel-chart circle').length >= 3");
    browser.both("result");
    for kind in ["exr", "png", "csv", "npy"] {
        let link = browser.run(&format!("return document.querySelector('a[data-download={kind}]').href"));
        let path = link.as_str().unwrap().trim_start_matches(&url).to_owned();
        if path.starts_with('/') {
            service.get(&path).expect(200);
        }
    }
    browser.open(&format!("{url}/#/sessions"));
    browser.until(&format!("document.querySelector('a[href*=\"{id}\"]')"));
    browser.both("sessions");
    browser.open(&format!("{url}/#/upload"));
    browser.until("document.querySelector('input[type=file]')");
    browser.both("upload");
}

#[test]
fn a_person_takes_a_bracket_and_looks_at_the_merged_photograph() {
    let Some(browser) = Browser::start() else { return };
    let (_place, service, url) = service(128);
    browser.open(&format!("{url}/#/new"));
    browser.click("input[name=kind][value=exposures]");
    browser.until("!document.querySelector('#plan-step_ev').closest('.field').hidden");
    browser.until("/\\d/.test(document.querySelector('#estimate').textContent)");
    browser.both("new-bracket");
    browser.click("#start");
    browser.until("location.hash.startsWith('#/session/')");
    let id = browser.run("return location.hash.split('/')[2]").as_str().unwrap().to_owned();
    service.until(&format!("/api/v1/sessions/{id}"), |s| s["has_results"] == true);
    browser.open(&format!("{url}/#/result/{id}"));
    browser.until("document.querySelector('#hdr-view').width === 128 && !document.querySelector('#exposure').disabled");
    // Two stops more make the picture brighter.
    let brightness =
        "const c = document.querySelector('#hdr-view'); return c.getContext('2d').getImageData(64, 64, 1, 1).data[0]";
    let before = browser.run(brightness).as_u64().unwrap();
    browser.enter(&[("exposure", "-2")]);
    let after = browser.run(brightness).as_u64().unwrap();
    assert!(after < before, "{before} to {after}");
    browser.until("[...document.querySelectorAll('.downloads a')].some((a) => a.textContent === 'hdr.exr')");
    browser.both("result-hdr");
    // The panel has no zero order, which the page reports in the service's words.
    browser.until("document.querySelector('#lut-scale')");
    browser.run("for (const [id, v] of [['lut-scale', '0.002'], ['lut-size', '128']]) { document.getElementById(id).value = v; }");
    browser.click("#make-next");
    browser.until(&format!("location.hash.startsWith('#/result/') && !location.hash.includes('{id}')"));
    browser.until("document.body.innerText.includes('center')");
}

#[test]
fn a_person_plans_a_spot_scan() {
    let Some(browser) = Browser::start() else { return };
    let (_place, _service, url) = service(64);
    browser.open(&format!("{url}/#/new"));
    browser.click("input[name=kind][value=spots]");
    browser.until("document.querySelector('#plan-angles').closest('fieldset').hidden");
    browser.until("document.querySelector('#plan-spots').closest('.field').hidden");
    browser.run(
        "for (const [id, v] of [['plan-fringes', '5'], ['plan-undecided_percent', '2'], ['spots-wavelength-nm', '560']]) {
            const input = document.getElementById(id);
            input.value = v;
            input.dispatchEvent(new Event('input', { bubbles: true }));
        }",
    );
    browser.until("document.querySelector('#estimate').textContent.includes('at least')");
    browser.until("!document.querySelector('#start').disabled");
    let plan = browser.run("return JSON.parse(document.querySelector('pre[aria-label]').textContent)");
    assert_eq!(
        (&plan["spots"]["fringes"]["count"], &plan["spots"]["fringes"]["until_undecided"]),
        (&5.into(), &0.02.into())
    );
    let made = &plan["reconstruct"];
    assert_eq!((&made["operation"], &made["options"]["wavelength_nm"]), (&"spots".into(), &560.into()), "{plan}");
    browser.both("new-spots");
    // Operations available for a bracket, with their options.
    browser.click("input[name=kind][value=flash]");
    for (method, field) in [("lut", "lut-wavelength-nm"), ("bokeh", "bokeh-psf"), ("flash", "flash-tiles")] {
        browser.choose("plan-method", method);
        browser.until(&format!("document.getElementById('{field}')"));
        if method == "flash" {
            browser.until("document.querySelector('.plan').innerText.includes('Size: the width and height')");
            browser.enter(&[("flash-size-mm", "60"), ("flash-size-mm-1", "60")]);
        }
        browser.until("!document.querySelector('#start').disabled");
        let plan = browser.run("return JSON.parse(document.querySelector('pre[aria-label]').textContent)");
        assert_eq!(plan["reconstruct"]["operation"], method, "{plan}");
        assert!(plan["reconstruct"]["options"].is_object(), "{plan}");
    }
    browser.both("new-flash");
}

/// Simulated photographs: orders of a lattice under a flash, and lines in an out-of-focus highlight.
fn photographs(place: &Place) -> [String; 2] {
    let made = |what: &str, scene: &str, photograph: &str| {
        let [file, out] = [place.path(&format!("{what}.toml")), place.path(what)];
        std::fs::write(&file, scene).unwrap();
        let [file, out] = [file, out].map(|p| p.to_str().unwrap().to_owned());
        nacre(["sim", "photograph", what, "--scene", &file, "--out", &out]).expect(0);
        format!("{out}/{photograph}")
    };
    let bracket = made("flash", "width = 300\nheight = 300\nread_noise_e = 0\nfull_scale_e = 1e7", "frames.json");
    let [merged, frames] = [place.path("merged").to_str().unwrap().to_owned(), bracket];
    nacre(["reconstruct", "hdr", &frames, "--out", &merged]).expect(0);
    [
        format!("{merged}/hdr.exr"),
        made("bokeh", "profile = \"rectangular\"\nperiod_um = 48\nblur_px = 2.2", "photograph.png"),
    ]
}

#[test]
fn a_person_uploads_photographs_of_diffraction() {
    let Some(browser) = Browser::start() else { return };
    let (place, _service, url) = service(128);
    let [orders, highlight] = photographs(&place);
    browser.upload_page(&url, "hdr");
    browser.choose("method", "lut");
    browser.attach("#photographs", &orders);
    browser.until("document.querySelector('#upload-start').disabled && document.body.innerText.includes('Wavelength: that of the filter')");
    browser.enter(&[
        ("lut-wavelength-nm", "680"),
        ("lut-illuminant", "D65"),
        ("lut-scale", "0.002"),
        ("lut-size", "256"),
    ]);
    browser.both("upload-lut");
    browser.click("#upload-start");
    browser.until("document.querySelector('#result-picture')?.naturalWidth === 256");
    browser.until("[...document.querySelectorAll('.downloads a')].some((a) => a.textContent === 'lut.exr')");
    browser.until("document.querySelector('svg path.light')?.getAttribute('d').length > 100");
    browser.until("document.querySelectorAll('#strongest-angles tbody tr').length > 1");
    browser.both("result-lut");
    // Another illuminant, from the same photograph.
    browser.run("document.getElementById('lut-illuminant').value = 'FL2'");
    browser.click("#make-next");
    browser.until("document.body.innerText.includes('FL2, observer')");

    browser.upload_page(&url, "bokeh");
    browser.attach("#photographs", &highlight);
    browser.choose("bokeh-scale", "lines");
    browser.run("for (const [id, v] of [['bokeh-psf-sigma', '2.2'], ['bokeh-scale-lines-per-mm', '20.8333333']]) { document.getElementById(id).value = v; }");
    browser.both("upload-bokeh");
    browser.click("#upload-start");
    browser.until("document.querySelector('#result-picture')?.naturalWidth > 0");
    browser.until("document.body.innerText.includes('48.0')");
    browser.until("document.querySelector('svg path.light')?.getAttribute('d').length > 100");
    browser.both("result-bokeh");

    // A surface under light: an image of heights with a scale given on the page.
    let heights = place.path("heights.png").to_str().unwrap().to_owned();
    let blaze: Vec<u8> = (0..128 * 128).map(|i| (i % 16 * 16) as u8).collect();
    nacre_processing::image::write_png8(Path::new(&heights), 128, 128, 1, &blaze).unwrap();
    browser.upload_page(&url, "brdf");
    browser.attach("#photographs", &heights);
    browser.run("for (const [id, v] of [['brdf-pixel-um', '0.1'], ['brdf-range-um', '0.3'], ['brdf-size', '300']]) { document.getElementById(id).value = v; }");
    browser.both("upload-brdf");
    browser.click("#upload-start");
    browser.until("document.querySelector('#result-picture')?.naturalWidth === 300");
    browser.until("document.body.innerText.includes('1.60 µm')");
    browser.both("result-brdf");
    browser.run("document.getElementById('brdf-settings-reflectance').value = 'gold'");
    browser.click("#make-next");
    browser.until("[...document.querySelectorAll('dd')].some((d) => d.textContent === 'gold')");
}

#[test]
fn a_person_picks_the_corners_of_a_sheet_of_tiles() {
    let Some(browser) = Browser::start() else { return };
    let (place, _service, url) = service(128);
    let [scene, photos] = ["sheet.toml", "photos"].map(|name| place.path(name).to_str().unwrap().to_owned());
    std::fs::write(&scene, "tiles = [6, 5]\nwidth = 300\nheight = 230\ncoherence_um = 8\nband_nm = 4\n").unwrap();
    nacre(["sim", "photograph", "tiles", "--scene", &scene, "--out", &photos]).expect(0);
    let geometry = nacre_processing::geometry::load(Path::new(&format!("{photos}/geometry.json"))).unwrap();
    let mut files: Vec<String> =
        std::fs::read_dir(&photos).unwrap().flatten().map(|e| e.path().display().to_string()).collect();
    files.retain(|f| f.ends_with(".png"));
    browser.upload_page(&url, "flash");
    browser.attach("#photographs", &files.join("\n"));
    browser.attach("#flash-frames", &format!("{photos}/frames.json"));
    browser.enter(&[("flash-tiles", "6"), ("flash-tiles-1", "5"), ("flash-size-mm", "178.2")]);
    browser.enter(&[("flash-size-mm-1", "131.25"), ("flash-camera-mm", "500"), ("upload-name", "polygons")]);
    // The photograph by room light is used for picking.
    let canvas = ".picker:not([hidden]) canvas";
    browser.until(&format!("document.querySelector('{canvas}')?.width === 300"));
    browser.run(&format!("document.querySelector('{canvas}').scrollIntoView({{ block: 'center' }})"));
    let element = browser.element(canvas);
    let half = [0.5 * 178.2, 0.5 * 131.25];
    for [right, up] in [[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]] {
        let [x, y] = geometry.pixel([right * half[0], up * half[1], 0.0]).unwrap();
        let scale = browser.run(&format!(
            "const c = document.querySelector('{canvas}'); return c.getBoundingClientRect().width / c.width;"
        ));
        let at = |v: f64, size: f64| ((v + 0.5 - 0.5 * size) * scale.as_f64().unwrap()).round();
        let origin = json!({ "element-6066-11e4-a52e-4f735466cecf": element });
        let actions = json!([
            { "type": "pointerMove", "duration": 0, "x": at(x, 300.0), "y": at(y, 230.0), "origin": origin },
            { "type": "pointerDown", "button": 0 },
            { "type": "pointerUp", "button": 0 },
        ]);
        browser.call(
            "POST",
            "/actions",
            &json!({ "actions": [{ "type": "pointer", "id": "mouse", "actions": actions }] }),
        );
    }
    browser.until("document.getElementById('flash-corner-3-y').value !== ''");
    // An arrow key moves a handle by a pixel.
    let nudged = browser.run(
        "const [field, handle] = [document.getElementById('flash-corner-0-x'), document.querySelector('.picker:not([hidden]) .pick')];
         const before = field.valueAsNumber;
         for (const key of ['ArrowRight', 'ArrowRight', 'ArrowLeft', 'ArrowLeft', 'ArrowRight', 'ArrowLeft', 'ArrowRight']) handle.dispatchEvent(new KeyboardEvent('keydown', { key }));
         const moved = field.valueAsNumber - before;
         handle.dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowLeft' }));
         return moved",
    );
    assert_eq!(nudged.as_f64().unwrap().round(), 1.0);
    browser.both("upload-flash");
    browser.run("window.scrollTo(0, 0)");
    browser.click("#upload-start");
    browser.until("document.querySelectorAll('#flash-directions tbody tr').length === 5");
    browser.until("document.querySelector('h1').textContent === 'Flash orientation of polygons'");
    // 1.66 µm, within the error of an uncalibrated lens and of picking whole pixels.
    browser.until("/1\\.6[56]\\d ± /.test(document.body.innerText)");
    browser.both("result-flash");
}

#[test]
fn a_person_edits_maps_and_sees_what_foil_and_a_calibration_ask() {
    let Some(browser) = Browser::start() else { return };
    let (place, _service, url) = service(128);
    // A wheel of orientations, and periods that increase to the right.
    let write = |name: &str, channel: &str, value: &(dyn Fn(f32, f32) -> f32 + Sync)| {
        let path = place.path(name);
        nacre_processing::image::write_exr(&path, 240, 160, &[channel], &[], &|_, y, row| {
            row.iter_mut().enumerate().for_each(|(x, v)| *v = value(x as f32 - 119.5, 79.5 - y as f32));
        })
        .unwrap();
        path.display().to_string()
    };
    let files = [
        write("orientation.exr", "orientation", &|x, y| y.atan2(x).rem_euclid(std::f32::consts::PI)),
        write("period.exr", "period", &|x, _| 1.2 + 0.002 * x),
    ];
    for method in ["foil", "calibrate"] {
        browser.upload_page(&url, method);
        browser.both(&format!("upload-{method}"));
    }
    browser.upload_page(&url, "map");
    browser.attach("#photographs", &files.join("\n"));
    browser.run(
        "const set = (id, v) => { const e = document.getElementById('map-' + id); e.value = v; e.dispatchEvent(new Event('change')); };
         set('rotate-deg', 30); set('tile', 2); set('tile-1', 1); set('period', 'sine_squared');
         set('period-sine-squared', 0.8); set('period-sine-squared-1', 1.6);",
    );
    browser.until("document.getElementById('map-period-sine-squared').closest('[hidden]') === null");
    browser.both("upload-map");
    browser.run("window.scrollTo(0, 0)");
    browser.click("#upload-start");
    browser.until("document.querySelector('#result-picture')?.naturalWidth > 0");
    // 240 × 160 rotated by 30° needs 288 × 259, drawn twice side by side.
    browser.until("document.body.innerText.includes('576 × 259')");
    browser.both("result-map");
}

#[test]
fn stop_is_in_reach_and_stops_within_200_ms() {
    let Some(browser) = Browser::start() else { return };
    let (_place, service, url) = service(128);
    let plan = json!({ "plan": { "kind": "polarization", "camera": { "exposure_ms": 300 },
        "analyser": { "angles_deg": [0, 20, 40, 60, 80, 100, 120, 140] } } });
    let id = service.post("/api/v1/sessions", &plan).expect(202).json()["id"].as_str().unwrap().to_owned();
    browser.open(&format!("{url}/#/session/{id}"));
    service.until(&format!("/api/v1/sessions/{id}"), |s| s["frames_committed"].as_u64() > Some(0));
    browser.click("#stop");
    browser.until(
        "performance.getEntriesByType('resource').some(e => e.name.endsWith('/api/v1/stop') && e.responseEnd > 0)",
    );
    let took = browser.run(
        "const e = performance.getEntriesByType('resource').find(e => e.name.endsWith('/api/v1/stop'));
         return e.responseEnd - e.startTime",
    );
    println!("STOP took {took} ms in the browser");
    assert!(took.as_f64().unwrap() < 200.0, "{took} ms");
    service.until(&format!("/api/v1/sessions/{id}"), |s| s["state"] == "idle");
    assert_eq!(service.get("/api/v1/devices").json()["display"]["pattern"], "black");
}

#[test]
fn the_pattern_page_acknowledges_refuses_when_hidden_and_goes_black_in_silence() {
    let Some(browser) = Browser::start() else { return };
    let (_place, service, url) = service(64);
    let show = |pattern: Value| service.post("/api/v1/display/pattern", &json!({ "pattern": pattern }));
    assert!(show(json!({ "kind": "full" })).expect(409).text().contains("/display"));
    browser.open(&format!("{url}/display"));
    service.until("/api/v1/display", |d| d["bound"].is_string());
    let brightness = "const c = document.querySelector('#panel'); const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
        let s = 0; for (let i = 0; i < d.length; i += 4) s += d[i]; return s / (d.length / 4)";
    for (pattern, low, high) in [
        (json!({ "kind": "full" }), 254.0, 255.0),
        (json!({ "kind": "disc", "center_mm": [0, 0], "diameter_mm": 100 }), 1.0, 250.0),
        (json!({ "kind": "edge", "angle_deg": 30, "offset_mm": 0 }), 100.0, 155.0),
        (json!({ "kind": "gradient", "order": 1, "angle_deg": 0 }), 100.0, 155.0),
        (json!({ "kind": "gradient", "order": 2, "angle_deg": 90 }), 1.0, 200.0),
        (json!({ "kind": "radial", "period_mm": 20, "phase_deg": 90 }), 100.0, 155.0),
        (json!({ "kind": "axial", "period_mm": 20, "angle_deg": 45, "phase_deg": 0 }), 100.0, 155.0),
        (json!({ "kind": "spots", "centers_mm": [[0, 0], [40, 40]], "diameter_mm": 30 }), 0.3, 200.0),
        // The size of the screen, which headless Chromium reports as smaller than its window.
        (json!({ "kind": "checkerboard", "square_mm": 10 }), 40.0, 155.0),
    ] {
        let shown = show(pattern.clone()).expect(200).json();
        assert!(shown["acknowledged"] == true && shown["viewport"].is_array(), "{shown}");
        let mean = browser.run(brightness).as_f64().unwrap();
        assert!((low..=high).contains(&mean), "{pattern}: mean {mean}");
        browser.shot(&format!("display-{}", pattern["kind"].as_str().unwrap()));
    }
    show(json!({ "kind": "spots", "centers_mm": [], "diameter_mm": -1 })).expect(400);

    // Another window in front hides the page.
    let first = browser.call("GET", "/window", &Value::Null);
    browser.call("POST", "/window/new", &json!({ "type": "tab" }));
    let handles = browser.call("GET", "/window/handles", &Value::Null);
    let second = handles.as_array().unwrap().iter().find(|h| **h != first).unwrap().clone();
    browser.call("POST", "/window", &json!({ "handle": second }));
    service.until("/api/v1/display", |d| d["visible"] == false);
    assert!(show(json!({ "kind": "full" })).expect(409).text().contains("hidden"));
    browser.call("POST", "/window", &json!({ "handle": first }));
    service.until("/api/v1/display", |d| d["visible"] == true);
    show(json!({ "kind": "full" })).expect(200);

    service.kill();
    let begun = Instant::now();
    while browser.run(brightness).as_f64().unwrap() > 0.0 {
        assert!(begun.elapsed() < NEVER, "still lit without the service");
        std::thread::sleep(Duration::from_millis(50));
    }
    println!("black {:.1} s after the service was killed", begun.elapsed().as_secs_f64());
}

//! Operations offer the same options with the same defaults on the command line, in the OpenAPI document and on the
//! page.

#![allow(clippy::unwrap_used)]

use nacre_processing::fields::Field;
use nacre_processing::image::write_png16_gray;
use nacre_processing::operations::OPERATIONS;
use nacre_tests::chromium::Browser;
use nacre_tests::http::{Service, begin, finished, plan};
use nacre_tests::{BENCH, Place, nacre};
use serde_json::{Value, json};
use std::fs;

/// Commands and the operations from whose options they are derived.
const DERIVED: [(&[&str], &str); 19] = [
    (&["reconstruct", "polarization"], "polarization"),
    (&["reconstruct", "hdr"], "hdr"),
    (&["reconstruct", "stack"], "stack"),
    (&["reconstruct", "lut"], "lut"),
    (&["reconstruct", "bokeh"], "bokeh"),
    (&["reconstruct", "foil"], "foil"),
    (&["reconstruct", "spots"], "spots"),
    (&["reconstruct", "flash"], "flash"),
    (&["brdf", "map"], "brdf"),
    (&["map", "edit"], "map"),
    (&["render"], "render"),
    (&["factor"], "factor"),
    (&["synthesize"], "synthesize"),
    (&["inspect"], "inspect"),
    (&["calibrate", "camera"], "camera"),
    (&["calibrate", "flat"], "flat"),
    (&["calibrate", "analyser"], "analyser"),
    (&["calibrate", "retarder"], "retarder"),
    (&["calibrate", "orientation"], "orientation"),
];

/// Operations on the page's uploads, and options with separate controls.
const UPLOADED: [(&str, &[&str]); 12] = [
    ("polarization", &[]),
    ("hdr", &[]),
    ("stack", &[]),
    ("lut", &["light", "center"]),
    ("bokeh", &[]),
    ("flash", &["corners_px", "reference_px"]),
    ("foil", &[]),
    ("brdf", &[]),
    ("calibrate", &[]),
    ("map", &[]),
    ("factor", &[]),
    ("synthesize", &[]),
];

#[test]
fn command_lines_have_every_option_with_its_default() {
    for (command, name) in DERIVED {
        let operation = OPERATIONS.iter().find(|o| o.name() == name).unwrap();
        let help = nacre(command.iter().copied().chain(["--help"])).expect(0).stdout();
        for field in &operation.fields().list {
            let flag = format!("--{}", field.name());
            let ends = |after: &str| after.starts_with([' ', '\n']);
            let after = help.match_indices(&flag).map(|(at, _)| &help[at + flag.len()..]).find(|after| ends(after));
            let after = after.unwrap_or_else(|| panic!("{name} has no {flag}:\n{help}"));
            // Up to the next flag.
            let own = after.split("\n      --").next().unwrap();
            let own = own.split_whitespace().collect::<Vec<_>>().join(" ");
            let default = field.default().filter(|v| !field.is_flag() && !v.is_object());
            assert_eq!(own.contains("[default: "), default.is_some(), "{name} {flag}: {own}");
            if let Some(default) = default {
                assert!(own.contains(&format!("[default: {}]", typed(default))), "{name} {flag}: {own}");
            }
            assert!(own.chars().filter(|c| c.is_alphabetic()).count() > 20, "{name} {flag} is not described: {own}");
        }
    }
}

/// A value as the command line takes it.
fn typed(value: &Value) -> String {
    match value {
        Value::String(word) => word.clone(),
        Value::Array(all) => all.iter().map(typed).collect::<Vec<_>>().join(","),
        other => other.as_f64().map_or(other.to_string(), |v| v.to_string()),
    }
}

#[test]
fn old_spellings_are_accepted() {
    let place = Place::new("");
    let out = place.text("out");
    // Values out of range, rejected under the new name before any input is read.
    for (old, new, value) in [
        ("--wavelength", "--wavelength-nm", "5"),
        ("--panel", "--panel-mm", "0x300"),
        ("--periods", "--periods-um", "4:2"),
        ("--mirror", "--mirror-deg", "90"),
    ] {
        for flag in [old, new] {
            let run = nacre(["reconstruct", "spots", &place.text("none"), flag, value, "--out", &out]).expect(2);
            assert!(run.stderr().contains(&format!("nacre: {new}:")), "{flag}: {}", run.stderr());
        }
    }
}

#[test]
fn mistakes_are_named_as_flags_and_as_keys() {
    let place = Place::with_bench("", BENCH);
    let wrong = nacre(["--json", "reconstruct", "hdr", ".", "--white", "much", "--out", &place.text("out")]).expect(2);
    assert!(wrong.stderr().contains("--white"), "{}", wrong.stderr());
    let service = Service::start(&place, &[]);
    let upload = uploaded(&service, 3);
    let asked =
        |options: Value| service.post("/api/v1/operations/stack", &json!({ "upload": upload, "options": options }));
    for (options, key) in [
        (json!({ "clip_sigma": 0.1 }), "clip_sigma"),
        (json!({ "clip": 3 }), "clip"),
        (json!({ "clip_sigma": "x" }), "clip_sigma"),
    ] {
        let answer = asked(options);
        assert!((400..500).contains(&answer.status) && answer.text().contains(key), "{}", answer.text());
    }
    let unknown = service.post("/api/v1/operations/stacks", &json!({ "upload": upload })).expect(404);
    assert!(unknown.text().contains("polarization, hdr, stack"), "{}", unknown.text());
}

/// Options must not name arbitrary files of the machine; files of the upload are used.
#[test]
fn options_name_files_of_the_upload_only() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let upload = uploaded(&service, 2);
    let merge = |response: &str| {
        service.post("/api/v1/operations/hdr", &json!({ "upload": upload, "options": { "response": response } }))
    };
    for path in ["/etc/passwd", "../../../etc/passwd", "a/b.json", "none.json"] {
        let refused = merge(path);
        assert!((400..500).contains(&refused.status), "{path}: {}", refused.text());
        assert!(refused.text().contains("was not sent"), "{}", refused.text());
    }
    // A built-in word is not a file: the next error is about the photographs.
    assert!(merge("recover").text().contains("exposure time"));
    // Plans must not name files, either.
    for (method, kind, options, key) in [
        ("lut", "exposures", json!({ "light": { "path": "/etc/passwd" } }), "light.path"),
        ("lut", "exposures", json!({ "illuminant": "/etc/passwd" }), "illuminant"),
        ("bokeh", "exposures", json!({ "psf": { "image": "/etc/passwd" } }), "psf.image"),
        ("spots", "spots", json!({ "polarization": "/etc" }), "polarization"),
    ] {
        let mut plan = json!({ "kind": kind, "exposures_ms": [1.0, 4.0], "spots": { "fringes": { "count": 8, "phases": 4, "finest_mm": 28.0 } },
            "reconstruct": { "operation": method, "options": options } });
        // Each kind of plan accepts only one of the two.
        plan.as_object_mut().unwrap().retain(|name, _| name != if kind == "spots" { "exposures_ms" } else { "spots" });
        let problems = service.post("/api/v1/plans/check", &json!({ "plan": plan })).text();
        assert!(problems.contains(&format!("reconstruct.options.{key}: names the file")), "{key}: {problems}");
    }
}

fn uploaded(service: &Service, count: usize) -> String {
    let place = tempfile::tempdir().unwrap();
    let mut parts: Vec<(&str, String, Vec<u8>)> = vec![("kind", String::new(), b"photographs".to_vec())];
    for k in 0..count {
        let path = place.path().join(format!("{k}.png"));
        let mut codes: Vec<u16> = (0..48 * 32).map(|i| (20_000 + 37 * (i * (k + 3) % 101)) as u16).collect();
        // One outlier in each.
        codes[100 * k] = 60_000;
        write_png16_gray(&path, 48, 32, &codes).unwrap();
        parts.push(("file", format!("{k}.png"), fs::read(&path).unwrap()));
    }
    let parts: Vec<(&str, &str, &[u8])> = parts.iter().map(|(n, f, b)| (*n, f.as_str(), b.as_slice())).collect();
    service.upload(&parts).expect(201).json()["id"].as_str().unwrap().to_owned()
}

#[test]
fn an_operation_runs_through_its_own_path() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    let offered = service.get("/api/v1/operations").expect(200).json();
    assert_eq!(offered.as_array().unwrap().len(), OPERATIONS.len());
    let done = |name: &str, order: &Value| {
        let job = service.post(&format!("/api/v1/operations/{name}"), order).expect(202).json();
        let path = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
        service.until(&path, |j| j["state"] == "done" || j["state"] == "failed")
    };
    let stacked = done("stack", &json!({ "upload": uploaded(&service, 5), "options": { "clip_sigma": null } }));
    assert_eq!((&stacked["method"], &stacked["report"]["photographs"]), (&json!("stack"), &json!(5)), "{stacked}");
    assert_eq!(stacked["report"]["rejected"], 0.0);
    let clipped = done("stack", &json!({ "upload": uploaded(&service, 5) }));
    // Only the outliers are rejected; the tolerance of half a value allows for rounding of the share.
    let rejected = clipped["report"]["rejected"].as_f64().unwrap() * 5.0 * 48.0 * 32.0;
    assert!((rejected - 5.0).abs() < 0.5, "{clipped}");
    let session = begin(&service, &plan(4, 10.0));
    finished(&service, &session);
    let plain = done("polarization", &json!({ "session": session, "options": { "model": "plain" } }));
    assert_eq!(plain["report"]["model"], "plain", "{plain}");
    parts_of_files_are_sent(
        &service,
        &format!("/api/v1/reconstructions/{}/files/aolp.exr", plain["id"].as_str().unwrap()),
    );
    // A request to the old path gives the same result.
    let job =
        service.post("/api/v1/reconstructions", &json!({ "session": session, "model": "plain" })).expect(202).json();
    let path = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
    let old = service.until(&path, |j| j["state"] == "done");
    assert_eq!(old["report"]["pixels"], plain["report"]["pixels"]);
}

fn parts_of_files_are_sent(service: &Service, path: &str) {
    let whole = service.get(path).expect(200);
    let tag = whole.header("ETag").unwrap();
    let asked = |headers: &[&str], status: u16| service.send("GET", path, headers, b"").expect(status);
    let some = asked(&["Range: bytes=4-19"], 206);
    assert_eq!(some.body, whole.body[4..20]);
    assert_eq!(some.header("Content-Range").unwrap(), format!("bytes 4-19/{}", whole.body.len()));
    assert_eq!(asked(&["Range: bytes=-7"], 206).body, whole.body[whole.body.len() - 7..]);
    let other = asked(&["Range: bytes=4-19", "If-Range: \"another\""], 200);
    assert_eq!(other.body.len(), whole.body.len());
    asked(&[&format!("Range: bytes={}-", whole.body.len())], 416);
    assert!(asked(&[&format!("If-None-Match: {tag}")], 304).body.is_empty());
}

/// Keys of the page's controls for an option. A structure that is a list on the command line has one control per value.
fn keys(field: &Field) -> Vec<Vec<String>> {
    let listed = field.schema.get("x-list").and(field.schema.get("properties")).and_then(Value::as_object);
    let inner =
        listed.map(|all| all.keys().map(|key| [field.path.as_slice(), std::slice::from_ref(key)].concat()).collect());
    inner.unwrap_or_else(|| vec![field.path.clone()])
}

#[test]
fn the_page_has_a_control_for_every_option() {
    let Some(browser) = Browser::start() else { return };
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    browser.open(&format!("http://{}/#/upload", service.address));
    browser.until("document.querySelector('#method')");
    for (name, apart) in UPLOADED {
        let operation = OPERATIONS.iter().find(|o| o.name() == name).unwrap();
        let fields = operation.fields();
        let shown = fields.list.iter().filter(|f| !apart.contains(&f.path[0].as_str()));
        for id in shown.flat_map(keys).map(|keys| format!("{name}-{}", keys.join("-").replace('_', "-"))) {
            let found = browser.run(&format!("return document.getElementById('{id}') !== null"));
            assert_eq!(found, true, "the page has no #{id}");
        }
    }
}

//! Scenes rendered by the service: uploads, progress, intermediate pictures, results, and rejected input.

#![allow(clippy::unwrap_used)]

use nacre_processing::image::{read_exr, write_exr};
use nacre_tests::http::{Answer, Service, begin, finished, plan};
use nacre_tests::{BENCH, Place, listing, nacre};
use serde_json::{Value, json};
use std::time::{Duration, Instant};

pub(crate) const SCENE: &str = "
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

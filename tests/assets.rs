//! Geometry, maps and foil from a user's point of view: from photographs to files and back, and rejected input.

#![allow(clippy::unwrap_used)]

use nacre_processing::geometry;
use nacre_processing::image::{read_exr, write_exr};
use nacre_tests::http::Service;
use nacre_tests::{Place, nacre, test_data};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Runs a command and expects its rejection with these words, without any output at `out`.
fn refused(args: &[&str], out: &Path, words: &str) {
    let run = nacre(args);
    let message = run.stderr();
    assert_eq!(run.code(), 2, "{args:?}: {message}");
    assert!(message.contains(words) && !message.contains("panicked"), "{words}: {message}");
    assert!(!out.exists(), "{args:?}");
}

#[test]
fn a_camera_is_calibrated_from_test_data() {
    let Some(data) = test_data() else { return };
    let dir = tempfile::tempdir().unwrap();
    let (boards, out, check) = (data.join("calibration"), dir.path().join("g.json"), dir.path().join("check"));
    let args = ["--json", "calibrate", "geometry", text(&boards), "--board", "9x6", "--square-mm", "25"];
    let more = ["--check", text(&check), "--out", text(&out), "--wavelength", "532"];
    let report = nacre([&args[..], &more].concat()).expect(0).json();
    assert!(report["rms_px"].as_f64().unwrap() <= 0.42, "{report}");
    assert_eq!(report["photographs"].as_array().unwrap().len(), 13);
    assert!(report["warnings"].to_string().contains("left01.jpg"), "{report}");
    let found = geometry::load(&out).unwrap();
    assert!((found.camera.focal_px[0] - 533.0).abs() < 3.0);
    assert_eq!(found.wavelength_nm, Some(532.0));
    assert!(check.join("left14.png").is_file());
    assert!(nacre([&args[..], &more].concat()).expect(2).stderr().contains("--force"));
    // Extends the geometry: the sample from its corners, the panel measured by hand, the light from its highlight and
    // height.
    let next = dir.path().join("next.json");
    let base = ["--json", "calibrate", "geometry", text(&out), "--out", text(&next)];
    let corners = ["--sample-corners", "200,150,420,152,421,330,198,328", "--sample-mm", "110,90"];
    let panel =
        ["--panel-px", "1920,1080", "--panel-pixel-mm", "0.27", "--panel-at", "0,150,300", "--panel-turn=-30,0,0"];
    let light = ["--highlight", "330,250", "--light-height-mm", "300,5"];
    let report = nacre([&base[..], &corners, &panel, &light].concat()).expect(0).json();
    let found = geometry::load(&next).unwrap();
    // The same highlight detected in a photograph, with a saturated centre.
    let lit = |places: &[[f64; 2]]| {
        image::GrayImage::from_fn(640, 480, |x, y| {
            let lobe = |[cx, cy]: [f64; 2]| {
                900.0 * (-((f64::from(x) - cx).powi(2) + (f64::from(y) - cy).powi(2)) / 72.0).exp()
            };
            image::Luma([places.iter().map(|p| lobe(*p)).sum::<f64>().min(255.0) as u8])
        })
    };
    let [one, two, seen] = ["one.png", "two.png", "seen.json"].map(|name| dir.path().join(name));
    lit(&[[330.0, 250.0]]).save(&one).unwrap();
    lit(&[[330.0, 250.0], [100.0, 100.0]]).save(&two).unwrap();
    let base = ["--json", "calibrate", "geometry", text(&out), "--out", text(&seen)];
    let light = ["--highlight", text(&one), "--light-height-mm", "300,5"];
    nacre([&base[..], &corners, &panel, &light].concat()).expect(0);
    let apart = [0, 1, 2].map(|k| geometry::load(&seen).unwrap().light_mm.unwrap()[k] - found.light_mm.unwrap()[k]);
    assert!(apart.iter().all(|mm| mm.abs() < 0.05), "{apart:?}");
    assert!(found.panel.is_some() && found.light_mm.is_some() && found.sigma.light_mm.is_some(), "{report}");
    // The corners agree with the given ones, except for the inconsistency of four measured corners.
    let seen = found.pixel([-55.0, 45.0, 0.0]).unwrap();
    assert!((seen[0] - 200.0).hypot(seen[1] - 150.0) < 3.0, "{seen:?}");
    let wrong = dir.path().join("wrong.json");
    let base = ["calibrate", "geometry", text(&out), "--out", text(&wrong)];
    let refused = |more: &[&str], words: &str| refused(&[&base[..], more].concat(), &wrong, words);
    refused(&["--sample-corners", "420,152,200,150,198,328,421,330", "--sample-mm", "110,90"], "clockwise");
    refused(&["--sample-corners", "1,2,3", "--sample-mm", "110,90"], "four corners");
    refused(&["--highlight", "330,250"], "fewer than two");
    refused(&["--highlight", text(&two), "--light-height-mm", "300,5"], "another light at");
    refused(&["--highlight", text(&dir.path().join("none.png"))], "none.png");
    refused(&["--highlight", "330,250", "--highlight", "330,250"], "how far away");
    refused(&["--panel-px", "1920,1080", "--panel-pixel-mm", "0.27"], "has no place");
    refused(&["--sample-photo", text(&dir.path().join("none.jpg"))], "none.jpg");
    refused(&["--lamp", "A"], "narrow band");
    let args = ["calibrate", "geometry", text(&boards), "--out", text(&wrong)];
    also_refused(&args, &["--board", "8x5"], &wrong, "left01.jpg");
    also_refused(&args, &["--board", "nine"], &wrong, "9x6");
    also_refused(&args, &["--square-mm", "-1"], &wrong, "square-mm");
}

/// As [`refused`], with further arguments.
fn also_refused(args: &[&str], more: &[&str], out: &Path, words: &str) {
    refused(&[args, more].concat(), out, words);
}

#[test]
fn the_papers_way_needs_no_board() {
    let dir = tempfile::tempdir().unwrap();
    let (photo, out) = (dir.path().join("photo.png"), dir.path().join("g.json"));
    image::GrayImage::from_pixel(640, 480, image::Luma([9])).save(&photo).unwrap();
    let args =
        ["--json", "calibrate", "geometry", text(&photo), "--out", text(&out), "--relative", "--known-mm", "150"];
    let more = ["--known-px", "100,200,550,210", "--camera-mm", "500", "--light-mm", "200", "--highlight", "300,260"];
    let report = nacre([&args[..], &more].concat()).expect(0).json();
    assert!(report["warnings"].to_string().contains("relative"));
    assert!(geometry::load(&out).unwrap().relative);
    let other = dir.path().join("other.json");
    let args = ["calibrate", "geometry", text(&photo), "--out", text(&other), "--relative", "--known-mm", "150"];
    also_refused(&args, &[], &other, "--known-px");
    // Without --relative, a photograph is not a valid geometry.
    refused(&["calibrate", "geometry", text(&photo), "--out", text(&other)], &other, "photo.png");
    let board = dir.path().join("board.png");
    let args = ["calibrate", "board", "--panel-px", "800,600", "--out", text(&board), "--square-px"];
    also_refused(&args, &["200"], &board, "does not fit");
    nacre([&args[..], &["60"]].concat()).expect(0);
    assert!(board.is_file());
}

fn same(a: &Path, b: &Path) -> bool {
    let bits = |path: &Path| {
        let map = read_exr(path).unwrap();
        let planes: Vec<(String, Vec<u32>)> =
            map.channels.into_iter().map(|(n, p)| (n, p.iter().map(|v| v.to_bits()).collect())).collect();
        (planes, map.attributes)
    };
    bits(a) == bits(b)
}

#[test]
fn foil_is_measured_made_anew_edited_and_exchanged() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| -> PathBuf { dir.path().join(name) };
    let scene = path("scene.toml");
    std::fs::write(&scene, "width = 240\nheight = 240\npixel_um = 1120\npattern = { spiral = [1.0, 1.45] }\n").unwrap();
    let photo = path("photo");
    nacre(["sim", "photograph", "foil", "--scene", text(&scene), "--out", text(&photo)]).expect(0);
    let geometry = photo.join("geometry.json");
    let found = path("found");
    let args = ["--json", "reconstruct", "foil", text(&photo), "--geometry", text(&geometry), "--depth-um", "0.08"];
    let report = nacre([&args[..], &["--period-um", "0.75,1.75", "--out", text(&found)]].concat()).expect(0).json();
    let mean = report["period_um"][0].as_f64().unwrap();
    // Uniformly distributed orientations: the mean of both ends.
    assert!((mean - 1.225).abs() < 0.02, "{report}");
    for name in ["histogram.exr", "histogram.png", "report.json"] {
        assert!(found.join(name).is_file(), "{name}");
    }
    let none = path("none");
    also_refused(&args[1..], &["--out", text(&none), "--period-um", "2,1"], &none, "period-um");
    also_refused(&args[1..], &["--out", text(&none), "--bins", "1,1"], &none, "bins");

    let new = path("new");
    let args = ["--json", "synthesize", text(&found), "--size", "600,400", "--pixel-um", "25"];
    let report = nacre([&args[..], &["--disc-px", "5", "--out", text(&new)]].concat()).expect(0).json();
    assert!(report["total_variation"][0].as_f64().unwrap() < 0.05, "{report}");
    also_refused(&args[1..], &["--out", text(&none)], &none, "--square-px");
    also_refused(&args[1..], &["--disc-px", "0", "--out", text(&none)], &none, "disc");
    also_refused(
        &["synthesize", text(&new)],
        &["--size", "9,9", "--pixel-um", "1", "--disc-px", "2", "--out", text(&none)],
        &none,
        "histogram.exr",
    );

    let edited = path("edited");
    let args = ["--json", "map", "edit", text(&new), "--rotate", "30", "--tile", "2,1", "--scale", "1.1"];
    let report = nacre([&args[..], &["--out", text(&edited)]].concat()).expect(0).json();
    // 600 × 400 rotated by 30° needs 720 × 647.
    assert_eq!((report["after"]["width"].as_u64(), report["after"]["height"].as_u64()), (Some(1440), Some(647)));
    assert!(edited.join("before-after.png").is_file());
    let (pack, back) = (path("pack"), path("back"));
    nacre(["map", "export", text(&edited), "--out", text(&pack)]).expect(0);
    nacre(["map", "import", text(&pack), "--out", text(&back)]).expect(0);
    for name in ["orientation.exr", "period.exr"] {
        assert!(same(&edited.join(name), &back.join(name)), "{name}");
    }
    // A crop, located by registration.
    let (part, compared) = (path("part"), path("compared"));
    nacre(["map", "edit", text(&new), "--size", "300,200", "--orientation-offset", "2", "--out", text(&part)])
        .expect(0);
    let args = ["--json", "map", "compare", text(&new), text(&part), "--out", text(&compared)];
    let report = nacre(args).expect(0).json();
    let other = &report["maps"][1];
    assert_eq!(other["shift_px"], serde_json::json!([0, 0]), "{report}");
    assert!((other["orientation"]["offset"].as_f64().unwrap() - 2.0).abs() < 0.01, "{report}");
    assert!(compared.join("compared.png").is_file());
    refused(&["map", "compare", text(&new), "--out", text(&none)], &none, "INPUTS");
    let args = ["map", "edit", text(&new), "--out", text(&none)];
    also_refused(&args, &[], &none, "changes nothing");
    also_refused(&args, &["--period", "cubic=1,2"], &none, "quadratic");
    also_refused(&args, &["--tile", "100000,100000"], &none, "tile");
    also_refused(&args, &["--clamp", "2,1"], &none, "clamp");
    refused(&["map", "import", text(&new), "--out", text(&none)], &none, "maps.json");
    refused(&["map", "edit", text(&photo), "--scale", "2", "--out", text(&none)], &none, "no map");
    let full = nacre(["map", "import", text(&pack), "--out", text(&back)]);
    assert!(full.expect(2).stderr().contains("--force"));
}

#[test]
fn a_photograph_tells_which_method_suits() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| -> PathBuf { dir.path().join(name) };
    let scene = "tiles = [6, 5]\nwidth = 900\nheight = 690\nlights_mm = [[0, 0, 200]]\nexposures = [1]\n[pattern]\npolygons = 8\n";
    std::fs::write(path("sheet.toml"), scene).unwrap();
    let photos = path("photos");
    nacre(["sim", "photograph", "tiles", "--scene", text(&path("sheet.toml")), "--out", text(&photos)]).expect(0);
    let (room, out) = (photos.join("room.png"), path("advice"));
    let report = nacre(["--json", "recommend", text(&room), "--out", text(&out)]).expect(0).json();
    assert_eq!(report["advice"], "flash", "{report}");
    assert!((report["repeats"]["copies"].as_f64().unwrap() - 30.0).abs() < 4.0, "{report}");
    assert!(out.join("tile.png").is_file() && out.join("report.json").is_file());
    let said = nacre(["recommend", text(&room)]).expect(0).stdout();
    assert!(said.contains("flash") && said.contains("reconstruct flash"), "{said}");
    refused(&["recommend", text(&path("none.png")), "--out", text(&path("x"))], &path("x"), "none.png");
    assert_eq!(nacre(["recommend", text(&room), "--out", text(&out)]).code(), 2, "nothing is replaced unasked");
}

#[test]
fn the_service_measures_foil_edits_maps_and_calibrates() {
    let place = Place::new("");
    let service = Service::start(&place, &[]);
    let upload = |kind: &str, files: &[&Path]| {
        let read: Vec<(String, Vec<u8>)> = files
            .iter()
            .map(|f| (f.file_name().unwrap().to_str().unwrap().to_owned(), std::fs::read(f).unwrap()))
            .collect();
        let mut parts = vec![("kind", "", kind.as_bytes())];
        parts.extend(read.iter().map(|(name, bytes)| {
            (if name == "frames.json" { "frames" } else { "file" }, name.as_str(), bytes.as_slice())
        }));
        service.upload(&parts)
    };
    let done = |upload: &str, method: &str, options: Value| {
        let asked = json!({ "upload": upload, "method": method, "options": options });
        let job = service.post("/api/v1/reconstructions", &asked).expect(202).json();
        let path = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
        service.until(&path, |job| job["state"] == "done")
    };
    let photo = place.path("photo");
    std::fs::write(place.path("foil.toml"), "width = 240\nheight = 240\npixel_um = 1120\n").unwrap();
    let scene = place.path("foil.toml");
    nacre(["sim", "photograph", "foil", "--scene", text(&scene), "--out", text(&photo)]).expect(0);
    let files = ["frames.json", "00.png", "01.png", "02.png"].map(|name| photo.join(name));
    let id = upload("photographs", &files.each_ref().map(|p| p.as_path())).expect(201).json()["id"].clone();
    let geometry: Value = serde_json::from_slice(&std::fs::read(photo.join("geometry.json")).unwrap()).unwrap();
    let id = id.as_str().unwrap();
    let found = done(id, "foil", json!({ "geometry": geometry, "period_um": [0.75, 1.75], "depth_um": 0.08 }));
    assert!((found["report"]["period_um"][0].as_f64().unwrap() - 1.225).abs() < 0.02, "{found}");
    let refused = |upload: &str, method: &str, options: Value, words: &str| {
        let asked = json!({ "upload": upload, "method": method, "options": options });
        let problem = service.post("/api/v1/reconstructions", &asked).expect(400).text();
        assert!(problem.contains(words), "{problem}");
    };
    refused(id, "foil", json!({}), "geometry.json");
    refused(id, "foil", json!({ "geometry": geometry, "period_um": [2, 1] }), "period");
    refused(id, "map", json!({ "rotate_deg": 5 }), "map");
    refused(id, "calibrate", json!({ "board": [1, 1] }), "board");

    // Generated maps: every pixel 30° and 1.2 µm.
    let maps = place.path("maps");
    std::fs::create_dir(&maps).unwrap();
    let write = |name: &str, channel: &str, value: f32| {
        write_exr(&maps.join(name), 20, 10, &[channel], &[], &|_, _, row| row.fill(value)).unwrap();
    };
    write("orientation.exr", "orientation", 0.5);
    write("period.exr", "period", 1.2);
    let files = ["orientation.exr", "period.exr"].map(|name| maps.join(name));
    let id = upload("maps", &files.each_ref().map(|p| p.as_path())).expect(201).json()["id"].clone();
    let id = id.as_str().unwrap();
    let edits = json!({ "rotate_deg": 90, "period": { "quadratic": [1.0, 2.0] } });
    let edited = done(id, "map", edits);
    assert_eq!(edited["report"]["after"]["width"], 10, "{edited}");
    let turned = 0.5 + std::f64::consts::FRAC_PI_2;
    let wanted = 1.0 + (turned / std::f64::consts::PI).powi(2);
    let got = edited["report"]["after"]["maps"]["period"]["range"][0].as_f64().unwrap();
    assert!((got - wanted).abs() < 1e-5, "{got} {wanted}");
    refused(id, "map", json!({}), "changes nothing");
    refused(id, "map", json!({ "period": { "table": [[10, 1], [5, 2]] } }), "period curve");
    assert!(upload("maps", &[photo.join("00.png").as_path()]).expect(400).text().contains("exr"));

    let Some(data) = test_data() else { return };
    let boards: Vec<PathBuf> =
        ["01", "02", "03", "04", "05"].map(|k| data.join(format!("calibration/left{k}.jpg"))).into();
    let paths: Vec<&Path> = boards.iter().map(PathBuf::as_path).collect();
    let id = upload("photographs", &paths).expect(201).json()["id"].clone();
    let found =
        done(id.as_str().unwrap(), "calibrate", json!({ "board": [9, 6], "square_mm": 25, "wavelength_nm": 532 }));
    let focal = found["report"]["geometry"]["camera"]["focal_px"][0].as_f64().unwrap();
    // The complete set gives 533.1; five photographs determine it to a few pixels.
    assert!((focal - 533.1).abs() < 8.0, "{found}");
}

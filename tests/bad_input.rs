//! Invalid photographs and descriptions: exit code 2, a message that names the file or key, and no output.

#![allow(clippy::unwrap_used)]

use nacre_tests::http::Service;
use nacre_tests::{BENCH, Place, listing, nacre};
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};

/// A valid series of four 16×16 photographs, for a test to damage.
struct Series {
    folder: tempfile::TempDir,
}

impl Series {
    fn new() -> Self {
        let series = Self { folder: tempfile::tempdir().unwrap() };
        fs::create_dir(series.path("")).unwrap();
        for (k, angle) in [0, 45, 90, 135].iter().enumerate() {
            let value = (120.0 + 60.0 * (2.0 * f64::from(*angle).to_radians()).cos()) as u8;
            image::GrayImage::from_pixel(16, 16, image::Luma([value + k as u8]))
                .save(series.path(&name(*angle)))
                .unwrap();
        }
        series.describe(&frames(&[0, 45, 90, 135]));
        series
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join("series").join(name)
    }

    fn describe(&self, json: &str) {
        fs::write(self.path("frames.json"), json).unwrap();
    }

    /// Runs a reconstruction that must be rejected with all of `words` in its message, without output.
    fn refused(&self, words: &[&str]) {
        let before = (listing(self.folder.path()), listing(&self.path("")));
        let out = self.folder.path().join("new/result");
        let run =
            nacre(["reconstruct", "polarization", self.path("").to_str().unwrap(), "--out", out.to_str().unwrap()]);
        let message = run.stderr();
        assert_eq!(run.code(), 2, "{words:?}: {message}");
        words.iter().for_each(|w| assert!(message.contains(w), "no {w} in: {message}"));
        assert!(message.contains("; ") && !message.contains("panicked"), "no remedy in: {message}");
        assert_eq!(before, (listing(self.folder.path()), listing(&self.path(""))), "{words:?} left something");
    }
}

fn name(angle: i32) -> String {
    format!("{angle:03}.png")
}

fn frames(angles: &[i32]) -> String {
    let list: Vec<String> =
        angles.iter().map(|a| format!(r#"{{"file": "{}", "analyser_deg": {a}}}"#, name(*a))).collect();
    format!(r#"{{"kind": "polarization", "transfer": "linear", "frames": [{}]}}"#, list.join(","))
}

#[test]
fn the_series_itself_is_good() {
    let series = Series::new();
    let out = series.folder.path().join("result");
    nacre(["reconstruct", "polarization", series.path("").to_str().unwrap(), "--out", out.to_str().unwrap()]).expect(0);
}

#[test]
fn descriptions() {
    let series = Series::new();
    let good = frames(&[0, 45, 90, 135]);
    let swap = |from: &str, to: &str| {
        assert!(good.contains(from));
        good.replacen(from, to, 1)
    };
    for (json, words) in [
        ("".into(), &["frames.json"][..]),
        ("not json".into(), &["frames.json", "line 1"]),
        ("[".repeat(100_000), &["frames.json"]),
        (format!(r#"{{"kind": {}"#, "[".repeat(100_000)), &["frames.json"]),
        ("\u{0}\u{1}".into(), &["frames.json"]),
        (good.clone() + "{}", &["frames.json", "trailing"]),
        (swap(r#""kind""#, r#""kid": 1, "kind""#), &["frames.json", "kid"]),
        (swap(r#""analyser_deg""#, r#""analyzer_deg""#), &["analyzer_deg"]),
        (swap("linear", "logarithmic"), &["transfer", "logarithmic"]),
        (swap(r#""linear""#, r#"{"gamma": -1}"#), &["gamma"]),
        (swap("000.png", "missing.png"), &["missing.png"]),
        (swap("000.png", "../series/000.png"), &["frames[0].file", "leaves"]),
        (swap("000.png", "/etc/hostname"), &["frames[0].file", "leaves"]),
        (swap("000.png", ""), &["frames[0].file"]),
        (swap(r#""analyser_deg": 45"#, r#""analyser_deg": NaN"#), &["frames.json"]),
        (swap(r#""analyser_deg": 45"#, r#""analyser_deg": 1e999"#), &["frames.json"]),
        (swap(r#""analyser_deg": 45"#, r#""analyser_deg": null"#), &["frames[1].analyser_deg", "missing"]),
        (swap(r#""analyser_deg": 45"#, r#""analyser_deg": "45""#), &["frames[1].analyser_deg"]),
        (swap(r#""analyser_deg": 45"#, r#""analyser_deg": 45, "exposure_s": 0"#), &["frames[1].exposure_s"]),
        (swap(r#""analyser_deg": 45"#, r#""analyser_deg": 45, "gain": -2"#), &["frames[1].gain"]),
        (swap(r#""frames""#, r#""black": 200, "white": 100, "frames""#), &["black", "200", "100"]),
        (swap(r#""frames""#, r#""black": 300, "frames""#), &["black", "300", "255"]),
        (swap(r#""frames""#, r#""channel": "g", "frames""#), &["channel", "grey"]),
        (swap(r#""frames""#, r#""layout": [[0,45],[90,135]], "frames""#), &["layout"]),
        (swap(r#""frames""#, r#""noise": {"full_scale_e": 0, "read_noise_e": 1}, "frames""#), &["noise.full_scale_e"]),
        (swap("polarization", "division_of_focal_plane"), &["analyser_deg"]),
        (swap("polarization", "exposures"), &["another kind"]),
        (swap("polarization", "spots"), &["frames[0].spot"]),
        (swap(r#""frames""#, r#""layout": [[0,45],[90,135]], "frames""#), &["layout"]),
        (frames(&[]), &["frames", "no frame"]),
        (frames(&[45]), &["45°", "at least 3"]),
        (frames(&[45, 90]), &["45°", "90°", "at least 3"]),
    ] {
        series.describe(&json);
        series.refused(words);
    }
    let equal = good.replace(": 90", ": 180").replace(": 135", ": 225");
    series.describe(&equal);
    series.refused(&["0°", "180°", "at least 3"]);
    fs::write(series.path("frames.json"), vec![b' '; 17 << 20]).unwrap();
    series.refused(&["frames.json", "bytes"]);
    fs::remove_file(series.path("frames.json")).unwrap();
    series.refused(&["frames.json", "nacre import"]);
}

#[test]
fn links_that_leave_the_folder() {
    let series = Series::new();
    fs::remove_file(series.path("045.png")).unwrap();
    fs::write(series.folder.path().join("elsewhere.png"), fs::read(series.path("000.png")).unwrap()).unwrap();
    std::os::unix::fs::symlink("../elsewhere.png", series.path("045.png")).unwrap();
    series.refused(&["045.png", "leaves"]);
}

/// Damages one photograph by a function of its path.
fn spoiled(words: &[&str], spoil: impl Fn(&Path)) {
    let series = Series::new();
    spoil(&series.path("090.png"));
    series.refused(words);
}

#[test]
fn photographs() {
    let save = |w: u32, h: u32| move |p: &Path| image::GrayImage::new(w, h).save(p).unwrap();
    spoiled(&["090.png", "8 x 16"], save(8, 16));
    spoiled(&["090.png", "16-bit"], |p| image::ImageBuffer::<image::Luma<u16>, _>::new(16, 16).save(p).unwrap());
    spoiled(&["090.png", "RGB"], |p| image::RgbImage::new(16, 16).save(p).unwrap());
    spoiled(&["090.png"], |p| fs::write(p, b"").unwrap());
    spoiled(&["090.png"], |p| fs::write(p, b"GIF89a and so on").unwrap());
    spoiled(&["090.png"], |p| {
        fs::remove_file(p).unwrap();
        fs::create_dir(p).unwrap();
    });
    for keep in [10, 40, 60] {
        spoiled(&["090.png"], |p| {
            let bytes = fs::read(p).unwrap();
            fs::write(p, &bytes[..keep.min(bytes.len() - 1)]).unwrap();
        });
    }
}

#[test]
fn a_gigantic_header_is_refused_before_any_memory_is_taken() {
    spoiled(&["090.png"], |p| {
        let mut bytes = fs::read(p).unwrap();
        bytes[16..24].copy_from_slice(&[0, 0, 0xff, 0xff, 0, 0, 0xff, 0xff]);
        fs::write(p, bytes).unwrap();
    });
}

#[test]
fn photographs_without_usable_light() {
    for (value, word) in [(0_u8, "black"), (255, "saturated")] {
        let series = Series::new();
        for angle in [0, 45, 90, 135] {
            image::GrayImage::from_pixel(16, 16, image::Luma([value])).save(series.path(&name(angle))).unwrap();
        }
        series.refused(&["frames.json", word]);
    }
}

#[test]
fn results_are_never_overwritten_unasked() {
    let series = Series::new();
    let out = series.folder.path().join("result");
    let input = series.path("");
    let run = |more: &[&str]| {
        let fixed = ["reconstruct", "polarization", input.to_str().unwrap(), "--out", out.to_str().unwrap()];
        nacre(fixed.iter().chain(more).map(|s| (*s).to_owned()))
    };
    fs::create_dir(&out).unwrap();
    fs::write(out.join("notes.txt"), "mine").unwrap();
    let refused = run(&[]).expect(2);
    assert!(refused.stderr().contains("--force"), "{}", refused.stderr());
    assert_eq!(listing(&out), ["notes.txt"]);
    run(&["--force"]).expect(0);
    assert_eq!(fs::read_to_string(out.join("notes.txt")).unwrap(), "mine");
    assert!(out.join("report.json").exists());
}

#[test]
fn bench_files() {
    let folder = tempfile::tempdir().unwrap();
    let (bench, out) = (folder.path().join("bench.toml"), folder.path().join("out"));
    for (text, word) in
        [("seed = ", "bench.toml"), ("sead = 1", "sead"), ("stage = { speed_deg_s = 0 }", "stage.speed_deg_s")]
    {
        fs::write(&bench, text).unwrap();
        let run =
            nacre(["sim", "render", "--bench", bench.to_str().unwrap(), "--out", out.to_str().unwrap()]).expect(2);
        assert!(run.stderr().contains(word), "{}", run.stderr());
    }
    nacre(["sim", "render", "--angles-deg", "0,nan", "--out", out.to_str().unwrap()]).expect(2);
    assert_eq!(listing(folder.path()), ["bench.toml"]);
}

/// A PNG of 3 × 1 pixels whose palette ends within a colour: its decoder panics.
const PALETTE: &[u8] = b"\x89PNG\x0d\x0a\x1a\x0a\x00\x00\x00\x0dIHDR\x00\x00\x00\x03\x00\x00\x00\x01\x08\x03\x00\x00\x00,>\xe4\x86\x00\x00\x00\x04PLTE\x01\x02\x03\x04#\xdb\x8a\xab\x00\x00\x00\x0cIDATx\x9cc```\x00\x00\x00\x04\x00\x01\xf6\x178U\x00\x00\x00\x00IEND\xaeB`\x82";

/// glTF whose only primitive refers to a missing accessor: its reader panics.
const GLTF: &str = r#"{"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 4294967295}}]}]}"#;

/// A scene with one shape of a plain material.
fn scene(shape: &str, albedo: &str) -> String {
    format!(
        "[camera]\nposition = [0, 0, 500]\ntarget = [0, 0, 0]\nfov_deg = 14\nwidth = 12\nheight = 12\n\
         [[shape]]\n{shape}\nmaterial = \"a\"\n[material.a.base]\nalbedo = {albedo}\nroughness = 0.5\n\
         [[light]]\ntype = \"environment\"\ncolor = [1, 1, 1]\n"
    )
}

/// Photographs that make their decoder panic, as a polarization series, as a bracket, and individually.
fn panicking(folder: &Path) {
    let angles = [0, 45, 90, 135];
    let series = frames(&angles).replacen(r#""frames""#, r#""channel": "g", "frames""#, 1);
    let times = angles.map(|a| format!(r#"{{"file": "{}", "exposure_s": {}}}"#, name(a), a + 1)).join(",");
    let bracket = format!(r#"{{"kind": "exposures", "transfer": "linear", "frames": [{times}]}}"#);
    for (kind, json) in [("series", Some(series)), ("bracket", Some(bracket)), ("photos", None)] {
        let folder = folder.join(kind);
        fs::create_dir(&folder).unwrap();
        angles.iter().for_each(|a| fs::write(folder.join(name(*a)), PALETTE).unwrap());
        json.into_iter().for_each(|json| fs::write(folder.join("frames.json"), json).unwrap());
    }
}

#[test]
fn files_on_which_a_decoder_panics() {
    let dir = tempfile::tempdir().unwrap();
    panicking(dir.path());
    let plane = "type = \"plane\"\nsize = [9, 9]";
    fs::write(dir.path().join("mesh.gltf"), GLTF).unwrap();
    fs::write(dir.path().join("textured.toml"), scene(plane, "\"photos/000.png\"")).unwrap();
    let mesh = scene("type = \"mesh\"\nfile = \"mesh.gltf\"", "[1, 1, 1]");
    fs::write(dir.path().join("mesh.toml"), mesh).unwrap();
    let path = |name: &str| dir.path().join(name).to_string_lossy().into_owned();
    let before = listing(dir.path());
    for (command, input, more, named) in [
        ("reconstruct polarization", "series", "", "000.png"),
        ("reconstruct hdr", "bracket", "", "000.png"),
        ("reconstruct lut", "photos/000.png", "--wavelength 560 --scale 0.002 --transfer linear", "000.png"),
        ("reconstruct bokeh", "photos/045.png", "--psf-sigma 2", "045.png"),
        ("recommend", "photos/090.png", "", "090.png"),
        ("render", "textured.toml", "--samples 1", "000.png"),
        ("render", "mesh.toml", "--samples 1", "mesh.gltf"),
    ] {
        let mut args: Vec<String> = command.split(' ').map(String::from).collect();
        args.push(path(input));
        args.extend(more.split_whitespace().map(String::from));
        if command != "recommend" {
            args.extend(["--out".into(), path("out.exr")]);
        }
        let run = nacre(&args);
        let message = run.stderr();
        assert_eq!(run.code(), 2, "{command} {input}: {message}");
        // Meshes are read without a third-party decoder.
        let reason = if input == "mesh.toml" { "mesh.gltf" } else { "decoder fail" };
        assert!(message.contains(named) && message.contains(reason), "{command}: {message}");
        assert!(!message.contains("panicked") && message.trim().lines().count() == 1, "{command}: {message}");
        assert_eq!(listing(dir.path()), before, "{command}");
    }
}

/// The service reports the error in the job, does not retry it, and continues.
#[test]
fn uploads_on_which_a_decoder_panics() {
    let place = Place::with_bench("", BENCH);
    let service = Service::start(&place, &[]);
    panicking(&place.path(""));
    for (kind, method) in [("series", "polarization"), ("bracket", "hdr")] {
        let read = |name: &str| fs::read(place.path(&format!("{kind}/{name}"))).unwrap();
        let json = read("frames.json");
        let names = [0, 45, 90, 135].map(name);
        let mut parts: Vec<(&str, &str, &[u8])> = vec![("kind", "", b"photographs"), ("frames", "frames.json", &json)];
        parts.extend(names.iter().map(|name| ("file", name.as_str(), PALETTE)));
        let id = service.upload(&parts).expect(201).json()["id"].clone();
        let asked = json!({ "upload": id, "method": method });
        let job = service.post("/api/v1/reconstructions", &asked).expect(202).json();
        let path = format!("/api/v1/reconstructions/{}", job["id"].as_str().unwrap());
        let ended = service.until(&path, |job| job["state"] != "queued" && job["state"] != "running");
        assert_eq!((ended["state"].as_str(), ended["attempts"].as_u64()), (Some("failed"), Some(1)), "{ended}");
        let error = ended["error"].as_str().unwrap();
        assert!(error.contains("000.png") && error.contains("decoder fail"), "{error}");
    }
}

//! Everything that can be wrong with photographs and their description: exit 2, a sentence that names the file or
//! key, nothing written.

#![allow(clippy::unwrap_used)]

use nacre_tests::{listing, nacre};
use std::fs;
use std::path::{Path, PathBuf};

/// A good series of four 16×16 photographs, to be spoiled by a test.
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

    /// Runs a reconstruction that must be refused with all of `words` in its message, leaving no trace.
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

/// Spoils one photograph by a function of its path.
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
fn colour_files_need_a_channel() {
    let series = Series::new();
    for angle in [0, 45, 90, 135] {
        image::RgbImage::from_pixel(16, 16, image::Rgb([100, angle as u8, 50]))
            .save(series.path(&name(angle)))
            .unwrap();
    }
    series.refused(&["000.png", "channel"]);
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

//! Commands as a user types them: demo, import, reconstruct, sim, schema.

#![allow(clippy::unwrap_used)]

use nacre_processing::image::read_exr;
use nacre_tests::{listing, nacre, test_data};
use std::path::Path;

fn args<'a>(fixed: &[&'a str], path: &'a Path) -> Vec<&'a str> {
    let path = path.to_str().unwrap();
    fixed.iter().map(|a| if *a == "OUT" { path } else { a }).collect()
}

#[test]
fn the_demo_meets_its_bound_and_says_where_things_are() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("demo");
    let run = nacre(args(&["--json", "demo", "--size", "256", "--out", "OUT"], &out)).expect(0);
    let json = run.json();
    assert!(json["error"]["mean_deg"].as_f64().unwrap() < 0.5, "{json}");
    assert_eq!(json["within_bound"], true);
    for file in ["session/frames.json", "session/truth.exr", "result/report.json", "result/overview.png"] {
        assert!(out.join(file).exists(), "{file}");
    }
    let again = nacre(args(&["demo", "--size", "64", "--out", "OUT"], &out)).expect(2);
    assert!(again.stderr().contains("session"), "{}", again.stderr());
}

/// A strongly birefringent film distorts the phase: the sinusoid model warns, and `auto` selects the film model.
#[test]
fn a_birefringent_film_is_found_and_the_sinusoid_warned_of() {
    let folder = tempfile::tempdir().unwrap();
    let (out, phase) = (folder.path().join("film"), folder.path().join("phase"));
    let run = nacre(args(&["--json", "demo", "--size", "256", "--retardance-deg", "10", "--out", "OUT"], &out));
    let json = run.json();
    let (mean, report) = (json["error"]["mean_deg"].as_f64().unwrap(), &json["report"]);
    assert!(mean < 1.0 && report["model"].as_str().unwrap().starts_with("curve"), "{mean} {report}");
    let film = &report["models"].as_array().unwrap().iter().find(|m| !m["film"].is_null()).unwrap()["film"];
    assert!((film["retardance_deg"].as_f64().unwrap() - 10.0).abs() < 1.0, "{film}");
    assert!((film["axis_deg"].as_f64().unwrap() - 20.0).abs() < 5.0, "{film}");

    let session = out.join("session");
    let asked =
        ["--json", "reconstruct", "polarization", session.to_str().unwrap(), "--model", "sinusoid", "--out", "OUT"];
    let json = nacre(args(&asked, &phase)).expect(0).json();
    assert!(json["circle"]["bias_deg"].as_f64().unwrap() > 2.0, "{json}");
    assert!(json["warnings"][0].as_str().unwrap().contains("film"), "{json}");
}

#[test]
fn a_wanted_error_is_held_or_the_exit_code_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let (session, out) = (folder.path().join("session"), folder.path().join("result"));
    nacre(args(&["sim", "render", "--size", "256", "--out", "OUT"], &session)).expect(0);
    let run = |wanted: &str| {
        let fixed = [
            "reconstruct",
            "polarization",
            session.to_str().unwrap(),
            "--out",
            "OUT",
            "--force",
            "--max-error",
            wanted,
        ];
        nacre(args(&fixed, &out))
    };
    run("0.5").expect(0);
    assert!(run("0.01").expect(1).stderr().contains("0.01°"));
}

#[test]
fn every_sample_renders_and_sessions_repeat_to_the_byte() {
    let folder = tempfile::tempdir().unwrap();
    for kind in
        ["kinematic", "stars", "polygons", "circles", "fireworks", "logo", "emblem", "cd", "stochastic", "mosaic"]
    {
        let render = |name: &str, seed: &str| {
            let out = folder.path().join(format!("{kind}-{name}"));
            let fixed = [
                "sim",
                "render",
                "--sample",
                kind,
                "--size",
                "48",
                "--seed",
                seed,
                "--angles-deg",
                "0,60,120",
                "--out",
                "OUT",
            ];
            nacre(args(&fixed, &out)).expect(0);
            std::fs::read(out.join("frames/0001.png")).unwrap()
        };
        let first = render("a", "4");
        assert!(first == render("b", "4"), "{kind} repeats");
        assert!(first != render("c", "5"), "{kind} depends on the seed");
    }
}

#[test]
fn the_eight_photographs_agree_with_plain_least_squares() {
    let Some(data) = test_data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (series, result) = (folder.path().join("series"), folder.path().join("result"));
    let source = data.join("polarization/rotating_analyser_630nm");
    nacre(["import", source.to_str().unwrap(), "--out", series.to_str().unwrap()]).expect(0);
    nacre(["reconstruct", "polarization", series.to_str().unwrap(), "--out", result.to_str().unwrap()]).expect(0);
    let angles: Vec<f64> = (0..8).map(|k| 45.0 * f64::from(k)).collect();
    let images: Vec<Vec<f64>> = angles
        .iter()
        .map(|a| {
            let image = image::open(source.join(format!("{a:03}.png"))).unwrap().to_luma8();
            image.into_raw().into_iter().map(|v| f64::from(v) / 255.0).collect()
        })
        .collect();
    compare_stokes(&result, &angles, &images, |i, k| images[k][i]);
}

/// Four of the eight photographs repeat the others at 180°: their differences agree with σ.
#[test]
fn the_eight_photographs_repeat_each_other_as_sigma_says() {
    let Some(data) = test_data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (series, result) = (folder.path().join("series"), folder.path().join("result"));
    let source = data.join("polarization/rotating_analyser_630nm");
    nacre(["import", source.to_str().unwrap(), "--out", series.to_str().unwrap()]).expect(0);
    let (series, result) = (series.to_str().unwrap(), result.to_str().unwrap());
    let asked = ["--json", "reconstruct", "polarization", series, "--out", result, "--model", "sinusoid"];
    let report = nacre(asked).expect(0).json();
    assert_eq!(report["noise"]["source"], "repeats");
    let found = &report["repeats"];
    assert_eq!((&found["pairs"], found["gain"].as_array().unwrap().len()), (&4.into(), 4));
    for chi2 in ["chi2", "chi2_median"] {
        assert!((0.8..=1.3).contains(&found[chi2].as_f64().unwrap()), "{found}");
    }
    // Half of at most 32,768 pixels, none of which is used for calibration.
    assert!((10_000..=16_384).contains(&found["pixels"].as_u64().unwrap()), "{found}");
    // Rounding to 8 bit contributes to the error even where it masks the noise.
    assert!(report["noise"]["floor"].as_f64().unwrap() >= 0.999 / (12.0 * 255.0 * 255.0), "{}", report["noise"]);
}

#[test]
fn the_polarization_sensor_agrees_with_plain_least_squares() {
    let Some(data) = test_data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let (series, result) = (folder.path().join("series"), folder.path().join("result"));
    let source = data.join("polarization/imx250mzr");
    let kind = ["--kind", "division-of-focal-plane", "--layout", "90,45,135,0"];
    nacre(["import", source.to_str().unwrap(), "--out", series.to_str().unwrap()].into_iter().chain(kind)).expect(0);
    nacre(["reconstruct", "polarization", series.to_str().unwrap(), "--out", result.to_str().unwrap()]).expect(0);
    let raw = image::open(source.join("camera_IMX250MZR.png")).unwrap().to_luma8();
    let width = raw.width() as usize / 2;
    let at = |i: usize, k: usize| {
        let (x, y) = (2 * (i % width) + k % 2, 2 * (i / width) + k / 2);
        f64::from(raw.get_pixel(x as u32, y as u32).0[0]) / 255.0
    };
    let images: Vec<Vec<f64>> =
        (0..4).map(|k| (0..width * raw.height() as usize / 2).map(|i| at(i, k)).collect()).collect();
    compare_stokes(&result, &[90.0, 45.0, 135.0, 0.0], &images, at);
}

/// Independent least squares: normal equations per pixel in f64, solved by elimination.
fn compare_stokes(result: &Path, angles: &[f64], images: &[Vec<f64>], at: impl Fn(usize, usize) -> f64) {
    // The sensor's four polarizers see different positions, which σ includes.
    let of_sensor = images.len() == 4;
    let stokes = read_exr(&result.join("stokes.exr")).unwrap();
    let map = read_exr(&result.join("aolp.exr")).unwrap();
    let rows: Vec<[f64; 3]> = angles.iter().map(|a| 2.0 * a.to_radians()).map(|p| [1.0, p.cos(), p.sin()]).collect();
    let (mut worst, mut counted) = (0.0_f64, 0);
    for i in 0..images[0].len() {
        let mut m = [[0.0; 4]; 3];
        for (k, row) in rows.iter().enumerate() {
            for a in 0..3 {
                (0..3).for_each(|b| m[a][b] += row[a] * row[b]);
                m[a][3] += row[a] * at(i, k);
            }
        }
        let fit = eliminate(m);
        let saturated = (0..rows.len()).any(|k| at(i, k) >= 1.0);
        for (channel, wanted) in ["S0", "S1", "S2"].iter().zip(fit) {
            let got = f64::from(stokes.channels[*channel][i]);
            assert_eq!(got.is_nan(), saturated, "pixel {i}");
            if !saturated {
                worst = worst.max((got - 2.0 * wanted).abs() / (2.0 * fit[0]).max(1.0 / 255.0));
                counted += 1;
            }
        }
        let [mask, aolp, sigma] = ["mask", "aolp", "sigma"].map(|c| map.channels[c][i]);
        // The mask depends on σ from noise, which is the total for photographs of one view.
        let measured = !saturated && sigma <= 0.125;
        assert!(if of_sensor { measured <= (mask == 1.0) } else { measured == (mask == 1.0) }, "pixel {i}");
        assert!(mask == 0.0 || !saturated, "pixel {i}");
        if mask == 1.0 {
            let off = (2.0 * (f64::from(aolp) - 0.5 * fit[2].atan2(fit[1]))).sin().abs();
            assert!(off < 1e-4, "pixel {i}: {aolp} rad");
        }
    }
    assert!(worst < 1e-6 && counted > 1000, "worst {worst} of {counted}");
}

fn eliminate(mut m: [[f64; 4]; 3]) -> [f64; 3] {
    for p in 0..3 {
        let pivot = m[p];
        for (r, row) in m.iter_mut().enumerate() {
            if r != p {
                let factor = row[p] / pivot[p];
                (0..4).for_each(|c| row[c] -= factor * pivot[c]);
            }
        }
    }
    [0, 1, 2].map(|r| m[r][3] / m[r][r])
}

#[test]
fn import_asks_instead_of_guessing_and_never_overwrites() {
    let folder = tempfile::tempdir().unwrap();
    let png = |name: &str| image::GrayImage::new(4, 4).save(folder.path().join(name)).unwrap();
    (1..=3).for_each(|k| png(&format!("IMG_000{k}.png")));
    let path = folder.path().to_str().unwrap();
    let counter = nacre(["import", path]).expect(2);
    assert!(counter.stderr().contains("--angles-deg"), "{}", counter.stderr());
    assert!(!folder.path().join("frames.json").exists());
    nacre(["import", path, "--angles-deg", "0,60,120"]).expect(0);
    let again = nacre(["import", path, "--angles-deg", "0,45,90"]).expect(2);
    assert!(again.stderr().contains("--force"), "{}", again.stderr());
    let json: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("frames.json")).unwrap()).unwrap();
    assert_eq!(json["frames"][2]["analyser_deg"], 120.0);
    assert_eq!(listing(folder.path()).len(), 4);
}

/// Uniform grey photographs with these names.
fn grey(names: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    names.iter().for_each(|name| image::GrayImage::new(4, 4).save(folder.path().join(name)).unwrap());
    folder
}

fn imported_angles(json: &serde_json::Value) -> Vec<f64> {
    json["frames"].as_array().unwrap().iter().map(|f| f["analyser_deg"].as_f64().unwrap()).collect()
}

#[test]
fn import_reads_signs_and_decimals_and_says_which() {
    let signed = grey(&["I_-45.png", "I_0.png", "I_45.png", "I_90.png"]);
    let run = nacre(args(&["import", "OUT"], signed.path())).expect(0);
    assert!(run.stdout().contains("-45°  I_-45.png"), "{}", run.stdout());
    let decimals = grey(&["m22p5.png", "p22p5.png", "p67p5.png"]);
    let json = nacre(args(&["--json", "import", "OUT"], decimals.path())).expect(0).json();
    assert_eq!(imported_angles(&json), [-22.5, 22.5, 67.5]);
    let open = grey(&["x_-0.png", "x_-45.png", "x_-90.png"]);
    let refused = nacre(args(&["import", "OUT"], open.path())).expect(2).stderr();
    assert!(refused.contains("x_-45.png: 45° or -45°") && refused.contains("--angles-deg"), "{refused}");
    nacre(args(&["import", "OUT", "--angles-deg", "0,-45,-90"], open.path())).expect(0);
}

#[test]
fn import_refuses_angles_that_file_names_contradict() {
    let folder = grey(&["I0.png", "I45.png", "I90.png", "I135.png"]);
    let given = |angles: &str, more: &[&str]| {
        let fixed = [&["--json", "import", "OUT", "--force", "--angles-deg", angles][..], more].concat();
        nacre(args(&fixed, folder.path()))
    };
    for shifted in ["0,45,90,135", "45,90,135,0"] {
        let refused = given(shifted, &[]).expect(2).stderr();
        assert!(
            refused.contains(".png is given") && refused.contains("I0.png, I135.png, I45.png, I90.png"),
            "{refused}"
        );
    }
    // In the order of the sorted names; half a turn more is equivalent, and names may be rounded.
    for right in ["0,135,45,90", "180,-45,45.4,89.7"] {
        given(right, &[]).expect(0);
    }
    let json = given("10,145,55,100", &["--ignore-names"]).expect(0).json();
    assert_eq!(imported_angles(&json), [10.0, 145.0, 55.0, 100.0]);
    given("0,135,45,90", &["--kind", "exposures"]).expect(2);
}

/// Messages about options name the flag, not the key.
#[test]
fn messages_name_flags() {
    let photo = grey(&["000.png", "060.png", "120.png"]);
    let out = tempfile::tempdir().unwrap();
    let grey = photo.path().to_str().unwrap();
    let (one, out) = (format!("{grey}/000.png"), out.path().join("out"));
    for (line, flag) in [
        (format!("import {grey} --channel g"), "--channel"),
        (format!("import {grey} --black 9 --white 3"), "--black"),
        (format!("import {grey} --black 300"), "--white"),
        (format!("import {grey} --transfer gamma=50"), "--transfer"),
        (format!("import {grey} --transfer recover"), "--transfer"),
        (format!("import {grey} --angles-deg 0,60"), "--angles-deg"),
        (format!("reconstruct lut {one} --wavelength 600 --scale 0.01 --out OUT"), "--transfer linear"),
        (format!("reconstruct lut {one} --scale 0.01 --transfer linear --out OUT"), "--wavelength"),
        (format!("reconstruct bokeh {one} --psf-sigma 2 --transfer gamma=50 --out OUT"), "--transfer"),
        (format!("reconstruct spots {grey} --mirror 90 --out OUT"), "--mirror"),
        (format!("reconstruct spots {grey} --periods 4,2 --out OUT"), "--periods"),
        (format!("reconstruct flash {grey} --light-sigma-mm 0 --out OUT"), "--light-sigma-mm"),
        (format!("reconstruct flash {grey} --tiles 0x3 --out OUT"), "--tiles"),
        (format!("reconstruct flash {grey} --reference-px 1,1,1,1 --out OUT"), "--reference-px"),
    ] {
        let words: Vec<&str> = line.split(' ').collect();
        let stderr = nacre(args(&words, &out)).expect(2).stderr();
        assert!(stderr.contains(flag), "{line}: {stderr}");
        let key = stderr.split(|c: char| !c.is_ascii_alphanumeric() && c != '_').find(|word| word.contains('_'));
        assert_eq!(key, None, "{line}: {stderr}");
    }
}

#[test]
fn import_reads_exposure_times_from_exif() {
    let Some(data) = test_data() else { return };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("bracket");
    let source = data.join("hdr");
    let run = nacre([
        "--json",
        "import",
        source.to_str().unwrap(),
        "--kind",
        "exposures",
        "--channel",
        "g",
        "--out",
        out.to_str().unwrap(),
    ])
    .expect(0)
    .json();
    let times: Vec<f64> = run["frames"].as_array().unwrap().iter().map(|f| f["exposure_s"].as_f64().unwrap()).collect();
    assert!((times[0] - 2.0).abs() < 1e-9 && (times[6] - 1.0 / 4000.0).abs() < 1e-9, "{times:?}");
    assert_eq!(run["transfer"], "srgb");
}

#[test]
fn schemas_and_help_are_there() {
    let frames = nacre(["schema", "frames"]).expect(0).json();
    assert!(frames["properties"]["layout"]["description"].as_str().unwrap().contains("2×2"));
    let bench = nacre(["schema", "bench"]).expect(0).json();
    assert!(
        bench["properties"]["film"].is_object() && bench["$defs"]["FilmConfig"]["properties"]["axis_deg"].is_object()
    );
    for command in [&["demo"][..], &["import"], &["schema"], &["sim", "render"], &["reconstruct", "polarization"], &[]]
    {
        let help = nacre(command.iter().copied().chain(["--help"])).expect(0);
        assert!(help.stdout().contains("Example"), "{command:?}");
    }
    nacre(["reconstruct", "polarisation"]).expect(2);
}

#[test]
fn what_is_wrong_is_json_too_for_a_program() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let missing = folder.path().join("nowhere");
    let bad = nacre(args(&["--json", "reconstruct", "hdr", missing.to_str().unwrap(), "--out", "OUT"], &out)).expect(2);
    let problem = bad.json();
    assert!(problem["type"].as_str().unwrap().ends_with("/bad-request"), "{problem}");
    assert!(problem["detail"].as_str().unwrap().contains(missing.to_str().unwrap()), "{problem}");
    assert!(problem["remedy"].as_str().unwrap().contains("frames.json"), "{problem}");
    assert_eq!(problem["exit_code"], 2);
    assert!(bad.stderr().contains("nowhere"));
    let usage = nacre(["--json", "reconstruct", "hdr", "--no-such-option"]).expect(2);
    assert!(usage.json()["detail"].as_str().unwrap().contains("--no-such-option"));
    // Without --json, only the result goes to standard output.
    assert_eq!(nacre(["reconstruct", "hdr", "--no-such-option"]).expect(2).stdout(), "");
}

#[test]
fn shells_manual_and_version_know_the_commands() {
    let folder = tempfile::tempdir().unwrap();
    let pages = folder.path().join("man1");
    let written = nacre(args(&["--json", "man", "--out", "OUT"], &pages)).expect(0).json();
    let named: Vec<&str> = written["pages"].as_array().unwrap().iter().map(|p| p.as_str().unwrap()).collect();
    assert_eq!(named.len(), listing(&pages).len());
    for page in ["nacre.1", "nacre-reconstruct-polarization.1", "nacre-sim-photograph-flash.1"] {
        assert!(named.contains(&page), "{page}: {named:?}");
    }
    // Hidden commands have no manual page.
    assert!(named.iter().all(|page| !page.contains("guardian") && !page.contains("job")), "{named:?}");
    let page = std::fs::read_to_string(pages.join("nacre-reconstruct-lut.1")).unwrap();
    assert!(page.contains("wavelength") && page.contains("Examples"), "{page}");
    for shell in ["bash", "zsh", "fish"] {
        let script = nacre(["completions", shell]).expect(0).stdout();
        assert!(script.contains("polarization") && script.contains("max-error"), "{shell}");
    }
    let version = nacre(["--version"]).expect(0).stdout();
    for line in ["nacre ", "\ncommit ", "\nfeatures ", "\ntarget "] {
        assert!(version.contains(line), "{version}");
    }
}

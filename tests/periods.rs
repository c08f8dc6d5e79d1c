//! Periods and smoothing from a user's point of view, on a simulated foil with known periods.

#![allow(clippy::unwrap_used)]

use nacre_processing::image::{ExrMap, read_exr};
use nacre_tests::nacre;
use serde_json::Value;
use std::path::PathBuf;

/// Squares of 1 mm with periods of 1.72 to 3.6 µm in 100 nm deep aluminium gratings in air, rigorous theory.
const BENCH: &str = r#"
[sample]
kind = "stochastic"
dot_um = 1000
period_um = 2.2
[filter]
wavelength_nm = 560
band_nm = 0
[film]
index = 1.0
front_reflection = 0
[geometry]
baseline_mm = 10
distance_mm = 2000
[grating.rigorous]
depth_um = 0.1
"#;

struct Foil {
    folder: tempfile::TempDir,
    truth: ExrMap,
}

impl Foil {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (bench, session) = (folder.path().join("bench.toml"), folder.path().join("session"));
        std::fs::write(&bench, BENCH).unwrap();
        let angles = ["--size", "128", "--angles-deg", "0,15,30,45,60,75,90,105,120,135,150,165"];
        let fixed = ["sim", "render", "--bench", bench.to_str().unwrap(), "--out", session.to_str().unwrap()];
        nacre(fixed.into_iter().chain(angles)).expect(0);
        let truth = read_exr(&session.join("truth.exr")).unwrap();
        Self { folder, truth }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn reconstruct(&self, name: &str, options: &[&str], code: i32) -> nacre_tests::Run {
        let (session, out) = (self.path("session"), self.path(name));
        let fixed =
            ["--json", "reconstruct", "polarization", session.to_str().unwrap(), "--out", out.to_str().unwrap()];
        nacre(fixed.into_iter().chain(options.iter().copied())).expect(code)
    }

    /// Sorted relative errors of the periods in pixels of one square.
    fn errors(&self, name: &str) -> Vec<f64> {
        let found = read_exr(&self.path(name).join("period.exr")).unwrap();
        let (period, truth, purity) =
            (&found.channels["period"], &self.truth.channels["period"], &self.truth.channels["purity"]);
        let pure = |i: &usize| period[*i].is_finite() && truth[*i].is_finite() && purity[*i] > 0.999;
        let mut errors: Vec<f64> =
            (0..period.len()).filter(pure).map(|i| f64::from(period[i] / truth[i]) - 1.0).collect();
        errors.sort_by(f64::total_cmp);
        assert!(errors.len() > 1000, "{}", errors.len());
        errors
    }
}

/// With the true depth, the periods are correct; with a wrong one, their errors agree with the documentation.
#[test]
fn periods_come_out_of_the_contrast() {
    let foil = Foil::new();
    let ask = |name: &str, depth: &str| {
        let options = ["--contrast-period", "1.7,3.7", "--depth-um", depth, "--wavelength-nm", "560"];
        (foil.reconstruct(name, &options, 0).json(), foil.errors(name))
    };
    let (report, errors) = ask("right", "0.1");
    let (middle, wide) = (errors[errors.len() / 2], errors[errors.len() * 95 / 100] - errors[errors.len() / 20]);
    // Noise scatters single pixels by 8 %. Where the polarization is weakest, it masks the longest periods and biases
    // the others.
    assert!(middle.abs() < 0.06 && wide < 0.35, "median {middle}, 90 % within {wide}");
    let period = &report["period"];
    assert_eq!(period["heuristic"], false);
    assert_eq!(period["method"]["depth_um"], 0.1);
    assert!(period["if_depth_is_off"][0].as_f64().unwrap() > 0.05, "{period}");
    let warned = |report: &Value, what: &str| {
        report["warnings"].as_array().unwrap().iter().any(|w| w.to_string().contains(what))
    };
    assert!(warned(&report, "periods assume aluminium of 100 nm"), "{}", report["warnings"]);
    for (name, depth, least, most) in [("shallow", "0.08", -0.25, -0.14), ("deep", "0.12", 0.2, 0.33)] {
        let (_, errors) = ask(name, depth);
        assert!((least..most).contains(&errors[errors.len() / 2]), "{name}: {}", errors[errors.len() / 2]);
    }
    // The plasmon below 1.7 µm makes part of a wider range ambiguous, which is masked and reported.
    let wide = ["--contrast-period", "0.9,3.7", "--depth-um", "0.1"];
    let report = foil.reconstruct("wide", &wide, 0).json();
    assert!(warned(&report, "can be told from the polarization"), "{}", report["warnings"]);
    assert!(report["period"]["ambiguous"].as_u64().unwrap() > 0);
    let map = read_exr(&foil.path("wide/period.exr")).unwrap();
    assert!(map.attributes["method"].contains("assumptions") && map.channels["mask"].contains(&0.0));
}

#[test]
fn heuristic_periods_are_labelled() {
    let foil = Foil::new();
    let report = foil.reconstruct("out", &["--relative-period", "0.7,2"], 0).json();
    assert_eq!(report["period"]["heuristic"], true);
    assert!(report["warnings"].to_string().contains("heuristic"));
    let map = read_exr(&foil.path("out/period.exr")).unwrap();
    assert!(map.attributes["method"].contains("heuristic"));
    let known = |c: &str| map.channels[c].iter().copied().filter(|v| v.is_finite()).collect::<Vec<_>>();
    assert!(known("sigma").is_empty() && known("period").iter().all(|p| (0.7..=2.0001).contains(p)));
    assert!(foil.path("out/period.png").exists());
    for (wrong, said) in [
        (&["--relative-period", "2,1"][..], "rising"),
        (&["--relative-period", "2"], "two numbers"),
        (&["--contrast-period", "1,2"], "--depth-um"),
        (&["--contrast-period", "1,2", "--depth-um", "0"], "depth"),
        (&["--contrast-period", "1,2", "--depth-um", "0.1", "--metal", "tin"], "chromium"),
        (&["--relative-period", "1,2", "--depth-um", "0.1"], "--contrast-period"),
        (&["--smooth", "much"], "light"),
        (&["--smooth", "none", "--smooth-maps"], "smooth"),
        (&["--smooth", "none", "--smoothed-exr"], "smooth"),
        (&["--model", "plain", "--offset-deg", "3"], "models of gratings"),
    ] {
        let run = foil.reconstruct("bad", wrong, 2);
        assert!(run.stderr().contains(said) || run.stdout().contains(said), "{wrong:?}: {}", run.stderr());
        assert!(!foil.path("bad").exists());
    }
}

/// By default, pictures are smoothed and the map is not; on request the map is smoothed, which all outputs state.
#[test]
fn maps_stay_as_measured_unless_asked() {
    let foil = Foil::new();
    foil.reconstruct("plain", &["--smooth", "none"], 0);
    foil.reconstruct("light", &[], 0);
    let report = foil.reconstruct("smooth", &["--smooth", "3", "--smooth-maps"], 0).json();
    let file = |name: &str| std::fs::read(foil.path(name)).unwrap();
    assert!(file("plain/orientation.exr") == file("light/orientation.exr"));
    assert!(file("plain/orientation.png") != file("light/orientation.png"));
    assert!(!foil.path("light/smoothed.exr").exists() && !foil.path("plain/smoothed.exr").exists());
    foil.reconstruct("full", &["--smoothed-exr"], 0);
    assert!(file("full/orientation.png") == file("light/orientation.png"));
    let full = read_exr(&foil.path("full/smoothed.exr")).unwrap();
    assert!(
        full.attributes["smoothing"].as_str() == "light"
            && full.channels["orientation"].len() == foil.truth.width * foil.truth.height
    );
    let [plain, smooth] = ["plain", "smooth"].map(|n| read_exr(&foil.path(n).join("orientation.exr")).unwrap());
    assert_eq!((plain.attributes["smoothing"].as_str(), smooth.attributes["smoothing"].as_str()), ("none", "3"));
    assert_eq!(plain.channels["mask"], smooth.channels["mask"]);
    assert_eq!((&report["smoothing"]["map"], &report["smoothing"]["rounds"]), (&Value::from(true), &Value::from(3)));
    assert!(report["warnings"].to_string().contains("smoothed"));
    let median = |map: &ExrMap| {
        let known = |i: &usize| map.channels["orientation"][*i].is_finite();
        let mut sigma: Vec<f32> = (0..map.width * map.height).filter(known).map(|i| map.channels["sigma"][i]).collect();
        sigma.sort_by(f32::total_cmp);
        sigma[sigma.len() / 2]
    };
    assert!(median(&smooth) < 0.5 * median(&plain));
}

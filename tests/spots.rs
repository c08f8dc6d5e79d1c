//! Orientation and absolute period from fringes, from a user's point of view: plan, simulated bench, `nacre reconstruct
//! spots`.

#![allow(clippy::unwrap_used)]

use nacre_processing::image::{ExrMap, read_exr};
use nacre_tests::{command, data, nacre};
use serde_json::Value;
use std::path::Path;
use std::process::Stdio;

const PLAN: &str = r#"
kind = "spots"
name = "mosaic of periods"
spots = { fringes = { count = 12, phases = 4 } }
extras = ["display_black"]
reconstruct = { operation = "spots" }
"#;

fn bench(seed: u64) -> String {
    format!(
        r#"
seed = {seed}
sample = {{ kind = "mosaic" }}
panel = {{ size_mm = [520, 320] }}
filter = {{ wavelength_nm = 560 }}
geometry = {{ distance_mm = 250, baseline_mm = 100 }}
camera = {{ width = 96, height = 96 }}
"#
    )
}

/// A seed not used by any earlier run.
fn fresh() -> u64 {
    std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_secs() % 1_000_000_007
}

fn channel(map: &ExrMap, name: &str) -> Vec<f64> {
    map.channels[name].iter().map(|v| f64::from(*v)).collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Ground truth of a bench, as written by `sim render`.
fn truth(bench: &Path, out: &Path) -> ExrMap {
    let args = ["sim", "render", "--bench", bench.to_str().unwrap(), "--out", out.to_str().unwrap(), "--size", "384"];
    nacre(args.into_iter().chain(["--angles-deg", "0,60,120"])).expect(0);
    read_exr(&out.join("truth.exr")).unwrap()
}

#[test]
fn a_mosaic_of_periods_is_measured() {
    let seed = fresh();
    println!("seed {seed}");
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let [bench_file, plan, session] = [path("bench.toml"), path("plan.toml"), path("session")];
    std::fs::write(&bench_file, bench(seed)).unwrap();
    std::fs::write(&plan, PLAN).unwrap();
    let text = |p: &Path| p.to_str().unwrap().to_owned();
    let checked =
        nacre(["--json", "plan", "check", &text(&plan), "--sim", "--bench", &text(&bench_file)]).expect(0).json();
    let shortest: Vec<f64> = checked["shortest_um"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    assert_eq!(shortest.len(), 12);
    let taken =
        nacre(["--json", "capture", &text(&plan), "--sim", "--bench", &text(&bench_file), "--out", &text(&session)]);
    let taken: Value = taken.expect(0).json();
    let report = &taken["report"];
    assert!(report["patterns"].as_u64().unwrap() < 64 && taken["frames"].as_u64().unwrap() <= 64, "{taken}");
    let truth = truth(&bench_file, &path("truth"));
    let results = session.join("results");
    let [turn, period] = ["orientation.exr", "period.exr"].map(|name| read_exr(&results.join(name)).unwrap());
    let (turned, found) = (channel(&turn, "orientation"), channel(&period, "period"));
    let (true_turn, true_period) = (channel(&truth, "orientation"), channel(&truth, "period"));
    let fold =
        |a: f64| (a + std::f64::consts::FRAC_PI_2).rem_euclid(std::f64::consts::PI) - std::f64::consts::FRAC_PI_2;
    let known: Vec<usize> = (0..found.len()).filter(|i| found[*i].is_finite()).collect();
    // Truth in sixteenths of a pixel, because the response of a mixed pixel does not correspond to the mean.
    let own = |i: usize| (4 * (i / 96) + 2) * 384 + 4 * (i % 96) + 2;
    let off = |i: usize, k: usize| [(found[i] / true_period[k] - 1.0).abs(), fold(turned[i] - true_turn[k]).abs()];
    assert!(known.len() * 10 > found.len() * 6, "seed {seed}: {} of {}", known.len(), found.len());
    let errors = [0, 1].map(|part| median(known.iter().map(|i| off(*i, own(*i))[part]).collect()));
    assert!(errors[0] < 0.01 && errors[1].to_degrees() < 0.5, "seed {seed}: {errors:?}");
    // Confidently wrong: the result resembles nothing near the pixel.
    let wrong = known.iter().filter(|i| {
        let span = |at: usize| (4 * at).saturating_sub(8)..(4 * at + 12).min(384);
        span(*i / 96).flat_map(|y| span(*i % 96).map(move |x| y * 384 + x)).all(|k| {
            let [p, t] = off(**i, k);
            p > 0.05 || t > 2.5_f64.to_radians()
        })
    });
    let wrong = wrong.count();
    assert!(wrong * 1000 <= found.len(), "seed {seed}: {wrong} confidently wrong");
    for name in ["orientation.png", "period.png", "report.json"] {
        assert!(results.join(name).is_file(), "{name}");
    }
    // The same result from separate commands; existing files are not overwritten. A wrong wavelength scales all periods
    // and is stated as an assumption.
    let again = path("again");
    let run = |more: &[&str]| {
        let args = ["--json", "reconstruct", "spots", session.to_str().unwrap(), "--out", again.to_str().unwrap()];
        nacre(args.into_iter().chain(more.iter().copied()))
    };
    run(&["--wavelength", "571.2", "--wavelength-sigma", "5.6"]).expect(0);
    run(&[]).expect(2);
    let scaled = read_exr(&again.join("period.exr")).unwrap();
    let (longer, sigma) = (channel(&scaled, "period"), channel(&scaled, "sigma"));
    let both: Vec<usize> = known.into_iter().filter(|i| longer[*i].is_finite()).collect();
    let ratio = median(both.iter().map(|i| longer[*i] / found[*i]).collect());
    assert!((ratio - 1.02).abs() < 2e-3, "{ratio}");
    assert!(both.iter().all(|i| sigma[*i] / longer[*i] > 0.0098), "the wavelength's σ is in that of the periods");
}

/// Discs decide between the two gratings left ambiguous by few fringes.
#[test]
fn discs_decide_between_gratings() {
    let seed = fresh();
    println!("seed {seed}");
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let text = |name: &str| path(name).to_str().unwrap().to_owned();
    std::fs::write(path("bench.toml"), bench(seed).replace("96", "64")).unwrap();
    let centers: Vec<String> = (0..24).map(|k| format!("[{}, {}]", 80 * (k % 6) - 200, 80 * (k / 6) - 120)).collect();
    let plan = format!(
        "kind = \"spots\"\nextras = [\"display_black\"]\n\
         spots = {{ centers_mm = [{}], diameter_mm = 80, fringes = {{ count = 5, phases = 3 }} }}\n\
         reconstruct = {{ operation = \"spots\" }}\n",
        centers.join(", ")
    );
    std::fs::write(path("plan.toml"), plan).unwrap();
    let args = ["--json", "capture", &text("plan.toml"), "--sim", "--bench", &text("bench.toml"), "--out", &text("s")];
    let with = nacre(args.map(str::to_owned)).expect(0).json()["report"].take();
    // The same photographs without those of the discs.
    let frames = std::fs::read_to_string(path("s/frames.json")).unwrap();
    let mut frames: Value = serde_json::from_str(&frames).unwrap();
    frames["frames"].as_array_mut().unwrap().retain(|f| f["spot"].is_null());
    std::fs::write(path("s/frames.json"), frames.to_string()).unwrap();
    let again = ["--json", "reconstruct", "spots", &text("s"), "--out", &text("without")];
    let without = nacre(again.map(str::to_owned)).expect(0).json();
    let pixels = |report: &Value, what: &str| report["pixels"][what].as_u64().unwrap();
    println!("with discs {}, {}; without {}", with["pixels"], with["discs"], without["pixels"]);
    assert!(without["discs"].is_null() && with["discs"]["discs"] == 24, "{with}");
    let decided = with["discs"]["decided"].as_u64().unwrap();
    assert!(
        decided > 0 && pixels(&with, "ambiguous") + decided == pixels(&without, "ambiguous"),
        "seed {seed}: {with}"
    );
    // Almost no remaining pixel is wrong, and many masked ones were.
    let truth = channel(&truth(&path("bench.toml"), &path("truth")), "period");
    let off = |folder: &str| {
        let found = channel(&read_exr(&path(folder).join("period.exr")).unwrap(), "period");
        let span = |at: usize| (6 * at).saturating_sub(12)..(6 * at + 18).min(384);
        let near = |i: usize| span(i / 64).flat_map(move |y| span(i % 64).map(move |x| y * 384 + x));
        let wrong = |i: &usize| found[*i].is_finite() && near(*i).all(|k| (found[*i] / truth[k] - 1.0).abs() > 0.05);
        (0..found.len()).filter(wrong).count()
    };
    let [left, before] = ["s/results", "without"].map(off);
    println!("{left} pixels are off with discs, {before} without");
    assert!(before >= 20 && left * 5 <= before, "seed {seed}: {left} of {before}");
}

#[test]
fn what_is_no_spot_scan_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let set = |frames: &str| {
        std::fs::write(
            path("frames.json"),
            format!(r#"{{"kind": "spots", "transfer": "linear", "frames": [{frames}]}}"#),
        )
        .unwrap();
        let args = ["reconstruct", "spots", folder.path().to_str().unwrap(), "--out", path("out").to_str().unwrap()]
            .map(str::to_owned);
        nacre(args).expect(2).stderr()
    };
    nacre_processing::image::write_png16_gray(&path("a.png"), 4, 4, &[100; 16]).unwrap();
    let fringes =
        |f: &str, phase: &str| format!(r#"{{"file": "a.png", "fringes": {{"cycles_per_mm": {f}, "phase": {phase}}}}}"#);
    let one = fringes("[0.01, 0]", "0");
    assert!(set(&one).contains("1 different fringes"), "{}", set(&one));
    assert!(set(&fringes("[1e9, 0]", "0")).contains("are no fringes"));
    let few: Vec<String> =
        (0..6).flat_map(|k| ["0", "0.01", "0.02"].map(|p| fringes(&format!("[0.0{k}1, 0.01]"), p))).collect();
    assert!(set(&few.join(",")).contains("do not tell"));
    let sound: Vec<String> =
        (0..6).flat_map(|k| ["0", "0.3", "0.6"].map(|p| fringes(&format!("[0.0{k}1, 0.01]"), p))).collect();
    assert!(set(&sound.join(",")).contains("where camera and panel stand"));
    let both = r#"{"file": "a.png", "fringes": {"cycles_per_mm": [0.01, 0], "phase": 0}, "spot": {"center_mm": [0, 0], "diameter_mm": 5}}"#;
    assert!(set(both).contains("beside fringes"));
}

/// Fringes are added until few pixels are undecided, and then no more; after a kill and resume, the same fringes are
/// used.
#[test]
fn fringes_are_added_as_they_are_needed() {
    let seed = fresh();
    println!("seed {seed}");
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let text = |name: &str| path(name).to_str().unwrap().to_owned();
    std::fs::write(path("bench.toml"), bench(seed).replace("96", "40")).unwrap();
    let plan = |fringes: &str| {
        let plan = format!("kind = \"spots\"\nspots = {{ fringes = {{ {fringes} }} }}\nextras = [\"display_black\"]");
        std::fs::write(path("plan.toml"), plan).unwrap();
    };
    let capture = |out: &str| {
        let args =
            ["--json", "capture", &text("plan.toml"), "--sim", "--bench", &text("bench.toml"), "--out", &text(out)]
                .map(str::to_owned);
        nacre(args)
    };
    let entries = |session: &str| -> Vec<Value> {
        let journal = std::fs::read_to_string(path(session).join("journal")).unwrap();
        journal.lines().map(|l| serde_json::from_str::<Value>(l).unwrap()["entry"].take()).collect()
    };
    // Nearly all pixels may be undecided: six fringes suffice.
    plan("until_undecided = 0.9, count = 6");
    let easy = capture("easy").expect(0).json();
    assert_eq!((&easy["ended"]["why"], &easy["ended"]["fringes"]), (&"met".into(), &6.into()), "{easy}");
    assert_eq!(easy["frames"], 1 + 3 + 4 * 6, "{easy}");
    // Five fringes leave some pixels undecided; the final state agrees with the reconstruction.
    plan("until_undecided = 0.0001, count = 5, phases = 3, at_most = 13");
    let hard = capture("hard").expect(0).json();
    let end = &hard["ended"];
    let fringes = end["fringes"].as_u64().unwrap();
    assert!(fringes > 5 && fringes <= 13, "{hard}");
    assert_eq!(hard["frames"], 1 + 3 + 3 * fringes, "{hard}");
    let added: Vec<u64> = entries("hard").iter().filter_map(|e| e["chosen"]["fringes"].as_u64()).collect();
    let before: Vec<f64> = entries("hard").iter().filter_map(|e| e["chosen"]["undecided"].as_f64()).collect();
    assert!(added.windows(2).all(|w| w[1] == w[0] + 2) && added.last() == Some(&fringes), "{added:?}");
    assert!(before[0] > end["undecided"].as_f64().unwrap(), "{before:?} {end}");
    nacre(["check", &text("hard")]).expect(0);
    let report = nacre(["--json", "reconstruct", "spots", &text("hard"), "--out", &text("maps")]).expect(0).json();
    assert_eq!(report["fringes"], fringes, "{report}");
    // Killed while it continues, with a frame damaged afterwards, and resumed, it has the same fringes and identical
    // bytes.
    let whole = data(&path("hard"));
    let resume = || nacre(["capture", "--resume", &text("hard"), "--sim"]);
    std::fs::write(path("hard/frames/0020.png"), b"spoiled").unwrap();
    nacre(["check", &text("hard")]).expect(1);
    resume().expect(0);
    assert!(data(&path("hard")) == whole);
    let killed = (100..).step_by(5).map(|operation| {
        let name = format!("killed-{operation}");
        let (mut command, _) = command();
        let args = ["capture", &text("plan.toml"), "--sim", "--bench", &text("bench.toml"), "--out", &text(&name)];
        let status = command.args(args).env("NACRE_DIE_AT", operation.to_string()).stderr(Stdio::null()).status();
        assert!(!status.unwrap().success(), "fringes were added before operation {operation}, so it cannot have ended");
        name
    });
    let killed = killed.into_iter().find(|name| entries(name).iter().any(|e| e["chosen"].is_object())).unwrap();
    nacre(["capture", "--resume", &text(&killed), "--sim"]).expect(0);
    assert!(data(&path(&killed)) == whole);
}

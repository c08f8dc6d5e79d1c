//! Inspection from a user's point of view: capture, reconstruct, train limits, inspect one sheet and a folder.

#![allow(clippy::unwrap_used)]

use nacre_tests::{Place, nacre};
use std::fs;

/// Twelve angles at one exposure.
const PLAN: &str = "kind = \"polarization\"\ncamera = { exposure_ms = 15 }\n\
    analyser = { angles_deg = [0, 15, 30, 45, 60, 75, 90, 105, 120, 135, 150, 165] }\n";

/// Captures and reconstructs a sheet into a folder of the place.
fn sheet(place: &Place, name: &str, seed: u64, sample: &str) {
    let bench = format!(
        "seed = {seed}\ncamera = {{ width = 128, height = 128 }}\n[sample]\nkind = \"polygons\"\nseed = 1\nsize_mm = 20.0\n{sample}"
    );
    fs::write(place.text("sheet.toml"), bench).unwrap();
    fs::write(place.text("plan.toml"), PLAN).unwrap();
    let (plan, toml, session) =
        (place.text("plan.toml"), place.text("sheet.toml"), place.text(&format!("{seed}-session")));
    nacre(["capture", &plan, "--sim", "--bench", &toml, "--out", &session]).expect(0);
    nacre(["reconstruct", "polarization", &session, "--out", &place.text(name)]).expect(0);
}

#[test]
fn sheets_are_accepted_or_rejected_by_trained_limits() {
    let place = Place::new("");
    sheet(&place, "good", 1, "");
    for (k, pose) in ["", "turn_deg = 2.0", "shift_mm = [1.0, -0.5]"].into_iter().enumerate() {
        sheet(&place, &format!("training/{k}"), 2 + k as u64, pose);
    }
    let defect = "turn_deg = 1.0\n[[sample.planted]]\nclass = \"dirt\"\nat_mm = [3.0, -2.0]\nwidth_mm = 1.0\n";
    sheet(&place, "batch/bad", 7, defect);
    sheet(&place, "batch/fine", 8, "turn_deg = -1.5");
    let inspect = |input: &str, more: &[&str], out: &str| {
        let (input, good, out) = (place.text(input), place.text("good"), place.text(out));
        let line = ["--json", "inspect", &input, "--reference", &good, "--out", &out];
        nacre(line.iter().chain(more).map(|s| (*s).to_owned()).collect::<Vec<_>>())
    };
    inspect("training", &["--train"], "trained").expect(0);
    let limits = place.text("trained/limits.toml");
    assert!(fs::read_to_string(&limits).unwrap().contains("samples = 3"));
    let fine = inspect("batch/fine", &["--limits", &limits], "fine").expect(0).json();
    assert_eq!(fine["sheets"][0]["verdict"], "accept", "{fine}");
    assert_eq!(fine["sheets"][0]["sample"]["files"][0]["sha256"].as_str().unwrap().len(), 64);
    let run = inspect("batch", &["--limits", &limits], "all").expect(1);
    assert!(run.stderr().contains("1 of 2 sheets"), "{}", run.stderr());
    let page = fs::read_to_string(place.text("all/bad/report.html")).unwrap();
    assert!(page.contains("data:image/png;base64,") && page.contains("dirt") && !page.contains("http"));
    let csv = fs::read_to_string(place.text("all/summary.csv")).unwrap();
    assert!(csv.contains("bad,reject,1,0,0,0,0,1") && csv.contains("fine,accept,0"), "{csv}");
}

#[test]
fn mistakes_are_named_as_flags() {
    let place = Place::new("");
    let out = place.text("out");
    let refused = |args: &[&str]| {
        let line = ["inspect", "nothing", "--reference", "nothing", "--out", &out];
        nacre(line.iter().chain(args).map(|s| (*s).to_owned()).collect::<Vec<_>>()).expect(2).stderr()
    };
    assert!(refused(&["--false-alarms", "7"]).contains("--false-alarms"));
    assert!(refused(&["--max-turn-deg", "200"]).contains("--max-turn-deg"));
    assert!(refused(&["--train", "--limits", "l.toml"]).contains("--limits"));
    assert!(nacre(["inspect", "nothing", "--out", &out]).expect(2).stderr().contains("--reference"));
}

//! Inspection from a user's point of view: capture, reconstruct, train limits, inspect one sheet and a folder.

#![allow(clippy::unwrap_used)]

use nacre_tests::{Place, nacre};
use std::fs;
use std::io::Read;

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
    // The PDF has the text of the page, and page numbers.
    let pdf = texts(&fs::read(place.text("all/bad/report.pdf")).unwrap());
    let hash = run.json()["reference"]["files"][0]["sha256"].as_str().unwrap().to_owned();
    for words in ["(Reject)", "(dirt)", "(Limits exceeded)", "(page 1 of ", &format!("(SHA-256 {hash})")] {
        assert!(pdf.contains(words), "no {words} in {pdf}");
    }
    assert!(page.contains(&hash) && page.contains("</svg>"));
    let defects = fs::read_to_string(place.text("all/bad/defects.csv")).unwrap();
    assert!(defects.lines().nth(1).unwrap().starts_with("1,dirt,"), "{defects}");
    let csv = fs::read_to_string(place.text("all/summary.csv")).unwrap();
    assert!(csv.contains("bad,reject,1,0,0,0,0,1") && csv.contains("fine,accept,0"), "{csv}");
}

/// The operators of all pages of a PDF: its streams that inflate to text.
fn texts(pdf: &[u8]) -> String {
    let starts = pdf.windows(8).enumerate().filter(|(at, w)| *w == b"\nstream\n" && *at > 0).map(|(at, _)| at + 8);
    let inflated = starts.filter_map(|at| {
        let mut text = String::new();
        flate2::read::ZlibDecoder::new(&pdf[at..]).read_to_string(&mut text).ok()?;
        Some(text)
    });
    inflated.collect()
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

//! Gratings from flash photographs from a user's point of view: simulated sheets of tiles, and rejected input.

#![allow(clippy::unwrap_used)]

use nacre_processing::image::read_exr;
use nacre_tests::http::Service;
use nacre_tests::{Place, nacre};
use serde_json::{Value, json};
use std::path::Path;

/// The 2018 paper's test on a small sheet.
const SHEET: &str = "tiles = [6, 5]\nwidth = 300\nheight = 230\ncoherence_um = 8\nband_nm = 4\nmisaligned_px = 2\n";

fn photographs(dir: &Path, scene: &str) -> String {
    let path = |name: &str| dir.join(name).to_str().unwrap().to_owned();
    std::fs::write(path("sheet.toml"), scene).unwrap();
    let photos = path("photos");
    nacre(["sim", "photograph", "tiles", "--scene", &path("sheet.toml"), "--out", &photos, "--force"]).expect(0);
    photos
}

fn run(photos: &str, out: &Path, more: &[&str]) -> nacre_tests::Run {
    let all = ["--json", "reconstruct", "flash", photos, "--out", out.to_str().unwrap()];
    nacre(all.iter().chain(more).map(|s| (*s).to_owned()).collect::<Vec<_>>())
}

const USUAL: [&str; 4] = ["--tiles", "6x5", "--size-mm", "178.2x131.25"];

#[test]
fn a_sheet_of_tiles_tells_its_period_and_its_polygons() {
    let dir = tempfile::tempdir().unwrap();
    let (photos, out) = (photographs(dir.path(), SHEET), dir.path().join("maps"));
    let report = run(&photos, &out, &USUAL).expect(0).json();
    let number = |v: &Value| v.as_f64().unwrap();
    let (um, sigma) = (number(&report["period"]["um"]), number(&report["period"]["sigma_um"]));
    assert!((um - 1.66).abs() < 3.0 * sigma && sigma < 0.03, "{report}");
    assert_eq!(report["relative"], false, "{report}");
    for name in ["orientation.exr", "period.exr", "orientation.png", "period.png", "sigma.png", "report.json"] {
        assert!(out.join(name).is_file(), "{name}");
    }
    let map = read_exr(&out.join("orientation.exr")).unwrap();
    let (angle, mask) = (&map.channels["orientation"], &map.channels["mask"]);
    let known: Vec<f64> = angle.iter().zip(mask).filter(|(_, m)| **m == 1.0).map(|(a, _)| f64::from(*a)).collect();
    assert!(2 * known.len() > angle.len(), "{} of {}", known.len(), angle.len());
    assert!(angle.iter().zip(mask).all(|(a, m)| a.is_finite() == (*m == 1.0)));
    // Directions are 7° plus multiples of 22.5°.
    let off = |a: &f64| {
        let steps = (a.to_degrees() - 7.0) / 22.5;
        22.5 * (steps - steps.round()).abs()
    };
    let near = known.iter().filter(|a| off(a) < 1.0).count();
    assert!(100 * near >= 99 * known.len(), "{near} of {}", known.len());
    // Existing files are not overwritten; a missed bound sets the exit code.
    run(&photos, &out, &USUAL).expect(2);
    run(&photos, &out, &[&USUAL[..], &["--force", "--max-error", "0.0001"]].concat()).expect(1);
    let paper = run(&photos, &out, &[&USUAL[..], &["--force", "--orientation", "image"]].concat()).expect(0).json();
    assert!(paper["warnings"].to_string().contains("biased"), "{paper}");
}

#[test]
fn what_makes_no_sense_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let photos = photographs(dir.path(), &format!("{SHEET}lights_mm = [[0, 0, 200]]\nexposures = [1]\n"));
    let out = dir.path().join("maps");
    let refused = |photos: &str, more: &[&str], word: &str| {
        let run = run(photos, &out, more).expect(2);
        assert!(run.stderr().contains(word), "{more:?}: {}", run.stderr());
        assert!(!out.exists(), "{more:?}");
    };
    refused(&photos, &[], "--size-mm");
    for (option, value, word) in [
        ("--tiles", "0x5", "--tiles"),
        ("--tiles", "6", "--tiles"),
        ("--size-mm", "nanx2", "--size-mm"),
        ("--period-um", "2:1", "--period-um"),
        ("--wavelength", "5", "--wavelength"),
        ("--orientation", "left", "--orientation"),
        ("--directions", "left", "--directions"),
        ("--pixel-mm", "0", "--pixel-mm"),
    ] {
        let usual: Vec<&str> = if option == "--tiles" || option == "--size-mm" { vec![] } else { USUAL.to_vec() };
        refused(&photos, &[&usual[..], &[option, value]].concat(), word);
    }
    refused(&photos, &["--reference-px", "1,1,1,1"], "--reference-px");
    refused(&photos, &["--size-mm", "178x131", "--corners", "0,0,0,0,0,0,0,0", "--camera-mm", "500"], "--corners");
    refused(dir.path().join("missing").to_str().unwrap(), &USUAL, "missing");
    // A light below the sheet, and missing photographs.
    let frames = dir.path().join("photos/frames.json");
    let text = std::fs::read_to_string(&frames).unwrap();
    std::fs::write(&frames, text.replace("200.0]", "-200.0]")).unwrap();
    refused(&photos, &USUAL, "light_mm");
    std::fs::write(&frames, text.replace("00-00.png", "gone.png")).unwrap();
    refused(&photos, &USUAL, "gone.png");
    std::fs::write(&frames, text.replace("\"flash\"", "\"exposures\"")).unwrap();
    refused(&photos, &USUAL, "frames.json");
}

#[test]
fn plans_say_what_their_tiles_are() {
    let place = Place::new("");
    let service = Service::start(&place, &[]);
    let asked = |reconstruct: Value| {
        let plan = json!({ "plan": { "kind": "flash", "exposures_ms": [5], "reconstruct": reconstruct } });
        service.post("/api/v1/sessions", &plan).expect(400).text()
    };
    let refused = asked(json!({ "method": "flash", "flash": { "tiles": [0, 4] } }));
    assert!(refused.contains("reconstruct.options.tiles") && !refused.contains("--"), "{refused}");
    assert!(asked(json!({ "method": "lut", "flash": { "tiles": [5, 4] } })).contains("reconstruct.flash"));
}

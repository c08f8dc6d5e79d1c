//! Keeping and choosing calibrations.

use super::*;
use crate::plan::{Limits, Plan};
use crate::setup::Setup;
use nacre_drivers::stage::Mounting;
use nacre_image::write_exr;
use nacre_sim::BenchConfig;
use serde_json::{Value, json};
use std::fs;

const DAY: u64 = 86_400;
const NOW: u64 = 1_000 * DAY;

/// A calibration's values by kind.
fn values(kind: CalibrationKind) -> Value {
    match kind {
        CalibrationKind::Camera => {
            json!({ "camera": { "noise": { "full_scale_e": 30_000, "read_noise_e": 6 }, "black": 60, "white": 4000, "gain": 1 } })
        }
        CalibrationKind::Flat => json!({ "flat": { "file": "flat.exr", "sigma": 0.001 } }),
        CalibrationKind::Analyser => json!({ "analyser": { "zero_deg": 1.5, "zero_sigma_deg": 0.01, "sense": 1 } }),
        CalibrationKind::Retarder => json!({ "retarder": { "panel_deg": 45, "azimuth_deg": 0, "azimuth_sigma_deg": 0.1,
            "retardance_deg": 92, "retardance_sigma_deg": 0.2 } }),
        CalibrationKind::Orientation => {
            json!({ "orientation": { "offset_deg": -0.7, "sigma_deg": 0.1, "model": "circle" } })
        }
    }
}

/// Writes results of a calibration, with a flat field of 64 × 48 pixels.
fn results(folder: &Path, values: &Value) {
    fs::create_dir_all(folder).unwrap();
    fs::write(folder.join(CALIBRATION_FILE), values.to_string()).unwrap();
    fs::write(folder.join(REPORT_FILE), "{}").unwrap();
    write_exr(&folder.join(FLAT_FILE), 64, 48, &["flat"], &[], &|_, _, row: &mut [f32]| row.fill(1.0)).unwrap();
}

fn limits() -> Limits {
    let mut bench = BenchConfig::default();
    (bench.camera.width, bench.camera.height) = (64, 48);
    let devices = nacre_sim::describe(&bench);
    Limits { stage: devices.stage, camera: devices.camera, display: devices.display, flash: None }
}

fn present() -> Present {
    Present::new(&limits(), None, &Setup { wavelength_nm: Some(560.0), ..Setup::default() }, None)
}

/// Calibrations in a folder, and results to keep.
struct Place {
    folder: tempfile::TempDir,
    choice: Choice,
}

impl Place {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let choice = Choice { calibrations: Calibrations::of_data(folder.path()), max_age_days: 90 };
        Self { folder, choice }
    }

    /// Keeps a calibration of the present devices from some days ago; returns its identifier.
    fn keep(&self, kind: CalibrationKind, days: u64, change: impl FnOnce(&mut Origin)) -> String {
        let result = self.folder.path().join("result");
        results(&result, &values(kind));
        let mut origin = Origin { taken: NOW - days * DAY, devices: present().devices(kind), ..Origin::default() };
        change(&mut origin);
        self.choice.calibrations.keep(new_id(), &Found::read(&result).unwrap(), origin).unwrap().id
    }

    fn choose(&self, plan: &str) -> Result<Chosen, String> {
        let plan: Plan = toml::from_str(plan).unwrap();
        plan.check_values().unwrap();
        self.choice.choose(&plan, &present(), NOW).map_err(|e| e.to_string())
    }
}

const PLAN: &str = "kind = \"polarization\"\nanalyser = { angles_deg = [0, 60, 120] }\n";

#[test]
fn every_kind_is_kept_whole_and_chosen_with_its_origin() {
    let place = Place::new();
    assert_eq!(place.choose(PLAN).unwrap(), Chosen::default());
    let ids = CalibrationKind::ALL.map(|kind| place.keep(kind, 3, |_| {}));
    let chosen = place.choose(PLAN).unwrap();
    assert!(chosen.warnings.is_empty(), "{:?}", chosen.warnings);
    let found = json!(chosen.calibration.unwrap());
    for (kind, id) in CalibrationKind::ALL.into_iter().zip(&ids) {
        let source = &found[kind.name()]["source"];
        assert_eq!((&source["id"], &source["taken"]), (&json!(id), &json!(NOW - 3 * DAY)), "{found}");
        let stored = place.choice.calibrations.read(id).unwrap();
        assert_eq!((stored.record.kind, kind.is_in(&stored.calibration)), (kind, true));
    }
    assert_eq!(fs::read(chosen.flat.unwrap()).unwrap(), fs::read(place.folder.path().join("result/flat.exr")).unwrap());
    place.choice.calibrations.remove(&ids[0]).unwrap();
    assert!(place.choice.calibrations.remove(&ids[0]).is_err());
    assert_eq!(place.choice.calibrations.entries().len(), 4);
}

#[test]
fn the_newest_of_the_devices_in_use_is_chosen_up_to_an_age() {
    use CalibrationKind::Camera;
    let place = Place::new();
    let old = place.keep(Camera, 91, |_| {});
    let warning = place.choose(PLAN).unwrap().warnings.join("; ");
    assert!(["91 days", "90 days", old.as_str()].iter().all(|word| warning.contains(word)), "{warning}");
    let used = |plan: &str| {
        let chosen = place.choose(plan).unwrap();
        assert!(chosen.warnings.is_empty(), "{:?}", chosen.warnings);
        chosen.calibration.and_then(|c| Some(c.camera?.source?.id))
    };
    let good = place.keep(Camera, 20, |_| {});
    place.keep(Camera, 30, |_| {});
    place.keep(Camera, 1, |origin| origin.devices = vec!["camera B".into()]);
    assert_eq!(used(PLAN), Some(good));
    assert_eq!(used(&format!("{PLAN}calibrations = \"off\"")), None);
    assert_eq!(used(&format!("{PLAN}calibrations = [\"{old}\"]")), Some(old.clone()));
    // A session that measures the camera does not use an earlier measurement.
    assert_eq!(used("kind = \"calibration\"\ncalibration = { of = \"camera\" }"), None);
    let of_camera = format!("kind = \"calibration\"\ncalibration = {{ of = \"camera\" }}\ncalibrations = [\"{old}\"]");
    assert!(place.choose(&of_camera).unwrap_err().contains("measures"));
}

#[test]
fn calibrations_of_another_bench_are_named() {
    use CalibrationKind::{Analyser, Camera, Flat, Orientation, Retarder};
    let mounting = Some(Mounting { zero_deg: 10.0, ..Mounting::default() });
    let other = |origin: &mut Origin| origin.devices = vec!["device B".into()];
    for (kind, change, words) in [
        (Camera, &other as &dyn Fn(&mut Origin), ["device B", present().devices(Camera)[0].clone().leak()]),
        (Flat, &other, ["device B", "flat field"]),
        (
            Flat,
            &|origin: &mut Origin| origin.conditions.region = Some([8, 0, 0, 0]),
            ["64 × 48 pixels from 8, 0", "from 0, 0"],
        ),
        (Analyser, &|origin: &mut Origin| origin.conditions.mounting = mounting, ["mounting", "analyser"]),
        (Orientation, &|origin: &mut Origin| origin.conditions.mounting = mounting, ["mounting", "orientations"]),
        (Retarder, &|origin: &mut Origin| origin.conditions.wavelength_nm = Some(630.0), ["630 nm", "560 nm"]),
    ] {
        let place = Place::new();
        let id = place.keep(kind, 1, change);
        let chosen = place.choose(PLAN).unwrap();
        assert_eq!((chosen.calibration, chosen.flat), (None, None), "{kind:?}");
        let warning = chosen.warnings.join("; ");
        assert!(words.iter().all(|word| warning.contains(word)) && chosen.warnings.len() == 1, "{warning}");
        let listed = place.choose(&format!("{PLAN}calibrations = [\"{id}\"]")).unwrap_err();
        assert!(listed.contains(&id) && listed.contains(words[0]), "{listed}");
    }
    let place = Place::new();
    let twice = [1, 2].map(|days| place.keep(Camera, days, |_| {}));
    assert!(place.choose(&format!("{PLAN}calibrations = {twice:?}")).unwrap_err().contains("second"));
    assert!(place.choose(&format!("{PLAN}calibrations = [\"{}\"]", new_id())).unwrap_err().contains("does not exist"));
}

#[test]
fn a_session_is_kept_once_with_its_conditions() {
    let place = Place::new();
    let folder = place.folder.path().join("s7");
    let mut plan = "kind = \"calibration\"\nname = \"lens A\"\ncalibration = { of = \"flat\" }".to_owned();
    plan += "\ncamera = { gain = 2, roi = [8, 4, 64, 48] }";
    let [stage, camera, display] = [CalibrationKind::Analyser, CalibrationKind::Camera, CalibrationKind::Retarder]
        .map(|kind| present().devices(kind).remove(0));
    let session = SessionFile {
        version: Version,
        software: "test".into(),
        created: NOW,
        plan: toml::from_str(&plan).unwrap(),
        devices: vec![stage, camera, display],
        exposure_s: 0.02,
        setup: Setup { wavelength_nm: Some(550.0), ..Setup::default() },
        bench: None,
        section: None,
        mounting: None,
        calibration: None,
        warnings: vec![],
    };
    results(&folder.join(RESULTS), &values(CalibrationKind::Flat));
    let calibrations = &place.choice.calibrations;
    assert!(calibrations.keep_session(&folder).is_err());
    fs::write(folder.join(crate::session::SESSION_FILE), json!(session).to_string()).unwrap();
    let kept = calibrations.keep_session(&folder).unwrap();
    assert_eq!(calibrations.keep_session(&folder).unwrap(), kept);
    assert_eq!((calibrations.entries().len(), kept.name.as_str(), kept.taken), (1, "lens A", NOW));
    assert_eq!((kept.session.as_deref(), &kept.devices), (Some("s7"), &present().devices(CalibrationKind::Flat)));
    assert_eq!((kept.conditions.region, kept.conditions.gain), (Some([8, 4, 64, 48]), Some(2.0)));
    let whole = place.choose(PLAN).unwrap();
    assert!(whole.flat.is_none() && whole.warnings[0].contains("64 × 48 pixels from 8, 4"), "{:?}", whole.warnings);
}

#[test]
fn results_that_are_no_calibration_are_refused() {
    let place = Place::new();
    let result = place.folder.path().join("result");
    let camera = values(CalibrationKind::Camera);
    let with = |pointer: &str, value: Value| {
        let mut changed = camera.clone();
        *changed.pointer_mut(pointer).unwrap() = value;
        changed
    };
    let mut two = camera.clone();
    two["analyser"] = values(CalibrationKind::Analyser)["analyser"].clone();
    for (values, word) in [
        (json!({}), "one kind"),
        (two, "one kind"),
        (json!({ "blur_px": 2 }), "blur_px"),
        (with("/camera/gain", json!(0)), "camera.gain"),
        (with("/camera/white", json!(60)), "camera.white"),
        (with("/camera/noise/read_noise_e", json!(-1)), "read_noise_e"),
    ] {
        results(&result, &values);
        let error = Found::read(&result).unwrap_err().to_string();
        assert!(error.contains(word), "{word}: {error}");
    }
    let keep = |values: &Value, origin: Origin| {
        results(&result, values);
        place.choice.calibrations.keep(new_id(), &Found::read(&result).unwrap(), origin).unwrap_err().to_string()
    };
    let origin = || Origin { devices: vec!["camera A".into()], ..Origin::default() };
    assert!(keep(&camera, Origin::default()).contains("devices"));
    assert!(keep(&camera, Origin { name: "a\nb".into(), ..origin() }).contains("name"));
    let averaged = Conditions { average: Some(4), ..Conditions::default() };
    assert!(keep(&camera, Origin { conditions: averaged, ..origin() }).contains("average"));
    assert!(keep(&json!({ "flat": { "file": "../flat.exr", "sigma": 0 } }), origin()).contains("flat.exr"));
    assert!(place.choice.calibrations.entries().is_empty());
    // Damage of a stored one is reported, and the others are used.
    let id = place.keep(CalibrationKind::Camera, 1, |_| {});
    fs::write(place.folder.path().join(FOLDER).join(&id).join(CALIBRATION_FILE), "{").unwrap();
    let analyser = place.keep(CalibrationKind::Analyser, 1, |_| {});
    let chosen = place.choose(PLAN).unwrap();
    assert!(chosen.warnings.join("; ").contains(&id), "{:?}", chosen.warnings);
    assert_eq!(chosen.calibration.unwrap().analyser.unwrap().source.unwrap().id, analyser);
}

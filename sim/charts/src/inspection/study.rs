//! Studies of inspections: missed defects and false alarms against size and noise.

use super::{Judged, KINDS, Trial};
use nacre_base::{Error, Result};
use nacre_inspect::Parameters;
use nacre_studies::{Axis, Effort, Outcome, Scene, Setting, Study};

/// Areas of defects in pixels, and full wells of the camera in electrons.
const AREAS_PX: [f64; 6] = [3.0, 5.0, 7.0, 10.0, 20.0, 40.0];
const WELLS_E: [f64; 5] = [2_000.0, 5_000.0, 10_000.0, 20_000.0, 40_000.0];

/// Position of 10 pixels and of 20,000 electrons.
const DEFAULT_AREA: usize = 3;
const REFERENCE: usize = 3;

/// Parameters of all inspections: the defaults of the program.
pub const PARAMETERS: Parameters = Parameters { false_alarms: 0.1, min_area_px: 4, max_turn_deg: 10.0, trained: None };

/// Quantity of a study, from all sheets of a run.
type Quantity = fn(&[Judged]) -> f64;

/// Both studies.
pub(crate) fn studies(effort: Effort) -> Vec<Study> {
    let missed = |all: &[Judged]| {
        let planted: usize = all.iter().map(|j| j.planted.len()).sum();
        let found: usize = all.iter().flat_map(|j| &j.planted).filter(|p| p.1.is_some()).count();
        1.0 - found as f64 / planted.max(1) as f64
    };
    let false_alarms = |all: &[Judged]| {
        let [hits, wrong] = all.iter().fold([0, 0], |s, j| [s[0] + j.hits, s[1] + j.false_alarms]);
        wrong as f64 / (hits + wrong).max(1) as f64
    };
    vec![
        study(effort, "inspection-recall", "Missed defects (1 - recall)", "missed share of defects", missed),
        study(effort, "inspection-precision", "False alarms (1 - precision)", "false share of regions", false_alarms),
    ]
}

fn study(effort: Effort, name: &'static str, title: &'static str, error: &str, quantity: Quantity) -> Study {
    let sheets = effort.pick(8, 2);
    let setting = |(k, area): (usize, &f64)| {
        let setting = Setting::new("area", format!("{area} px"), *area);
        if k == DEFAULT_AREA { setting.as_default() } else { setting }
    };
    Study {
        name,
        group: "inspection",
        title: title.into(),
        question: format!(
            "Sheets of {} patterns, 256 × 256 pixels, photographed at 12 angles, turned by up to 3° and shifted by up to 5 mm, with ten planted defects of five \
             classes each (missing; orientation off by 10° to 80°; period off by a factor of 0.7 to 0.85 or 1.2 to 1.5; scratches of 0.7 pixels; dirt). Each run \
             inspects {sheets} sheets against a capture of the clean sheet (`nacre inspect`), without trained limits.",
            KINDS.len()
        ),
        knob: Axis::log("area of a defect", "px"),
        stress: Axis::log("full well of the camera", "e⁻"),
        error: Axis::linear(error, ""),
        time: Axis::log("time of an inspection", "s"),
        predicted: "",
        settings: AREAS_PX.iter().enumerate().map(setting).collect(),
        scenes: WELLS_E.iter().map(|well| Scene::new(*well)).collect(),
        reference: REFERENCE,
        run: Box::new(move |setting, scene, seed| {
            let judged: Vec<Judged> = (0..sheets).map(|k| trial(k, seed, setting, scene)).collect::<Result<_>>()?;
            let seconds = judged.iter().map(|j| j.seconds).sum::<f64>() / judged.len().max(1) as f64;
            Ok(Outcome { error: Some(quantity(&judged)), seconds, masked: 0.0, wrong: 0.0, predicted: None })
        }),
    }
}

fn trial(k: usize, seed: u64, setting: usize, scene: usize) -> Result<Judged> {
    let folder = tempfile::tempdir().map_err(|e| Error::output(&std::env::temp_dir(), e))?;
    let trial = Trial { area_px: AREAS_PX[setting], well_e: WELLS_E[scene], ..Trial::of(k, seed) };
    Ok(trial.judged(folder.path(), &PARAMETERS)?.0)
}

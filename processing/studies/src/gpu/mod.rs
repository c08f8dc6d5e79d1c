//! Studies of rendering on a graphics card: agreement with the processor, and speed relative to the card's limits.

mod scenes;
mod speed;

use super::{Axis, Drawn, Effort, Outcome, Picture, Scene, Setting, Study};
use nacre_base::{Error, Result};
use nacre_render::{difference, gpu};
use scenes::{Files, MATERIALS};
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::sync::{LazyLock, Mutex, PoisonError};

const SAMPLES: [usize; 5] = [4, 8, 16, 32, 64];
const ERRORS: [f64; 6] = [0.3, 0.1, 0.03, 0.01, 0.003, 0.001];

/// Number of samples in the study of the truncation error; the same for all settings.
const FEW: usize = 8;

/// Truncation error of sums in the study of the number of samples: the default of `nacre render`.
const DEFAULT: f64 = 0.0025;

/// Truncation error of the reference, negligible against the studied ones.
const EXACT: f64 = 1e-4;

/// Name of the graphics card, if there is one; queried once.
static ADAPTER: LazyLock<Option<String>> = LazyLock::new(|| gpu::adapter().ok());

/// The varied parameter.
#[derive(Clone, Copy, PartialEq)]
enum Knob {
    Samples,
    Errors,
}

/// Studies of the number of samples, and of the truncation error of sums over orders and wavelengths.
pub fn studies(effort: Effort) -> Vec<Study> {
    vec![study(Knob::Samples, effort), study(Knob::Errors, effort)]
}

/// Picture of the frame rate relative to the card's limits.
pub fn pictures() -> Vec<Picture> {
    vec![Picture {
        name: "gpu-speed",
        group: "gpu",
        title: "Frames per second on the graphics card, and what it could do",
        text: "A sample of each of 1920 × 1080 pixels, maps of 2048 × 2048. Operations and texels of a pixel are counted by the shaders \
               themselves; the card's best is measured with shaders that add a texture to the picture, and that multiply and add. Bytes are those \
               that must move through memory: a texel of the maps, if there are any, and the sum of the samples, to and fro. Software draws the middle of the frame alone.",
        draw,
    }]
}

fn draw() -> Result<Drawn> {
    match &*ADAPTER {
        Some(_) => speed::draw(pictures()[0].title),
        None => Ok(speed::nothing(pictures()[0].title)),
    }
}

fn study(knob: Knob, effort: Effort) -> Study {
    let devices = ["the processor".to_owned()].into_iter().chain(ADAPTER.clone());
    let settings = devices.flat_map(|device| {
        let samples = SAMPLES.map(|n| (Setting::new(&device, format!("{n} samples"), n as f64), n == 64));
        let errors = ERRORS.map(|e| (Setting::new(&device, format!("{} %", 100.0 * e), e), e == 0.003));
        let all = if knob == Knob::Samples { samples.to_vec() } else { errors.to_vec() };
        let default = device == "the processor";
        all.into_iter().map(move |(s, usual)| match (usual, default) {
            (true, true) => s.as_default(),
            (true, false) => s,
            (false, _) => s.without_sweep(),
        })
    });
    let (name, title, question, axis) = match knob {
        Knob::Samples => (
            "gpu-samples",
            "Samples per pixel, on the card and on the processor",
            "Do both show the same, and how long do they take? A flat sample of each material under a light or a sky, against the processor with \
             at least eight times as many samples. Both take the middle of the pixel's parts by other rules, so that they agree but for noise.",
            Axis::log("samples", ""),
        ),
        Knob::Errors => (
            "gpu-sums",
            "Error asked of the sums over orders and wavelengths",
            "What does exactness cost? The same eight samples of each pixel, with sums off by as much as asked for, against the same device \
             with sums to 0.01 %: reach and step of lobes in wave numbers, and on the processor the highest order, follow from it.",
            Axis::log("error of sums", ""),
        ),
    };
    let side = effort.pick(96, 20);
    let bench = Bench { side, knob, truth: effort.pick(1024, 512), known: Mutex::default(), card: Mutex::default() };
    let settings: Vec<Setting> = settings.collect();
    let count = if knob == Knob::Samples { SAMPLES.len() } else { ERRORS.len() };
    Study {
        name,
        group: "gpu",
        title: title.into(),
        question: question.into(),
        knob: axis,
        stress: Axis::names("material"),
        error: Axis::log("mean CIEDE2000 of what is lit", ""),
        time: Axis::log(&format!("time of {side} × {side} pixels"), "s"),
        predicted: "",
        settings,
        scenes: MATERIALS.iter().enumerate().map(|(k, m)| Scene::named(k, m.name)).collect(),
        reference: 0,
        run: Box::new(move |setting, scene, seed| bench.run(setting % count, scene, seed, setting >= count)),
    }
}

/// Reference pictures by scene, seed and device (`true` for the card).
type Known = BTreeMap<(usize, u64, bool), Vec<[f32; 3]>>;

/// Pictures of one study.
struct Bench {
    side: usize,
    knob: Knob,
    /// Samples per pixel of the reference picture.
    truth: usize,
    known: Mutex<Known>,
    card: Mutex<gpu::Kept>,
}

impl Bench {
    fn run(&self, setting: usize, scene: usize, seed: u64, on_card: bool) -> Result<Outcome> {
        let files = Files::written(64)?;
        let text = scenes::scene(&MATERIALS[scene], [self.side; 2], seed);
        let picture = |samples, error, on_card: bool| {
            let mut kept = on_card.then(|| self.card.lock().unwrap_or_else(PoisonError::into_inner));
            gpu::timed(&scenes::parsed(&text)?, files.folder.path(), samples, error, kept.as_deref_mut())
        };
        let (found, key) = match self.knob {
            Knob::Samples => (picture(SAMPLES[setting], DEFAULT, on_card)?, (scene, seed, false)),
            Knob::Errors => (picture(FEW, ERRORS[setting], on_card)?, (scene, seed, on_card)),
        };
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let (samples, error) = match self.knob {
            Knob::Samples => (self.truth * MATERIALS[scene].noise, DEFAULT),
            Knob::Errors => (FEW, EXACT),
        };
        let truth = match known.entry(key) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(place) => place.insert(picture(samples, error, key.2)?.pixels),
        };
        let off = difference(truth, &found.pixels);
        let error = (off.lit > 0).then_some(off.mean);
        Ok(Outcome { error, seconds: found.seconds, masked: 0.0, wrong: 0.0, predicted: None })
    }
}

/// Error for an internal file that could not be created or read.
fn broken(what: &str, why: impl std::fmt::Display) -> Error {
    Error::input(what, why, "report this")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// More samples reduce the difference to the reference, and a smaller truncation error approaches the exact sums.
    #[test]
    fn knobs_have_their_effect() {
        for (study, last) in studies(Effort::Quick).iter().zip([SAMPLES.len() - 1, ERRORS.len() - 1]) {
            let error = |setting| (study.run)(setting, 0, 5).unwrap().error.unwrap();
            let (coarse, fine) = (error(0), error(last));
            assert!(fine < 0.5 * coarse, "{}: {coarse} {fine}", study.name);
        }
    }
}

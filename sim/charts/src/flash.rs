//! Studies of gratings from flash photographs of repeated tiles: number of lights, lobe fits, and violated assumptions
//! of the method.

use nacre_base::Error;
use nacre_base::Result;
use nacre_base::progress::Silent;
use nacre_image::OutputFolder;
use nacre_periods::flash::{Orientation, PeriodChoice, Settings, reconstruct};
use nacre_sim::photographs::{Pattern, Periods, Score, TilesPhotograph};
use nacre_studies::{Axis, Effort, Outcome, Scene, Setting, Study};
use std::time::Instant;

/// Error measure of a study.
#[derive(Clone, Copy)]
enum Compared {
    /// Mean orientation error further than two pixels from an edge, in degrees.
    Orientation,
    /// Mean orientation error within two pixels of an edge, in degrees.
    Edges,
    /// Root mean square of the relative error of the period.
    Period,
}

/// Name of a setting, and its change to the options of the reconstruction.
type Way = (&'static str, fn(Settings) -> Settings);

/// Description of one study: question, stress axis and settings.
struct Sheet {
    name: &'static str,
    title: &'static str,
    question: &'static str,
    axis: Axis,
    values: &'static [f64],
    reference: usize,
    compared: Compared,
    /// Settings; the first is the default of the program.
    settings: &'static [Way],
    scene: fn(f64, TilesPhotograph) -> TilesPhotograph,
    /// Introduces a wrong assumption into the options.
    misled: fn(f64, &TilesPhotograph, Settings) -> Settings,
}

const PLAIN: Way = ("lobes fitted", |s| s);
const PIXELS: Way = ("lobes fitted, a period per pixel", |s| Settings { period: PeriodChoice::Pixel, ..s });
const PAPER: Way = ("brightest copy (paper)", |s| Settings { orientation: Orientation::Image, ..s });

fn same(_: f64, _: &TilesPhotograph, settings: Settings) -> Settings {
    settings
}

/// All studies of flash photographs.
pub(super) fn studies(effort: Effort) -> Vec<Study> {
    [
        lights(Compared::Orientation, "flash", "Orientations from flash photographs"),
        lights(Compared::Period, "flash-period", "Periods from flash photographs"),
        lobe(),
        tiles(),
        height(),
        wavelength(),
        tilt(),
        crossed(),
        order(),
    ]
    .map(|sheet| sheet.study(effort))
    .into()
}

/// 6 × 5 tiles as in the paper's test, photographed at low resolution.
fn sheet(effort: Effort, seed: u64) -> TilesPhotograph {
    let [width, height] = effort.pick([480, 370], [280, 220]);
    TilesPhotograph {
        seed,
        tiles: [6, 5],
        width,
        height,
        coherence_um: 8.0,
        band_nm: 4.0,
        ..TilesPhotograph::default()
    }
}

impl Sheet {
    fn study(self, effort: Effort) -> Study {
        let values: Vec<f64> = match effort {
            Effort::Full => self.values.to_vec(),
            Effort::Quick => self.values.iter().copied().step_by(2).collect(),
        };
        let reference = if effort == Effort::Quick { self.reference / 2 } else { self.reference };
        let setting = |(k, (name, _)): (usize, &Way)| {
            let setting = Setting::new(name, *name, k as f64);
            if k == 0 { setting.as_default() } else { setting }
        };
        let error = match self.compared {
            Compared::Orientation => Axis::log("mean orientation error inside polygons", "°"),
            Compared::Edges => Axis::log("mean orientation error within two pixels of an edge", "°"),
            Compared::Period => Axis::log("relative error of the period (RMS)", ""),
        };
        let scenes = values.iter().copied().map(Scene::new).collect();
        Study {
            name: self.name,
            group: "flash",
            title: self.title.into(),
            question: format!(
                "{} A sheet of 6 × 5 tiles of 24 polygons in 8 directions, 600 lines per mm unless said otherwise, at 560 nm under a \
                 Gaussian light (2018 paper, section 7.1). A pixel counts as confidently wrong when its orientation or period is off by more than \
                 five of its own σ.",
                self.question
            ),
            knob: Axis::names("way"),
            stress: self.axis,
            error,
            time: Axis::log("time per sheet", "s"),
            predicted: "σ as the maps have it (RMS)",
            settings: self.settings.iter().enumerate().map(setting).collect(),
            scenes,
            reference,
            run: Box::new(move |setting, at, seed| {
                let scene = (self.scene)(values[at], sheet(effort, seed));
                let plain =
                    Settings { tiles: Some(scene.tiles), size_mm: Some(scene.sheet_mm()), ..Settings::default() };
                let settings = (self.settings[setting].1)((self.misled)(values[at], &scene, plain));
                outcome(&scene, &settings, self.compared)
            }),
        }
    }
}

/// Simulates the photographs, reconstructs the maps and compares them with the printed pattern.
fn outcome(scene: &TilesPhotograph, settings: &Settings, compared: Compared) -> Result<Outcome> {
    let home = tempfile::tempdir().map_err(|e| Error::input("temporary folder", e, "make room for it"))?;
    let (photographs, out) = (home.path().join("in"), home.path().join("out"));
    let folder = OutputFolder::begin(&photographs, false)?;
    scene.write(&folder)?;
    folder.commit()?;
    let begun = Instant::now();
    let report = reconstruct(&photographs, &out, settings, &Silent)?;
    let seconds = begun.elapsed().as_secs_f64();
    let score: Score = scene.score(&out, &report)?;
    let (error, predicted) = match compared {
        Compared::Orientation => (score.inside_deg, score.said_deg),
        Compared::Edges => (score.edge_deg, score.said_deg),
        Compared::Period => (score.bias.hypot(score.spread), score.said_period),
    };
    let known = |v: f64| v.is_finite().then_some(v.max(1e-6));
    Ok(Outcome { error: known(error), seconds, masked: score.masked, wrong: score.wrong, predicted: known(predicted) })
}

fn lights(compared: Compared, name: &'static str, title: &'static str) -> Sheet {
    Sheet {
        name,
        title,
        question: "How many lights does it take? With few, many places have no copy near a lobe, and are masked.",
        axis: Axis::linear("lights", ""),
        values: &[1.0, 2.0, 3.0, 4.0, 5.0],
        reference: 4,
        compared,
        settings: &[PLAIN, PIXELS, PAPER],
        scene: |n, s| TilesPhotograph { lights_mm: TilesPhotograph::spread(n as usize), ..s },
        misled: same,
    }
}

fn lobe() -> Sheet {
    Sheet {
        name: "flash-lobe",
        title: "The size of the light",
        question: "A large light makes wide lobes, which many copies see; a small one narrow lobes, between which copies fall.",
        axis: Axis::log("standard deviation of the light, 200 mm away", "mm"),
        values: &[1.5, 2.0, 3.0, 4.5, 6.0, 8.0, 11.0],
        reference: 4,
        compared: Compared::Orientation,
        settings: &[PLAIN, PIXELS, PAPER],
        scene: |mm, s| TilesPhotograph { light_sigma_mm: mm, ..s },
        misled: same,
    }
}

fn tiles() -> Sheet {
    Sheet {
        name: "flash-tiles",
        title: "Tiles that lie beside their grid",
        question: "Each tile lies up to so many pixels beside its place along each axis.",
        axis: Axis::linear("misaligned by up to", "px"),
        values: &[0.0, 0.5, 1.0, 2.0, 3.0],
        reference: 4,
        compared: Compared::Edges,
        settings: &[PLAIN, ("left on the grid", |s| Settings { unregistered: true, ..s }), PAPER],
        scene: |px, s| TilesPhotograph { misaligned_px: px, ..s },
        misled: same,
    }
}

fn height() -> Sheet {
    Sheet {
        name: "flash-geometry",
        title: "A wrong height of the light",
        question: "The light is said to be so much higher than it is, 200 mm above the sheet.",
        axis: Axis::log("height too large by", "mm"),
        values: &[0.2, 0.5, 1.0, 2.0, 5.0, 10.0],
        reference: 2,
        compared: Compared::Period,
        settings: &[PLAIN, PIXELS],
        // The true elevations of the lights are lower than those in the options; frames.json does not contain them.
        scene: |_, s| s,
        misled: |mm, scene, s| Settings { light_height_mm: Some(scene.lights_mm[0][2] + mm), ..s },
    }
}

fn wavelength() -> Sheet {
    Sheet {
        name: "flash-wavelength",
        title: "A wrong wavelength",
        question: "The wavelength is said to be so much longer than it is. Nothing in the photographs tells.",
        axis: Axis::log("too long by", "nm"),
        values: &[0.5, 1.0, 2.0, 5.0, 10.0],
        reference: 1,
        compared: Compared::Period,
        settings: &[PLAIN],
        scene: |_, s| s,
        misled: |nm, scene, s| Settings { wavelength_nm: Some(scene.wavelength_nm + nm), ..s },
    }
}

fn tilt() -> Sheet {
    Sheet {
        name: "flash-tilt",
        title: "A tilted sheet",
        question: "The sheet is turned about the axis that points up, and the geometry does not know.",
        axis: Axis::log("tilt", "°"),
        values: &[0.1, 0.2, 0.5, 1.0, 2.0],
        reference: 3,
        compared: Compared::Period,
        settings: &[PLAIN, ("lights where they are said to be", |s| Settings { trust_lights: true, ..s })],
        scene: |degrees, s| TilesPhotograph { tilt_deg: [0.0, degrees], ..s },
        misled: same,
    }
}

fn crossed() -> Sheet {
    Sheet {
        name: "flash-crossed",
        title: "Two gratings in one place",
        question: "So much of every polygon has grooves across the others.",
        axis: Axis::linear("share of the crossed grooves", ""),
        values: &[0.0, 0.05, 0.1, 0.2, 0.3, 0.5],
        reference: 2,
        compared: Compared::Orientation,
        settings: &[PLAIN, PAPER],
        scene: |share, s| TilesPhotograph { pattern: Pattern { crossed: share, ..s.pattern.clone() }, ..s },
        misled: same,
    }
}

fn order() -> Sheet {
    Sheet {
        name: "flash-order",
        title: "Second orders taken for first",
        question: "Periods are only known to lie between 1 and 6 µm: the longer they are, the more orders are in the picture.",
        axis: Axis::log("period", "µm"),
        values: &[1.2, 1.66, 2.2, 2.8, 3.3, 4.0],
        reference: 1,
        compared: Compared::Period,
        settings: &[PLAIN, PIXELS, PAPER],
        scene: |um, s| {
            let pattern = Pattern { periods: Periods::Uniform(um), ..s.pattern.clone() };
            TilesPhotograph { pattern, light_sigma_mm: 4.0, ..s }
        },
        misled: |_, _, s| Settings { period_um: Some([1.0, 6.0]), ..s },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With fitted lobes the errors are small; the paper's brightest-copy method is far off for the same photographs.
    #[test]
    fn fitted_lobes_beat_the_brightest_copy() {
        let study = lights(Compared::Orientation, "flash", "").study(Effort::Quick);
        let of = |setting| (study.run)(setting, 2, 3).unwrap();
        let (fitted, paper) = (of(0), of(2));
        assert!(
            fitted.error.unwrap() < 0.3 && paper.error.unwrap() > 5.0 * fitted.error.unwrap(),
            "{fitted:?} {paper:?}"
        );
    }
}

//! Studies of the spot scan: number of patterns, noise, and stress. The stress studies cover errors of geometry,
//! wavelength and display exponent, periods out of range, and mixed pixels.

mod job;

pub use job::{Judged, Shown, bench, judged, photograph};

use nacre_base::{Error, Result};
use nacre_periods::fringes::Settings;
use nacre_sim::BenchConfig;
use nacre_studies::{Axis, Effort, Outcome, Scene, Setting, Study};

/// All studies of the spot scan.
pub(super) fn studies(effort: Effort) -> Vec<Study> {
    vec![patterns(effort), geometry(effort), wavelength(effort), exponent(effort), reach(effort), mixed(effort)]
}

/// One run: the true bench, the bench described in `frames.json`, the fringes and the options.
struct Run {
    bench: BenchConfig,
    nominal: BenchConfig,
    shown: Shown,
    settings: Settings,
}

impl Run {
    fn new(seed: u64, pixels: u32) -> Self {
        let bench = bench(seed, pixels);
        Self { nominal: bench.clone(), bench, shown: Shown::default(), settings: Settings::default() }
    }

    fn outcome(&self) -> Result<Outcome> {
        let folder = tempfile::tempdir().map_err(|e| Error::output(&std::env::temp_dir(), e))?;
        let found =
            job::judged_with_nominal_bench(&self.bench, &self.nominal, &self.shown, &self.settings, folder.path())?;
        let percent = |v: f64| Some(100.0 * v).filter(|v| v.is_finite());
        Ok(Outcome {
            error: percent(found.period),
            seconds: found.seconds,
            masked: found.masked,
            wrong: found.wrong,
            predicted: percent(found.promised),
        })
    }
}

/// Description of one study of this module.
struct Varied {
    name: &'static str,
    title: &'static str,
    question: &'static str,
    knob: Axis,
    stress: Axis,
    values: Vec<f64>,
    reference: usize,
    /// Names and values of the settings; the first is the default of the program.
    settings: Vec<(&'static str, f64)>,
    change: fn(setting: f64, stress: f64, run: &mut Run),
}

impl Varied {
    fn study(self, effort: Effort) -> Study {
        let (values, change, pixels) = (self.values.clone(), self.change, effort.pick(96, 48));
        let knobs: Vec<f64> = self.settings.iter().map(|s| s.1).collect();
        let setting = |(k, (name, value)): (usize, &(&'static str, f64))| {
            let method = if self.knob.name == "fringes" { "fringes" } else { *name };
            let setting = Setting::new(method, *name, *value);
            if k == 0 { setting.as_default() } else { setting }
        };
        Study {
            name: self.name,
            group: "spots",
            title: self.title.into(),
            question: format!(
                "{} A mosaic of random polygons, periods of 1.2 to 3 µm, 25 cm from a panel of 52 × 32 cm, at 560 nm; {pixels} × {pixels} \
                 pixels. A pixel counts as confidently wrong when its answer is more than five of its σ, and more than 2 % or 1°, off \
                 everything that is seen there.",
                self.question
            ),
            knob: self.knob.clone(),
            stress: self.stress.clone(),
            error: Axis::log("median error of the period", "%"),
            time: Axis::log("time of the reconstruction", "s"),
            predicted: "the error that σ promises",
            settings: self.settings.iter().enumerate().map(setting).collect(),
            scenes: self.values.iter().map(|v| Scene::new(*v)).collect(),
            reference: self.reference,
            run: Box::new(move |setting, scene, seed| {
                let mut run = Run::new(seed, pixels as u32);
                change(knobs[setting], values[scene], &mut run);
                run.outcome()
            }),
        }
    }
}

/// Number of fringe patterns, against noise.
fn patterns(effort: Effort) -> Study {
    Varied {
        name: "spots-patterns",
        title: "How many fringes a spot scan needs",
        question: "So many different fringes, at four phases each, and three frames of even light.",
        knob: Axis::linear("fringes", ""),
        stress: Axis::log("electrons at white", "e⁻"),
        values: vec![300.0, 1000.0, 4000.0, 40_000.0],
        reference: 3,
        settings: vec![
            ("12 fringes", 12.0),
            ("5 fringes", 5.0),
            ("7 fringes", 7.0),
            ("9 fringes", 9.0),
            ("15 fringes", 15.0),
        ],
        change: |count, electrons, run| {
            run.shown.count = count as usize;
            run.bench.camera.well_e = electrons;
            // The photon rate is unchanged. Read noise is 8 electrons, at most 1 % of the well capacity.
            run.bench.camera.read_noise_e = 8.0_f64.min(0.01 * electrons);
            run.nominal.camera = run.bench.camera.clone();
        },
    }
    .study(effort)
}

/// Error of the display's position.
fn geometry(effort: Effort) -> Study {
    Varied {
        name: "spots-geometry",
        title: "A panel that is not where it is said to be",
        question: "The panel is further to the right than the geometry says. The mirrored light tells, as far as the surface is believed to \
                   be uneven.",
        knob: Axis::names("believed tilt of the surface"),
        stress: Axis::linear("panel displaced", "mm"),
        values: vec![0.0, 0.5, 1.0, 2.0, 4.0, 8.0],
        reference: 2,
        settings: vec![("0.2°", 0.2), ("0.02°", 0.02), ("1°", 1.0)],
        change: |deg, moved, run| {
            run.settings.mirror_deg = deg;
            run.nominal.geometry.baseline_mm = run.bench.geometry.baseline_mm - moved;
        },
    }
    .study(effort)
}

/// Error of the filter's centre wavelength.
fn wavelength(effort: Effort) -> Study {
    Varied {
        name: "spots-wavelength",
        title: "A wrong wavelength",
        question: "The filter's middle is longer than the photographs say. All periods scale with it, which no fringe can tell; the \
                   standard deviation that is admitted is what keeps the answer honest.",
        knob: Axis::names("admitted"),
        stress: Axis::linear("wavelength off by", "nm"),
        values: vec![0.0, 1.0, 3.0, 6.0, 12.0],
        reference: 2,
        settings: vec![("nothing admitted", 0.0), ("1 nm", 1.0), ("5 nm", 5.0)],
        change: |sigma, off, run| {
            run.settings.wavelength_sigma_nm = Some(sigma).filter(|s| *s > 0.0);
            run.bench.filter.wavelength_nm += off;
        },
    }
    .study(effort)
}

/// Error of the display's exponent.
fn exponent(effort: Effort) -> Study {
    Varied {
        name: "spots-exponent",
        title: "A panel of another exponent",
        question: "The panel is driven for an exponent of 2.2 and has another. Harmonics of the fringes then light other places.",
        knob: Axis::names("phases"),
        stress: Axis::linear("exponent of the panel", ""),
        values: vec![1.8, 2.0, 2.2, 2.4, 2.6],
        reference: 3,
        settings: vec![("4 phases", 4.0), ("3 phases", 3.0), ("5 phases", 5.0)],
        change: |phases, gamma, run| {
            run.shown.phases = phases as usize;
            run.bench.panel.gamma = gamma;
        },
    }
    .study(effort)
}

/// Periods whose orders miss the display because they are too short.
fn reach(effort: Effort) -> Study {
    Varied {
        name: "spots-reach",
        title: "Periods out of reach",
        question: "Mosaics whose shortest period is this, and whose longest 2.5 times that. Orders of short periods miss the panel: these \
                   pixels must be masked.",
        knob: Axis::names("camera to panel"),
        stress: Axis::log("shortest period", "µm"),
        values: vec![0.4, 0.6, 0.8, 1.0, 1.2, 1.6],
        reference: 2,
        settings: vec![("100 mm", 100.0), ("0 mm", 0.0), ("300 mm", 300.0)],
        change: |baseline, period, run| {
            run.bench.sample.period_um = Some(period);
            run.bench.geometry.baseline_mm = baseline;
            run.nominal.geometry.baseline_mm = baseline;
            run.settings.periods_um = [0.3, 5.0];
        },
    }
    .study(effort)
}

/// Several gratings in a pixel.
fn mixed(effort: Effort) -> Study {
    Varied {
        name: "spots-mixed",
        title: "Several gratings in a pixel",
        question: "So many of the sample's dots of 50 µm have a random orientation, and a pixel sees several dots. A pixel without one \
                   grating that outshines the others must be masked.",
        knob: Axis::names("fringes of"),
        stress: Axis::linear("mixed dots", ""),
        values: vec![0.0, 0.05, 0.1, 0.2, 0.4, 0.8],
        reference: 2,
        settings: vec![("28 mm", 28.0), ("20 mm", 20.0), ("45 mm", 45.0)],
        change: |finest, share, run| {
            run.shown.finest_mm = finest;
            run.bench.sample.mixed_dots = share;
        },
    }
    .study(effort)
}

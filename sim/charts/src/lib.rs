#![doc = include_str!("../README.md")]

pub mod bench_calibration;
mod bokeh;
mod calibration;
mod environment;
mod factor;
mod flash;
mod foil;
mod hdr;
pub mod inspection;
mod lut;
mod maxwell;
mod period;
mod photographs;
mod prediction;
mod render;
mod series;
mod shots;
mod slits;
pub mod spots;
mod surface;
mod two_pass;

use nacre_polarimetry::{Align, Model, Oblique, Options};
use nacre_sim::BenchConfig;
use nacre_sim::surface::SampleKind;
use nacre_studies::{Axis, Effort, Scene, Setting, Study};
use photographs::outcome;

/// All studies, in the order of the documentation page.
pub fn studies(effort: Effort) -> Vec<Study> {
    let mut all = vec![wedge(effort), oblique(effort), compact_disc(effort), series::study(effort), hdr::study(effort)];
    all.extend(period::studies(effort));
    all.extend(calibration::studies(effort));
    all.extend(bench_calibration::study::studies(effort));
    all.extend(foil::studies(effort));
    all.extend(lut::studies(effort));
    all.extend(bokeh::studies(effort));
    all.extend(surface::studies(effort));
    all.extend(spots::studies(effort));
    all.extend(flash::studies(effort));
    all.extend(environment::studies(effort));
    all.push(factor::study(effort));
    all.extend(render::studies(effort));
    all.push(two_pass::study(effort));
    all.extend(inspection::study::studies(effort));
    all.extend([slits::study(effort), prediction::study(effort)]);
    all.extend(maxwell::studies(effort));
    all
}

/// Description of one study on the simulated bench: the options of each setting, and the parameter that the stress axis
/// varies.
struct Bench {
    name: &'static str,
    title: &'static str,
    question: &'static str,
    stress: Axis,
    values: Vec<f64>,
    reference: usize,
    /// Name and options of each setting; the first is the default of the program.
    settings: Vec<(&'static str, Options)>,
    config: fn(f64, &mut BenchConfig),
}

impl Bench {
    fn study(mut self, effort: Effort) -> Study {
        if effort == Effort::Quick {
            self.values = self.values.iter().copied().step_by(2).collect();
            self.reference /= 2;
        }
        let (values, config, pixels) = (self.values.clone(), self.config, effort.pick(256, 192));
        let options: Vec<Options> = self.settings.iter().map(|s| s.1.clone()).collect();
        let setting = |(k, (name, _)): (usize, &(&str, Options))| {
            let setting = Setting::new(name, *name, k as f64);
            if k == 0 { setting.as_default() } else { setting }
        };
        Study {
            name: self.name,
            group: "bench",
            title: self.title.into(),
            question: self.question.into(),
            knob: Axis::names("treatment"),
            stress: self.stress,
            error: Axis::log("mean orientation error", "°"),
            time: Axis::log(&format!("time of the reconstruction of {pixels} × {pixels} pixels"), "s"),
            predicted: "the error that σ promises",
            settings: self.settings.iter().enumerate().map(setting).collect(),
            scenes: self.values.into_iter().map(Scene::new).collect(),
            reference: self.reference,
            run: Box::new(move |setting, at, seed| {
                let mut bench = BenchConfig { seed, ..BenchConfig::default() };
                (bench.camera.width, bench.camera.height) = (pixels, pixels);
                config(values[at], &mut bench);
                outcome(&bench, &options[setting])
            }),
        }
    }
}

/// Image shift caused by a wedged analyser.
fn wedge(effort: Effort) -> Study {
    let options = |align| Options { model: Some(Model::Sinusoid), align: Some(align), ..Options::default() };
    Bench {
        name: "stress-wedge",
        title: "Photographs shifted by a wedged analyser",
        question: "The kinematic sample without a film, seen through an analyser whose faces are not parallel, so that the photograph runs \
                   around a circle of this radius as it turns. The shifts are found and undone, as the program does when they are \
                   worth it, or left. At every edge a shifted photograph shows another orientation.",
        stress: Axis::linear("radius of the circle", "px"),
        values: vec![0.0, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 4.0],
        reference: 5,
        settings: vec![
            ("moved back", options(Align::Auto)),
            ("left as they are", options(Align::Off)),
        ],
        config: |wedge_px, bench| bench.analyser.wedge_px = wedge_px,
    }
    .study(effort)
}

/// Settings with and without the correction of oblique incidence.
fn corrected() -> Vec<(&'static str, Options)> {
    let options = |oblique| Options { oblique, ..Options::default() };
    vec![("as if at the normal", options(Oblique::Off)), ("oblique incidence taken out", options(Oblique::Auto))]
}

/// Illumination from the side.
fn oblique(effort: Effort) -> Study {
    Bench {
        name: "stress-oblique",
        title: "Oblique incidence",
        question: "A piece of a compact disc, 4 cm wide, without a film, 40 cm from the camera; the distance between camera and light \
                   grows. 30 cm is the 2018 paper's bench (section 7.2), where it reports 3.62° ± 3.02°. Its own correction needs the \
                   sample turned and photographed again; this one needs only the distances.",
        stress: Axis::linear("camera to light, 40 cm away", "mm"),
        values: vec![20.0, 60.0, 100.0, 200.0, 300.0, 400.0, 500.0],
        reference: 4,
        settings: corrected(),
        config: |baseline_mm, bench| {
            bench.sample.kind = SampleKind::Cd;
            bench.sample.size_mm = Some(40.0);
            (bench.geometry.distance_mm, bench.geometry.baseline_mm) = (400.0, baseline_mm);
        },
    }
    .study(effort)
}

/// A whole compact disc under a film.
fn compact_disc(effort: Effort) -> Study {
    Bench {
        name: "compact-disc",
        title: "A compact disc under a film",
        question: "A whole compact disc of aluminium under a film with its axis at 20°, which reflects 5 % at its front, 60 cm from the \
                   camera and with the light 10 cm beside it; 20,000 electrons, stray light in the room. Its hub is a mirror. The \
                   model is chosen by the program.",
        stress: Axis::linear("film retardance Δn", "°"),
        values: vec![0.0, 1.0, 3.0, 6.0, 10.0],
        reference: 4,
        settings: corrected(),
        config: |retardance_deg, bench| {
            bench.sample.kind = SampleKind::Cd;
            bench.camera.well_e = 20_000.0;
            bench.film.retardance_deg = retardance_deg;
            (bench.geometry.distance_mm, bench.geometry.baseline_mm) = (600.0, 100.0);
        },
    }
    .study(effort)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Shifted photographs have larger errors than registered ones; registered ones match those of a plane-parallel
    /// analyser. Hardly any pixel deviates by more than 5 σ.
    #[test]
    fn moving_photographs_back_pays() {
        let study = wedge(Effort::Quick);
        let at = study.scenes.iter().position(|s| s.value == 1.0).unwrap_or_default();
        let error = |setting, at| {
            let found = (study.run)(setting, at, 3).unwrap();
            assert!(found.wrong <= 1e-3, "{setting} {at}: {found:?}");
            found.error.unwrap()
        };
        let (never, back, left) = (error(0, 0), error(0, at), error(1, at));
        assert!(back < 0.5 * left && back < 1.5 * never, "{never} {back} {left}");
    }
}

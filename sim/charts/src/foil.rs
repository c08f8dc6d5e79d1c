//! Studies of foil with random dots: bins of the measured distribution, size of the flash, depth of the gratings, and
//! synthesised maps.

use super::environment::Last;
use nacre_base::Result;
use nacre_lut::foil::{Distribution, Dots, Light, Settings, Shape, measure, synthesize};
use nacre_sim::photographs::FoilPhotograph;
use nacre_sim::random::{electrons, key};
use nacre_studies::{Axis, Effort, Outcome, Scene, Setting, Study};
use std::f64::consts::PI;
use std::time::Instant;

/// Options of the measurement: bins of orientation and of spatial frequency, and whether the depth is given.
#[derive(Clone, Copy)]
struct Way {
    bins: Option<[usize; 2]>,
    depth: bool,
}

const BINS: [[usize; 2]; 5] = [[12, 8], [24, 16], [48, 32], [96, 64], [192, 128]];
const FLASH_MM: [f64; 7] = [1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0];
const DEPTHS_UM: [f64; 7] = [0.02, 0.05, 0.08, 0.12, 0.16, 0.2, 0.3];

/// Sampling points of the density comparison along orientation and along spatial frequency.
const COMPARED: [usize; 2] = [192, 256];

/// Range of grating periods in µm.
const PERIODS_UM: [f64; 2] = [0.75, 1.8];

/// Exposures of a bracket, relative to the shortest.
const EXPOSURES: [f64; 3] = [256.0, 16.0, 1.0];

/// Studies against the size of the flash, the depth of the gratings, and the size of synthesised maps.
pub(super) fn studies(effort: Effort) -> Vec<Study> {
    let size = Axis::log("diameter of the flash", "mm");
    let depth = Axis::log("depth of the gratings", "µm");
    vec![
        measured(effort, "foil", "Bins of a foil's distribution, and the light's size", size, &FLASH_MM, |p, mm| {
            p.flash_diameter_mm = mm;
        }),
        measured(
            effort,
            "foil-depth",
            "Bins of a foil's distribution, and the gratings' depth",
            depth,
            &DEPTHS_UM,
            |p, um| {
                p.depth_um = um;
            },
        ),
        synthesis(effort),
    ]
}

fn ways() -> Vec<(Setting, Way)> {
    let mut all = vec![
        (Setting::new("bins by pixels", "auto", 0.0).as_default(), Way { bins: None, depth: false }),
        (Setting::new("bins by pixels, depth said", "auto, depth said", 0.0), Way { bins: None, depth: true }),
    ];
    all.extend(BINS.map(|bins| {
        let setting = Setting::new("bins as said, depth said", format!("{} × {}", bins[0], bins[1]), bins[0] as f64);
        let way = Way { bins: Some(bins), depth: true };
        (if bins == BINS[1] { setting } else { setting.without_sweep() }, way)
    }));
    all
}

fn measured(
    effort: Effort,
    name: &'static str,
    title: &str,
    stress: Axis,
    values: &'static [f64],
    change: fn(&mut FoilPhotograph, f64),
) -> Study {
    let side = effort.pick(320, 160);
    let (settings, ways): (Vec<Setting>, Vec<Way>) = ways().into_iter().unzip();
    let value = |k: &usize| Scene::new(values[*k]);
    let last = Last::new();
    let scenes: Vec<usize> = (0..values.len()).step_by(effort.pick(1, 2)).collect();
    Study {
        name,
        group: "foil",
        title: title.into(),
        question: format!(
            "A photograph of {side} × {side} pixels of a foil of random dots whose periods rise from 1.0 to 1.45 µm with the orientation, under a flash of 4 mm, 0.08 µm deep unless \
             varied; three exposures merged. How many bins of orientation and of lines should the distribution have, and does it help to say the depth? By default bins are as \
             fine as pixels allow, and gratings are taken for shallow. The error is the total variation between the measured and the true density \
             (0: equal, 1: nothing in common), over periods of {} to {} µm. Masked: dots in bins that the photograph does not show. Wrong and confident: bins that are \
             more than five of their σ off, which holds noise and not blur, by the part of the dots in them.",
            PERIODS_UM[0], PERIODS_UM[1]
        ),
        knob: Axis::log("bins of orientation", ""),
        stress,
        error: Axis::log("total variation from the true distribution", ""),
        time: Axis::log("time of sorting", "s"),
        predicted: "",
        settings,
        scenes: scenes.iter().map(value).collect(),
        reference: scenes.len() / 3,
        run: Box::new(move |setting, scene, seed| {
            let make = || {
                let mut photograph = scene_of(side);
                change(&mut photograph, values[scenes[scene]]);
                let values = merged(&photograph.radiance()?, &photograph, seed);
                Ok((Light { width: side, height: side, values }, photograph))
            };
            let taken = last.get(scene, seed, make)?;
            run(&taken.0, &taken.1, ways[setting])
        }),
    }
}

/// A photograph that shows the same part of the pattern at every size.
fn scene_of(side: usize) -> FoilPhotograph {
    let plain = FoilPhotograph::default();
    let pixel_um = plain.pixel_um * plain.width as f64 / side as f64;
    FoilPhotograph { width: side, height: side, pixel_um, ..plain }
}

/// Merged bracket: each pixel takes its value from the longest exposure that is not saturated.
fn merged(radiance: &[f64], scene: &FoilPhotograph, seed: u64) -> Vec<f32> {
    let peak = radiance.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let pixel = |(i, value): (usize, &f64)| {
        let level = scene.level * value / peak;
        let longest = EXPOSURES.into_iter().find(|e| level * e < 1.0).unwrap_or(1.0);
        let arrived = electrons(key(&[seed, i as u64]), level * longest * scene.full_scale_e, scene.read_noise_e);
        (arrived / scene.full_scale_e / longest) as f32
    };
    radiance.iter().enumerate().map(pixel).collect()
}

fn run(light: &Light, scene: &FoilPhotograph, way: Way) -> Result<Outcome> {
    let settings = Settings {
        bins: way.bins,
        depth_um: way.depth.then_some(scene.depth_um),
        period_um: Some(PERIODS_UM),
        ..Settings::default()
    };
    let begun = Instant::now();
    let (found, _) = measure(light, &scene.geometry(), &settings)?;
    let seconds = begun.elapsed().as_secs_f64();
    Ok(judged(&found, scene, seconds))
}

/// Density of dots at an orientation (rad) and spatial frequency (1/µm), per rad and 1/µm.
fn truth(scene: &FoilPhotograph, theta: f64, lines: f64) -> f64 {
    scene.density(theta, 1.0 / lines) / (lines * lines)
}

fn judged(found: &Distribution, scene: &FoilPhotograph, seconds: f64) -> Outcome {
    let [low, high] = PERIODS_UM.map(|um| 1.0 / um);
    let (low, high) = (high, low);
    let [across, along] = COMPARED;
    let area = PI / across as f64 * (high - low) / along as f64;
    let bin_area = |k: usize| PI / found.orientations as f64 * (found.edge(k + 1) - found.edge(k));
    let mut true_share = vec![0.0; found.share.len()];
    let (mut apart, mut masked) = (0.0, 0.0);
    for k in 0..across * along {
        let theta = PI * ((k % across) as f64 + 0.5) / across as f64;
        let lines = low + (high - low) * ((k / across) as f64 + 0.5) / along as f64;
        let part = truth(scene, theta, lines) * area;
        let Some(bin) = found.bin(theta, 1.0 / lines) else {
            apart += part;
            masked += part;
            continue;
        };
        true_share[bin] += part;
        if found.coverage[bin] > 0.0 {
            apart += (found.share[bin] / bin_area(bin / found.orientations) * area - part).abs();
        } else {
            masked += part;
        }
    }
    let wrong = (0..true_share.len())
        .filter(|b| found.coverage[*b] > 0.0 && (found.share[*b] - true_share[*b]).abs() > 5.0 * found.sigma[*b]);
    let wrong = wrong.map(|b| true_share[b]).sum::<f64>().min(1.0);
    Outcome { error: Some(0.5 * apart), seconds, masked: masked.min(1.0), wrong, predicted: None }
}

/// Dot sizes of the synthesised maps: side lengths in pixels.
const SQUARES: [usize; 5] = [1, 2, 4, 8, 16];
const DISCS: [f64; 3] = [4.0, 8.0, 16.0];
const SIDES: [usize; 5] = [64, 128, 256, 512, 1024];

fn synthesis(effort: Effort) -> Study {
    let sides: Vec<usize> = SIDES[..effort.pick(5, 3)].to_vec();
    let squares = SQUARES.map(|s| (Setting::new("squares", format!("squares of {s} px"), s as f64), Shape::Square(s)));
    let discs = DISCS.map(|d| (Setting::new("discs", format!("discs of {d} px"), d), Shape::Disc(d)));
    let all = squares.into_iter().chain(discs);
    let few = |(setting, shape): (Setting, Shape)| {
        let shown = [Shape::Square(1), Shape::Square(4), Shape::Square(16), Shape::Disc(4.0)].contains(&shape);
        (if shown { setting } else { setting.without_sweep() }, shape)
    };
    let (settings, shapes): (Vec<Setting>, Vec<Shape>) = all.map(few).unzip();
    Study {
        name: "synthesis",
        group: "foil",
        title: "Dots of a new map".into(),
        question: "How well does a map of random dots show the distribution (60 × 40 bins) that it is drawn from? Dots are drawn in even steps of the cumulated distribution, \
                   so that marginals come out better than by chance, which the dashed line is. The shape and the size of dots and of the map are the user's: there is no default. \
                   The error is the total variation of orientations, by area. Masked: the part that no dot covers."
            .into(),
        knob: Axis::log("size of a dot", "px"),
        stress: Axis::log("side of the map", "px"),
        error: Axis::log("total variation of orientations", ""),
        time: Axis::log("time per megapixel", "s"),
        predicted: "independent draws",
        settings,
        scenes: sides.iter().map(|s| Scene::new(*s as f64)).collect(),
        reference: 2,
        run: Box::new(move |setting, scene, seed| {
            let side = sides[scene];
            let dots = Dots { size: [side, side], pixel_um: 25.0, shape: shapes[setting].clone(), seed };
            let from = spiral();
            let begun = Instant::now();
            let made = synthesize(&from, &dots)?.report;
            Ok(Outcome {
                error: Some(made.total_variation[0]),
                seconds: begun.elapsed().as_secs_f64() / (side * side) as f64 * 1e6,
                masked: made.bare,
                wrong: 0.0,
                predicted: Some(made.expected[0]),
            })
        }),
    }
}

/// Distribution of the simulated bench's foil.
fn spiral() -> Distribution {
    let (orientations, periods) = (60, 40);
    let scene = FoilPhotograph::default();
    let mut found = Distribution {
        orientations,
        periods,
        lines_per_um: PERIODS_UM.map(|um| 1.0 / um),
        share: vec![],
        sigma: vec![0.0; orientations * periods],
        coverage: vec![1.0; orientations * periods],
        relative: false,
    };
    found.lines_per_um.reverse();
    let share = |at: usize| {
        let theta = PI * ((at % orientations) as f64 + 0.5) / orientations as f64;
        truth(&scene, theta, 0.5 * (found.edge(at / orientations) + found.edge(at / orientations + 1)))
    };
    let share: Vec<f64> = (0..orientations * periods).map(share).collect();
    let sum: f64 = share.iter().sum();
    Distribution { share: share.into_iter().map(|s| s / sum).collect(), ..found }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A large flash blurs the distribution; a given depth removes second orders; more dots reduce the sampling error.
    #[test]
    fn studies_show_where_distributions_fail() {
        let [size, depth, dots]: [Study; 3] = studies(Effort::Quick).try_into().ok().unwrap();
        let error = |study: &Study, setting, scene| (study.run)(setting, scene, 3).unwrap().error.unwrap();
        let [small, large] = [1, 3].map(|scene| error(&size, 1, scene));
        assert!(large > 1.5 * small, "{small} {large}");
        let [shallow, said] = [0, 1].map(|setting| error(&depth, setting, 3));
        assert!(said < 0.7 * shallow, "{shallow} {said}");
        let [small, large] = [0, 2].map(|scene| error(&dots, 2, scene));
        assert!(large < 0.5 * small, "{small} {large}");
    }
}

//! Study of exposure brackets: number of exposures and of electrons. The radiance covers twelve stops; brackets of
//! different steps are merged.

use nacre_base::Result;
use nacre_frames::hdr::merge;
use nacre_frames::{Frame, FrameSet, Kind, Transfer};
use nacre_image::{Raster, Samples};
use nacre_polarimetry::NoiseModel;
use nacre_sim::random::{electrons, key};
use nacre_studies::{Axis, Effort, Outcome, Scene, Setting, Study};
use std::time::Instant;

const EXPOSURES: [usize; 7] = [1, 2, 3, 4, 5, 7, 13];
const ELECTRONS: [f64; 6] = [300.0, 1000.0, 3000.0, 10_000.0, 40_000.0, 160_000.0];
const REFERENCE: usize = 4;

/// Dynamic range of the radiance in stops, and span of a bracket in stops.
const RANGE_EV: f64 = 12.0;

const READ_NOISE: f64 = 8.0;

/// A camera: name, largest code value and response curve.
struct Camera {
    name: &'static str,
    white: f64,
    transfer: Transfer,
}

const CAMERAS: [Camera; 2] = [
    Camera { name: "12 bits, linear", white: 4095.0, transfer: Transfer::Linear },
    Camera { name: "8 bits, gamma 2.2", white: 255.0, transfer: Transfer::Gamma(2.2) },
];

/// Study of 1 to 13 exposures of two cameras.
pub(super) fn study(effort: Effort) -> Study {
    let pixels = effort.pick(512 * 512, 4096);
    let settings = CAMERAS.iter().flat_map(|camera| {
        EXPOSURES.map(|n| {
            let step = if n > 1 { format!("{n} × {:.1} EV", RANGE_EV / (n - 1) as f64) } else { "1 exposure".into() };
            let setting = Setting::new(camera.name, step, n as f64);
            match n {
                7 => setting.as_default(),
                1 | 3 | 13 => setting,
                _ => setting.without_sweep(),
            }
        })
    });
    Study {
        name: "hdr",
        group: "hdr",
        title: "Exposures of a bracket".into(),
        question: "How many exposures does light over 12 powers of two (4096 : 1) need? Brackets in even steps from the exposure in \
                   which the brightest is white to one 4096 times as long; sensors whose white is so many electrons (8 electrons \
                   read noise). The error is the root mean square of relative errors below 50 %, over what was measured; light that \
                   is off by more than five of its own standard deviations counts as confidently wrong, and what is saturated in \
                   every exposure, or less than three standard deviations above nothing, as masked."
            .into(),
        knob: Axis::linear("exposures", ""),
        stress: Axis::log("electrons at white", "e⁻"),
        error: Axis::log("relative error", ""),
        time: Axis::log("time per megapixel", "s"),
        predicted: "the error that the variance promises",
        settings: settings.collect(),
        scenes: ELECTRONS.map(Scene::new).to_vec(),
        reference: REFERENCE,
        run: Box::new(move |setting, scene, seed| {
            let camera = &CAMERAS[setting / EXPOSURES.len()];
            run(camera, EXPOSURES[setting % EXPOSURES.len()], ELECTRONS[scene], pixels, seed)
        }),
    }
}

fn run(camera: &Camera, exposures: usize, full: f64, pixels: usize, seed: u64) -> Result<Outcome> {
    let light = |i: usize| (-(RANGE_EV * i as f64) / pixels as f64).exp2();
    let step = if exposures > 1 { RANGE_EV / (exposures - 1) as f64 } else { 0.0 };
    let times: Vec<f64> = (0..exposures).map(|k| (step * k as f64).exp2()).collect();
    let photograph = |(k, time): (usize, &f64)| {
        let code = |i: usize| {
            let arrived = electrons(key(&[seed, k as u64, i as u64]), light(i) * time * full, READ_NOISE);
            let level = (arrived / full).clamp(0.0, 1.0);
            let encoded = if let Transfer::Gamma(g) = camera.transfer { level.powf(1.0 / g) } else { level };
            (encoded * camera.white).round()
        };
        let samples = if camera.white < 256.0 {
            Samples::U8((0..pixels).map(|i| code(i) as u8).collect())
        } else {
            Samples::U16((0..pixels).map(|i| code(i) as u16).collect())
        };
        Raster { width: pixels, height: 1, channels: 1, samples }
    };
    let rasters: Vec<Raster> = times.iter().enumerate().map(photograph).map(squared).collect();
    let frames = times.iter().map(|t| Frame { exposure_s: Some(*t), ..Frame::new("simulated") }).collect();
    let set = FrameSet {
        transfer: camera.transfer,
        white: Some(camera.white),
        noise: Some(NoiseModel { full_scale_e: full, read_noise_e: READ_NOISE }),
        ..FrameSet::new(Kind::Exposures, frames)
    };
    let begun = Instant::now();
    let merged = merge(set, rasters)?;
    let seconds = begun.elapsed().as_secs_f64() / pixels as f64 * 1e6;
    let (mut square, mut promised, mut known, mut wrong) = (0.0, 0.0, 0.0, 0.0);
    for (i, [found, variance]) in merged.samples.iter().enumerate() {
        let (found, variance, truth) = (f64::from(*found), f64::from(*variance), light(i));
        if found.is_nan() || found < 3.0 * variance.sqrt() {
            continue;
        }
        wrong += f64::from(u8::from((found - truth).abs() > 5.0 * variance.sqrt()));
        square += (found / truth - 1.0).powi(2).min(0.25);
        promised += (variance / (truth * truth)).min(0.25);
        known += 1.0;
    }
    let root = |sum: f64| (known > 0.0).then(|| (sum / known).sqrt());
    let all = pixels as f64;
    Ok(Outcome {
        error: root(square),
        seconds,
        masked: 1.0 - known / all,
        wrong: wrong / all,
        predicted: root(promised),
    })
}

/// Reshapes the raster to a square, so that its sides stay below the limit for images.
fn squared(raster: Raster) -> Raster {
    let side = (raster.width as f64).sqrt() as usize;
    Raster { width: side, height: side, ..raster }
}

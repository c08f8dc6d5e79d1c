//! Study of circular against linear illumination, behind an unknown film.

use super::scene::{PROMISED, fitted, judge, orientation_error, pixels, ratio, time};
use crate::{Axis, Effort, Outcome, Scene, Setting, Study};
use nacre_base::Result;
use nacre_polarimetry::synthetic::{Photographs, Source, Synthetic};
use nacre_polarimetry::{OrientationMaps, StokesMaps};
use rayon::prelude::*;
use std::f64::consts::PI;
use std::time::Instant;

const RETARDANCES: [f64; 10] = [0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 15.0, 20.0];
/// Azimuths of linear light in degrees; the film's axis is at 20°.
const LINEAR: [f64; 5] = [0.0, 20.0, 45.0, 65.0, 90.0];
const REFERENCE: usize = 5;

/// Both use the same estimator: the point of the film-free curve closest to (S1/S0, S2/S0).
pub(super) fn study(effort: Effort) -> Study {
    let mut settings = vec![Setting::new("circular", "circular", 0.0).as_default()];
    settings.extend(LINEAR.map(|a| Setting::new(&format!("linear, {a}°"), format!("linear, {a}°"), a)));
    Study {
        name: "illumination",
        group: "polarimetry",
        title: "Circular against linear light, behind a film".into(),
        question: "Why the retarder in front of the panel? Linear light tells orientations too as long as the sample is bare: each has \
                   its own (S1/S0, S2/S0), though some share it. Here r 1.2 and ζ 150° are known, the film (axis at 20°) is not: every \
                   pixel gets the orientation whose film-free point is nearest. σ is the noise of the point over the speed of the \
                   film-free curve; pixels with σ over 7.2° are masked."
            .into(),
        knob: Axis::names("light"),
        stress: Axis::linear("film retardance Δn", "°"),
        error: orientation_error(),
        time: time(),
        predicted: PROMISED,
        settings,
        scenes: RETARDANCES.map(Scene::new).to_vec(),
        reference: REFERENCE,
        run: Box::new(move |setting, scene, seed| {
            let source = match setting.checked_sub(1) {
                Some(at) => Source::Linear(LINEAR[at].to_radians()),
                None => Source::Circular,
            };
            run(source, RETARDANCES[scene], pixels(effort), seed)
        }),
    }
}

fn run(source: Source, film_deg: f64, pixels: usize, seed: u64) -> Result<Outcome> {
    let bare = Synthetic { ratio: ratio(1.2, 150.0), source, ..Synthetic::default() };
    let scene = Synthetic { retardance: film_deg.to_radians(), axis: 20f64.to_radians(), ..bare.clone() };
    let photographs = scene.render(pixels, seed)?;
    let begun = Instant::now();
    let maps = fitted(&photographs);
    let map = nearest(&maps, &photographs, &Curve::of(&bare));
    let seconds = begun.elapsed().as_secs_f64() / pixels as f64 * 1e6;
    Ok(judge(&map.orientation, &map.sigma, &photographs.truth, seconds))
}

/// Curve of (S1/S0, S2/S0) over all orientations.
struct Curve {
    points: Vec<[f64; 2]>,
    /// Arc length per rad of orientation.
    speeds: Vec<f64>,
}

impl Curve {
    const POINTS: usize = 1440;

    fn of(scene: &Synthetic) -> Self {
        let at = |k: usize| {
            let s = scene.stokes(PI * k as f64 / Self::POINTS as f64);
            [s.s1 / s.s0, s.s2 / s.s0]
        };
        let points: Vec<[f64; 2]> = (0..Self::POINTS).map(at).collect();
        let step = 2.0 * PI / Self::POINTS as f64;
        let speed = |k: usize| {
            let (a, b) = (points[(k + Self::POINTS - 1) % Self::POINTS], points[(k + 1) % Self::POINTS]);
            (b[0] - a[0]).hypot(b[1] - a[1]) / step
        };
        let speeds = (0..Self::POINTS).map(speed).collect();
        Self { points, speeds }
    }
}

/// Largest unmasked σ in rad: the limit of the sinusoid model.
const MASKED: f64 = 0.125;

fn nearest(maps: &StokesMaps, photographs: &Photographs, curve: &Curve) -> OrientationMaps {
    let noise = photographs.noise[0];
    let frames = photographs.noise.len() as f64;
    let pixel = |i: usize| -> (f32, f32) {
        let (s0, s1, s2) = (f64::from(maps.s0[i]), f64::from(maps.s1[i]), f64::from(maps.s2[i]));
        let (x, y) = (s1 / s0, s2 / s0);
        let distance = |p: &[f64; 2]| (p[0] - x).powi(2) + (p[1] - y).powi(2);
        let best =
            (0..Curve::POINTS).min_by(|a, b| distance(&curve.points[*a]).total_cmp(&distance(&curve.points[*b])));
        let best = best.unwrap_or(0);
        // C and S have the variance 2 σ_I² / N, and A = S0 / 2.
        let point = (2.0 * (noise.shot * s0 / 2.0 + noise.floor) / frames).sqrt() / (s0 / 2.0);
        let sigma = (point / curve.speeds[best].max(1e-12)).min(PI / 2.0);
        let theta = PI * best as f64 / Curve::POINTS as f64;
        (if sigma <= MASKED && s0 > 0.0 { theta as f32 } else { f32::NAN }, sigma as f32)
    };
    let (orientation, sigma) = (0..maps.s0.len()).into_par_iter().map(pixel).unzip();
    OrientationMaps { width: maps.width, height: maps.height, orientation, sigma }
}

//! Studies of the number of smoothing rounds: noise reduction on even regions, and errors at edges and on slopes.

use super::scene::{PROMISED, judge, orientation_error, time};
use crate::{Axis, Effort, Outcome, Scene, Setting, Study};
use nacre_base::progress::Silent;
use nacre_base::{Error, Result};
use nacre_polarimetry::synthetic::normal;
use nacre_polarimetry::{OrientationMaps, Smoothing, smooth};
use std::f64::consts::PI;
use std::time::Instant;

const ROUNDS: [u32; 7] = [0, 1, 3, 10, 30, 50, 100];
const STEPS_DEG: [f64; 8] = [1.0, 2.0, 5.0, 10.0, 20.0, 30.0, 45.0, 90.0];
const SLOPES_DEG: [f64; 8] = [0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 20.0];

/// Noise of the orientation in degrees.
const NOISE_DEG: f64 = 1.0;

/// Side of the squares of alternating orientation, in pixels.
const SQUARE: usize = 20;

/// Studies of steps between regions, and of slopes.
pub(super) fn studies(effort: Effort) -> Vec<Study> {
    let steps = study(
        effort,
        "smooth",
        "Rounds of smoothing, and steps between regions",
        &format!(
            "Squares of {SQUARE} px of two orientations, {NOISE_DEG}° of noise. Smoothing averages within a square and keeps its edges, \
             as long as the step between them is well above the noise"
        ),
        (Axis::log("step between regions", "°"), STEPS_DEG.to_vec(), 4),
        |step, x, y| if (x / SQUARE + y / SQUARE).is_multiple_of(2) { 0.7 } else { 0.7 + step },
    );
    let slopes = study(
        effort,
        "smooth-slope",
        "Rounds of smoothing, and slopes",
        &format!(
            "Orientations that rise evenly from left to right, {NOISE_DEG}° of noise. Where they slope, the window shrinks until all rounds \
             together reach over no more than the noise"
        ),
        (Axis::log("slope", "°/px"), SLOPES_DEG.to_vec(), 3),
        |slope, x, _| slope * x as f64,
    );
    vec![steps, slopes]
}

fn study(
    effort: Effort,
    name: &'static str,
    title: &str,
    scene: &str,
    (stress, mut values, mut reference): (Axis, Vec<f64>, usize),
    truth: fn(f64, usize, usize) -> f64,
) -> Study {
    let side = effort.pick(160, 60);
    if effort == Effort::Quick {
        values.truncate(6);
        reference = reference.min(4);
    }
    let setting = |n: &u32| {
        let label = if *n == 1 { "1 round".into() } else { format!("{n} rounds") };
        let setting = Setting::new("bilateral filter", label, f64::from(*n));
        match n {
            10 => setting.as_default(),
            0 | 3 | 50 => setting,
            _ => setting.without_sweep(),
        }
    };
    Study {
        name,
        group: "polarimetry",
        title: title.into(),
        question: format!(
            "{scene}. By default pictures are smoothed in ten rounds (--smooth light) and maps are not smoothed; --smooth strong takes 50. \
             A map of {side} × {side} pixels; the dashed line is the error that the smoothed map's own σ promises."
        ),
        knob: Axis::linear("rounds", ""),
        stress,
        error: orientation_error(),
        time: time(),
        predicted: PROMISED,
        settings: ROUNDS.iter().map(setting).collect(),
        scenes: values.iter().copied().map(Scene::new).collect(),
        reference,
        run: Box::new(move |setting, scene, seed| {
            let value = values[scene].to_radians();
            run(side, ROUNDS[setting], |x, y| truth(value, x, y), seed)
        }),
    }
}

fn run(side: usize, rounds: u32, truth: impl Fn(usize, usize) -> f64, seed: u64) -> Result<Outcome> {
    let smoothing: Smoothing =
        rounds.to_string().parse().map_err(|problem: String| Error::input("rounds", problem, "report this"))?;
    let sigma = NOISE_DEG.to_radians();
    let truth: Vec<f64> = (0..side * side).map(|i| truth(i % side, i / side).rem_euclid(PI)).collect();
    let noisy = |(i, t): (usize, &f64)| (t + sigma * normal(seed, i as u64)).rem_euclid(PI) as f32;
    let map = OrientationMaps {
        width: side,
        height: side,
        orientation: truth.iter().enumerate().map(noisy).collect(),
        sigma: vec![sigma as f32; side * side],
    };
    let begun = Instant::now();
    let found = smooth(&map, smoothing, 1.0, &Silent)?;
    let seconds = begun.elapsed().as_secs_f64() / (side * side) as f64 * 1e6;
    let truth: Vec<f32> = truth.into_iter().map(|t| t as f32).collect();
    Ok(judge(&found.orientation, &found.sigma, &truth, seconds))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten rounds reduce the noise of even regions and of gentle slopes. Steps near the noise are lost, and fifty
    /// rounds lose more of them.
    #[test]
    fn smoothing_gains_on_even_regions_and_loses_small_steps() {
        let [steps, slopes]: [Study; 2] = studies(Effort::Full).try_into().ok().unwrap();
        let error = |study: &Study, rounds: u32, value: f64| {
            let setting = ROUNDS.iter().position(|r| *r == rounds).unwrap();
            let scene = study.scenes.iter().position(|s| s.value == value).unwrap();
            (study.run)(setting, scene, 3).unwrap().error.unwrap()
        };
        assert!(error(&steps, 10, 90.0) < 0.4 * error(&steps, 0, 90.0));
        assert!(error(&steps, 50, 2.0) > error(&steps, 3, 2.0));
        assert!(error(&slopes, 10, 0.03) < 0.4 * error(&slopes, 0, 0.03));
        assert!(error(&slopes, 10, 10.0) < 1.2 * error(&slopes, 0, 10.0));
    }
}

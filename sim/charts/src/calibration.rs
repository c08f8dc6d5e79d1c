//! Studies of camera calibration: number of photographs of a board, corner noise and board tilt.

use nacre_base::Result;
use nacre_base::progress::Silent;
use nacre_optics::geometry::{Camera, Pose};
use nacre_periods::calibration::{Board, of_corners};
use nacre_sim::random::{key, normals, uniform};
use nacre_studies::{Axis, Effort, Outcome, Scene, Setting, Study};
use std::f64::consts::{PI, TAU};
use std::path::PathBuf;
use std::time::Instant;

const PHOTOGRAPHS: [usize; 6] = [3, 5, 8, 13, 20, 40];
const NOISE_PX: [f64; 7] = [0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0];
const TILT_DEG: [f64; 7] = [0.5, 1.0, 3.0, 8.0, 15.0, 30.0, 45.0];
const BOARD: Board = Board { columns: 9, rows: 6, square_mm: 25.0 };
const SIZE: [usize; 2] = [640, 480];

/// A camera with lens distortion.
const CAMERA: Camera =
    Camera { focal_px: [620.0, 615.0], center_px: [326.0, 236.0], distortion: [-0.22, 0.08, 0.0012, -0.0008, -0.02] };

/// Studies against the corner noise, and against the tilt of the boards.
pub(super) fn studies(_effort: Effort) -> Vec<Study> {
    vec![
        study(
            "calibration",
            "Photographs of a board, and noise of its corners",
            Axis::log("noise of the corners", "px"),
            NOISE_PX.map(|noise| [noise, 30.0]).to_vec(),
            |[noise, _]| noise,
        ),
        study(
            "calibration-tilt",
            "Photographs of a board, and its tilt",
            Axis::log("tilt of the boards", "°"),
            TILT_DEG.map(|tilt| [0.1, tilt]).to_vec(),
            |[_, tilt]| tilt,
        ),
    ]
}

fn study(name: &'static str, title: &str, stress: Axis, scenes: Vec<[f64; 2]>, value: fn([f64; 2]) -> f64) -> Study {
    let setting = |n: &usize| {
        let setting = Setting::new("photographs", n.to_string(), *n as f64);
        if [3, 5, 13, 40].contains(n) { setting } else { setting.without_sweep() }
    };
    Study {
        name,
        group: "calibration",
        title: title.into(),
        question: format!(
            "How many photographs of a chessboard does a camera need (`nacre calibrate geometry`, Zhang's method)? A camera of {} × {} pixels whose lens distorts, boards of \
             {} × {} corners in different places, turned and tilted by this angle (30° unless varied) in all directions; corners are off by 0.1 px unless varied. The number is \
             the user's, so that there is no default; messages ask for 10 to 30, and fewer than three are refused. The error is that of both focal \
             lengths. Masked: refused. Wrong and confident: focal lengths more than five of their σ off.",
            SIZE[0], SIZE[1], BOARD.columns, BOARD.rows
        ),
        knob: Axis::log("photographs", ""),
        stress,
        error: Axis::log("relative error of the focal lengths (RMS)", ""),
        time: Axis::log("time of the fit", "s"),
        predicted: "σ of the focal lengths",
        settings: PHOTOGRAPHS.iter().map(setting).collect(),
        scenes: scenes.iter().map(|s| Scene::new(value(*s))).collect(),
        reference: if name == "calibration" { 2 } else { 5 },
        run: Box::new(move |setting, scene, seed| run(PHOTOGRAPHS[setting], scenes[scene], seed)),
    }
}

/// Pose of the `k`-th board in the camera frame.
fn pose(k: usize, tilt_deg: f64, seed: u64) -> Pose {
    let random = |i: u64| uniform(key(&[seed, k as u64, i]));
    let (sin, cos) = (TAU * random(0)).sin_cos();
    let tilt = tilt_deg.to_radians();
    let turn = [tilt * cos, tilt * sin, 0.6 * random(1) - 0.3];
    let at = [100.0 * random(2) - 50.0, 70.0 * random(3) - 35.0, 420.0 + 160.0 * random(4)];
    // The camera looks straight down on the board before the tilt.
    Pose::from_rotation_vector([PI, 0.0, 0.0], [0.0; 3]).then(&Pose::from_rotation_vector(turn, at))
}

fn run(photographs: usize, [noise_px, tilt_deg]: [f64; 2], seed: u64) -> Result<Outcome> {
    let corners = |k: usize| -> Vec<[f64; 2]> {
        let pose = pose(k, tilt_deg, seed);
        let place = |(i, [x, y]): (usize, [f64; 2])| {
            let [u, v] = CAMERA.project(pose.apply([x, y, 0.0]))?;
            let [a, b] = normals(key(&[seed, k as u64, 100 + i as u64]));
            Some([u + noise_px * a, v + noise_px * b])
        };
        BOARD.places().into_iter().enumerate().filter_map(place).collect()
    };
    let good: Vec<_> = (0..photographs).map(|k| (PathBuf::from(format!("{k}.png")), corners(k))).collect();
    let begun = Instant::now();
    let found = of_corners(good, vec![], &BOARD, SIZE, &Silent);
    let seconds = begun.elapsed().as_secs_f64();
    // Boards that do not determine the camera must be refused, with a remedy in the message.
    let Ok(found) = found else {
        return Ok(Outcome { error: None, seconds, masked: 1.0, wrong: 0.0, predicted: None });
    };
    let off = [0, 1].map(|k| (found.camera.focal_px[k] - CAMERA.focal_px[k]) / CAMERA.focal_px[k]);
    let sigma = [0, 1].map(|k| found.sigma[k] / CAMERA.focal_px[k]);
    let wrong = off.iter().zip(&sigma).filter(|(off, s)| off.abs() > 5.0 * **s).count() as f64 / 2.0;
    let root = |of: [f64; 2]| Some((0.5 * (of[0] * of[0] + of[1] * of[1])).sqrt());
    Ok(Outcome { error: root(off), seconds, masked: 0.0, wrong, predicted: root(sigma) })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Focal-length errors match their σ and fall with the number of photographs; boards without tilt are refused.
    #[test]
    fn more_photographs_reduce_errors_and_parallel_ones_do_not() {
        let mean = |photographs, scene| {
            let all = (0..8).map(|seed| run(photographs, scene, seed).unwrap());
            let found: Vec<_> = all.filter_map(|o| Some([o.error?, o.predicted?, o.wrong])).collect();
            let n = found.len() as f64;
            [0, 1, 2].map(|k| found.iter().map(|f| f[k]).sum::<f64>() / n)
        };
        let [few, many] = [5, 20].map(|n| mean(n, [0.1, 30.0]));
        assert!(many[0] < 0.7 * few[0] && many[2] == 0.0 && few[2] == 0.0, "{few:?} {many:?}");
        assert!((0.4..1.6).contains(&(many[0] / many[1])), "{many:?}");
        assert_eq!(run(5, [0.1, 0.5], 3).unwrap().masked, 1.0);
    }
}

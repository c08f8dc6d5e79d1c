//! Ray-traced photographs of boards, independent of the calibration's formulas.

use crate::calibration::{Board, Gray};
use nacre_optics::geometry::{Camera, Pose};
use rayon::prelude::*;

/// Samples per pixel along each axis.
const SUPER: usize = 3;

/// Photograph, with noise, of the shade (0 to 1) that `shade` gives for a ray from `from` along a direction, both in
/// sample coordinates.
pub fn photograph(
    camera: &Camera,
    sample: &Pose,
    [width, height]: [usize; 2],
    noise: f32,
    seed: u64,
    shade: &(dyn Fn([f64; 3], [f64; 3]) -> f64 + Sync),
) -> Gray {
    let back = sample.inverse();
    let from = back.translation_mm;
    let value = |i: usize| {
        let (x, y) = ((i % width) as f64, (i / width) as f64);
        let mut sum = 0.0;
        for k in 0..SUPER * SUPER {
            let sub = |k: usize| (k as f64 + 0.5) / SUPER as f64 - 0.5;
            let pixel = [x + sub(k % SUPER), y + sub(k / SUPER)];
            sum += shade(from, back.turn(straightened(camera, pixel)));
        }
        // The sum of four uniform numbers is approximately normal.
        let mut state = (seed << 32 | i as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mut uniform = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 40) as f32 / (1_u64 << 24) as f32 - 0.5
        };
        let normal: f32 = (0..4).map(|_| uniform()).sum::<f32>() * 3.0_f32.sqrt();
        40.0 + 160.0 * (sum / (SUPER * SUPER) as f64) as f32 + noise * normal
    };
    let values = (0..width * height).into_par_iter().map(value).collect();
    Gray { width, height, values }
}

/// Direction of a pixel, with distortion inverted by fixed-point iteration.
fn straightened(camera: &Camera, pixel: [f64; 2]) -> [f64; 3] {
    let [k1, k2, p1, p2, k3] = camera.distortion;
    let seen = [0, 1].map(|k| (pixel[k] - camera.center_px[k]) / camera.focal_px[k]);
    let [mut x, mut y] = seen;
    for _ in 0..25 {
        let s = x * x + y * y;
        let radial = 1.0 + k1 * s + k2 * s * s + k3 * s * s * s;
        let shift = [2.0 * p1 * x * y + p2 * (s + 2.0 * x * x), p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y];
        [x, y] = [(seen[0] - shift[0]) / radial, (seen[1] - shift[1]) / radial];
    }
    [x, y, 1.0]
}

/// Intersection of a ray with the plane of a pose, in the pose's coordinates; `None` for rays that miss it or meet it
/// from behind.
pub fn meets(pose: &Pose, from: [f64; 3], along: [f64; 3]) -> Option<[f64; 2]> {
    let back = pose.inverse();
    let (from, along) = (back.apply(from), back.turn(along));
    let steps = -from[2] / along[2];
    (steps > 0.0 && from[2] > 0.0).then(|| [from[0] + steps * along[0], from[1] + steps * along[1]])
}

/// Shade of a board in the centre of a plane: dark upper left square, white surroundings.
pub fn squares(board: &Board, [x, y]: [f64; 2]) -> f64 {
    let s = board.square_mm;
    let column = (x / s + 0.5 * (board.columns + 1) as f64).floor();
    let row = (0.5 * (board.rows + 1) as f64 - y / s).floor();
    let inside = column >= 0.0 && row >= 0.0 && column <= board.columns as f64 && row <= board.rows as f64;
    if inside && (column + row) as i64 % 2 == 0 { 0.0 } else { 1.0 }
}

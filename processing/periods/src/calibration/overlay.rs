//! Check picture: a photograph of the board without distortion, with detected and fitted corners.

use super::boards::{Photograph, name};
use super::corners::Board;
use nacre_base::Result;
use nacre_image::Gray;
use nacre_image::{Canvas, Rgb};
use nacre_optics::geometry::Camera;
use rayon::prelude::*;

/// Magnification of the drawn residuals.
const LONGER: f64 = 20.0;

const LINE: Rgb = [60, 160, 255];
const CORNER: Rgb = [0, 220, 60];
const OFF: Rgb = [255, 60, 40];
const STRIPE: usize = 22;

/// Draws a check picture. After removal of distortion, rows and columns of the board are straight. The lines are those
/// of the model, crosses are detected corners, and red lines show residuals magnified 20 times.
///
/// # Errors
/// `Input` if the photograph has changed.
pub fn overlay(photograph: &Photograph, camera: &Camera, board: &Board) -> Result<Canvas> {
    let image = Gray::read(&photograph.path)?;
    let (width, height) = (image.width, image.height);
    let top = image.values.iter().copied().fold(1e-9, f32::max);
    let mut canvas = Canvas::new(width, height + STRIPE, [250, 250, 250]);
    canvas.rgb.par_chunks_exact_mut(3 * width).take(height).enumerate().for_each(|(y, row)| {
        for (x, rgb) in row.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let at = [0, 1].map(|k| ([x as f64, y as f64][k] - camera.center_px[k]) / camera.focal_px[k]);
            let seen = camera.project([at[0], at[1], 1.0]);
            let inside =
                seen.filter(|[x, y]| *x >= 0.0 && *y >= 0.0 && *x <= width as f64 - 1.0 && *y <= height as f64 - 1.0);
            *rgb = [inside.map_or(64, |p| (image.at(p) / top * 255.0) as u8); 3];
        }
    });
    let flat =
        |x: f64, y: f64| [camera.center_px[0] + camera.focal_px[0] * x, camera.center_px[1] + camera.focal_px[1] * y];
    let model: Vec<[f64; 2]> = board
        .places()
        .iter()
        .map(|p| {
            let [x, y, z] = photograph.pose.apply([p[0], p[1], 0.0]);
            flat(x / z, y / z)
        })
        .collect();
    for row in 0..board.rows {
        line(&mut canvas, model[row * board.columns], model[(row + 1) * board.columns - 1], LINE);
    }
    for column in 0..board.columns {
        line(&mut canvas, model[column], model[(board.rows - 1) * board.columns + column], LINE);
    }
    for (corner, model) in photograph.corners.iter().zip(&model) {
        let Some([x, y, z]) = camera.ray(*corner) else { continue };
        let found = flat(x / z, y / z);
        for (dx, dy) in [(3.0, 3.0), (3.0, -3.0)] {
            line(&mut canvas, [found[0] - dx, found[1] - dy], [found[0] + dx, found[1] + dy], CORNER);
        }
        let end = [0, 1].map(|k| found[k] + LONGER * (model[k] - found[k]));
        line(&mut canvas, found, end, OFF);
    }
    let words = format!(
        "{}, lens undone: corners are {:.3} px RMS off the model (red, {LONGER} times as long)",
        name(&photograph.path),
        photograph.rms_px
    );
    canvas.text(6.0, height as f32 + 4.0, 14.0, [25, 25, 25], &words);
    Ok(canvas)
}

/// Draws a line one pixel wide.
fn line(canvas: &mut Canvas, from: [f64; 2], to: [f64; 2], color: Rgb) {
    let length = (to[0] - from[0]).abs().max((to[1] - from[1]).abs());
    // Lines far outside of the picture are invisible.
    if length.is_nan() || length >= 1e5 {
        return;
    }
    let steps = length.ceil().max(1.0) as usize;
    for k in 0..=steps {
        let [x, y] = [0, 1].map(|c| from[c] + (to[c] - from[c]) * k as f64 / steps as f64);
        if x >= 0.0 && y >= 0.0 {
            canvas.set(x.round() as usize, y.round() as usize, color);
        }
    }
}
